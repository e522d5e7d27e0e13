"""Mach number from calibrated airspeed and pressure altitude, below the speed of sound."""

from __future__ import annotations

import numpy as np

from enginediag_cli.config.fields import Field, Section
from enginediag_cli.recordings.derived.isa_deviation import LAPSE_K_M, SEA_LEVEL_K, TROPOPAUSE_M, isa_temperature
from enginediag_cli.recordings.derived.rule import Columns, Rule, Settings

SEA_LEVEL_PA = 101325.0
"""Standard atmosphere at sea level (ISO 2533:1975)."""
GRAVITY_OVER_R = 9.80665 / 287.05287
"""g₀/R in K/m (ISO 2533:1975)."""
SOUND_AT_SEA_LEVEL_M_S = 340.294
"""Speed of sound at 288.15 K, with which airspeed indicators are calibrated (ISO 2533:1975)."""


def isa_pressure(altitude_m: np.ndarray) -> np.ndarray:
    """p in Pa at a pressure altitude (N,) in m below 20 km: p₀ (T/T₀)^(g₀/(R L)), above 11 km exp(−g₀ Δh/(R T))."""
    temperature = isa_temperature(altitude_m)
    above = np.maximum(altitude_m - TROPOPAUSE_M, 0.0)
    below: np.ndarray = (temperature / SEA_LEVEL_K) ** (GRAVITY_OVER_R / LAPSE_K_M)
    return SEA_LEVEL_PA * below * np.exp(-GRAVITY_OVER_R * above / temperature)


def mach_from_cas(cas_m_s: np.ndarray, altitude_m: np.ndarray) -> np.ndarray:
    """M = √(5 ((q_c/p + 1)^(2/7) − 1)), q_c = p₀ ((1 + 0.2 (V_c/a₀)²)^3.5 − 1): the isentropic pitot equation with
    γ = 1.4, at the altitude and as the indicator is calibrated at sea level. Below 0 the speed is taken as 0."""
    impact = SEA_LEVEL_PA * ((1.0 + 0.2 * (np.maximum(cas_m_s, 0.0) / SOUND_AT_SEA_LEVEL_M_S) ** 2) ** 3.5 - 1.0)
    mach: np.ndarray = np.sqrt(5.0 * ((impact / isa_pressure(altitude_m) + 1.0) ** (2.0 / 7.0) - 1.0))
    return mach


def _compute(columns: Columns, settings: Settings) -> np.ndarray:
    return mach_from_cas(columns[settings["cas"]], columns[settings["altitude"]])


MACH_FROM_CAS = Rule(
    Section(
        "mach_from_cas",
        "Mach number from calibrated airspeed and pressure altitude, subsonic",
        (
            Field("cas", "text", "column of the calibrated airspeed", "cas_m_s"),
            Field("altitude", "text", "column of the pressure altitude", "altitude_m"),
        ),
    ),
    lambda settings: [settings["cas"], settings["altitude"]],
    _compute,
)
