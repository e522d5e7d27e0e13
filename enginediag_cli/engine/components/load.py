"""Load: what a shaft drives outside the engine (generator, propeller, pump)."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from enginediag_cli.config.fields import Field, Section
from enginediag_cli.engine.components.base import NAME, Component, Design, scalar
from enginediag_cli.engine.components.driven import spare, tell
from enginediag_cli.engine.dual import Value, chain, power, value
from enginediag_cli.engine.evaluation import Evaluation
from enginediag_cli.parameters import Parameter
from enginediag_cli.units import RAD_S_PER_RPM

SURPLUS = "surplus"
"""The law of a load that takes what is left."""


class Load(Component):
    """Law `surplus`: takes what the shaft has to spare, at a speed that is given; the power is an output.

    Other laws take a power P of their own, from which the speed follows: `cube` P_design (N/N_design)³ (propeller or
    water brake); `torque` T(N) ω with T ∝ N^torque_exponent, or from a table of torque against speed (brake, pump);
    `given` what is demanded, a number or the input column <name>_power_demand_W. A shaft may have several loads; one
    that takes the surplus is the last. The output <name>_power_W is what is delivered, η P, <name>_torque_N_m is P/ω;
    power_W is the sum over all driven machines.
    """

    TYPE = "load"
    SECTION = Section(
        "load",
        "driven machine on a shaft",
        (
            NAME,
            Field("shaft", "text", "shaft that drives it"),
            Field("law", "choice", "what it takes", SURPLUS, choices=(SURPLUS, "cube", "torque", "given")),
            Field(
                "efficiency",
                "number",
                "delivered power over shaft power (generator, gearbox)",
                1.0,
                minimum=0.3,
                maximum=1.0,
            ),
            Field(
                "design_power_W",
                "number",
                "delivered at the design point (not of law surplus); default: what the shaft has to spare",
                None,
                unit="W",
                minimum=0.0,
            ),
            Field(
                "demand",
                "choice",
                "law given: constant, the design power always; input, the column <name>_power_demand_W",
                "constant",
                choices=("constant", "input"),
            ),
            Field("torque_exponent", "number", "law torque: of the speed", 0.0, minimum=-2.0, maximum=4.0),
            Field("speeds_rpm", "numbers", "law torque: rising speeds of a table, read linearly", ()),
            Field("torques_N_m", "numbers", "law torque: torque that it takes at these speeds, N m", ()),
        ),
    )
    design_power_W = 1.0  # taken from the shaft
    design_speed_rpm = 1.0

    def __init__(self, values: Mapping[str, Any]):
        super().__init__(values)
        self.speeds = np.asarray(self.values["speeds_rpm"], dtype=float)
        self.torques = np.asarray(self.values["torques_N_m"], dtype=float)
        if self.speeds.size == 1 or self.speeds.size != self.torques.size or (np.diff(self.speeds) <= 0.0).any():
            raise ValueError(f"{self.name}: speeds_rpm must rise, with one of torques_N_m for each, at least two")
        if self.values["law"] == SURPLUS and self.values["design_power_W"] is not None:
            raise ValueError(f"{self.name}: design_power_W is not of a load that takes what is left (law surplus)")

    @property
    def demand_column(self) -> str | None:
        """The input column that says what it takes."""
        asked = self.values["law"] == "given" and self.values["demand"] == "input"
        return f"{self.name}_power_demand_W" if asked else None

    @property
    def states_power(self) -> bool:
        """Whether it says itself what it takes at the design point."""
        return self.values["law"] != SURPLUS and (self.values["design_power_W"] is not None or self.speeds.size > 0)

    def inputs(self) -> dict[str, float | None]:
        return {self.demand_column: None} if self.demand_column else {}

    def at_design(self) -> dict[str, float]:
        stated = self.values["design_power_W"]
        return {self.demand_column: stated} if self.demand_column and stated is not None else {}

    def parameters(self) -> tuple[Parameter, ...]:
        return (
            self.design(
                "efficiency",
                Design(self.values["efficiency"], 0.01, 0.3, 1.05, part=True),
                "1",
                "delivered over shaft power",
                wear=-1,
            ),
        )

    def evaluate(self, e: Evaluation) -> None:
        if self.values["law"] == SURPLUS:
            self._take(e, spare(e, self.values["shaft"]))
        else:
            self._take(e, self._by_law(e))

    def _by_law(self, e: Evaluation) -> Value:
        """Power that the law takes from the shaft, W."""
        if self.values["law"] == "given":
            demanded = e[self.demand_column] / e[f"{self.name}.efficiency"] if self.demand_column else None
            return self.design_power_W if demanded is None else demanded
        N = e.shaft(self.values["shaft"]).speed_rpm
        if self.speeds.size:
            return self._tabulated(N) * N * RAD_S_PER_RPM
        n = N * (1.0 / self.design_speed_rpm)
        if self.values["law"] == "cube":
            return n * n * n * self.design_power_W
        return power(n, 1.0 + self.values["torque_exponent"]) * self.design_power_W

    def _tabulated(self, N: Value) -> Value:
        """Torque at a speed, N m; beyond the table on the straight line through its last two values."""
        at = np.asarray(value(N), dtype=float)
        slope = np.diff(self.torques) / np.diff(self.speeds)
        cell = np.clip(np.searchsorted(self.speeds, at, side="right") - 1, 0, len(slope) - 1)
        return chain(self.torques[cell] + slope[cell] * (at - self.speeds[cell]), (slope[cell], N))

    def _take(self, e: Evaluation, taken: Value) -> None:
        shaft = e.shaft(self.values["shaft"])
        if self.values["law"] != SURPLUS:
            shaft.load_W = shaft.load_W + taken
        tell(e, self.name, shaft, taken, taken * e[f"{self.name}.efficiency"])

    def size(self, e: Evaluation) -> None:
        shaft = e.shaft(self.values["shaft"])
        self.design_speed_rpm = scalar(shaft.speed_rpm)
        stated = self.values["design_power_W"]
        if self.speeds.size:
            self.design_power_W = scalar(self._by_law(e))
        elif stated is not None:
            self.design_power_W = stated / self.values["efficiency"]
        else:
            self.design_power_W = scalar(spare(e, self.values["shaft"]))
        self._take(e, self.design_power_W)
