"""`enginediag residual`: condense recordings into local statistics, or list residuals record by record."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import chain
from typing import TYPE_CHECKING, Any

import click

from enginediag_cli.commands.intake_options import compared_options, judging_options, source_options, window_options
from enginediag_cli.commands.judging import Compared, ending, judged_files, tell_files
from enginediag_cli.commands.options import exit_codes, jobs_option, message_options, output_options, pass_messages
from enginediag_cli.errors import ExitCode
from enginediag_cli.presentation.messages import Messages
from enginediag_cli.presentation.output import Output
from enginediag_cli.presentation.summaries import STATISTICS

if TYPE_CHECKING:
    from enginediag_cli.intake.source import Source
    from enginediag_cli.residuals.files import JudgedFiles, Judging
    from enginediag_cli.residuals.monitor import Monitor

if TYPE_CHECKING:
    from enginediag_cli.errors import ExitCode


@click.command(short_help="Condense recordings into local statistics.", epilog=exit_codes())
@source_options
@compared_options(required=True)
@judging_options
@window_options
@click.option("--sensors", is_flag=True, help="Statistics of a bias of every sensor, too, for isolate.")
@click.option(
    "--what",
    type=click.Choice(["statistics", "records"]),
    default="statistics",
    show_default=True,
    help="One row of local statistics per window, or one row of residuals per record.",
)
@jobs_option
@output_options
@message_options
@pass_messages
def residual(
    messages: Messages,
    source: Source,
    compared: Compared,
    judging: Judging,
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
    nominal engine and about sensor offsets has columns of its own (nuisance), so that rows add over windows,
    flights and files; it is counted as noise when the rows are read. With --reference it is counted in s, F and V.

    Statistics are formed without gross errors; rows of records have every reading as it is, gross errors, too.
    """
    from enginediag_cli.presentation.outputs.residual import RECORDS, RESIDUAL
    from enginediag_cli.recordings.provenance import header_lines
    from enginediag_cli.residuals.flat import flat_columns
    from enginediag_cli.residuals.seal import CHECKSUM, MADE_COLUMNS

    monitor = compared.open(messages, source, sensors=sensors, model_error=judging.model_error)
    assert monitor is not None
    files = judged_files(source, monitor, judging)
    columns: tuple[str, ...] | None
    if what == "records":
        rows, columns = _records(files), None
    else:
        files.additive = True
        rows = _statistics(files, monitor)
        columns = (*flat_columns(monitor.monitored, files.nuisance), *MADE_COLUMNS, CHECKSUM)
    first = next(rows, None)  # reads the head of the first file, which the provenance quotes
    notes = {"linearised": "at nominal" if judging.linearise == "nominal" or what == "records" else "at each estimate"}
    head = header_lines(
        "residual",
        configs=[*compared.configs, *source.configs],
        notes={**(RECORDS if what == "records" else RESIDUAL).notes, **notes, **source.notes, **judging.notes},
        inherited=files.intake.provenance,
    )
    summary = STATISTICS if what == "statistics" else ()  # residuals go by the engine's own sensors, in their order
    rows_found = chain([first] if first is not None else [], rows)
    output.write_rows(rows_found, columns, summary=summary, provenance=head, live=True)
    tell_files(messages, files)
    return ending(0, files.counts["statistics"], False, files.intake.unread)


def _statistics(files: JudgedFiles, monitor: Monitor) -> Iterator[dict[str, Any]]:
    from enginediag_cli.residuals.files import made_with
    from enginediag_cli.residuals.flat import flat_row
    from enginediag_cli.residuals.seal import sealed

    made = made_with(files, monitor)
    for found, _ in files.windows():
        yield sealed(flat_row(found), made)


def _records(files: JudgedFiles) -> Iterator[dict[str, Any]]:
    from enginediag_cli.residuals.records import record_residuals

    assert files.monitor is not None
    for chunk in files.intake.chunks():
        for row in record_residuals(files.monitor, chunk):
            files.counts["statistics"] += any(value == value for c, value in row.items() if c.endswith(":residual"))
            yield row
