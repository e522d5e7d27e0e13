"""Trials over processes: each worker keeps an explainer of its own."""

from __future__ import annotations

from collections.abc import Generator, Iterable
from concurrent.futures import ProcessPoolExecutor, as_completed
from functools import lru_cache
from multiprocessing import get_context
from typing import Any

from enginediag_cli.trials.blind.correspondent import Correspondent
from enginediag_cli.trials.blind.trial import Plan, run_trial
from enginediag_cli.trials.studies.pool import ignore_interrupt, single_threaded


def run_trials(plan: Plan, todo: Iterable[int], jobs: int) -> Generator[dict[str, Any], None, None]:
    """Records of trials as they are finished, in any order. When the caller stops, those at work are waited for."""
    todo = tuple(todo)
    if not todo:
        return
    workers = max(1, min(jobs, len(todo)))
    with single_threaded(), ProcessPoolExecutor(workers, get_context("spawn"), initializer=ignore_interrupt) as pool:
        waiting = [pool.submit(_run, plan, k) for k in todo]
        try:
            for future in as_completed(waiting):
                yield future.result()
        finally:
            pool.shutdown(wait=True, cancel_futures=True)


def _run(plan: Plan, trial: int) -> dict[str, Any]:
    return run_trial(plan, trial, _explainer())


@lru_cache(maxsize=1)
def _explainer() -> Correspondent:
    """This worker's explainer; it ends when the worker, and with it its standard input, does."""
    return Correspondent()
