"""Deviation of the static air temperature from the International Standard Atmosphere (ISO 2533:1975)."""

from __future__ import annotations

import numpy as np

from enginediag_cli.config.fields import Field, Section
from enginediag_cli.recordings.derived.rule import Columns, Rule, Settings

SEA_LEVEL_K = 288.15
"""Standard atmosphere at sea level (ISO 2533:1975)."""
LAPSE_K_M = 0.0065
"""Its fall with altitude up to the tropopause (ISO 2533:1975)."""
TROPOPAUSE_M = 11000.0
"""Geopotential altitude from which it is constant (ISO 2533:1975)."""


def isa_temperature(altitude_m: np.ndarray) -> np.ndarray:
    """T_ISA in K at a pressure altitude (N,) in m, below 20 km: 288.15 − 0.0065 h, then 216.65."""
    return SEA_LEVEL_K - LAPSE_K_M * np.minimum(altitude_m, TROPOPAUSE_M)


def _compute(columns: Columns, settings: Settings) -> np.ndarray:
    return columns[settings["temperature"]] - isa_temperature(columns[settings["altitude"]])


ISA_DEVIATION = Rule(
    Section(
        "isa_deviation",
        "static temperature minus that of the standard atmosphere, in K",
        (
            Field("temperature", "text", "column of the static air temperature", "ambient_temperature_K"),
            Field("altitude", "text", "column of the pressure altitude", "altitude_m"),
        ),
    ),
    lambda settings: [settings["temperature"], settings["altitude"]],
    _compute,
)
