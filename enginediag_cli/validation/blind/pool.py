"""Trials over processes: each worker keeps an explainer of its own."""

from __future__ import annotations

from collections.abc import Generator, Iterable
from functools import lru_cache, partial
from typing import Any

from enginediag_cli.validation.blind.correspondent import Correspondent
from enginediag_cli.validation.blind.trial import Plan, run_trial
from enginediag_cli.worker_pool import run_pieces


def run_trials(plan: Plan, todo: Iterable[int], jobs: int) -> Generator[tuple[int, dict[str, Any]], None, None]:
    """Number and record of each trial as it is finished, in any order."""
    return run_pieces(partial(_run, plan), todo, jobs)


def _run(plan: Plan, trial: int) -> dict[str, Any]:
    return run_trial(plan, trial, _explainer())


@lru_cache(maxsize=1)
def _explainer() -> Correspondent:
    """This worker's explainer; it ends when the worker, and with it its standard input, does."""
    return Correspondent()
