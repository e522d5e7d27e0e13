"""`enginediag fleet`: many engines, from their recordings to a ranking; and the store in which work is kept."""

from __future__ import annotations

from typing import TYPE_CHECKING

import click

from enginediag_cli.cli.fleet_store import WithParts, fleet_recordings
from enginediag_cli.cli.intake_options import accept_mismatch_option
from enginediag_cli.cli.judging import ending
from enginediag_cli.cli.options import (
    ConfigFile,
    exit_code_option,
    exit_codes,
    message_options,
    output_options,
    pass_messages,
)
from enginediag_cli.report.messages import Messages
from enginediag_cli.report.output import Output

if TYPE_CHECKING:
    from enginediag_cli.errors import ExitCode


@click.command(
    cls=WithParts,
    short_help="Judge the engines of a fleet, rank them, and say what is common.",
    epilog=exit_codes(finding="an engine is listed, or an instrument stuck or noisy, and --exit-code given"),
)
@click.argument("fleet_file", metavar="FLEET.yaml", type=ConfigFile())
@fleet_recordings
@click.option(
    "--jobs",
    metavar="N",
    type=click.IntRange(min=1),
    help="Processes to work with; one per core when not given. The result does not depend on it.",
)
@click.option(
    "--scheduler",
    metavar="ADDRESS",
    help="Work on the Dask cluster of this scheduler, such as tcp://host:8786, whose workers see recordings and "
    "--store under the same paths. Needs `pip install 'enginediag[fleet]'`.",
)
@click.option(
    "--store",
    "store_folder",
    metavar="FOLDER",
    type=click.Path(file_okay=False),
    help="Keep what recordings come to in FOLDER, so that the next run does only what is new, also after this one was "
    "killed. Without it, it is thrown away in the end.",
)
@click.option(
    "--what",
    type=click.Choice(["engines", "health", "flights"]),
    default="engines",
    show_default=True,
    help="Rows of a table or CSV: engines, worst first; their health, one row per parameter; their flights. JSON holds "
    "all of it.",
)
@accept_mismatch_option
@exit_code_option
@output_options
@message_options
@pass_messages
def fleet(
    messages: Messages,
    fleet_file: str,
    recordings: tuple[str, ...],
    jobs: int | None,
    scheduler: str | None,
    store_folder: str | None,
    what: str,
    accept_mismatch: bool,
    exit_code: bool,
    output: Output,
) -> ExitCode:
    """Judge all engines of a fleet, rank them by severity, and say what is common to them.

    \b
    enginediag fleet fleet.yaml --store kept -o fleet.json
    enginediag fleet fleet.yaml flights/*.csv --what health -o health.csv
    enginediag fleet status fleet.yaml --store kept
    enginediag fleet prune fleet.yaml --store kept
    enginediag fleet merge kept from_the_other_machine

    The fleet file says which recordings there are (those on the command line stand in place of its patterns), how
    engines are told apart, what of their early life is healthy, what maintenance was done, and what to judge;
    `enginediag schema fleet` has its keys. A model is identified from the early life of some engines, unless a
    nominal file is named; each engine is judged against its own early life.
    """
    from enginediag_cli.api.fleets import fleet as run

    result = run(
        fleet_file,
        recordings,
        what=what,
        jobs=jobs,
        scheduler=scheduler or "",
        store=store_folder,
        accept_mismatch=accept_mismatch,
        messages=messages,
    )
    result.write(output)
    return ending(result.found, result.judged, exit_code)
