"""Declarations of keys, from which YAML files are validated, documented and turned into a JSON schema.

A `Field` is one key: its kind, unit, bounds, default and help. A `Section` is a mapping with known keys; `Variants` is
a mapping whose `type:` key chooses the section, `Either` one whose section follows from the key that it has. Each file
kind and each component of an engine declares its fields beside the code that reads them, so there is one list of keys
and no second one.

The hints that end a message (`near`, `unknown_key`, `not_a_number`) and the JSON schema (draft-07, for editors with a
YAML language server) are made from the same declarations. The schema cannot state that the names of a list differ, or
that a range rises: the validator alone checks that.
"""

from __future__ import annotations

import difflib
import re
from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from enginediag_cli.safe_text import SHORT
from enginediag_cli.units import UnitError, convert, find_unit, split_column

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

NAME = Field("name", "text", "name by which other parts of the file refer to this one")


def plain(value: Any, *, floats: bool = False) -> Any:
    """Tuples as lists, mappings as dicts, all copied; with `floats`, whole numbers as floats."""
    if isinstance(value, Mapping):
        return {key: plain(item, floats=floats) for key, item in value.items()}
    if isinstance(value, (list, tuple)):
        return [plain(item, floats=floats) for item in value]
    return float(value) if floats and isinstance(value, int) else value


SHOWN = 20
"""Names listed in a hint before the rest is only counted."""

SUPERSCRIPTS = str.maketrans(
    {"²": "2", "³": "3", "°": "", "(": "", ")": "", "^": "", "·": "_", "/": "_", "*": "_", " ": "_"}
)


def near(word: str, known: Iterable[str]) -> str:
    """Say which known name a misspelt one is nearest to, otherwise list them.

    Parameters
    ----------
    word : str
    known : iterable of str

    Returns
    -------
    str
        The second half of an error message.
    """
    names = list(known)
    close = closest(word, names)
    if close:
        return f"did you mean '{close}'?"
    if not names:
        return "there are none"
    rest = f", … ({len(names)} in all)" if len(names) > SHOWN else ""
    return ("one of: " if len(names) > 1 else "the only one is ") + ", ".join(names[:SHOWN]) + rest


def closest(word: str, names: Sequence[str]) -> str | None:
    """The known name nearest to a misspelt one, or None if nothing is near. Case does not count."""
    if len(word) > SHORT:
        return None
    folded = {name.casefold(): name for name in reversed(names)}
    match = difflib.get_close_matches(word.casefold(), list(folded), n=1, cutoff=0.6)
    return folded[match[0]] if match else None


def same_quantity(key: str, fields: Sequence[Field]) -> Field | None:
    """The field that holds the same quantity in another unit: `area_in2` or `area` for `area_m2`."""
    best: tuple[int, Field] | None = None
    for field in fields:
        stem = _stem(field)
        if stem and _is_stem_with_unit(key, stem) and (best is None or len(stem) > best[0]):
            best = (len(stem), field)
    return best[1] if best else None


def _stem(field: Field) -> str:
    """The name without its unit: `fuel_flow_kg_s` [kg/s] → `fuel_flow`; empty if it carries none."""
    if not field.unit:
        return ""
    suffix = "_" + field.unit.translate(SUPERSCRIPTS)
    if field.name.casefold().endswith(suffix.casefold()):
        return field.name[: -len(suffix)]
    return field.name.rpartition("_")[0]


def _is_stem_with_unit(key: str, stem: str) -> bool:
    folded, stem = key.casefold(), stem.casefold()
    if folded == stem:
        return True
    # unit symbols are short: in2, ft, lb_s, psi, degC, kPa, inHg
    return folded.startswith(stem + "_") and all(0 < len(part) <= 5 for part in folded[len(stem) + 1 :].split("_"))


def unknown_key(key: str, value: object, fields: Sequence[Field], known: Sequence[str]) -> tuple[str, str | None]:
    """(hint, the key that was probably meant or None) for a key that the section does not have.

    `known` are the declared keys that the file does not give yet: what is given already was not meant.
    """
    field = same_quantity(key, [field for field in fields if field.name in known])
    if field is not None:
        converted = _converted(key, value, field.name)
        return f"did you mean '{field.name}{converted}'? this key wants {field.unit}", field.name
    close = closest(key, known)
    if close is None:
        inside = next((f.name for f in fields if key in _keys_inside(f)), None)
        if inside is not None:
            return f"it belongs under '{inside}:'; indent it further", None
    return near(key, known), close


def _converted(key: str, value: object, name: str) -> str:
    """ ": 10668" for `altitude_ft: 35000` where `altitude_m` is wanted; empty where units are not known."""
    given, wanted = split_column(key)[1], split_column(name)[1]
    if not isinstance(value, (int, float)) or isinstance(value, bool) or not given or not wanted:
        return ""
    try:
        # a temperature may be a point or a difference; only the reader knows which
        if find_unit(wanted).dimension == "temperature":
            return ""
        return f": {convert(float(value), given, wanted):.6g}"
    except UnitError:
        return ""


def _keys_inside(field: Field) -> tuple[str, ...]:

    if field.kind == "section" and isinstance(field.section, Section):
        return tuple(inner.name for inner in field.section.fields)
    return ()


LONGEST_NUMBER = 60
"""Characters beyond which nobody has meant a number: a float has 17 digits, sign, point and exponent."""


def not_a_number(text: str, unit: str) -> str:
    """Why a text is not a number: decimal comma, unit after the number, percent sign, digit groups."""
    plain = text.strip()
    if len(plain) > LONGEST_NUMBER:  # the patterns below take quadratic time, and say nothing about such a text
        return f"give a number{_unit_phrase(unit)}"
    if re.fullmatch(r"[-+]?\d+,\d+", plain):
        return "write a decimal point instead of the comma"
    if re.fullmatch(r"[-+]?[\d.]+\s*%", plain):
        return f"write it without '%'{_unit_phrase(unit)}"
    if re.fullmatch(r"[-+]?\d{1,3}([_' ]\d{3})+(\.\d*)?", plain):
        return "write the digits without separators"
    if re.fullmatch(r"[-+]?(\d+\.?\d*|\.\d+)([eE][-+]?\d+)?", plain):
        return "remove the quotes"
    if re.match(r"^[-+]?(\d+\.?\d*|\.\d+)([eE][-+]?\d+)?\s*[A-Za-z°/]", plain):
        return f"write the number alone{_unit_phrase(unit)}; the key says the unit"
    return f"give a number{_unit_phrase(unit)}"


def _unit_phrase(unit: str) -> str:
    return f", in {unit}" if unit else ""


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
