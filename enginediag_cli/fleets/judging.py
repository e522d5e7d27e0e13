"""Judging one engine: its windows out of the store, in order, as a history and a series."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from functools import lru_cache

from enginediag_cli.detection.trend_of_files import Series, series_of
from enginediag_cli.errors import EngineDiagError
from enginediag_cli.fleet_judgement.engine import judged_engine
from enginediag_cli.fleet_judgement.finding import NO_VERDICT, EngineFinding, FleetSettings
from enginediag_cli.fleet_judgement.history import EngineHistory, Event
from enginediag_cli.fleet_judgement.margin import MarginScale, margin_scale
from enginediag_cli.fleets.condense import whole_monitor
from enginediag_cli.fleets.condensed_file import CondensedReader
from enginediag_cli.fleets.fleet import Baseline
from enginediag_cli.fleets.tree import tree_sum
from enginediag_cli.residuals.admission import Elsewhere
from enginediag_cli.residuals.files import Window
from enginediag_cli.residuals.monitor import Monitor
from enginediag_cli.residuals.statistics import LocalStatistics


@dataclass(frozen=True)
class Piece:
    """Parts of one condensed recording that are of one engine: its file, its parts, and how the recording is called."""

    file: str
    parts: tuple[int, ...]
    name: str


@dataclass(frozen=True)
class EngineTask:
    """An engine to judge: its pieces in order, and the nominal file that they are held against."""

    serial: str
    build: str
    pieces: tuple[Piece, ...]
    nominal: str
    fingerprint: str
    whole: bool
    baseline: Baseline
    events: tuple[Event, ...]
    settings: FleetSettings


@dataclass(frozen=True)
class Judged:
    """What was found, the sum of the engine's statistics, and how many records lie where training has not been."""

    finding: EngineFinding
    total: LocalStatistics | None
    elsewhere: Counter[Elsewhere] = field(default_factory=Counter)


@dataclass
class _Stored:
    """Windows of an engine as `series_of` reads them."""

    task: EngineTask
    monitor: Monitor
    elsewhere: Counter[Elsewhere] = field(default_factory=Counter)
    reasons: Counter[str] = field(default_factory=Counter)

    @property
    def summed(self) -> bool:
        return self.task.whole

    def windows(self) -> Iterator[Window]:
        for piece in self.task.pieces:
            with CondensedReader(piece.file) as reader:
                for part in piece.parts:
                    for window in reader.windows(part, piece.name, self.task.serial, self.monitor.meaning):
                        self.elsewhere.update(window.elsewhere)
                        self.reasons.update([window.reason] if window.statistics is None else [])
                        yield window, self.monitor.meaning


def judge(task: EngineTask) -> Judged:
    """What the history of an engine says; the same wherever it runs. What cannot be judged is a finding without a
    verdict, no error."""
    try:
        return _judged(task)
    except EngineDiagError as error:
        return Judged(EngineFinding(task.serial, task.build, 0, 0, NO_VERDICT, str(error)), None)


def _judged(task: EngineTask) -> Judged:
    monitor = whole_monitor(task.nominal, task.fingerprint)
    stored = _Stored(task, monitor)
    series = series_of(stored, "covariance")
    stretches, instruments = series.stretches.get(task.serial, []), series.instruments.get(task.serial, ())
    if not stretches:
        nothing = replace(_nothing(task, stored, series), instruments=instruments)
        return Judged(nothing, None, stored.elsewhere)
    baseline = task.baseline.stretches([x.window.records for x in stretches])
    history = EngineHistory(task.serial, task.build, stretches, baseline, task.events)
    finding = judged_engine(history, series, task.settings, _scale(task.nominal, task.fingerprint))
    finding = replace(finding, instruments=instruments)
    return Judged(finding, tree_sum([x.statistics for x in stretches]), stored.elsewhere)


@lru_cache(maxsize=4)
def _scale(nominal: str, fingerprint: str) -> MarginScale:
    """Of the margin of all engines of a nominal file, which takes longer than an engine."""
    monitor = whole_monitor(nominal, fingerprint)
    return margin_scale(Series({}, monitor.meaning, 0, monitor=monitor))


def _nothing(task: EngineTask, stored: _Stored, series: Series) -> EngineFinding:
    most = stored.reasons.most_common(1)
    reason = f"no window has statistics: {most[0][0]}" if most else "no record"
    return replace(EngineFinding(task.serial, task.build, 0, 0, NO_VERDICT, reason), flights=series.lost)
