"""What `prove` does whatever is asked: the choice of truths and kinds, trials with their journal, and isolation."""

from __future__ import annotations

from collections.abc import Callable, Generator, Iterable, Mapping
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from enginediag_cli.report.messages import Messages
from enginediag_cli.report.output import Output
from enginediag_cli.validation import kinds as explained

if TYPE_CHECKING:
    from enginediag_cli.validation.isolation_trials import Plan

EXPLAIN, ISOLATE = "explain", "isolate"
"""What may be asked of the recordings."""
BOTH = "both"
SEVERAL_ENGINES = ("turbofan.yaml", "turbojet.yaml", "power_plant.yaml", "turboshaft.yaml")
"""Engines that are flown when nobody names one and a truth is realistic, a law, or several causes."""
AIRLINER = SEVERAL_ENGINES[0]
"""Engine of whole flights of an airliner when nobody names one."""
MOVING_ENGINES = (
    "turbofan.yaml",
    "turbojet.yaml",
    "turboshaft.yaml",
    "naval_gas_generator.yaml",
    "micro_gas_turbine.yaml",
)
"""Engines that are flown when nobody names one and recordings move: power set by fuel, by speed and by a load."""

Record = Mapping[str, Any]
Running = Callable[[Iterable[int], int], Generator[tuple[int, dict[str, Any]], None, None]]
"""Numbers of trials and processes → number and record of each trial as it is finished."""


@dataclass(frozen=True)
class Asked:
    """What is asked of which trials; `truth` and `chosen` as given, None and empty where nothing was."""

    question: str
    truth: str | None
    chosen: tuple[str, ...]

    def check(self) -> None:
        """Raises click.UsageError for choices that do not go together."""
        isolating = self.question == ISOLATE
        kinds = explained.ISOLATION_CHOICES if isolating else explained.CHOICES
        truths = explained.ISOLATION_TRUTHS if isolating else explained.TRUTHS
        for option, values, own in (("--kind", self.chosen, kinds), ("--truth", self.truths, truths)):
            odd = [v for v in values if v not in own]
            if odd:
                raise click.UsageError(
                    f"{option} {odd[0]} does not go with --question {self.question}; one of {', '.join(own)} does"
                )
        if isolating and explained.FIELD in self.chosen and len(self.chosen) > 1:
            raise click.UsageError(f"--kind {explained.FIELD} holds the other kinds in fixed shares; give it alone")
        if self.moving and explained.REALISTIC in self.truths:
            raise click.UsageError(
                f"--kind {explained.DYNAMIC} does not go with --truth {explained.REALISTIC}, whose clocks and probes "
                f"are behind themselves; one of {', '.join((*explained.USUAL, BOTH))} does"
            )
        for choice in (explained.LAW, explained.SEVERAL):
            if choice in self.choices and explained.REALISTIC in self.truths:
                raise click.UsageError(
                    f"--kind {choice} does not go with --truth {explained.REALISTIC}, whose instruments cannot be told "
                    f"from what is concealed; one of {', '.join((*explained.USUAL, BOTH))} does"
                )

        if explained.PLANNED in self.chosen and explained.REALISTIC in self.truths:
            raise click.UsageError(
                f"--kind {explained.PLANNED} does not go with --truth {explained.REALISTIC}, whose instruments "
                f"are drawn for the first flights alone; one of {', '.join((*explained.USUAL, BOTH))} does"
            )

    @property
    def truths(self) -> tuple[str, ...]:
        if self.truth in (None, BOTH) and self.question == EXPLAIN:
            return explained.SAME_MODEL, explained.MAP_ERROR
        if self.truth == BOTH:
            return explained.ISOLATION_TRUTHS
        return (self.truth or explained.REALISTIC,)

    @property
    def kinds(self) -> tuple[str, ...]:
        if self.question == ISOLATE:
            return self.chosen or explained.ISOLATION_KINDS
        return explained.all_of(self.chosen) or explained.KINDS

    @property
    def moving(self) -> bool:
        """Whether recordings move in some of the trials."""
        return self.question == EXPLAIN and any(map(explained.moves, self.kinds))

    @property
    def choices(self) -> frozenset[str]:
        """What of the kinds is drawn only where it is chosen."""
        return frozenset(map(explained.choice, self.kinds)) if self.question == EXPLAIN else frozenset()

    def engines(self, given: str | None) -> tuple[str, ...]:
        """The engine file given, or those that come with the program. Raises DataError."""
        from enginediag_cli.shipped import shipped

        if given:
            return (given,)
        if self.moving:
            return tuple(str(shipped(name)) for name in MOVING_ENGINES)
        if self.question == ISOLATE and self.kinds == (explained.FIELD,):
            return (str(shipped(AIRLINER)),)
        several = explained.REALISTIC in self.truths or bool(self.choices & {explained.LAW, explained.SEVERAL})
        return tuple(str(shipped(name)) for name in (SEVERAL_ENGINES if several else SEVERAL_ENGINES[:1]))


@dataclass(frozen=True)
class Kept:
    """How many trials, over how many processes, kept in which file; `resume`: go on from what it holds."""

    trials: int
    jobs: int
    path: str | None
    resume: bool


def finished_trials(messages: Messages, key: str, running: Running, kept: Kept) -> list[Record]:
    """Run the trials that the journal does not hold; all of them in their order. Raises DataError."""
    from enginediag_cli.errors import DataError
    from enginediag_cli.validation.explain_trials import trials_journal
    from enginediag_cli.worker_pool import WorkerDiedError

    journal = trials_journal(Path(kept.path), key) if kept.path else None
    finished: dict[int, Record] = {}
    if journal:
        finished = journal.read() if kept.resume else {}
        if not finished:
            if not kept.resume and journal.begun:
                raise DataError(f"{journal.path} holds trials already: go on with --resume, or remove it")
            journal.write({})
    todo = [k for k in range(kept.trials) if k not in finished]
    if finished:
        messages.note(f"{kept.trials - len(todo)} of {kept.trials} trials are in {journal.path if journal else ''}")
    found = running(todo, kept.jobs)
    try:
        for number, record in messages.progress(found, "prove", len(todo)):
            finished[number] = record
            if journal:
                journal.add(number, record)
    except (KeyboardInterrupt, WorkerDiedError):
        if journal:
            messages.note(
                f"{len(finished)} of {kept.trials} trials are kept in {journal.path}; "
                "the same command with --resume goes on from there"
            )
        raise
    finally:
        found.close()
    if journal:
        journal.write(dict(sorted(finished.items())))
    return [finished[k] for k in range(kept.trials)]


def prove_isolation(messages: Messages, engines: tuple[str, ...], seed: int, asked: Asked, kept: Kept) -> Isolation:
    """Run the trials of isolation; what came of them. Raises DataError."""
    from enginediag_cli.validation.causes import check_engine
    from enginediag_cli.validation.isolation_trials import Plan, plan_key, run_trials

    plan = Plan(engines, seed, asked.truths, asked.kinds)
    for path in engines:
        check_engine(path)
    records = finished_trials(messages, plan_key(plan), partial(run_trials, plan), kept)
    tell_cost(messages, records, "isolator_seconds", "to identify and isolate")
    return Isolation(plan, records)


def tell_cost(messages: Messages, records: list[Record], name: str, what: str) -> None:
    """How long a trial took."""
    total = sum(r["seconds"] for r in records) / len(records)
    asked = sum(r[name] for r in records) / len(records)
    messages.note(f"{len(records)} trials; CPU time of one: {asked:.1f} s {what}, {total:.1f} s to score")


@dataclass(frozen=True)
class Isolation:
    """Trials of isolation, finished."""

    plan: Plan
    records: list[Record]

    def write(self, output: Output) -> None:
        """The reliability tables and the sheet."""
        from enginediag_cli.api import header_lines
        from enginediag_cli.report.outputs.validation import ISOLATED
        from enginediag_cli.validation.rows import document, isolation_sheet_rows, tables

        found = document(self.plan, self.records)
        head = header_lines(
            "prove",
            seed=self.plan.seed,
            configs=list(self.plan.engines),
            notes=ISOLATED.notes | {"trials": str(len(self.records))},
        )
        if output.chosen_format() != "table" or output.columns:
            output.write_document(found, isolation_sheet_rows(found), ISOLATED.names, provenance=head)
            return
        output.write_tables(tables(found))
