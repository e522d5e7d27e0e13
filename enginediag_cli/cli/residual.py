"""`enginediag residual`: condense recordings into local statistics, or list residuals record by record."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import click

from enginediag_cli.cli.intake_options import compared_options, judging_options, source_options, window_options
from enginediag_cli.cli.judging import Compared, ending, write_result
from enginediag_cli.cli.options import exit_codes, jobs_option, message_options, output_options, pass_messages
from enginediag_cli.errors import ExitCode
from enginediag_cli.report.messages import Messages
from enginediag_cli.report.output import Output

if TYPE_CHECKING:
    from enginediag_cli.api.inputs import Recordings


@click.command(short_help="Condense recordings into local statistics.", epilog=exit_codes())
@source_options
@compared_options(required=True)
@judging_options
@window_options
@click.option(
    "--sensors", is_flag=True, help="Statistics of bias, scale and drift of every instrument, too, for isolate."
)
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
    source: Recordings,
    compared: Compared,
    windows: dict[str, Any],
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
    from enginediag_cli.api.detection import residual as run

    result = run(
        compared.nominal,
        source,
        what=what,
        sensors=sensors,
        messages=messages,
        stream=True,
        **windows,
        **compared.arguments,
    )
    write_result(result, output)
    return ending(0, result.judged, False, result.unread)
