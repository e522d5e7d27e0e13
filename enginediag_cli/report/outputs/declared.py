"""The declaration of an output: rows are made by it, and its JSON schema is printed from it.

A column is a `config.fields.Field`: kind, unit, help; one whose default is None may be empty. The version of an output
goes up when a column disappears, changes its kind or unit, or may be empty where it never was; new columns are no new
version. tests/cli/output_schemas.json holds what was released.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

from enginediag_cli.config.fields import REQUIRED, Field, Section

if TYPE_CHECKING:
    from enginediag_cli.config.json_schema import Schema

CSV_LIST = "; "
"""Between the items of a list in a cell, as `presentation.rows.cell` writes it."""


def column(name: str, kind: str, help: str, unit: str = "", *, empty: bool = False) -> Field:
    """A column, or a key of a document; `empty`: a cell may hold nothing (null in JSON)."""
    return Field(name, kind, help, default=None if empty else REQUIRED, unit=unit)


def part(name: str, help: str, fields: Sequence[Field] = (), *, many: bool = False, empty: bool = False) -> Field:
    """An object inside a document, or with `many` a list of them; without fields its keys are not promised."""
    kind = "sections" if many else "section"
    return Field(name, kind, help, default=None if empty else REQUIRED, section=Section(name, help, tuple(fields)))


@dataclass(frozen=True)
class Table:
    """Rows of one kind.

    families: columns whose names hold a name of the engine's, `<parameter>`; asked: columns that are there only with
    an option, and that option; document: keys of the one object that `--format json` writes instead of the rows.
    """

    name: str
    version: int
    help: str
    columns: tuple[Field, ...]
    families: tuple[Field, ...] = ()
    asked: Mapping[str, str] = field(default_factory=dict)
    document: tuple[Field, ...] = ()

    @property
    def id(self) -> str:
        """ "enginediag/detect/1", as it stands in the head of a file."""
        return f"enginediag/{self.name}/{self.version}"

    @property
    def notes(self) -> dict[str, str]:
        """For the head of a file."""
        return {"schema": self.id}

    @property
    def names(self) -> tuple[str, ...]:
        """The columns that are always there, in their order."""
        return tuple(c.name for c in self.columns if c.name not in self.asked)

    def row(self, values: Mapping[str, Any]) -> dict[str, Any]:
        """The values in the order of the columns, None where there is none; families behind, as they come."""
        first = {c.name: values.get(c.name) for c in self.columns if c.name in values or c.name not in self.asked}
        return {**first, **{name: value for name, value in values.items() if name not in first}}

    def column(self, name: str) -> Field | None:
        """The declaration of a column by its name in a file; None for one that is not declared."""
        plain = next((c for c in self.columns if c.name == name), None)
        return plain or next((f for f in self.families if re.fullmatch(pattern(f.name), name)), None)

    def schema(self) -> Schema:
        """JSON schema (draft-07) of what `--format json` writes, with the columns of the CSV beside it."""
        from enginediag_cli.config.json_schema import DIALECT, section_schema

        row = self._row_schema()
        head: Schema = {
            "$schema": DIALECT,
            "$id": self.id,
            "title": f"what enginediag {self.name.replace('/', ', ')} writes",
            "description": self.help,
        }
        if self.document:
            section = Section(self.name, self.help, self.document)
            body = {**_open(section_schema(section)), "definitions": {"row": row}}
        else:
            body = {"type": "array", "items": row}
        csv = {"empty": "", "list": CSV_LIST, "boolean": ["false", "true"]}
        columns = [self.cell(c) for c in (*self.columns, *self.families)]
        return {**head, **body, "version": self.version, "csv": {**csv, "columns": columns}}

    def cell(self, c: Field) -> Schema:
        """A column as a line of the schema's list: name, type, unit, whether it may be empty, and what asks for it."""
        told = {"name": c.name, "type": c.kind, "unit": c.unit, "nullable": not c.required}
        return {**told, "only_with": self.asked[c.name]} if c.name in self.asked else told

    def _row_schema(self) -> Schema:
        required = [c.name for c in self.columns if c.name not in self.asked]
        schema: Schema = {
            "type": "object",
            "properties": {c.name: _with_unit(c) for c in self.columns},
            "required": required,
        }
        if self.families:
            schema["patternProperties"] = {f"^{pattern(c.name)}$": _with_unit(c) for c in self.families}
        return schema


def pattern(name: str) -> str:
    """The names of a family as a regular expression: "F:<a>|<b>" as "F:.+\\|.+"."""
    return ".+".join(re.escape(piece) for piece in re.split(r"<[^>]*>", name))


def _with_unit(c: Field) -> Schema:
    from enginediag_cli.config.json_schema import field_schema

    return {**field_schema(c), "unit": c.unit} if c.unit else field_schema(c)


def _open(schema: Any) -> Any:
    """The schema with room for further keys in every object: what is new breaks no reader."""
    if isinstance(schema, Mapping):
        return {key: _open(value) for key, value in schema.items() if key != "additionalProperties" or value}
    return [_open(item) for item in schema] if isinstance(schema, list) else schema
