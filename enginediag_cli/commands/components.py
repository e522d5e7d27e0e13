"""`enginediag components`: the parts of which an engine file is made, and their keys."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import click

from enginediag_cli.commands.options import exit_codes, message_options, output_options
from enginediag_cli.presentation.output import Output

if TYPE_CHECKING:
    from click.shell_completion import CompletionItem

LIST_COLUMNS = ("component", "title", "unknowns")


def _complete(context: click.Context, parameter: click.Parameter, incomplete: str) -> list[CompletionItem]:
    from click.shell_completion import CompletionItem

    from enginediag_cli.engine.components import COMPONENTS

    return [CompletionItem(name) for name in COMPONENTS if name.startswith(incomplete)]


@click.command(short_help="Say of which components an engine file is made.", epilog=exit_codes())
@click.argument("name", required=False, shell_complete=_complete)
@output_options
@message_options
def components(name: str | None, output: Output) -> None:
    """Show the component type NAME: what it computes, its keys, parameters and columns, an example; or list them all.

    \b
    enginediag components
    enginediag components turbine

    Parameters, unknowns, balances and columns bear the names that they have in the example. As csv, NAME is one row
    for each key; json holds everything.
    """
    import json

    from enginediag_cli.engine.components import COMPONENTS
    from enginediag_cli.engine.example import shown
    from enginediag_cli.presentation.components import component_row, key_rows, page, parameter_rows
    from enginediag_cli.recordings.provenance import header_lines

    form, head = output.chosen_format(), header_lines("components")
    if name is None:
        rows = [component_row(kind, shown(t)) for t, kind in COMPONENTS.items()]
        output.write_rows(rows, LIST_COLUMNS if form == "table" else None, provenance=head)
        return
    if name not in COMPONENTS:
        from enginediag_cli.config.hints import near

        raise click.UsageError(f"no component {name!r}; {near(name, COMPONENTS)}")
    kind, found = COMPONENTS[name], shown(name)
    if form == "table":
        output.write_text(page(kind, found))
    elif form == "json":
        document: dict[str, Any] = component_row(kind, found)
        document |= {"keys": list(key_rows(kind)), "parameters": list(parameter_rows(found)), "example": found.text}
        output.write_text(json.dumps(document, indent=1, ensure_ascii=False) + "\n")
    else:
        output.write_rows(key_rows(kind), provenance=head)
