"""`enginediag detect --follow`: a flight judged while it is being recorded."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import wraps
from typing import Any

import click

from enginediag_cli.cli.judging import digits_of
from enginediag_cli.cli.options import FiniteRange


@dataclass(frozen=True)
class Follow:
    """Choices of `follow_options`; `window`, `step` and `nominal`: as given beside them."""

    wanted: bool
    idle_s: float
    window: str | None
    step: str | None
    nominal: str | None


def follow_options(function: Callable[..., Any]) -> Callable[..., Any]:
    """`--follow` and `--idle` as one `follow: Follow`; stands below `window_options`, whose options it sees, too."""

    @wraps(function)
    def with_follow(*args: Any, follow: bool, idle: float, **others: Any) -> Any:
        given = click.get_current_context().params
        chosen = Follow(follow, idle, given.get("window"), given.get("step"), given.get("nominal"))
        return function(*args, follow=chosen, **others)

    wanted = click.option(
        "--follow",
        is_flag=True,
        help="Judge records as they come, from standard input or a growing file: one row per --window records (20), "
        "with one probability of a false alarm (--false-alarm) for the whole of each flight.",
    )
    idle = click.option(
        "--idle",
        metavar="SECONDS",
        type=FiniteRange(min=0),
        default=60.0,
        show_default=True,
        help="With --follow, a file to which nothing is added for so long has ended.",
    )
    return wanted(idle(with_follow))


def check_follow(follow: Follow, windows: Mapping[str, Any], detectable: bool) -> None:
    """Raises click.UsageError for choices that do not go with --follow."""
    if follow.nominal is None:
        raise click.UsageError("--follow needs --nominal")
    refused = {
        "--step": (follow.step, "blocks do not overlap, or their evidence would count twice"),
        "--detectable": (detectable, "the smallest change depends on how long it has lasted"),
        "--reference": (windows["reference"], "a flight is judged from its first record on"),
        "--last": (windows["last"], "the last records of a flight that goes on are not known"),
    }
    reasons = [f"{option} does not go with --follow: {why}" for option, (given, why) in refused.items() if given]
    if reasons:
        raise click.UsageError("; ".join(reasons))
    digits_of(follow.window)
