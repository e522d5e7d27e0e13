"""Result tables: what each command writes, declared once.

A column has a name, a kind, words, a unit and its value: a function of the result that a row is about. Rows are made by
the declaration and its JSON schema is printed from it, so that a column is added in one place. The version of a table
goes up when a column disappears, changes its kind or unit, or may be empty where it never was; new columns are no new
version. tests/cli/output_schemas.json holds what was released.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass, replace
from importlib import import_module
from operator import attrgetter, itemgetter
from typing import TYPE_CHECKING, Any, Generic, TypeVar

from enginediag_cli.config.fields import REQUIRED, Field, Section

if TYPE_CHECKING:
    from enginediag_cli.config.fields import Schema

Source = TypeVar("Source")
Row = dict[str, Any]

CSV_LIST = "; "
"""Between the items of a list in a cell, as `output.cell` writes it."""


def _no_value(source: Any) -> Any:
    raise TypeError("a column without a value")


@dataclass(frozen=True)
class Column(Field):
    """A column; one whose default is None may be empty.

    value: the cell, from the result that a row is about; only_with: the option with which alone the column is there.
    """

    value: Callable[[Any], Any] = _no_value
    option: str = ""


class Columns(Generic[Source]):
    """Declares columns whose values come from one type of result: `of_verdict: Columns[Verdict] = Columns()`."""

    def __call__(
        self,
        name: str,
        kind: str,
        help: str,
        value: Callable[[Source], Any] | None = None,
        unit: str = "",
        *,
        only_with: str = "",
    ) -> Column:
        """A column; without a value the attribute of the result that has the column's name. kind: "number?" may be
        empty."""
        return Column(name, *_kind(kind, help), unit, value=value or attrgetter(name), option=only_with)

    def part(self, get: Callable[[Source], Any], columns: Sequence[Column]) -> tuple[Column, ...]:
        """Columns of a part of the result; cells are empty where there is no such part."""

        def value(of_part: Callable[[Any], Any]) -> Callable[[Source], Any]:
            return lambda source: None if (found := get(source)) is None else of_part(found)

        return tuple(replace(c, value=value(c.value)) for c in columns)


def _kind(kind: str, help: str) -> tuple[str, str, Any]:
    """Kind, words and default: "number?" is a number that may be missing."""
    return kind.removesuffix("?"), help, None if kind.endswith("?") else REQUIRED


def column(name: str, kind: str, help: str, unit: str = "", *, only_with: str = "") -> Column:
    """A column, or a key of a document, of results that are mappings; kind: "number?" may be empty (null in JSON)."""
    return Column(name, *_kind(kind, help), unit, value=itemgetter(name), option=only_with)


def part(name: str, help: str, fields: Sequence[Field] = (), *, many: bool = False, empty: bool = False) -> Field:
    """An object inside a document, or with `many` a list of them; without fields its keys are not promised."""
    kind = "sections" if many else "section"
    return Field(name, kind, help, default=None if empty else REQUIRED, section=Section(name, help, tuple(fields)))


def object_column(field: Field, value: Callable[[Any], Any], only_with: str = "") -> Column:
    """An object inside a document as a column of rows."""
    return Column(
        field.name,
        field.kind,
        field.help,
        field.default,
        field.unit,
        section=field.section,
        value=value,
        option=only_with,
    )


@dataclass(frozen=True)
class Table(Generic[Source]):
    """Rows of one kind: their columns, and how they are shown.

    Attributes
    ----------
    name, version, help : str, int, str
        Name and version of the schema, and what a row is.
    columns : tuple of Column
        Columns that every row has.
    terminal : tuple of str
        Columns that a narrow terminal shows, most important first.
    families : tuple of Column
        Columns whose names hold a name of the engine's, `<parameter>`.
    family_cells : callable or None
        Gives the cells of all families of a row.
    families_after : str
        Column after which they follow; "" for the end.
    document : tuple of Field
        Keys of the one object that `--format json` writes instead of rows.
    """

    name: str
    version: int
    help: str
    columns: tuple[Column, ...]
    terminal: tuple[str, ...] = ()
    families: tuple[Column, ...] = ()
    family_cells: Callable[[Source], Mapping[str, Any]] | None = None
    families_after: str = ""
    document: tuple[Field, ...] = ()

    def __post_init__(self) -> None:
        unknown = [name for name in self.terminal if self.column(name) is None]
        if unknown:
            raise ValueError(f"{self.name}: a terminal shows {unknown}, which are no columns")

    @property
    def id(self) -> str:
        """ "enginediag/detect/1", as in the head of a file."""
        return f"enginediag/{self.name}/{self.version}"

    @property
    def notes(self) -> dict[str, str]:
        """For the head of a file."""
        return {"schema": self.id}

    @property
    def names(self) -> tuple[str, ...]:
        """The columns that are always there, in their order."""
        return tuple(c.name for c in self.columns if not c.option)

    def row(self, source: Source, optional: Collection[str] = ()) -> Row:
        """The cells of one result in the order of the columns, families behind; `optional`: names of columns and
        families that are there only with an option and are wanted here. A value that is missing is an error."""
        shown = {c.name: c.value(source) for c in self.columns if not c.option or c.name in optional}
        if self.family_cells is None or not all(not f.option or f.name in optional for f in self.families):
            return shown
        place = [*shown].index(self.families_after) + 1 if self.families_after else len(shown)
        cells = [*shown.items()]
        return {**dict(cells[:place]), **self.family_cells(source), **dict(cells[place:])}

    def column(self, name: str) -> Column | None:
        """The declaration of a column by its name in a file; None for one that is not declared."""
        plain = next((c for c in self.columns if c.name == name), None)
        return plain or next((f for f in self.families if re.fullmatch(pattern(f.name), name)), None)

    def schema(self) -> Schema:
        """JSON schema (draft-07) of what `--format json` writes, with the columns of the CSV beside it."""
        from enginediag_cli.config.fields import DIALECT, section_schema

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
        columns = [*map(_schema_line, self.columns), *(_schema_line(replace(f, option="")) for f in self.families)]
        return {**head, **body, "version": self.version, "csv": {**csv, "columns": columns}}

    def _row_schema(self) -> Schema:
        schema: Schema = {
            "type": "object",
            "properties": {c.name: _with_unit(c) for c in self.columns},
            "required": list(self.names),
        }
        if self.families:
            schema["patternProperties"] = {f"^{pattern(c.name)}$": _with_unit(c) for c in self.families}
        return schema


def pattern(name: str) -> str:
    """The names of a family as a regular expression: "F:<a>|<b>" as "F:.+\\|.+"."""
    return ".+".join(re.escape(piece) for piece in re.split(r"<[^>]*>", name))


def _schema_line(c: Column) -> Schema:
    """A column as a line of the schema's list: name, type, unit, whether it may be empty, and its option."""
    line = {"name": c.name, "type": c.kind, "unit": c.unit, "nullable": not c.required}
    return {**line, "only_with": c.option} if c.option else line


def _with_unit(c: Column) -> Schema:
    from enginediag_cli.config.fields import field_schema

    return {**field_schema(c), "unit": c.unit} if c.unit else field_schema(c)


def _open(schema: Any) -> Any:
    """The schema with room for further keys in every object: what is new breaks no reader."""
    if isinstance(schema, Mapping):
        return {key: _open(value) for key, value in schema.items() if key != "additionalProperties" or value}
    return [_open(item) for item in schema] if isinstance(schema, list) else schema


PREFIX = "output/"
"""Before the name of a table where kinds of files have names, too."""

OUTPUTS = {
    "detect": "detection:DETECT",
    "detect/follow": "detection:FOLLOW",
    "detect/method": "detection:METHOD",
    "isolate": "isolation:ISOLATE",
    "isolate/components": "isolation:COMPONENTS",
    "trend": "trend:TREND",
    "trend/components": "trend:EVENTS",
    "trend/flights": "trend:FLIGHTS",
    "trend/margin": "fleet:MARGIN",
    "trend/deltas": "trend:DELTAS",
    "residual": "detection:RESIDUAL",
    "residual/records": "detection:RECORDS",
    "locate": "location:LOCATE",
    "locate/per-record": "location:PER_RECORD",
    "explain": "explanation:EXPLAIN",
    "explain/curves": "explanation:CURVES",
    "explain/amplitudes": "explanation:AMPLITUDES",
    "refine": "identification:REFINE",
    "refine/control": "identification:CONTROL",
    "prove": "trials:PROVE",
    "prove/isolate": "trials:ISOLATED",
    "prove/history": "trials:HISTORIES",
    "study": "trials:STUDY",
    "study/counts": "trials:COUNTS",
    "study/reliability": "trials:RELIABILITY",
    "simulate": "recordings:SIMULATE",
    "check": "recordings:CHECK",
    "log": "recordings:LOG",
}
"""Module and attribute of each table; what `identify` writes is a YAML file of kind nominal."""


def output(name: str) -> Table[Any]:
    """Find the table of a command.

    Parameters
    ----------
    name : str
        For instance "detect" or "trend/flights".

    Returns
    -------
    Table

    Raises
    ------
    KeyError
        For a table that does not exist.
    """
    module, _, attribute = OUTPUTS[name].partition(":")
    found: Table[Any] = getattr(import_module(f"{__name__}.{module}"), attribute)
    return found
