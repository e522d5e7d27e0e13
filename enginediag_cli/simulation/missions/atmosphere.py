"""How warm the day is: the deviation from ISA along a flight."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from enginediag_cli.config.fields import Field

FIELDS = (
    Field("dT_isa_ground_K", "number", "deviation from ISA at the ground, mean over flights", 5.0, unit="K"),
    Field("dT_isa_ground_sigma_K", "number", "its standard deviation over flights", 8.0, unit="K", minimum=0.0),
    Field("dT_isa_cruise_K", "number", "deviation from ISA at 11 km, mean over flights", 0.0, unit="K"),
    Field("dT_isa_cruise_sigma_K", "number", "its standard deviation over flights", 5.0, unit="K", minimum=0.0),
)

REFERENCE_ALTITUDE_M = 11000.0
"""Tropopause of the standard atmosphere: from the ground to it the day's deviation changes linearly."""
DAY_LIMIT_SIGMA = 2.0
"""No day is further out: it would leave the envelope of the engine."""


def day(
    settings: Mapping[str, Any],
    where: str,
    rng: np.random.Generator,
    count: int,
) -> NDArray[np.float64]:
    """Deviations from ISA, K, of `count` days at `where` (ground or cruise): normal, cut at two sigma."""
    mean, sigma = settings[f"dT_isa_{where}_K"], settings[f"dT_isa_{where}_sigma_K"]
    return mean + sigma * np.clip(rng.standard_normal(count), -DAY_LIMIT_SIGMA, DAY_LIMIT_SIGMA)


def along_flight(
    time_s: NDArray[np.float64],
    altitude_m: NDArray[np.float64],
    ground_K: float,
    cruise_K: float,
    rng: np.random.Generator,
    amplitude_K: float = 1.5,
) -> NDArray[np.float64]:
    """Deviation from ISA, K, (N,): linear in altitude between ground and 11 km, plus slow air-mass waves.

    The waves are two sinusoids of 40–90 min and 10–25 min period with random phases, fading out at the
    ground.
    """
    share = np.clip(altitude_m / REFERENCE_ALTITUDE_M, 0.0, 1.0)
    periods = np.array([rng.uniform(2400.0, 5400.0), rng.uniform(600.0, 1500.0)])
    phases = rng.uniform(0.0, 2.0 * np.pi, size=2)
    waves = np.sin(2.0 * np.pi * time_s[:, None] / periods + phases) @ np.array([0.7, 0.3])
    return ground_K + (cruise_K - ground_K) * share + amplitude_K * share * waves
