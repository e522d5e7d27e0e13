"""Speed of a rotor: I ω dω/dt is what the power of its turbines exceeds that of all they drive by."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

from enginediag_cli.engine.dual import Array, Value
from enginediag_cli.engine.evaluation import Evaluation
from enginediag_cli.engine.hooks import Hooks
from enginediag_cli.engine.transient.state import STEP, State
from enginediag_cli.units import RAD_S_PER_RPM

if TYPE_CHECKING:
    from enginediag_cli.engine.moving.memory import Memory
    from enginediag_cli.engine.network import Network


class Rotor(State):
    """P_turbine η_m = P_compressor + P_offtake + I ω dω/dt; the state is ω, rad/s.

    Source: Walsh and Fletcher, Gas Turbine Performance, 2nd ed. 2004, ch. 8.
    """

    unit = "rad/s"
    per_given = 1.0 / RAD_S_PER_RPM

    def __init__(self, shaft: str, inertia_kg_m2: float):
        self.shaft, self.inertia_kg_m2 = shaft, inertia_kg_m2
        self.name, self.words = f"{shaft}.omega", f"{shaft} speed"

    def install(self, hooks: Hooks, network: Network) -> None:
        hooks.leaves.setdefault(f"{self.shaft}.power_offtake_W", []).append(self._taken)

    def stands_for(self, memory: Memory) -> bool:
        return memory.turns == self.shaft

    def value(self, e: Evaluation) -> Value:
        return e.shaft(self.shaft).speed_rpm * RAD_S_PER_RPM

    def power(self, x: Array, slope: Array) -> Array:
        return self.inertia_kg_m2 * x * slope

    def moved(self, x: Array, names: Sequence[str], before: Array, after: Array) -> Array:
        k = names.index(f"{self.shaft}.corrected_speed")
        return x * (after[k] / before[k])

    def acceleration(self, e: Evaluation) -> Value:
        """dω/dt (N,) in rad/s²: of a stage, or, where the speed is given, from the power that is left over."""
        omega = self.value(e)
        if e.has(self.base):
            return (omega - e[self.base]) / e[STEP]
        return e.outputs[surplus_column(self.shaft)] / (omega * self.inertia_kg_m2)

    def slope(self, e: Evaluation) -> Value:
        return self.acceleration(e)

    def _taken(self, e: Evaluation, load_W: Value) -> Value:
        if not e.has(self.base):
            return load_W
        omega = self.value(e)
        return load_W + omega * ((omega - e[self.base]) / e[STEP]) * self.inertia_kg_m2


def surplus_column(shaft: str) -> str:
    """Model column with the power that accelerates a shaft, where its speed is given."""
    return f"{shaft}_surplus_W"
