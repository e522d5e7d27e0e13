"""What driven machines have in common: what a shaft has to spare for them, and the columns of what they take."""

from __future__ import annotations

from enginediag_cli.engine.dual import Value
from enginediag_cli.engine.evaluation import Evaluation, Shaft
from enginediag_cli.units import RAD_S_PER_RPM


def spare(e: Evaluation, shaft: str) -> Value:
    """Power that the turbines of a shaft met so far give beyond what is taken from it so far, W."""
    s = e.shaft(shaft)
    return s.supply_W * e[f"{shaft}.mechanical_efficiency"] - s.demand_W - e[f"{shaft}.power_offtake_W"] - s.load_W


def tell(e: Evaluation, name: str, shaft: Shaft, taken_W: Value, delivered_W: Value) -> None:
    """Columns <name>_power_W, delivered, and <name>_torque_N_m on the shaft; power_W is the sum of all powers."""
    e.outputs[f"{name}_torque_N_m"] = taken_W / (shaft.speed_rpm * RAD_S_PER_RPM)
    e.outputs[f"{name}_power_W"] = delivered_W
    e.add_output("power_W", delivered_W)
