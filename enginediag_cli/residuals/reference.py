"""An engine's own early records as the reference of its later ones.

Engines of one type differ from the nominal engine, and from each other, before anything goes wrong. What they
differ by, x ~ N(0, C) with C the uncertainty of nominal and of sensor offsets, is estimated from records believed
healthy, s₀ ~ N(F₀ x, F₀), and taken out of every later window of the same engine:

    x̂ = C₁ s₀        C₁ = (F₀ + C⁻¹)⁻¹        s ← s − F x̂        C ← C₁
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, replace

import numpy as np

from enginediag_cli.recordings.table import Recording, concat
from enginediag_cli.residuals.groups import Key, group_rows
from enginediag_cli.residuals.monitor import Monitor
from enginediag_cli.residuals.pipeline import condensed, window_statistics
from enginediag_cli.residuals.root import root_of
from enginediag_cli.residuals.scale_offsets import with_scale_offsets
from enginediag_cli.residuals.statistics import LocalStatistics
from enginediag_cli.residuals.window import WindowStatistics
from enginediag_cli.residuals.windows import WindowPlan

OWN_SCALE = 0.01
"""By how much the readings of one engine plausibly differ from those of its type, where nominal does not say."""

OWN_HEALTH = 0.25
"""By how much a new engine's monitored parameters plausibly differ from those of its type, as a share of a
plausible change: half a per cent of efficiency, by manufacture and initial wear."""


@dataclass(frozen=True)
class Reference:
    """`shift` x̂ (p,) from nominal and its covariance `uncertainty` C₁ (p, p), in parameter units."""

    shift: np.ndarray
    uncertainty: np.ndarray

    def taken_out_of(self, statistics: LocalStatistics) -> LocalStatistics:
        """The statistics of residuals from which J x̂ is subtracted."""
        moved = statistics.F @ self.shift
        return replace(
            statistics,
            s=statistics.s - moved,
            chi2=statistics.chi2 - 2 * float(self.shift @ statistics.s) + float(self.shift @ moved),
        )


def learn_reference(statistics: LocalStatistics, uncertainty: np.ndarray) -> Reference:
    """Reference from the statistics of all p parameters over healthy records; C (p, p) may be singular."""
    root = root_of(uncertainty, statistics.prior_sigma)
    inner = np.eye(root.shape[1]) + root.T @ statistics.F @ root
    gain = np.linalg.solve(inner, root.T)  # C₁ = root gain
    return Reference(root @ (gain @ statistics.s), root @ gain)


def windows_against_reference(
    monitor: Monitor,
    recordings: Iterable[Recording],
    plan: WindowPlan,
    records: int,
    *,
    last: int = 0,
    linearise: str = "estimate",
) -> Iterator[WindowStatistics]:
    """Windows of what follows the first `records` of each flight and engine, judged against these.

    records 0: no reference, windows are judged against nominal as it is. last: of what follows, only the last
    so many records (0: all). A flight whose first records give no reference, or that ends with them, is a window
    without verdict.
    """
    if records:
        monitor = _with_own_state(monitor)
    early = _EarlyRecords(monitor, records, linearise)

    def condense(window: WindowStatistics, statistics: LocalStatistics) -> WindowStatistics:
        uncertainty = monitor.uncertainty
        if records:
            reference = early.reference(window)
            if reference is None:
                return replace(window, reason=f"the first {records} records of this engine give no reference")
            statistics, uncertainty = reference.taken_out_of(statistics), reference.uncertainty
        return replace(window, statistics=condensed(monitor, statistics, uncertainty))

    later = early.set_aside(recordings) if records else recordings
    later = last_records(later, last) if last else later
    yield from window_statistics(monitor, later, plan, linearise=linearise, condense=condense, apart=not records)
    yield from early.without_later_records()


def _with_own_state(monitor: Monitor) -> Monitor:
    """The monitor with the uncertainty of how one engine differs from its type, which a reference will reduce."""
    monitor = with_scale_offsets(monitor, OWN_SCALE)
    spread = np.zeros(len(monitor.names))
    healthy = slice(len(monitor.monitored))
    spread[healthy] = OWN_HEALTH * monitor.prior_sigma[healthy]
    return replace(monitor, uncertainty=monitor.uncertainty + np.diag(spread**2))


class _EarlyRecords:
    """Takes the first n records of each flight and engine out of a stream and learns its reference from them."""

    def __init__(self, monitor: Monitor, n: int, linearise: str):
        self._monitor, self._n, self._linearise = monitor, n, linearise
        self._learnt: dict[Key, Reference] = {}
        self._held: dict[Key, list[Recording]] = {}
        self._count: dict[Key, int] = {}
        self._continued: set[Key] = set()

    def reference(self, window: WindowStatistics) -> Reference | None:
        return self._learnt.get((window.source, window.flight, window.engine))

    def set_aside(self, recordings: Iterable[Recording]) -> Iterator[Recording]:
        for recording in recordings:
            later = np.ones(len(recording), bool)
            for key, rows in group_rows(recording):
                missing = self._n - self._count.get(key, 0)
                first = rows[:missing] if missing > 0 else rows[:0]
                later[first] = False
                self._count[key] = self._count.get(key, 0) + len(first)
                if len(first):
                    self._held.setdefault(key, []).append(recording.select(first))
                if len(rows) > len(first):
                    self._continued.add(key)
            self._learn([key for key in self._held if self._count[key] == self._n])
            yield recording.select(later)

    def without_later_records(self) -> Iterator[WindowStatistics]:
        for key, count in self._count.items():
            if key not in self._continued:
                reason = f"{count} records are not more than the {self._n} of the reference"
                yield WindowStatistics(*key, 0, 0, np.nan, np.nan, 0, 0, 0, 0, None, reason)

    def _learn(self, complete: list[Key]) -> None:
        parts = [part for key in complete for part in self._held.pop(key)]
        for window in window_statistics(
            self._monitor,
            [concat(parts)] if parts else [],
            WindowPlan(),
            linearise=self._linearise,
            condense=_everything,
        ):
            if window.statistics is not None:
                key = (window.source, window.flight, window.engine)
                self._learnt[key] = learn_reference(window.statistics, self._monitor.uncertainty)


def _everything(window: WindowStatistics, statistics: LocalStatistics) -> WindowStatistics:
    """Whatever early records show is how this engine is: nothing counts as noise."""
    return replace(window, statistics=statistics)


def last_records(recordings: Iterable[Recording], n: int) -> Iterator[Recording]:
    """The last n records of each flight and engine, file by file, in the order in which they began."""
    held: dict[Key, Recording] = {}
    for recording in recordings:
        if held and next(iter(held))[0] != recording.source:
            yield from _settled(held)
            held = {}
        for key, rows in group_rows(recording):
            part = recording.select(rows[-n:])
            both = concat([held[key], part]) if key in held else part
            held[key] = both.select(slice(max(len(both) - n, 0), None))
    yield from _settled(held)


def _settled(held: Mapping[Key, Recording]) -> Iterator[Recording]:
    if held:
        yield concat(list(held.values()))
