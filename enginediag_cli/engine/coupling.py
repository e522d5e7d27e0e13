"""What the shafts of an engine drive, and which of them turn together."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from enginediag_cli.engine.components.base import Component, scalar
from enginediag_cli.engine.components.gearbox import Gearbox
from enginediag_cli.engine.components.load import SURPLUS, Load
from enginediag_cli.engine.components.propeller import Propeller
from enginediag_cli.engine.dual import Value
from enginediag_cli.engine.evaluation import Evaluation

DESIGN_SURPLUS = 1e-3
"""Share of its turbines' power by which a shaft may be out of balance at the design point of an engine with stated
loads: figures of a data sheet have three digits."""


class Coupling:
    """Shafts, their gears and their driven machines."""

    def __init__(self, shafts: Mapping[str, Mapping[str, Any]], components: Sequence[Component]):
        self.shafts = shafts
        self.machines = [c for c in components if isinstance(c, (Load, Propeller))]
        self.gears = [c for c in components if isinstance(c, Gearbox)]
        self.driving = {
            g.values["drives"]: g.values["shaft"] for g in self.gears
        }  # driven shaft → the one that drives it
        self.loaded = {c.values["shaft"] for c in (*self.machines, *self.gears)} | set(self.driving)
        took = {c.values["shaft"] for c in self.machines if c.values.get("law") == SURPLUS}
        self._turning = {name: self._group(name) for name in shafts}
        self.balanced = [s for s in shafts if s not in took and s not in self.driving]

    def turning_with(self, name: str) -> list[str]:
        """The shafts that turn with this one at fixed ratios, that which drives the others first."""
        return self._turning[name]

    def _group(self, name: str) -> list[str]:
        first = self._first(name)
        return [first, *(s for s in self.shafts if s in self.driving and self._first(s) == first)]

    def _first(self, name: str) -> str:
        """The shaft at the beginning of the gears that drive this one."""
        while name in self.driving:
            name = self.driving[name]
        return name

    def ratio(self, name: str, other: str) -> float:
        """Speed of a shaft over that of another which turns with it."""
        return float(self.shafts[name]["design_speed_rpm"] / self.shafts[other]["design_speed_rpm"])

    def missing(self, e: Evaluation, name: str) -> Value:
        """What its turbines give beyond what is taken from a shaft, over what they give."""
        shaft = e.shaft(name)
        taken = shaft.demand_W + e[f"{name}.power_offtake_W"] + shaft.load_W
        return e[f"{name}.mechanical_efficiency"] - taken / shaft.supply_W

    def check_design(self, e: Evaluation) -> None:
        """Raises ValueError for a shaft whose stated loads do not add up to what its turbine gives at design."""
        for name in self.balanced:
            left = scalar(self.missing(e, name)) * scalar(e.shaft(name).supply_W)
            if name in self.loaded and abs(left) > DESIGN_SURPLUS * scalar(e.shaft(name).supply_W):
                more = "more" if left > 0.0 else "less"
                raise ValueError(
                    f"the turbines of shaft '{name}' give {abs(left):.4g} W {more} than is taken from it; leave the "
                    "design_power_W of one machine out, or the pressure_ratio of the turbine behind all of them, or "
                    f"let a machine of this shaft take {abs(left):.4g} W {more}"
                )
