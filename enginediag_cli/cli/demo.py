"""`enginediag demo`: the whole chain on simulated flights, command by command, with its results in words."""

from __future__ import annotations

import os
from pathlib import Path
from typing import TYPE_CHECKING

import click

from enginediag_cli.cli.demo_steps import copy_shipped, head, run, tell, working_in
from enginediag_cli.cli.options import exit_codes, message_options, pass_messages
from enginediag_cli.report.messages import Messages

if TYPE_CHECKING:
    from enginediag_cli.validation.demonstration import Case, Flight


def _new_folder(context: click.Context, parameter: click.Parameter, value: str | None) -> str | None:
    """Refuse a folder with files in it: the demonstration would write over them."""
    if value is not None and os.path.lexists(value) and not (os.path.isdir(value) and not os.listdir(value)):
        raise click.BadParameter(f"{value} exists and is not an empty folder", context, parameter)
    return value


@click.command(short_help="Run the whole chain and explain it.", epilog=exit_codes())
@click.option(
    "--seed",
    type=click.IntRange(min=0),
    default=1,
    show_default=True,
    metavar="N",
    help="Seed of the flights and their noise; the same seed gives the same bytes.",
)
@click.option(
    "--keep",
    metavar="DIR",
    callback=_new_folder,
    help="Leave all files in DIR, which is made; the commands that were shown run there again.",
)
@click.option(
    "--missing-physics",
    is_flag=True,
    help="Instead, conceal a physical effect in the flights, find it, put it into the model, and let flights "
    "that were not used judge.",
)
@click.option("--report", "as_page", is_flag=True, help="Leave a report in DIR, too: one page that opens offline.")
@message_options
@pass_messages
def demo(messages: Messages, seed: int, keep: str | None, missing_physics: bool, as_page: bool) -> None:
    """Simulate healthy and faulty flights, identify the engine, detect and isolate, and say what was found.

    \b
    enginediag demo
    enginediag demo --seed 7 --keep demo_files
    enginediag demo --keep demo_files --report
    enginediag demo --missing-physics --keep story

    Every step shows the command line that it runs. At the end stands what was found beside what was put in,
    and what was missed. It takes about half a minute. --missing-physics flies an engine with an effect that the
    engine file lacks and runs locate, explain, refine and detect on its recordings; DIR then has the refined engine
    and two pictures, locate.svg and refine.svg.
    """
    from tempfile import TemporaryDirectory

    from enginediag_cli.cli.demo_missing import play as play_missing

    if as_page and keep is None:
        raise click.UsageError("--report leaves a page in the folder that --keep names: --keep DIR")

    def play(messages: Messages, seed: int) -> None:
        (play_missing if missing_physics else _play)(messages, seed)
        if as_page:
            _report(messages, missing_physics)

    if keep is not None:
        os.makedirs(keep, exist_ok=True)
        with working_in(keep):
            play(messages, seed)
        messages.note(f"all files are in {keep}; the commands above run there again")
        return
    with TemporaryDirectory(prefix="enginediag-demo-") as folder, working_in(folder):
        play(messages, seed)
    messages.note("the files of these commands are gone; --keep DIR leaves them in DIR")


def _play(messages: Messages, seed: int) -> None:
    from enginediag_cli.api.inputs import load_nominal
    from enginediag_cli.validation import demonstration as script
    from enginediag_cli.validation import demonstration as story

    copy_shipped(script.INGREDIENTS)
    head(1, f"Record {script.HEALTHY_FLIGHTS} flights of an engine believed healthy")
    run(messages, script.record_healthy(seed))
    head(2, "Learn from them how this very engine and its sensors behave")
    run(messages, script.identify())
    baseline = load_nominal(script.NOMINAL)
    noise = {column: sensor.noise_sigma for column, sensor in baseline.engine.sensors.items()}
    tell(story.identified(baseline.nominal, noise))
    played: list[tuple[Case, list[Flight]]] = []
    for number, case in enumerate(script.CASES, start=1):
        head(2 + number, f"Fly {case.title}")
        played.append((case, _fly(messages, case, seed + number)))
    click.echo("\nWhat was put in, and what was found")
    for case, flights in played:
        tell(story.comparison(case, flights))
    click.echo(f"\n{story.closing([flight for _, flights in played for flight in flights])}")


def _fly(messages: Messages, case: Case, seed: int) -> list[Flight]:
    """Simulate the flights of a case and judge them; a case with a fault is also isolated."""
    from enginediag_cli.api.inputs import load_engine
    from enginediag_cli.validation import demonstration as script
    from enginediag_cli.validation import demonstration as story
    from enginediag_cli.validation.demonstration import read_flights

    truth, detected, isolated = Path(case.truth), Path(case.detected), Path(case.isolated)
    run(messages, script.fly(case, seed))
    run(messages, script.detect(case))
    engine = load_engine(script.ENGINE)
    flights = read_flights(engine, truth, detected)
    tell(map(story.verdict, flights))
    if not case.fault:
        return flights
    run(messages, script.isolate(case))
    flights = read_flights(engine, truth, detected, isolated)
    tell(map(story.isolated, flights))
    return flights


def _report(messages: Messages, missing_physics: bool) -> None:
    """Write what was found as one page, as the last step."""
    from enginediag_cli.validation import demonstration as script
    from enginediag_cli.validation import demonstration_missing as concealed

    click.echo("\nThe same as a page, for whoever was not here")
    run(messages, concealed.report() if missing_physics else script.report())
