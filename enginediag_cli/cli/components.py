"""`enginediag components`: the parts of which an engine file is made, and their keys."""

from __future__ import annotations

from typing import TYPE_CHECKING

import click

from enginediag_cli.cli.options import exit_codes, message_options, output_options
from enginediag_cli.report.output import Output

if TYPE_CHECKING:
    from click.shell_completion import CompletionItem

LIST_COLUMNS = ("component", "title", "unknowns")


def _complete(context: click.Context, parameter: click.Parameter, incomplete: str) -> list[CompletionItem]:
    from click.shell_completion import CompletionItem

    from enginediag_cli.api.files import component_names

    return [CompletionItem(name) for name in component_names() if name.startswith(incomplete)]


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

    from enginediag_cli.api.files import describe_component, list_components

    form = output.chosen_format()
    if name is None:
        listed = list_components()
        output.write_rows(listed.rows, LIST_COLUMNS if form == "table" else None, provenance=listed.provenance)
        return
    found = describe_component(name)
    if form == "table":
        output.write_text(found.page)
    elif form == "json":
        output.write_text(json.dumps(found.document, indent=1, ensure_ascii=False) + "\n")
    else:
        output.write_rows(found.rows, provenance=found.provenance)
