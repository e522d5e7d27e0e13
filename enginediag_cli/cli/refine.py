"""`enginediag refine`: put a missing effect into the model, if flights that were not used gain by it."""

from __future__ import annotations

import os
import sys

import click

from enginediag_cli.cli.mismatch_options import (
    Searched,
    complete_terms,
    draw,
    mismatch_options,
    without_option,
)
from enginediag_cli.cli.options import (
    OutputFile,
    exit_codes,
    jobs_option,
    message_options,
    output_file_option,
    pass_messages,
)
from enginediag_cli.cli.parameter_types import CSV_SUFFIXES
from enginediag_cli.cli.picture_option import picture_option
from enginediag_cli.errors import ExitCode
from enginediag_cli.report.messages import Messages


@click.command(short_help="Put a missing effect into the model, if unseen flights gain by it.", epilog=exit_codes())
@mismatch_options
@without_option
@click.option(
    "--term",
    "terms",
    metavar="TERM@SITE",
    multiple=True,
    shell_complete=complete_terms,
    help="Effect to put in, such as reynolds_efficiency@hpc; may be given several times. Without it, what "
    "explain names from the flights that are fitted.",
)
@click.option(
    "--switched", is_flag=True, help="The effect of --term is on or off without any column showing it: find its states."
)
@click.option(
    "--states",
    metavar="FILE",
    type=OutputFile(CSV_SUFFIXES),
    help="Write the states of a switched effect, record by record, as CSV or .parquet, with the column that the "
    "refined engine reads.",
)
@click.option(
    "--holdout-last",
    metavar="K",
    type=click.IntRange(min=1),
    help="Judge by the last K flights of each engine, which are not fitted.",
)
@click.option(
    "--test",
    "tests",
    metavar="FILE",
    multiple=True,
    type=click.Path(exists=True, dir_okay=False, readable=True),
    help="Judge by the flights of this recording, which are not fitted. May be given several times.",
)
@click.option(
    "--window",
    metavar="RECORDS",
    type=click.IntRange(min=5),
    default=30,
    show_default=True,
    help="Length of the windows in which detect is tried before and after.",
)
@output_file_option(
    "Engine file that carries the effect, written completely or not at all; - is standard output.", required=True
)
@click.option(
    "--report",
    metavar="FILE",
    type=OutputFile(),
    help="Write before and after to FILE (.csv, .json, .parquet or a table), beside standard error.",
)
@picture_option("before and after")
@jobs_option
@message_options
@pass_messages
def refine(
    messages: Messages,
    searched: Searched,
    without: tuple[str, ...],
    terms: tuple[str, ...],
    switched: bool,
    states: str | None,
    holdout_last: int | None,
    tests: tuple[str, ...],
    window: int,
    output_path: str,
    report: str | None,
    picture_path: str | None,
) -> ExitCode:
    """Fit what the model of an engine lacks, and write an engine file that carries it.

    \b
    enginediag refine configs/turbofan.yaml flights.csv --holdout-last 3 -o refined.yaml
    enginediag refine configs/turbofan.yaml train.csv --test unseen.csv --term humidity@ambient -o refined.yaml

    All of this is asked: the coefficients differ from nothing by the fitted flights; the unseen flights, judged
    together, are predicted better at the point prediction, whatever the width of the prediction; and an effect that
    switches without a column does so where it is on and by the contrast of on and off.
    Else, or when a coefficient ends at its physical bound or a fit does not converge, nothing is written and the
    exit code is 3. The refined file can be used with every other command.
    """
    from enginediag_cli.api.refinement import refine as run

    result = run(
        searched.engine,
        searched.source,
        terms=terms,
        without=without,
        switched=switched,
        holdout_last=holdout_last,
        test=tests,
        window=window,
        command=" ".join(os.path.basename(word) if os.sep in word else word for word in sys.argv[1:]),
        messages=messages,
        **searched.arguments,
    )
    if report:
        result.save_report(report)
    if picture_path:
        draw(messages, result, picture_path)
    result.save(output_path)  # where it is not accepted, the reason is the error that ends the command
    if states:
        result.save_states(states)
    return ExitCode.DONE
