"""The series of one engine as its readings: what each epoch's readings are off by, and what every suspect does to them.

Where the error of each output sensor is among the parameters, the statistics of an epoch hold its readings:

    s_S = R⁻¹ e,   F_SS = R⁻¹,   F_Sa = R⁻¹ J_a      ⇒      e = F_SS⁻¹ s_S,   J = F_SS⁻¹ F_S·

whatever R is, summed over records or with everything uncertain about nominal counted as noise. Statistics without
sensors have directions of the parameters in their place, as far as every epoch determines them.

`Series` holds the statistics of flights, read from files: windows of a flight are added up, flights of an engine follow
each other, across files. `estimate_flight_change` gives the change of each parameter in one flight.
"""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from math import isfinite
from typing import Literal, Protocol

import numpy as np

from enginediag_cli.errors import DataError
from enginediag_cli.parameters import Parameter
from enginediag_cli.residuals.files import Window
from enginediag_cli.residuals.instruments import FaultInFlights, InstrumentFault, faults_in_flights
from enginediag_cli.residuals.monitor import Monitor
from enginediag_cli.residuals.statistics import LocalStatistics
from enginediag_cli.residuals.windows import WindowStatistics, join_bookkeeping

LEAST_INFORMATION = 1e-6
"""Share of the information of the best determined direction below which a direction is not determined."""


@dataclass(frozen=True)
class Readings:
    """n flights in order of time, m readings, p parameters that may change.

    z (n, m): readings minus prediction in units of their noise; J (n, m, p): what one prior standard deviation D (p,)
    of each parameter adds to them; noise (m, m): covariance of z by the stated noise; number (n,): of each flight, from
    0; weather (n, c): functions of the conditions flown, of mean 0 and unit size.
    """

    parameters: tuple[str, ...]
    D: np.ndarray
    z: np.ndarray
    J: np.ndarray
    noise: np.ndarray
    number: np.ndarray
    weather: np.ndarray

    def __len__(self) -> int:
        return len(self.z)


@dataclass(frozen=True)
class EpochStatistics:
    """What readings take of the statistics of one epoch of n records: s (p,), and of F the rows (r, p) of the
    parameters at `rows` (r,), those of biases of sensors, all where there are none. They add as statistics do."""

    parameters: tuple[str, ...]
    prior_sigma: np.ndarray
    s: np.ndarray
    information: np.ndarray
    rows: np.ndarray
    n: int

    @staticmethod
    def from_statistics(statistics: LocalStatistics, biases: Collection[str]) -> EpochStatistics:
        """biases: names of those among the parameters."""
        names = statistics.parameters
        rows = np.array([i for i, name in enumerate(names) if name in biases] or range(len(names)), int)
        information = statistics.F[rows]
        return EpochStatistics(names, statistics.prior_sigma, statistics.s, information, rows, statistics.n)

    def __add__(self, other: EpochStatistics) -> EpochStatistics:
        if self.parameters != other.parameters:
            raise ValueError("statistics of different parameters cannot be added")
        information = self.information + other.information
        return replace(self, s=self.s + other.s, information=information, n=self.n + other.n)

    @property
    def F(self) -> np.ndarray:
        """(p, p), rows that are not kept being unknown, NaN."""
        found = np.full((len(self.parameters),) * 2, np.nan)
        found[self.rows] = self.information
        return found


def build_readings(
    statistics: Sequence[LocalStatistics | EpochStatistics],
    described: Sequence[Parameter],
    conditions: np.ndarray | None = None,
) -> Readings:
    """One flight per element, in order; described (p,): their parameters that may change; conditions (n, c): means of
    what was flown. ValueError when the statistics are of different parameters."""
    first = statistics[0]
    if any(x.parameters != first.parameters for x in statistics):
        raise ValueError("statistics of different parameters have no common trend")
    position = {name: i for i, name in enumerate(first.parameters)}
    at = np.array([position[p.name] for p in described], int)
    D = first.prior_sigma[at]
    s = np.stack([x.s[at] for x in statistics]) * D
    sensors = [i for i, p in enumerate(described) if p.belongs_to_sensor and p.quantity == "bias"]
    own = np.median([np.diag(x.F)[at[sensors]] for x in statistics], axis=0) * D[sensors] ** 2
    told = [i for i, information in zip(sensors, own, strict=True) if information > LEAST_INFORMATION]
    directions = np.eye(len(at))[:, told]
    if not told:
        if not np.all(np.isfinite(first.F)):
            raise ValueError("no sensor is read in half of the flights or more")
        directions = _determined_directions(np.stack([x.F[np.ix_(at, at)] for x in statistics]) * D * D[:, None])
    seen = D[:, None] * directions
    FJ = np.empty((len(statistics), directions.shape[1], len(at)))  # not (n, p, p), and nothing of its size beside it
    for x, of_epoch in zip(statistics, FJ, strict=True):
        of_epoch[:] = D[told, None] * x.F[np.ix_(at[told], at)] if told else seen.T @ x.F[np.ix_(at, at)]
    FJ *= D
    inner = FJ @ directions
    rank = np.linalg.eigvalsh(inner)
    kept = rank[:, 0] > LEAST_INFORMATION * np.median(rank[:, -1])
    inverse = np.linalg.inv(inner[kept])
    z = np.einsum("nab,nb->na", inverse, s[kept] @ directions)
    J = FJ if np.all(kept) else FJ[kept]
    for epoch, of_epoch in zip(inverse, J, strict=True):
        of_epoch[:] = epoch @ of_epoch
    noise = np.median(inverse, axis=0)
    scale = np.sqrt(np.diag(noise))
    J /= scale[:, None]
    n = int(kept.sum())
    return Readings(
        tuple(p.name for p in described),
        D,
        z / scale,
        J,
        noise / scale / scale[:, None],
        np.flatnonzero(kept),
        _condition_functions(conditions[kept]) if conditions is not None else np.zeros((n, 0)),
    )


def _determined_directions(F: np.ndarray) -> np.ndarray:
    """Directions (p, r) of the parameters, as many as the epochs' information F (n, p, p) determines in nine of ten:
    among many parameters one direction that single epochs do not show would take these out of the series."""
    value, vector = np.linalg.eigh(F.sum(axis=0))
    for r in range(int(np.sum(value > LEAST_INFORMATION * value[-1])), 1, -1):
        rank = np.linalg.eigvalsh(vector[:, -r:].T @ F @ vector[:, -r:])
        if np.mean(rank[:, 0] > LEAST_INFORMATION * np.median(rank[:, -1])) >= MOST_EPOCHS:
            return np.asarray(vector[:, -r:])
    return np.asarray(vector[:, -1:])


MOST_EPOCHS = 0.9
"""Share of the epochs that must determine a direction: the other directions are excluded."""
EPOCHS_PER_COLUMN = 10
"""Epochs for each function of the conditions: with fewer, these would explain what they have nothing to do with."""
VARIES = 1e-6
"""Relative spread of a condition below which it is the same all the time."""


def _condition_functions(conditions: np.ndarray) -> np.ndarray:
    """Conditions (n, c) themselves, their squares and products, as far as there are epochs for them, of mean 0 and
    variance 1."""
    n = len(conditions)
    spread = conditions.std(axis=0)
    u = conditions[:, spread > VARIES * np.abs(conditions).max(axis=0, initial=0.0)]
    u = (u - u.mean(axis=0)) / u.std(axis=0)
    if u.shape[1] * EPOCHS_PER_COLUMN > n:
        return np.zeros((n, 0))
    i, j = np.triu_indices(u.shape[1])
    both = u[:, i] * u[:, j]
    both = both[:, both.std(axis=0) > VARIES]
    both = (both - both.mean(axis=0)) / both.std(axis=0)
    return np.concatenate([u, both], axis=1) if (u.shape[1] + both.shape[1]) * EPOCHS_PER_COLUMN <= n else u


@dataclass(frozen=True)
class FlightChange:
    """Change of each parameter (p,) from nominal in one flight, with standard errors (p,), in parameter units.

    Posterior mean and deviation under a change of prior size: where a flight has no information, 0 ± prior.
    """

    parameters: tuple[str, ...]
    records: int
    change: np.ndarray
    standard_error: np.ndarray


def estimate_flight_change(statistics: LocalStatistics) -> FlightChange:
    """Change of each parameter in the flight that the statistics are of.

    Parameters
    ----------
    statistics : LocalStatistics
        Of p parameters.

    Returns
    -------
    FlightChange
        Posterior means and standard errors (p,), in parameter units, with changes N(0, prior_sigma²).
    """
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
"""Flights that a trend needs: a level before, one after, and one to separate noise from either."""
MOST_BYTES = 600e6
"""Size of the statistics of a series: 20,000 flights of forty parameters with the covariance of their statistics, a
hundred thousand without. What a machine of 1 GB has to spare."""


@dataclass(frozen=True)
class FlightWindow:
    """One flight, or one window of a recording without flights.

    Attributes
    ----------
    window : WindowStatistics
        Its place, counts and conditions; its statistics are in `stored`.
    stored : LocalStatistics or EpochStatistics
        Its statistics, or the part of them that readings need.
    """

    window: WindowStatistics
    stored: LocalStatistics | EpochStatistics

    @property
    def statistics(self) -> LocalStatistics:
        """All of them. Raises ValueError where they were not kept."""
        if not isinstance(self.stored, LocalStatistics):
            raise ValueError("of this series the readings alone are kept")
        return self.stored


@dataclass(frozen=True)
class Series:
    """The flights of engines in order.

    Attributes
    ----------
    stretches : mapping of str to sequence of FlightWindow
        Engine → its flights, or windows, in order of time.
    parameters : mapping of str to Parameter
        Meaning of the parameters.
    skipped_windows : int
        Windows without statistics.
    power_inputs : collection of str
        Inputs that set the power; the state of health of the engine moves them.
    monitor : Monitor or None
        None where statistics came without one.
    instruments : mapping of str to tuple of FaultInFlights
        Engine → instruments that are stuck or scatter in some of its flights, also in skipped windows.
    """

    stretches: Mapping[str, Sequence[FlightWindow]]
    parameters: Mapping[str, Parameter]
    skipped_windows: int
    power_inputs: Collection[str] = ()
    monitor: Monitor | None = None
    instruments: Mapping[str, tuple[FaultInFlights, ...]] = field(default_factory=dict)

    def healthy(self, engine: str, records: int) -> int:
        """How many of an engine's first stretches hold no more than its first `records` records."""
        total = np.cumsum([x.window.records for x in self.stretches[engine]])
        return int(np.sum(total <= records))

    def readings(self, engine: str) -> Readings:
        """The series of an engine. Raises DataError when its flights have statistics of different parameters."""
        mine = self.stretches[engine]
        present = set(mine[0].stored.parameters)
        described = [p for name, p in self.parameters.items() if name in present]
        try:
            return build_readings(
                [x.stored for x in mine],
                described,
                self._conditions(mine),
            )
        except ValueError as error:
            name = f"engine {engine}: " if engine else ""
            raise DataError(f"{name}{error}") from None

    def _conditions(self, mine: Sequence[FlightWindow]) -> np.ndarray | None:
        columns = [c for c in mine[0].window.conditions if c not in self.power_inputs]
        if not columns or any(c not in x.window.conditions for x in mine for c in columns):
            return None
        return np.array([[x.window.conditions[c] for c in columns] for x in mine])


class WindowSource(Protocol):
    """Windows of several recordings, in order: of files (`WindowReader`), or of a store. As these have them."""

    @property
    def monitor(self) -> Monitor | None: ...

    @property
    def summed(self) -> bool: ...

    def windows(self) -> Iterator[Window]: ...


def build_series(files: WindowSource, law: Law = "whole") -> Series:
    """Read windows into a series; windows of a flight are added where `files.summed`.

    Parameters
    ----------
    files : WindowSource
        Windows of recordings, in order of time for each engine.
    law : {"whole", "covariance", "none"}
        How much is kept of the covariance of each statistic, nine tenths of the memory: everything; the covariance V,
        which sums need; or nothing, where only `Series.readings` is used.

    Returns
    -------
    Series

    Raises
    ------
    DataError
        When windows of a flight have different parameters, and for more flights than fit into `MOST_BYTES`.
    """
    found: dict[str, list[FlightWindow]] = {}
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
        kept = _trim_statistics(window.statistics, law, mine[0].stored if mine else None)
        window = replace(window, statistics=None, weights=None)
        key = (window.engine, window.source, window.flight)
        if not window.flight or key not in place or not files.summed:
            place[key] = len(mine)
            mine.append(FlightWindow(window, kept))
            size += _bytes(kept)
            if size > MOST_BYTES:
                raise DataError(_memory_message(found))
            continue
        one = mine[place[key]]
        try:
            both = _add_windows(one.stored, kept)
        except ValueError as error:
            raise DataError(f"{window.source}: flight {window.flight}: {error}") from None
        mine[place[key]] = FlightWindow(join_bookkeeping([one.window, window]), both)
    wrong = {name: faults_in_flights(faults, flights[name]) for name, faults in shown.items()}
    if files.monitor is None:
        return Series(found, known, lost, instruments=wrong)
    engine = files.monitor.engine
    steered = (getattr(engine, "power_setting", ""),)
    return Series(found, known, lost, steered, files.monitor, wrong)


def _trim_statistics(
    statistics: LocalStatistics, law: Law, first: LocalStatistics | EpochStatistics | None
) -> LocalStatistics | EpochStatistics:
    """The required part of the covariance; what is the same as in the `first` flight of the series is its own."""
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
    biases = {name for name, p in statistics.meaning.items() if p.belongs_to_sensor and p.quantity == "bias"}
    return EpochStatistics.from_statistics(statistics, biases)


def _add_windows(
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


def _memory_message(found: Mapping[str, Sequence[FlightWindow]]) -> str:
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
