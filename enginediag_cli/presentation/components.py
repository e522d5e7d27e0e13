"""Component types as rows, and one type as a page that an engineer reads; all from the declarations."""

from __future__ import annotations

import inspect
import textwrap
from collections.abc import Iterator
from typing import TYPE_CHECKING, Any

from enginediag_cli.config.fields import Field, Section

if TYPE_CHECKING:
    from enginediag_cli.engine.components import Actuator, Component
    from enginediag_cli.engine.example import Shown
    from enginediag_cli.parameters import Parameter

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


def component_row(kind: type[Component], shown: Shown) -> dict[str, Any]:
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


def parameter_rows(shown: Shown) -> Iterator[dict[str, Any]]:
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


def page(kind: type[Component], shown: Shown) -> str:
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
    from enginediag_cli.engine.wiring import outlets

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
