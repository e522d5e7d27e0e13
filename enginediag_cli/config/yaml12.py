"""YAML 1.2 scalars on top of PyYAML, which resolves plain scalars by the rules of YAML 1.1.

By the 1.1 rules `1e5` is a text, `12:30` is 750, `014` is 12 and `no` is false, while every editor with a
YAML plug-in reads them as a number, a text, 14 and a text. Here the editor and the program agree:
YAML 1.2.2, section 10.3.2 (core schema).
"""

from __future__ import annotations

import math
import re
from typing import Any

import yaml

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
"""Characters of a document whose errors are told in the words of the Python parser, which reads 100,000 in a second."""

_DEEP_LINE = re.compile(rf"^[-?: \t]{{{MOST_DEPTH}}}", re.MULTILINE)
"""Block levels take a column each: indentation, or a mark of an item or a key on the same line."""
_BRACKET = re.compile(r"[\[\]{}]")


class TooManyValues(yaml.YAMLError):
    """A document has more values than MOST_VALUES."""


def refuse_bombs(text: str) -> None:
    """Raises RecursionError for a document that may be nested deeper than MOST_DEPTH, and TooManyValues for one that
    may have more than MOST_VALUES; what is in quotes or comments counts as well, which no honest file comes near."""
    openers = text.count("[") + text.count("{")
    if openers + sum(text.count(mark) for mark in (",", ":", "- ", "-\n", "? ", "*")) > MOST_VALUES:
        raise TooManyValues(f"more than {MOST_VALUES} values")
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
