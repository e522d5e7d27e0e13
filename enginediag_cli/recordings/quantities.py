"""What a foreign column may be, by its name: the program's column, and the units in which it is usually recorded."""

from __future__ import annotations

import re
from collections.abc import Collection, Sequence
from dataclasses import dataclass

import numpy as np

from enginediag_cli.recordings.acceptance import median_of, usual_range
from enginediag_cli.units import UnitError, find_unit, split_column

_TEMPERATURES = ("K", "degC", "degF", "degR")
_PRESSURES = ("Pa", "kPa", "bar", "psi", "mbar", "MPa")
_SPEEDS = ("kt", "m_s", "kmh")
_FLOWS = ("kg_s", "kg_h", "lb_h", "g_s", "kg_min")

NAMES: tuple[tuple[str, str, tuple[str, ...]], ...] = (
    (r"t|time|secs?|seconds|elapsed( time)?|zeit", "time_s", ("s",)),
    (r"(p(ress(ure)?)? ?)?alt(itude)?( (std|press|baro))?|hoehe|höhe|zp|hp", "altitude_m", ("m", "ft", "kft")),
    (r"mach( (no|nr|number))?|ma|xm", "mach", ("1",)),
    (r"[kc]?[ci]as|(calibrated|indicated) air ?speed|vc|ias", "cas_m_s", _SPEEDS),
    (r"k?tas|true air ?speed|vt", "tas_m_s", _SPEEDS),
    (
        r"sat|oat|t ?amb|amb(ient)? ?t(emp(erature)?)?|outside air temp(erature)?|t0|at",
        "ambient_temperature_K",
        _TEMPERATURES,
    ),
    (r"tat|total air temp(erature)?", "TAT_K", _TEMPERATURES),
    (r"p ?amb|amb(ient)? ?p(ress(ure)?)?|p0|baro(meter)?|ap", "ambient_pressure_Pa", _PRESSURES),
    (r"r\.?h\.?|rel(ative)? ?hum(idity)?|ah", "relative_humidity", ("pct", "1")),
    (r"n ?1|n ?l|fan speed|ng|ngg|gg speed|n gg", "N1_rpm", ("rpm", "pct")),
    (r"n ?2|n ?h|core speed|np|npt|n pt", "N2_rpm", ("rpm", "pct")),
    (r"w ?f|f ?f|fuel ?flow|fuel|kraftstoff|fuel rate", "Wf_kg_s", _FLOWS),
    (r"c ?d ?t|compressor (discharge|exit) temp(erature)?", "T3_K", _TEMPERATURES),
    (r"c ?d ?p|compressor (discharge|exit) press(ure)?", "P3_Pa", _PRESSURES),
    (r"i ?t ?t", "ITT_K", _TEMPERATURES),
    (r"e ?g ?t|tgt|exhaust (gas )?temp(erature)?", "EGT_K", _TEMPERATURES),
    (r"t ?i ?t", "T4_K", _TEMPERATURES),
    (r"tq|trq|torque", "torque_Nm", ("Nm", "kNm", "lbf_ft", "pct")),
    (r"shp|(shaft )?power|leistung|load", "power_W", ("W", "kW", "MW", "hp")),
)
"""Name of the quantity, in small letters with spaces between words; the target; units in the order of preference."""

_STATION = re.compile(r"(ps|p|t)t? ?(\d{1,2})")
FLIGHT = re.compile(r"flight( (no|nr|number|id))?|sortie|leg|flug|flt( no)?")


@dataclass(frozen=True)
class Guess:
    """A source column taken for `target`. unit: as stated by the file, or the first in which the values can be;
    stated: whether the file said so; doubt: what the user must decide, empty where nothing."""

    target: str
    unit: str
    stated: bool
    doubt: str = ""
    full_scale: float | None = None
    density: float | None = None


def words_of(quantity: str) -> str:
    """Small letters, words parted by single spaces, brackets left out: `Fuel_Flow (act)` → `fuel flow`."""
    bare = re.sub(r"[\[(].*?[\])]", " ", quantity)
    bare = re.sub(r"(?<=[a-z])(?=[A-Z])", " ", bare)
    return " ".join(re.split(r"[^0-9a-zäöüß.]+", bare.casefold())).strip()


def target_of(quantity: str, targets: Collection[str] = ()) -> tuple[str, Sequence[str]] | None:
    """The program's column for a quantity's name, with usual units; with `targets`, one of those."""
    words = words_of(quantity)
    found: tuple[str, Sequence[str]] | None = None
    for target in targets:
        name, unit = split_column(target)
        if words_of(name) == words or words_of(name).replace(" ", "") == words.replace(" ", ""):
            return target, (unit or "1",)
    station = _STATION.fullmatch(words)
    known = next(((t, units) for pattern, t, units in NAMES if re.fullmatch(pattern, words)), None)
    if known:
        found = known
    elif station:
        found = _at_station(*station.groups())
    else:
        found = _described(words)
    if not found or not targets or found[0] in {*targets, *HELPERS}:
        return found
    # a torque is that of the gearbox, where an engine has no other
    quantity, unit = split_column(found[0])
    own = [t for t in targets if _is_of(t, quantity, unit or "1")]
    return (own[0], found[1]) if len(own) == 1 else None


def _is_of(target: str, quantity: str, unit: str) -> bool:
    """Whether a column is that quantity of some part: `reduction_gear_torque_N_m` is a torque."""
    name, own = split_column(target)
    return name.endswith(f"_{quantity}") and find_unit(own or "1").dimension == find_unit(unit).dimension


def _at_station(kind: str, number: str) -> tuple[str, Sequence[str]]:
    return (f"T{number}_K", _TEMPERATURES) if kind == "t" else (f"{kind.capitalize()}{number}_Pa", _PRESSURES)


def _described(words: str) -> tuple[str, Sequence[str]] | None:
    """A name in many words: `Compressor Entry Temperature T3`, `Fuel Flow f`."""
    if "amb" in words and "press" in words:
        return "ambient_pressure_Pa", _PRESSURES
    if re.match(r"fuel flow\b", words):
        return "Wf_kg_s", _FLOWS
    named = re.search(r"\b(p|t)(\d{1,2})\b", words)
    if named and {"p": "press", "t": "temp"}[named[1]] in words:
        return _at_station("ps" if named[1] == "p" and "static" in words else named[1], named[2])
    return None


HELPERS = ("time_s", "altitude_m", "mach", "cas_m_s", "tas_m_s", "ambient_temperature_K", "TAT_K")
"""Targets that are of use although an engine does not ask for them: others are computed from them."""


def guess(target: str, usual: Sequence[str], unit: str, values: np.ndarray) -> Guess:
    """What a column of N values is, taken for `target`; unit: as the file states it, or empty."""
    quantity, own = split_column(target)
    dimension = find_unit(own or "1").dimension
    stated = bool(unit)
    doubt = ""
    if not unit and own:
        unit = _by_values(quantity, dimension, usual, values)
        doubt = "unit guessed from the values" if unit else "unit not known"
        unit = unit or usual[0]
    unit = unit or "1"
    try:
        given = find_unit(unit).dimension
    except UnitError:
        return Guess(target, own or "1", False, f"the unit {unit!r} is not known")
    if given == "ratio" and dimension != "ratio":
        return Guess(target, unit, stated, f"full_scale: the {own} at 100 %, here only a stand-in", full_scale=10000.0)
    if given == "volume flow" and dimension == "mass flow":
        return Guess(target, unit, stated, "density of the fuel at the meter", density=800.0)
    if given != dimension:
        return Guess(target, own or "1", False, f"the file says {unit}, which is no {dimension}")
    known, usual_si = find_unit(unit), usual_range(quantity, dimension)
    median = median_of(values) * known.factor + known.offset
    if stated and usual_si and not usual_si.low <= median <= usual_si.high:
        doubt = f"in {unit} the median is {median:.4g} {own}, which cannot be"
    return Guess(target, unit, stated, doubt)


def _by_values(quantity: str, dimension: str, usual: Sequence[str], values: np.ndarray) -> str:
    limits, median = usual_range(quantity, dimension), median_of(values)
    if dimension == "rotational speed" and np.nanmax(np.abs(values)) <= 130.0:
        return "pct"
    if limits is None:
        return usual[0] if len(usual) == 1 else ""
    units = [find_unit(name) for name in usual if find_unit(name).dimension == dimension]
    return next((u.name for u in units if limits.low <= median * u.factor + u.offset <= limits.high), "")
