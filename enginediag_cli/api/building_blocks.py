"""What an engine file is made of: physical effects, what a law may vary with, and component types."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import TYPE_CHECKING, Any

from enginediag_cli.api.inputs import EngineLike, as_engine, load_engine
from enginediag_cli.api.results import DocumentResult, Result, Row
from enginediag_cli.errors import UsageError

if TYPE_CHECKING:
    from enginediag_cli.engine.engine import Engine
    from enginediag_cli.engine.term import Site, Term


class Listing(Result):
    """What there is of a kind, a row each."""

    def __init__(self, rows: Sequence[Row], head: Sequence[str]):
        self._listed = rows
        super().__init__(head=lambda: tuple(head))

    def _compute(self) -> Iterator[Row]:
        yield from self._listed


class Description(DocumentResult):
    """One thing as a page, as rows and as one document.

    Attributes
    ----------
    page : str
        For a reader.
    document : dict
        Everything that is known of it; `to_dict` has it for ``json.dump``.
    """

    def __init__(self, page: str, document: dict[str, Any], rows: Sequence[Row], head: Sequence[str]):
        self.page, self.document, self._listed = page, document, rows
        super().__init__(head=lambda: tuple(head))

    def _compute(self) -> Iterator[Row]:
        yield from self._listed

    def _document(self, provenance: Sequence[str]) -> Mapping[str, Any]:
        return self.document

    def summary(self) -> str:
        """The page."""
        return self.page


def list_effects(engine: EngineLike | None = None) -> Listing:
    """List the physical effects that a model may carry or lack.

    Parameters
    ----------
    engine : str, Path or Engine, optional
        Gives a row for each place where one can act on this engine, and what its model carries there; without it, a row
        for each effect.

    Returns
    -------
    Listing

    Raises
    ------
    ConfigError, DataError
    """
    from enginediag_cli.physics.registry import term, term_names
    from enginediag_cli.report.reference_pages import carried_blocks, site_row, term_row

    terms = [term(name) for name in term_names()]
    if engine is None:
        return Listing([term_row(t) for t in terms], _head("physics"))
    model = as_engine(engine)
    carried = carried_blocks(model)
    rows = [site_row(t, site, carried) for t in [*terms, *_laws(model)] for site in t.sites(model.network)]
    return Listing(rows, _head("physics", model))


def describe_effect(name: str, engine: EngineLike | None = None) -> Description:
    """Describe one physical effect: what it is, its equation, coefficients, places and reference.

    Parameters
    ----------
    name : str
        As `list_effects` has it; with `engine`, a law of the engine's own, too.
    engine : str, Path or Engine, optional
        Its places on this engine, a row each; without it, rows are its coefficients, and places those on the engines
        that come with enginediag.

    Returns
    -------
    Description

    Raises
    ------
    UsageError
        For an effect that is not there; names the nearest.
    ConfigError, DataError
    """
    from enginediag_cli.physics.registry import term, term_names
    from enginediag_cli.report.reference_pages import (
        carried_blocks,
        coefficient_rows,
        physics_page,
        site_row,
        term_row,
    )

    model = None if engine is None else as_engine(engine)
    laws = {law.NAME: law for law in (_laws(model) if model is not None else ())}
    if name not in term_names() and name not in laws:
        from enginediag_cli.config.hints import near

        raise UsageError(f"no physics term {name!r}; {near(name, [*term_names(), *laws])}")
    engines = {model.name: model} if model is not None else _shipped_engines()
    shown: Term = laws[name] if name in laws else term(name)
    places: dict[str, list[Site]] = {n: list(shown.sites(e.network)) for n, e in engines.items()}
    carried = {n: carried_blocks(e) for n, e in engines.items()}
    sites = {n: [site_row(shown, s, carried[n]) for s in found] for n, found in places.items()}
    coefficients = list(coefficient_rows(shown))
    document = {**term_row(shown), "coefficients": coefficients, "places": sites}
    rows = coefficients if model is None else [row for found in sites.values() for row in found]
    return Description(physics_page(shown, places, carried), document, rows, _head("physics", model))


def list_law_variables(engine: EngineLike) -> Listing:
    """List what a ``law:`` of an engine may vary with, and its value at the design point.

    Parameters
    ----------
    engine : str, Path or Engine
        Engine YAML, or a loaded engine.

    Returns
    -------
    Listing

    Raises
    ------
    ConfigError, DataError
    """
    from enginediag_cli.report.reference_pages import variable_rows

    model = as_engine(engine)
    return Listing(list(variable_rows(model.network)), _head("physics", model))


def component_names() -> tuple[str, ...]:
    """Names of the component types."""
    from enginediag_cli.engine.components import COMPONENTS

    return tuple(COMPONENTS)


def list_components() -> Listing:
    """List the component types of which an engine file is made: keys, unknowns, balances, outputs.

    Returns
    -------
    Listing
    """
    from enginediag_cli.engine.components import COMPONENTS
    from enginediag_cli.engine.example import shown
    from enginediag_cli.report.reference_pages import component_row

    rows = [component_row(kind, shown(name)) for name, kind in COMPONENTS.items()]
    return Listing(rows, _head("components"))


def describe_component(name: str) -> Description:
    """Describe one component type: what it computes, its keys (rows), parameters and columns, with an example.

    Parameters
    ----------
    name : str
        As `list_components` has it.

    Returns
    -------
    Description

    Raises
    ------
    UsageError
        For a type that is not there; names the nearest.
    """
    from enginediag_cli.engine.components import COMPONENTS
    from enginediag_cli.engine.example import shown
    from enginediag_cli.report.reference_pages import component_row, key_rows, page, parameter_rows

    if name not in COMPONENTS:
        from enginediag_cli.config.hints import near

        raise UsageError(f"no component {name!r}; {near(name, COMPONENTS)}")
    kind, found = COMPONENTS[name], shown(name)
    keys = list(key_rows(kind))
    parts = {"keys": keys, "parameters": list(parameter_rows(found)), "example": found.text}
    return Description(page(kind, found), {**component_row(kind, found), **parts}, keys, _head("components"))


def _head(command: str, engine: Engine | None = None) -> tuple[str, ...]:
    from enginediag_cli.recordings.provenance import header_lines

    return header_lines(command, configs=[] if engine is None else [engine.path])


def _shipped_engines() -> Mapping[str, Engine]:
    """Engines that come with enginediag, by name."""
    from enginediag_cli.shipped import shipped_folder

    files = (p for p in sorted(shipped_folder().glob("*.yaml")) if "\nkind: engine" in p.read_text(encoding="utf-8"))
    return {engine.name: engine for engine in map(load_engine, files)}


def _laws(engine: Engine) -> list[Term]:
    """What of an engine's effects its own file states."""
    from enginediag_cli.physics.laws.law import Law

    return [e.term for e in engine.effects if isinstance(e.term, Law)]
