"""`enginediag schema`: the JSON schema of a kind of YAML file, or of what a command writes."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING

import click

from enginediag_cli.cli.options import exit_codes, message_options

if TYPE_CHECKING:
    from click.shell_completion import CompletionItem


def _kinds(context: click.Context, parameter: click.Parameter, incomplete: str) -> list[CompletionItem]:
    from click.shell_completion import CompletionItem

    return [CompletionItem(name, help=help) for name, help in _known() if name.startswith(incomplete)]


def _known() -> Iterator[tuple[str, str]]:
    """Every name that has a schema, and what it is."""
    from enginediag_cli.config.kinds import FILE_KINDS
    from enginediag_cli.report.outputs.registry import OUTPUTS, PREFIX, output

    yield from ((kind.name, kind.help) for kind in FILE_KINDS.values())
    yield from ((f"{PREFIX}{name}", output(name).help) for name in OUTPUTS)


@click.command(short_help="Print the JSON schema of a kind of YAML file, or of an output.", epilog=exit_codes())
@click.argument("kind", required=False, shell_complete=_kinds)
@message_options
def schema(kind: str | None) -> None:
    """Print the JSON schema (draft-07) of a KIND of YAML file, or of what a command writes; without KIND, list them.

    \b
    enginediag schema engine > engine.schema.json
    enginediag schema output/detect > detect.schema.json

    Schemas of outputs describe --format json, and under `csv` the columns of the CSV: name, type, unit, whether a cell
    may be empty. `version` goes up when a column goes or means something else, not when one is added; it stands as
    `schema` in the head of a CSV and in JSON objects.

    An editor with a YAML language server checks and completes a file whose first line is
    # yaml-language-server: $schema=engine.schema.json
    """
    import json

    from enginediag_cli.config.hints import near
    from enginediag_cli.config.json_schema import json_schema
    from enginediag_cli.config.kinds import FILE_KINDS
    from enginediag_cli.report.outputs.registry import OUTPUTS, PREFIX, output

    if kind is None:
        every = dict(_known())
        width = max(map(len, every))
        for name, told in every.items():
            click.echo(f"{name:<{width}}  {told}")
        return
    name = kind.removeprefix(PREFIX)
    if kind.startswith(PREFIX) and name in OUTPUTS:
        click.echo(json.dumps(output(name).schema(), indent=2, ensure_ascii=False))
        return
    if kind not in FILE_KINDS:
        outputs = [f"{PREFIX}{known}" for known in OUTPUTS]
        raise click.UsageError(
            f"no output {kind!r}; {near(kind, outputs)}"
            if kind.startswith(PREFIX)
            else f"no kind of file {kind!r}; {near(kind, [*FILE_KINDS, *outputs])}"
        )
    section = FILE_KINDS[kind].load_section()
    click.echo(json.dumps(json_schema(section, f"enginediag {kind} file"), indent=2, ensure_ascii=False))
