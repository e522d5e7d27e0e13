"""ISO 2533 / US 1976 standard atmosphere up to 20 km, with altitude as geopotential height."""

from __future__ import annotations

import numpy as np

from enginediag_cli.engine.dual import Value, exp, power, select, value

T_ISA, P_ISA = 288.15, 101325.0  # K, Pa: reference conditions of all corrected quantities too
LAPSE = 0.0065  # K/m
GRAVITY, R_AIR = 9.80665, 287.05287  # m/s², J/(kg K)
H_TROPOPAUSE = 11000.0  # m
T_TROPOPAUSE = T_ISA - LAPSE * H_TROPOPAUSE
P_TROPOPAUSE = P_ISA * (T_TROPOPAUSE / T_ISA) ** (GRAVITY / (R_AIR * LAPSE))
WATER_OVER_AIR = 0.62198  # molar masses
ICE_POINT = 273.15  # K


def standard_atmosphere(altitude_m: Value) -> tuple[Value, Value]:
    """Standard temperature [K] and pressure [Pa] at pressure altitude [m]; arrays (N,) or derivatives carriers.

    Troposphere T = T0 − L h, p = p0 (T/T0)^(g/(R L)); above 11 km isothermal, p = p11 exp(−g (h − h11)/(R T11)).
    """
    below = np.asarray(value(altitude_m) < H_TROPOPAUSE)
    T_low = T_ISA - LAPSE * altitude_m
    P_low = P_ISA * power(select(below, T_low, T_TROPOPAUSE + 0.0 * T_low) / T_ISA, GRAVITY / (R_AIR * LAPSE))
    if below.all():
        return T_low, P_low
    P_high = P_TROPOPAUSE * exp((H_TROPOPAUSE - altitude_m) * (GRAVITY / (R_AIR * T_TROPOPAUSE)))
    return select(below, T_low, T_TROPOPAUSE + 0.0 * T_low), select(below, P_low, P_high)


def saturated_water(T_K: Value, p_Pa: Value) -> Value:
    """Water of saturated air [kg per kg of dry air]: 0.622 e/(p − e), e(T) over liquid water by Buck's formula,
    e = 611.21 Pa · exp[(18.678 − t/234.5) t/(257.14 + t)], t in °C (Buck 1981, J. Appl. Meteorol. 20, 1527, with
    the constants of 1996)."""
    t = T_K - ICE_POINT
    vapour = 611.21 * exp((18.678 - t * (1.0 / 234.5)) * t / (257.14 + t))
    return WATER_OVER_AIR * vapour / (p_Pa - vapour)
