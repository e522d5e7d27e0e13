"""What a control is after: a column of the model at a value, told as a surplus that rises with the actuator."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from enginediag_cli.engine.components.base import scalar
from enginediag_cli.engine.controls.schedule import Schedule
from enginediag_cli.engine.dual import Value, maximum, minimum
from enginediag_cli.engine.evaluation import Evaluation
from enginediag_cli.parameters import Parameter, spelled
from enginediag_cli.units import split_column

if TYPE_CHECKING:
    from enginediag_cli.engine.network import Network

SET_POINT_SHARE = 0.02
"""How far a set point plausibly lies from what is stated, as a share of it. Judgement."""
SET_POINT_REACH = 0.3
"""Bounds of a set point, as a share of it."""


@dataclass
class Aim:
    """`column` at a target: parameter `<owner>.<quantity>` of nominal `value`, or a `schedule`, or, with neither, the
    reading of the column itself that the operating point states (`demand`: the power setting).

    `side`: "" where it is held, else "at_most" or "at_least". `sign`: +1 where the column rises with the actuator,
    −1 where it falls; `lead_s`: times the rate of change of the column is added to it in transients, so that a
    governor acts before the speed is there; found at the design point, where a value that is not stated is taken from,
    too.
    """

    owner: str
    quantity: str
    column: str
    side: str = ""
    value: float | None = None
    schedule: Schedule | None = None
    demand: bool = False
    sign: float = 1.0
    lead_s: float = 0.0

    @property
    def name(self) -> str:
        return f"{self.owner}.{self.quantity}"

    @property
    def caps(self) -> bool:
        """Whether it keeps the actuator from going further up, rather than further down."""
        return (self.side == "at_most") == (self.sign > 0.0)

    def parameters(self) -> tuple[Parameter, ...]:
        if self.demand:
            return ()
        if self.schedule is not None:
            return self.schedule.parameters()
        v = 1.0 if self.value is None else self.value
        reach = SET_POINT_REACH * (abs(v) or 1.0)
        unit = split_column(self.column)[1] or "1"
        words = f"{spelled(self.owner)} {spelled(self.quantity)}"
        sigma = SET_POINT_SHARE * (abs(v) or 1.0)
        told = f"{self.column} {self.side.replace('_', ' ') or 'held'}"
        return (
            Parameter(
                self.name,
                "design",
                v,
                v - reach,
                v + reach,
                sigma,
                unit,
                told,
                self.owner,
                self.quantity,
                words,
                spelled(self.owner),
            ),
        )

    def target(self, e: Evaluation, network: Network) -> Value:
        """The value to be met (N,), in the column's unit."""
        if self.demand:
            return e[network.power_setting]
        if self.schedule is not None:
            return self.schedule.at(e, network)
        return e[self.name]

    def surplus(self, e: Evaluation, network: Network) -> Value:
        """± (column / target − 1), (N,): above zero where the actuator stands too far up."""
        found = network.read(e, self.column)
        if self.lead_s:
            found = found + network.rate(e, self.column) * self.lead_s
        return self.sign * (found / self.target(e, network) - 1.0)

    def sized(self, e: Evaluation, network: Network, slope: float) -> None:
        """At the design point `e`, where the column changes by `slope` with the actuator."""
        self.sign = 1.0 if slope >= 0.0 else -1.0
        if self.value is None and self.schedule is None:
            self.value = scalar(network.read(e, self.column))


def selected(first: Aim, limits: tuple[Aim, ...], e: Evaluation, network: Network) -> Value:
    """The surplus that acts (N,): each limit caps or lifts what stands before it, F = max(F, F_i) or min(F, F_i)."""
    F = first.surplus(e, network)
    for limit in limits:
        one = limit.surplus(e, network)
        F = maximum(F, one) if limit.caps else minimum(F, one)
    return F
