from __future__ import annotations

import json
from typing import Any

import pytest
from config_declarations import FILE, GOOD

from enginediag_cli.config.document import Node, document_problems, parse_document
from enginediag_cli.config.fields import KINDS, SHAPES, Field, Section, json_schema
from enginediag_cli.config.validate import LEAVES, WANTED, validate
from enginediag_cli.errors import ConfigError

SCHEMA = json_schema(FILE, "enginediag engine file")


def plain(node: Node) -> Any:
    """A document as an editor's JSON schema validator sees it."""
    if node.is_mapping:
        return {key: plain(child) for key, child in node.value.items()}
    return [plain(child) for child in node.value] if node.is_list else node.value


def is_type(value: Any, name: str) -> bool:
    number = isinstance(value, (int, float)) and not isinstance(value, bool)
    return {
        "object": isinstance(value, dict),
        "array": isinstance(value, list),
        "string": isinstance(value, str),
        "boolean": isinstance(value, bool),
        "null": value is None,
        "number": number,
        "integer": number and float(value).is_integer(),
    }[name]


def accepts(schema: dict[str, Any], value: Any) -> bool:
    """The part of draft-07 that the schemas use; an unknown keyword is an error, not an acceptance."""
    known = {
        "$schema",
        "title",
        "description",
        "default",
        "type",
        "enum",
        "const",
        "minimum",
        "maximum",
        "minItems",
        "maxItems",
        "items",
        "required",
        "properties",
        "additionalProperties",
        "anyOf",
        "allOf",
        "if",
        "then",
    }
    assert set(schema) <= known, set(schema) - known
    types = schema.get("type", [])
    if types and not any(is_type(value, name) for name in ([types] if isinstance(types, str) else types)):
        return False
    if value not in schema.get("enum", [value]) or value != schema.get("const", value):
        return False
    if is_type(value, "number") and not schema.get("minimum", value) <= value <= schema.get("maximum", value):
        return False
    if isinstance(value, list):
        size = len(value)
        if not schema.get("minItems", 0) <= size <= schema.get("maxItems", size):
            return False
        if not all(accepts(schema.get("items", {}), item) for item in value):
            return False
    if isinstance(value, dict) and not accepts_mapping(schema, value):
        return False
    if "anyOf" in schema and not any(accepts(option, value) for option in schema["anyOf"]):
        return False
    if "if" in schema and accepts(schema["if"], value) and not accepts(schema["then"], value):
        return False
    return all(accepts(part, value) for part in schema.get("allOf", []))


def accepts_mapping(schema: dict[str, Any], value: dict[str, Any]) -> bool:
    if not set(schema.get("required", [])) <= set(value):
        return False
    properties, others = schema.get("properties", {}), schema.get("additionalProperties", True)
    for key, item in value.items():
        part = properties.get(key, others)
        if part is False or (part is not True and not accepts(part, item)):
            return False
    return True


CHANGES = [  # (text of GOOD, what it becomes)
    ("", ""),
    ("kind: engine", "kind: engines"),
    ("kind: engine\n", ""),
    ("kind: engine", "kind: 3"),
    ("altitude_m: 1.0e4", "altitude_ft: 1.0e4"),
    ("altitude_m: 1.0e4", "altitude_m: 1e5"),
    ("altitude_m: 1.0e4", "altitude_m:"),
    ("altitude_m: 1.0e4", "altitude_m: '3'"),
    ("altitude_m: 1.0e4", "altitude_m: 12:30"),
    ("altitude_m: 1.0e4", "altitude_m: true"),
    ("stages: 4", "stages: 4.0"),
    ("stages: 4", "stages: 4.5"),
    ("stages: 4", "stages: 0"),
    ("cooled: true", "cooled: yes"),
    ("cooled: true", "cooled: 1"),
    ("cooled: true", "cooled: FALSE"),
    ("[1e3, 2000, 3.5e+3]", "[]"),
    ("[1e3, 2000, 3.5e+3]", "[a]"),
    ("[1e3, 2000, 3.5e+3]", "5"),
    ("[1e3, 2000, 3.5e+3]", "[-1]"),
    ("[220, 320.5]", "[220]"),
    ("[220, 320.5]", "null"),
    ("[220, 320.5]", "[220, x]"),
    ("[report 1, report 2]", "[1]"),
    ("[report 1, report 2]", "[]"),
    ('"a test"', "014"),
    ('"a test"', "no"),
    ('"a test"', ""),
    ("0.9", "x"),
    ("EGT", "5"),
    ("d: }", "d: []}"),
    ("d: }", "d: 1e-3}"),
    ("sigma: 2", "sigma: -2"),
    ("    sigma: 2\n", ""),
    ("sigma: 2", "sigma: 2\n    extra: 1"),
    ("lp: {}", "lp:"),
    ("lp: {}", "lp: {inertia_kg_m2: }"),
    ("lp: {}", "lp: {mass: 1}"),
    ("lp: {}", "lp: []"),
    ("name: hpc", "title: hpc"),
    ("name: hpc", "name: 3"),
    ("type: compressor", "type: nozzle"),
    ("type: compressor", "type: fan"),
    ("    type: compressor\n", ""),
    ("pressure_ratio: 12", "pressure_ratio: 0"),
    ("spool: hp", "spool: hp\n    map: {beta: 0.2}"),
    ("spool: hp", "spool: hp\n    map: {beta: 2}"),
    ("spool: hp", "spool: hp\n    map: {bete: 0.2}"),
    ("spool: hp", "spool: hp\n    map: {table: }"),
    ("type: nozzle, area_m2: .25", "type: nozzle"),
    ("sensors:\n", "sensors: 3\nx:\n"),
]


@pytest.mark.parametrize(("old", "new"), CHANGES)
def test_the_schema_accepts_exactly_what_the_validator_accepts(old: str, new: str) -> None:
    assert old in GOOD
    document = parse_document(GOOD.replace(old, new, 1) if old else GOOD, "f.yaml")
    assert not list(document_problems(document))
    try:
        validate(document, FILE)
        valid = True
    except ConfigError:
        valid = False
    assert accepts(SCHEMA, plain(document)) == valid


def test_the_changes_above_contain_good_and_bad_documents() -> None:
    documents = [plain(parse_document(GOOD.replace(old, new, 1), "f")) for old, new in CHANGES]
    accepted = sum(accepts(SCHEMA, document) for document in documents)
    assert 10 <= accepted <= len(CHANGES) - 25


def test_a_jsonschema_package_agrees_that_the_schema_is_draft_07() -> None:
    jsonschema = pytest.importorskip("jsonschema")
    jsonschema.Draft7Validator.check_schema(SCHEMA)
    jsonschema.Draft7Validator(SCHEMA).validate(plain(parse_document(GOOD, "f")))


def test_the_schema_is_json_and_names_its_dialect() -> None:
    assert json.loads(json.dumps(SCHEMA)) == SCHEMA
    assert SCHEMA["$schema"] == "http://json-schema.org/draft-07/schema#"
    assert SCHEMA["title"] == "enginediag engine file"


def test_units_bounds_and_defaults_are_in_the_schema() -> None:
    assert SCHEMA["properties"]["altitude_m"] == {
        "type": "number",
        "minimum": -500,
        "maximum": 20000,
        "default": 0.0,
        "description": "design altitude [m]",
    }


def test_every_kind_of_field_has_a_shape_a_description_and_a_check() -> None:
    assert set(KINDS) == set(SHAPES) == set(WANTED)
    assert set(KINDS) - set(LEAVES) == {"section", "sections", "section_map", "named_sections"}


def test_a_declared_name_is_not_declared_again() -> None:
    own = Section("s", "", (Field("name", "choice", "", choices=("a", "b")),))
    schema = json_schema(Section("f", "", (Field("parts", "named_sections", "", default=(), section=own),)))
    assert schema["properties"]["parts"]["items"]["properties"]["name"]["enum"] == ["a", "b"]
