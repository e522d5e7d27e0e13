"""What `isolate` can be asked beyond the set of changes: sensors, signs, names, large faults, advice."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from functools import wraps
from typing import Any

import click

from enginediag_cli.cli.options import FiniteRange


@dataclass(frozen=True)
class Further:
    """Choices of `further_options`; sensors: None where nothing was said; extra: model column → noise of a further
    sensor, in the column's unit."""

    sensors: bool | None = None
    one_sided: bool = False
    catalogue: tuple[str, ...] = ()
    nonlinear: str = "auto"
    advise: bool = False
    extra: dict[str, float] = field(default_factory=dict)

    @property
    def arguments(self) -> dict[str, Any]:
        """The choices as arguments of the library."""
        return {
            "sensors": self.sensors,
            "one_sided": self.one_sided,
            "catalogue": self.catalogue,
            "nonlinear": self.nonlinear,
            "advise": self.advise,
            "extra_sensors": self.extra,
        }


def further_options(function: Callable[..., Any]) -> Callable[..., Any]:
    """The options of `Further`, as one argument `further`."""

    @wraps(function)
    def with_further(
        *args: Any,
        sensors: bool | None,
        one_sided: bool,
        catalogue: tuple[str, ...],
        nonlinear: str,
        advise: bool,
        extra_sensors: tuple[tuple[str, float], ...],
        **others: Any,
    ) -> Any:
        further = Further(sensors, one_sided, catalogue, nonlinear, advise, dict(extra_sensors))
        return function(*args, further=further, **others)

    options = [
        click.option(
            "--sensors/--no-sensors",
            default=None,
            help="Whether every sensor may be wrong, too, those that give the model its inputs included. They may when "
            "neither is given, with the posterior and without --monitor: a wrong sensor would else be taken for a "
            "change of the engine.",
        ),
        click.option(
            "--catalogue",
            metavar="FILE",
            type=click.Path(exists=True, readable=True),
            multiple=True,
            help="Faults to be named: a fault file, or a folder of them. May be given several times.",
        ),
        click.option(
            "--one-sided",
            is_flag=True,
            help="Changes have known signs: efficiencies fall, and other parameters go the way on which "
            "the catalogue agrees.",
        ),
        click.option(
            "--nonlinear",
            type=click.Choice(["auto", "always", "never"]),
            default="auto",
            show_default=True,
            help="Fit leading sets with the full model: when changes are too large for the quadratic "
            "likelihood, always, or never.",
        ),
        click.option(
            "--advise",
            is_flag=True,
            help="Say what to record next to tell the answer from its leading rival.",
        ),
        click.option(
            "--extra-sensor",
            "extra_sensors",
            metavar="COLUMN SIGMA",
            type=(str, FiniteRange(min=0, min_open=True)),
            multiple=True,
            help="A sensor to consider with --advise: any column of the model, and its noise.",
        ),
    ]
    for option in reversed(options):
        with_further = option(with_further)
    return with_further
