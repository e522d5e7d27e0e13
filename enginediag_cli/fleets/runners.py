"""What every place does that can work for a fleet.

The work of a fleet in this process, one task after the other.

The work of a fleet in several processes of this machine.

Which place works, by what the user asks for.

The work of a fleet on a Dask cluster that exists: one task per piece of work, which the cluster retries.

Only the scheduler is spoken to; recordings, nominal files and the store are files that the workers see under the same
paths.
"""

from __future__ import annotations

import asyncio
import threading
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import Future
from concurrent.futures import TimeoutError as FutureTimeoutError
from contextlib import contextmanager
from functools import partial
from itertools import islice
from typing import Any, Protocol, TypeVar

from enginediag_cli import __version__
from enginediag_cli.errors import DataError, EngineDiagError
from enginediag_cli.parallel import TASKS_PER_WORKER, ProcessPool

Task = TypeVar("Task")
Result = TypeVar("Result")

ADVICE = "what was condensed is kept with --store; use fewer --jobs"
"""Where worker processes keep dying."""


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


class SerialRunner:
    """One worker: this process."""

    workers = 1

    def run(self, work: Callable[[Task], Result], tasks: Iterable[Task]) -> Iterator[tuple[int, Result]]:
        """As `Runner.run`, in order."""
        for number, task in enumerate(tasks):
            yield number, work(task)

    def close(self) -> None:
        """There is nobody to let go."""


@contextmanager
def open_runner(jobs: int, scheduler: str = "") -> Iterator[Runner]:
    """This process for one job, so many processes, or the cluster of a Dask scheduler. Raises DataError."""
    runner: Runner
    if scheduler:
        runner = DaskRunner(scheduler)
    elif jobs == 1:
        runner = SerialRunner()
    else:
        runner = ProcessPool(jobs, ADVICE)
    try:
        yield runner
    finally:
        runner.close()


RETRIES = 1
"""Times that a task that failed is begun again, for what passes by itself, such as a file server out of reach. One
whose worker died is begun again by the cluster's own rule."""
CONNECT_S = 5
"""Seconds that a scheduler may take to answer, and its first worker to be there."""
KEPT = "what was condensed is kept with --store"
HINT = "pip install 'enginediag[fleet]'"


class DaskRunner:
    """The workers of the cluster whose scheduler is at `address`."""

    def __init__(self, address: str):
        """Raises DataError when nobody answers there, or Dask is not installed."""
        try:
            from distributed import Client
        except ImportError:
            raise DataError(f"--scheduler needs Dask, which is not installed: {HINT}, or work with --jobs") from None
        try:
            self._client: Any = _connect_in_time(partial(Client, address, timeout=CONNECT_S, set_as_default=False))
        except (OSError, ValueError, TimeoutError, asyncio.TimeoutError) as error:
            raise DataError(f"--scheduler {address}: no Dask scheduler answers there ({error})") from None

        try:
            self._client.wait_for_workers(1, timeout=CONNECT_S)
        except (TimeoutError, asyncio.TimeoutError):  # one only from Python 3.11 on
            self._client.close()
            raise DataError(f"--scheduler {address}: it has no workers; start some, such as `dask worker`") from None
        self._check_versions(address)

    def _check_versions(self, address: str) -> None:
        """DataError unless every worker has this version of the program."""
        try:
            found = self._client.run(worker_version)
        except ModuleNotFoundError:
            found = {"its workers": "none"}
        for worker, other in found.items():
            if other != __version__:
                self._client.close()
                raise DataError(f"--scheduler {address}: {worker} has enginediag {other}, here is {__version__}")

    @property
    def workers(self) -> int:
        """Threads of the cluster as it is now; one where it has none yet."""
        return max(sum(self._client.nthreads().values()), 1)

    def run(self, work: Callable[[Task], Result], tasks: Iterable[Task]) -> Iterator[tuple[int, Result]]:
        """As `Runner.run`. Raises ClusterError when a task has killed its workers, or the scheduler is gone."""
        from distributed import as_completed

        waiting = enumerate(tasks)
        numbers: dict[str, int] = {}
        finished = as_completed(loop=self._client.loop)

        def hand_out(count: int) -> None:
            for number, task in islice(waiting, count):
                # the number is part of the name: two tasks that are alike are two all the same
                future = self._client.submit(work, task, retries=RETRIES, pure=False)
                numbers[future.key] = number
                finished.add(future)

        hand_out(TASKS_PER_WORKER * self.workers)
        try:
            for future in finished:
                yield numbers.pop(future.key), self._result(future)
                hand_out(max(TASKS_PER_WORKER * self.workers - len(numbers), 0))
        finally:
            finished.clear()

    @staticmethod
    def _result(future: Any) -> Any:
        from distributed.client import FutureCancelledError
        from distributed.scheduler import KilledWorker

        try:
            return future.result()
        except KilledWorker as error:
            what = f"a task has ended its workers, at last {error.last_worker.address}, perhaps because memory ran out"
            raise ClusterError(f"{what}; {KEPT}") from None
        except FutureCancelledError:
            raise ClusterError(f"the scheduler is gone; {KEPT}") from None
        finally:
            future.release()

    def close(self) -> None:
        """Leave the cluster, which goes on without us."""
        self._client.close()


def _connect_in_time(connect: Callable[[], Any]) -> Any:
    """What `connect` gives. TimeoutError where something listens that never answers, for which Dask waits on and on."""
    found: Future[Any] = Future()

    def work() -> None:
        try:
            found.set_result(connect())
        except BaseException as error:
            found.set_exception(error)

    threading.Thread(target=work, daemon=True).start()
    try:
        return found.result(2 * CONNECT_S)
    except FutureTimeoutError:
        if found.done():
            raise
        raise TimeoutError("what listens there does not answer as a scheduler does") from None


def worker_version() -> str:
    """Of the program, where this is called."""
    return __version__


class ClusterError(EngineDiagError):
    """The cluster could not do what it was given."""
