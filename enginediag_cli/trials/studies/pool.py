"""Batches over processes: every process loads the study itself, so any way of starting processes will do."""

from __future__ import annotations

import os
import signal
from collections.abc import Generator, Iterable, Iterator
from concurrent.futures import Future, ProcessPoolExecutor, as_completed
from contextlib import contextmanager
from multiprocessing import get_context
from pathlib import Path

from enginediag_cli.trials.studies.batches import Batch, run_batch
from enginediag_cli.trials.studies.tally import Tally

THREADS = ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS")


def run_batches(
    path: Path, seed: int, todo: Iterable[Batch], processes: int
) -> Generator[tuple[Batch, dict[str, Tally]], None, None]:
    """Batches as they are finished, in any order. When the caller stops, those at work are waited for, not begun."""
    todo = tuple(todo)
    if not todo:
        return
    workers = max(1, min(processes, len(todo)))
    with single_threaded(), ProcessPoolExecutor(workers, get_context("spawn"), initializer=ignore_interrupt) as pool:
        waiting: dict[Future[dict[str, Tally]], Batch] = {pool.submit(run_batch, path, seed, b): b for b in todo}
        try:
            for future in as_completed(waiting):
                yield waiting[future], future.result()
        finally:
            pool.shutdown(wait=True, cancel_futures=True)


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


def ignore_interrupt() -> None:
    """Ctrl-C reaches every process of a terminal; only the first one acts on it."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
