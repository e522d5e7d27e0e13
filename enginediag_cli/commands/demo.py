"""`enginediag demo`: the whole chain on simulated flights, command by command, with its results in words."""

from __future__ import annotations

import os
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING

import click

from enginediag_cli.commands.options import exit_codes, message_options, pass_messages
from enginediag_cli.errors import ExitCode, NoVerdictError
from enginediag_cli.presentation.messages import Messages

if TYPE_CHECKING:
    from enginediag_cli.demonstration.flights import Flight
    from enginediag_cli.demonstration.script import Case


def _new_folder(context: click.Context, parameter: click.Parameter, value: str | None) -> str | None:
    """Refuse a folder with files in it: the demonstration would write over them."""
    if value is not None and os.path.lexists(value) and not (os.path.isdir(value) and not os.listdir(value)):
        raise click.BadParameter(f"{value} exists and is not an empty folder", context, parameter)
    return value


@click.command(short_help="Run the whole chain and explain it.", epilog=exit_codes())
@click.option("--seed", type=click.IntRange(min=0), default=1, show_default=True, metavar="N",
              help="Seed of the flights and their noise; the same seed gives the same bytes.")
@click.option("--keep", metavar="DIR", callback=_new_folder,
              help="Leave all files in DIR, which is made; the commands that were shown run there again.")
@message_options
@pass_messages
def demo(messages: Messages, seed: int, keep: str | None) -> None:
    """Simulate healthy and faulty flights, identify the engine, detect and isolate, and say what was found.

    \b
    enginediag demo
    enginediag demo --seed 7 --keep demo_files

    Every step shows the command line that it runs. At the end stands what was found beside what was put in,
    and what was missed. It takes about half a minute.
    """
    from tempfile import TemporaryDirectory

    if keep is not None:
        os.makedirs(keep, exist_ok=True)
        with _working_in(keep):
            _play(messages, seed)
        messages.note(f"all files are in {keep}; the commands above run there again")
        return
    with TemporaryDirectory(prefix="enginediag-demo-") as folder, _working_in(folder):
        _play(messages, seed)
    messages.note("the files of these commands are gone; --keep DIR leaves them in DIR")


@contextmanager
def _working_in(folder: str) -> Iterator[None]:
    """Run in another folder, so that the command lines shown are those that run."""
    before = os.getcwd()
    os.chdir(folder)
    try:
        yield
    finally:
        os.chdir(before)


def _play(messages: Messages, seed: int) -> None:
    from enginediag_cli.demonstration import script, story
    from enginediag_cli.engine import load_engine
    from enginediag_cli.identification.nominal_file import read_nominal

    _copy_shipped(script.INGREDIENTS)
    _head(1, f"Record {script.HEALTHY_FLIGHTS} flights of an engine believed healthy")
    _run(messages, script.record_healthy(seed))
    _head(2, "Learn from them how this very engine and its sensors behave")
    _run(messages, script.identify())
    noise = {column: sensor.noise_sigma for column, sensor in load_engine(script.ENGINE).sensors.items()}
    _tell(story.identified(read_nominal(script.NOMINAL), noise))
    played: list[tuple[Case, list[Flight]]] = []
    for number, case in enumerate(script.CASES, start=1):
        _head(2 + number, f"Fly {case.title}")
        played.append((case, _fly(messages, case, seed + number)))
    click.echo("\nWhat was put in, and what was found")
    for case, flights in played:
        _tell(story.comparison(case, flights))
    click.echo(f"\n{story.closing([flight for _, flights in played for flight in flights])}")


def _fly(messages: Messages, case: Case, seed: int) -> list[Flight]:
    """Simulate the flights of a case and judge them; a case with a fault is also isolated."""
    from enginediag_cli.demonstration import script, story
    from enginediag_cli.demonstration.flights import read_flights

    truth, detected, isolated = Path(case.truth), Path(case.detected), Path(case.isolated)
    _run(messages, script.fly(case, seed))
    _run(messages, script.detect(case))
    flights = read_flights(truth, detected)
    _tell(map(story.verdict, flights))
    if not case.fault:
        return flights
    _run(messages, script.isolate(case))
    flights = read_flights(truth, detected, isolated)
    _tell(map(story.isolated, flights))
    return flights


def _copy_shipped(names: Iterable[str]) -> None:
    """Copy shipped files into the working folder, under the names that the command lines give."""
    from shutil import copyfile

    from enginediag_cli.shipped import shipped

    for name in names:
        os.makedirs(os.path.dirname(name) or ".", exist_ok=True)
        copyfile(shipped(name), name)


def _run(messages: Messages, arguments: list[str]) -> None:
    """Show a command line and run it; NoVerdictError when it ends without its result."""
    from dataclasses import replace
    from shlex import join

    from enginediag_cli.commands.main import enginediag

    click.echo(f"   $ {join(['enginediag', *arguments])}")
    with enginediag.make_context("enginediag", list(arguments), obj=replace(messages, quiet=True)) as context:
        code = enginediag.invoke(context)
    # detect and isolate end so when they could judge no flight at all; their rows say why, and are told
    if code == ExitCode.NO_VERDICT and arguments[0] == "identify":
        raise NoVerdictError("without a nominal engine the demonstration cannot go on")


def _head(number: int, text: str) -> None:
    click.echo(f"{'' if number == 1 else chr(10)}{number}. {text}")


def _tell(lines: Iterable[str]) -> None:
    for line in lines:
        click.echo(f"   {line}")
