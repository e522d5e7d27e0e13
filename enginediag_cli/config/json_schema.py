"""JSON schema (draft-07) of a file kind, made from the fields that validate it.

Editors with a YAML language server complete and check files with it. What JSON schema cannot say is left to
the validator: that the names of a list differ, and that a range rises.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from enginediag_cli.config.fields import AnySection, Either, Field, Section
from enginediag_cli.config.validate import NAME, plain

DIALECT = "http://json-schema.org/draft-07/schema#"

Schema = dict[str, Any]


def json_schema(section: AnySection, title: str | None = None) -> Schema:
    """The schema of a whole file whose top level is `section`."""
    return {"$schema": DIALECT, "title": title or section.name, **section_schema(section)}


def section_schema(section: AnySection, named: bool = False) -> Schema:
    """Schema of one mapping; `named` mappings have a `name` besides their declared fields."""
    extra = [NAME] if named else []
    if isinstance(section, Section):
        return _mapping(section, extra)
    if isinstance(section, Either):
        either = [{**_mapping(option, []), "required": [key]} for key, option in section.options.items()]
        return {"description": section.help, "oneOf": either}
    names = list(section.options)
    return {
        "type": "object",
        "description": section.help,
        "required": [section.key],
        "properties": {section.key: {"enum": names}},
        "allOf": [
            {
                "if": {"properties": {section.key: {"const": name}}, "required": [section.key]},
                "then": _mapping(option, [_constant(section.key, name, option.help), *extra]),
            }
            for name, option in section.options.items()
        ],
    }


def _constant(key: str, value: str, help: str) -> Field:
    return Field(key, "choice", help, choices=(value,))


def _mapping(section: Section, extra: list[Field]) -> Schema:
    declared = {field.name for field in section.fields}
    fields = [field for field in extra if field.name not in declared] + list(section.fields)
    schema: Schema = {
        "type": "object",
        "description": section.help,
        "properties": {field.name: field_schema(field) for field in fields},
        "additionalProperties": False,
    }
    required = [field.name for field in fields if field.required]
    return {**schema, "required": required} if required else schema


def field_schema(field: Field) -> Schema:
    """Schema of one key, with unit, default and bounds; null is allowed where the default is None."""
    help = {"description": field.help + (f" [{field.unit}]" if field.unit else "")}
    if field.default is None:
        return {**help, "anyOf": [SHAPES[field.kind](field), {"type": "null"}]}
    schema = {**SHAPES[field.kind](field), **help}
    if not field.required:
        schema["default"] = plain(field.default)
    return schema


def _number(field: Field) -> Schema:
    schema: Schema = {"type": "number"}
    if field.minimum is not None:
        schema["minimum"] = field.minimum
    if field.maximum is not None:
        schema["maximum"] = field.maximum
    return schema


def _text(field: Field) -> Schema:
    return {"type": "string", "enum": list(field.choices)} if field.choices else {"type": "string"}


def _mapping_schema(values: Schema) -> Schema:
    return {"type": "object", "additionalProperties": values}


def _inner(field: Field) -> Schema:
    assert field.section is not None, f"field '{field.name}' of kind {field.kind} declares no section"
    return section_schema(field.section, named=field.kind == "named_sections")


SHAPES: dict[str, Callable[[Field], Schema]] = {
    "number": _number,
    "integer": lambda field: {**_number(field), "type": "integer"},
    "text": _text,
    "choice": _text,
    "boolean": lambda field: {"type": "boolean"},
    "numbers": lambda field: {"type": "array", "items": _number(field)},
    "texts": lambda field: {"type": "array", "items": _text(field)},
    "scalar": lambda field: {"type": ["string", "number", "boolean"]},
    "range": lambda field: {"type": "array", "items": _number(field), "minItems": 2, "maxItems": 2},
    "number_map": lambda field: _mapping_schema(_number(field)),
    "text_map": lambda field: _mapping_schema(_text(field)),
    "any_map": lambda field: _mapping_schema({"type": ["string", "number", "boolean", "null"]}),
    "section": _inner,
    "sections": lambda field: {"type": "array", "items": _inner(field)},
    "named_sections": lambda field: {"type": "array", "items": _inner(field)},
    "section_map": lambda field: _mapping_schema(_inner(field)),
}
"""One entry per kind in `fields.KINDS`."""
