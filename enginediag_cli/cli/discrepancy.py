"""`enginediag locate`, `explain` and `refine`: where model and recordings differ, why, and a model that does not."""

from __future__ import annotations

import os
import sys
from typing import TYPE_CHECKING, Any

import click

from enginediag_cli.cli.config import choose_exit_code, command, write_result
from enginediag_cli.cli.options import (
    COUNT,
    CSV_SUFFIXES,
    EXISTING,
    INPUT,
    JUDGEMENT,
    MODEL,
    OUTPUT,
    OutputFile,
    complete_terms,
    engine_argument,
    exit_code_option,
    jobs_option,
    model_error_option,
    nominal_options,
    option,
    options,
    output_file_option,
    output_options,
    picture_option,
    probability_option,
    recordings_options,
    seed_option,
)
from enginediag_cli.errors import ExitCode, NoVerdictError
from enginediag_cli.report.messages import Messages
from enginediag_cli.report.output import Output

if TYPE_CHECKING:
    from enginediag_cli.api.inputs import Recordings
    from enginediag_cli.api.results import Result


def _name_drivers(values: dict[str, Any]) -> None:
    values["drivers"] = values.pop("driver")


search_options = options(
    engine_argument,
    recordings_options,
    nominal_options(
        "Nominal file of the engine, from identify: starting point and noise. Default: explain identifies the engine "
        "from the same flights; locate and refine start from the engine file."
    ),
    option(
        INPUT,
        "--driver",
        metavar="COLUMN",
        multiple=True,
        help="Further recorded column that the missing physics may depend on, such as hours or a valve position. "
        "Repeatable.",
    ),
    model_error_option,
    option(
        MODEL,
        "--noise",
        type=click.Choice(["specified", "estimate"]),
        help="specified: sensor noise as stated; estimate: from the residuals, with its correlation over time. "
        "Default: locate and refine follow the engine file, explain the flights; estimate with a nominal file whose "
        "noise was estimated.",
    ),
    probability_option("--false-finding", 0.05, "Probability of a finding where nothing is missing."),
    seed_option,
    adapt=_name_drivers,
)
"""Engine, recordings, nominal file, and attributes of `SearchOptions`."""

without_option = option(
    MODEL,
    "--without",
    metavar="TERM",
    multiple=True,
    shell_complete=complete_terms,
    help="Exclude this effect, or effect@site, from the search. Repeatable.",
)


@command(finding="model and recordings differ and --exit-code given")
@search_options
@option(OUTPUT, "--all", is_flag=True, help="Write all places of the map, not only the plausible ones.")
@option(
    OUTPUT,
    "--per-record",
    metavar="N",
    type=COUNT,
    help="Instead of the map: fit a free amplitude in every Nth record at each place, for large effects without a "
    "recorded driver.",
)
@picture_option("the map, and the residuals that show it best,")
@jobs_option
@exit_code_option
@output_options
def locate(
    messages: Messages,
    engine: str,
    source: Recordings,
    all: bool,
    picture: str | None,
    per_record: int | None,
    exit_code: bool,
    output: Output,
    **search: Any,
) -> ExitCode:
    """Locate a mismatch between the engine's model and recordings of healthy flights.

    \b
    enginediag locate configs/turbofan.yaml flights.csv
    enginediag locate configs/turbofan.yaml fleet/*.csv --picture map.svg
    enginediag locate configs/power_plant.yaml year.csv --per-record 16 --format table
    enginediag locate configs/citation_jt15d.yaml flight.csv --recorder configs/recorders/citation_jt15d.yaml

    The first question is whether there is a mismatch beyond noise and the parameters of identification. If so, there is
    one row for each plausible place, with the variables (drivers) that it depends on; drivers that these flights cannot
    separate form one group (a = b). `statistic` is the reduction of χ² by a free-form correction there, `share` its
    part of the excess. `p_value` is adjusted for all places examined. `stability` is the share of resamples of whole
    flights in which the place comes first. The verdict distinguishes a wrong sensor, a change over time (fault), an
    effect, an effect common to all engines of a fleet, and an effect that switches.
    """
    from enginediag_cli.api import discrepancy

    if per_record is None:
        located = discrepancy.locate(engine, source, every_place=all, messages=messages, **search)
        if located.converged:
            write_result(located, output, picture)
        return choose_exit_code(located.findings, located.judged, exit_code)
    if all or picture:
        raise click.UsageError("--all and --picture need the map, which --per-record replaces")
    result = discrepancy.locate_per_record(engine, source, every=per_record, messages=messages, **search)
    write_result(result, output)
    return choose_exit_code(0, result.judged, False)


@command(finding="something is missing and --exit-code given")
@search_options
@without_option
@option(
    OUTPUT,
    "--amplitudes",
    metavar="FILE",
    type=OutputFile(CSV_SUFFIXES),
    help="Write the amplitude of an effect without a recorded driver, record by record, as CSV or .parquet.",
)
@option(
    OUTPUT,
    "--curves",
    metavar="FILE",
    type=OutputFile(CSV_SUFFIXES),
    help="Write the unexplained part as curves over its driver, as CSV or .parquet.",
)
@picture_option("the unexplained part, as an empirical formula or a free curve, with its band,")
@option(OUTPUT, "--no-advice", is_flag=True, help="Do not search for recordings that separate the alternatives.")
@option(
    OUTPUT,
    "--plan",
    metavar="FILE.yaml",
    type=OutputFile((".yaml", ".yml")),
    help="Write the flight that separates the alternatives soonest, as a flight file for simulate, and report the best "
    "recording of every kind.",
)
@jobs_option
@exit_code_option
@output_options
def explain(
    messages: Messages,
    engine: str,
    source: Recordings,
    amplitudes: str | None,
    curves: str | None,
    picture: str | None,
    no_advice: bool,
    plan: str | None,
    exit_code: bool,
    output: Output,
    **search: Any,
) -> ExitCode:
    """Name the physics that the model of an engine lacks, from recordings of healthy engines.

    \b
    enginediag explain configs/turbofan.yaml flights.csv
    enginediag explain configs/turbofan.yaml flights.csv --without humidity --format json
    enginediag explain configs/turbofan.yaml flights.csv --amplitudes valve.csv
    enginediag explain configs/turbofan.yaml flights.csv --plan next.yaml

    The answer is one of: nothing; one or several effects, with the effects that these flights cannot separate from
    them; a fault, which begins at a time; an empirical formula that an engine file can carry; an effect without a
    recorded driver; or none of these, with place, driver and form of the deviation. A partial answer states what
    remains unexplained. Sentences go to standard error; coefficients go to standard output as rows, or with all details
    as one JSON object.
    """
    from enginediag_cli.api.discrepancy import explain as run

    result = run(engine, source, advice=not no_advice, every_plan=plan is not None, messages=messages, **search)
    result.write(output)
    if amplitudes:
        result.save_amplitudes(amplitudes)
    if curves:
        result.save_curves(curves)
    if plan:
        result.save_plan(plan)
    if picture:
        _draw(messages, result, picture)
    return choose_exit_code(result.findings, result.judged, exit_code)


@command()
@search_options
@option(
    INPUT,
    "--test",
    metavar="FILE",
    multiple=True,
    type=EXISTING,
    help="Judge by the flights of this recording, which are not fitted. Repeatable.",
)
@without_option
@option(
    MODEL,
    "--term",
    metavar="TERM@SITE",
    multiple=True,
    shell_complete=complete_terms,
    help="Effect to add, such as reynolds_efficiency@hpc. Repeatable. Default: what explain finds in the fitted "
    "flights.",
)
@option(MODEL, "--switched", is_flag=True, help="The effect of --term switches on and off unrecorded: find its states.")
@option(
    JUDGEMENT,
    "--holdout-last",
    metavar="K",
    type=COUNT,
    help="Judge by the last K flights of each engine, which are not fitted.",
)
@option(
    JUDGEMENT,
    "--window",
    metavar="RECORDS",
    type=click.IntRange(min=5),
    default=30,
    show_default=True,
    help="Length of the windows in which detect is tried before and after.",
)
@output_file_option(
    "Engine file with the effect, written completely or not at all; - is standard output.", required=True
)
@option(
    OUTPUT,
    "--report",
    metavar="FILE",
    type=OutputFile(),
    help="Write the comparison before and after to FILE (.csv, .json, .parquet or a table).",
)
@option(
    OUTPUT,
    "--states",
    metavar="FILE",
    type=OutputFile(CSV_SUFFIXES),
    help="Write the states of a switched effect, record by record, as CSV or .parquet, with the column that the "
    "refined engine reads.",
)
@picture_option("the comparison before and after")
@jobs_option
def refine(
    messages: Messages,
    engine: str,
    source: Recordings,
    term: tuple[str, ...],
    states: str | None,
    output: str,
    report: str | None,
    picture: str | None,
    **choices: Any,
) -> ExitCode:
    """Fit what the model of an engine lacks, and write an engine file with it.

    \b
    enginediag refine configs/turbofan.yaml flights.csv --holdout-last 3 -o refined.yaml
    enginediag refine configs/turbofan.yaml train.csv --test unseen.csv --term humidity@ambient -o refined.yaml

    All of these are required. The coefficients differ significantly from zero in the fitted flights. The model predicts
    the unseen flights better. An effect that switches unrecorded does so at its place and with the contrast of on and
    off. Otherwise, or when a coefficient is at its physical bound or a fit does not converge, nothing is written and
    the exit code is 3. Every other command reads the refined file.
    """
    from enginediag_cli.api.refinement import refine as run

    result = run(
        engine,
        source,
        terms=term,
        command=" ".join(os.path.basename(word) if os.sep in word else word for word in sys.argv[1:]),
        messages=messages,
        **choices,
    )
    if report:
        result.save_report(report)
    if picture:
        _draw(messages, result, picture)
    result.save(output)  # where it is not accepted, the reason is the error that ends the command
    if states:
        result.save_states(states)
    return ExitCode.DONE


def _draw(messages: Messages, result: Result, path: str) -> None:
    """Write the picture of a result; a note says why there is none."""
    try:
        result.plot().save(path)
    except NoVerdictError as nothing:
        messages.note(f"{path}: not written, {nothing}")
