"""`enginediag trend`: health over flights, and since when and how fast it changes."""

from __future__ import annotations

from typing import TYPE_CHECKING

import click

from enginediag_cli.commands.intake_options import compared_options, judging_options, source_options
from enginediag_cli.commands.judging import Compared, ending, judged_files, tell_files
from enginediag_cli.commands.options import exit_codes, message_options, output_options, pass_messages
from enginediag_cli.presentation.messages import Messages
from enginediag_cli.presentation.output import Output
from enginediag_cli.presentation.summaries import FLIGHTS, TREND

if TYPE_CHECKING:
    from enginediag_cli.errors import ExitCode
    from enginediag_cli.intake.source import Source
    from enginediag_cli.residuals.files import Judging


@click.command(short_help="Follow health over flights: level, onset and rate of deterioration.", epilog=exit_codes())
@source_options
@compared_options(help="Nominal engine, as written by identify; not needed for what residual has written.")
@judging_options
@click.option(
    "--what",
    type=click.Choice(["trend", "flights"]),
    default="trend",
    show_default=True,
    help="One row per parameter with kind, onset and rate, or one row per flight and parameter.",
)
@output_options
@message_options
@pass_messages
def trend(
    messages: Messages,
    source: Source,
    compared: Compared,
    judging: Judging,
    what: str,
    output: Output,
) -> ExitCode:
    """Follow the health of engines over flights, in the order of the files and of the flights in them.

    \b
    enginediag trend -n nominal.yaml flights.csv
    enginediag trend -n nominal.yaml --what flights flights.csv
    enginediag residual -n nominal.yaml flights.csv -o statistics.csv && enginediag trend statistics.csv

    Changes are in the parameter's unit, from nominal (--what flights) or since the onset, with 95 % intervals.
    `kind` is steady, step or deterioration, and `probability` is that the parameter has changed at all. Flights
    are counted from 1. Windows of one flight are added up.
    """
    from enginediag_cli.detection.trend_of_files import engine_trends, flight_sums
    from enginediag_cli.presentation.trend_rows import flight_rows, tell_trends, trend_rows
    from enginediag_cli.recordings.provenance import header_lines

    monitor = compared.open(messages, source, model_error=judging.model_error)
    files = judged_files(source, monitor, judging, summed=True)
    sums = flight_sums(files)
    if what == "flights":
        rows = list(flight_rows(sums))
    else:
        trends = engine_trends(sums)
        tell_trends(messages, trends)
        rows = list(trend_rows(trends, sums))
    head = header_lines(
        "trend",
        configs=[*compared.configs, *source.configs],
        notes={**source.notes, **judging.notes},
        inherited=files.intake.provenance,
    )
    output.write_rows(rows, summary=TREND if what == "trend" else FLIGHTS, provenance=head)
    tell_files(messages, files)
    if sums.lost:
        messages.warning(f"{sums.lost} windows without a verdict were left out")
    return ending(0, len(rows), False)
