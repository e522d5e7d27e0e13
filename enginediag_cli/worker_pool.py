"""Pieces of work over processes: every process loads what it needs itself, so any way of starting one will do."""

from __future__ import annotations

import os
import signal
from collections.abc import Callable, Generator, Iterable, Iterator
from concurrent.futures import Future, ProcessPoolExecutor, as_completed
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager
from multiprocessing import get_context, parent_process
from typing import TypeVar

from enginediag_cli.config.reading import READING, Reading
from enginediag_cli.errors import WorkerDiedError
from enginediag_cli.parent_process import end_with_parent

Piece = TypeVar("Piece")
Result = TypeVar("Result")

THREADS = ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS")


def run_pieces(
    work: Callable[[Piece], Result], todo: Iterable[Piece], processes: int, *, in_order: bool = False
) -> Generator[tuple[Piece, Result], None, None]:
    """Each piece with its result as it is finished, or in the order of `todo`. `work` and the pieces must be picklable.

    When the caller stops, those at work are waited for, not begun. Raises WorkerDiedError, and what `work` raises.
    """
    todo = tuple(todo)
    if not todo:
        return
    workers = max(1, min(processes, len(todo)))
    with single_threaded(), worker_pool(workers) as pool:
        waiting: dict[Future[Result], Piece] = {pool.submit(work, piece): piece for piece in todo}
        try:
            for future in waiting if in_order else as_completed(waiting):
                yield waiting[future], future.result()
        except BrokenProcessPool:
            raise WorkerDiedError(
                "a worker process was ended from outside, perhaps because memory ran out; use fewer processes"
            ) from None
        finally:
            pool.shutdown(wait=True, cancel_futures=True)


def worker_pool(workers: int) -> ProcessPoolExecutor:
    """Processes that allow what this one does, and end with it."""
    return ProcessPoolExecutor(workers, get_context("spawn"), initializer=begin_worker, initargs=(READING,))


@contextmanager
def single_threaded() -> Iterator[None]:
    """Processes started inside use one thread each for linear algebra: more would only hinder each other."""
    before = {name: os.environ.get(name) for name in THREADS}
    os.environ.update(dict.fromkeys(THREADS, "1"))
    try:
        yield
    finally:
        for name, value in before.items():
            if value is None:
                del os.environ[name]
            else:
                os.environ[name] = value


def begin_worker(reading: Reading) -> None:
    """What a process of a pool does first: it reads what its parent may read. Ctrl-C reaches every process of a
    terminal, and only the first one acts on it; a killed parent, which can end nobody any more, takes its workers with
    it."""
    READING.allow_outside = reading.allow_outside
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    parent = parent_process()
    if parent is not None and parent.pid is not None:
        end_with_parent(parent.pid)
