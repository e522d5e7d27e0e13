"""YAML in and out: files read into nodes with their place, values written, and texts edited in place.

Plain scalars follow YAML 1.2 (section 10.3.2, core schema) on top of PyYAML, which follows YAML 1.1. By the 1.1 rules
`1e5` is a text, `12:30` is 750, `014` is 12 and `no` is false; editors with a YAML plug-in read a number, a text, 14
and a text. Here the editor and the program agree.
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import yaml

from enginediag_cli.config.files import read_regular
from enginediag_cli.errors import ConfigError, DataError, Mark, Problem
from enginediag_cli.safe_text import shortened

TAG = "tag:yaml.org,2002:"

NULL = re.compile(r"^(?:~|null|Null|NULL|)$")
BOOLEAN = re.compile(r"^(?:true|True|TRUE|false|False|FALSE)$")
INTEGER = re.compile(r"^(?:[-+]?[0-9]+|0o[0-7]+|0x[0-9a-fA-F]+)$")
FLOAT = re.compile(
    r"^(?:[-+]?(?:\.[0-9]+|[0-9]+(?:\.[0-9]*)?)(?:[eE][-+]?[0-9]+)?"
    r"|[-+]?\.(?:inf|Inf|INF)|\.(?:nan|NaN|NAN))$"
)


class Loader(yaml.SafeLoader):
    """A SafeLoader whose plain scalars follow YAML 1.2; only its `get_single_node` is used."""


Loader.yaml_implicit_resolvers = {}  # those of YAML 1.1 are inherited otherwise

for _kind, _pattern, _first in (
    ("null", NULL, ["~", "n", "N", ""]),
    ("bool", BOOLEAN, list("tTfF")),
    ("int", INTEGER, list("-+0123456789")),
    ("float", FLOAT, list("-+.0123456789")),
):
    Loader.add_implicit_resolver(TAG + _kind, _pattern, _first)

FastLoader: type[yaml.CSafeLoader] | None = None
"""The same on libyaml, ten times as fast, where PyYAML was built with it."""

if yaml.__with_libyaml__:

    class _FastLoader(yaml.CSafeLoader):
        pass

    _FastLoader.yaml_implicit_resolvers = Loader.yaml_implicit_resolvers
    FastLoader = _FastLoader

MOST_DEPTH = 1000
"""Levels of nesting beyond which a document is refused unread; the deepest files here have ten. libyaml recurses in C
and overflows the stack near 30,000 levels."""
MOST_VALUES = 1_000_000
"""Values of a document, each of which takes some 200 bytes when it is read; the largest files here have a tenth."""
MOST_QUOTED = 500_000
"""Characters of a document whose errors are those of the Python parser, which reads 100,000 in a second."""

_DEEP_LINE = re.compile(rf"^[-?: \t]{{{MOST_DEPTH}}}", re.MULTILINE)
"""Block levels take a column each: indentation, or a mark of an item or a key on the same line."""
_BRACKET = re.compile(r"[\[\]{}]")


class ValueCountError(yaml.YAMLError):
    """A document has more values than MOST_VALUES."""


def refuse_bombs(text: str) -> None:
    """Raises RecursionError for a document that may be nested deeper than MOST_DEPTH, and ValueCountError for one that
    may have more than MOST_VALUES; what is in quotes or comments counts as well, which no honest file comes near."""
    openers = text.count("[") + text.count("{")
    if openers + sum(text.count(mark) for mark in (",", ":", "- ", "-\n", "? ", "*")) > MOST_VALUES:
        raise ValueCountError(f"more than {MOST_VALUES} values")
    depth = 0
    for bracket in _BRACKET.finditer(text) if openers > MOST_DEPTH else ():
        depth = depth + 1 if bracket.group() in "[{" else max(depth - 1, 0)
        if depth > MOST_DEPTH:
            raise RecursionError("brackets are nested too deeply")
    if _DEEP_LINE.search(text):
        raise RecursionError("indentation is nested too deeply")


def compose(text: str) -> yaml.Node | None:
    """PyYAML's tree of a document, None for an empty one.

    Raises yaml.YAMLError, for a short document from the Python parser, whose messages and marks are the same on every
    machine, and what `refuse_bombs` raises.
    """
    refuse_bombs(text)
    if FastLoader is not None:
        try:
            return _single_node(FastLoader(text))
        except yaml.YAMLError:
            if len(text) > MOST_QUOTED:
                raise
    return _single_node(Loader(text))


def _single_node(loader: yaml.SafeLoader | yaml.CSafeLoader) -> yaml.Node | None:
    try:
        node: yaml.Node | None = loader.get_single_node()
        return node
    finally:
        loader.dispose()


def scalar_value(tag: str, text: str) -> Any:
    """The Python value of a scalar with a resolved tag.

    Raises ValueError if the text does not have the form that the tag asks for (`!!int abc`) or the tag is
    not one of the core schema's.
    """
    kind = tag.removeprefix(TAG)
    if kind == "str":
        return text
    if kind == "float" and FLOAT.match(text):
        return _float(text)
    if kind == "null" and NULL.match(text):
        return None
    if kind == "bool" and BOOLEAN.match(text):
        return text.lower() == "true"
    if kind == "int" and INTEGER.match(text):
        return _integer(text)
    raise ValueError(f"'{text}' cannot be read with the tag '{tag.replace(TAG, '!!')}'")


def _integer(text: str) -> int | float:
    if text.startswith("0o"):
        return int(text[2:], 8)
    if text.startswith("0x"):
        return int(text[2:], 16)
    # Python refuses to convert thousands of digits to int; no quantity has them, so infinity is said instead
    return int(text) if len(text) < 400 else math.copysign(math.inf, -1.0 if text[0] == "-" else 1.0)


def _float(text: str) -> float:
    if text[-1] not in "fFnN":  # of .inf and .nan
        return float(text)
    if text.lower().endswith("nan"):
        return math.nan
    return -math.inf if text[0] == "-" else math.inf


SHOWN_KEYS = 20
"""Keys of a mapping that are named in a message before the rest is only counted."""


@dataclass(frozen=True)
class Node:
    """One value of a document and where it stands.

    `value` is the Python value of a scalar, the tuple of child nodes of a list, and the dict of child nodes
    (in the order of the file) of a mapping, whose keys are at `key_marks`. Keys are text as written.
    """

    value: Any
    mark: Mark
    text: str = ""
    key_marks: Mapping[str, Mark] = field(default_factory=dict)
    problems: tuple[Problem, ...] = ()

    @property
    def is_mapping(self) -> bool:
        return isinstance(self.value, dict)

    @property
    def is_list(self) -> bool:
        return isinstance(self.value, tuple)

    @property
    def is_scalar(self) -> bool:
        return not isinstance(self.value, (dict, tuple))

    def describe(self) -> str:
        """What stands here, in words: "the text 'abc'", "the number 3", "a list of 2"."""
        if self.is_mapping:
            if not self.value:
                return "an empty mapping"
            rest = f", … ({len(self.value)} in all)" if len(self.value) > SHOWN_KEYS else ""
            return (
                "a mapping with the keys " + ", ".join(shortened(key) for key in list(self.value)[:SHOWN_KEYS]) + rest
            )
        if self.is_list:
            return f"a list of {len(self.value)}" if self.value else "an empty list"
        if self.value is None:
            return "nothing"
        if isinstance(self.value, str):
            return f"the text '{shortened(self.value)}'"
        return f"{'' if isinstance(self.value, bool) else 'the number '}{shortened(self.text)}"


def load_document(path: str | Path) -> Node:
    """Read a YAML file into nodes with their places.

    Parameters
    ----------
    path : path

    Returns
    -------
    Node
        The root.

    Raises
    ------
    ConfigError
        If the file cannot be read, is no regular file, is larger than ``MOST_YAML_BYTES``, or is not YAML.
    """
    name = str(path)
    return parse_document(_decode(read_regular(path), name), name)


def parse_document(text: str, name: str) -> Node:
    """The root node of YAML text; `name` is that of the marks. Raises ConfigError as `load_document`."""
    try:
        tree = compose(text)
        if tree is None:
            raise ConfigError(
                [
                    Problem(
                        Mark(name, 1, 1),
                        "the file is empty",
                        "it should open with 'kind: …', which says what it describes",
                    )
                ]
            )
        return _Builder(name).node(tree)
    except yaml.reader.ReaderError as error:
        before = text[: error.position]
        mark = Mark(name, before.count("\n") + 1, error.position - (before.rfind("\n") + 1) + 1)
        what = f"the control character U+{_code(error.character):04X} is not allowed in YAML"
        raise ConfigError([Problem(mark, what)]) from error
    except yaml.MarkedYAMLError as error:
        raise ConfigError([_syntax_problem(error, text, name)]) from error
    except ValueCountError as error:
        raise ConfigError([Problem(Mark(name), f"the file has {error}, which no file of this kind has")]) from error
    except RecursionError as error:
        raise ConfigError([Problem(Mark(name), "brackets or indentation are nested too deeply")]) from error


def document_problems(root: Node) -> Iterator[Problem]:
    """Duplicate keys, foreign tags and the like, over the whole document, each node once."""
    seen: set[int] = set()
    waiting = [root]
    while waiting:
        node = waiting.pop()
        if id(node) in seen:
            continue
        seen.add(id(node))
        yield from node.problems
        if not node.is_scalar:
            waiting.extend(node.value.values() if node.is_mapping else node.value)


class _Builder:
    """Turns PyYAML's nodes into ours; an aliased node becomes one node, seen from several places."""

    def __init__(self, name: str):
        self.name = name
        self.built: dict[int, Node] = {}
        self.open: set[int] = set()

    def node(self, source: yaml.Node) -> Node:
        known = self.built.get(id(source))
        if known is not None:
            return known
        mark = self._mark(source.start_mark)
        if isinstance(source, yaml.ScalarNode):  # thousands of numbers, which hold nothing that could be open
            built = self.built[id(source)] = self._scalar(source, mark)
            return built
        if id(source) in self.open:
            return Node(None, mark, problems=(Problem(mark, "this anchor contains an alias to itself"),))
        self.open.add(id(source))
        if isinstance(source, yaml.MappingNode):
            built = self._mapping(source, mark)
        else:
            built = Node(
                tuple(self.node(item) for item in source.value), mark, problems=self._tag_problems(source, "seq", mark)
            )
        self.open.discard(id(source))
        self.built[id(source)] = built
        return built

    def _mapping(self, source: yaml.MappingNode, mark: Mark) -> Node:
        children: dict[str, Node] = {}
        marks: dict[str, Mark] = {}
        problems = list(self._tag_problems(source, "map", mark))
        for key_node, value_node in source.value:
            place = self._mark(key_node.start_mark)
            if not isinstance(key_node, yaml.ScalarNode):
                problems.append(Problem(place, "a key must be a text, not a list or a mapping"))
                continue
            key = key_node.value
            if key == "<<" and not key_node.style:  # plain: None in one parser, "" in the other
                problems.append(
                    Problem(
                        place,
                        "merge keys '<<' are not part of YAML 1.2",
                        "write the keys out, or use an alias for a whole value",
                    )
                )
            elif key in marks:
                first = marks[key]
                problems.append(
                    Problem(
                        place,
                        f"key '{key}' is given twice",
                        f"first given at {first.file}:{first.line}:{first.column}; keep one of them",
                    )
                )
            else:
                child = self.node(value_node)
                # nothing stands nowhere, and the parsers disagree where: at the key, for both
                nothing = child.value is None and not child.text
                children[key], marks[key] = replace(child, mark=place) if nothing else child, place
        return Node(children, mark, key_marks=marks, problems=tuple(problems))

    def _scalar(self, source: yaml.ScalarNode, mark: Mark) -> Node:
        try:
            return Node(scalar_value(source.tag, source.value), mark, text=source.value)
        except ValueError as error:
            return Node(source.value, mark, text=source.value, problems=(Problem(mark, str(error)),))

    def _tag_problems(self, source: yaml.Node, kind: str, mark: Mark) -> tuple[Problem, ...]:
        if source.tag == TAG + kind:
            return ()
        tag = source.tag.replace(TAG, "!!")
        return (Problem(mark, f"the tag '{tag}' is not known here", "leave it out"),)

    def _mark(self, mark: yaml.Mark) -> Mark:
        return Mark(self.name, mark.line + 1, mark.column + 1)


def _decode(raw: bytes, name: str) -> str:
    if raw[:2] in (b"\xff\xfe", b"\xfe\xff"):
        raise ConfigError([Problem(Mark(name, 1, 1), "the file is UTF-16, not UTF-8", "save it as UTF-8")])
    try:
        return raw.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        start = raw.rfind(b"\n", 0, error.start) + 1
        column = len(raw[start : error.start].decode("utf-8", "replace").lstrip("\ufeff")) + 1
        mark = Mark(name, raw.count(b"\n", 0, error.start) + 1, column)
        byte = raw[error.start]
        hint = f"save the file as UTF-8; as Latin-1 this byte would be '{bytes([byte]).decode('latin-1')}'"
        raise ConfigError([Problem(mark, f"the byte 0x{byte:02x} is not UTF-8 text", hint)]) from error


def _code(character: Any) -> int:
    return character if isinstance(character, int) else ord(character)


def _syntax_problem(error: yaml.MarkedYAMLError, text: str, name: str) -> Problem:
    """PyYAML's complaint at its place, with the usual cause as hint."""
    found = error.problem_mark or error.context_mark
    mark = Mark(name, found.line + 1, found.column + 1) if found else Mark(name)
    what = error.problem or "not valid YAML"
    lines = text.splitlines()
    line = lines[mark.line - 1] if 0 < mark.line <= len(lines) else ""
    if "\t" in line[: mark.column] and ("\\t" in what or "tab" in what):
        return Problem(mark, "a tab stands where YAML wants spaces", "indent with spaces")
    hint = ""
    if "mapping values are not allowed" in what:
        hint = "put a text that contains ': ' in quotes, or check indentation and ':' of the line above"
    elif "could not find expected ':'" in what:
        hint = "a key is followed by ': '"
    elif "another document" in what:
        return Problem(mark, "a second document begins here", "one file holds one; remove the second '---'")
    elif "undefined alias" in what:
        hint = "define it first with '&', or put a text that begins with '*' in quotes"
    elif "quoted scalar" in (error.context or ""):
        hint = "a quote is opened and not closed"
    elif "flow sequence" in (error.context or "") or "flow mapping" in (error.context or ""):
        hint = "a bracket is opened and not closed, or a comma is missing"
    elif "cannot start any token" in what:
        hint = "put a text that begins with this character in quotes"
    elif "expected <block end>" in what:
        hint = "the indentation differs from that of the lines above"
    context = f"{error.context}: " if error.context and not hint else ""
    return Problem(mark, f"not valid YAML: {context}{what}", hint)


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


def insert_item(text: str, place: Node, item: str) -> str:
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


def insert_key(text: str, mapping: Node, behind: str, entry: str) -> str:
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
    for _tag, _resolver in _resolvers:
        Dumper.add_implicit_resolver(_tag, _resolver, None)


def dump(values: Mapping[str, Any], width: int = 110) -> str:
    """Write plain values as YAML text, keys in their order, lists of scalars on one line.

    Floats have the shortest digits that give the same float back.

    Parameters
    ----------
    values : mapping
    width : int
        Characters of a line.

    Returns
    -------
    str
        Text that `load_document` reads.
    """
    return str(
        yaml.dump(
            dict(values), Dumper=Dumper, sort_keys=False, allow_unicode=True, width=width, default_flow_style=None
        )
    )
