"""What every control is to the network: unknowns, equations and parameters of its own, and its actuator's position."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING

from enginediag_cli.engine.components.base import Actuator, Unknown
from enginediag_cli.engine.controls.aim import Aim
from enginediag_cli.engine.controls.release import Release
from enginediag_cli.engine.dual import Array, Value
from enginediag_cli.engine.evaluation import Evaluation
from enginediag_cli.parameters import Parameter

if TYPE_CHECKING:
    from enginediag_cli.engine.network import Network

AT_LIMIT = 1e-6
"""Distance from a stop, of the way between the stops, or from a limit, of its value, within which it acts."""

Derived = Callable[[Evaluation], Value]


@dataclass(frozen=True)
class Pace:
    """How fast an actuator follows in transients: its control's time constant, s, and its largest rate, in its unit per
    second; 0: at once."""

    time_constant_s: float = 0.0
    rate_per_s: float = 0.0


class Control(ABC):
    """One actuator and what moves it."""

    pace = Pace()
    release: Release | None = None  # when it acts, where it does not always

    def __init__(self, name: str, actuator: Actuator):
        self.name, self.actuator = name, actuator

    def inputs(self) -> dict[str, float | None]:
        """Input columns that it reads, with the default of those that may be left out."""
        return {}

    def parameters(self) -> tuple[Parameter, ...]:
        return ()

    def unknowns(self) -> tuple[Unknown, ...]:
        return ()

    @abstractmethod
    def position(self) -> Mapping[str, Derived]:
        """The actuator's leaf and how it is found in an evaluation; nothing where it is an unknown already."""

    def close(self, e: Evaluation, network: Network) -> None:  # noqa: B027  most add one, what is given needs none
        """Adds its equation to the balances of `e`."""

    def aims(self) -> tuple[Aim, ...]:
        """What it is after, to be given a sign at the design point."""
        return ()

    def acting(self, e: Evaluation, network: Network) -> Mapping[str, Array]:
        """Limit or stop → records (N,) in which it acts, at a solution."""
        return {}
