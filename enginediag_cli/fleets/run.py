"""A fleet from its file to its findings: models, condensed recordings, engines put together, judged, ranked.

Sums by a fixed binary tree: the same to the last digit in whatever order the parts come.

Node (level, i) is the sum of leaves i·2^level … (i + 1)·2^level − 1 in their order; where the right half of a node has
no leaves it is its left half. Memory holds the nodes whose other half has not come: as many as there are levels when
the leaves come in order.

Judging one engine: its windows out of the store, in order, as a history and a series.
"""

from __future__ import annotations

import os
import time
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import lru_cache
from typing import Generic, Protocol, TypeVar

from enginediag_cli.detection.series import Series, series_of
from enginediag_cli.errors import DataError, EngineDiagError, NoVerdictError
from enginediag_cli.fleets.condense import CondenseTask, Outcome, condense, whole_monitor
from enginediag_cli.fleets.condensed_file import CondensedReader
from enginediag_cli.fleets.engine_judgement import judged_engine
from enginediag_cli.fleets.finding import NO_VERDICT, EngineFinding, EngineHistory, Event, FleetFinding, FleetSettings
from enginediag_cli.fleets.fleet import Baseline, Fleet
from enginediag_cli.fleets.in_common import judged_fleet
from enginediag_cli.fleets.margin import MarginScale, margin_scale, with_taken_off
from enginediag_cli.fleets.models import Model, model_of
from enginediag_cli.fleets.recordings import Recorded, natural
from enginediag_cli.fleets.runners.runner import Runner
from enginediag_cli.fleets.store import Store
from enginediag_cli.progress import each
from enginediag_cli.residuals.files import Window
from enginediag_cli.residuals.monitor import Monitor
from enginediag_cli.residuals.statistics import LocalStatistics
from enginediag_cli.residuals.windows import Elsewhere


class Adds(Protocol):
    """What can be added up."""

    def __add__(self: Sum, other: Sum, /) -> Sum: ...


Sum = TypeVar("Sum", bound=Adds)


class TreeSum(Generic[Sum]):
    """The sum of `leaves` values that `add` brings in any order; None stands for a leaf without a value."""

    def __init__(self, leaves: int):
        self._leaves, self._waiting = leaves, dict[tuple[int, int], Sum | None]()
        self._done: Sum | None = None

    def add(self, number: int, value: Sum | None) -> None:
        """Bring leaf `number`, from 0, once."""
        level, size = 0, 1
        while size < self._leaves:
            sibling = number ^ 1
            if sibling * size < self._leaves:  # else there is no right half
                key = (level, sibling)
                if key not in self._waiting:
                    self._waiting[level, number] = value
                    return
                other = self._waiting.pop(key)
                left, right = (value, other) if number < sibling else (other, value)
                value = right if left is None else left if right is None else left + right
            number, level, size = number // 2, level + 1, 2 * size
        self._done = value

    @property
    def total(self) -> Sum | None:
        """The sum, once all leaves have come; None where none has a value."""
        return self._done


def tree_sum(values: list[Sum]) -> Sum | None:
    """The sum of values that are there already, by the same tree."""
    tree = TreeSum[Sum](len(values))
    for number, value in enumerate(values):
        tree.add(number, value)
    return tree.total


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


BATCH_BYTES = 500_000
"""Recordings are condensed together up to this: some 3,000 records of a CSV file, as many as a call of the engine is
made with; a larger recording goes alone."""
BATCH_FILES = 200
"""And no more than so many files, all of which are open while their windows come."""

PACKED = 5
"""By how much less a packed recording weighs."""
SEEN_S = 10.0
"""Seconds after which a file that another machine has written is seen here, if it ever is: file servers keep for some
seconds what they believe is not there."""


@dataclass
class FleetRun:
    """What a run found. recordings: in order, with what became of each; left_out: recording and why it is; sums: of all
    statistics of each build; unknown: engines that events name and no recording; elsewhere: of records that training
    did not cover; consumed_limit_K: what engines have lost of their margin when they are taken off, and its standard
    deviation, None where that is not known."""

    fleet: Fleet
    models: Mapping[str, Model]
    recordings: Sequence[tuple[Recorded, Outcome]]
    finding: FleetFinding
    left_out: Sequence[tuple[str, str]] = ()
    sums: Mapping[str, LocalStatistics] = field(default_factory=dict)
    unknown: Sequence[str] = ()
    elsewhere: Counter[Elsewhere] = field(default_factory=Counter)
    consumed_limit_K: tuple[float, float] | None = None

    @property
    def counts(self) -> Counter[str]:
        """Of records and windows by what became of them, and of recordings: `fresh` were condensed by this run."""
        total: Counter[str] = Counter()
        left_out = {name for name, _ in self.left_out}
        for recorded, outcome in self.recordings:
            total.update(outcome.condensed.counts if outcome.condensed and recorded.name not in left_out else {})
            total.update(fresh=outcome.fresh)
        return total


def condense_all(
    recordings: Sequence[Recorded], models: Mapping[str, Model], store: Store, runner: Runner
) -> list[Outcome]:
    """What became of each recording. Raises OSError when the store cannot be written."""
    tasks = list(_batches([r for r in recordings if not r.trouble], models, store))
    found = {r.path: Outcome(r.path, trouble=r.trouble) for r in recordings if r.trouble}
    for _, outcomes in each(runner.run(condense, tasks), "batches of recordings condensed", len(tasks)):
        found |= {outcome.path: outcome for outcome in outcomes}
    _check_there(store, found.values())
    return [found[r.path] for r in recordings]


def _check_there(store: Store, outcomes: Iterable[Outcome]) -> None:
    """Raises DataError when what workers have written is not seen here."""
    until = time.monotonic() + SEEN_S
    for outcome in outcomes:
        while outcome.condensed is not None and not store.path(outcome.condensed.key).exists():
            if time.monotonic() > until:
                what = f"{store.path(outcome.condensed.key)}: written by a worker, and not there"
                raise DataError(f"{what}: --store has to name a folder that all workers share under this path")
            time.sleep(0.1)


def _read_bytes(path: str) -> int:
    """Of a recording as it is read: packed ones hold more than they weigh."""
    size = os.path.getsize(path) if os.path.exists(path) else 0
    return size * (PACKED if path.endswith((".gz", ".parquet")) else 1)


def _batches(recordings: Sequence[Recorded], models: Mapping[str, Model], store: Store) -> Iterator[CondenseTask]:
    waiting: list[str] = []
    size, build = 0, ""
    for recorded in recordings:
        more = _read_bytes(recorded.path)
        if waiting and (recorded.build != build or size + more > BATCH_BYTES or len(waiting) >= BATCH_FILES):
            yield CondenseTask(tuple(waiting), models[build].making, str(store.folder))
            waiting, size = [], 0
        waiting.append(recorded.path)
        size, build = size + more, recorded.build
    if waiting:
        yield CondenseTask(tuple(waiting), models[build].making, str(store.folder))


def engine_tasks(
    fleet: Fleet, recordings: Sequence[tuple[Recorded, Outcome]], models: Mapping[str, Model], store: Store
) -> tuple[list[EngineTask], list[tuple[str, str]]]:
    """The engines in order of their serial numbers, each with its pieces in order of the recordings, and which
    recordings are left out and why."""
    pieces: dict[tuple[str, str], list[Piece]] = {}
    left_out: list[tuple[str, str]] = []
    seen: dict[tuple[str, str], str] = {}
    for recorded, outcome in recordings:
        condensed = outcome.condensed
        if condensed is None:
            left_out.append((recorded.name, outcome.trouble))
            continue
        first = seen.setdefault((recorded.build, condensed.sha256), recorded.name)
        if first != recorded.name:
            left_out.append((recorded.name, f"holds the same bytes as {first}, which are counted once"))
            continue
        named = {part.engine for part in condensed.parts if part.engine}
        if recorded.serial and len(named) > 1:
            told = f"holds records of {len(named)} engines, but its name says that it is of {recorded.serial}"
            left_out.append((recorded.name, told))
            continue
        parts: dict[str, list[int]] = {}
        for number, part in enumerate(condensed.parts):
            parts.setdefault(recorded.serial or part.engine, []).append(number)
        if "" in parts:
            told = "has records that name no engine in a column `engine`; engines: serial_from: file takes its name"
            left_out.append((recorded.name, told))
        for serial, numbers in parts.items():
            if serial:
                piece = Piece(str(store.path(condensed.key)), tuple(numbers), recorded.name)
                pieces.setdefault((recorded.build, serial), []).append(piece)
    settings = FleetSettings(
        false_alarm=fleet.judge["false_alarm"],
        false_discovery=fleet.judge["fdr"],
        sensors=fleet.judge["sensors"],
        limits_K=fleet.judge["limits_K"],
        consumed_limit_K=None if fleet.judge["consumed_limit_K"] is None else tuple(fleet.judge["consumed_limit_K"]),
        thorough=fleet.judge["thorough"],
    )
    tasks = []
    for build, serial in sorted(pieces, key=lambda k: (natural(k[1]), k[0])):
        model = models[build]
        events = tuple(e for e in fleet.events if e.engine == serial)
        tasks.append(
            EngineTask(
                serial,
                build,
                tuple(pieces[build, serial]),
                model.making.nominal,
                model.making.fingerprint,
                fleet.whole,
                fleet.baseline,
                events,
                replace(settings, generic=model.generic),
            )
        )
    return tasks, left_out


def run_fleet(fleet: Fleet, recordings: Sequence[Recorded], store: Store, runner: Runner) -> FleetRun:
    """Everything. Raises ConfigError, DataError, OSError, and NoVerdictError where there is no engine to judge."""
    builds = [b for b in fleet.builds if any(r.build == b.name and not r.trouble for r in recordings)]
    if not builds:
        raise NoVerdictError(f"{fleet.path}: no recording can be read: {recordings[0].name}: {recordings[0].trouble}")
    models = {build.name: model_of(fleet, build, recordings, store) for build in builds}
    for model in models.values():  # what is wrong with a nominal file is told before work begins
        whole_monitor(model.making.nominal, model.making.fingerprint)
    outcomes = list(zip(recordings, condense_all(recordings, models, store, runner), strict=True))
    tasks, left_out = engine_tasks(fleet, outcomes, models, store)
    if not tasks:
        why = f": {left_out[0][0]}: {left_out[0][1]}" if left_out else ""
        raise NoVerdictError(f"{fleet.path}: no engine to judge{why}")
    findings, sums, elsewhere = _judge_all(tasks, runner)
    settings = with_taken_off(tasks[0].settings, findings, fleet.judge["taken_off"], f"{fleet.path}: taken_off")
    serials = {task.serial for task in tasks}
    known = whole_monitor(tasks[0].nominal, tasks[0].fingerprint).meaning
    return FleetRun(
        fleet,
        models,
        outcomes,
        judged_fleet(findings, settings, known),
        left_out,
        sums,
        sorted({e.engine for e in fleet.events} - serials, key=natural),
        elsewhere,
        settings.consumed_limit_K,
    )


def _judge_all(
    tasks: Sequence[EngineTask], runner: Runner
) -> tuple[list[EngineFinding], dict[str, LocalStatistics], Counter[Elsewhere]]:
    """Findings in the order of the tasks, the sum of all statistics of each build, and where records lie that training
    did not cover."""
    found: dict[int, EngineFinding] = {}
    elsewhere: Counter[Elsewhere] = Counter()
    place = {number: k for mine in _by_build(tasks).values() for k, number in enumerate(mine)}
    trees = {build: TreeSum[LocalStatistics](len(mine)) for build, mine in _by_build(tasks).items()}
    for number, judged in each(runner.run(judge, tasks), "engines judged", len(tasks)):
        found[number] = judged.finding
        trees[tasks[number].build].add(place[number], judged.total)
        elsewhere.update(judged.elsewhere)
    sums = {build: tree.total for build, tree in trees.items() if tree.total is not None}
    return [found[k] for k in range(len(tasks))], sums, Counter(dict(sorted(elsewhere.items())))


def _by_build(tasks: Sequence[EngineTask]) -> dict[str, list[int]]:
    """Numbers of the tasks of each build."""
    numbers: dict[str, list[int]] = {}
    for number, task in enumerate(tasks):
        numbers.setdefault(task.build, []).append(number)
    return numbers
