"""`enginediag fleet`: many engines, from their recordings to a ranking; `status`, `prune` and `merge` of its store."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import click

from enginediag_cli.cli.config import Command, choose_exit_code, command, write_result
from enginediag_cli.cli.options import (
    INPUT,
    OPERATION,
    OUTPUT,
    accept_mismatch_option,
    exit_code_option,
    option,
    options,
    output_options,
)
from enginediag_cli.cli.parameter_types import COUNT, EXISTING, ConfigFile
from enginediag_cli.report.messages import Messages
from enginediag_cli.report.output import Output

if TYPE_CHECKING:
    from enginediag_cli.errors import ExitCode

FOLDER = click.Path(exists=True, file_okay=False)

fleet_arguments = options(
    click.argument("fleet_file", metavar="FLEET.yaml", type=ConfigFile()),
    click.argument("recordings", nargs=-1, metavar="[RECORDING]...", type=EXISTING),
)
store_option = option(INPUT, "--store", metavar="FOLDER", required=True, type=FOLDER, help="Folder of the store.")


@command("List what the store holds of a fleet.")
@fleet_arguments
@store_option
@output_options
def status(messages: Messages, fleet_file: str, recordings: tuple[str, ...], store: str, output: Output) -> None:
    """List which recordings of a fleet are reduced in the store, and which are new.

    \b
    enginediag fleet status fleet.yaml --store kept
    """
    from enginediag_cli.api.fleets import fleet_status

    write_result(fleet_status(fleet_file, store, recordings, messages=messages), output)


@command("Remove from the store what a fleet does not need.")
@fleet_arguments
@store_option
@option(OPERATION, "-n", "--dry-run", is_flag=True, help="Only report what would be removed.")
def prune(messages: Messages, fleet_file: str, recordings: tuple[str, ...], store: str, dry_run: bool) -> None:
    """Remove from the store recordings that the fleet no longer has, or that were reduced with another nominal file or
    other settings, and incomplete files of interrupted runs.

    \b
    enginediag fleet prune fleet.yaml --store kept --dry-run
    """
    from enginediag_cli.api.fleets import prune_store

    prune_store(fleet_file, store, recordings, dry_run=dry_run, messages=messages)


@command("Merge the content of other stores into one.")
@click.argument("into", metavar="STORE", type=click.Path(file_okay=False))
@click.argument("others", metavar="OTHER...", nargs=-1, required=True, type=FOLDER)
def merge(messages: Messages, into: str, others: tuple[str, ...]) -> None:
    """Copy into STORE what only the OTHER stores hold; they remain unchanged.

    \b
    enginediag fleet merge kept from_the_other_machine
    """
    from enginediag_cli.api.fleets import merge_stores

    merge_stores(into, *others, messages=messages)


PARTS: dict[str, click.Command] = {"status": status, "prune": prune, "merge": merge}


class FleetCommand(Command):
    """A command whose first argument may be the name of one of `PARTS`, which then runs instead."""

    def make_context(
        self, info_name: str | None, args: list[str], parent: click.Context | None = None, **extra: Any
    ) -> click.Context:
        """Pass on to a part."""
        if args and args[0] in PARTS:
            return PARTS[args[0]].make_context(f"{info_name} {args[0]}", args[1:], parent, **extra)
        return super().make_context(info_name, args, parent, **extra)


@command(cls=FleetCommand, finding="an engine is flagged, or an instrument stuck or noisy, and --exit-code given")
@fleet_arguments
@accept_mismatch_option
@option(
    OUTPUT,
    "--what",
    type=click.Choice(["engines", "health", "flights"]),
    default="engines",
    show_default=True,
    help="Rows of a table or CSV: engines, worst first; health, one row per engine and parameter; or flights. JSON has "
    "all three.",
)
@option(
    OPERATION,
    "--store",
    metavar="FOLDER",
    type=click.Path(file_okay=False),
    help="Keep reduced recordings in FOLDER. The next run processes only new ones, also after an interruption.",
)
@option(
    OPERATION,
    "--jobs",
    metavar="N",
    type=COUNT,
    help="Number of processes. Default: one per core. The result does not depend on it.",
)
@option(
    OPERATION,
    "--scheduler",
    metavar="ADDRESS",
    default="",
    help="Dask scheduler, such as tcp://host:8786, whose workers see recordings and --store under the same paths. "
    "Needs the extra enginediag[fleet].",
)
@exit_code_option
@output_options
def fleet(
    messages: Messages, fleet_file: str, recordings: tuple[str, ...], exit_code: bool, output: Output, **choices: Any
) -> ExitCode:
    """Judge all engines of a fleet, rank them by severity, and find what is common to them.

    \b
    enginediag fleet fleet.yaml --store kept -o fleet.json
    enginediag fleet fleet.yaml flights/*.csv --what health -o health.csv
    enginediag fleet status fleet.yaml --store kept
    enginediag fleet prune fleet.yaml --store kept
    enginediag fleet merge kept from_the_other_machine

    The fleet file names the recordings (those on the command line replace its patterns), the engines, their healthy
    early life, the maintenance and what to judge; `enginediag schema fleet` has its keys. A common model is identified
    from the early life of some engines, unless a nominal file is named. Each engine is judged relative to its own early
    life.
    """
    from enginediag_cli.api.fleets import fleet as run

    result = run(fleet_file, recordings, messages=messages, **choices)
    result.write(output)
    return choose_exit_code(result.findings, result.judged, exit_code)
