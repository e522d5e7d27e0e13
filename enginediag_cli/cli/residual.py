"""`enginediag residual`: reduce recordings to sufficient statistics, or list residuals record by record."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import click

from enginediag_cli.cli.config import choose_exit_code, command, write_result
from enginediag_cli.cli.options import (
    MODEL,
    OUTPUT,
    jobs_option,
    nominal_options,
    option,
    output_options,
    recordings_options,
    window_options,
)
from enginediag_cli.errors import ExitCode
from enginediag_cli.report.messages import Messages
from enginediag_cli.report.output import Output

if TYPE_CHECKING:
    from enginediag_cli.api.inputs import Recordings


@command()
@recordings_options
@nominal_options(required=True)
@window_options
@option(
    MODEL, "--sensors", is_flag=True, help="Include bias, scale and drift of every instrument, as isolate needs them."
)
@option(
    OUTPUT,
    "--what",
    type=click.Choice(["statistics", "records"]),
    default="statistics",
    show_default=True,
    help="statistics: one row of sufficient statistics per window; records: one row of residuals per record.",
)
@jobs_option
@output_options
def residual(messages: Messages, nominal: str, source: Recordings, output: Output, **choices: Any) -> ExitCode:
    """Compare recordings with the nominal engine.

    \b
    enginediag residual -n nominal.yaml --sensors flight.csv --window 10min | enginediag isolate -
    enginediag residual -n nominal.yaml flight.csv --what records > residuals.csv

    A row of statistics holds s, F and V of a window (upper triangles), the nominal values, the prior sizes and the
    names of the parameters. detect, isolate and trend need nothing else. The uncertainty of the nominal engine and of
    sensor offsets has columns of its own (nuisance parameters), so that rows add over windows, flights and files; it
    is added to the noise when the rows are read. With --reference it is part of s, F and V.

    Gross errors are excluded from statistics; rows of records keep every reading.
    """
    from enginediag_cli.api.detection import residual as run

    result = run(nominal, source, messages=messages, stream=True, **choices)
    write_result(result, output)
    return choose_exit_code(0, result.judged, False, result.unread)
