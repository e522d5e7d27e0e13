"""What the margin of a turbine temperature is counted to and from, for commands that follow it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import wraps
from typing import TYPE_CHECKING, Any

import click

from enginediag_cli.commands.options import FiniteRange

if TYPE_CHECKING:
    from enginediag_cli.fleet_judgement.of_series import MarginQuestion


@dataclass(frozen=True)
class Asked:
    """limits_K: column → limit; consumed_limit_K: margin that is lost when an engine is taken off, and its standard
    deviation; taken_off: engines that tell it; events: file of maintenance, "" for none; baseline: flights, 0 where not
    said."""

    limits_K: dict[str, float]
    consumed_limit_K: tuple[float, float] | None
    taken_off: tuple[str, ...]
    events: str
    baseline: int

    def __bool__(self) -> bool:
        return bool(self.limits_K or self.consumed_limit_K or self.taken_off or self.events)

    @property
    def configs(self) -> list[str]:
        """Files that a result depends on, for its provenance."""
        return [self.events] if self.events else []

    @property
    def notes(self) -> dict[str, str]:
        """Choices that a result depends on, for its provenance."""
        limits = ", ".join(f"{c} {v:g}" for c, v in self.limits_K.items())
        consumed = " ± ".join(f"{v:g}" for v in self.consumed_limit_K or ())
        told = {
            "limit": limits,
            "consumed limit": consumed and f"{consumed} K",
            "taken off": ", ".join(self.taken_off),
            "baseline": self.baseline and f"first {self.baseline} flights",
        }
        return {name: str(value) for name, value in told.items() if value}

    def question(self, *, healthy: int = 0, sensors: bool = True) -> MarginQuestion:
        """With the events of the file; healthy, sensors: as of `MarginQuestion`. Raises ConfigError."""
        import os
        from pathlib import Path

        from enginediag_cli.fleet.events import read_events
        from enginediag_cli.fleet_judgement.of_series import MarginQuestion

        events = read_events(Path(self.events), named=False) if self.events else ()
        return MarginQuestion(
            limits_K=self.limits_K,
            consumed_limit_K=self.consumed_limit_K,
            taken_off=self.taken_off,
            events=events,
            events_file=os.path.basename(self.events),
            baseline=self.baseline,
            healthy=healthy,
            sensors=sensors,
        )


def margin_options(function: Callable[..., Any]) -> Callable[..., Any]:
    """The options as one argument `asked: Asked`."""

    @wraps(function)
    def with_asked(
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
        asked = Asked(dict(limits), consumed_limit_K, taken_off, events_path or "", baseline)
        return function(*args, asked=asked, **others)

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
    return limit(consumed(taken_off(events(baseline(with_asked)))))
