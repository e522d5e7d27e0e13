"""Physics terms as rows, and one term as a page that an engineer reads."""

from __future__ import annotations

import textwrap
from collections.abc import Iterator, Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from enginediag_cli.engine.moving.tape import MOMENT
from enginediag_cli.physics.laws.variables import variables_of
from enginediag_cli.presentation.numbers import with_unit

if TYPE_CHECKING:
    from enginediag_cli.engine.engine import Engine
    from enginediag_cli.engine.network import Network
    from enginediag_cli.engine.term import Coefficient, Site, Term

WIDTH = 100
"""Letters of a line of text and of the labels before it."""
LABEL = 14
"""Letters that are kept for the labels."""
ASSUMED = "range assumed: engineering judgement, not read in a source"
MEMORY = "the past of each record, by its column time_s; a record without one is taken as steady"
SWITCH = "commanded: may be on or off while no recorded column shows it"

Carried = Mapping[str, Mapping[str, Any]]
"""By label `term@site`: the block of the engine file with coefficients, standard errors and source."""


def term_row(term: Term) -> dict[str, Any]:
    """One term of the list."""
    return {
        "term": term.NAME,
        "title": term.TITLE,
        "driver": term.DRIVER.word,
        "varies_with": term.varies_with(),
        "coefficients": [c.name for c in term.COEFFICIENTS],
        "assumed": [c.name for c in term.COEFFICIENTS if c.assumed],
        "columns": list(term.INPUTS),
        "switches": term.SWITCHES,
        "statement": term.STATEMENT,
        "equation": term.EQUATION,
        "reference": term.REFERENCE,
    }


def coefficient_rows(term: Term) -> Iterator[dict[str, Any]]:
    """One row for each coefficient of a term."""
    for c in term.COEFFICIENTS:
        yield {
            "term": term.NAME,
            "coefficient": c.name,
            "unit": c.unit,
            "absent": c.absent,
            "lower": c.lower,
            "upper": c.upper,
            "typical": c.typical,
            "prior_sigma": c.sigma,
            "sought": not c.shape,
            "assumed": c.assumed,
            "description": c.description,
        }


def site_row(term: Term, site: Site, carried: Carried) -> dict[str, Any]:
    """Where a term can act on one engine, and what the engine's model carries there."""
    block = carried.get(f"{term.NAME}@{site.name}")
    return {
        "term": term.NAME,
        "at": site.name,
        "component": site.component,
        "acts_on": list(site.acts_on),
        "driver": term.DRIVER.word,
        "carried": block is not None,
        "coefficients": dict(block["coefficients"]) if block else {},
        "standard_errors": dict(block["standard_errors"]) if block else {},
        "source": block["source"] if block else "",
    }


def carried_blocks(engine: Engine) -> dict[str, Mapping[str, Any]]:
    """What the engine file says of each effect that it carries, by label."""
    found: dict[str, Mapping[str, Any]] = {}
    for block in engine.declared["physics"]:
        if "law" in block:
            declared = block["coefficients"]
            values = {name: c["value"] for name, c in declared.items()}
            errors = {name: c["standard_error"] for name, c in declared.items() if c["standard_error"] is not None}
            told = {"coefficients": values, "standard_errors": errors, "source": block["source"]}
            found[f"{block['law']}@{block['at']}"] = told
        else:
            found[f"{block['term']}@{block['at']}"] = block
    return found


def variable_rows(network: Network) -> Iterator[dict[str, Any]]:
    """What a law of an engine may vary with, and what that is at the engine's design point."""
    for v in variables_of(network).values():
        unit = v.driver.unit if v.recorded else "ratio to the design point"
        yield {"variable": v.name, "at_design": v.reference, "unit": unit, "words": v.words}


def page(term: Term, places: Mapping[str, Sequence[Site]], carried: Mapping[str, Carried]) -> str:
    """The term for a reader; `places` are its sites by the name of the engine, `carried` what each engine carries."""
    lines = [f"{term.NAME}: {term.TITLE}", "", *textwrap.wrap(term.STATEMENT, WIDTH), ""]
    lines += _labelled("equation", term.EQUATION)
    lines += _labelled("varies with", term.varies_with())
    if term.SWITCHES:
        lines += _labelled("switch", SWITCH)
    for column, default in term.INPUTS.items():
        reads = f"column {column}; {default:g} where it is not recorded"
        lines += _labelled("reads", MEMORY if column == MOMENT else reads)
    lines += _labelled("reference", term.REFERENCE)
    lines += ["", "coefficients"]
    for c in term.COEFFICIENTS:
        lines += _indented(f"{c.name} [{c.unit}]: {c.description}", 2)
        for text in _facts(c):
            lines += _indented(text, 4)
    lines += ["", "places"]
    for engine, sites in places.items():
        lines += _sites(engine, sites, term, carried[engine])
    example = next((s.name for sites in places.values() for s in sites if not term.OF_A_FILE), None)
    if example:
        values = ", ".join(f"{c.name}: {c.typical:g}" for c in term.amplitudes())
        lines += [
            "",
            "in an engine file",
            "  physics:",
            f"    - {{term: {term.NAME}, at: {example}, coefficients: {{{values}}}}}",
        ]
    return "\n".join(lines) + "\n"


def _labelled(label: str, text: str) -> list[str]:
    # spaces inside an equation are its own: they are not a place to fold at unless it is too long
    return textwrap.wrap(
        text, WIDTH, initial_indent=label.ljust(LABEL), subsequent_indent=" " * LABEL, break_on_hyphens=False
    )


def _indented(text: str, by: int) -> list[str]:
    return textwrap.wrap(text, WIDTH, initial_indent=" " * by, subsequent_indent=" " * (by + 2), break_on_hyphens=False)


def _facts(c: Coefficient) -> Iterator[str]:
    within = f"within {c.lower:g} to {c.upper:g}" if np.isfinite([c.lower, c.upper]).any() else "without bounds"
    if c.free:
        yield f"{c.absent:g} unless the engine file says otherwise, {within}; sought with the others"
    elif c.shape:
        yield f"{c.absent:g} unless the engine file says otherwise, {within}; not sought"
    else:
        yield f"absent at {c.absent:g}, typically {c.typical:g}, {within}; prior standard deviation {c.sigma:g}"
    if c.assumed:
        yield ASSUMED


def _sites(engine: str, sites: Sequence[Site], term: Term, carried: Carried) -> Iterator[str]:
    if not sites:
        yield f"  {engine}: none"
        return
    names = [_site(site, carried.get(f"{term.NAME}@{site.name}")) for site in sites]
    yield from _indented(f"{engine}: {', '.join(names)}", 2)


def _site(site: Site, block: Mapping[str, Any] | None) -> str:
    """ "hpc (hpc.efficiency)", with the coefficients that the engine carries there."""
    text = f"{site.name} ({' and '.join(site.acts_on)})"
    if block is None:
        return text
    errors = block["standard_errors"]
    sizes = [f"{name} {with_unit(value, '', errors.get(name))}" for name, value in block["coefficients"].items()]
    return f"{text} carried: {' and '.join(sizes) or 'absent'}"
