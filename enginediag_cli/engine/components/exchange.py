"""Effectiveness of heat exchangers of given conductance, by W. M. Kays and A. L. London, Compact Heat Exchangers."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from enginediag_cli.config.fields import Field
from enginediag_cli.engine.dual import Value, exp, select, value

BALANCED = 1e-12
"""1 − C_r below which both sides have the same heat capacity."""
NEARLY_BALANCED = 1e-3
"""NTU (1 − C_r) below which (1 − e^−x)/x is its series: right to 1e-14 there."""
EFFECTIVENESS_LAW = Field(
    "effectiveness_law",
    "choice",
    "constant, or that of an exchanger of given conductance, which falls with flow",
    "constant",
    choices=("constant", "ntu"),
)
CONDUCTANCE_EXPONENT = Field(
    "conductance_exponent",
    "number",
    "m of conductance ∝ W^m of the air, for law ntu: 0 laminar, 0.6 to 0.8 turbulent",
    0.0,
    minimum=0.0,
    maximum=1.0,
)


def check_conductance(values: Mapping[str, Any]) -> None:
    """Raises ValueError where no conductance gives the effectiveness."""
    if values["effectiveness_law"] == "ntu" and values["effectiveness"] == 1.0:
        raise ValueError(f"{values['name']}: an effectiveness of 1 needs endless conductance; law ntu takes less")


def counterflow(ntu: Value, capacity_ratio: Value) -> Value:
    """ε of a counterflow exchanger, (N,): with g = (1 − e^−x)/x, x = NTU (1 − C_r), it is NTU g/(1 + C_r NTU g), which
    has no hole at C_r = 1."""
    x = ntu * (1.0 - capacity_ratio)
    near = np.asarray(np.abs(value(x)) < NEARLY_BALANCED)
    apart = select(near, 1.0, x)
    series = 1.0 - x * (0.5 - x * (1.0 / 6.0 - x * (1.0 / 24.0)))
    g = select(near, series, (1.0 - exp(-1.0 * apart)) / apart)
    return ntu * g / (1.0 + capacity_ratio * (ntu * g))


def transfer_units(effectiveness: float, capacity_ratio: float) -> float:
    """NTU of a counterflow exchanger of this effectiveness: the inverse of `counterflow`."""
    if abs(1.0 - capacity_ratio) < BALANCED:
        return effectiveness / (1.0 - effectiveness)
    ratio = (1.0 - effectiveness * capacity_ratio) / (1.0 - effectiveness)
    return float(np.log(ratio)) / (1.0 - capacity_ratio)
