"""`enginediag physics`: the effects that a model may carry or lack, and where they can act."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import click

from enginediag_cli.commands.mismatch_options import complete_terms
from enginediag_cli.commands.options import ConfigFile, exit_codes, message_options, output_options
from enginediag_cli.presentation.output import Output
from enginediag_cli.presentation.summaries import SITES, TERMS, VARIABLES

if TYPE_CHECKING:
    from enginediag_cli.engine.engine import Engine
    from enginediag_cli.engine.term import Site, Term


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
    from enginediag_cli.physics.registry import term, term_names
    from enginediag_cli.recordings.provenance import header_lines

    if variables and (engine_path is None or name is not None):
        raise click.UsageError("--variables goes with --engine, and without NAME")
    engines = _engines(engine_path) if name or engine_path else {}
    laws = {law.NAME: law for engine in engines.values() for law in _laws(engine)} if engine_path else {}
    if name is not None and name not in term_names() and name not in laws:
        from enginediag_cli.config.hints import near

        raise click.UsageError(f"no physics term {name!r}; {near(name, [*term_names(), *laws])}")
    head = header_lines("physics", configs=[engine_path] if engine_path else [])
    if variables:
        from enginediag_cli.presentation.physics_terms import variable_rows

        [engine] = engines.values()
        output.write_rows(list(variable_rows(engine.network)), VARIABLES, provenance=head)
    elif name is not None:
        _one(laws[name] if name in laws else term(name), engines, bool(engine_path), head, output)
    else:
        _all([term(n) for n in term_names()], engines, head, output)


def _engines(path: str | None) -> dict[str, Engine]:
    """By name, the engine of the file, or those that come with the program."""
    from enginediag_cli.physics.engine_file import load_engine
    from enginediag_cli.shipped import shipped_folder

    shipped = (p for p in sorted(shipped_folder().glob("*.yaml")) if "\nkind: engine" in p.read_text(encoding="utf-8"))
    loaded = [load_engine(p) for p in ([path] if path else shipped)]
    return {engine.name: engine for engine in loaded}


def _all(terms: Sequence[Term], engines: Mapping[str, Engine], head: Sequence[str], output: Output) -> None:
    """Every term; or, with an engine, every place where one can act on it."""
    from enginediag_cli.presentation.physics_terms import carried_blocks, site_row, term_row

    if not engines:
        rows = [term_row(t) for t in terms]
        output.write_rows(rows, None if _all_columns(output) else TERMS, provenance=head)
        return
    [engine] = engines.values()
    carried = carried_blocks(engine)
    terms = [*terms, *_laws(engine)]
    rows = [site_row(t, site, carried) for t in terms for site in t.sites(engine.network)]
    output.write_rows(rows, None if _all_columns(output) else SITES, provenance=head)


def _all_columns(output: Output) -> bool:
    """Whether all that is known of a term is written: sentences and equations have no room in a table."""
    return output.chosen_format() != "table" or output.wide or bool(output.columns)


def _one(shown: Term, engines: Mapping[str, Engine], of_one_engine: bool, head: Sequence[str], output: Output) -> None:
    """One term, as a page, as rows, or as one JSON object."""

    from enginediag_cli.presentation.physics_terms import (
        carried_blocks,
        coefficient_rows,
        page,
        site_row,
        term_row,
    )

    places: dict[str, list[Site]] = {n: list(shown.sites(e.network)) for n, e in engines.items()}
    carried = {n: carried_blocks(e) for n, e in engines.items()}
    sites = {n: [site_row(shown, s, carried[n]) for s in found] for n, found in places.items()}
    if output.chosen_format() == "table" and not (output.wide or output.columns):
        output.write_text(page(shown, places, carried))
        return
    document: dict[str, Any] = term_row(shown)
    document |= {"coefficients": list(coefficient_rows(shown)), "places": sites}
    rows = [row for rows in sites.values() for row in rows] if of_one_engine else list(coefficient_rows(shown))
    output.write_document(document, rows, provenance=head)


def _laws(engine: Engine) -> list[Term]:
    """What of an engine's effects its own file states."""
    from enginediag_cli.physics.laws.law import Law

    return [e.term for e in engine.effects if isinstance(e.term, Law)]
