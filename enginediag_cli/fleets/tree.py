"""Sums by a fixed binary tree: the same to the last digit in whatever order the parts come.

Node (level, i) is the sum of leaves i·2^level … (i + 1)·2^level − 1 in their order; where the right half of a node has
no leaves it is its left half. Memory holds the nodes whose other half has not come: as many as there are levels when
the leaves come in order.
"""

from __future__ import annotations

from typing import Generic, Protocol, TypeVar


class Adds(Protocol):
    """What can be added up."""

    def __add__(self: Sum, other: Sum, /) -> Sum: ...


Sum = TypeVar("Sum", bound=Adds)


class TreeSum(Generic[Sum]):
    """The sum of `leaves` values that `add` brings in any order; None stands for a leaf without a value."""

    def __init__(self, leaves: int):
        self._leaves, self._waiting = leaves, dict[tuple[int, int], Sum | None]()
        self._done: Sum | None = None

    def add(self, number: int, value: Sum | None) -> None:
        """Bring leaf `number`, from 0, once."""
        level, size = 0, 1
        while size < self._leaves:
            sibling = number ^ 1
            if sibling * size < self._leaves:  # else there is no right half
                key = (level, sibling)
                if key not in self._waiting:
                    self._waiting[level, number] = value
                    return
                other = self._waiting.pop(key)
                left, right = (value, other) if number < sibling else (other, value)
                value = right if left is None else left if right is None else left + right
            number, level, size = number // 2, level + 1, 2 * size
        self._done = value

    @property
    def total(self) -> Sum | None:
        """The sum, once all leaves have come; None where none has a value."""
        return self._done


def tree_sum(values: list[Sum]) -> Sum | None:
    """The sum of values that are there already, by the same tree."""
    tree = TreeSum[Sum](len(values))
    for number, value in enumerate(values):
        tree.add(number, value)
    return tree.total
