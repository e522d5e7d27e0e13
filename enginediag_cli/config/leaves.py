"""Checks of the values that are not sections: numbers, texts, choices, lists and maps of them."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

from enginediag_cli.config.document import Node
from enginediag_cli.config.fields import Field
from enginediag_cli.config.hints import near, not_a_number

Report = Callable[..., None]
"""Called with (mark, message, hint)."""

Leaf = Callable[[Node, Field, str, Report], Any]

WANTED = {
    "number": "a number",
    "integer": "a whole number",
    "text": "a text",
    "boolean": "true or false",
    "choice": "a choice",
    "numbers": "a list of numbers",
    "texts": "a list of texts",
    "scalar": "a single value",
    "range": "a range [low, high]",
    "number_map": "a mapping of names to numbers",
    "text_map": "a mapping of names to texts",
    "any_map": "a mapping of names to single values",
    "section": "a mapping",
    "sections": "a list of mappings",
    "section_map": "a mapping of names to mappings",
    "named_sections": "a list of mappings, each with a name",
}


def expectation(field: Field) -> str:
    """What belongs under a key: "a number in m²: throat area"."""
    wanted = WANTED[field.kind]
    if field.kind == "choice":
        wanted = f"one of {', '.join(field.choices)}"
        if len(field.choices) == 1:
            wanted = f"write '{field.name}: {field.choices[0]}'"
    return wanted + (f" in {field.unit}" if field.unit else "") + (f": {field.help}" if field.help else "")


def number(node: Node, field: Field, where: str, report: Report) -> float | None:
    value = node.value
    if isinstance(value, bool) or not isinstance(value, (int, float)):
        hint = not_a_number(value, field.unit) if isinstance(value, str) else expectation(field)
        report(node.mark, f"{where} must be a number, not {node.describe()}", hint)
        return None
    if not math.isfinite(value) or abs(value) > 1e300:
        report(node.mark, f"{where} must be a finite number, not {node.text}", expectation(field))
        return None
    if _outside(float(value), field):
        report(node.mark, f"{where} must be {_bounds(field)}, not {node.text}", field.help)
        return None
    return float(value)


def integer(node: Node, field: Field, where: str, report: Report) -> int | None:
    value = number(node, field, where, report)
    if value is not None and not value.is_integer():
        report(node.mark, f"{where} must be a whole number, not {node.text}", expectation(field))
        return None
    if value is None:
        return None
    return node.value if isinstance(node.value, int) else int(value)


def text(node: Node, field: Field, where: str, report: Report) -> str | None:
    if not isinstance(node.value, str):
        hint = f'put it in quotes: "{node.text}"' if node.is_scalar and node.value is not None else field.help
        report(node.mark, f"{where} must be a text, not {node.describe()}", hint)
        return None
    if field.choices and node.value not in field.choices:
        report(node.mark, f"{where} cannot be '{node.value}'", near(node.value, field.choices))
        return None
    return node.value


def choice(node: Node, field: Field, where: str, report: Report) -> str | None:
    if not isinstance(node.value, str) and node.text not in field.choices:
        report(node.mark, f"{where} must be a choice, not {node.describe()}", near("", field.choices))
        return None
    return text(node, field, where, report)  # a choice that looks like a number needs its quotes


def boolean(node: Node, field: Field, where: str, report: Report) -> bool | None:
    if not isinstance(node.value, bool):
        spelt = {"yes": "true", "on": "true", "1": "true", "no": "false", "off": "false", "0": "false"}
        meant = spelt.get(node.text.lower())
        report(
            node.mark,
            f"{where} must be true or false, not {node.describe()}",
            f"write {meant}" if meant else field.help,
        )
        return None
    return node.value


def numbers(node: Node, field: Field, where: str, report: Report) -> list[float | None]:
    return _list(node, field, where, report, number)


def texts(node: Node, field: Field, where: str, report: Report) -> list[str | None]:
    return _list(node, field, where, report, text)


def number_range(node: Node, field: Field, where: str, report: Report) -> list[float | None] | None:
    if not node.is_list or len(node.value) != 2:
        report(
            node.mark,
            f"{where} must be a range of two numbers, not {node.describe()}",
            f"write [low, high]{' in ' + field.unit if field.unit else ''}",
        )
        return None
    low, high = _list(node, field, where, report, number)
    if low is not None and high is not None and low > high:
        report(node.mark, f"{where} must rise: {low:g} is above {high:g}", f"write [{high:g}, {low:g}]")
    return [low, high]


def number_map(node: Node, field: Field, where: str, report: Report) -> dict[str, Any]:
    return _map(node, field, where, report, number)


def text_map(node: Node, field: Field, where: str, report: Report) -> dict[str, Any]:
    return _map(node, field, where, report, text)


def any_map(node: Node, field: Field, where: str, report: Report) -> dict[str, Any]:
    return _map(node, field, where, report, _scalar)


def scalar(node: Node, field: Field, where: str, report: Report) -> str | None:
    if _scalar(node, field, where, report) is None:
        return None
    return node.text


LEAVES: dict[str, Leaf] = {
    "number": number,
    "integer": integer,
    "text": text,
    "boolean": boolean,
    "choice": choice,
    "numbers": numbers,
    "texts": texts,
    "scalar": scalar,
    "range": number_range,
    "number_map": number_map,
    "text_map": text_map,
    "any_map": any_map,
}


def _list(node: Node, field: Field, where: str, report: Report, one: Leaf) -> list[Any]:
    if not node.is_list:
        hint = f"write [{node.text}]" if node.is_scalar else expectation(field)
        report(node.mark, f"{where} must be {WANTED[field.kind]}, not {node.describe()}", hint)
        return []
    return [one(item, field, f"{where}[{position}]", report) for position, item in enumerate(node.value)]


def _map(node: Node, field: Field, where: str, report: Report, one: Leaf) -> dict[str, Any]:
    if not node.is_mapping:
        report(node.mark, f"{where} must be {WANTED[field.kind]}, not {node.describe()}", field.help)
        return {}
    return {key: one(child, field, f"{where}.{key}", report) for key, child in node.value.items()}


def _scalar(node: Node, field: Field, where: str, report: Report) -> Any:
    if not node.is_scalar:
        report(node.mark, f"{where} must be a single value, not {node.describe()}", field.help)
        return None
    return node.value


def _outside(value: float, field: Field) -> bool:
    below = field.minimum is not None and value < field.minimum
    return below or (field.maximum is not None and value > field.maximum)


def _bounds(field: Field) -> str:
    unit = f" {field.unit}" if field.unit else ""
    if field.minimum is not None and field.maximum is not None:
        return f"between {field.minimum:g} and {field.maximum:g}{unit}"
    if field.minimum is not None:
        return f"at least {field.minimum:g}{unit}"
    return f"at most {field.maximum:g}{unit}"
