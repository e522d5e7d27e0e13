"""`--limit`, `--events` and `--baseline` of commands that follow the margin of a turbine temperature."""

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
    """limits_K: column → limit; events: file of maintenance, "" for none; baseline: flights, 0 where not said."""

    limits_K: dict[str, float]
    events: str
    baseline: int

    def __bool__(self) -> bool:
        return bool(self.limits_K or self.events)

    @property
    def configs(self) -> list[str]:
        """Files that a result depends on, for its provenance."""
        return [self.events] if self.events else []

    @property
    def notes(self) -> dict[str, str]:
        """Choices that a result depends on, for its provenance."""
        limits = ", ".join(f"{c} {v:g}" for c, v in self.limits_K.items())
        told = {"limit": limits, "baseline": self.baseline and f"first {self.baseline} flights"}
        return {name: str(value) for name, value in told.items() if value}

    def question(self, *, healthy: int = 0, sensors: bool = True) -> MarginQuestion:
        """With the events of the file; healthy, sensors: as of `MarginQuestion`. Raises ConfigError."""
        import os
        from pathlib import Path

        from enginediag_cli.fleet.events import read_events
        from enginediag_cli.fleet_judgement.of_series import MarginQuestion

        events = read_events(Path(self.events), named=False) if self.events else ()
        return MarginQuestion(self.limits_K, events, os.path.basename(self.events), self.baseline, healthy, sensors)


def margin_options(function: Callable[..., Any]) -> Callable[..., Any]:
    """The three options as one argument `asked: Asked`."""

    @wraps(function)
    def with_asked(
        *args: Any, limits: tuple[tuple[str, float], ...], events_path: str | None, baseline: int, **others: Any
    ) -> Any:
        return function(*args, asked=Asked(dict(limits), events_path or "", baseline), **others)

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
    return limit(events(baseline(with_asked)))
