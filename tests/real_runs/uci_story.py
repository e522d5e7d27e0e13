"""The power-plant turbine of 2011 and 2012: what its model lacks, found with humidity withheld and vanes unrecorded.

Every step is a function that returns numbers; `uci_mismatch.py` prints them and `test_uci_mismatch.py` states them.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from ground_recordings import CONFIGS, public_data

from enginediag_cli.mismatch.fit.evidence import Dataset, Flight
from enginediag_cli.mismatch.fit.freeform import Location, list_locations
from enginediag_cli.mismatch.fit.identified import NULL_HYPOTHESIS, Hypothesis, Nuisance, nuisance
from enginediag_cli.mismatch.fit.load import MismatchQuery, build_dataset
from enginediag_cli.mismatch.unrecorded.control_law import HeldReading, Stop, by_law, find_stop, held_readings
from enginediag_cli.mismatch.unrecorded.per_record import PerRecord, amplitudes_at, fit_per_record, scan
from enginediag_cli.mismatch.unrecorded.per_record_effects import BLOCK, Beside, Rows, effects_beside, inflation
from enginediag_cli.physics.engine_file import load_engine
from enginediag_cli.physics.registry import candidate_effects, effect
from enginediag_cli.recordings.recorder_file import load_recorder

ENGINE, RECORDER = CONFIGS / "power_plant.yaml", CONFIGS / "recorders" / "uci_gas_turbine.yaml"
WITHHELD = ("relative_humidity", "humidity_kg_kg")
PLACE = "compressor.flow_capacity"
SENSORS = {"P3_Pa": "CDP", "T5_K": "TAT", "power_W": "TEY", "dP_exhaust_Pa": "GTEP"}
PART_BELOW, BASE_ABOVE, BASE_TAT_BELOW = 1370.15, 1372.45, 822.15  # K: 1097, 1099.3 and 549 °C


def part_load(columns: Mapping[str, np.ndarray]) -> np.ndarray:
    return np.asarray(columns["T4_K"] < PART_BELOW)


def base_load(columns: Mapping[str, np.ndarray]) -> np.ndarray:
    return np.asarray((columns["T4_K"] > BASE_ABOVE) & (columns["T5_K"] < BASE_TAT_BELOW))


REGIMES = {"part load": part_load, "base load": base_load}


@dataclass(frozen=True)
class Year:
    """Steady hours of one year, every `thin`-th: the evidence, what identification carries along, and the recorded
    humidity (N,), which is not in the evidence unless it was asked for."""

    evidence: Dataset
    along: Nuisance
    humidity: np.ndarray

    @property
    def columns(self) -> Mapping[str, np.ndarray]:
        return self.evidence.flights[0].columns


def load_years(
    *years: int,
    thin: int = 1,
    regime: str = "",
    without: Sequence[str] = (),
    humidity: float | None = None,
    map_accuracy: float | None = None,
) -> list[Year]:
    """`regime`: only its hours; `without`: further columns left out; `humidity`: factor on the recorded humidity, which
    is then given, None to withhold it; `map_accuracy`: None for the engine file's. The floor's curves are of all the
    years' operating points together (no readings), so that what one year teaches holds in the other."""
    flights, moist = [], []
    for year in years:
        [mapped] = load_recorder(RECORDER).read(public_data("uci_gas_turbine") / f"gt_{year}.csv")
        columns = {c: mapped.recording[c][::thin] for c in mapped.recording.columns}
        if regime:
            keep = REGIMES[regime](columns)
            columns = {c: v[keep] for c, v in columns.items()}
        moist.append(columns["humidity_kg_kg"])
        given = {c: v for c, v in columns.items() if c not in (*WITHHELD, *without)}
        if humidity is not None:
            given["humidity_kg_kg"] = humidity * moist[-1]
        flights.append(Flight(str(year), "", given))
    evidence = build_dataset(load_engine(ENGINE), flights, MismatchQuery(model_error=map_accuracy))
    along, found, first = nuisance(evidence), [], 0
    for k, w in enumerate(moist):
        own = {name: curve[first : first + len(w)] for name, curve in along.curves.items()}
        found.append(Year(evidence.only([k]), replace(along, curves=own), w))
        first += len(w)
    return found


def places(year: Year) -> list[Location]:
    return list_locations(year.evidence.engine, tuple(year.evidence.noise.sigma))


def place(year: Year) -> Location:
    return next(p for p in places(year) if p.name == PLACE)


def locate(year: Year) -> list[PerRecord]:
    """One free amplitude per hour at each place in turn, best first."""
    return scan(year.evidence, places(year), year.along)


COMPUTED, KAPPA = "computed_reading@T4", "computed_reading.T4.ignored"


def hypothesis(year: Year, *labels: str) -> Hypothesis:
    return Hypothesis(tuple(effect(year.evidence.engine, *label.split("@")) for label in labels))


def vanes(year: Year, *labels: str, start: PerRecord | None = None) -> PerRecord:
    """Compressor flow free in every hour, with these effects."""
    h = hypothesis(year, *labels) if labels else NULL_HYPOTHESIS
    return fit_per_record(year.evidence, place(year), year.along, h, (start,) if start else (None,))


def plain(year: Year) -> PerRecord:
    """The model as it is."""
    return fit_per_record(year.evidence, None, year.along)


Errors = Mapping[str, Mapping[str, float]]
"""Regime → CDP, TEY, GTEP in per cent and TAT in K, root mean square."""


def predicted(trained: PerRecord, year: Year, sensors: Sequence[str]) -> Errors:
    """Error of every sensor in a year at the trained parameters, the amplitude taken from `sensors` alone."""
    found = amplitudes_at(year.evidence, trained, year.along, sensors)
    return {name: _errors(found, year, regime(year.columns)) for name, regime in REGIMES.items()}


def _errors(found: PerRecord, year: Year, rows: np.ndarray) -> Mapping[str, float]:
    rms = np.sqrt(np.nanmean((found.residual[rows] * found.sigma) ** 2, axis=0))
    mean = {s: float(np.mean(year.columns[s][rows])) for s in found.sensors}
    return {
        SENSORS[s]: float(r) if s == "T5_K" else float(100.0 * r / mean[s])
        for s, r in zip(found.sensors, rms, strict=True)
    }


@dataclass(frozen=True)
class Position:
    """What the hidden amplitude looks like: its stop, what it holds, and what that law alone predicts (per cent)."""

    stop: Stop
    held: tuple[HeldReading, ...]
    law: Mapping[str, float]


def position(year: Year, fit: PerRecord) -> Position:
    stop = find_stop(fit, year.columns["ambient_temperature_K"])
    held = held_readings(year.evidence, fit, year.along, stop)
    error = by_law(year.evidence, fit, year.along, held[0], part_load(year.columns))
    return Position(stop, tuple(held), {SENSORS[s]: 100.0 * rms / mean for s, (rms, mean) in error.items()})


@dataclass(frozen=True)
class Second:
    """Effects scored beside the free flow, and the best of them fitted: label → χ² it removes, over `inflation`."""

    scores: tuple[Beside, ...]
    removed: Mapping[str, float]
    inflation: float
    fits: Mapping[str, PerRecord]


def second_effect(year: Year, fit: PerRecord, thin: int, most: int = 5) -> Second:
    """The `most` best effects that can be ranked, by the fall of χ² that their score promises, are fitted."""
    scores = effects_beside(year.evidence, fit, list(candidate_effects(year.evidence.engine)), max(1, BLOCK // thin))
    short = sorted((b for b in scores if b.rankable), key=lambda b: -b.fall)[:most]
    divisor = inflation(fit)
    fits, removed = {}, {}
    for b in short:
        h = replace(fit.hypothesis, effects=(*fit.hypothesis.effects, b.effect))
        new = fit_per_record(year.evidence, fit.location, year.along, h, (fit,))
        fits[b.effect.label] = new
        removed[b.effect.label] = (fit.objective - new.objective) / divisor
    return Second(tuple(scores), dict(sorted(removed.items(), key=lambda kv: -kv[1])), divisor, fits)


HUMIDITY = "humidity@ambient"


@dataclass(frozen=True)
class HumidityCheck:
    """`coefficient`: of the recorded humidity when it is given, 1 if it were seen; `correlation`: of the hidden
    estimate's day means with the withheld column's, ambient temperature taken out of both; `absorbed`: share of the
    square of what humidity does to the readings that flow, parameters and tolerance of the maps explain."""

    coefficient: float
    correlation: float
    absorbed: float


def humidity_check(regime: str, thin: int) -> HumidityCheck:
    [year] = load_years(2011, thin=thin, regime=regime)
    fit = vanes(year, COMPUTED)
    # readings in σ that the withheld humidity would have moved, and per unit of it
    moved = _at(year, replace(fit, inputs={**fit.inputs, "humidity_kg_kg": year.humidity})) - _at(year, fit)
    per_unit = moved / year.humidity[:, None]
    own = fit.direction / np.linalg.norm(fit.direction, axis=1)[:, None]
    across, e = (v - own * (own * v).sum(axis=1)[:, None] for v in (per_unit, fit.residual))
    hidden = (across * e).sum(axis=1) / (across**2).sum(axis=1)
    T = year.columns["ambient_temperature_K"]
    means = [_day_means(_beyond(v, T), max(1, 24 // thin)) for v in (hidden, year.humidity)]
    left = Rows(fit).projected(moved[:, :, None])[:, 0]
    absorbed = 1.0 - float(left @ left) / float((moved**2).sum())
    return HumidityCheck(_coefficient(regime, thin), float(np.corrcoef(*means)[0, 1]), absorbed)


def _coefficient(regime: str, thin: int) -> float:
    """Where the parabola through χ² at 0, 1 and 2 times the recorded humidity is lowest."""
    at: list[float] = []
    start = None
    for factor in (0.0, 1.0, 2.0):
        [year] = load_years(2011, thin=thin, regime=regime, humidity=factor)
        start = vanes(year, COMPUTED, start=start)
        at.append(start.objective)
    bend = at[0] - 2.0 * at[1] + at[2]
    return 1.0 - 0.5 * (at[2] - at[0]) / bend


def _at(year: Year, fit: PerRecord) -> np.ndarray:
    """Readings that the model gives (N, m), in σ, at the fit and the inputs that it carries."""
    engine = year.evidence.engine.replace_effects((*year.evidence.engine.effects, *fit.hypothesis.effects))
    theta: dict = {n: v for n, v in fit.theta.items() if n in engine.parameters}
    assert fit.location is not None
    theta[fit.location.parameter] = fit.theta[fit.location.parameter] + fit.amplitude
    inputs = {c: fit.inputs[c] for c in (*engine.inputs, *engine.optional_inputs)}
    return np.asarray(engine.predict(inputs, theta, sensors=fit.sensors).y / fit.sigma)


def _beyond(values: np.ndarray, T: np.ndarray) -> np.ndarray:
    """Values (N,) less their regression on a parabola in ambient temperature."""
    A = np.polynomial.chebyshev.chebvander((T - T.mean()) / np.ptp(T), 2)
    return np.asarray(values - A @ np.linalg.lstsq(A, values, rcond=None)[0])


def _day_means(values: np.ndarray, hours: int) -> np.ndarray:
    n = len(values) // hours * hours
    return np.asarray(values[:n].reshape(-1, hours).mean(axis=1))
