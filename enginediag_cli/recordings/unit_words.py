"""Units as foreign files spell them: `DEG C`, `LB/HR`, `%RPM`, `psig`, `KFT`, `ft msl`, `x1000 rpm`."""

from __future__ import annotations

import re
from dataclasses import dataclass
from functools import cache

from enginediag_cli.units import ALIASES, UNITS, Unit, find_unit


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
