"""`enginediag explain`: what physics does the model lack?"""

from __future__ import annotations

from typing import TYPE_CHECKING

import click

from enginediag_cli.cli.judging import ending
from enginediag_cli.cli.mismatch_options import Searched, draw, mismatch_options, without_option
from enginediag_cli.cli.options import (
    OutputFile,
    exit_code_option,
    exit_codes,
    jobs_option,
    message_options,
    output_options,
    pass_messages,
)
from enginediag_cli.cli.parameter_types import CSV_SUFFIXES
from enginediag_cli.cli.picture_option import picture_option
from enginediag_cli.report.messages import Messages
from enginediag_cli.report.output import Output

if TYPE_CHECKING:
    from enginediag_cli.errors import ExitCode


@click.command(
    short_help="Say what physics the model lacks.", epilog=exit_codes("something is missing and --exit-code given")
)
@mismatch_options
@without_option
@click.option(
    "--amplitudes",
    metavar="FILE",
    type=OutputFile(CSV_SUFFIXES),
    help="Write the amplitude of an effect whose driver is not recorded, record by record, as CSV or .parquet.",
)
@click.option(
    "--curves",
    metavar="FILE",
    type=OutputFile(CSV_SUFFIXES),
    help="Write what no listed effect explains as curves along its driver, as CSV or .parquet.",
)
@picture_option("what no listed effect explains, a law along its variable or a free curve, with its band,")
@click.option("--no-advice", is_flag=True, help="Do not look for recordings that would separate rival explanations.")
@click.option(
    "--plan",
    metavar="FILE.yaml",
    type=OutputFile((".yaml", ".yml")),
    help="Write the flight that would separate rival explanations soonest, as a flight file that simulate takes, and "
    "tell the best recording of every kind.",
)
@jobs_option
@exit_code_option
@output_options
@message_options
@pass_messages
def explain(
    messages: Messages,
    searched: Searched,
    without: tuple[str, ...],
    amplitudes: str | None,
    curves: str | None,
    picture_path: str | None,
    no_advice: bool,
    plan: str | None,
    exit_code: bool,
    output: Output,
) -> ExitCode:
    """Name what was left out of the model of an engine, from recordings of engines believed healthy.

    \b
    enginediag explain configs/turbofan.yaml flights.csv
    enginediag explain configs/turbofan.yaml flights.csv --without humidity --format json
    enginediag explain configs/turbofan.yaml flights.csv --amplitudes valve.csv
    enginediag explain configs/turbofan.yaml flights.csv --plan next.yaml

    The answer is one of: nothing; an effect or several, with those that these flights cannot tell from them; a
    fault, which begins in time; a law that no library holds, by a formula that an engine file can carry; an effect
    whose driver is not recorded; none of these, with where, along what and how. What is named in part says what stays
    unexplained. Sentences go to standard error, coefficients as rows (or all of it as one JSON object) to standard
    output.
    """
    from enginediag_cli.api.discrepancy import explain as run

    result = run(
        searched.engine,
        searched.source,
        without=without,
        advice=not no_advice,
        every_plan=plan is not None,
        messages=messages,
        **searched.arguments,
    )
    result.write(output)
    if amplitudes:
        result.save_amplitudes(amplitudes)
    if curves:
        result.save_curves(curves)
    if plan:
        result.save_plan(plan)
    if picture_path:
        draw(messages, result, picture_path)
    return ending(result.found, result.judged, exit_code)
