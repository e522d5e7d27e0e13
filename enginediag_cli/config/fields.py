"""The declarations from which YAML files are validated, documented and turned into a JSON schema.

A `Field` is one key: its kind, unit, bounds, default and help. A `Section` is a mapping with known keys;
`Variants` is a mapping whose `type:` key chooses the section. Every file kind and every engine component
declares its own fields beside the code that reads them, so there is one list of keys and no second one.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import dataclass
from typing import Any

REQUIRED: Any = object()
"""Default of a field that must be given."""

KINDS = (
    "number",
    "integer",
    "text",
    "boolean",
    "choice",
    "numbers",  # list of numbers
    "texts",  # list of texts
    "scalar",  # a single value, taken as the text that stands there
    "range",  # [low, high]
    "number_map",  # mapping: any name -> number
    "text_map",  # mapping: any name -> text
    "any_map",  # mapping: any name -> scalar
    "section",  # mapping with the fields of `section`
    "sections",  # list of such mappings
    "section_map",  # mapping: any name -> such a mapping
    "named_sections",  # list of such mappings or of variants, each with a `name:`
)


@dataclass(frozen=True)
class Field:
    """One YAML key. `unit` is for documentation; the key itself carries it (`area_m2`)."""

    name: str
    kind: str
    help: str
    default: Any = REQUIRED
    unit: str = ""
    minimum: float | None = None
    maximum: float | None = None
    choices: tuple[str, ...] = ()
    section: AnySection | None = None

    @property
    def required(self) -> bool:
        return self.default is REQUIRED


@dataclass(frozen=True)
class Section:
    """A mapping with known keys; anything else in it is an error."""

    name: str
    help: str
    fields: tuple[Field, ...]


@dataclass(frozen=True)
class Either:
    """A mapping whose section is given by which key is there: `term:` or `law:`."""

    name: str
    help: str
    options: Mapping[str, Section]

    def choose(self, keys: Collection[str]) -> Section | None:
        """The one whose key is among these; None where there is none, or more than one."""
        found = [section for key, section in self.options.items() if key in keys]
        return found[0] if len(found) == 1 else None


@dataclass(frozen=True)
class Variants:
    """A mapping whose key `key` names which section it is, e.g. `type: compressor`."""

    name: str
    help: str
    options: Mapping[str, Section]
    key: str = "type"


AnySection = Section | Variants | Either
