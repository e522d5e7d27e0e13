"""`enginediag refine`: put a missing effect into the model, if flights that were not used gain by it."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, NamedTuple

import click

from enginediag_cli.commands.mismatch_options import (
    complete_terms,
    mismatch_options,
    provenance,
    tell_case,
    without_option,
)
from enginediag_cli.commands.options import (
    OutputFile,
    exit_codes,
    jobs_option,
    message_options,
    output_file_option,
    pass_messages,
)
from enginediag_cli.commands.parameter_types import CSV_SUFFIXES
from enginediag_cli.commands.picture_option import picture_option
from enginediag_cli.errors import ExitCode
from enginediag_cli.presentation.messages import Messages

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from enginediag_cli.engine.term import Effect
    from enginediag_cli.mismatch.fit.evidence import Evidence, Flight
    from enginediag_cli.mismatch.fit.load import Case, Loaded
    from enginediag_cli.mismatch.refine.refine import Refinement
    from enginediag_cli.mismatch.unrecorded.hidden import HiddenFinding


class Written(NamedTuple):
    """Files to write: the engine file, the report and the picture, if any, and the head of what is written."""

    place: str
    report: str | None
    picture: str | None
    head: tuple[str, ...]


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
    case: Case,
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
    if (holdout_last is None) == (not tests):
        raise click.UsageError("name the flights to judge by: either --holdout-last K or --test FILE")
    if switched and len(terms) != 1:
        raise click.UsageError("--switched goes with one --term")
    from enginediag_cli.mismatch.refine.refine import refine as run
    from enginediag_cli.mismatch.refine.switch import judged_by_trained_noise
    from enginediag_cli.presentation.refinements import refusal

    loaded, unseen, inherited = _loaded(messages, case, holdout_last, tests, controls=not terms)
    evidence = loaded.evidence
    hidden: HiddenFinding | None = None
    if len(unseen) == len(evidence.flights):
        raise click.UsageError("no flight is left to fit the effects to")
    if loaded.control is not None:
        head = provenance("refine", case, inherited, unseen=", ".join(evidence.flights[k].label for k in unseen))
        if states:
            messages.note(f"{states}: not written; what a control does in a record is in active_limit of simulate")
        return _control(messages, case, loaded, unseen, Written(output_path, report, picture_path, head))
    evidence = judged_by_trained_noise(evidence, unseen)
    training = evidence.only([k for k in range(len(evidence.flights)) if k not in unseen])
    if terms:
        effects = _asked(evidence, terms)
        if switched:
            from enginediag_cli.mismatch.refine.switch import find_switch

            hidden = find_switch(training, effects[0])
            if hidden is None:
                messages.error(f"no switch was found where {effects[0].label} acts; nothing is written")
                return ExitCode.NO_VERDICT
    else:
        effects, hidden = _explained(messages, training, without)
    if not effects:
        return ExitCode.NO_VERDICT
    try:
        found = run(evidence, unseen, effects, hidden=hidden, window=window)
    except ValueError as error:
        raise click.UsageError(str(error)) from None
    head = provenance("refine", case, inherited, unseen=", ".join(evidence.flights[k].label for k in unseen))
    _present(messages, found, Written(output_path, report, picture_path, head))
    told = refusal(found)
    if told:
        messages.error(f"{told}; {output_path} is not written")
        return ExitCode.NO_VERDICT
    _write(evidence, found, case, unseen, output_path)
    if states:
        from enginediag_cli.presentation.output import Output
        from enginediag_cli.presentation.refinements import state_rows

        if not Output(states).write_rows(state_rows(found), provenance=head):
            messages.note(f"{states}: no effect is switched, the file has no rows")
    return ExitCode.DONE


def _control(messages: Messages, case: Case, loaded: Loaded, unseen: list[int], to: Written) -> ExitCode:
    """Put the control that the engine lacks into its file, if unseen flights gain."""
    from enginediag_cli.mismatch.fit.evidence import as_recordings
    from enginediag_cli.mismatch.refine.controlled import refine_control
    from enginediag_cli.mismatch.refine.file import moved_text, write_refined
    from enginediag_cli.presentation import refined_controls
    from enginediag_cli.presentation.controls import control_sentences

    assert loaded.control is not None and loaded.as_described is not None
    described, engine = loaded.as_described
    flights = as_recordings(loaded.evidence.flights)
    training = [f for k, f in enumerate(flights) if k not in unseen]
    found = refine_control(loaded.control, described, engine, training, [flights[k] for k in unseen])
    for line in (*control_sentences(loaded.control), *refined_controls.sentences(found)):
        messages.note(line)
    rows = list(refined_controls.rows(found))
    _report(to, rows, refined_controls.COLUMNS, lambda: refined_controls.document(found, to.head))
    if to.picture and found.after:
        from enginediag_cli.presentation.pictures.written import write_drawing
        from enginediag_cli.presentation.refined_control_picture import picture

        write_drawing(picture(found), to.picture)
    if not found.accepted:
        messages.error(f"{refined_controls.refusal(found)}; {to.place} is not written")
        return ExitCode.NO_VERDICT
    source = _source(case, loaded.evidence, unseen)
    text = found.law.written(moved_text(case.engine, to.place), case.engine, source, found.standard_errors)
    write_refined(text, to.place, found.law.engine(described, engine.power_setting))
    return ExitCode.DONE


def _loaded(
    messages: Messages, case: Case, last: int | None, tests: tuple[str, ...], *, controls: bool
) -> tuple[Loaded, list[int], tuple[str, ...]]:
    """All flights, the positions of those to judge by, and the recordings' heads."""
    from dataclasses import replace

    from enginediag_cli.mismatch.fit.load import load_case
    from enginediag_cli.mismatch.refine.refine import last_flights

    def unseen(flights: Sequence[Flight]) -> list[int]:
        if last is not None:
            return last_flights(flights, last)
        return [k for k, flight in enumerate(flights) if flight.file in tests]

    def fitted(flights: Sequence[Flight]) -> list[Flight]:
        without = set(unseen(flights))
        return [f for k, f in enumerate(flights) if k not in without] or list(flights)

    source = replace(case.source, files=(*case.source.files, *tests))
    loaded = load_case(replace(case, source=source), fitted, controls=controls)
    tell_case(messages, case, loaded)
    return loaded, unseen(loaded.evidence.flights), tuple(loaded.intake.provenance)


def _asked(evidence: Evidence, terms: tuple[str, ...]) -> list[Effect]:
    """Effects that the user names. Raises UsageError for those that do not exist or are carried already."""
    from enginediag_cli.config.hints import near
    from enginediag_cli.physics.registry import candidates, effect

    engine = evidence.engine
    known = [e.label for e in candidates(engine)]
    carried = {e.label for e in engine.effects}
    found = []
    for label in dict.fromkeys(terms):
        if label in carried:
            raise click.UsageError(f"--term {label}: {engine.name} carries it already")
        if label not in known:
            raise click.UsageError(f"--term {label}: not an effect of {engine.name} ({near(label, known)})")
        name, _, site = label.partition("@")
        found.append(effect(engine, name, site))
    return found


def _explained(
    messages: Messages, training: Evidence, without: tuple[str, ...]
) -> tuple[list[Effect], HiddenFinding | None]:
    """What `explain` names from the flights that are fitted, and its finding where that is a switch; none, with the
    reason told, when it names no effect."""
    from enginediag_cli.mismatch.explain.answer import HIDDEN
    from enginediag_cli.mismatch.explain.story import named_effects, tell
    from enginediag_cli.physics.registry import candidates
    from enginediag_cli.presentation.explanations import sentences

    story = tell(training, list(candidates(training.engine, without)), advise=False, every_record=True)
    for line in sentences(story):
        messages.note(line)
    if story.answer.status == HIDDEN and story.hidden[0].is_switch and story.hidden_effects[0]:
        return list(story.hidden_effects[0][:1]), story.hidden[0]
    effects = list(named_effects(story))
    if not effects:
        messages.error("explain names no effect that a model could carry; nothing is written")
    return effects, None


def _present(messages: Messages, found: Refinement, to: Written) -> None:
    from enginediag_cli.presentation import refinements
    from enginediag_cli.presentation.tables import short_cell

    rows = list(refinements.rows(found))
    if rows:
        width = max(len(f"{r['what']}, {r['of']}") for r in rows)
        messages.note(f"{'on unseen flights':{width}}  {'before':>10}  {'after':>10}")
        for r in rows:
            unit = "" if r["unit"] == "1" else f" {r['unit']}"
            what = f"{r['what']}, {r['of']}"
            messages.note(f"{what:{width}}  {short_cell(r['before']):>10}  {short_cell(r['after']):>10}{unit}")
    for line in refinements.sentences(found):
        messages.note(line)
    _report(to, rows, refinements.COLUMNS, lambda: refinements.document(found, to.head))
    if to.picture and found.unseen is not None:
        from enginediag_cli.presentation.pictures.written import write_drawing
        from enginediag_cli.presentation.refinement_picture import picture

        write_drawing(picture(found), to.picture)


def _report(
    to: Written, rows: list[dict[str, Any]], columns: Sequence[str], document: Callable[[], dict[str, Any]]
) -> None:
    from enginediag_cli.presentation.output import SUFFIX_FORMATS, Output, table_suffix
    from enginediag_cli.presentation.summaries import REFINE

    if to.report:
        out = Output(to.report, "auto" if table_suffix(to.report) in SUFFIX_FORMATS else "table")
        out.write_document(document, rows, columns, summary=REFINE, provenance=to.head)


def _write(evidence: Evidence, found: Refinement, case: Case, unseen: list[int], place: str) -> None:
    from enginediag_cli.mismatch.refine.file import refined_text, write_refined

    engine = evidence.engine
    text = refined_text(case.engine, found.effects, found.standard_errors, _source(case, evidence, unseen), place)
    write_refined(text, place, engine.with_effects((*engine.effects, *found.effects)))


def _source(case: Case, evidence: Evidence, unseen: list[int]) -> str:
    """Data and command, files by name and hash but not by folder."""
    import os
    import sys

    from enginediag_cli import __version__
    from enginediag_cli.recordings.provenance import besides, sha256_of

    data = ", ".join(
        "standard input" if p == "-" else f"{os.path.basename(p)} sha256:{sha256_of(p)[:16]}" for p in case.source.files
    )
    command = " ".join(os.path.basename(a) if os.sep in a else a for a in sys.argv[1:])
    command += "".join(f", {key} {told}" for key, told in besides().items())
    return (
        f"enginediag {__version__} {command}; fitted to {len(evidence.flights) - len(unseen)} flights of {data}, "
        f"judged by {len(unseen)} that were not fitted"
    )
