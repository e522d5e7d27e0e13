"""Fleets of the shipped turbofan as local statistics: flights in its own geometry, without a recording in between.

A flight is RECORDS records at one operating point of an airliner's cruise or climb. Healthy engines differ from the
engine file (health, offsets of instruments); from flight to flight their readings are off by offsets of the
instruments, by an error of the power that nobody records, which moves all readings at once, and by what the model
misses at an operating point, each engine with its own size of each. Wanted, instruments drift besides.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from pathlib import Path
from types import SimpleNamespace

import numpy as np

from enginediag_cli.detection.series import FlightWindow, Series
from enginediag_cli.fleets.engine_judgement import judge_engine
from enginediag_cli.fleets.findings import EngineFinding, EngineHistory, FleetSettings, MaintenanceEvent
from enginediag_cli.fleets.margin import MarginScale, margin_scale
from enginediag_cli.history.engines import EngineSums
from enginediag_cli.physics.engine_file import load_engine
from enginediag_cli.residuals.monitor import Monitor
from enginediag_cli.residuals.statistics import LocalStatistics
from enginediag_cli.residuals.windows import WindowStatistics
from enginediag_cli.simulation.flights import ColumnNoise
from enginediag_cli.validation.studies import known_nominal

ENGINE = Path(__file__).parents[2] / "configs" / "turbofan.yaml"
RECORDS = 20
POINTS = 400
BASELINE = 20


@dataclass(frozen=True)
class Geometry:
    """Sensitivities J (POINTS, m, p) at operating points, their `conditions`, effect of one per cent of the power
    setting (POINTS, m), noise sigma (m,)."""

    monitor: Monitor
    conditions: dict[str, np.ndarray]
    J: np.ndarray
    power: np.ndarray
    sigma: np.ndarray

    @property
    def like(self) -> LocalStatistics:
        """Of no record."""
        p = len(self.monitor.monitored)
        of_none = np.zeros(p), np.zeros((p, p)), np.zeros((p, p)), 0, 0.0, 0.0
        return LocalStatistics(self.monitor.monitored, self.monitor.theta0, self.monitor.prior_sigma, *of_none)


@lru_cache(maxsize=1)
def geometry() -> Geometry:
    rng = np.random.default_rng(0)
    engine = load_engine(ENGINE)
    noise = {c: ColumnNoise("gaussian", sigma=s.noise_sigma) for c, s in engine.sensors.items()}
    monitor = known_nominal(engine, (*engine.monitored, "sensor.*.bias"), noise)
    inputs = {
        "altitude_m": rng.uniform(6e3, 11e3, POINTS),
        "mach": rng.uniform(0.6, 0.82, POINTS),
        "dT_isa_K": rng.uniform(-10, 10, POINTS),
    }
    inputs["Wf_kg_s"] = engine.power_from_fraction(rng.uniform(0.7, 0.95, POINTS), inputs)
    found = engine.predict(inputs, wrt=(*monitor.names, "Wf_kg_s"))
    J = np.asarray(found.jacobian)
    power = 0.01 * inputs["Wf_kg_s"][:, None] * J[:, :, -1]
    return Geometry(monitor, inputs, J[:, :, :-1], power, monitor.noise.sigma)


def series(engine: bool = False) -> Series:
    """What the parameters of these fleets are, with the engine itself if wanted; the stretches come with histories."""
    g = geometry()
    envelope = SimpleNamespace(inputs=tuple(g.conditions), points=np.stack(list(g.conditions.values()), axis=1))
    monitor = replace(g.monitor, envelope=envelope) if engine else None
    return Series({}, dict(g.monitor.meaning), 0, power_inputs=("Wf_kg_s",), monitor=monitor)


def engine_history(
    rng: np.random.Generator,
    serial: str,
    flights: int,
    change: np.ndarray | None = None,
    events: tuple[MaintenanceEvent, ...] = (),
    scatter: float = 1.0,
    wander: float = 0.0,
) -> EngineHistory:
    """A history of `flights` flights; change (flights, p): of the parameters, in prior standard deviations; scatter: of
    flights, by how much larger than the usual one; wander: of each instrument over some flights, by how much of its
    offsets."""
    g = geometry()
    at = rng.integers(POINTS, size=flights)
    J, m = g.J[at], len(g.sigma)
    D = g.monitor.prior_sigma
    e = np.zeros((flights, m))
    e += (J * D) @ (0.25 * rng.standard_normal(len(D)))  # how this engine differs from its type
    offsets = scatter * rng.uniform(0.1, 0.6, m) * g.sigma
    e += offsets * rng.standard_normal((flights, m))
    e += scatter * rng.uniform(0.0, 0.2) * rng.standard_normal((flights, 1)) * g.power[at]
    u = np.stack([(v - v.mean()) / v.std() for c, v in g.conditions.items() if c != "Wf_kg_s"], axis=1)[at]
    functions = np.concatenate([u, u**2 - 1, u[:, :1] * u[:, 1:]], axis=1)
    e += 0.3 * functions @ (offsets * rng.standard_normal((functions.shape[1], m)))
    if wander:
        apart = np.abs(np.subtract.outer(np.arange(flights), np.arange(flights)))
        L = np.linalg.cholesky(np.exp(-apart / rng.uniform(5, 30)) + 1e-9 * np.eye(flights))
        e += wander * offsets * (L @ rng.standard_normal((flights, m)))
    e += g.sigma / np.sqrt(RECORDS) * rng.standard_normal((flights, m))
    if change is not None:
        e += np.einsum("nmp,np->nm", J, change * D)
    return history_of(serial, [_stretch(serial, k, at[k], e[k]) for k in range(flights)], BASELINE, events)


def history_of(
    serial: str, stretches: Sequence[FlightWindow], baseline: int, events: tuple[MaintenanceEvent, ...] = ()
) -> EngineHistory:
    """With the sums of the statistics of these flights."""
    sums = EngineSums(geometry().like)
    for k, stretch in enumerate(stretches):
        sums.add(k, stretch.statistics)
    return EngineHistory(serial, "", stretches, sums, baseline, events)


def _stretch(serial: str, k: int, at: int, e: np.ndarray) -> FlightWindow:
    g = geometry()
    weighed = g.J[at].T / g.sigma**2
    F = RECORDS * weighed @ g.J[at]
    statistics = LocalStatistics(
        g.monitor.monitored, g.monitor.theta0, g.monitor.prior_sigma, RECORDS * weighed @ e, F, F, RECORDS, 0.0, 0.0
    )
    conditions = {c: float(v[at]) for c, v in g.conditions.items()}
    window = WindowStatistics(
        serial, str(k + 1), serial, 1, RECORDS, 0.0, 1.0, RECORDS, 0, 0, 0, statistics, conditions=conditions
    )
    return FlightWindow(window, statistics)


def fault(rng: np.random.Generator, flights: int) -> np.ndarray:
    """What one component loses: efficiency and flow capacity, at once or growing, from some flight after the baseline;
    one prior standard deviation in all."""
    names = geometry().monitor.monitored
    component = rng.choice(["fan", "booster", "hpc", "hpt", "lpt"])
    onset = rng.integers(BASELINE, max(3 * flights // 4, BASELINE + 1))
    ratio = rng.uniform(0.0, 1.0)
    size = np.array([1.0, ratio]) / np.hypot(1.0, ratio)
    t = np.arange(flights)
    grows = rng.random() < 0.5
    course = np.clip((t - onset) / (flights - onset), 0, None) if grows else (t >= onset).astype(float)
    change = np.zeros((flights, len(names)))
    for quantity, s in zip(("efficiency", "flow_capacity"), size, strict=True):
        change[:, names.index(f"{component}.{quantity}")] = -s * course
    return change


SETTINGS = FleetSettings(limits_K={"T45_K": 1500.0})


@lru_cache(maxsize=1)
def known() -> Series:
    """What the parameters are, with the engine."""
    return series(engine=True)


@lru_cache(maxsize=1)
def scale() -> MarginScale:
    """The margin of the engine."""
    return margin_scale(known())


def judged(history: EngineHistory, settings: FleetSettings = SETTINGS) -> EngineFinding:
    """The finding of one engine of these fleets."""
    return judge_engine(history, known(), settings, scale())


def lost(flights: int, sizes: dict[str, float], course: np.ndarray) -> np.ndarray:
    """Change (flights, p): parameters that have gone by `sizes`, in prior standard deviations, along a course."""
    names = geometry().monitor.monitored
    change = np.zeros((flights, len(names)))
    for name, size in sizes.items():
        change[:, names.index(name)] = size * course
    return change
