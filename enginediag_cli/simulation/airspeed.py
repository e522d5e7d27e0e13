"""Calibrated airspeed and Mach number, for flight paths that are flown by them.

The compressible Bernoulli relation that airspeed indicators are calibrated by; ICAO standard atmosphere
(e.g. Young, Performance of the Jet Transport Airplane, 2018, ch. 6).
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from enginediag_cli.engine.atmosphere import P_ISA, R_AIR, T_ISA, standard_atmosphere

GAMMA = 1.4
"""Ratio of heat capacities of air that airspeed indicators are calibrated with."""
SOUND_SPEED_ISA_M_S = float(np.sqrt(GAMMA * R_AIR * T_ISA))
KNOT_M_S = 1852.0 / 3600.0
"""International nautical mile of 1852 m an hour."""
FOOT_M = 0.3048
"""International foot of 1959."""


def mach_from_cas(cas_m_s: ArrayLike, altitude_m: ArrayLike) -> NDArray[np.float64]:
    """Mach number of a calibrated airspeed, m/s, at a pressure altitude, m; arguments broadcast.

    The impact pressure qc that an indicator shows as CAS at sea level is the same at altitude:
    qc = p0 [(1 + (CAS/a0)²/5)^3.5 − 1],   M² = 5 [(qc/p + 1)^(1/3.5) − 1]   (subsonic).
    """
    ratio = np.asarray(cas_m_s, dtype=float) / SOUND_SPEED_ISA_M_S
    impact_pressure = P_ISA * ((1.0 + 0.2 * ratio**2) ** 3.5 - 1.0)
    return np.sqrt(5.0 * ((impact_pressure / _pressure(altitude_m) + 1.0) ** (1.0 / 3.5) - 1.0))


def _pressure(altitude_m: ArrayLike) -> NDArray[np.float64]:
    return np.asarray(standard_atmosphere(np.asarray(altitude_m, dtype=float))[1])
