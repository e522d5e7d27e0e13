"""`enginediag residual`: condense recordings into local statistics, or list residuals record by record."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import chain
from typing import TYPE_CHECKING, Any

import click

from enginediag_cli.commands.intake_options import (
    judging_options,
    monitor_option,
    nominal_options,
    source_options,
    window_options,
)
from enginediag_cli.commands.judging import ending, open_intake, open_monitor, tell_files
from enginediag_cli.commands.options import exit_codes, message_options, output_options, pass_messages
from enginediag_cli.errors import ExitCode
from enginediag_cli.presentation.messages import Messages
from enginediag_cli.presentation.output import Output

if TYPE_CHECKING:
    from enginediag_cli.intake.source import Source
    from enginediag_cli.residuals.files import JudgedFiles, Judging


@click.command(short_help="Condense recordings into local statistics.", epilog=exit_codes())
@source_options
@nominal_options(required=True)
@judging_options
@window_options
@monitor_option
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
    source: Source,
    nominal: str,
    accept_changed_engine: bool,
    judging: Judging,
    patterns: tuple[str, ...],
    sensors: bool,
    what: str,
    output: Output,
) -> ExitCode:
    """Compare recordings with the nominal engine.

    \b
    enginediag residual -n nominal.yaml --sensors flight.csv --window 10min | enginediag isolate -
    enginediag residual -n nominal.yaml flight.csv --what records > residuals.csv

    A row of statistics holds s, F and V of a window (upper triangles), the nominal values, prior sizes of
    change and names of the parameters: detect and isolate need nothing else. What is uncertain about the
    nominal engine and about sensor offsets is counted in s, F and V.
    """
    from enginediag_cli.recordings.provenance import header_lines
    from enginediag_cli.residuals.files import JudgedFiles
    from enginediag_cli.residuals.flat import flat_columns, flat_row

    monitor = open_monitor(nominal, patterns, accept_changed_engine, sensors=sensors)
    files = JudgedFiles(open_intake(source, monitor), monitor, judging)
    columns: tuple[str, ...] | None
    if what == "records":
        rows, columns = _records(files), None
    else:
        rows = (flat_row(found, units) for found, units in files.windows())
        columns = flat_columns(monitor.monitored)
    first = next(rows, None)  # reads the head of the first file, which the provenance quotes
    notes = {"linearised": "at nominal" if judging.linearise == "nominal" or what == "records" else "at each estimate"}
    head = header_lines(
        "residual",
        configs=[nominal, *source.configs],
        notes={**notes, **source.notes, **judging.notes},
        inherited=files.intake.provenance,
    )
    written = output.write_rows(chain([first] if first is not None else [], rows), columns, provenance=head, live=True)
    tell_files(messages, files)
    judged = files.counts["statistics"] if what == "statistics" else written
    return ending(0, judged, False)


def _records(files: JudgedFiles) -> Iterator[dict[str, Any]]:
    from enginediag_cli.residuals.records import record_residuals

    assert files.monitor is not None
    for chunk in files.intake.chunks():
        yield from record_residuals(files.monitor, chunk)
