"""`enginediag demo`: the whole chain on simulated flights, command by command, with its results in words."""

from __future__ import annotations

import os
import sys
import textwrap
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from enginediag_cli.cli.config import command
from enginediag_cli.cli.options import INPUT, OUTPUT, option
from enginediag_cli.errors import ExitCode, NoVerdictError
from enginediag_cli.report.messages import Messages

if TYPE_CHECKING:
    from enginediag_cli.validation.demonstration import Case, JudgedFlight

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
