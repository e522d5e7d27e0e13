"""Validation: a document is checked against the fields that its kind of file declares, and defaults are filled in.

All problems of a file are found in one pass and raised together. Defaults have the form of a given value, so that
nothing downstream distinguishes the two. The result, `Checked`, has the values and the place of each of them.

`FILE_KINDS` lists the kinds of YAML file and where the code that declares each of them is. Declarations are imported
when a file of their kind is read. A new kind of file is one entry there.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from importlib import import_module
from pathlib import Path
from typing import Any

from enginediag_cli.config.document import Node, document_problems, load_document
from enginediag_cli.config.fields import (
    NAME,
    AnySection,
    Either,
    Field,
    Section,
    Variants,
    near,
    not_a_number,
    plain,
    unknown_key,
)
from enginediag_cli.errors import MOST_PROBLEMS, ConfigError, Mark, Problem
from enginediag_cli.safe_text import shortened

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


def scalar_map(node: Node, field: Field, where: str, report: Report) -> dict[str, Any]:
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
    "any_map": scalar_map,
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


FLOATS = ("number", "numbers", "range", "number_map")


def default_value(field: Field) -> Any:
    """Fresh lists and dicts, floats where the field holds numbers, sections with the defaults of their own
    fields. None for a required field: it has no default, and its absence is a problem already reported."""
    if field.required:
        return None
    if field.kind == "section" and isinstance(field.default, Mapping) and field.section is not None:
        return _filled(field.section, field.default)
    return plain(field.default, floats=field.kind in FLOATS)


def _filled(section: AnySection, given: Mapping[str, Any]) -> dict[str, Any]:
    if isinstance(section, Variants):
        chosen = section.options.get(str(given.get(section.key)))
        head = {section.key: given[section.key]} if section.key in given else {}
        return head | (_filled(chosen, given) if chosen is not None else plain(given))
    if isinstance(section, Either):
        known = section.choose(given)
        return _filled(known, given) if known is not None else dict(plain(given))
    return {field.name: _value_or_default(field, given) for field in section.fields}


def _value_or_default(field: Field, given: Mapping[str, Any]) -> Any:
    if field.name not in given:
        return default_value(field)
    value = given[field.name]
    if field.kind == "section" and isinstance(value, Mapping) and field.section is not None:
        return _filled(field.section, value)
    return plain(value, floats=field.kind in FLOATS)


@dataclass(frozen=True)
class Checked:
    """A validated file: `values` is a plain nested dict with the defaults filled in.

    A path into it is a tuple of keys, list positions, or names of `named_sections`:
    `("components", "hpc", "shaft")` and `("components", 3, "shaft")` are the same place.
    """

    values: dict[str, Any]
    node: Node

    @property
    def file(self) -> str:
        return self.node.mark.file

    def mark(self, path: tuple[str | int, ...] = ()) -> Mark:
        """Where the value stands; for a value that a default supplied, where its section stands."""
        return _walk(self.node, path)[1]

    def key_mark(self, path: tuple[str | int, ...]) -> Mark:
        """Where the key of a value stands; as `mark` for list items and defaults."""
        parent, place = _walk(self.node, path[:-1])
        if parent is None:
            return place
        key = str(path[-1])
        return parent.key_marks[key] if parent.is_mapping and key in parent.key_marks else self.mark(path)

    def is_given(self, path: tuple[str | int, ...]) -> bool:
        """Whether the file itself gives this value (a default is not given)."""
        return _walk(self.node, path)[0] is not None

    def problem(self, path: tuple[str | int, ...], message: str, hint: str = "") -> Problem:
        """A problem at the place of a value, for checks that need more than one value to see it."""
        return Problem(self.mark(path), message, hint)


def _walk(node: Node, path: tuple[str | int, ...]) -> tuple[Node | None, Mark]:
    """(the node at the path or None, the mark of the deepest node on the way to it)."""
    for step in path:
        child = _child(node, step)
        if child is None:
            return None, node.mark
        node = child
    return node, node.mark


def _child(node: Node, step: str | int) -> Node | None:
    if node.is_mapping:
        return node.value.get(str(step))
    if not node.is_list:
        return None
    if isinstance(step, int):
        return node.value[step] if -len(node.value) <= step < len(node.value) else None
    named = (item for item in node.value if item.is_mapping and "name" in item.value)
    return next((item for item in named if item.value["name"].value == step), None)


def validate(document: Node, section: AnySection) -> Checked:
    """Check a document against a declaration, and fill in the defaults.

    Lists and ranges become lists, numbers floats, mappings dicts. An optional key whose default is None may be empty.

    Parameters
    ----------
    document : Node
    section : Section, Variants or Either

    Returns
    -------
    Checked

    Raises
    ------
    ConfigError
        With every problem, in the order of the file.
    """
    walk = _Validator(list(document_problems(document)))
    values = walk.mapping(document, section, "")
    if walk.problems:
        raise ConfigError(sorted(walk.problems, key=lambda p: (p.mark.line, p.mark.column)))
    return Checked(values, document)


HINTS = 4 * MOST_PROBLEMS
"""Unknown keys for which a near name is sought; sections are not walked in the order of the file, hence more than are
reported."""


@dataclass
class _Validator:
    problems: list[Problem]
    hints: int = HINTS

    def report(self, mark: Mark, message: str, hint: str = "") -> None:
        self.problems.append(Problem(mark, message, hint))

    def mapping(self, node: Node, section: AnySection, where: str, named: bool = False) -> dict[str, Any]:
        """`where` is the dotted path for messages; `named` mappings have a `name:` besides their fields."""
        if not node.is_mapping:
            self.report(
                node.mark,
                f"{where or 'the file'} must be a mapping of keys, not {node.describe()}",
                "a space is missing after ':'" if _lacks_space(node) else section.help,
            )
            return {}
        extra = [NAME] if named else []
        if isinstance(section, Either):
            known = section.choose(node.value)
            if known is None:
                what = f"one of {', '.join(section.options)} says what it is{_inside(where)}"
                self.report(node.mark, what, f"there must be exactly one of them: {section.help}")
                return {}
            section = known
        if isinstance(section, Variants):
            chosen = self._variant(node, section, where)
            if chosen is None:
                return {}
            extra.append(_type_field(section))
            section = chosen
        declared = {field.name for field in section.fields}
        fields = [field for field in extra if field.name not in declared] + list(section.fields)
        replaced = self._unknown_keys(node, fields, where)
        values: dict[str, Any] = {}
        for field in fields:
            child = node.value.get(field.name)
            if child is None:
                if field.required and field.name not in replaced:
                    self.report(node.mark, f"missing key '{field.name}'{_inside(where)}", expectation(field))
                values[field.name] = default_value(field)
            elif child.value is None and field.default is None:
                values[field.name] = None
            else:
                values[field.name] = self.value(child, field, f"{where}.{field.name}".lstrip("."))
        return values

    def value(self, node: Node, field: Field, where: str) -> Any:
        """One value by its field's kind; None once a problem is reported."""
        if node.value is None:
            self.report(node.mark, f"{where} is empty", expectation(field))
            return None
        leaf = LEAVES.get(field.kind)
        if leaf is not None:
            return leaf(node, field, where, self.report)
        assert field.section is not None, f"field '{field.name}' of kind {field.kind} declares no section"
        if field.kind == "section":
            return self.mapping(node, field.section, where)
        if field.kind == "section_map":
            return self._section_map(node, field, field.section, where)
        return self._sections(node, field, field.section, where)

    def _sections(self, node: Node, field: Field, section: AnySection, where: str) -> list[Any]:
        named = field.kind == "named_sections"
        if not node.is_list:
            hint = "begin each entry with '- '" if node.is_mapping else field.help
            self.report(node.mark, f"{where} must be a list, not {node.describe()}", hint)
            return []
        values = []
        places: dict[str, Mark] = {}
        for position, item in enumerate(node.value):
            name = _entry_name(item) if named else None
            inside = f"{where}.{name}" if name else f"{where}[{position}]"
            values.append(self.mapping(item, section, inside, named))
            if name is None:
                continue
            if name in places:
                first = places[name]
                self.report(
                    item.value["name"].mark,
                    f"the name '{name}' is used twice in {where}",
                    f"first at {first.file}:{first.line}:{first.column}; names must differ",
                )
            else:
                places[name] = item.value["name"].mark
        return values

    def _section_map(self, node: Node, field: Field, section: AnySection, where: str) -> dict[str, Any]:
        if not node.is_mapping:
            self.report(node.mark, f"{where} must be a mapping of names, not {node.describe()}", field.help)
            return {}
        return {name: self.mapping(child, section, f"{where}.{name}") for name, child in node.value.items()}

    def _variant(self, node: Node, variants: Variants, where: str) -> Section | None:
        chooser = node.value.get(variants.key)
        if chooser is None:
            self.report(node.mark, f"missing key '{variants.key}'{_inside(where)}", near("", variants.options))
            return None
        if not isinstance(chooser.value, str):
            self.report(
                chooser.mark,
                f"{variants.key}{_inside(where)} must be a name, not {chooser.describe()}",
                near("", variants.options),
            )
            return None
        if chooser.value not in variants.options:
            self.report(
                chooser.mark,
                f"unknown {variants.key} '{chooser.value}'{_inside(where)}",
                near(chooser.value, variants.options),
            )
            return None
        return variants.options[chooser.value]

    def _unknown_keys(self, node: Node, fields: list[Field], where: str) -> set[str]:
        """Report keys that are not declared; returns the declared keys that they probably stand for."""
        names = [field.name for field in fields]
        free = [name for name in names if name not in node.value]
        replaced = set()
        for key in node.value:
            if key in names:
                continue
            hint, meant = "", None
            if self.hints:  # beyond what will be reported, the search for near names would only cost time
                self.hints -= 1
                hint, meant = unknown_key(key, node.value[key].value, fields, free or names)
            self.report(node.key_marks[key], f"unknown key '{shortened(key)}'{_inside(where)}", hint)
            if meant is not None:
                replaced.add(meant)
        return replaced


def _type_field(variants: Variants) -> Field:
    return Field(variants.key, "choice", variants.help, choices=tuple(variants.options))


def _entry_name(item: Node) -> str | None:
    name = item.value.get("name") if item.is_mapping else None
    return name.value if name is not None and isinstance(name.value, str) else None


def _inside(where: str) -> str:
    return f" in {where}" if where else ""


def _lacks_space(node: Node) -> bool:
    return isinstance(node.value, str) and ":" in node.value.strip(":") and " " not in node.value


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
            "alerts",
            "alert levels of deltas over flights: caution, warning, and how long they must last",
            "enginediag_cli.history.deltas:ALERTS_FILE",
            "enginediag_cli.history.deltas:load_alerts",
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

    Parameters
    ----------
    path : path
    kind : str
        A key of ``FILE_KINDS``.

    Returns
    -------
    Checked

    Raises
    ------
    ConfigError
        With every problem of the file, or with the one problem that it is of another kind.
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
