"""`enginediag physics`: the effects that a model may carry or lack, and where they can act."""

from __future__ import annotations

import click

from enginediag_cli.cli.mismatch_options import complete_terms
from enginediag_cli.cli.options import ConfigFile, exit_codes, message_options, output_options
from enginediag_cli.report.output import Output
from enginediag_cli.report.summaries import SITES, TERMS, VARIABLES


@click.command(short_help="Say which physical effects a model may carry or lack.", epilog=exit_codes())
@click.argument("name", required=False, shell_complete=complete_terms)
@click.option(
    "--engine",
    "engine_path",
    metavar="ENGINE.yaml",
    type=ConfigFile(),
    help="Where the effects can act on this engine, and which of them its model carries.",
)
@click.option(
    "--variables", is_flag=True, help="Rather list what a `law:` of this engine may vary with. Goes with --engine."
)
@output_options
@message_options
def physics(name: str | None, engine_path: str | None, variables: bool, output: Output) -> None:
    """Show the physics term NAME: what it is, its equation, coefficients, places and reference; or list them all.

    \b
    enginediag physics
    enginediag physics reynolds_efficiency
    enginediag physics --engine turbofan.yaml
    enginediag physics --engine turbofan.yaml --variables

    Without --engine, NAME is shown with its places on the engines that come with the program; with it, NAME may be a
    law of the engine's own. As csv, NAME is one row for each coefficient, and with --engine one for each place; json
    holds everything.
    """
    from enginediag_cli.api.files import describe_effect, list_effects, list_law_variables

    whole = output.chosen_format() != "table" or output.wide or bool(output.columns)
    if variables:
        if engine_path is None or name is not None:
            raise click.UsageError("--variables goes with --engine, and without NAME")
        listed = list_law_variables(engine_path)
        output.write_rows(listed.rows, VARIABLES, provenance=listed.provenance)
    elif name is None:
        listed = list_effects(engine_path)
        # sentences and equations have no room in a table
        columns = None if whole else SITES if engine_path else TERMS
        output.write_rows(listed.rows, columns, provenance=listed.provenance)
    else:
        found = describe_effect(name, engine_path)
        if whole:
            found.write(output)
        else:
            output.write_text(found.page)
