"""`enginediag identify`: nominal parameters and noise of an engine from healthy recordings."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from enginediag_cli.cli.config import command
from enginediag_cli.cli.options import (
    INPUT,
    JUDGEMENT,
    MODEL,
    engine_argument,
    jobs_option,
    model_error_option,
    option,
    output_file_option,
    picture_option,
    recordings_options,
)
from enginediag_cli.cli.parameter_types import COUNT, FiniteRange
from enginediag_cli.errors import ExitCode
from enginediag_cli.report.messages import Messages

if TYPE_CHECKING:
    from enginediag_cli.api.inputs import Recordings


@command()
@engine_argument
@recordings_options
@option(INPUT, "--first", type=COUNT, metavar="N", help="Use only the first N records of each recording.")
@option(
    JUDGEMENT,
    "--holdout",
    type=FiniteRange(0, 0.9, min_open=True),
    metavar="SHARE",
    help="Exclude the last SHARE of each recording from the fit and judge the fit by it.",
)
@option(JUDGEMENT, "--holdout-last", is_flag=True, help="Exclude the last recording from the fit and judge by it.")
@option(JUDGEMENT, "--no-cross-validation", is_flag=True, help="Skip the refits without one block of records.")
@option(
    JUDGEMENT,
    "--allow-bounds",
    is_flag=True,
    help="Write the nominal file even if parameters are at their bounds or far from their priors.",
)
@option(MODEL, "--keep-probes", is_flag=True, help="Also fit probes that contradict the heat balances of the others.")
@model_error_option
@picture_option("how well each reading is fitted")
@output_file_option("Write the nominal file here, completely or not at all; - is standard output.")
@jobs_option
def identify(
    messages: Messages,
    engine: str,
    source: Recordings,
    no_cross_validation: bool,
    picture: str | None,
    output: str,
    **choices: Any,
) -> ExitCode:
    """Identify the nominal engine from recordings of healthy flights.

    \b
    enginediag identify configs/turbofan.yaml healthy.csv -o nominal.yaml
    enginediag identify configs/jt15d.yaml flight.csv --recorder configs/recorders/citation_jt15d.yaml \\
        --engine-instance left --holdout 0.3 -o left.yaml

    The nominal file goes to standard output or -o, the report to standard error. The `identification:` block of the
    engine file lists the parameters to estimate and their prior sizes.
    """
    from enginediag_cli.api.identification import identify as run

    result = run(engine, source, cross_validation=not no_cross_validation, messages=messages, **choices)
    if result.refusal:
        return ExitCode.NO_VERDICT
    result.save(output)
    if picture:
        result.plot().save(picture)
    return ExitCode.DONE
