"""A linear engine with the sensitivities of a real one along simulated flights, for studies that need many windows.

y = J_k δ + noise, δ the departures of all parameters from the engine file's values, with J_k (m, p) computed once. The
product's own identification, statistics and thresholds run on it as on an engine.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from scipy.signal import lfilter

from enginediag_cli.identification.identify import identify
from enginediag_cli.identification.nominal import Nominal
from enginediag_cli.identification.problem import IdentificationSettings, TrainingRecording
from enginediag_cli.parameters import Parameter
from enginediag_cli.physics.engine_file import load_engine
from enginediag_cli.simulation.flights import default_plan, engine_inputs, generate_flights

FLIGHTS = 12
NEGLIGIBLE = 5e-5
"""Information per record of a direction of uncertain parameters that is left out, as in `residuals.compact`."""


@dataclass(frozen=True)
class Flown:
    """Sensitivities J (N, m, p) of flown records, phase (N,) and flight (N,); sigma (m,).

    The monitored parameters come first. What is uncertain besides them has been turned to its principal directions
    `uncertain.1` …, of prior standard deviation 1, and those that no record notices left out.
    """

    J: np.ndarray
    phase: np.ndarray
    flight: np.ndarray
    sigma: np.ndarray
    prior: np.ndarray
    names: tuple[str, ...]
    monitored: tuple[str, ...]
    sensors: tuple[str, ...]


def fly(engine_file: str | Path, seed: int = 1, flights: int = FLIGHTS) -> Flown:
    """Sensitivities of the engine along simulated flights to monitored, design and sensor parameters."""
    engine = load_engine(engine_file)
    given = generate_flights(default_plan(engine), engine, np.random.default_rng(seed), flights=flights)
    rest = [
        n
        for n, p in engine.parameters.items()
        if n not in engine.monitored and p.prior_sigma > 0 and p.family != "physics"
    ]
    names = (*engine.monitored, *rest)
    found = engine.predict(engine_inputs(engine, given), wrt=names)
    ok = np.asarray(found.ok)
    sigma = np.array([s.noise_sigma for s in engine.sensors.values()])
    prior = np.array([engine.parameters[n].prior_sigma for n in names])
    a, J = len(engine.monitored), np.asarray(found.jacobian)[ok]
    effect = J[:, :, a:] * prior[a:]
    whitened = (effect / sigma[:, None]).reshape(-1, len(rest))
    strength, directions = np.linalg.eigh(whitened.T @ whitened / len(J))
    leading = directions[:, strength > NEGLIGIBLE][:, ::-1]
    r = leading.shape[1]
    return Flown(
        np.concatenate([J[:, :, :a], effect @ leading], axis=2),
        np.asarray(given.columns["phase"])[ok],
        np.asarray(given.columns["flight"])[ok].astype(float),
        sigma,
        np.concatenate([prior[:a], np.ones(r)]),
        (*engine.monitored, *(f"uncertain.{i + 1}" for i in range(r))),
        engine.monitored,
        tuple(engine.sensors),
    )


def draw_noise(rng: np.random.Generator, kind: str, rho: float, shape: tuple[int, ...]) -> np.ndarray:
    """Unit-variance noise (..., n, m), correlated along n."""
    if kind == "uniform":
        return rng.uniform(-np.sqrt(3), np.sqrt(3), shape)
    white = rng.standard_normal(shape)
    if not rho:
        return white
    shocks = np.sqrt(1 - rho**2) * white
    shocks[..., 0, :] = white[..., 0, :]
    return np.asarray(lfilter([1.0], [1.0, -rho], shocks, axis=-2))


@dataclass(frozen=True)
class Predicted:
    """What a fit asks of a prediction."""

    y: np.ndarray
    jacobian: np.ndarray
    status: np.ndarray

    @property
    def ok(self) -> np.ndarray:
        return self.status == 0


@dataclass(frozen=True)
class Sensor:
    """What a fit asks of a sensor."""

    noise_sigma: float


class LinearEngine:
    """y = J δ; its only input is the number of the flown record."""

    inputs = ("record",)

    def __init__(self, flown: Flown):
        self._flown = flown
        self._columns = {name: i for i, name in enumerate(flown.names)}
        self.optional_inputs: Mapping[str, float] = {}
        self.sensors = {name: Sensor(float(s)) for name, s in zip(flown.sensors, flown.sigma, strict=True)}
        self.parameters = {
            name: Parameter(name, "design", 0.0, -np.inf, np.inf, float(sigma))
            for name, sigma in zip(flown.names, flown.prior, strict=True)
        }

    def predict(
        self,
        inputs: Mapping[str, Any],
        parameters: Mapping[str, Any] | None = None,
        *,
        sensors: Sequence[str] | None = None,
        wrt: Sequence[str] = (),
    ) -> Predicted:
        delta = np.array([(parameters or {}).get(name, 0.0) for name in self._columns], float)
        J = self._flown.J[np.asarray(inputs["record"]).astype(int)]
        assert sensors is None or tuple(sensors) == self._flown.sensors
        found = J if tuple(wrt) == self._flown.names else J[:, :, [self._columns[name] for name in wrt]]
        return Predicted(J @ delta, found, np.zeros(len(J), np.int8))


def identified(
    rng: np.random.Generator, flown: Flown, records: int, kind: str, rho: float
) -> tuple[np.ndarray, Nominal] | None:
    """Error of the identified parameters (p,) and their nominal, from the first `records` records that were flown;
    None when identification did not converge.

    The engine is drawn from the priors; parameters and noise are identified as by `enginediag identify`.
    """
    rows = np.arange(records)
    truth = flown.prior * rng.standard_normal(len(flown.prior))
    y = flown.J[rows] @ truth + flown.sigma * draw_noise(rng, kind, rho, (records, len(flown.sigma)))
    engine = LinearEngine(flown)
    training = [
        TrainingRecording(
            f"flight {number:g}",
            {"record": rows[here].astype(float), **dict(zip(flown.sensors, y[here].T, strict=True))},
            np.full(int(here.sum()), "all"),
        )
        for number in np.unique(flown.flight[rows])
        for here in [flown.flight[rows] == number]
    ]
    found = identify(engine, training, settings=IdentificationSettings(), cross_validation=False)
    if not found.converged:
        return None
    nominal = found.nominal("linear", "", {})
    return truth - np.array([nominal.theta0[name] for name in flown.names]), nominal
