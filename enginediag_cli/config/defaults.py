"""Defaults in the form that a given value would have, so that nothing downstream tells the two apart."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from enginediag_cli.config.fields import AnySection, Either, Field, Variants

FLOATS = ("number", "numbers", "range", "number_map")


def default_value(field: Field) -> Any:
    """Fresh lists and dicts, floats where the field holds numbers, sections with the defaults of their own
    fields. None for a required field: it has no default, and its absence is a problem already reported."""
    if field.required:
        return None
    if field.kind == "section" and isinstance(field.default, Mapping) and field.section is not None:
        return _filled(field.section, field.default)
    return plain(field.default, floats=field.kind in FLOATS)


def plain(value: Any, *, floats: bool = False) -> Any:
    """Tuples as lists, mappings as dicts, all copied; with `floats`, whole numbers as floats."""
    if isinstance(value, Mapping):
        return {key: plain(item, floats=floats) for key, item in value.items()}
    if isinstance(value, (list, tuple)):
        return [plain(item, floats=floats) for item in value]
    return float(value) if floats and isinstance(value, int) else value


def _filled(section: AnySection, given: Mapping[str, Any]) -> dict[str, Any]:
    if isinstance(section, Variants):
        chosen = section.options.get(str(given.get(section.key)))
        head = {section.key: given[section.key]} if section.key in given else {}
        return head | (_filled(chosen, given) if chosen is not None else plain(given))
    if isinstance(section, Either):
        known = section.of(given)
        return _filled(known, given) if known is not None else dict(plain(given))
    return {field.name: _given_or_default(field, given) for field in section.fields}


def _given_or_default(field: Field, given: Mapping[str, Any]) -> Any:
    if field.name not in given:
        return default_value(field)
    value = given[field.name]
    if field.kind == "section" and isinstance(value, Mapping) and field.section is not None:
        return _filled(field.section, value)
    return plain(value, floats=field.kind in FLOATS)
