"""Water per dry air from relative humidity, temperature and pressure."""

from __future__ import annotations

import numpy as np

from enginediag_cli.config.fields import Field, Section
from enginediag_cli.recordings.derived.rule import Columns, Rule, Settings

WATER_TO_AIR = 18.015268 / 28.9652
"""Ratio of the molar masses of water and dry air."""


def saturation_pressure(temperature_K: np.ndarray, pressure_Pa: np.ndarray) -> np.ndarray:
    """Vapour pressure over water in moist air, in Pa, −20 to 50 °C within 0.1 %.

    e_s = f · 6.1121 hPa · exp(17.502 t / (240.97 + t)), f = 1.0007 + 3.46e-6 p, with t in °C and p in hPa
    (Buck 1981, J. Appl. Meteorol. 20, curves ew1 and fw3).
    """
    t = temperature_K - 273.15
    enhancement = 1.0007 + 3.46e-6 * pressure_Pa / 100.0
    return enhancement * 611.21 * np.exp(17.502 * t / (240.97 + t))


def humidity_ratio(relative: np.ndarray, temperature_K: np.ndarray, pressure_Pa: np.ndarray) -> np.ndarray:
    """w = 0.622 e / (p − e) in kg/kg, with e = φ e_s; φ cut to 0 to 1 (sensors read up to 1.002)."""
    vapour = np.clip(relative, 0.0, 1.0) * saturation_pressure(temperature_K, pressure_Pa)
    return WATER_TO_AIR * vapour / (pressure_Pa - vapour)


def _compute(columns: Columns, settings: Settings) -> np.ndarray:
    return humidity_ratio(*(columns[settings[key]] for key in ("relative", "temperature", "pressure")))


HUMIDITY_RATIO = Rule(
    Section(
        "humidity_ratio",
        "water per dry air from the relative humidity, in kg/kg",
        (
            Field("relative", "text", "column of the relative humidity, 0 to 1", "relative_humidity"),
            Field("temperature", "text", "column of the air temperature", "ambient_temperature_K"),
            Field("pressure", "text", "column of the air pressure", "ambient_pressure_Pa"),
        ),
    ),
    lambda settings: [settings[key] for key in ("relative", "temperature", "pressure")],
    _compute,
)
