"""`enginediag man`: the manual page of the program or of a command, made from what --help says."""

from __future__ import annotations

from typing import TYPE_CHECKING

import click

from enginediag_cli.cli.options import exit_codes, message_options

if TYPE_CHECKING:
    from click.shell_completion import CompletionItem


def _commands(context: click.Context, parameter: click.Parameter, incomplete: str) -> list[CompletionItem]:
    from click.shell_completion import CompletionItem

    from enginediag_cli.cli.main import COMMANDS

    return [CompletionItem(name, help=entry.help) for name, entry in COMMANDS.items() if name.startswith(incomplete)]


@click.command(short_help="Print a manual page.", epilog=exit_codes())
@click.argument("command", required=False, shell_complete=_commands)
@message_options
def man(command: str | None) -> None:
    """Print the manual page (roff) of COMMAND, or of the whole program.

    \b
    enginediag man detect | man -l -
    enginediag man > ~/.local/share/man/man1/enginediag.1
    """
    from enginediag_cli.cli.main import COMMANDS, enginediag
    from enginediag_cli.report.reference import command_page, program_page

    group = click.Context(enginediag, info_name="enginediag")
    if command is None:
        click.echo(program_page(group, {name: entry.help for name, entry in COMMANDS.items()}), nl=False)
        return
    found = enginediag.get_command(group, command)
    if found is None:
        from enginediag_cli.config.hints import near

        raise click.UsageError(f"no such command {command!r}; {near(command, COMMANDS)}")
    click.echo(command_page(click.Context(found, info_name=command, parent=group)), nl=False)
