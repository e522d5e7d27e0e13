"""`enginediag schema`: the JSON schema of a kind of YAML file."""

from __future__ import annotations

from typing import TYPE_CHECKING

import click

from enginediag_cli.commands.options import exit_codes, message_options

if TYPE_CHECKING:
    from click.shell_completion import CompletionItem


def _kinds(context: click.Context, parameter: click.Parameter, incomplete: str) -> list[CompletionItem]:
    from click.shell_completion import CompletionItem

    from enginediag_cli.config.kinds import FILE_KINDS

    return [
        CompletionItem(kind.name, help=kind.help) for kind in FILE_KINDS.values() if kind.name.startswith(incomplete)
    ]


@click.command(short_help="Print the JSON schema of a kind of YAML file, for editors.", epilog=exit_codes())
@click.argument("kind", required=False, shell_complete=_kinds)
@message_options
def schema(kind: str | None) -> None:
    """Print the JSON schema (draft-07) of a KIND of YAML file; without KIND, list the kinds.

    \b
    enginediag schema engine > engine.schema.json

    An editor with a YAML language server checks and completes a file whose first line is
    # yaml-language-server: $schema=engine.schema.json
    """
    import json

    from enginediag_cli.config.hints import near
    from enginediag_cli.config.json_schema import json_schema
    from enginediag_cli.config.kinds import FILE_KINDS

    if kind is None:
        width = max(map(len, FILE_KINDS))
        for known in FILE_KINDS.values():
            click.echo(f"{known.name:<{width}}  {known.help}")
        return
    if kind not in FILE_KINDS:
        raise click.UsageError(f"no kind of file {kind!r}; {near(kind, FILE_KINDS)}")
    section = FILE_KINDS[kind].load_section()
    click.echo(json.dumps(json_schema(section, f"enginediag {kind} file"), indent=2, ensure_ascii=False))
