"""`enginediag residual`: condense recordings into local statistics, or list residuals record by record."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import chain
from typing import Any

import click

from enginediag_cli.commands.options import (
    exit_codes,
    message_options,
    nominal_option,
    output_options,
    pass_messages,
    recordings_argument,
)
from enginediag_cli.commands.origin import Origin, origin_options
from enginediag_cli.commands.windows import Intake, load_monitor, planned, window_options
from enginediag_cli.presentation.messages import Messages
from enginediag_cli.presentation.output import Output


@click.command(short_help="Condense recordings into local statistics.", epilog=exit_codes())
@recordings_argument
@nominal_option
@window_options
@origin_options
@click.option("--sensors", is_flag=True, help="Statistics of a bias of every sensor, too, for isolate.")
@click.option(
    "--what",
    type=click.Choice(["statistics", "records"]),
    default="statistics",
    show_default=True,
    help="One row of local statistics per window, or one row of residuals per record.",
)
@output_options
@message_options
@pass_messages
def residual(
    messages: Messages,
    recordings: tuple[str, ...],
    nominal: str,
    window: str | None,
    step: str | None,
    linearise: str,
    patterns: tuple[str, ...],
    origin: Origin,
    sensors: bool,
    what: str,
    output: Output,
) -> None:
    """Compare recordings with the nominal engine.

    \b
    enginediag residual -n nominal.yaml --sensors flight.csv --window 10min | enginediag isolate -
    enginediag residual -n nominal.yaml flight.csv --what records > residuals.csv

    A row of statistics holds s, F and V of a window (upper triangles), the nominal values, prior sizes of
    change and names of the parameters: detect and isolate need nothing else. What is uncertain about the
    nominal engine and about sensor offsets is counted in s, F and V.
    """
    from enginediag_cli.recordings.provenance import header_lines
    from enginediag_cli.residuals.flat import flat_columns, flat_row

    plan = planned(window, step)
    intake = Intake(messages, load_monitor(messages, nominal, patterns, sensors=sensors), plan, linearise, origin)
    assert intake.monitor is not None
    columns: tuple[str, ...] | None
    if what == "records":
        rows, columns = _records(intake, recordings), None
    else:
        rows = (flat_row(found) for found, _ in intake.windows(recordings))
        columns = flat_columns(intake.monitor.monitored)
    first = next(rows, None)  # reads the head of the first file, which the provenance quotes
    notes = {"linearised": "at nominal" if linearise == "nominal" or what == "records" else "at each estimate"}
    head = header_lines(
        "residual",
        configs=[nominal, *origin.configs],
        notes={**notes, **origin.notes},
        inherited=intake.provenance,
    )
    output.write_rows(chain([first] if first is not None else [], rows), columns, provenance=head, live=True)
    intake.report()


def _records(intake: Intake, files: tuple[str, ...]) -> Iterator[dict[str, Any]]:
    from enginediag_cli.residuals.records import record_residuals

    assert intake.monitor is not None
    for chunk in intake.recordings(files):
        yield from record_residuals(intake.monitor, chunk)
