"""Reference pages, made from the declarations: component types and physics terms, and the manual pages of commands.

Manual pages are in roff (man(7) macros), from click's declarations: the same text as the help.
"""

from __future__ import annotations

import inspect
import re
import textwrap
from collections.abc import Iterator, Mapping, Sequence
from typing import TYPE_CHECKING, Any

import click
import numpy as np

from enginediag_cli import __version__
from enginediag_cli.config.fields import Field, Section
from enginediag_cli.engine.recall import MOMENT
from enginediag_cli.physics.law import formula_variables
from enginediag_cli.report.sentences import format_quantity

if TYPE_CHECKING:
    from enginediag_cli.engine.components import Actuator, Component
    from enginediag_cli.engine.engine import Engine
    from enginediag_cli.engine.network import Network
    from enginediag_cli.engine.overview import ComponentExample
    from enginediag_cli.engine.term import Coefficient, Site, Term
    from enginediag_cli.parameters import Parameter


TERMS_COLUMNS = ("term", "title", "varies_with")
VARIABLES_COLUMNS = ("variable", "at_design", "unit", "words")
SITES_COLUMNS = ("term", "at", "acts_on", "carried", "coefficients")
"""Columns that a narrow terminal shows of physics terms, of variables of formulas, and of places."""
WIDTH = 100
"""Letters of a line of text and of the labels before it."""
LABEL = 14
"""Letters that are kept for the labels."""

PARAMETER_FAMILIES = (
    ("health", "health parameters, watched"),
    ("actuator", "actuator errors, suspected"),
    ("design", "design parameters, identified"),
)
"""Families of parameters in the order in which a page shows them, with their titles."""


def component_row(kind: type[Component], shown: ComponentExample) -> dict[str, Any]:
    """One type of the list."""
    c = shown.component
    return {
        "component": kind.TYPE,
        "title": kind.SECTION.help,
        "required_keys": [f.name for f in kind.SECTION.fields if f.required],
        "optional_keys": [f.name for f in kind.SECTION.fields if not f.required],
        "inputs": list(c.inputs()),
        "unknowns": [u.name for u in c.unknowns()],
        "balances": list(shown.balances),
        "actuators": [a.name for a in c.actuators()],
        "health_parameters": [p.name for p in c.parameters() if p.family == "health"],
        "outputs": list(shown.outputs),
        "description": description(kind),
    }


def key_rows(kind: type[Component]) -> Iterator[dict[str, Any]]:
    """One row for each key of a type, those of its sections included, named section.key."""
    for name, field in _keys(kind.SECTION):
        yield {
            "component": kind.TYPE,
            "key": name,
            "kind": field.kind,
            "unit": field.unit,
            "required": field.required,
            "default": None if field.required or field.default in ({}, ()) else field.default,
            "minimum": field.minimum,
            "maximum": field.maximum,
            "choices": list(field.choices),
            "description": field.help,
        }


def parameter_rows(shown: ComponentExample) -> Iterator[dict[str, Any]]:
    """One row for each parameter of the example."""
    for p in shown.component.parameters():
        yield {
            "parameter": p.name,
            "family": p.family,
            "nominal": p.nominal,
            "lower": p.lower,
            "upper": p.upper,
            "prior_sigma": p.prior_sigma,
            "unit": p.unit,
            "description": p.description,
        }


def description(kind: type[Component]) -> str:
    """What a type does, with its equations: the words beside the code that computes it."""
    return inspect.cleandoc(kind.__doc__ or "")


def page(kind: type[Component], shown: ComponentExample) -> str:
    """The type for a reader; names of parameters, balances and columns are those of the example."""
    c = shown.component
    lines = [f"{kind.TYPE}: {kind.SECTION.help}", ""]
    for paragraph in description(kind).split("\n\n"):
        # an indented paragraph is an equation: its spaces are its own
        lines += paragraph.splitlines() if paragraph.startswith(" ") else textwrap.wrap(paragraph, WIDTH)
        lines.append("")
    lines.append("keys")
    for name, field in _keys(kind.SECTION):
        lines += _wrapped(f"{name}{_bracketed(field.unit)}: {field.help}", 2)
        lines += _wrapped(_facts(field), 4)
    lines += ["", "in an engine file", *shown.text.splitlines(), ""]
    lines += _labelled("reads", ", ".join(_input(name, default) for name, default in c.inputs().items()))
    lines += _labelled("unknowns", ", ".join(u.name for u in c.unknowns()))
    lines += _labelled("balances", ", ".join(shown.balances))
    lines += _labelled("moved by", ", ".join(_actuator(a) for a in c.actuators()))
    if "shaft" in c.values:
        lines += _labelled("shaft", f"its power counts in the balance of shaft '{c.values['shaft']}'")
    lines += _labelled("columns", ", ".join((*shown.outputs, *_station_columns(c))))
    for family, title in PARAMETER_FAMILIES:
        found = [p for p in c.parameters() if p.family == family]
        if found:
            lines += ["", title]
            for p in found:
                lines += _wrapped(_parameter(p), 2)
    return "\n".join(lines).rstrip() + "\n"


def _keys(section: Section, before: str = "") -> Iterator[tuple[str, Field]]:
    for field in section.fields:
        yield before + field.name, field
        if isinstance(field.section, Section):
            yield from _keys(field.section, f"{before}{field.name}.")


def _facts(field: Field) -> str:
    facts = ["required" if field.required else _default(field)]
    if field.choices:
        facts.append(f"one of {', '.join(field.choices)}")
    if field.minimum is not None and field.maximum is not None:
        facts.append(f"{field.minimum:g} to {field.maximum:g}")
    elif field.minimum is not None:
        facts.append(f"at least {field.minimum:g}")
    elif field.maximum is not None:
        facts.append(f"at most {field.maximum:g}")
    return "; ".join(facts)


def _default(field: Field) -> str:
    if field.default is None or field.default in ({}, (), ""):
        return "optional"
    if isinstance(field.default, bool):
        return f"default {str(field.default).lower()}"
    return f"default {field.default:g}" if isinstance(field.default, float) else f"default {field.default}"


def _bracketed(unit: str) -> str:
    return f" [{unit}]" if unit else ""


def _actuator(a: Actuator) -> str:
    unit = "" if a.unit == "1" else f" {a.unit}"
    return f"{a.name} ({a.lower:g} to {a.upper:g}{unit}, {a.neutral:g} where nothing sets it)"


def _input(name: str, default: float | None) -> str:
    return name if default is None else f"{name} ({default:g} where it is not recorded)"


def _station_columns(c: Component) -> list[str]:
    """Columns of the stations that the component delivers."""
    from enginediag_cli.engine.load import outlets

    return [f"{what}{s}{unit}" for s in outlets(c.values) for what, unit in (("T", "_K"), ("P", "_Pa"), ("W", "_kg_s"))]


def _parameter(p: Parameter) -> str:
    unit = "" if p.unit == "1" else f" {p.unit}"
    spread = f"nominal {p.nominal:g}{unit}, {p.lower:g} to {p.upper:g}, plausibly ± {p.prior_sigma:g}"
    return f"{p.name}: {p.description}; {spread}"


def _labelled(label: str, text: str) -> list[str]:
    if not text:
        return []
    return textwrap.wrap(
        text, WIDTH, initial_indent=label.ljust(LABEL), subsequent_indent=" " * LABEL, break_on_hyphens=False
    )


def _wrapped(text: str, by: int) -> list[str]:
    return textwrap.wrap(text, WIDTH, initial_indent=" " * by, subsequent_indent=" " * (by + 2), break_on_hyphens=False)


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
        "varies_with": term.driver_words(),
        "coefficients": [c.name for c in term.COEFFICIENTS],
        "assumed": [c.name for c in term.COEFFICIENTS if not c.cited],
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
            "assumed": not c.cited,
            "description": c.description,
        }


def site_row(term: Term, site: Site, carried: Carried) -> dict[str, Any]:
    """Where a term can act on one engine, and what the engine's model carries there."""
    block = carried.get(f"{term.NAME}@{site.name}")
    return {
        "term": term.NAME,
        "at": site.name,
        "component": site.component,
        "acts_on": list(site.targets),
        "driver": term.DRIVER.word,
        "carried": block is not None,
        "coefficients": dict(block["coefficients"]) if block else {},
        "standard_errors": dict(block["standard_errors"]) if block else {},
        "source": block["source"] if block else "",
    }


def effect_blocks(engine: Engine) -> dict[str, Mapping[str, Any]]:
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
    for v in formula_variables(network).values():
        unit = v.driver.unit if v.recorded else "ratio to the design point"
        yield {"variable": v.name, "at_design": v.reference, "unit": unit, "words": v.words}


def physics_page(term: Term, places: Mapping[str, Sequence[Site]], carried: Mapping[str, Carried]) -> str:
    """The term for a reader; `places` are its sites by the name of the engine, `carried` what each engine carries."""
    lines = [f"{term.NAME}: {term.TITLE}", "", *textwrap.wrap(term.STATEMENT, WIDTH), ""]
    lines += _physics_terms_labelled("equation", term.EQUATION)
    lines += _physics_terms_labelled("varies with", term.driver_words())
    if term.SWITCHES:
        lines += _physics_terms_labelled("switch", SWITCH)
    for column, default in term.INPUTS.items():
        reads = f"column {column}; {default:g} where it is not recorded"
        lines += _physics_terms_labelled("reads", MEMORY if column == MOMENT else reads)
    lines += _physics_terms_labelled("reference", term.REFERENCE)
    lines += ["", "coefficients"]
    for c in term.COEFFICIENTS:
        lines += _indented(f"{c.name} [{c.unit}]: {c.description}", 2)
        for text in _physics_terms_facts(c):
            lines += _indented(text, 4)
    lines += ["", "places"]
    for engine, sites in places.items():
        lines += _sites(engine, sites, term, carried[engine])
    example = next((s.name for sites in places.values() for s in sites if not term.FROM_FILE), None)
    if example:
        values = ", ".join(f"{c.name}: {c.typical:g}" for c in term.amplitudes())
        lines += [
            "",
            "in an engine file",
            "  physics:",
            f"    - {{term: {term.NAME}, at: {example}, coefficients: {{{values}}}}}",
        ]
    return "\n".join(lines) + "\n"


def _physics_terms_labelled(label: str, text: str) -> list[str]:
    # spaces inside an equation are its own: they are not a place to fold at unless it is too long
    return textwrap.wrap(
        text, WIDTH, initial_indent=label.ljust(LABEL), subsequent_indent=" " * LABEL, break_on_hyphens=False
    )


def _indented(text: str, by: int) -> list[str]:
    return textwrap.wrap(text, WIDTH, initial_indent=" " * by, subsequent_indent=" " * (by + 2), break_on_hyphens=False)


def _physics_terms_facts(c: Coefficient) -> Iterator[str]:
    within = f"within {c.lower:g} to {c.upper:g}" if np.isfinite([c.lower, c.upper]).any() else "without bounds"
    if c.free:
        yield f"{c.absent:g} unless the engine file says otherwise, {within}; sought with the others"
    elif c.shape:
        yield f"{c.absent:g} unless the engine file says otherwise, {within}; not sought"
    else:
        yield f"absent at {c.absent:g}, typically {c.typical:g}, {within}; prior standard deviation {c.sigma:g}"
    if not c.cited:
        yield ASSUMED


def _sites(engine: str, sites: Sequence[Site], term: Term, carried: Carried) -> Iterator[str]:
    if not sites:
        yield f"  {engine}: none"
        return
    names = [_site(site, carried.get(f"{term.NAME}@{site.name}")) for site in sites]
    yield from _indented(f"{engine}: {', '.join(names)}", 2)


def _site(site: Site, block: Mapping[str, Any] | None) -> str:
    """ "hpc (hpc.efficiency)", with the coefficients that the engine carries there."""
    text = f"{site.name} ({' and '.join(site.targets)})"
    if block is None:
        return text
    errors = block["standard_errors"]
    sizes = [f"{name} {format_quantity(value, '', errors.get(name))}" for name, value in block["coefficients"].items()]
    return f"{text} carried: {' and '.join(sizes) or 'absent'}"


VERBATIM = "\b"
"""Click's mark of a paragraph whose lines stay as they are."""


def program_page(context: click.Context, commands: Mapping[str, str]) -> str:
    """The page enginediag(1); `commands`: the line of help of each."""
    lines = [*_head("enginediag", _summary(context.command)), *_synopsis(context), *_description(context.command)]
    lines.append(".SH COMMANDS")
    for name, told in commands.items():
        lines += [".TP", f".BR enginediag\\-{name} (1)", _text(told)]
    return _page([*lines, *_options(context)])


def command_page(context: click.Context) -> str:
    """The page of one command, enginediag-detect(1)."""
    command = context.command
    lines = [*_head(f"enginediag-{context.info_name}", _summary(command)), *_synopsis(context), *_description(command)]
    lines += _options(context)
    if command.epilog:
        lines += [".SH EXIT STATUS", *_paragraphs(command.epilog.replace("Exit codes: ", ""))]
    return _page([*lines, ".SH SEE ALSO", ".BR enginediag (1)"])


def _page(lines: list[str]) -> str:
    return "\n".join(lines) + "\n"


def _head(name: str, summary: str) -> Iterator[str]:
    yield f'.TH "{_text(name.upper())}" "1" "" "enginediag {__version__}" "User Commands"'
    yield ".SH NAME"
    yield f"{_text(name)} \\- {_text(summary.rstrip('.'))}"


def _summary(command: click.Command) -> str:
    return command.short_help or (command.help or "").strip().partition("\n")[0]


def _synopsis(context: click.Context) -> Iterator[str]:
    yield ".SH SYNOPSIS"
    yield f".B {_text(context.command_path)}"
    yield _text(" ".join(context.command.collect_usage_pieces(context)))


def _description(command: click.Command) -> Iterator[str]:
    yield ".SH DESCRIPTION"
    yield from _paragraphs(inspect.cleandoc(command.help or ""))


def _options(context: click.Context) -> Iterator[str]:
    yield ".SH OPTIONS"
    for parameter in context.command.get_params(context):
        record = parameter.get_help_record(context)
        if record is None:
            continue
        names, told = record
        yield ".TP"
        yield f"\\fB{_text(names)}\\fR"
        yield _text(" ".join(told.split()))
        variables = parameter.variables(context) if hasattr(parameter, "variables") else ()
        if variables:
            yield ".br"
            yield _text(f"Environment: {', '.join(variables)}")


def _paragraphs(text: str) -> Iterator[str]:
    for paragraph in re.split(r"\n\s*\n", text.strip()):
        if paragraph.startswith(VERBATIM):
            yield from (".PP", ".nf")
            yield from (_text(line) for line in paragraph.split("\n")[1:])
            yield ".fi"
        else:
            yield ".PP"
            yield _text(" ".join(paragraph.split()))


def _text(text: str) -> str:
    """Text that roff prints as it is: no escapes, no requests, and hyphens that can be copied."""
    text = text.replace("\\", "\\e").replace("-", "\\-")
    return "\\&" + text if text[:1] in (".", "'") else text
