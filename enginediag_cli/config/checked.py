"""What validation hands over: the values, and where each of them stands."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from enginediag_cli.config.document import Node
from enginediag_cli.errors import Mark, Problem


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

    def given(self, path: tuple[str | int, ...]) -> bool:
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
