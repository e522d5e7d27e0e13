"""`enginediag identify`: nominal parameters and noise of an engine from healthy recordings."""

from __future__ import annotations

from typing import TYPE_CHECKING

import click

from enginediag_cli.cli.intake_options import model_error_option, source_options
from enginediag_cli.cli.options import (
    ConfigFile,
    FiniteRange,
    exit_codes,
    jobs_option,
    message_options,
    output_file_option,
    pass_messages,
)
from enginediag_cli.cli.picture_option import picture_option
from enginediag_cli.errors import ExitCode
from enginediag_cli.report.messages import Messages

if TYPE_CHECKING:
    from enginediag_cli.api.inputs import Recordings


@click.command(short_help="Fit the nominal engine and its sensor noise.", epilog=exit_codes())
@click.argument("engine_path", metavar="ENGINE.yaml", type=ConfigFile())
@source_options
@click.option(
    "--first",
    type=click.IntRange(min=1),
    metavar="N",
    help="Use only the first N records of each recording, for an engine's early life.",
)
@click.option(
    "--holdout",
    type=FiniteRange(0, 0.9, min_open=True),
    metavar="SHARE",
    help="Keep the last SHARE of each recording out of the fit and judge the fit by it.",
)
@click.option("--holdout-last", is_flag=True, help="Keep the last recording out of the fit and judge by it.")
@click.option("--no-cross-validation", is_flag=True, help="Skip the refits without a block of records.")
@click.option("--keep-probes", is_flag=True, help="Fit probes, too, that the heat balances of the others contradict.")
@model_error_option
@click.option(
    "--allow-bounds", is_flag=True, help="Write it although parameters end at their bounds, or far from their priors."
)
@picture_option("how well each reading is fitted")
@output_file_option("Write the nominal file here, completely or not at all; - is standard output.")
@jobs_option
@message_options
@pass_messages
def identify(
    messages: Messages,
    engine_path: str,
    source: Recordings,
    first: int | None,
    holdout: float | None,
    holdout_last: bool,
    no_cross_validation: bool,
    keep_probes: bool,
    model_error: float | None,
    allow_bounds: bool,
    picture_path: str | None,
    output_path: str,
) -> ExitCode:
    """Identify the nominal engine from recordings believed healthy.

    \b
    enginediag identify configs/turbofan.yaml healthy.csv -o nominal.yaml
    enginediag identify configs/jt15d.yaml flight.csv --recorder configs/recorders/citation_jt15d.yaml \\
        --engine-instance left --holdout 0.3 -o left.yaml

    The nominal file goes to standard output or -o, the report to standard error. What is estimated, and how
    loosely, stands in the `identification:` block of the engine file.
    """
    from enginediag_cli.api.identification import identify as run

    result = run(
        engine_path,
        source,
        first=first,
        holdout=holdout,
        holdout_last=holdout_last,
        cross_validation=not no_cross_validation,
        keep_probes=keep_probes,
        model_error=model_error,
        allow_bounds=allow_bounds,
        messages=messages,
    )
    if result.refusal:
        return ExitCode.NO_VERDICT
    result.save(output_path)
    if picture_path:
        result.plot().save(picture_path)
    return ExitCode.DONE
