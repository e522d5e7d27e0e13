"""Units: which unit a column name carries, and exact conversion to and from SI.

A column is a quantity and the unit it is recorded in: `T3_K`, `Wf_lb_h`. Factors are exact by definition
(NIST SP 811, 2008, appendix B; ISO 80000): 1 in = 25.4 mm, 1 lb = 0.45359237 kg, 1 lbf = 1 lb · 9.80665 m/s²,
1 kt = 1852 m/h. Conventional inHg and inH2O are those of SP 811 (0 °C and 4 °C columns).

Foreign files spell units in other ways: `DEG C`, `LB/HR`, `%RPM`, `psig`, `KFT`, `ft msl`, `x1000 rpm`.
"""

from __future__ import annotations

import math
import re
from dataclasses import dataclass
from functools import cache
from typing import TypeVar

import numpy as np

Value = TypeVar("Value", float, np.ndarray)

DAY_S = 86_400.0
"""A day, in s."""
FIRST_DATE_S, LAST_DATE_S = 3e8, 4e9
"""Seconds since 1970 between which a time is a date (1979 to 2096): no recording that counts from its start is as
long."""


def is_date(time_s: float) -> bool:
    """Whether a time counts from 1970 rather than from the start of a recording."""
    return FIRST_DATE_S <= time_s <= LAST_DATE_S


RAD_S_PER_RPM = math.pi / 30.0
"""Of angular speed: a turn is 2π rad, a minute 60 s."""
_LB = 0.45359237
"""International avoirdupois pound, exact (NIST SP 811)."""
_LBF = _LB * 9.80665
"""Pound-force: one pound at standard gravity, 9.80665 m/s² (NIST SP 811)."""
_PSI = _LBF / 0.0254**2
"""Pound-force per square inch of 0.0254 m (NIST SP 811)."""
_FT = 0.3048
"""International foot, exact (NIST SP 811)."""
_GAL = 231 * 0.0254**3
"""US liquid gallon: 231 cubic inches (SP 811)."""


@dataclass(frozen=True)
class Unit:
    """SI value = factor · value + offset, where the SI unit of the dimension is `si`."""

    name: str
    dimension: str
    si: str
    factor: float
    offset: float = 0.0


class UnitError(ValueError):
    """An unknown unit, or two units that do not measure the same thing."""


_TABLE: dict[tuple[str, str], dict[str, float]] = {
    ("pressure", "Pa"): {
        "Pa": 1.0,
        "kPa": 1e3,
        "hPa": 100.0,
        "MPa": 1e6,
        "bar": 1e5,
        "mbar": 100.0,
        "atm": 101325.0,
        "psi": _PSI,
        "inHg": 3386.389,
        "inH2O": 249.0889,
    },
    ("length", "m"): {"m": 1.0, "ft": _FT, "kft": 1000 * _FT, "km": 1000.0},
    ("speed", "m_s"): {
        "m_s": 1.0,
        "kt": 1852 / 3600,
        "kmh": 1 / 3.6,
        "ft_min": _FT / 60,
        "ft_s": _FT,
        "mph": 1609.344 / 3600,
    },
    ("mass flow", "kg_s"): {
        "kg_s": 1.0,
        "kg_h": 1 / 3600,
        "lb_s": _LB,
        "lb_h": _LB / 3600,
        "lb_min": _LB / 60,
        "kg_min": 1 / 60,
        "g_s": 1e-3,
        "t_h": 1 / 3.6,
    },
    ("volume flow", "m3_s"): {
        "m3_s": 1.0,
        "m3_h": 1 / 3600,
        "l_s": 1e-3,
        "l_min": 1e-3 / 60,
        "l_h": 1e-3 / 3600,
        "gal_min": _GAL / 60,
        "gal_h": _GAL / 3600,
    },
    ("density", "kg_m3"): {"kg_m3": 1.0, "kg_l": 1e3, "lb_gal": _LB / _GAL},
    ("rotational speed", "rpm"): {"rpm": 1.0, "rad_s": 30 / math.pi, "Hz": 60.0},
    ("power", "W"): {"W": 1.0, "kW": 1e3, "MW": 1e6, "hp": 550 * _FT * _LBF},
    ("torque", "Nm"): {"Nm": 1.0, "kNm": 1e3, "lbf_ft": _LBF * _FT},
    ("voltage", "V"): {"V": 1.0, "mV": 1e-3},
    ("force", "N"): {"N": 1.0, "kN": 1e3, "lbf": _LBF},
    ("mass", "kg"): {"kg": 1.0, "lb": _LB},
    ("time", "s"): {"s": 1.0, "min": 60.0, "h": 3600.0},
    ("angle", "rad"): {"rad": 1.0, "deg": math.pi / 180},
    ("ratio", "1"): {"1": 1.0, "pct": 0.01, "kg_kg": 1.0, "g_kg": 1e-3},
    ("area", "m2"): {"m2": 1.0},
    ("flow per pressure", "kg_s_Pa"): {"kg_s_Pa": 1.0, "pph_psi": _LB / 3600 / _PSI},
}

_TEMPERATURES = (
    Unit("K", "temperature", "K", 1.0),
    Unit("degC", "temperature", "K", 1.0, 273.15),
    Unit("degF", "temperature", "K", 5 / 9, 459.67 * 5 / 9),
    Unit("degR", "temperature", "K", 5 / 9),
)

UNITS: dict[str, Unit] = {unit.name: unit for unit in _TEMPERATURES} | {
    name: Unit(name, dimension, si, factor)
    for (dimension, si), factors in _TABLE.items()
    for name, factor in factors.items()
}

ALIASES: dict[str, str] = {
    "psia": "psi",
    "PSI": "psi",
    "PSIA": "psi",
    "kPaA": "kPa",
    "kPa_a": "kPa",
    "bara": "bar",
    "in_Hg": "inHg",
    "shp": "hp",
    "SHP": "hp",
    "HP": "hp",
    "PPH": "lb_h",
    "l/min": "l_min",
    "L/min": "l_min",
    "l/h": "l_h",
    "L/h": "l_h",
    "l/s": "l_s",
    "gal/h": "gal_h",
    "gph": "gal_h",
    "GPH": "gal_h",
    "gal/min": "gal_min",
    "m3/h": "m3_h",
    "m3/s": "m3_s",
    "kg/min": "kg_min",
    "lb/min": "lb_min",
    "g/s": "g_s",
    "kg/m3": "kg_m3",
    "kg/l": "kg_l",
    "lb/gal": "lb_gal",
    "deg C": "degC",
    "deg F": "degF",
    "deg_C": "degC",
    "deg_F": "degF",
    "KT": "kt",
    "KTS": "kt",
    "FT": "ft",
    "feet": "ft",
    "RPM": "rpm",
    "1/min": "rpm",
    "PCT": "pct",
    "N m": "Nm",
    "lbf ft": "lbf_ft",
    "ft lbf": "lbf_ft",
    "lb ft": "lbf_ft",
    "pph": "lb_h",
    "lbm_s": "lb_s",
    "lbm_h": "lb_h",
    "C": "degC",
    "F": "degF",
    "R": "degR",
    "°C": "degC",
    "°F": "degF",
    "°R": "degR",
    "m/s": "m_s",
    "km/h": "kmh",
    "km_h": "kmh",
    "ft/min": "ft_min",
    "fpm": "ft_min",
    "kts": "kt",
    "knots": "kt",
    "kg/s": "kg_s",
    "kg/h": "kg_h",
    "kgh": "kg_h",
    "lb/h": "lb_h",
    "lb/s": "lb_s",
    "lbm/s": "lb_s",
    "lbm/h": "lb_h",
    "t/h": "t_h",
    "rad/s": "rad_s",
    "%": "pct",
    "percent": "pct",
    "ratio": "1",
    "MWh_h": "MW",
    "MWh/h": "MW",
    "N_m": "Nm",
    "sec": "s",
    "kg/kg": "kg_kg",
    "pph/psi": "pph_psi",
}
"""Other spellings. An energy per hour (`MWh_h`: the reading of an hourly meter) is a mean power."""

_NOT_SUFFIXES = frozenset({"1", "C", "F", "R", "ratio"})
"""Never read as a unit at the end of a column name: `flag_1`, `class_C` are names, not quantities."""

UNITLESS_COLUMNS = frozenset({"mach", "BPR", "OPR", "EPR"})
"""Columns that hold a number although their name carries no unit."""


def known_unit(name: str) -> Unit | None:
    """The unit of that name or alias; None where there is none."""
    return UNITS.get(ALIASES.get(name, name))


def find_unit(name: str) -> Unit:
    """The unit of that name or alias.

    Raises UnitError with a near match.
    """
    unit = known_unit(name)
    if unit is not None:
        return unit
    import difflib

    known = [*UNITS, *ALIASES]
    near = [other for other in known if other.lower() == name.lower()] or difflib.get_close_matches(name, known, n=1)
    hint = f"did you mean {near[0]!r}?" if near else "known units: " + ", ".join(UNITS)
    raise UnitError(f"unknown unit {name!r} ({hint})")


def split_column(column: str) -> tuple[str, str]:
    """Quantity and unit suffix of a column: `T3_K` → (`T3`, `K`), `mach` → (`mach`, ``).

    The longest known suffix wins (`climb_ft_min` is in ft_min, not in min).
    """
    parts = column.split("_")
    for start in range(1, len(parts)):
        suffix = "_".join(parts[start:])
        if suffix not in _NOT_SUFFIXES and (suffix in UNITS or suffix in ALIASES) and parts[0]:
            return "_".join(parts[:start]), suffix
    return column, ""


def split_header(header: str) -> tuple[str, str]:
    """As `split_column` for headers of foreign files: also `P3 [kPa]`, `P3 (kPa)`, `P3 kPa`, `P3/kPa` and `P3, kPa`.

    The unit is given as written; empty where none is known.
    """
    bare = header.strip()
    for opening, closing in (("[", "]"), ("(", ")"), ("{", "}")):
        if bare.endswith(closing) and opening in bare:
            quantity, unit = bare[:-1].rsplit(opening, 1)
            if _is_unit(unit.strip()) and quantity.strip():
                return quantity.strip(" _-"), unit.strip()
    for separator in (", ", " ", "/"):
        quantity, _, unit = bare.partition(separator) if separator == "/" else bare.rpartition(separator)
        if quantity.strip() and _is_unit(unit.strip()) and unit.strip() not in _NOT_SUFFIXES:
            return quantity.strip(" _-,"), unit.strip()
    return split_column(bare)


def _is_unit(unit: str) -> bool:
    return unit in UNITS or unit in ALIASES


def is_numeric_column(column: str) -> bool:
    """Whether the name says that the column holds numbers: a unit suffix, or a known unitless quantity."""
    return column in UNITLESS_COLUMNS or split_column(column)[1] != ""


def to_si(value: Value, unit: str, full_scale: float | None = None) -> Value:
    """Value in the SI unit of its dimension (rotational speed: rpm, as everywhere in this program).

    With `full_scale` the value is in % and 100 % is that many units of the result:
    `to_si(98.0, "pct", 15900)` is 15582 rpm. Raises UnitError for an unknown unit, or for a full
    scale given with another unit than %.
    """
    known = find_unit(unit)
    if full_scale is not None:
        if known.name != "pct":
            raise UnitError(f"a full scale belongs to a reading in pct, not in {unit}")
        return value * (full_scale / 100.0)
    with np.errstate(over="ignore"):
        return value * known.factor + known.offset


def convert(value: Value, unit: str, to: str) -> Value:
    """Convert a value to another unit of its dimension; temperatures are points on the scale (0 degC is 273.15 K).

    Parameters
    ----------
    value
        A number or an array of any shape.
    unit, to
        Names or aliases of the two units.

    Returns
    -------
    float or numpy.ndarray
        The value in `to`, (value · factor + offset − offset') / factor'.

    Raises
    ------
    UnitError
        For an unknown unit, or units of different dimensions.
    """
    source, target = _same_dimension(unit, to)
    with np.errstate(over="ignore"):  # a cell at the end of what a float holds becomes infinite, and so is no reading
        return (value * source.factor + source.offset - target.offset) / target.factor


def _same_dimension(unit: str, to: str) -> tuple[Unit, Unit]:
    source, target = find_unit(unit), find_unit(to)
    if source.dimension != target.dimension:
        raise UnitError(f"{unit} is a {source.dimension} and {to} is a {target.dimension}")
    return source, target


@dataclass(frozen=True)
class UnitWord:
    """A spelt unit: reading · scale is in `unit`, a name of `units.UNITS`; gauge: above the ambient pressure, absolute:
    the spelling says that it is not."""

    unit: str
    scale: float = 1.0
    gauge: bool = False
    absolute: bool = False

    @property
    def definition(self) -> Unit:
        """The unit itself."""
        return find_unit(self.unit)

    @property
    def dimension(self) -> str:
        """What it measures: `temperature`, `pressure`, …"""
        return self.definition.dimension


_MULTIPLES = {
    "krpm": ("rpm", 1000.0),
    "rpmx1000": ("rpm", 1000.0),
    "x1000rpm": ("rpm", 1000.0),
    "rpm/1000": ("rpm", 1000.0),
    "1000rpm": ("rpm", 1000.0),
    "1000ft": ("kft", 1.0),
    "ftx1000": ("kft", 1.0),
    "mmhg": ("Pa", 133.322),
    "torr": ("Pa", 133.322),
    "mmh2o": ("Pa", 9.80665),
    "mmwc": ("Pa", 9.80665),
    "mmwg": ("Pa", 9.80665),
    "inh2o": ("inH2O", 1.0),
    "inwc": ("inH2O", 1.0),
    "kgf/cm2": ("Pa", 98066.5),
    "kg/cm2": ("Pa", 98066.5),
    "ksc": ("Pa", 98066.5),
    "psf": ("psi", 1 / 144),
    "lbf/ft2": ("psi", 1 / 144),
    "lbf/in2": ("psi", 1.0),
    "ms": ("s", 1e-3),
    "msec": ("s", 1e-3),
    "millisecond": ("s", 1e-3),
    "us": ("s", 1e-6),
    "gal/s": ("gal_min", 60.0),
    "kl/h": ("m3_h", 1.0),
    "inlb": ("lbf_ft", 1 / 12),
    "lbin": ("lbf_ft", 1 / 12),
    "kgm": ("Nm", 9.80665),
    "kgfm": ("Nm", 9.80665),
    "klbf": ("lbf", 1000.0),
    "kgf": ("N", 9.80665),
    "klb/h": ("lb_h", 1000.0),
    "kpph": ("lb_h", 1000.0),
}
"""Spelling → unit and factor, for units that are multiples of one of the program (mm of mercury and water: SP 811)."""

_SPELT = {
    "c": "degC",
    "f": "degF",
    "r": "degR",
    "k": "K",
    "celsius": "degC",
    "centigrade": "degC",
    "fahrenheit": "degF",
    "rankine": "degR",
    "kelvin": "K",
    "pound/square inch": "psi",
    "rpm": "rpm",
    "rev/min": "rpm",
    "revs/min": "rpm",
    "u/min": "rpm",
    "tr/min": "rpm",
    "min1": "rpm",
    "pct": "pct",
    "percent": "pct",
    "%": "pct",
    "%rpm": "pct",
    "rpm%": "pct",
    "%rh": "pct",
    "%n": "pct",
    "%n1": "pct",
    "%n2": "pct",
    "%torque": "pct",
    "%trq": "pct",
    "%nom": "pct",
    "pctrpm": "pct",
    "lb/h": "lb_h",
    "pph": "lb_h",
    "pps": "lb_s",
    "lb/s": "lb_s",
    "ppm": "lb_min",
    "lb/min": "lb_min",
    "kg/h": "kg_h",
    "kgh": "kg_h",
    "kgph": "kg_h",
    "kg/s": "kg_s",
    "kg/min": "kg_min",
    "g/s": "g_s",
    "t/h": "t_h",
    "gal/h": "gal_h",
    "gph": "gal_h",
    "usgph": "gal_h",
    "lph": "l_h",
    "lpm": "l_min",
    "cm3/min": "",
    "knot": "kt",
    "knots": "kt",
    "kts": "kt",
    "kn": "kt",
    "km/h": "kmh",
    "kph": "kmh",
    "feet": "ft",
    "foot": "ft",
    "ftmsl": "ft",
    "ftbaro": "ft",
    "ftpressure": "ft",
    "meter": "m",
    "meters": "m",
    "metre": "m",
    "metres": "m",
    "ftlb": "lbf_ft",
    "lbft": "lbf_ft",
    "ftlbf": "lbf_ft",
    "lbfft": "lbf_ft",
    "nm": "Nm",
    "knm": "kNm",
    "mwh": "MW",
    "mwe": "MW",
    "kwe": "kW",
    "shp": "hp",
    "bhp": "hp",
    "mb": "mbar",
    "millibar": "mbar",
    "mach": "1",
    "-": "",
    "none": "",
    "sec": "s",
    "second": "s",
    "seconds": "s",
    "hr": "h",
    "hour": "h",
    "hours": "h",
    "minute": "min",
    "minutes": "min",
    "deg": "deg",
    "degree": "deg",
    "degrees": "deg",
}
"""Further spellings, in small letters without spaces, of single units."""

_PRESSURE_REFERENCE = re.compile(
    r"(psi|bar|mbar|kpa|mpa|hpa|pa|inhg|kg/cm2|kgf/cm2)[ (_-]*(a|g|abs|absolute|gauge|gage)\)?"
)


@cache
def _table() -> dict[str, str]:
    """Small letters without spaces → unit, of everything that `units` knows and of what is spelt otherwise."""
    known = {**{name: name for name in UNITS}, **ALIASES}
    lowered: dict[str, str] = {}
    for name, unit in known.items():
        if unit not in ("V", "mV", "1"):
            lowered.setdefault(name.casefold().replace("_", "/"), unit)
            lowered.setdefault(name.casefold().replace(" ", "").replace("_", ""), unit)
    return {**lowered, **_SPELT}


def parse_unit(text: str) -> UnitWord | None:
    """The unit that a text spells, or None: exactly as the program writes it, else whatever its case and spaces."""
    bare = text.strip().strip("[](){}").strip()
    if not bare or re.fullmatch(r"[-+\d.,]+", bare):
        return None
    exact = ALIASES.get(bare, bare)
    if exact in UNITS:
        gauge = bool(_PRESSURE_REFERENCE.fullmatch(bare.casefold())) and find_unit(exact).dimension == "pressure"
        return UnitWord(exact, absolute=gauge)
    lowered = bare.casefold().replace("²", "2").replace("·", "").replace("°", "deg").replace("º", "deg")
    lowered = re.sub(r"\s+per\s+", "/", lowered)
    referred = _PRESSURE_REFERENCE.fullmatch(re.sub(r"[\s.]+", "", lowered))
    if referred:
        base = parse_unit(referred[1])
        if base is None:
            return None
        gauge = referred[2].startswith("g")
        return UnitWord(base.unit, base.scale, gauge, not gauge)
    plain = re.sub(r"[\s_.^-]+", "", lowered)
    plain = re.sub(r"^deg(rees?)?(?=[cfrk]$|celsius$|fahrenheit$|rankine$|kelvin$)", "", plain)
    plain = re.sub(r"lb[ms]s?(?=$|/)|lbs", "lb", plain)
    plain = re.sub(r"/(hrs?|hour)$", "/h", plain)
    plain = re.sub(r"/sec(ond)?$", "/s", plain)
    plain = re.sub(r"^(lb|kg|gal|l|ft|klb)(hr?|s|min)$", r"\1/\2", plain).replace("/hr", "/h")
    plain = "gal/h" if plain == "usgal/h" else plain
    if plain in _MULTIPLES:
        return UnitWord(*_MULTIPLES[plain])
    unit = _table().get(plain, "")
    return UnitWord(unit) if unit in UNITS else None


def split_unit(name: str) -> tuple[str, UnitWord, bool] | None:
    """What stands before the unit at the end of a column's name, the unit, and whether it is one letter behind a space
    or underscore, which may be another mark: `ALT KFT`, `EGT_degC`, `N1A (%RPM)`, `P3/kPa`, `T3, K`, `TAT F`."""
    bare = name.strip()
    bracketed = re.fullmatch(r"(.+?)\s*[\[({]([^\[\](){}]*(?:\([ag]\))?)[\])}]\s*", bare)
    if bracketed and bracketed[1].strip(" _-"):
        word = parse_unit(bracketed[2])
        if word is not None:
            return bracketed[1].strip(" _-.,"), word, False
    parts = list(re.finditer(r"[\s_,/.:-]+", bare))
    for gap in parts[-4:]:
        head, tail = bare[: gap.start()], bare[gap.end() :]
        word = parse_unit(tail) or parse_unit(tail.replace("_", "/"))
        if word is None or word.unit == "1" or not head.strip(" _-") or re.fullmatch(r"\d+|.*(?<!\([ag])[\])}]", tail):
            continue
        single = len(tail) == 1
        if tail in ("m", "s", "h", "N", "V", "A", "W", "g", "l", "1", "M", "S", "H", "L", "n") and gap.group() != ", ":
            # `time_s` and `alt_m` are units; `N_L`, `N_H` are shafts
            if tail not in ("m", "s", "N", "V", "W"):
                continue
        if word.unit == "hp" and tail.casefold() == "hp" and not re.search("pow|shp|load", head, re.I):
            continue  # the high-pressure shaft
        return head.strip(" _-.,"), word, single
    return None
