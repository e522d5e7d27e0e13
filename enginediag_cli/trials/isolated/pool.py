"""Trials of isolation over processes: each worker keeps an isolator of its own."""

from __future__ import annotations

from collections.abc import Generator, Iterable
from functools import lru_cache, partial
from typing import Any

from enginediag_cli.trials.blind.correspondent import Correspondent
from enginediag_cli.trials.isolated.trial import Plan, run_trial
from enginediag_cli.trials.pool import run_pieces

ISOLATOR = "enginediag_cli.trials.isolated.isolator"


def run_trials(plan: Plan, todo: Iterable[int], jobs: int) -> Generator[tuple[int, dict[str, Any]], None, None]:
    """Number and record of each trial as it is finished, in any order."""
    return run_pieces(partial(_run, plan), todo, jobs)


def _run(plan: Plan, trial: int) -> dict[str, Any]:
    return run_trial(plan, trial, _isolator())


@lru_cache(maxsize=1)
def _isolator() -> Correspondent:
    """This worker's isolator; it ends when the worker, and with it its standard input, does."""
    return Correspondent(ISOLATOR)
