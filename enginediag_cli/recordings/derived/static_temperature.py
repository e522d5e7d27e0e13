"""Static air temperature from a total temperature probe and the Mach number."""

from __future__ import annotations

import numpy as np

from enginediag_cli.config.fields import Field, Section
from enginediag_cli.recordings.derived.rule import Columns, Rule, Settings

GAMMA = 1.4
"""Ratio of specific heats of air below 320 K, where probes of the outside air work."""


def static_temperature(total_K: np.ndarray, mach: np.ndarray, recovery: float = 1.0) -> np.ndarray:
    """T = T_t / (1 + r (γ − 1)/2 M²), in K, with the probe's recovery factor r."""
    return total_K / (1.0 + recovery * 0.5 * (GAMMA - 1.0) * mach**2)


def _compute(columns: Columns, settings: Settings) -> np.ndarray:
    return static_temperature(columns[settings["total"]], columns[settings["mach"]], settings["recovery"])


STATIC_TEMPERATURE = Rule(
    Section(
        "static_temperature",
        "static from total air temperature, in K",
        (
            Field("total", "text", "column of the total temperature", "T2_K"),
            Field("mach", "text", "column of the Mach number", "mach"),
            Field("recovery", "number", "recovery factor of the probe", 1.0, minimum=0.0, maximum=1.0),
        ),
    ),
    lambda settings: [settings["total"], settings["mach"]],
    _compute,
)
