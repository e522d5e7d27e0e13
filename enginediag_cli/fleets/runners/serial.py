"""The work of a fleet in this process, one task after the other."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator

from enginediag_cli.fleets.runners.runner import Result, Task


class Serial:
    """One worker: this process."""

    workers = 1

    def run(self, work: Callable[[Task], Result], tasks: Iterable[Task]) -> Iterator[tuple[int, Result]]:
        """As `Runner.run`, in order."""
        for number, task in enumerate(tasks):
            yield number, work(task)

    def close(self) -> None:
        """There is nobody to let go."""
