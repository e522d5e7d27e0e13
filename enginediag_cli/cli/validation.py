"""Commands that measure how often the diagnosis is right: `study`, `prove` and `demo`.

`study` and `prove` diagnose engines whose truth is known. `demo` shows the whole chain on simulated flights, command by
command, with the results in words.
"""

from __future__ import annotations

import os
import sys
import textwrap
from collections.abc import Callable, Generator, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

import click

from enginediag_cli.cli.config import command
from enginediag_cli.cli.options import (
    COUNT,
    INPUT,
    JUDGEMENT,
    OPERATION,
    OUTPUT,
    ConfigFile,
    OutputFile,
    all_cores_option,
    option,
    output_options,
    seed_option,
)
from enginediag_cli.errors import ExitCode, NoVerdictError
from enginediag_cli.report.messages import Messages
from enginediag_cli.report.output import Output
from enginediag_cli.validation import kinds as trial_kinds

if TYPE_CHECKING:
    from enginediag_cli.validation.demonstration import Case, JudgedFlight
    from enginediag_cli.validation.studies import Results, Study
    from enginediag_cli.validation.trials import Journal, TrialPlan


Key = TypeVar("Key")
Value = TypeVar("Value")
Record = Mapping[str, Any]

EXPLAIN, ISOLATE = "explain", "isolate"
"""Questions that trials may put."""
BOTH = "both"
SEVERAL_ENGINES = ("turbofan.yaml", "turbojet.yaml", "power_plant.yaml", "turboshaft.yaml")
"""Engines that are flown when nobody names one and a truth is realistic, a formula, or several causes."""
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


@command()
@click.argument("file", metavar="FILE", type=ConfigFile())
@option(
    INPUT, "--repetitions", metavar="N", type=COUNT, help="Repetitions of every case. Default: those of the study file."
)
@option(
    OUTPUT,
    "--show",
    type=click.Choice(["rates", "counts", "reliability"]),
    default="rates",
    show_default=True,
    help="Table or CSV of rates with binomial intervals, counts per parameter as in the paper, or reliability of "
    "stated probabilities. JSON has all three.",
)
@option(OPERATION, "--seed", metavar="N", type=click.IntRange(min=0), help="Seed. Default: that of the study file.")
@option(
    OPERATION,
    "--processes",
    metavar="N",
    type=COUNT,
    help="Number of processes. Default: one per core. The result does not depend on it.",
)
@option(
    OPERATION,
    "--journal",
    metavar="FILE",
    type=OutputFile(),
    help="Keep finished batches in FILE and resume from them. With -o, the journal is beside the output until the "
    "study is complete.",
)
@output_options
def study(
    messages: Messages,
    file: str,
    show: str,
    repetitions: int | None,
    seed: int | None,
    processes: int | None,
    journal: str | None,
    output: Output,
) -> None:
    """Run the study that FILE describes: one row per case and method.

    \b
    enginediag study configs/studies/paper.yaml -o paper.json
    enginediag study configs/studies/paper.yaml --repetitions 50 --show counts
    enginediag study configs/studies/calibration.yaml --show reliability

    Data come from the full nonlinear engine. The same seed gives the same counts, on any number of processes. The same
    command with -o or --journal resumes an interrupted study.
    """
    from enginediag_cli.parallel import run_tasks
    from enginediag_cli.validation.studies import batches, load_study, run_batch, study_journal, totals

    described = load_study(file)
    seed = described.seed if seed is None else seed
    path = Path(journal) if journal else None if output.to_stdout else Path(output.path + ".journal")
    kept = study_journal(path, described, seed, repetitions) if path else None
    every, finished = batches(described, repetitions), kept.read() if kept else {}
    todo = [batch for batch in every if batch not in finished]
    running = run_tasks(partial(run_batch, described.path, seed), todo, processes or os.cpu_count() or 1)
    _collect(messages, running, described.path.stem, todo, finished, kept)
    _write_study(described, totals(described, finished), seed, show, output, file)
    if kept and not journal:
        kept.path.unlink(missing_ok=True)


def _write_study(described: Study, results: Results, seed: int, show: str, output: Output, file: str) -> None:
    from enginediag_cli.api.results import header_lines
    from enginediag_cli.report.tables.trials import COUNTS, RELIABILITY, STUDY
    from enginediag_cli.validation.studies import short_rates, study_document, study_rows

    found, columns = study_rows(described, results, show)
    declared = {"rates": STUDY, "counts": COUNTS, "reliability": RELIABILITY}[show]
    head = header_lines("study", seed=seed, configs=[file], notes=declared.notes)
    if output.chosen_format() == "table" and show == "rates" and not (output.wide or output.columns):
        found = [short_rates(row) for row in found]
        columns = tuple(found[0])
    output.write_document(
        lambda: study_document(described, results, seed), found, columns, summary=STUDY.terminal, provenance=head
    )


def _collect(
    messages: Messages,
    running: Generator[tuple[Key, Value], None, None],
    label: str,
    todo: Sequence[Key],
    finished: dict[Key, Value],
    journal: Journal[Key, Value] | None,
    resume: str = "the same command",
) -> None:
    """Add results to those that are finished as they come, and to the journal, which outlives an interruption."""
    from enginediag_cli.errors import WorkerDiedError

    total = len(todo) + len(finished)
    if finished and journal:
        messages.note(f"{len(finished)} of {total} pieces of work are in {journal.path}")
    try:
        for key, value in messages.progress(running, label, len(todo)):
            finished[key] = value
            if journal:
                journal.add(key, value)
    except (KeyboardInterrupt, WorkerDiedError):
        if journal:
            kept = f"{len(finished)} of {total} pieces of work are kept in {journal.path}"
            messages.note(f"{kept}; {resume} resumes from there")
        raise
    finally:
        running.close()


@dataclass(frozen=True)
class TrialChoices:
    """What trials are about; `truth` and `chosen` (kinds) as given, None and empty for the default."""

    question: str
    truth: str | None
    chosen: tuple[str, ...]

    def check(self) -> None:
        """Raise click.UsageError for choices that exclude each other."""
        isolating = self.question == ISOLATE
        known_kinds = trial_kinds.ISOLATION_CHOICES if isolating else trial_kinds.CHOICES
        known_truths = trial_kinds.ISOLATION_TRUTHS if isolating else trial_kinds.TRUTHS
        for name, values, known in (("--kind", self.chosen, known_kinds), ("--truth", self.truths, known_truths)):
            odd = [v for v in values if v not in known]
            if odd:
                raise click.UsageError(
                    f"{name} {odd[0]} does not go with --question {self.question}; one of {', '.join(known)} does"
                )
        if isolating and trial_kinds.FIELD in self.chosen and len(self.chosen) > 1:
            raise click.UsageError(f"--kind {trial_kinds.FIELD} has the other kinds in fixed shares; give it alone")
        if trial_kinds.REALISTIC not in self.truths:
            return
        apart = "whose instrument errors are indistinguishable from what is concealed"
        refused = {
            trial_kinds.DYNAMIC: self.moving and "whose clocks and probes lag",
            trial_kinds.LAW: trial_kinds.LAW in self.choices and apart,
            trial_kinds.SEVERAL: trial_kinds.SEVERAL in self.choices and apart,
            trial_kinds.PLANNED: trial_kinds.PLANNED in self.chosen
            and "whose instruments are drawn for the first flights alone",
        }
        for kind, why in refused.items():
            if why:
                others = ", ".join((*trial_kinds.USUAL, BOTH))
                raise click.UsageError(
                    f"--kind {kind} does not go with --truth {trial_kinds.REALISTIC}, {why}; one of {others} does"
                )

    @property
    def truths(self) -> tuple[str, ...]:
        """The truths of the trials."""
        if self.truth in (None, BOTH) and self.question == EXPLAIN:
            return trial_kinds.SAME_MODEL, trial_kinds.MAP_ERROR
        if self.truth == BOTH:
            return trial_kinds.ISOLATION_TRUTHS
        return (self.truth or trial_kinds.REALISTIC,)

    @property
    def kinds(self) -> tuple[str, ...]:
        """The kinds of the trials."""
        if self.question == ISOLATE:
            return self.chosen or trial_kinds.ISOLATION_KINDS
        return trial_kinds.expand_choices(self.chosen) or trial_kinds.KINDS

    @property
    def moving(self) -> bool:
        """Whether recordings are unsteady in some of the trials."""
        return self.question == EXPLAIN and any(map(trial_kinds.is_dynamic, self.kinds))

    @property
    def choices(self) -> frozenset[str]:
        """The kinds that are drawn only on request."""
        return frozenset(map(trial_kinds.special_choice, self.kinds)) if self.question == EXPLAIN else frozenset()

    def engines(self, given: str | None) -> tuple[str, ...]:
        """The engine file given, or shipped ones. Raises DataError."""
        from enginediag_cli.shipped import shipped

        if given:
            return (given,)
        several = trial_kinds.REALISTIC in self.truths or self.choices & {trial_kinds.LAW, trial_kinds.SEVERAL}
        names: tuple[str, ...] = SEVERAL_ENGINES if several else SEVERAL_ENGINES[:1]
        if self.moving:
            names = MOVING_ENGINES
        elif self.question == ISOLATE and self.kinds == (trial_kinds.FIELD,):
            names = (AIRLINER,)
        return tuple(str(shipped(name)) for name in names)


@command()
@click.argument("engine", metavar="[ENGINE.yaml]", type=ConfigFile(), required=False)
@option(
    JUDGEMENT,
    "--question",
    type=click.Choice([EXPLAIN, ISOLATE]),
    default=EXPLAIN,
    show_default=True,
    help="explain: which physics is missing; isolate: what has changed since the healthy flights.",
)
@option(
    INPUT,
    "--trials",
    metavar="N",
    type=COUNT,
    default=400,
    show_default=True,
    help="Number of trials: engines drawn, each with something concealed in it.",
)
@option(
    INPUT,
    "--truth",
    type=click.Choice((*trial_kinds.TRUTHS, BOTH)),
    help="same_model: the true engine differs from the model only in what is concealed; map_error: also in maps, "
    "cooling and gas, with a model error of 0.3 %; realistic: also in instruments, clocks, probes and noise, with "
    "airline sensors in a third of the trials. Default: the first two for explain, realistic for isolate.",
)
@option(
    INPUT,
    "--kind",
    multiple=True,
    type=click.Choice(
        tuple(dict.fromkeys((*trial_kinds.CHOICES, *trial_kinds.ISOLATION_CHOICES, trial_kinds.HISTORY)))
    ),
    metavar="KIND",
    help=f"Only trials of this kind. Repeatable. For explain: {', '.join(trial_kinds.KINDS)}; only on request dynamic "
    "(unsteady recordings, effects with memory), law (formulas outside the library), planned (what to fly next), "
    f"several ({', '.join(kind for own in trial_kinds.SPECIAL_KINDS.values() for kind in own)}). For isolate: "
    f"{', '.join(trial_kinds.ISOLATION_KINDS)}; only on request {trial_kinds.FIELD} (whole flights with everything at "
    f"once, a quarter of them healthy). {trial_kinds.HISTORY}, alone: engines over 20 to 200 flights, judged by trend.",
)
@option(
    OUTPUT,
    "--sizes/--no-sizes",
    default=True,
    show_default=True,
    help="Add the smallest detectable size of every effect, with and without model error.",
)
@option(
    OUTPUT,
    "--trials-output",
    metavar="FILE.jsonl",
    type=OutputFile(),
    help="Keep every trial with its sealed answer and its marks, one JSON line each.",
)
@option(OPERATION, "--resume", is_flag=True, help="Resume from the trials in --trials-output.")
@all_cores_option
@seed_option
@output_options
def prove(
    messages: Messages,
    engine: str | None,
    question: str,
    truth: str | None,
    kind: tuple[str, ...],
    trials: int,
    trials_output: str | None,
    resume: bool,
    jobs: int | None,
    sizes: bool,
    seed: int,
    output: Output,
) -> None:
    """Draw engines that lack some physics, or in which something has changed, conceal it, and score the diagnosis of
    their recordings.

    \b
    enginediag prove --trials 400 --seed 12 --format json -o sheet.json
    enginediag prove turbofan.yaml --trials 60 --kind null --kind single --truth same_model
    enginediag prove --trials 400 --seed 12 --trials-output trials.jsonl --resume
    enginediag prove --kind law --trials 200 --seed 12
    enginediag prove --question isolate --truth realistic --trials 400 --seed 12
    enginediag prove --question isolate --kind field --trials 320 --seed 12

    The diagnosis runs in a separate process, which gets only the recordings, the engine file, and what is known about
    noise and maps. The default of ENGINE.yaml is turbofan.yaml. Realistic trials other than field use turbofan,
    turbojet, power_plant and turboshaft in turn. The same seed gives the same sheet, whatever --jobs.
    """
    from enginediag_cli.validation.trials import TrialPlan

    if resume and not trials_output:
        raise click.UsageError("--resume needs --trials-output FILE")
    if trial_kinds.HISTORY in kind:
        from enginediag_cli.shipped import shipped

        if len(kind) > 1:
            raise click.UsageError(f"--kind {trial_kinds.HISTORY} is a question of its own; give it alone")
        truths = (trial_kinds.SAME_MODEL, trial_kinds.REALISTIC) if truth in (None, BOTH) else (truth,)
        engines = (engine or str(shipped(AIRLINER)),)
        _prove_histories(
            messages,
            TrialPlan(ISOLATE, engines, seed, truths, kind),
            partial(_finished_trials, messages, trials, jobs or os.cpu_count() or 1, trials_output, resume),
            output,
        )
        return
    choices = TrialChoices(question, truth, kind)
    choices.check()
    plan = TrialPlan(question, choices.engines(engine), seed, choices.truths, choices.kinds)
    run = partial(_finished_trials, messages, trials, jobs or os.cpu_count() or 1, trials_output, resume)
    if question == ISOLATE:
        from enginediag_cli.validation import isolation_trials

        records = run(plan, isolation_trials.run_group)
        _report_cost(messages, records, "isolator_seconds", "to identify and isolate")
        _write_isolation(plan, records, output)
        return
    from enginediag_cli.validation import explain_trials

    records = run(plan, explain_trials.run_group)
    _report_cost(messages, records, "explainer_seconds", "to explain")
    unscored = sum(not r["scorer_converged"] for r in records)
    if unscored:
        messages.note(f"{unscored} trials could not be scored: a noise-free fit of the scorer did not converge")
    for r in records:
        if r["error"]:
            messages.warning(f"trial {r['trial']}: the explainer failed: {r['error']}")
    _write_explanations(plan, records, sizes, output)


def _finished_trials(
    messages: Messages,
    total: int,
    jobs: int,
    path: str | None,
    resume: bool,
    plan: TrialPlan,
    run_group: Callable[[TrialPlan, Sequence[int]], list[dict[str, Any]]],
) -> list[Record]:
    """Run the trials that the journal does not have; all of them in their order. Raises DataError."""
    from enginediag_cli.errors import DataError
    from enginediag_cli.validation.trial_flights import check_engine
    from enginediag_cli.validation.trials import run_trials, trials_journal

    for engine in plan.engines:
        check_engine(engine)
    journal = trials_journal(Path(path), plan.key) if path else None
    finished: dict[int, Record] = {}
    if journal:
        finished = journal.read() if resume else {}
        if not finished:
            if not resume and journal.has_lines:
                raise DataError(f"{journal.path} has trials already: continue with --resume, or remove it")
            journal.write({})
    todo = [k for k in range(total) if k not in finished]
    _collect(
        messages,
        run_trials(run_group, plan, todo, jobs),
        "prove",
        todo,
        finished,
        journal,
        "the same command with --resume",
    )
    if journal:
        journal.write(dict(sorted(finished.items())))
    return [finished[k] for k in range(total)]


def _report_cost(messages: Messages, records: Sequence[Record], name: str, what: str) -> None:
    """Report the CPU time of a trial."""
    total = sum(r["seconds"] for r in records) / len(records)
    diagnosis = sum(r[name] for r in records) / len(records)
    messages.note(f"{len(records)} trials; CPU time per trial: {diagnosis:.1f} s {what}, {total:.1f} s to score")


def _write_explanations(plan: TrialPlan, records: list[Record], sizes: bool, output: Output) -> None:
    from enginediag_cli.api.results import header_lines
    from enginediag_cli.report.tables.trials import PROVE
    from enginediag_cli.validation.score_sheet import bin_rows, score_sheet_document, sheet_rows, sheet_table, size_rows

    found = score_sheet_document(plan, records, sizes)
    notes = PROVE.notes | {"trials": str(len(records))}
    head = header_lines("prove", seed=plan.seed, configs=[plan.engines[0]], notes=notes)
    scores = {name: found[name] for name in found["scores"]}
    if output.chosen_format() != "table" or output.columns:
        output.write_document(found, sheet_rows(scores, found["bins"]), PROVE.names, provenance=head)
        return
    binned = ("lambda", "lambda_sep", "signal_to_noise")
    parts = [sheet_table(scores), *(bin_rows(found["bins"], what) for what in binned)]
    output.write_tables([*parts, *([size_rows(found["detectable_size"])] if sizes else [])])


def _prove_histories(messages: Messages, plan: TrialPlan, run: Callable[..., list[Record]], output: Output) -> None:
    """Run the trials of histories and write their sheet."""
    from enginediag_cli.api.results import header_lines
    from enginediag_cli.report.tables.trials import HISTORIES
    from enginediag_cli.validation import history_trials

    records = run(plan, history_trials.run_group)
    _report_cost(messages, records, "trend_seconds", "to follow")
    for r in records:
        if r["error"]:
            messages.warning(f"trial {r['trial']}: {r['error']}")
    found = history_trials.history_document(plan, records)
    notes = HISTORIES.notes | {"trials": str(len(records))}
    head = header_lines("prove", seed=plan.seed, configs=list(plan.engines), notes=notes)
    output.write_document(found, found["sheet"], HISTORIES.names, provenance=head)


def _write_isolation(plan: TrialPlan, records: list[Record], output: Output) -> None:
    from enginediag_cli.api.results import header_lines
    from enginediag_cli.report.tables.trials import ISOLATED
    from enginediag_cli.validation.isolation_trials import isolation_document, isolation_sheet_rows, isolation_tables

    found = isolation_document(plan, records)
    notes = ISOLATED.notes | {"trials": str(len(records))}
    head = header_lines("prove", seed=plan.seed, configs=list(plan.engines), notes=notes)
    if output.chosen_format() != "table" or output.columns:
        output.write_document(found, isolation_sheet_rows(found), ISOLATED.names, provenance=head)
        return
    output.write_tables(isolation_tables(found))


COLUMNS = 110
"""Letters of a line of the demonstration: what a terminal of usual width shows without breaking it."""


def _check_folder(context: click.Context, parameter: click.Parameter, value: str | None) -> str | None:
    """Refuse a folder with files in it: the demonstration would write over them."""
    if value is not None and os.path.lexists(value) and not (os.path.isdir(value) and not os.listdir(value)):
        raise click.BadParameter(f"{value} exists and is not an empty folder", context, parameter)
    return value


@command()
@option(
    INPUT,
    "--missing-physics",
    is_flag=True,
    help="Conceal a physical effect in the flights instead, find it, add it to the model, and judge by unseen flights.",
)
@option(OUTPUT, "--keep", metavar="DIR", callback=_check_folder, help="Keep all files in the new folder DIR.")
@option(OUTPUT, "--report", is_flag=True, help="Also write a report into DIR: one page that opens offline.")
@option(
    INPUT,
    "--seed",
    type=click.IntRange(min=0),
    default=1,
    show_default=True,
    metavar="N",
    help="Seed of the flights and their noise. The same seed gives the same bytes.",
)
def demo(messages: Messages, seed: int, keep: str | None, missing_physics: bool, report: bool) -> None:
    """Simulate healthy and faulty flights, identify the engine, detect and isolate, and explain the results.

    \b
    enginediag demo
    enginediag demo --seed 7 --keep demo_files
    enginediag demo --keep demo_files --report
    enginediag demo --missing-physics --keep story

    Every step shows its command line. At the end, the findings are compared with the truth. The demonstration takes
    about half a minute. --missing-physics flies an engine with an effect that the engine file lacks and runs locate,
    explain, refine and detect on its recordings; DIR then has the refined engine and two pictures, locate.svg and
    refine.svg.
    """
    from tempfile import TemporaryDirectory

    if report and keep is None:
        raise click.UsageError("--report writes a page into the folder of --keep: give --keep DIR")

    def play() -> None:
        (_play_missing_physics if missing_physics else _play)(messages, seed)
        if report:
            _write_report(messages, missing_physics)

    if keep is not None:
        os.makedirs(keep, exist_ok=True)
        with _change_folder(keep):
            play()
        messages.note(f"all files are in {keep}; the commands above can be repeated there")
        return
    with TemporaryDirectory(prefix="enginediag-demo-") as folder, _change_folder(folder):
        play()
    messages.note("the files of these commands are deleted; --keep DIR keeps them in DIR")


def _play(messages: Messages, seed: int) -> None:
    from enginediag_cli.api.inputs import load_nominal
    from enginediag_cli.validation import demonstration

    copy_shipped(demonstration.INGREDIENTS)
    _head(1, f"Record {demonstration.HEALTHY_FLIGHTS} flights of a healthy engine")
    run(messages, demonstration.record_healthy(seed))
    _head(2, "Identify this engine and its sensors")
    run(messages, demonstration.identify())
    baseline = load_nominal(demonstration.NOMINAL)
    noise = {column: sensor.noise_sigma for column, sensor in baseline.engine.sensors.items()}
    _print(demonstration.describe_identification(baseline.nominal, noise))
    played: list[tuple[Case, list[JudgedFlight]]] = []
    for number, case in enumerate(demonstration.CASES, start=1):
        _head(2 + number, f"Fly {case.title}")
        played.append((case, _fly(messages, case, seed + number)))
    click.echo("\nTruth and findings")
    for case, flights in played:
        _print(demonstration.comparison(case, flights))
    click.echo(f"\n{demonstration.closing([flight for _, flights in played for flight in flights])}")


def _fly(messages: Messages, case: Case, seed: int) -> list[JudgedFlight]:
    """Simulate the flights of a case and judge them; a case with a fault is also isolated."""
    from enginediag_cli.api.inputs import load_engine
    from enginediag_cli.validation import demonstration

    truth, detected, isolated = Path(case.truth), Path(case.detected), Path(case.isolated)
    run(messages, demonstration.fly(case, seed))
    run(messages, demonstration.detect(case))
    engine = load_engine(demonstration.ENGINE)
    flights = demonstration.read_flights(engine, truth, detected)
    _print(map(demonstration.describe_verdict, flights))
    if not case.fault:
        return flights
    run(messages, demonstration.isolate(case))
    flights = demonstration.read_flights(engine, truth, detected, isolated)
    _print(map(demonstration.describe_isolation, flights))
    return flights


def _play_missing_physics(messages: Messages, seed: int) -> None:
    """Conceal an effect, find it, add it to the model, and judge by unseen flights. Raises NoVerdictError."""
    from enginediag_cli.validation import demonstration_missing as story

    copy_shipped(story.INGREDIENTS)
    _head(1, "Conceal an effect: fly an engine that has it")
    story.prepare()
    for line in story.preparations():
        click.echo(f"   $ {line}")
    _print(story.describe_concealed())
    run(messages, story.fly(story.RECORDED, story.FITTED_FLIGHTS, seed))
    run(messages, story.fly(story.UNSEEN, story.UNSEEN_FLIGHTS, seed + 1))
    _head(2, "Where do model and recordings differ?")
    kept = _NoteCollector(debug=messages.debug, color=messages.color)
    run(kept, story.locate(), quiet=False)
    _print(_wrapped(kept.notes))
    _head(3, "Which physics is missing?")
    run(messages, story.explain())
    _print(_wrapped(story.read_json(story.EXPLAINED)["sentences"]))
    effects = story.named_effects(Path(story.EXPLAINED))
    if not effects:
        raise NoVerdictError("explain named no effect that a model could carry: there is nothing to refine")
    _head(4, "Add it to the model, and judge by unseen flights")
    run(messages, story.refine(effects))
    _print(_wrapped(story.read_json(story.REPORT)["sentences"]))
    _head(5, "Does detect give false alarms on healthy flights?")
    for engine in (story.ENGINE, story.REFINED, story.TRUTH):
        run(messages, story.identify(engine))
        run(messages, story.detect(engine))
        _print([story.describe_alarms(story.read_json(story.verdict_file(engine)), engine)])
    found = story.read_results()
    click.echo("\nTruth and findings")
    _print(story.comparison(found))
    click.echo(f"\n{story.closing(found)}")
    click.echo(f"{story.REFINED} runs in every other command. Pictures: {story.MAP} and {story.BEFORE_AFTER}.")


def _write_report(messages: Messages, missing_physics: bool) -> None:
    """Write the results as one page, as the last step."""
    from enginediag_cli.validation import demonstration, demonstration_missing

    click.echo("\nThe same as one page")
    run(messages, demonstration_missing.report() if missing_physics else demonstration.report())


class _NoteCollector(Messages):
    """Messages that keep the notes of a command, for the demonstration to print."""

    def __init__(self, debug: bool, color: str):
        super().__init__(debug=debug, color=color)
        self.notes: list[str] = []

    def note(self, text: str, **fields: Any) -> None:
        """Keep a note."""
        self.notes.append(text)


@contextmanager
def _change_folder(folder: str) -> Iterator[None]:
    """Run in another folder, so that the command lines shown are those that run."""
    before = os.getcwd()
    os.chdir(folder)
    try:
        yield
    finally:
        os.chdir(before)


def copy_shipped(names: Iterable[str]) -> None:
    """Copy shipped files into the working folder, under the names that the command lines give."""
    from shutil import copyfile

    from enginediag_cli.shipped import shipped

    for name in names:
        os.makedirs(os.path.dirname(name) or ".", exist_ok=True)
        copyfile(shipped(name), name)


def run(messages: Messages, arguments: list[str], *, quiet: bool = True) -> None:
    """Show a command line and run it, with the messages as they are unless `quiet`. Raises NoVerdictError when it ends
    without its result."""
    from copy import copy
    from shlex import join

    from enginediag_cli.cli.main import enginediag

    click.echo(f"   $ {join(['enginediag', *arguments])}")
    step = copy(messages)
    step.begun = True  # a step has no log and no file of options of its own
    step.quiet = messages.quiet or quiet
    with _replace_arguments(arguments), enginediag.make_context("enginediag", list(arguments), obj=step) as context:
        code = enginediag.invoke(context)
    # detect and isolate end so when they could judge no flight at all; their rows have the reason, and are printed
    if code == ExitCode.NO_VERDICT and arguments[0] not in ("detect", "isolate"):
        raise NoVerdictError(f"the demonstration cannot continue without the result of {arguments[0]}")


@contextmanager
def _replace_arguments(arguments: list[str]) -> Iterator[None]:
    """Have results record this command, not the demonstration, as the one that made them."""
    before = sys.argv
    sys.argv = ["enginediag", *arguments]
    try:
        yield
    finally:
        sys.argv = before


def _head(number: int, text: str) -> None:
    click.echo(f"{'' if number == 1 else chr(10)}{number}. {text}")


def _print(lines: Iterable[str]) -> None:
    for line in lines:
        click.echo(f"   {line}".rstrip())


def _wrapped(lines: Iterable[str]) -> Iterator[str]:
    """Sentences in lines of a terminal, the continuation indented by two more."""
    for line in lines:
        indent = line[: len(line) - len(line.lstrip())]
        yield from textwrap.wrap(
            line, COLUMNS, initial_indent="", subsequent_indent=f"{indent}  ", break_on_hyphens=False
        )
