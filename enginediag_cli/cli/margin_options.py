"""What the margin of a turbine temperature is counted to and from, for commands that follow it."""

from __future__ import annotations

from collections.abc import Callable
from functools import wraps
from typing import Any

import click

from enginediag_cli.cli.options import FiniteRange


def margin_options(function: Callable[..., Any]) -> Callable[..., Any]:
    """The options as one argument `margin: MarginOptions`."""

    @wraps(function)
    def with_margin(
        *args: Any,
        limits: tuple[tuple[str, float], ...],
        consumed_limit_K: tuple[float, float] | None,
        taken_off: tuple[str, ...],
        events_path: str | None,
        baseline: int,
        **others: Any,
    ) -> Any:
        if sum(map(bool, (limits, consumed_limit_K, taken_off))) > 1:
            raise click.UsageError("a limit is one of --limit, --consumed-limit and --taken-off")
        from enginediag_cli.api.over_time import MarginOptions

        margin = MarginOptions(dict(limits), consumed_limit_K, taken_off, events_path or "", baseline)
        return function(*args, margin=margin, **others)

    limit = click.option(
        "--limit",
        "limits",
        nargs=2,
        type=(str, FiniteRange(min=0, min_open=True)),
        metavar="COLUMN KELVIN",
        multiple=True,
        help="Highest permitted turbine temperature, such as T45_K 1180, at the hottest operating point that "
        "identification had: what its margin is counted to.",
    )
    consumed = click.option(
        "--consumed-limit",
        "consumed_limit_K",
        nargs=2,
        type=FiniteRange(min=0, min_open=True),
        metavar="KELVIN KELVIN",
        help="Where no temperature limit is known: margin that engines have lost when they are taken off, and its "
        "standard deviation, such as 25 3.",
    )
    taken_off = click.option(
        "--taken-off",
        metavar="ENGINE",
        multiple=True,
        help="An engine of these recordings that end where it was taken off because it was worn; of three at least: "
        "what they had lost by then is the limit of all others.",
    )
    events = click.option(
        "--events",
        "events_path",
        metavar="FILE",
        type=click.Path(exists=True, dir_okay=False, readable=True),
        help="CSV of maintenance as a fleet's: columns kind (wash, overhaul, exchange), flight (the first after it) or "
        "time_s, component, and engine, which may be left out of one engine's.",
    )
    baseline = click.option(
        "--baseline",
        metavar="FLIGHTS",
        type=click.IntRange(min=0),
        default=0,
        help="First flights of an engine that are believed healthy: the margin that wear has taken is counted from "
        "them; those of --reference, or else the first flight, where not given.",
    )
    return limit(consumed(taken_off(events(baseline(with_margin)))))
