"""The fuel control: it meets the power that is asked for, unless a limit takes over."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING

from enginediag_cli.engine.components.base import Actuator
from enginediag_cli.engine.controls.aim import Aim, selected
from enginediag_cli.engine.controls.control import Control, Derived
from enginediag_cli.engine.controls.held import inputs_of, limits_acting
from enginediag_cli.engine.dual import Array
from enginediag_cli.engine.evaluation import Evaluation
from enginediag_cli.parameters import Parameter

if TYPE_CHECKING:
    from enginediag_cli.engine.network import Network

FUEL_VALVE = Actuator("fuel", "kg/s", 0.0, 0.0, float("inf"), "fuel valve")


class Governor(Control):
    """F = 0 with F as `selected` gives it: the burner's fuel flow, an unknown already, has no stops of its own."""

    def __init__(self, name: str, aim: Aim, limits: tuple[Aim, ...]):
        super().__init__(name, FUEL_VALVE)
        self.aim, self.limits = aim, limits

    def aims(self) -> tuple[Aim, ...]:
        return (self.aim, *self.limits)

    def inputs(self) -> dict[str, float | None]:
        return inputs_of(self.aims())

    def parameters(self) -> tuple[Parameter, ...]:
        return tuple(p for aim in self.aims() for p in aim.parameters())

    def position(self) -> Mapping[str, Derived]:
        return {}

    def close(self, e: Evaluation, network: Network) -> None:
        e.balances[f"{self.name} fuel"] = network.paced(self, e, selected(self.aim, self.limits, e, network))

    def acting(self, e: Evaluation, network: Network) -> Mapping[str, Array]:
        return limits_acting(self.limits, e, network)
