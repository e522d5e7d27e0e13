"""Windows for the tests of the residual families, of a linear engine and of the curved toy engine."""

from __future__ import annotations

from dataclasses import dataclass
from types import SimpleNamespace

import numpy as np
from parameter_makers import meaning_of
from toy_engine import SIGMA, toy_monitor

from enginediag_cli.methods.base import RecordWindows
from enginediag_cli.parameters import Parameter
from enginediag_cli.residuals.instruments import NoiseModel
from enginediag_cli.residuals.monitor import Monitor

NAMES = ("a", "b", "c")
SENSORS = ("y1", "y2", "y3", "y4")
NOISE = np.array([0.5, 1.0, 2.0, 0.7])
A = np.array([[1.0, 0.3, 0.0], [0.2, 1.5, 1.0], [2.0, 0.0, 1.5], [0.4, 0.5, -0.6]])
B = np.array([[0.0, 0.5, 0.2], [0.3, 0.0, -0.5], [0.0, 1.0, 0.0], [0.4, -0.3, 0.2]])


@dataclass(frozen=True)
class LinearEngine:
    """y = (A + u B) θ."""

    name: str = "linear"
    inputs: tuple[str, ...] = ("u",)
    optional_inputs: tuple[()] = ()
    monitored: tuple[str, ...] = NAMES

    @property
    def sensors(self):
        return dict.fromkeys(SENSORS)

    @property
    def parameters(self):
        return {n: Parameter(n, "health", 0.0, -100.0, 100.0, 1.0) for n in NAMES}

    def predict(self, inputs, parameters=None, *, sensors=None, wrt=()):
        J = A + np.asarray(inputs["u"])[:, None, None] * B
        theta = np.stack([np.broadcast_to(parameters[n], len(J)) for n in NAMES], axis=1)
        ok = np.isfinite(J).all(axis=(1, 2))
        columns = [NAMES.index(n) for n in wrt]
        return SimpleNamespace(y=np.einsum("kjp,kp->kj", J, theta), jacobian=J[:, :, columns], ok=ok)


def linear_monitor(*, rho=0.0, uncertain=0.0) -> Monitor:
    """Monitor of the linear engine; `uncertain`: standard deviation of θ0 as identified."""
    C = uncertain**2 * np.eye(3)
    ones = np.ones(3)
    noise = NoiseModel(NOISE, np.full(4, rho))
    meaning = meaning_of(NAMES)
    return Monitor(
        engine=LinearEngine(),
        sensors=SENSORS,
        base={},
        names=NAMES,
        monitored=NAMES,
        meaning=meaning,
        offsets=(),
        theta0=0 * ones,
        prior_sigma=ones,
        lower=-100 * ones,
        upper=100 * ones,
        uncertainty=C,
        noise=noise,
    )


def ar1(rng, shape, rho):
    """Unit AR(1) noise (W, n, m), correlated along the second axis."""
    e = rng.standard_normal(shape)
    for k in range(1, shape[1]):
        e[:, k] = rho * e[:, k - 1] + np.sqrt(1 - rho**2) * e[:, k]
    return e


def linear_windows(rng, W, n, *, change=(0, 0, 0), since=0, rho=0.0, uncertain=0.0) -> RecordWindows:
    """Windows of the linear engine with a change of the parameters from record `since` on."""
    u = rng.uniform(-1, 1, (W, n))
    J = A + u[:, :, None, None] * B
    theta = np.where(np.arange(n)[:, None] >= since, np.asarray(change, float), 0.0)
    theta = theta[None] + uncertain * rng.standard_normal((W, 1, 3))
    return RecordWindows({"u": u}, np.einsum("wkjp,wkp->wkj", J, theta) + NOISE * ar1(rng, (W, n, 4), rho))


def toy_windows(rng, W, n, change=None, monitor=None) -> RecordWindows:
    """Windows of the curved toy engine with white noise and changed parameters by position."""
    monitor = monitor or toy_monitor()
    u = {
        "altitude_m": rng.uniform(0, 11e3, (W, n)),
        "mach": rng.uniform(0, 0.85, (W, n)),
        "Wf_kg_s": rng.uniform(0.4, 1.2, (W, n)),
    }
    theta = monitor.theta0.copy()
    for i, delta in (change or {}).items():
        theta[i] += delta
    y = monitor.predict({c: v.ravel() for c, v in u.items()}, theta)[0].reshape(W, n, -1)
    return RecordWindows(u, y + SIGMA * rng.standard_normal(y.shape))


def within_binomial(hits, level, sigmas=4.0) -> bool:
    """Whether the rate of hits agrees with `level` to so many binomial standard errors."""
    return abs(np.mean(hits) - level) < sigmas * np.sqrt(level * (1 - level) / np.size(hits))
