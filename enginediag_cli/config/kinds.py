"""The kinds of YAML file, and where the code that declares each of them lives.

Declarations are imported when a file of their kind is read, so that reading one kind does not load the code
of the others. A new kind of file is one entry here.

JSON schema (draft-07) of a file kind, made from the fields that validate it.

Editors with a YAML language server complete and check files with it. What JSON schema cannot say is left to
the validator: that the names of a list differ, and that a range rises.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from importlib import import_module
from pathlib import Path
from typing import Any

from enginediag_cli.config.document import Node, load_document
from enginediag_cli.config.hints import AnySection, Either, Field, Section, near
from enginediag_cli.config.validate import NAME, Checked, plain, validate
from enginediag_cli.errors import ConfigError, Problem


@dataclass(frozen=True)
class FileKind:
    """`section` is the "module:attribute" of the declaration. `build` is the "module:function" that turns a
    path into the object that the file describes; it raises ConfigError for what one key alone cannot show."""

    name: str
    help: str
    section: str
    build: str = ""

    def load_section(self) -> Section:
        section: Section = _attribute(self.section)
        return section

    def load_build(self) -> Callable[[Path], Any] | None:
        return _attribute(self.build) if self.build else None


FILE_KINDS: dict[str, FileKind] = {
    kind.name: kind
    for kind in (
        FileKind(
            "engine",
            "an engine: its components, shafts, sensors and parameters",
            "enginediag_cli.engine.declaration:ENGINE_FILE",
            "enginediag_cli.physics.engine_file:load_engine",
        ),
        FileKind(
            "faults",
            "faults: named directions in parameter space, their size and onset",
            "enginediag_cli.faults.catalogue:FAULT_FILE",
            "enginediag_cli.faults.catalogue:load_faults",
        ),
        FileKind(
            "recorder",
            "a recorder: the columns and units of foreign recordings",
            "enginediag_cli.recordings.recorder_file:RECORDER_FILE",
            "enginediag_cli.recordings.recorder_file:load_recorder",
        ),
        FileKind(
            "nominal",
            "the nominal state of an engine, identified from healthy recordings",
            "enginediag_cli.identification.nominal_file:NOMINAL_FILE",
            "enginediag_cli.identification.nominal_file:read_nominal",
        ),
        FileKind(
            "study",
            "a Monte-Carlo study: fault cases, methods of diagnosis and repetitions",
            "enginediag_cli.validation.studies:STUDY_FILE",
            "enginediag_cli.validation.studies:load_study",
        ),
        FileKind(
            "fleet",
            "a fleet: engines by serial number, their recordings, maintenance and what to judge",
            "enginediag_cli.fleets.fleet_file:FLEET_FILE",
            "enginediag_cli.fleets.fleet_file:load_fleet",
        ),
        FileKind(
            "flight",
            "a flight to simulate: altitude, speed and power along time",
            "enginediag_cli.simulation.flights:FLIGHT_FILE",
        ),
        FileKind(
            "defaults",
            "options of commands, for enginediag.yaml beside the data",
            "enginediag_cli.cli.config:DEFAULTS_FILE",
            "enginediag_cli.cli.config:check_defaults",
        ),
    )
}


def load_checked(path: str | Path, kind: str) -> Checked:
    """Read and validate a YAML file that must be of one kind.

    Raises ConfigError with every problem of the file, or with the one problem that it is of another kind.
    """
    return check_document(load_document(path), kind)


def check_document(document: Node, kind: str) -> Checked:
    """Validate a document that must be of one kind; raises ConfigError as `load_checked`."""
    require_kind(document, kind)
    return validate(document, FILE_KINDS[kind].load_section())


def require_kind(document: Node, kind: str) -> None:
    """Raises ConfigError for a document that says it is of another kind."""
    found = _kind_node(document)
    if found is not None and found.text in FILE_KINDS and found.text != kind:
        raise ConfigError(
            [
                Problem(
                    found.mark,
                    f"this is a file of kind '{found.value}', and one of kind '{kind}' is wanted here",
                    f"give {FILE_KINDS[kind].help}",
                )
            ]
        )


def file_kind(document: Node) -> FileKind:
    """The kind that a document says it is of; raises ConfigError if it says none or an unknown one."""
    found = _kind_node(document)
    if found is None:
        what = (
            "the file does not say its kind"
            if document.is_mapping
            else (f"the file must be a mapping of keys, not {document.describe()}")
        )
        raise ConfigError([Problem(document.mark, what, f"begin it with 'kind:' and one of {', '.join(FILE_KINDS)}")])
    if not isinstance(found.value, str) or found.value not in FILE_KINDS:
        raise ConfigError(
            [Problem(found.mark, f"unknown kind of file, {found.describe()}", near(found.text, FILE_KINDS))]
        )
    return FILE_KINDS[found.value]


def check_file(path: str | Path) -> FileKind:
    """Validate a YAML file by the kind that it names, then build what it describes.

    Returns the kind; raises ConfigError with the problems of the declarations, or if there are none, with
    those of the build.
    """
    document = load_document(path)
    kind = file_kind(document)
    validate(document, kind.load_section())
    build = kind.load_build()
    if build is not None:
        build(Path(path))
    return kind


def _kind_node(document: Node) -> Node | None:
    return document.value.get("kind") if document.is_mapping else None


def _attribute(where: str) -> Any:
    module, _, name = where.partition(":")
    return getattr(import_module(module), name)


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
