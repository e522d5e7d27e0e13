"""The units of a file's columns, where it does not state them: one posterior over all of them together.

An axis is a group of columns that are recorded in one unit (the temperatures of the outside air, those of the gas
path, …). Each combination of units is judged by a prior (which units are usual), by whether each column's median can
be what it is taken for, and by what physics says of columns together: total and static temperature at a Mach number,
the standard atmosphere, airspeed against Mach number, and the work of a compressor. The probability of the other
combinations is doubt.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from enginediag_cli.recordings.derived import isa_pressure, isa_temperature, mach_from_cas, static_temperature
from enginediag_cli.units import UNITS, find_unit, split_column

PRIORS: Mapping[str, Mapping[str, float]] = {
    "air temperature": {"degC": 0.70, "K": 0.15, "degF": 0.10, "degR": 0.05},
    "gas temperature": {"degC": 0.45, "K": 0.30, "degF": 0.15, "degR": 0.10},
    "indicated temperature": {"degC": 0.75, "K": 0.10, "degF": 0.10, "degR": 0.05},
    "air pressure": {"mbar": 0.3, "kPa": 0.2, "psi": 0.2, "Pa": 0.1, "bar": 0.1, "inHg": 0.1},
    "pressure": {"psi": 0.35, "kPa": 0.25, "bar": 0.25, "Pa": 0.10, "MPa": 0.03, "mbar": 0.02},
    "altitude": {"ft": 0.80, "m": 0.17, "kft": 0.03},
    "airspeed": {"kt": 0.85, "m_s": 0.10, "kmh": 0.05},
    "fuel flow": {"kg_h": 0.35, "lb_h": 0.35, "kg_s": 0.15, "lb_s": 0.10, "g_s": 0.05},
    "flow": {"kg_s": 0.6, "lb_s": 0.4},
    "torque": {"Nm": 0.35, "lbf_ft": 0.25, "pct": 0.35, "kNm": 0.05},
    "power": {"kW": 0.4, "MW": 0.3, "W": 0.15, "hp": 0.15},
    "thrust": {"N": 0.3, "kN": 0.35, "lbf": 0.35},
    "difference of pressure": {"mbar": 0.4, "kPa": 0.2, "Pa": 0.2, "psi": 0.2},
    "humidity": {"pct": 0.9, "1": 0.1},
    "speed": {"rpm": 0.5, "pct": 0.5},
}
"""Axis → unit → how usual it is in flight recorders, test benches and plants, before any value is seen."""
ALIKE = (
    ("air temperature", "gas temperature", 0.05),
    ("gas temperature", "indicated temperature", 0.1),
    ("air temperature", "indicated temperature", 0.1),
    ("air pressure", "pressure", 0.3),
)
"""Axes that one file mostly records in one unit, and the prior's factor where it does not. What a cockpit indicates
(EGT, ITT) is mostly in °C, whatever the rest is in."""
INDICATED = ("EGT", "ITT")
STATED_ELSEWHERE = 0.1
"""The prior's factor for a unit other than that which columns of the axis state."""
CERTAIN = 0.98
"""Probability from which an inferred unit is a guess; below it is the user's to decide."""
WORTH_NAMING = 0.02
"""Probability from which another unit is named beside the likeliest."""
WORST = -18.0
"""Least ln likelihood of one fact: one column that is something else must not outweigh all others."""
_RECORDS = 64
"""Records, evenly chosen, at which columns are compared with each other; more say the same again."""

Limits = Mapping[str, tuple[float, float]]
"""Target → lowest and highest value in SI that an engine file allows."""


@dataclass(frozen=True)
class InferredUnit:
    """A column's unit: the likeliest, its probability, and other units that are possible with theirs."""

    unit: str
    probability: float
    others: tuple[tuple[str, float], ...]

    @property
    def certain(self) -> bool:
        """Whether it may be taken as a guess."""
        return self.probability >= CERTAIN


def unit_axis(target: str) -> str:
    """The axis of a target column, or an empty text where its unit is not inferred."""
    quantity, own = split_column(target)
    dimension = find_unit(own or "1").dimension
    if target == "dT_isa_K":
        return ""
    if dimension == "temperature":
        air = quantity in ("ambient_temperature", "TAT", "T0", "T1", "T2")
        return "air temperature" if air else "indicated temperature" if quantity in INDICATED else "gas temperature"
    if dimension == "pressure":
        if quantity.startswith("dP_"):
            return "difference of pressure"
        return "air pressure" if quantity == "ambient_pressure" else "pressure"
    if dimension == "mass flow":
        return "fuel flow" if quantity == "Wf" else "flow"
    if target == "relative_humidity":
        return "humidity"
    return {
        "length": "altitude",
        "speed": "airspeed",
        "torque": "torque",
        "power": "power",
        "force": "thrust",
        "rotational speed": "speed",
    }.get(dimension, "")


_FARTHEST = 1e3
"""Soft steps outside limits beyond which it makes no difference how many they are."""
_DEVIATION_PER_STEP = 0.04
"""Relative distance from a usual range that counts as one standard deviation: ranges are soft by a few per cent."""

_FURTHER_RANGES: Mapping[str, tuple[float, float]] = {
    "mach": (0.0, 1.2),
    "cas_m_s": (0.0, 230.0),
    "tas_m_s": (0.0, 320.0),
    "relative_humidity": (0.02, 1.05),
    "TAT_K": (200.0, 340.0),
    "torque_Nm": (20.0, 5e5),
    "power_W": (1e3, 6e8),
    "Fn_N": (20.0, 6e5),
    "Fg_N": (20.0, 6e5),
    "dP_inlet_Pa": (20.0, 4e3),
    "dP_exhaust_Pa": (50.0, 1e4),
    "BPR": (0.1, 15.0),
    "EPR": (0.8, 5.0),
}
"""Ranges of medians of quantities that `acceptance.USUAL` does not hold, in SI, as wide as engines differ."""


def median_range(target: str, limits: Limits | None = None) -> tuple[float, float] | None:
    """Where a target's median usually lies, in SI; by the engine's own limits where they are known."""
    quantity, own = split_column(target)
    between = quantity[:1] in ("T", "P") and quantity[1:2] == "2" and quantity[1:].isdigit() and len(quantity) > 2
    # all stations between the compressors are alike
    known = usual_range(f"{quantity[0]}25" if between else quantity, find_unit(own or "1").dimension)
    usual = (known.low, known.high) if known else _FURTHER_RANGES.get(target)
    own_limits = (limits or {}).get(target)
    if own_limits is None:
        return usual
    low, high = own_limits
    return (
        (max(low, usual[0]), min(high, usual[1])) if usual and max(low, usual[0]) < min(high, usual[1]) else (low, high)
    )


def outside(value: float, limits: tuple[float, float] | None) -> float:
    """How many soft steps a value lies outside limits, 1,000 at most; 0 within."""
    if limits is None or np.isnan(value):
        return 0.0
    low, high = limits
    scale = max(abs(low), abs(high)) if low <= 0.0 else None
    if value < low:
        return min((low - value) / (_DEVIATION_PER_STEP * (scale or low)), _FARTHEST)
    if value > high:
        return min((value - high) / (_DEVIATION_PER_STEP * (scale or high)), _FARTHEST)
    return 0.0


@dataclass(frozen=True)
class UnitColumn:
    """A column whose unit is sought: its target, N values as the file has them, and the unit and factor it states."""

    target: str
    values: np.ndarray
    unit: str = ""
    scale: float = 1.0

    def si_values(self, unit: str) -> np.ndarray:
        """Values (N,) in SI, read in that unit."""
        known = find_unit(self.unit or unit)
        with np.errstate(over="ignore"):
            return self.values * self.scale * known.factor + known.offset


@dataclass(frozen=True)
class PhysicalFact:
    """Columns that physics holds together, and by how many standard deviations they disagree, record by record."""

    targets: tuple[str, ...]
    judge: Callable[[Mapping[str, np.ndarray]], np.ndarray]


def _total_and_static(c: Mapping[str, np.ndarray]) -> np.ndarray:
    # T_t = T (1 + 0.2 M²): probes of both agree within some kelvin
    return (static_temperature(c["TAT_K"], c["mach"]) - c["ambient_temperature_K"]) / 3.0


def _standard_atmosphere(c: Mapping[str, np.ndarray]) -> np.ndarray:
    # air is within about 12 K of the standard atmosphere (standard deviation over seasons and latitudes)
    return (c["ambient_temperature_K"] - isa_temperature(c["altitude_m"])) / 12.0


def _standard_atmosphere_total(c: Mapping[str, np.ndarray]) -> np.ndarray:
    return (static_temperature(c["TAT_K"], c["mach"]) - isa_temperature(c["altitude_m"])) / 12.0


def _pressure_at_altitude(c: Mapping[str, np.ndarray]) -> np.ndarray:
    # pressure altitude is a pressure; geometric altitude differs by the weather, 3 %
    return np.log(np.maximum(c["ambient_pressure_Pa"], 1.0) / isa_pressure(c["altitude_m"])) / 0.03


def _pressure_on_the_ground(c: Mapping[str, np.ndarray]) -> np.ndarray:
    # most plants stand below 1,000 m, and weather is 3 %
    return np.log(np.maximum(c["ambient_pressure_Pa"], 1.0) / 97e3) / 0.06


def _airspeed_and_mach(c: Mapping[str, np.ndarray]) -> np.ndarray:
    # 0.02: calibrated against indicated airspeed, and readings of different moments
    return (mach_from_cas(c["cas_m_s"], c["altitude_m"]) - c["mach"]) / 0.02


def _compressor_work(exit_pressure: str, air: str, pressure: str) -> PhysicalFact:
    """The work of compression between the air at the inlet and station 3; without a column of the air, or of its
    pressure, they are those of the standard atmosphere at the altitude and Mach number."""
    known = air != "altitude_m" and pressure != "altitude_m"
    # polytropic efficiency 0.86 ± 0.06; a deviation of 12 K from the standard atmosphere is 0.05 of it
    spread = 0.06 if known else 0.08

    def judge(c: Mapping[str, np.ndarray]) -> np.ndarray:
        ram = 1.0 + 0.2 * c.get("mach", np.zeros(1)) ** 2
        inlet = isa_temperature(c[air]) * ram if air == "altitude_m" else c[air]
        total = isa_pressure(c[pressure]) * ram**3.5 if pressure == "altitude_m" else c[pressure]
        # ln(T3/T2) = (γ − 1)/(γ e) ln(P3/P2), with (γ − 1)/γ = 0.28 over the compressor's temperatures
        return (0.28 * np.log(c[exit_pressure] / total) / np.log(c["T3_K"] / inlet) - 0.86) / spread

    mach = ("mach",) if "altitude_m" in (air, pressure) else ()
    return PhysicalFact(tuple(dict.fromkeys(("T3_K", exit_pressure, air, pressure, *mach))), judge)


def _thermal_efficiency(c: Mapping[str, np.ndarray]) -> np.ndarray:
    # shaft power over the heat of the fuel (43 MJ/kg): 0.28 ± 0.07 from small engines to large ones, at high power
    return (c["power_W"] / (c["Wf_kg_s"] * 43e6) - 0.28) / 0.07


FACTS: Sequence[Sequence[PhysicalFact]] = (
    (PhysicalFact(("TAT_K", "ambient_temperature_K", "mach"), _total_and_static),),
    (
        PhysicalFact(("ambient_temperature_K", "altitude_m"), _standard_atmosphere),
        PhysicalFact(("TAT_K", "altitude_m", "mach"), _standard_atmosphere_total),
    ),
    (PhysicalFact(("ambient_pressure_Pa", "altitude_m"), _pressure_at_altitude),),
    (PhysicalFact(("cas_m_s", "altitude_m", "mach"), _airspeed_and_mach),),
    tuple(
        _compressor_work(exit_pressure, air, pressure)
        for exit_pressure in ("P3_Pa", "Ps3_Pa")
        for air in ("T2_K", "TAT_K", "T1_K", "ambient_temperature_K", "altitude_m")
        for pressure in ("P2_Pa", "ambient_pressure_Pa", "altitude_m")
    ),
    (PhysicalFact(("power_W", "Wf_kg_s"), _thermal_efficiency),),
)
"""What physics says of columns together; of the forms of one fact that which is recorded and comes first."""
ON_THE_GROUND = (PhysicalFact(("ambient_pressure_Pa",), _pressure_on_the_ground),)
"""What it says of a machine without a column of FLIGHT."""
FLIGHT = frozenset(("altitude_m", "mach", "cas_m_s", "tas_m_s", "TAT_K"))


def infer_units(columns: Sequence[UnitColumn], limits: Limits | None = None) -> list[InferredUnit | None]:
    """The unit of each column that states none, from all columns together; None where it states one, or where nothing
    is known of its kind. Speeds are judged one by one, since % of each shaft is its own."""
    axes = [unit_axis(c.target) for c in columns]
    names = list(dict.fromkeys(a for a, c in zip(axes, columns, strict=True) if a and a != "speed" and not c.unit))
    options = {a: tuple(PRIORS[a]) for a in names}
    factors: list[Factor] = [(_axis_evidence(a, columns, axes, limits), (a,)) for a in names]
    for one, other, factor in ALIKE:
        if one in names and other in names:
            same = np.array([[0.0 if u == v else np.log(factor) for v in options[other]] for u in options[one]])
            factors.append((same, (one, other)))
    flies = FLIGHT & {c.target for c in columns}
    for forms in (*FACTS, *(() if flies else (ON_THE_GROUND,))):
        found = (_joint_likelihood(form, columns, axes, options) for form in forms)
        factors += [f for f in found if f is not None][:1]
    marginal = _marginals(names, options, factors)
    result: list[InferredUnit | None] = []
    for c, a in zip(columns, axes, strict=True):
        if c.unit or not a:
            result.append(None)
        else:
            result.append(_speed_unit(c, limits) if a == "speed" else _best(marginal[a]))
    return result


Factor = tuple[np.ndarray, tuple[str, ...]]
"""ln likelihood over the units of some axes, and these axes."""


def _marginals(
    names: Sequence[str], options: Mapping[str, tuple[str, ...]], factors: Sequence[Factor]
) -> dict[str, dict[str, float]]:
    """Probability of each unit of each axis. Only axes that a factor holds together are enumerated together, at most
    some hundred thousand combinations."""
    bound = {a for _, joined in factors if len(joined) > 1 for a in joined}
    groups = [[a for a in names if a in bound], *([a] for a in names if a not in bound)]
    marginal: dict[str, dict[str, float]] = {}
    for group in groups:
        log = np.zeros(tuple(len(options[a]) for a in group))
        for values, joined in factors:
            if joined[0] in group:
                log = log + _broadcast(values, group, joined)
        weight = np.exp(log - log.max())
        weight /= weight.sum()
        for k, a in enumerate(group):
            others = tuple(i for i in range(len(group)) if i != k)
            marginal[a] = dict(zip(options[a], weight.sum(axis=others), strict=True))
    return marginal


def _axis_evidence(axis: str, columns: Sequence[UnitColumn], axes: Sequence[str], limits: Limits | None) -> np.ndarray:
    """ln of prior times plausibility for each unit of an axis."""
    mine = [c for c, a in zip(columns, axes, strict=True) if a == axis]
    twin = {a for one, other, _ in ALIKE if axis in (one, other) for a in (one, other)} - {axis}
    stated = {c.unit for c in mine if c.unit}
    beside = {c.unit for c, a in zip(columns, axes, strict=True) if a in twin and c.unit}
    result = []
    for unit, prior in PRIORS[axis].items():
        value = np.log(prior)
        if stated or beside:
            value += 0.0 if unit in (stated or beside) else np.log(STATED_ELSEWHERE)
        for c in mine:
            if not c.unit:
                value += likelihood_of_range(c, unit, limits)
        result.append(value)
    return np.array(result)


def likelihood_of_range(column: UnitColumn, unit: str, limits: Limits | None = None) -> float:
    """ln likelihood, 0 at most, that the column's median in that unit is what its target usually is."""
    if find_unit(unit).dimension == "ratio" and split_column(column.target)[1]:
        return 0.0 if np.nanmax(np.abs(column.values)) <= _FULL_SCALE_PCT else WORST
    median = finite_median(column.si_values(unit))
    return float(max(-0.5 * outside(median, median_range(column.target, limits)) ** 2, WORST))


_FULL_SCALE_PCT = 135.0
"""Largest reading of a speed or torque in %: overspeed and overtorque included."""


def _joint_likelihood(
    fact: PhysicalFact, columns: Sequence[UnitColumn], axes: Sequence[str], options: Mapping[str, tuple[str, ...]]
) -> Factor | None:
    """ln likelihood over the units of the axes that a fact leaves open, or None where a column is not recorded."""
    mine = {c.target: (c, a) for c, a in zip(columns, axes, strict=True) if c.target in fact.targets}
    if len(mine) < len(fact.targets):
        return None
    if any(not c.unit and a and a not in options for c, a in mine.values()):
        return None
    open_axes = tuple(dict.fromkeys(a for c, a in mine.values() if a and not c.unit))
    if not open_axes:
        return None
    result = np.zeros(tuple(len(options[a]) for a in open_axes))
    for index in np.ndindex(*result.shape):
        units = {a: options[a][k] for a, k in zip(open_axes, index, strict=True)}
        si = {t: _subsample(c.si_values(units.get(a, "1") if not c.unit else c.unit)) for t, (c, a) in mine.items()}
        with np.errstate(all="ignore"):
            apart = np.abs(fact.judge(si))
        apart = apart[np.isfinite(apart)]
        result[index] = max(-0.5 * float(np.median(apart)) ** 2, WORST) if apart.size else WORST
    return result, open_axes


def _subsample(values: np.ndarray) -> np.ndarray:
    return values[np.unique(np.linspace(0, len(values) - 1, _RECORDS).astype(int))]


def _broadcast(values: np.ndarray, names: Sequence[str], axes: Sequence[str]) -> np.ndarray:
    """An array over some axes, as one that broadcasts over all of them."""
    order = sorted(range(len(axes)), key=lambda k: names.index(axes[k]))
    moved = np.transpose(values, order)
    shape = [1] * len(names)
    for size, k in zip(moved.shape, order, strict=True):
        shape[names.index(axes[k])] = size
    return moved.reshape(shape)


def _best(marginal: Mapping[str, float]) -> InferredUnit:
    ranked = sorted(marginal.items(), key=lambda item: -item[1])
    others = tuple((unit, float(p)) for unit, p in ranked[1:] if p >= WORTH_NAMING)
    return InferredUnit(ranked[0][0], float(ranked[0][1]), others)


def _speed_unit(column: UnitColumn, limits: Limits | None) -> InferredUnit:
    """rpm or %: no shaft turns at 135 rpm, and none reads a thousand %."""
    log = {u: np.log(p) + likelihood_of_range(column, u, limits) for u, p in PRIORS["speed"].items()}
    best = max(log.values())
    weight = {u: float(np.exp(v - best)) for u, v in log.items()}
    return _best({u: w / sum(weight.values()) for u, w in weight.items()})


@dataclass(frozen=True)
class UsualRange:
    """What the readings of a quantity usually lie within, in SI; narrower than what a sensor can give."""

    pattern: str
    low: float
    high: float


USUAL = {
    "temperature": (
        UsualRange(r"(ambient_)?(temperature|SAT|sat|OAT|oat)|T0", 190.0, 335.0),
        UsualRange(r"T1\d*|T2|TAT|tat", 200.0, 360.0),
        UsualRange(r"T21\d*|T25\d*", 230.0, 700.0),
        UsualRange(r"T3\d*", 350.0, 1050.0),
        UsualRange(r"T4\d*|TIT|ITT|itt", 600.0, 2300.0),
        UsualRange(r"T5\d*|T6\d*|EGT|egt|TGT", 350.0, 1500.0),
    ),
    "pressure": (
        UsualRange(r"(ambient_)?pressure|P0", 5e3, 1.1e5),
        UsualRange(r"P1\d*|P2", 1.8e4, 2.5e5),
        UsualRange(r"P21\d*|P25\d*", 1.5e4, 1e6),
        UsualRange(r"Ps?3\d*|Ps?4", 5e4, 6e6),
        UsualRange(r"P4\d|P5\d*|P6\d*", 1.5e4, 2e6),
    ),
    "rotational speed": (UsualRange(r"N\d*|Np|Ng", 200.0, 2.5e5),),
    "mass flow": (UsualRange(r"Wf|fuel_flow|fuel", 3e-4, 15.0),),
    "length": (UsualRange(r"altitude|alt", -500.0, 20_000.0),),
}
"""Dimension → ranges of quantities by ARP755 station, of gas turbines from 10 kW to 400 MW, from idle up. They say
whether a unit can be: a median outside is a question to the user, never a mask."""


@dataclass(frozen=True)
class UnitDoubt:
    """A column whose median cannot be in its unit, and the units of its dimension in which it could."""

    column: str
    unit: str
    median: float
    low: float
    high: float
    plausible: tuple[str, ...]


def unit_doubt(column: str, values: np.ndarray) -> UnitDoubt | None:
    """The doubt about a column's unit, or None where its median (N values) can be, or nothing is known about it."""
    quantity, suffix = split_column(column)
    finite = values[np.isfinite(values)]
    if not suffix or not finite.size:
        return None
    unit = find_unit(suffix)
    usual = usual_range(quantity, unit.dimension)
    median = finite_median(finite)
    if usual is None or usual.low <= median * unit.factor + unit.offset <= usual.high:
        return None
    plausible = tuple(
        name
        for name, other in UNITS.items()
        if other.dimension == unit.dimension and usual.low <= median * other.factor + other.offset <= usual.high
    )
    low, high = ((limit - unit.offset) / unit.factor for limit in (usual.low, usual.high))
    return UnitDoubt(column, suffix, median, low, high, plausible)


def finite_median(values: np.ndarray) -> float:
    """The median of the values (N,) that are there; infinite where it is at the end of what a float holds."""
    with np.errstate(over="ignore"):
        return float(np.nanmedian(values))


def usual_range(quantity: str, dimension: str) -> UsualRange | None:
    """The usual range of a quantity of that name, perhaps behind an engine's prefix (`lh_T3`)."""
    for known in USUAL.get(dimension, ()):
        if re.fullmatch(rf"([A-Za-z]+\d*_)?({known.pattern})", quantity):
            return known
    return None


MOST_OUTSIDE = 0.01
"""Share of the readings outside the proposed limits from which these, or the unit, are doubtful."""


MOST_FILLERS = 0.3
"""Share of readings that may be one or two values far away, such as 9999, which limits then shut out."""


_LIMITS: Mapping[str, tuple[float, float]] = {
    "altitude_m": (-600.0, 20_000.0),
    "mach": (-0.05, 1.5),
    "cas_m_s": (-5.0, 350.0),
    "tas_m_s": (-5.0, 450.0),
    "relative_humidity": (0.0, 1.1),
    "ambient_temperature_K": (180.0, 345.0),
    "ambient_pressure_Pa": (5e3, 1.15e5),
    "TAT_K": (180.0, 360.0),
    "BPR": (0.0, 20.0),
    "EPR": (0.5, 6.0),
}
"""What readings can truthfully be, in SI, beyond any flight or site: for the air around."""


_LIMITS_BY_DIMENSION: Mapping[str, tuple[float, float]] = {
    "temperature": (0.8, 1.15),
    "pressure": (0.3, 1.1),
    "mass flow": (0.0, 2.0),
}
"""Factors on the usual range of a median (`unit_inference.range_of`) between which every reading must lie: start,
idle and overshoot included."""


def propose_limits(
    target: str, values: np.ndarray, possible: float | None = None
) -> tuple[tuple[float, float] | None, tuple[str, ...]]:
    """Plausible limits of a target in SI, wider than the usual range, with a doubt where more than one reading in a
    hundred (N values in SI) lies outside them. possible: the largest reading that the engine file holds possible."""
    _quantity, own = split_column(target)
    limits = _LIMITS.get(target)
    usual = median_range(target)
    factors = _LIMITS_BY_DIMENSION.get(find_unit(own or "1").dimension)
    if limits is None and usual is not None and factors is not None:
        low = 200.0 if own == "K" else factors[0] * usual[0]  # a cold engine has the temperature of the air
        limits = (low, factors[1] * usual[1])
    if limits is not None and possible is not None:  # a tenth beyond it
        limits = (limits[0], min(limits[1], max(1.1 * possible, limits[0] + 1.0)))
    if limits is None:
        return None, ()
    known = values[np.isfinite(values)]
    if not known.size:
        return limits, ()
    beyond = (known < limits[0]) | (known > limits[1])
    outside = float(np.mean(beyond))
    if outside > MOST_OUTSIDE and not (outside < MOST_FILLERS and len(np.unique(known[beyond])) <= 2):
        text = f"{100 * outside:.0f} % of the readings lie outside {limits[0]:.4g} to {limits[1]:.4g}"
        return None, (f"{text} {own}: another unit, or fill values? add limits",)
    return limits, ()
