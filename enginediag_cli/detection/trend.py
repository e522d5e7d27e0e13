"""Health in one flight of many: the changes of each parameter from nominal, from the sums of its windows.

The series of files: windows of a flight are added up, flights of an engine follow each other, across files.
"""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from math import isfinite
from typing import Literal, Protocol

import numpy as np

from enginediag_cli.detection.readings import EpochStatistics, InputReadings, Readings, jump, readings_of
from enginediag_cli.engine.instrument_errors import InputError
from enginediag_cli.errors import DataError
from enginediag_cli.parameters import Parameter
from enginediag_cli.residuals.files import Window
from enginediag_cli.residuals.instruments import FaultInFlights, InstrumentFault, faults_in_flights
from enginediag_cli.residuals.monitor import Monitor
from enginediag_cli.residuals.series_monitor import effects_of_inputs
from enginediag_cli.residuals.statistics import LocalStatistics
from enginediag_cli.residuals.windows import WindowStatistics, joined


@dataclass(frozen=True)
class FlightChange:
    """Change of each parameter (p,) from nominal in one flight, with standard errors (p,), in parameter units.

    Posterior mean and deviation under a change of prior size: where a flight tells nothing, 0 ± prior.
    """

    parameters: tuple[str, ...]
    records: int
    change: np.ndarray
    standard_error: np.ndarray


def flight_change(statistics: LocalStatistics) -> FlightChange:
    """Changes in the flight(s) that the statistics stand for."""
    D = statistics.prior_sigma
    F, s = _effective(statistics)
    covariance = np.linalg.inv(np.eye(len(D)) + D[:, None] * F * D)
    return FlightChange(
        statistics.parameters, statistics.n, D * (covariance @ (D * s)), D * np.sqrt(np.diag(covariance))
    )


def _effective(statistics: LocalStatistics) -> tuple[np.ndarray, np.ndarray]:
    """Information (p, p) and score (p,) with the true covariance V of s: F V⁻¹ F and F V⁻¹ s."""
    if np.array_equal(statistics.F, statistics.V):
        return statistics.F, statistics.s
    from enginediag_cli.residuals.score import fisher_score

    score = fisher_score(statistics)
    return score.information, score.b


Law = Literal["whole", "covariance", "none"]

FEWEST = 3
"""Flights that a trend needs: a level before, one after, and one to tell noise from either."""
MOST_BYTES = 600e6
"""Size of the statistics of a series: 20,000 flights of forty parameters with the covariance of their statistics, a
hundred thousand without. What a machine of 1 GB has to spare."""


@dataclass(frozen=True)
class Stretch:
    """One flight, or one window of a recording without flights; kept: its statistics, or so much of them as readings
    take."""

    window: WindowStatistics
    kept: LocalStatistics | EpochStatistics

    @property
    def statistics(self) -> LocalStatistics:
        """All of them. Raises ValueError where they were not kept."""
        if not isinstance(self.kept, LocalStatistics):
            raise ValueError("of this series the readings alone are kept")
        return self.kept


@dataclass(frozen=True)
class Series:
    """The stretches of each engine in order, what the parameters are, and `lost`: windows that had no statistics.
    instruments: of each engine those that are stuck or scatter in some of its flights, also of lost ones;
    steered: inputs that set the power, which an engine's state does not leave alone; errors: of inputs, by name;
    monitor: None where statistics came without one."""

    stretches: Mapping[str, Sequence[Stretch]]
    known: Mapping[str, Parameter]
    lost: int
    steered: Collection[str] = ()
    errors: Mapping[str, InputError] = field(default_factory=dict)
    monitor: Monitor | None = None
    instruments: Mapping[str, tuple[FaultInFlights, ...]] = field(default_factory=dict)

    def healthy(self, engine: str, records: int) -> int:
        """How many of an engine's first stretches hold no more than its first `records` records."""
        total = np.cumsum([x.window.records for x in self.stretches[engine]])
        return int(np.sum(total <= records))

    def readings(self, engine: str) -> Readings:
        """The series of an engine. Raises DataError when its flights have statistics of different parameters."""
        mine = self.stretches[engine]
        present = set(mine[0].kept.parameters)
        described = [p for name, p in self.known.items() if name in present]
        try:
            return readings_of(
                [x.kept for x in mine],
                described,
                _clock(mine),
                self._conditions(mine),
                self._read(mine),
                self._effects(mine),
            )
        except ValueError as error:
            name = f"engine {engine}: " if engine else ""
            raise DataError(f"{name}{error}") from None

    def _read(self, mine: Sequence[Stretch]) -> dict[str, InputReadings]:
        """What the instruments of inputs read, by column; the logarithm of it where their usual error, the first,
        multiplies."""
        found: dict[str, InputReadings] = {}
        by_column: dict[str, list[InputError]] = {}
        for error in self.errors.values():
            by_column.setdefault(error.column, []).append(error)
        for column, errors in by_column.items():
            values = np.array([x.window.conditions.get(column, np.nan) for x in mine])
            log = errors[0].multiplies
            if np.all(np.isfinite(values)) and (not log or np.all(values > 0)):
                added = {e.parameter.name: values if e.multiplies else np.ones_like(values) for e in errors}
                if log:
                    added = {name: what / values for name, what in added.items()}
                found[column] = InputReadings(np.log(values) if log else values, added)
        return found

    def _effects(self, mine: Sequence[Stretch]) -> dict[str, dict[str, np.ndarray]]:
        """What errors of the inputs that set the power do to the readings, at the mean conditions of each stretch,
        where such an input has stepped: it moves the engine on its maps by more than they are straight for."""
        inputs = mine[0].window.conditions
        if self.monitor is None or not inputs or any(x.window.conditions.keys() != inputs.keys() for x in mine):
            return {}
        values = {c: np.array([x.window.conditions[c] for x in mine]) for c in inputs}
        sizes = {}
        for name in self.governed:
            error = self.errors[name]
            level = values[error.column]
            step = jump(level)
            sizes[name] = step / float(np.median(level)) if error.multiplies else step
        return effects_of_inputs(self.monitor, values, sizes) if any(sizes.values()) else {}

    @property
    def governed(self) -> list[str]:
        """Errors of the inputs that set the power."""
        return [name for name, error in self.errors.items() if error.column in self.steered]

    def _conditions(self, mine: Sequence[Stretch]) -> np.ndarray | None:
        columns = [c for c in mine[0].window.conditions if c not in self.steered]
        if not columns or any(c not in x.window.conditions for x in mine for c in columns):
            return None
        return np.array([[x.window.conditions[c] for c in columns] for x in mine])


def _clock(stretches: Sequence[Stretch]) -> np.ndarray:
    """When each stretch was: seconds or lines within one recording, else its number: flights have no common clock."""
    windows = [x.window for x in stretches]
    if len({(w.source, w.flight) for w in windows}) == 1:
        seconds = np.array([(w.start_s + w.end_s) / 2 for w in windows])
        lines = np.array([(w.first_line + w.last_line) / 2 for w in windows])
        for clock in (seconds, lines):
            if np.all(np.isfinite(clock)) and np.all(np.diff(clock) > 0):
                return clock
    return np.arange(len(windows), dtype=float)


class Windows(Protocol):
    """Windows of several recordings, in order: of files (`JudgedFiles`), or of a store. As these have them."""

    @property
    def monitor(self) -> Monitor | None: ...

    @property
    def summed(self) -> bool: ...

    def windows(self) -> Iterator[Window]: ...


def series_of(files: Windows, law: Law = "whole") -> Series:
    """Raises DataError when windows of a flight have different parameters, and for more flights than memory should take
    (`MOST_BYTES`). law: how much is kept of the law of each statistic, which is nine tenths of what it holds: all of
    it; its covariance V, which sums need; or nothing, where `readings` alone will be asked of the series."""
    found: dict[str, list[Stretch]] = {}
    flights: dict[str, int] = {}
    shown: dict[str, list[tuple[int, str, InstrumentFault]]] = {}
    before: dict[str, tuple[str, str]] = {}
    place: dict[tuple[str, str, str], int] = {}
    known: dict[str, Parameter] = {}
    lost = 0
    size = 0.0
    for window, its_own in files.windows():
        named = (window.source, window.flight)
        if not window.flight or before.get(window.engine) != named:
            flights[window.engine] = flights.get(window.engine, 0) + 1
        before[window.engine] = named
        for fault in window.instruments:
            shown.setdefault(window.engine, []).append((flights[window.engine], window.flight, fault))
        if window.statistics is None:
            lost += 1
            continue
        known.update(its_own)
        mine = found.setdefault(window.engine, [])
        kept = _with_law(window.statistics, law, mine[0].kept if mine else None)
        window = replace(window, statistics=None, weights=None)
        key = (window.engine, window.source, window.flight)
        if not window.flight or key not in place or not files.summed:
            place[key] = len(mine)
            mine.append(Stretch(window, kept))
            size += _bytes(kept)
            if size > MOST_BYTES:
                raise DataError(_too_many(found))
            continue
        one = mine[place[key]]
        try:
            both = _sum(one.kept, kept)
        except ValueError as error:
            raise DataError(f"{window.source}: flight {window.flight}: {error}") from None
        mine[place[key]] = Stretch(joined([one.window, window]), both)
    wrong = {name: faults_in_flights(faults, flights[name]) for name, faults in shown.items()}
    if files.monitor is None:
        return Series(found, known, lost, instruments=wrong)
    engine = files.monitor.engine
    steered = (getattr(engine, "power_setting", ""),)
    return Series(found, known, lost, steered, getattr(engine, "errors", {}), files.monitor, wrong)


def _with_law(
    statistics: LocalStatistics, law: Law, first: LocalStatistics | EpochStatistics | None
) -> LocalStatistics | EpochStatistics:
    """So much of the law as is asked for; what is the same as in the `first` flight of the series is its own."""
    if first is not None and first.parameters == statistics.parameters:
        statistics = replace(statistics, parameters=first.parameters)
        if np.array_equal(first.prior_sigma, statistics.prior_sigma):
            statistics = replace(statistics, prior_sigma=first.prior_sigma)
        if isinstance(first, LocalStatistics) and np.array_equal(first.theta0, statistics.theta0):
            statistics = replace(statistics, theta0=first.theta0)
    if law == "whole":
        return statistics
    if law == "covariance":
        return replace(statistics, by_sensor=None, rows=None, kurtosis=None)
    biases = {name for name, p in statistics.meaning.items() if p.of_sensor and p.quantity == "bias"}
    return EpochStatistics.from_statistics(statistics, biases)


def _sum(
    one: LocalStatistics | EpochStatistics, other: LocalStatistics | EpochStatistics
) -> LocalStatistics | EpochStatistics:
    """Of two windows of one series. Raises ValueError for different parameters."""
    if isinstance(one, LocalStatistics) and isinstance(other, LocalStatistics):
        return one + other
    assert isinstance(one, EpochStatistics) and isinstance(other, EpochStatistics)
    return one + other


def _bytes(kept: LocalStatistics | EpochStatistics) -> float:
    if isinstance(kept, EpochStatistics):
        return kept.information.nbytes + kept.s.nbytes
    parts = (kept.s, kept.F, kept.V, kept.by_sensor, kept.rows, kept.slopes)
    return sum(part.nbytes for part in parts if part is not None)


def _too_many(found: Mapping[str, Sequence[Stretch]]) -> str:
    """That a series holds more than memory may take, and what to do."""
    flights = sum(map(len, found.values()))
    whole = all(x.window.flight for mine in found.values() for x in mine[:1])
    how = "give fewer files at once, or one engine with --engine-instance" if whole else "cut it with --window 10min"
    return (
        f"more than {flights:,} {'flights' if whole else 'windows of a recording without flights'}: their statistics "
        f"take more than {MOST_BYTES / 1e6:.0f} MB of memory; {how}"
    )


def has_times(window: WindowStatistics) -> bool:
    """Whether it is known when a window was."""
    return isfinite(window.start_s) and isfinite(window.end_s)
