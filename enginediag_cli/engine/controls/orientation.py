"""Which way an actuator moves what it is to hold: the sign of dq/dx at the design point, all else in balance."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import numpy as np

from enginediag_cli.engine.controls.control import Control
from enginediag_cli.engine.dual import Dual, Value
from enginediag_cli.engine.evaluation import Evaluation

if TYPE_CHECKING:
    from enginediag_cli.engine.network import Network

UNMOVED = 1e-9
"""Relative change of a column over the whole way of an actuator, or per relative change of fuel, which is none."""


def orient(network: Network, leaves: Mapping[str, Any]) -> None:
    """Gives every aim of every control its sign and, where it has none, its set point. Raises ValueError for an
    actuator that does not move what it is to hold and for a wander without an input that releases it, KeyError for a
    column that the model does not have.

    dq/dx = q_x − q_z F_z⁻¹ F_x along the balances F and unknowns z of the engine without controls, all other actuators
    at neutral and, but for the fuel control itself, at constant power setting.
    """
    if not any(control.aims() for control in network.controls):
        return
    unknowns = [u.name for u in network.open_unknowns()]
    fuel = network.fuel_unknown
    moved = [c.actuator.name for c in network.controls if c.position()]
    e = Evaluation(network.gas, 1, leaves, frozenset([*unknowns, fuel, *moved]))
    with np.errstate(all="ignore"):
        network.open_loop(e)
    held = network.governor.aim.column if network.governor is not None else network.power_setting
    asked = {} if network.given_leaf else {held: network.read(e, held)}
    for control in network.controls:
        if control.release is not None:
            control.release.check(e, network)
        governs = not control.position()
        along = fuel if governs else control.actuator.name
        free = [n for n in unknowns if not (governs and n == fuel)]
        rows = {**e.balances, **({} if governs else asked)}
        if len(rows) != len(free):
            return  # the engine does not close: the check of its unknowns and balances says where
        F, F_x = _slopes(e, rows, free), _slopes(e, rows, [along])[:, 0]
        dz = -np.linalg.solve(F, F_x)
        way = 1.0 if governs else _way(control)
        for aim in control.aims():
            q = network.read(e, aim.column)
            slope = float(_slopes(e, {aim.column: q}, [along])[0, 0] + _slopes(e, {aim.column: q}, free)[0] @ dz)
            size = abs(float(np.ravel(q.v if isinstance(q, Dual) else q)[0])) or 1.0
            if not abs(slope * way) > UNMOVED * size:
                raise ValueError(f"{control.name}: the {control.actuator.words} does not move {aim.column} at design")
            aim.sized(e, network, slope)


def _way(control: Control) -> float:
    """How far the actuator goes, in its unit."""
    far = control.actuator.upper - control.actuator.lower
    return far if np.isfinite(far) else 1.0


def _slopes(e: Evaluation, rows: Mapping[str, Value], names: list[str]) -> np.ndarray:
    """Derivatives (rows, names) of one-point values with respect to leaves."""
    out = np.zeros((len(rows), len(names)))
    for i, y in enumerate(rows.values()):
        if isinstance(y, Dual):
            for j, name in enumerate(names):
                k = e.directions.get(name, len(y.d))
                out[i, j] = y.d[k, 0] if k < len(y.d) else 0.0
    return out
