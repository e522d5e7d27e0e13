"""An algebraic stand-in for an engine: three inputs, five outputs, four health parameters, one bias."""

from __future__ import annotations

from dataclasses import dataclass
from types import SimpleNamespace

import numpy as np
from parameter_makers import meaning_of

from enginediag_cli.identification.nominal import Envelope
from enginediag_cli.parameters import Parameter
from enginediag_cli.recordings.table import Recording
from enginediag_cli.residuals.instruments import NoiseModel
from enginediag_cli.residuals.monitor import Monitor, Offset

SENSORS = ("T3_K", "P3_Pa", "T5_K", "N1_rpm", "N2_rpm")
SIGMA = np.array([1.0, 2e3, 2.0, 5.0, 10.0])
HEALTH = ("fan.efficiency", "hpc.efficiency", "hpc.flow_capacity", "hpt.efficiency")


def outputs(u, theta):
    """Five smooth functions of altitude, Mach and fuel flow, curved in the parameters."""
    h, M, w = u
    a, b, c, d, bias = theta
    load = w / (a * d) * (1 + 0.2 * M**2) * (1 - h / 40e3)
    return np.stack(
        [
            300 + 400 * load / (b**2 * c) + bias,
            4e5 * (1 + load) * c**1.5 / b,
            700 + 500 * load**1.2 / (d**2 * b * c),
            2000 * (1 + 0.5 * load) * a * c**-0.5,
            7000 * (1 + 0.3 * load / d) / c,
        ],
        axis=-1,
    )


@dataclass(frozen=True)
class ToyEngine:
    name: str = "toy"
    inputs: tuple[str, ...] = ("altitude_m", "mach", "Wf_kg_s")

    def __post_init__(self):
        names = [*((n, 1.0, 0.02) for n in HEALTH), ("sensor.T3.bias", 0.0, 5.0)]
        parameters = {n: Parameter(n, "health", x, x - 10 * s, x + 10 * s, s) for n, x, s in names}
        for name, value in (
            ("parameters", parameters),
            ("monitored", HEALTH),
            ("sensors", dict.fromkeys(SENSORS)),
            ("optional_inputs", {"humidity_kg_kg": 0.0}),
        ):
            object.__setattr__(self, name, value)

    def predict(self, inputs, parameters=None, *, sensors=None, wrt=()):
        """Complex-step sensitivities; records above 13 km do not converge."""
        u = [np.asarray(inputs[c], float) for c in self.inputs]
        values = {n: p.nominal for n, p in self.parameters.items()} | dict(parameters or {})
        theta = [np.broadcast_to(np.asarray(values[n], float), u[0].shape) for n in self.parameters]
        chosen = [SENSORS.index(c) for c in sensors or SENSORS]
        status = np.where(u[0] > 13e3, 2, 0).astype(np.int8)
        y = np.where(status[:, None] < 2, outputs(u, theta)[:, chosen], np.nan)
        J = np.empty((*y.shape, len(wrt)))
        for i, name in enumerate(wrt):
            step = [t + 1e-30j if n == name else t for n, t in zip(self.parameters, theta, strict=True)]
            moved = [x + 1e-30j if c == name else x for c, x in zip(self.inputs, u, strict=True)]
            J[:, :, i] = outputs(moved, step)[:, chosen].imag / 1e-30
        return SimpleNamespace(
            y=y,
            jacobian=J,
            status=status,
            ok=status <= 1,
            reason=lambda k: "hp shaft power not met" if status[k] else "",
        )


def toy_monitor(*, offset=0.0, uncertain=0.0, rho=0.0) -> Monitor:
    """Monitor of four health parameters; `offset`: sigma of a T5 offset; `uncertain`: of sensor.T3.bias."""
    engine = ToyEngine()
    names, sigma = [*HEALTH], [0.02] * 4
    if uncertain:
        names, sigma = [*names, "sensor.T3.bias"], [*sigma, uncertain]
    if offset:
        names, sigma = [*names, "offset.T5_K.bias"], [*sigma, offset]
    C = np.zeros((len(names), len(names)))
    C[range(4, len(names)), range(4, len(names))] = np.square(sigma[4:])
    theta0 = np.array([1.0] * 4 + [0.0] * (len(names) - 4))
    bound = np.array([0.2] * 4 + [np.inf] * (len(names) - 4))
    envelope = Envelope(
        engine.inputs, np.array([1e4, 0.5, 1.0]), np.zeros(3), np.ones(3), np.array([[5e3, 0.5, 1.0]]), 3.0
    )
    return Monitor(
        engine=engine,
        sensors=SENSORS,
        base={},
        names=tuple(names),
        monitored=HEALTH,
        meaning=meaning_of(HEALTH),
        offsets=(Offset(2, "bias"),) if offset else (),
        theta0=theta0,
        prior_sigma=np.array(sigma),
        lower=theta0 - bound,
        upper=theta0 + bound,
        uncertainty=C,
        noise=NoiseModel(SIGMA, np.full(5, rho)),
        envelope=envelope,
    )


def toy_recording(rng, n=200, *, change=None, flights=1, shift=None, noise=1.0, source="toy.csv") -> Recording:
    """Flights of n records each of the toy engine with `change` of parameters and `shift` of sensors."""
    N = n * flights
    columns = {
        "altitude_m": rng.uniform(0, 11e3, N),
        "mach": rng.uniform(0, 0.85, N),
        "Wf_kg_s": rng.uniform(0.4, 1.2, N),
    }
    parameters = {name: 1 + delta for name, delta in (change or {}).items()}
    y = ToyEngine().predict(columns, parameters).y + noise * SIGMA * rng.standard_normal((N, 5))
    y = y + (0 if shift is None else np.asarray(shift))
    columns |= {c: y[:, j] for j, c in enumerate(SENSORS)}
    columns["time_s"] = np.tile(np.arange(n) * 10.0, flights)
    return Recording(
        columns,
        {"flight": [str(k) for k in np.repeat(np.arange(flights), n)]},
        line=np.arange(2, N + 2),
        source=source,
    )
