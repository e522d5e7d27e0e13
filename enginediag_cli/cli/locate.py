"""`enginediag locate`: whether model and recordings differ, and where: location × driver."""

from __future__ import annotations

from typing import TYPE_CHECKING

import click

from enginediag_cli.cli.judging import ending, write_result
from enginediag_cli.cli.mismatch_options import Searched, mismatch_options
from enginediag_cli.cli.options import (
    exit_code_option,
    exit_codes,
    jobs_option,
    message_options,
    output_options,
    pass_messages,
)
from enginediag_cli.cli.picture_option import picture_option
from enginediag_cli.report.messages import Messages
from enginediag_cli.report.output import Output

if TYPE_CHECKING:
    from enginediag_cli.errors import ExitCode


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
    searched: Searched,
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
    from enginediag_cli.api import discrepancy

    if every is None:
        located = discrepancy.locate(
            searched.engine, searched.source, every_place=everything, messages=messages, **searched.arguments
        )
        if located.converged:
            write_result(located, output, picture_path)
        return ending(located.found, located.judged, exit_code)
    if everything or picture_path:
        raise click.UsageError("--all and --picture are of the map, and --per-record writes none")
    found = discrepancy.locate_per_record(
        searched.engine, searched.source, every=every, messages=messages, **searched.arguments
    )
    write_result(found, output)
    return ending(0, found.judged, False)
