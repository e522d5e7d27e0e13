"""Columns computed from recorded ones, and gaps of slowly sampled columns filled; a recorder lists those that it needs.

Missing values (NaN) in give missing values out. To add a rule: its function and its row in `RULES`.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import reduce
from typing import Any

import numpy as np

from enginediag_cli.config.fields import Field, Section
from enginediag_cli.recordings.table import Recording, concat

Columns = Mapping[str, np.ndarray]
Settings = Mapping[str, Any]


@dataclass(frozen=True)
class DerivationRule:
    """How a column is computed.

    section: its YAML keys; columns: those of them that name columns, one or a list; compute: the column (N,) from the
    settings and the named columns, in the order of `columns`; one_unit: all columns must have the same unit.
    """

    section: Section
    columns: tuple[str, ...]
    function: Callable[..., np.ndarray]
    one_unit: bool = False

    def needs(self, settings: Settings) -> list[str]:
        """The columns that these settings ask for."""
        keys = [settings[key] for key in self.columns]
        return [column for key in keys for column in ([key] if isinstance(key, str) else key)]

    def compute(self, columns: Columns, settings: Settings) -> np.ndarray:
        """The derived column (N,)."""
        keys = [settings[key] for key in self.columns]
        arrays = [columns[key] if isinstance(key, str) else [columns[c] for c in key] for key in keys]
        return np.asarray(self.function(settings, *arrays))


WATER_TO_AIR = 18.015268 / 28.9652
"""Ratio of the molar masses of water and dry air."""


AIR_C = 100.0
"""°C, below and above zero: no air that an engine breathes is outside. The formula has a pole at −241 °C, and does not
hold for water that boils."""


def saturation_pressure(temperature_K: np.ndarray, pressure_Pa: np.ndarray) -> np.ndarray:
    """Vapour pressure over water in moist air, in Pa, −20 to 50 °C within 0.1 %; NaN outside ±AIR_C.

    e_s = f · 6.1121 hPa · exp(17.502 t / (240.97 + t)), f = 1.0007 + 3.46e-6 p, with t in °C and p in hPa
    (Buck 1981, J. Appl. Meteorol. 20, curves ew1 and fw3).
    """
    t = temperature_K - 273.15
    t = np.where(np.abs(t) <= AIR_C, t, np.nan)
    enhancement = 1.0007 + 3.46e-6 * pressure_Pa / 100.0
    return enhancement * 611.21 * np.exp(17.502 * t / (240.97 + t))


def humidity_ratio(relative: np.ndarray, temperature_K: np.ndarray, pressure_Pa: np.ndarray) -> np.ndarray:
    """w = 0.622 e / (p − e) in kg/kg, with e = φ e_s; φ cut to 0 to 1 (sensors read up to 1.002).

    NaN where e ≥ p: no air is at such a pressure and temperature.
    """
    vapour = np.clip(relative, 0.0, 1.0) * saturation_pressure(temperature_K, pressure_Pa)
    vapour = np.where(vapour < pressure_Pa, vapour, np.nan)
    return WATER_TO_AIR * vapour / (pressure_Pa - vapour)


HUMIDITY_RATIO = DerivationRule(
    Section(
        "humidity_ratio",
        "water per dry air from the relative humidity, in kg/kg",
        (
            Field("relative", "text", "column of the relative humidity, 0 to 1", "relative_humidity"),
            Field("temperature", "text", "column of the air temperature", "ambient_temperature_K"),
            Field("pressure", "text", "column of the air pressure", "ambient_pressure_Pa"),
        ),
    ),
    ("relative", "temperature", "pressure"),
    lambda settings, relative, temperature, pressure: humidity_ratio(relative, temperature, pressure),
)


SEA_LEVEL_K = 288.15
"""Standard atmosphere at sea level (ISO 2533:1975)."""
LAPSE_K_M = 0.0065
"""Its fall with altitude up to the tropopause (ISO 2533:1975)."""
TROPOPAUSE_M = 11000.0
"""Geopotential altitude from which it is constant (ISO 2533:1975)."""


def isa_temperature(altitude_m: np.ndarray) -> np.ndarray:
    """T_ISA in K at a pressure altitude (N,) in m, below 20 km: 288.15 − 0.0065 h, then 216.65."""
    return SEA_LEVEL_K - LAPSE_K_M * np.minimum(altitude_m, TROPOPAUSE_M)


ISA_DEVIATION = DerivationRule(
    Section(
        "isa_deviation",
        "static temperature minus that of the standard atmosphere, in K",
        (
            Field("temperature", "text", "column of the static air temperature", "ambient_temperature_K"),
            Field("altitude", "text", "column of the pressure altitude", "altitude_m"),
        ),
    ),
    ("temperature", "altitude"),
    lambda settings, temperature, altitude: temperature - isa_temperature(altitude),
)


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


MACH_FROM_CAS = DerivationRule(
    Section(
        "mach_from_cas",
        "Mach number from calibrated airspeed and pressure altitude, subsonic",
        (
            Field("cas", "text", "column of the calibrated airspeed", "cas_m_s"),
            Field("altitude", "text", "column of the pressure altitude", "altitude_m"),
        ),
    ),
    ("cas", "altitude"),
    lambda settings, cas, altitude: mach_from_cas(cas, altitude),
)


GAMMA = 1.4
"""Ratio of specific heats of air below 320 K, where probes of the outside air work."""


def static_temperature(total_K: np.ndarray, mach: np.ndarray, recovery: float = 1.0) -> np.ndarray:
    """T = T_t / (1 + r (γ − 1)/2 M²), in K, with the probe's recovery factor r."""
    return total_K / (1.0 + recovery * 0.5 * (GAMMA - 1.0) * mach**2)


STATIC_TEMPERATURE = DerivationRule(
    Section(
        "static_temperature",
        "static from total air temperature, in K",
        (
            Field("total", "text", "column of the total temperature", "T2_K"),
            Field("mach", "text", "column of the Mach number", "mach"),
            Field("recovery", "number", "recovery factor of the probe", 1.0, minimum=0.0, maximum=1.0),
        ),
    ),
    ("total", "mach"),
    lambda settings, total, mach: static_temperature(total, mach, settings["recovery"]),
)


GAS_CONSTANT = 287.05287
"""Of air in J/(kg K), as in the standard atmosphere (ISO 2533:1975)."""


def mach_from_tas(tas_m_s: np.ndarray, temperature_K: np.ndarray, recovery: float = 0.0) -> np.ndarray:
    """M = V/√(γ R T) with the static temperature; with a total one, T = T_t − r V² (γ − 1)/(2 γ R).

    The second is T = T_t/(1 + r (γ − 1)/2 M²) solved for T at the speed V (energy equation of a perfect gas).
    recovery: r of the total temperature probe; 0 for a static temperature. NaN where V exceeds what T_t allows.
    """
    static = temperature_K - recovery * tas_m_s**2 * (GAMMA - 1.0) / (2.0 * GAMMA * GAS_CONSTANT)
    return tas_m_s / np.sqrt(GAMMA * GAS_CONSTANT * np.where(static > 0.0, static, np.nan))


MACH_FROM_TAS = DerivationRule(
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
    ("tas", "temperature"),
    lambda settings, tas, temperature: mach_from_tas(tas, temperature, settings["recovery"] * settings["total"]),
)


def consensus(readings: np.ndarray, agree_within: float, least: int = 1, *, median: bool = False) -> np.ndarray:
    """(N,) mean or median of the probes (P, N) of the largest group that agrees: all within `agree_within` of one of
    them. NaN where fewer than `least` agree, and where two groups that share no probe are as large: nobody knows which
    of two is wrong."""
    known = np.isfinite(readings)
    with np.errstate(invalid="ignore"):
        near = np.abs(readings[:, None, :] - readings[None, :, :]) <= agree_within  # (P, P, N), false where missing
    size = near.sum(axis=1)
    best = np.argmax(size, axis=0)
    most = np.max(size, axis=0, initial=0)
    group = np.take_along_axis(near, best[None, None, :], axis=0)[0]
    apart = ~np.einsum("pqn,qn->pn", near, group).astype(bool) & known  # probes with no neighbour in the group
    tied = ((size == most) & apart).any(axis=0)
    taken = np.where(group, readings, np.nan)
    good = (most >= max(least, 1)) & ~tied
    result = np.full(readings.shape[1], np.nan)
    if good.any():
        result[good] = (np.nanmedian if median else np.nanmean)(taken[:, good], axis=0)
    return result


SUM = DerivationRule(
    Section(
        "sum",
        "sum of columns in one unit, as a gauge pressure and the ambient pressure",
        (
            Field("of", "texts", "columns to add"),
            Field("minus", "texts", "columns to subtract", ()),
        ),
    ),
    ("of", "minus"),
    lambda settings, added, subtracted: reduce(np.subtract, subtracted, np.sum(added, axis=0)),
    one_unit=True,
)

CONSENSUS = DerivationRule(
    Section(
        "consensus",
        "mean of those redundant probes that agree; missing where no group of them is the largest",
        (
            Field("of", "texts", "columns of the probes, in one unit"),
            Field("agree_within", "number", "largest difference of probes that agree, in that unit", minimum=0.0),
            Field("least", "integer", "fewest probes that must agree; others missing, one may do", 1, minimum=1),
            Field("take", "choice", "what is taken of those that agree", "mean", choices=("mean", "median")),
        ),
    ),
    ("of",),
    lambda settings, probes: consensus(
        np.array(probes), settings["agree_within"], settings["least"], median=settings["take"] == "median"
    ),
    one_unit=True,
)

PRODUCT = DerivationRule(
    Section(
        "product",
        "factor times the product of some columns over the product of others",
        (
            Field("of", "texts", "columns to multiply"),
            Field("over", "texts", "columns to divide by", ()),
            Field("factor", "number", "constant factor", 1.0),
        ),
    ),
    ("of", "over"),
    lambda settings, factors, divisors: settings["factor"] * reduce(np.divide, divisors, np.prod(factors, axis=0)),
)


def lowpass(values: np.ndarray, time_s: np.ndarray, time_constant_s: float) -> np.ndarray:
    """Low-pass (N,) of values at any time stamps: τ dy/dt = x − y, with y = x at the first record.

    Exact between records for x held over each step: y_k = b y_{k−1} + (1 − b) x_k, b = exp(−Δt/τ), solved as
    one bidiagonal system. Where x is missing y is held; where time runs backwards (files joined) it starts
    afresh.
    """
    from scipy.linalg import solve_banded

    known = np.isfinite(values)
    if not known.any():
        return np.full(len(values), np.nan)
    step = np.diff(time_s, prepend=time_s[0])
    decay = np.where(step >= 0.0, np.exp(-np.maximum(step, 0.0) / time_constant_s), 0.0)
    decay = np.where(known, decay, 1.0)
    start = int(np.argmax(known))
    decay[: start + 1] = 0.0
    x = np.where(known, values, 0.0)
    x[:start] = values[start]
    bands = np.zeros((2, len(x)))
    bands[0] = 1.0
    bands[1, :-1] = -decay[1:]
    result: np.ndarray = solve_banded((1, 0), bands, (1.0 - decay) * x)
    return result


SOAK = DerivationRule(
    Section(
        "soak",
        "a column minus its own low-pass, computed at the rate of the file, before averaging",
        (
            Field("column", "text", "column that drives the soak, e.g. N1_rpm"),
            Field("time_constant_s", "number", "time constant of the low-pass", unit="s", minimum=1e-3),
            Field("time", "text", "column of the time", "time_s"),
        ),
    ),
    ("column", "time"),
    lambda settings, values, time_s: values - lowpass(values, time_s, settings["time_constant_s"]),
)


@dataclass(frozen=True)
class GapFill:
    """method: "hold" the last reading, or "interpolate" in time between two (in records without time_s); records: the
    most records that a reading is carried, or that two readings lie apart. What is further stays missing."""

    method: str
    records: int


class GapFiller:
    """Fills columns of a stream; what waits for the next reading of an interpolated column is handed out later, so the
    result does not depend on chunks."""

    def __init__(self, fills: Mapping[str, GapFill]):
        self._fills = fills
        self._reach = max((f.records for f in fills.values()), default=0)
        self._held: Recording | None = None
        self._done = 0

    def add(self, recording: Recording, *, end: bool = False) -> Recording:
        """The records that have become final by these."""
        if not self._fills:
            return recording
        every = concat([self._held, recording]) if self._held is not None else recording
        n = len(every)
        final = n if end else min([n, *(self._ready(every[c], f) for c, f in self._fills.items())])
        final = max(final, self._done)
        time = every["time_s"] if "time_s" in every else np.arange(float(n))
        filled = every.with_columns({c: fill_gaps(every[c], time, f) for c, f in self._fills.items()})
        result = filled.select(slice(self._done, final))
        first = max(0, final - self._reach - 1)
        self._held, self._done = every.select(slice(first, None)), final - first
        return result

    def _ready(self, values: np.ndarray, how: GapFill) -> int:
        n = len(values)
        if how.method == "hold":
            return n
        known = np.flatnonzero(np.isfinite(values))
        return max(int(known[-1]) + 1 if known.size else 0, n - how.records)


def fill_gaps(values: np.ndarray, time: np.ndarray, how: GapFill) -> np.ndarray:
    """(N,) values with gaps filled as `how` says; time: (N,) at which they were read."""
    n = len(values)
    known = np.isfinite(values)
    if not known.any():
        return values
    rows = np.arange(n)
    before = np.maximum.accumulate(np.where(known, rows, -1))
    if how.method == "hold":
        carried = ~known & (before >= 0) & (rows - before <= how.records)
        return np.where(carried, values[before], values)
    after = np.minimum.accumulate(np.where(known, rows, n)[::-1])[::-1]
    between = ~known & (before >= 0) & (after < n)
    between &= np.where(between, after - before, 0) <= how.records
    a, b = before[between], after[between]
    span = time[b] - time[a]
    with np.errstate(invalid="ignore", divide="ignore"):
        share = np.where(span > 0.0, (time[rows[between]] - time[a]) / span, np.nan)
    result = values.copy()
    result[between] = values[a] + share * (values[b] - values[a])
    return result


RULES: dict[str, DerivationRule] = {
    rule.section.name: rule
    for rule in (
        CONSENSUS,
        HUMIDITY_RATIO,
        ISA_DEVIATION,
        MACH_FROM_CAS,
        MACH_FROM_TAS,
        PRODUCT,
        SOAK,
        STATIC_TEMPERATURE,
        SUM,
    )
}
