"""`enginediag fleet`: many engines, from their recordings to a ranking; and the store in which work is kept."""

from __future__ import annotations

from typing import TYPE_CHECKING

import click

from enginediag_cli.commands.fleet_store import WithParts, fleet_recordings
from enginediag_cli.commands.intake_options import accept_mismatch_option
from enginediag_cli.commands.options import (
    ConfigFile,
    exit_code_option,
    exit_codes,
    message_options,
    output_options,
    pass_messages,
)
from enginediag_cli.presentation.messages import Messages
from enginediag_cli.presentation.output import Output

if TYPE_CHECKING:
    from enginediag_cli.errors import ExitCode

WHAT = ("engines", "health", "flights")


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
    type=click.Choice(WHAT),
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
    if jobs and scheduler:
        raise click.UsageError("--jobs and --scheduler exclude each other: the cluster has its own workers")
    if scheduler and not store_folder:
        raise click.UsageError("--scheduler needs --store, a folder that the workers share")
    import os
    from dataclasses import replace

    from enginediag_cli.errors import ExitCode
    from enginediag_cli.fleets.fleet import load_fleet
    from enginediag_cli.fleets.recordings import recordings_of
    from enginediag_cli.fleets.run import run_fleet
    from enginediag_cli.fleets.runners.places import runner_for
    from enginediag_cli.fleets.store import opened_store
    from enginediag_cli.presentation.fleet_rows import ROWS, document, tell_models, tell_result
    from enginediag_cli.presentation.summaries import FLEET
    from enginediag_cli.recordings.provenance import header_lines

    described = replace(load_fleet(fleet_file), accept_mismatch=accept_mismatch)
    found = recordings_of(described, recordings)
    with opened_store(store_folder) as store, runner_for(jobs or os.cpu_count() or 1, scheduler or "") as runner:
        result = run_fleet(described, found, store, runner)
    tell_models(messages, result)
    head = header_lines("fleet", configs=[fleet_file, *described.configs])
    rows = list(ROWS[what](result))
    summary = FLEET if what == "engines" else ()
    output.write_document(lambda: document(result, head), rows, summary=summary, provenance=head)
    tell_result(messages, result)
    if not any(x.verdict != "no verdict" for x in result.finding.engines):
        return ExitCode.NO_VERDICT
    listed = result.finding.discoveries.engines or any(x.instruments for x in result.finding.engines)
    return ExitCode.FINDING if exit_code and listed else ExitCode.DONE
