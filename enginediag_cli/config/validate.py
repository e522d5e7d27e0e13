"""Checks a document against the declared fields of its section and fills in the defaults.

All problems of a file are found in one pass and raised together.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from enginediag_cli.config.checked import Checked
from enginediag_cli.config.defaults import default_value
from enginediag_cli.config.document import Node, document_problems
from enginediag_cli.config.excerpt import render
from enginediag_cli.config.fields import AnySection, Either, Field, Section, Variants
from enginediag_cli.config.hints import near, unknown_key
from enginediag_cli.config.leaves import LEAVES, expectation
from enginediag_cli.errors import MOST_PROBLEMS, ConfigError, Mark, Problem
from enginediag_cli.safe_text import shortened

__all__ = ["Checked", "near", "render", "validate"]


def validate(document: Node, section: AnySection) -> Checked:
    """The values of a document, defaults filled in.

    Lists and ranges become lists, numbers floats, mappings dicts; an optional key whose default is None may
    also be left empty. Raises ConfigError with every problem, in the order of the file.
    """
    walk = _Walk(list(document_problems(document)))
    values = walk.mapping(document, section, "")
    if walk.problems:
        raise ConfigError(sorted(walk.problems, key=lambda p: (p.mark.line, p.mark.column)))
    return Checked(values, document)


HINTS = 4 * MOST_PROBLEMS
"""Unknown keys for which a near name is sought; sections are not walked in the order of the file, hence more than are
told."""


@dataclass
class _Walk:
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
            known = section.of(node.value)
            if known is None:
                told = f"one of {', '.join(section.options)} says what it is{_in(where)}"
                self.report(node.mark, told, f"there must be exactly one of them: {section.help}")
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
                    self.report(node.mark, f"missing key '{field.name}'{_in(where)}", expectation(field))
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
            name = _name_of(item) if named else None
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
            self.report(node.mark, f"missing key '{variants.key}'{_in(where)}", near("", variants.options))
            return None
        if not isinstance(chooser.value, str):
            self.report(
                chooser.mark,
                f"{variants.key}{_in(where)} must be a name, not {chooser.describe()}",
                near("", variants.options),
            )
            return None
        if chooser.value not in variants.options:
            self.report(
                chooser.mark,
                f"unknown {variants.key} '{chooser.value}'{_in(where)}",
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
            if self.hints:  # beyond what will be told, the search for near names would only cost time
                self.hints -= 1
                hint, meant = unknown_key(key, node.value[key].value, fields, free or names)
            self.report(node.key_marks[key], f"unknown key '{shortened(key)}'{_in(where)}", hint)
            if meant is not None:
                replaced.add(meant)
        return replaced


NAME = Field("name", "text", "name by which other parts of the file refer to this one")


def _type_field(variants: Variants) -> Field:
    return Field(variants.key, "choice", variants.help, choices=tuple(variants.options))


def _name_of(item: Node) -> str | None:
    name = item.value.get("name") if item.is_mapping else None
    return name.value if name is not None and isinstance(name.value, str) else None


def _in(where: str) -> str:
    return f" in {where}" if where else ""


def _lacks_space(node: Node) -> bool:
    return isinstance(node.value, str) and ":" in node.value.strip(":") and " " not in node.value
