"""`enginediag locate`: whether model and recordings differ, and where: location × driver."""

from __future__ import annotations

from typing import TYPE_CHECKING

import click

from enginediag_cli.commands.mismatch_options import mismatch_options, provenance, tell_case
from enginediag_cli.commands.options import (
    exit_code_option,
    exit_codes,
    jobs_option,
    message_options,
    output_options,
    pass_messages,
)
from enginediag_cli.commands.picture_option import picture_option
from enginediag_cli.errors import ExitCode
from enginediag_cli.presentation.messages import Messages
from enginediag_cli.presentation.output import Output
from enginediag_cli.presentation.summaries import LOCATE, PER_RECORD

if TYPE_CHECKING:
    from enginediag_cli.mismatch.fit.load import Case, Loaded


@click.command(
    short_help="Say where model and recordings differ.",
    epilog=exit_codes("model and recordings differ and --exit-code given"),
)
@mismatch_options
@click.option("--all", "everything", is_flag=True, help="Write every place of the map, not only those within reach.")
@picture_option("the map, and the residuals that show it best,")
@click.option(
    "--per-record",
    "every",
    metavar="N",
    type=click.IntRange(min=1),
    help="Instead of the map: a free amplitude in every Nth record at each place in turn, for what moves the engine "
    "far and has no recorded driver.",
)
@jobs_option
@exit_code_option
@output_options
@message_options
@pass_messages
def locate(
    messages: Messages,
    case: Case,
    everything: bool,
    picture_path: str | None,
    every: int | None,
    exit_code: bool,
    output: Output,
) -> ExitCode:
    """Locate a mismatch between the engine's model and recordings believed healthy.

    \b
    enginediag locate configs/turbofan.yaml flights.csv
    enginediag locate configs/turbofan.yaml fleet/*.csv --picture map.svg
    enginediag locate configs/power_plant.yaml year.csv --per-record 16 --format table
    enginediag locate configs/citation_jt15d.yaml flight.csv --recorder configs/recorders/citation_jt15d.yaml

    First whether there is one, beyond noise and what identification absorbs; if not, that is the answer. Then where
    it acts and what it varies with: one row for each place within reach of the best, drivers that these flights
    cannot tell apart as one group (a = b). `statistic` is the fall of χ² of a free-form correction there, `share`
    what that is of the excess, `p_value` is adjusted for all places looked at, `stability` the share of resamples of
    whole flights in which the place comes first. The verdict tells a wrong sensor, a change in time (fault), an
    effect, one common to all engines of a fleet, and one that switches.
    """
    from enginediag_cli.mismatch.fit.load import load_case
    from enginediag_cli.mismatch.locate.locate import locate as run
    from enginediag_cli.mismatch.locate.verdict_kind import kind_of
    from enginediag_cli.presentation.located import COLUMNS, located_rows, picture, sentences
    from enginediag_cli.presentation.outputs.locate import LOCATE as LOCATE_ROWS

    loaded = load_case(case)
    tell_case(messages, case, loaded)
    if every is not None:
        return _per_record(messages, case, loaded, every, output)
    located = run(loaded.evidence)
    kind = kind_of(located)
    told = list(sentences(located, kind, loaded.evidence.engine))
    if not located.converged:
        messages.error(told[0])
        return ExitCode.NO_VERDICT
    notes = {**LOCATE_ROWS.notes, "map accuracy": f"{loaded.evidence.settings.map_accuracy:g}"}
    output.write_rows(
        located_rows(located, kind, everything),
        COLUMNS,
        summary=LOCATE,
        provenance=provenance("locate", case, loaded.intake.provenance, **notes),
    )
    for line in told:
        messages.note(line)
    if picture_path is not None:
        from enginediag_cli.presentation.pictures.written import write_drawing

        title = f"{loaded.evidence.engine.name}: where model and recordings differ"
        write_drawing(picture(located, kind, title, told[:3]), picture_path)
    return ExitCode.FINDING if located.mismatch and exit_code else ExitCode.DONE


def _per_record(messages: Messages, case: Case, loaded: Loaded, every: int, output: Output) -> ExitCode:
    """The places with a free amplitude per record, best first."""
    from enginediag_cli.mismatch.fit.freeform import locations_of
    from enginediag_cli.mismatch.fit.identified import nuisance
    from enginediag_cli.mismatch.unrecorded.control_law import held_readings, stop_of
    from enginediag_cli.mismatch.unrecorded.per_record import inlet_temperature, scan, thinned
    from enginediag_cli.mismatch.unrecorded.per_record_effects import alike
    from enginediag_cli.physics.registry import candidates
    from enginediag_cli.presentation.outputs.locate import PER_RECORD as PLACES
    from enginediag_cli.presentation.per_record import COLUMNS, per_record_rows, per_record_sentences

    evidence = thinned(loaded.evidence, every)
    along = nuisance(evidence)
    found = scan(evidence, locations_of(evidence.engine, tuple(evidence.noise.sigma)), along)
    notes = {**PLACES.notes, "map accuracy": f"{evidence.settings.map_accuracy:g}", "per-record": f"{every}"}
    output.write_rows(
        per_record_rows(found),
        COLUMNS,
        summary=PER_RECORD,
        provenance=provenance("locate", case, loaded.intake.provenance, **notes),
    )
    best = found[0]
    if best.location is None or not best.converged:
        messages.error("no verdict: no place with an amplitude of its own in every record could be fitted")
        return ExitCode.NO_VERDICT
    stop = stop_of(best, inlet_temperature(evidence, best))
    acting = alike(evidence, best, list(candidates(evidence.engine)))
    for line in per_record_sentences(found, stop, held_readings(evidence, best, along, stop), acting):
        messages.note(line)
    return ExitCode.DONE
