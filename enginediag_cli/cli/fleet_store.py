"""`enginediag fleet status`, `prune` and `merge`: what the store of a fleet holds."""

from __future__ import annotations

from typing import Any

import click

from enginediag_cli.cli.judging import write_result
from enginediag_cli.cli.options import ConfigFile, exit_codes, message_options, output_options, pass_messages
from enginediag_cli.report.messages import Messages
from enginediag_cli.report.output import Output

fleet_recordings = click.argument(
    "recordings", nargs=-1, metavar="[RECORDING]...", type=click.Path(exists=True, dir_okay=False, readable=True)
)
_store = click.option(
    "--store",
    "store_folder",
    metavar="FOLDER",
    required=True,
    type=click.Path(exists=True, file_okay=False),
    help="The store.",
)


@click.command(short_help="Say what the store holds of a fleet.", epilog=exit_codes())
@click.argument("fleet_file", metavar="FLEET.yaml", type=ConfigFile())
@fleet_recordings
@_store
@output_options
@message_options
@pass_messages
def status(messages: Messages, fleet_file: str, recordings: tuple[str, ...], store_folder: str, output: Output) -> None:
    """Say which recordings of a fleet are condensed in the store, and which are new.

    \b
    enginediag fleet status fleet.yaml --store kept
    """
    from enginediag_cli.api.fleets import fleet_status

    write_result(fleet_status(fleet_file, store_folder, recordings, messages=messages), output)


@click.command(short_help="Remove from the store what a fleet does not need.", epilog=exit_codes())
@click.argument("fleet_file", metavar="FLEET.yaml", type=ConfigFile())
@fleet_recordings
@_store
@click.option("-n", "--dry-run", is_flag=True, help="Say what would be removed, and remove nothing.")
@message_options
@pass_messages
def prune(messages: Messages, fleet_file: str, recordings: tuple[str, ...], store_folder: str, dry_run: bool) -> None:
    """Remove from the store recordings that the fleet does not have (any more), or that were condensed by another
    nominal file or other settings, and what killed runs have left half-written.

    \b
    enginediag fleet prune fleet.yaml --store kept --dry-run
    """
    from enginediag_cli.api.fleets import prune_store

    prune_store(fleet_file, store_folder, recordings, dry_run=dry_run, messages=messages)


@click.command(short_help="Put the content of one store into another.", epilog=exit_codes())
@click.argument("into", metavar="STORE", type=click.Path(file_okay=False))
@click.argument("others", metavar="OTHER...", nargs=-1, required=True, type=click.Path(exists=True, file_okay=False))
@message_options
@pass_messages
def merge(messages: Messages, into: str, others: tuple[str, ...]) -> None:
    """Put into STORE what the OTHER stores hold and it does not; those stay as they are.

    \b
    enginediag fleet merge kept from_the_other_machine
    """
    from enginediag_cli.api.fleets import merge_stores

    merge_stores(into, *others, messages=messages)


PARTS: dict[str, click.Command] = {"status": status, "prune": prune, "merge": merge}


class WithParts(click.Command):
    """A command whose first argument may be the name of one of `PARTS`, which then runs instead."""

    def make_context(
        self, info_name: str | None, args: list[str], parent: click.Context | None = None, **extra: Any
    ) -> click.Context:
        if args and args[0] in PARTS:
            from enginediag_cli.cli.general import equip

            part = equip(PARTS[args[0]], f"{info_name}_{args[0]}")
            return part.make_context(f"{info_name} {args[0]}", args[1:], parent=parent, **extra)
        return super().make_context(info_name, args, parent=parent, **extra)
