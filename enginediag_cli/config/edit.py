"""Changes to the text of a YAML file that leave the rest of it, comments and all, as it stands.

Writes values as YAML that this program and readers of YAML 1.1 understand alike.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import yaml

from enginediag_cli.config.document import Loader, Node, parse_document
from enginediag_cli.errors import DataError


def appended(text: str, name: str, key: str, entries: Sequence[Sequence[str]]) -> str:
    """The text with entries, lines of list items indented by two, at the end of the list under a top-level key, which
    is made where there is none. `name`: of the file, for messages. Raises ConfigError for text that is not YAML,
    DataError for a list in brackets."""
    lines, root = text.splitlines(), parse_document(text, name)
    block = root.value.get(key)
    if block is None or not block.is_list or not block.value:
        if block is not None:  # `key: []`, or nothing behind it
            start, end = extent(root, key, len(lines))
            del lines[start:end]
        while lines and not lines[-1].strip():
            lines.pop()
        return "\n".join([*lines, "", f"{key}:", *(line for e in entries for line in e)]) + "\n"
    start, end = extent(root, key, len(lines))
    if "[" in lines[start].partition("#")[0]:
        raise DataError(f"{name}:{start + 1}: write the list under `{key}:` with a `- ` for each entry, and try again")
    while end > start + 1 and (not lines[end - 1].strip() or lines[end - 1].startswith("#")):
        end -= 1  # what stands above the next key belongs to it
    indent = " " * (block.value[0].mark.column - 1 - 2)
    added = [indent + line[2:] for e in entries for line in e]
    return "\n".join([*lines[:end], *added, *lines[end:]]) + "\n"


def with_item(text: str, place: Node, item: str) -> str:
    """The text with one more scalar behind the last one of a list."""
    last = place.value[-1]
    lines = text.splitlines()
    k, column = last.mark.line - 1, last.mark.column - 1
    before = lines[k][:column]
    if before.strip() == "-":
        lines.insert(k + 1, before + item)
    else:
        end = column + len(last.text)
        lines[k] = f"{lines[k][:end]}, {item}{lines[k][end:]}"
    return "\n".join(lines) + "\n"


def with_key(text: str, mapping: Node, behind: str, entry: str) -> str:
    """The text with one more `key: value` in a mapping, behind its key `behind`, whose value is a scalar."""
    value, mark = mapping.value[behind], mapping.key_marks[behind]
    lines = text.splitlines()
    k = value.mark.line - 1
    end = value.mark.column - 1 + len(value.text)
    line = lines[k]
    if line[end : end + 1] in ('"', "'"):
        end += 1
    rest = line[end:].lstrip()
    if rest.startswith((",", "}")):
        lines[k] = f"{line[:end]}, {entry}{line[end:]}"
    else:
        lines.insert(k + 1, " " * (mark.column - 1) + entry)
    return "\n".join(lines) + "\n"


def extent(root: Node, key: str, total: int) -> tuple[int, int]:
    """Lines [start, end) of a key of the file and all that stands below it, counted from 0."""
    starts = sorted(mark.line - 1 for mark in root.key_marks.values())
    start = root.key_marks[key].line - 1
    return start, next((s for s in starts if s > start), total)


class Dumper(yaml.SafeDumper):
    """Quotes every text that YAML 1.1 or 1.2 would read as something else: `no`, `1e5`, `0o14`."""


for _resolvers in Loader.yaml_implicit_resolvers.values():
    for _tag, _pattern in _resolvers:
        Dumper.add_implicit_resolver(_tag, _pattern, None)


def dump(values: Mapping[str, Any], width: int = 110) -> str:
    """YAML text of plain values, keys in their order, lists of scalars on one line.

    Floats have the shortest digits that give the same float back. The text is loaded by `load_document`.
    """
    return str(
        yaml.dump(
            dict(values), Dumper=Dumper, sort_keys=False, allow_unicode=True, width=width, default_flow_style=None
        )
    )
