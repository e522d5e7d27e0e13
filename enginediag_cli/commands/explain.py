"""`enginediag explain`: what physics does the model lack?"""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import click

from enginediag_cli.commands.mismatch_options import mismatch_options, provenance, tell_case, without_option
from enginediag_cli.commands.options import (
    OutputFile,
    exit_code_option,
    exit_codes,
    jobs_option,
    message_options,
    output_options,
    pass_messages,
)
from enginediag_cli.commands.parameter_types import CSV_SUFFIXES
from enginediag_cli.commands.picture_option import picture_option
from enginediag_cli.errors import ExitCode
from enginediag_cli.presentation.messages import Messages
from enginediag_cli.presentation.output import Output
from enginediag_cli.presentation.summaries import EXPLAIN

if TYPE_CHECKING:
    from enginediag_cli.mismatch.explain.story import Story
    from enginediag_cli.mismatch.fit.load import Case


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
    case: Case,
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
    from dataclasses import replace

    from enginediag_cli.mismatch.explain.answer import FAILED
    from enginediag_cli.mismatch.explain.story import tell
    from enginediag_cli.mismatch.fit.load import load_case
    from enginediag_cli.physics.registry import candidates
    from enginediag_cli.presentation.explanation_rows import amplitude_rows, curve_rows
    from enginediag_cli.presentation.explanations import sentences

    if plan and no_advice:
        raise click.UsageError("--plan asks for what --no-advice leaves out")
    loaded = load_case(case, identified=True, controls=True)
    tell_case(messages, case, loaded)
    effects = list(candidates(loaded.evidence.engine, without))
    story = tell(loaded.evidence, effects, advise=not no_advice, intake=loaded.intake)
    story = replace(story, control=loaded.control, planned=plan is not None)
    asked = {"without": ", ".join(without)} if without else {}
    head = provenance("explain", case, loaded.intake.provenance, **asked)
    for line in sentences(story):
        messages.note(line)
    _present(output, story, head)
    for path, rows, what in (
        (amplitudes, amplitude_rows(story), "effect with an unrecorded driver"),
        (curves, curve_rows(story.curves), "free-form curve"),
    ):
        if path and not Output(path).write_rows(rows, provenance=head):
            messages.note(f"{path}: no {what} was found, the file has no rows")
    if plan:
        _write_plan(messages, plan, story)
    if picture_path:
        _draw(messages, story, picture_path)
    if story.answer.status == FAILED and story.control is None:
        return ExitCode.NO_VERDICT
    return ExitCode.FINDING if exit_code and not story.found_nothing else ExitCode.DONE


def _draw(messages: Messages, story: Story, path: str) -> None:
    from enginediag_cli.presentation.explanation_picture import picture
    from enginediag_cli.presentation.pictures.written import write_drawing

    try:
        text = picture(story)
    except ValueError as nothing:
        messages.note(f"{path}: not written, {nothing}")
        return
    write_drawing(text, path)


def _present(output: Output, story: Story, head: tuple[str, ...]) -> None:
    from enginediag_cli.presentation.explanation_rows import COLUMNS, document, rows

    output.write_document(
        lambda: document(story, head if output.header else ()), rows(story), COLUMNS, summary=EXPLAIN, provenance=head
    )


def _write_plan(messages: Messages, path: str, story: Story) -> None:
    """The best flight as a flight file; nothing where there is none."""
    from enginediag_cli.config.dump import dump
    from enginediag_cli.recordings.write import output

    flight = story.advice.best_flight if story.advice is not None else None
    if flight is None:
        why = "no rival explanations remain" if story.advice is None else "no flight would tell the rivals apart"
        messages.note(f"{path}: not written, {why}")
        return
    with output(Path(path)) as stream:
        stream.write(dump(flight.flight_file(story.evidence.engine)))
    messages.note(f"{path}: {flight.words}, {flight.records} records")
