"""The series of files: windows of a flight are added up, flights of an engine follow each other, across files."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cache
from math import isfinite
from typing import Literal, Protocol

import numpy as np

from enginediag_cli.detection.readings import InputReadings, Readings, jump, readings_of
from enginediag_cli.engine.input_errors import InputError
from enginediag_cli.errors import DataError
from enginediag_cli.parameters import Parameter
from enginediag_cli.residuals.files import Window
from enginediag_cli.residuals.monitor import Monitor
from enginediag_cli.residuals.series_monitor import effects_of_inputs
from enginediag_cli.residuals.statistics import LocalStatistics
from enginediag_cli.residuals.window import WindowStatistics, joined

Law = Literal["whole", "covariance", "none"]

FEWEST = 3
"""Flights that a trend needs: a level before, one after, and one to tell noise from either."""


@dataclass(frozen=True)
class Stretch:
    """One flight, or one window of a recording without flights, with its statistics."""

    window: WindowStatistics
    statistics: LocalStatistics


@dataclass(frozen=True)
class Series:
    """The stretches of each engine in order, what the parameters are, and `lost`: windows that had no statistics.
    steered: inputs that set the power, which an engine's state does not leave alone; errors: of inputs, by name;
    monitor: None where statistics came without one."""

    stretches: Mapping[str, Sequence[Stretch]]
    known: Mapping[str, Parameter]
    lost: int
    steered: Collection[str] = ()
    errors: Mapping[str, InputError] = field(default_factory=dict)
    monitor: Monitor | None = None

    def healthy(self, engine: str, records: int) -> int:
        """How many of an engine's first stretches hold no more than its first `records` records."""
        total = np.cumsum([x.window.records for x in self.stretches[engine]])
        return int(np.sum(total <= records))

    def readings(self, engine: str) -> Readings:
        """The series of an engine. Raises DataError when its flights have statistics of different parameters."""
        mine = self.stretches[engine]
        present = set(mine[0].statistics.parameters)
        described = [p for name, p in self.known.items() if name in present]
        try:
            return readings_of(
                [x.statistics for x in mine],
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
    """Raises DataError when windows of a flight have different parameters. law: how much is kept of the law of each
    statistic, which is nine tenths of what it holds: all of it; its covariance V, which sums need; or nothing (V is
    NaN), where `readings` alone will be asked of the series."""
    found: dict[str, list[Stretch]] = {}
    place: dict[tuple[str, str, str], int] = {}
    known: dict[str, Parameter] = {}
    lost = 0
    for window, its_own in files.windows():
        if window.statistics is None:
            lost += 1
            continue
        window = replace(window, statistics=_with_law(window.statistics, law))
        assert window.statistics is not None
        known.update(its_own)
        mine = found.setdefault(window.engine, [])
        key = (window.engine, window.source, window.flight)
        if not window.flight or key not in place or not files.summed:
            place[key] = len(mine)
            mine.append(Stretch(window, window.statistics))
            continue
        before = mine[place[key]]
        try:
            both = before.statistics + window.statistics
        except ValueError as error:
            raise DataError(f"{window.source}: flight {window.flight}: {error}") from None
        mine[place[key]] = Stretch(joined([before.window, window]), _with_law(both, law))
    if files.monitor is None:
        return Series(found, known, lost)
    engine = files.monitor.engine
    steered = (getattr(engine, "power_setting", ""),)
    return Series(found, known, lost, steered, getattr(engine, "errors", {}), files.monitor)


def _with_law(statistics: LocalStatistics, law: Law) -> LocalStatistics:
    if law == "whole":
        return statistics
    V = statistics.V if law == "covariance" else _unknown(len(statistics.parameters))
    return replace(statistics, by_sensor=None, rows=None, kurtosis=None, V=V)


@cache
def _unknown(p: int) -> np.ndarray:
    """A covariance of which nothing is known, one for all flights."""
    V = np.full((p, p), np.nan)
    V.setflags(write=False)
    return V


def has_times(window: WindowStatistics) -> bool:
    """Whether it is known when a window was."""
    return isfinite(window.start_s) and isfinite(window.end_s)
