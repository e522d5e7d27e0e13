"""Mach number from true airspeed and a static or total air temperature."""

from __future__ import annotations

import numpy as np

from enginediag_cli.config.fields import Field, Section
from enginediag_cli.recordings.derived.rule import Columns, Rule, Settings
from enginediag_cli.recordings.derived.static_temperature import GAMMA

GAS_CONSTANT = 287.05287
"""Of air in J/(kg K), as in the standard atmosphere (ISO 2533:1975)."""


def mach_from_tas(tas_m_s: np.ndarray, temperature_K: np.ndarray, recovery: float = 0.0) -> np.ndarray:
    """M = V/√(γ R T) with the static temperature; with a total one, T = T_t − r V² (γ − 1)/(2 γ R).

    The second is T = T_t/(1 + r (γ − 1)/2 M²) solved for T at the speed V (energy equation of a perfect gas).
    recovery: r of the total temperature probe; 0 for a static temperature. NaN where V exceeds what T_t allows.
    """
    static = temperature_K - recovery * tas_m_s**2 * (GAMMA - 1.0) / (2.0 * GAMMA * GAS_CONSTANT)
    return tas_m_s / np.sqrt(GAMMA * GAS_CONSTANT * np.where(static > 0.0, static, np.nan))


def _compute(columns: Columns, settings: Settings) -> np.ndarray:
    return mach_from_tas(
        columns[settings["tas"]],
        columns[settings["temperature"]],
        settings["recovery"] if settings["total"] else 0.0,
    )


MACH_FROM_TAS = Rule(
    Section(
        "mach_from_tas",
        "Mach number from true airspeed and air temperature",
        (
            Field("tas", "text", "column of the true airspeed", "tas_m_s"),
            Field("temperature", "text", "column of the air temperature", "ambient_temperature_K"),
            Field("total", "boolean", "whether the temperature is the total one", False),
            Field("recovery", "number", "recovery factor of a total temperature probe", 1.0, minimum=0.0, maximum=1.0),
        ),
    ),
    lambda settings: [settings["tas"], settings["temperature"]],
    _compute,
)
