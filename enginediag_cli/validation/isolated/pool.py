"""Trials of isolation over processes: each worker keeps an isolator of its own."""

from __future__ import annotations

from collections.abc import Generator, Iterable
from functools import lru_cache, partial
from itertools import groupby
from typing import Any

from enginediag_cli.validation.blind.correspondent import Correspondent
from enginediag_cli.validation.isolated.sealed import group_of
from enginediag_cli.validation.isolated.trial import Plan, run_group
from enginediag_cli.worker_pool import run_pieces

ISOLATOR = "enginediag_cli.validation.isolated.isolator"


def run_trials(plan: Plan, todo: Iterable[int], jobs: int) -> Generator[tuple[int, dict[str, Any]], None, None]:
    """Number and record of each trial, those of a group together as they are finished, in any order."""
    groups = [tuple(own) for _, own in groupby(todo, lambda trial: group_of(trial, plan.kinds))]
    for trials, records in run_pieces(partial(_run, plan), groups, jobs):
        yield from zip(trials, records, strict=True)


def _run(plan: Plan, trials: tuple[int, ...]) -> list[dict[str, Any]]:
    return run_group(plan, trials, _isolator())


@lru_cache(maxsize=1)
def _isolator() -> Correspondent:
    """This worker's isolator; it ends when the worker, and with it its standard input, does."""
    return Correspondent(ISOLATOR)
