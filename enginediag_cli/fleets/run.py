"""A fleet from its file to its findings: models, condensed recordings, engines put together, judged, ranked."""

from __future__ import annotations

import os
import time
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace

from enginediag_cli.errors import DataError, NoVerdictError
from enginediag_cli.fleet_judgement.finding import EngineFinding, FleetFinding, FleetSettings
from enginediag_cli.fleet_judgement.fleet import judged_fleet
from enginediag_cli.fleet_judgement.remaining import with_taken_off
from enginediag_cli.fleets.condense import CondenseTask, Outcome, condense, whole_monitor
from enginediag_cli.fleets.fleet import Fleet
from enginediag_cli.fleets.judging import EngineTask, Piece, judge
from enginediag_cli.fleets.models import Model, model_of
from enginediag_cli.fleets.recordings import Recorded, natural
from enginediag_cli.fleets.runners.runner import Runner
from enginediag_cli.fleets.store import Store
from enginediag_cli.fleets.tree import TreeSum
from enginediag_cli.progress import each
from enginediag_cli.residuals.admission import Elsewhere
from enginediag_cli.residuals.statistics import LocalStatistics

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
    findings, sums, elsewhere = _judged(tasks, runner)
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


def _judged(
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
