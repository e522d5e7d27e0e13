"""What every place does that can work for a fleet."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from typing import Protocol, TypeVar

Task = TypeVar("Task")
Result = TypeVar("Result")

IN_WORK = 4
"""Tasks per worker that are handed out at a time: enough that none waits, few enough that memory does not grow with
the fleet."""


class Runner(Protocol):
    """A place to work. `work`, tasks and results must be picklable."""

    @property
    def workers(self) -> int:
        """How many tasks are done at a time."""

    def run(self, work: Callable[[Task], Result], tasks: Iterable[Task]) -> Iterator[tuple[int, Result]]:
        """Number, from 0, and result of each task as it is finished, in any order; tasks are taken as there is room
        for them. Raises what `work` raises."""

    def close(self) -> None:
        """Let the workers go."""
