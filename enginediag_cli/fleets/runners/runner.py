"""What every place does that can work for a fleet.

The work of a fleet in this process, one task after the other.

The work of a fleet in several processes of this machine.

Which place works, by what the user asks for.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import FIRST_COMPLETED, Future, ProcessPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager
from itertools import islice
from typing import Protocol, TypeVar

from enginediag_cli.errors import WorkerDiedError
from enginediag_cli.worker_pool import single_threaded, worker_pool

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


class Serial:
    """One worker: this process."""

    workers = 1

    def run(self, work: Callable[[Task], Result], tasks: Iterable[Task]) -> Iterator[tuple[int, Result]]:
        """As `Runner.run`, in order."""
        for number, task in enumerate(tasks):
            yield number, work(task)

    def close(self) -> None:
        """There is nobody to let go."""


DEATHS = 3
"""Times that a process may be ended from outside before the run ends: what kills a worker kills the next one, too."""


class Processes:
    """So many processes, which live until `close`. What was in work when one of them died is done again."""

    def __init__(self, workers: int):
        self.workers = workers
        self._pool: ProcessPoolExecutor | None = None
        self._deaths = 0

    def run(self, work: Callable[[Task], Result], tasks: Iterable[Task]) -> Iterator[tuple[int, Result]]:
        """As `Runner.run`. Raises WorkerDiedError."""
        waiting = enumerate(tasks)
        again: list[tuple[int, Task]] = []
        at_work: dict[Future[Result], tuple[int, Task]] = {}
        try:
            while True:
                try:
                    self._fill(work, waiting, again, at_work)
                    if not at_work:
                        return
                    done, _ = wait(at_work, return_when=FIRST_COMPLETED)
                    for future in sorted(done, key=lambda f: at_work[f][0]):
                        result = future.result()
                        yield at_work.pop(future)[0], result
                except BrokenProcessPool:
                    again = sorted([*again, *at_work.values()], key=lambda numbered: numbered[0])
                    at_work.clear()
                    self._replace()
        finally:
            for future in at_work:
                future.cancel()

    def _fill(
        self,
        work: Callable[[Task], Result],
        waiting: Iterator[tuple[int, Task]],
        again: list[tuple[int, Task]],
        at_work: dict[Future[Result], tuple[int, Task]],
    ) -> None:
        pool = self._opened()
        while len(at_work) < IN_WORK * self.workers:
            if not again:
                again.extend(islice(waiting, 1))
            if not again:
                return
            with single_threaded():  # processes begin when there is work for them
                future = pool.submit(work, again[0][1])  # a broken pool refuses it, and it is still there
            at_work[future] = again.pop(0)

    def _opened(self) -> ProcessPoolExecutor:
        if self._pool is None:
            self._pool = worker_pool(self.workers)
        return self._pool

    def _replace(self) -> None:
        self._deaths += 1
        if self._deaths >= DEATHS:
            raise WorkerDiedError(
                f"a worker process was ended from outside {self._deaths} times, perhaps because memory ran out; what "
                "was condensed is kept with --store; use fewer --jobs"
            ) from None
        self.close()

    def close(self) -> None:
        """Let the processes go when they have finished what is in work."""
        if self._pool is not None:
            self._pool.shutdown(wait=True, cancel_futures=True)
            self._pool = None


@contextmanager
def runner_for(jobs: int, scheduler: str = "") -> Iterator[Runner]:
    """This process for one job, so many processes, or the cluster of a Dask scheduler. Raises DataError."""
    runner: Runner
    if scheduler:
        from enginediag_cli.fleets.runners.on_dask import OnDask

        runner = OnDask(scheduler)
    elif jobs == 1:
        runner = Serial()
    else:
        runner = Processes(jobs)
    try:
        yield runner
    finally:
        runner.close()
