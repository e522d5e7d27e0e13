"""Drivers: the quantities on which an effect or a discrepancy may depend, and curves along them.

Drivers come from the inputs and from the model's own prediction, never from the readings that are judged.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from typing import TYPE_CHECKING

import numpy as np

from enginediag_cli.engine.components.combustion import Burner
from enginediag_cli.engine.components.nozzles import Nozzle
from enginediag_cli.engine.components.passages import Ambient, Inlet
from enginediag_cli.engine.components.turbomachinery import Compressor
from enginediag_cli.engine.dual import value
from enginediag_cli.engine.evaluation import (
    P_ISA,
    T_ISA,
    reynolds_index_from_state,
    saturated_water,
    standard_atmosphere,
)
from enginediag_cli.engine.term import Driver, DriverConditions, DriverValues
from enginediag_cli.parameters import spelled
from enginediag_cli.units import find_unit, split_column

if TYPE_CHECKING:
    from enginediag_cli.engine.engine import Engine

SAME = 0.95
"""Correlation from which two drivers are one: these recordings cannot separate them."""

LOG_REYNOLDS, IN_STANDARD_AIR = "ln RNI", "1 in standard air at sea level"
LEAST_PIVOT = 1e-6
"""Of the largest: a curve that adds less to those before it is not carried by the values."""


def _inlet(engine: Engine) -> str:
    """Station behind the inlet."""
    return str(next(c.values["to"] for c in engine.network.components if isinstance(c, Inlet)))


def _hot(engine: Engine) -> str:
    """Station behind the burner."""
    return str(next(c.values["to"] for c in engine.network.components if isinstance(c, Burner)))


def _last_compressor(engine: Engine) -> str:
    """Column of the pressure behind the last compressor; empty without one."""
    found = (c.values["to"] for c in reversed(engine.network.components) if isinstance(c, Compressor))
    station = next(found, None)
    return f"P{station}_Pa" if station is not None else ""


def _nozzles(engine: Engine) -> dict[str, str]:
    """Column of the pressure ratio → name of the nozzle."""
    return {f"{c.name}_pressure_ratio": c.name for c in engine.network.components if isinstance(c, Nozzle)}


def _mach(at: DriverConditions) -> Iterable[DriverValues]:
    if "mach" in at.inputs:
        yield DriverValues(MACH, "mach", np.asarray(at.inputs["mach"], float), "Mach number")


def _ambient_pressure(at: DriverConditions) -> Iterable[DriverValues]:
    x = np.log(at.column["P0_Pa"] / P_ISA)
    yield DriverValues(AMBIENT_PRESSURE, "ambient_pressure", x, "ambient pressure")


def _inlet_temperature(at: DriverConditions) -> Iterable[DriverValues]:
    x = at.column[f"T{_inlet(at.engine)}_K"]
    yield DriverValues(INLET_TEMPERATURE, "inlet_temperature", x, "inlet temperature")


def _power(at: DriverConditions) -> Iterable[DriverValues]:
    x = at.column[f"T{_hot(at.engine)}_K"] / at.column[f"T{_inlet(at.engine)}_K"]
    yield DriverValues(POWER, "power", x, "power T4/T2")


def _burner_temperature(at: DriverConditions) -> Iterable[DriverValues]:
    x = at.column[f"T{_hot(at.engine)}_K"]
    yield DriverValues(BURNER_TEMPERATURE, "burner_temperature", x, "burner temperature T4")


def _reynolds_index(at: DriverConditions) -> Iterable[DriverValues]:
    named = (("reynolds_index", _inlet, "inlet"), ("turbine_reynolds_index", _hot, "turbine"))
    for name, station, where in named:
        s = station(at.engine)
        x = np.log(value(reynolds_index_from_state(at.column[f"T{s}_K"], at.column[f"P{s}_Pa"])))
        yield DriverValues(REYNOLDS_INDEX, name, x, f"{where} Reynolds index")


def _labels(engine: Engine) -> list[tuple[str, str]]:
    """Column and label of every shaft's speed."""
    return [(column, split_column(column)[0]) for column in engine.network.speed_columns]


def _corrected_speed(at: DriverConditions) -> Iterable[DriverValues]:
    root = np.sqrt(at.column[f"T{_inlet(at.engine)}_K"] / T_ISA)
    for column, label in _labels(at.engine):
        yield DriverValues(CORRECTED_SPEED, f"corrected_{label}", at.column[column] / root, f"corrected {label}")


def _shaft_speed(at: DriverConditions) -> Iterable[DriverValues]:
    for column, label in _labels(at.engine):
        yield DriverValues(SHAFT_SPEED, label, at.column[column], label)


def _nozzle_pressure_ratio(at: DriverConditions) -> Iterable[DriverValues]:
    for column, name in _nozzles(at.engine).items():
        yield DriverValues(NOZZLE_PRESSURE_RATIO, name, at.column[column], f"{spelled(name)} pressure ratio")


def _bypass_ratio(at: DriverConditions) -> Iterable[DriverValues]:
    if "BPR" in at.column:
        yield DriverValues(BYPASS_RATIO, "bypass_ratio", at.column["BPR"], "bypass ratio")


def _compressor_pressure(at: DriverConditions) -> Iterable[DriverValues]:
    column = _last_compressor(at.engine)
    if column:
        x = at.column[column]
        yield DriverValues(COMPRESSOR_PRESSURE, "compressor_pressure", x, "compressor exit pressure")


def _humidity(at: DriverConditions) -> Iterable[DriverValues]:
    if "humidity_kg_kg" in at.inputs:
        yield DriverValues(HUMIDITY, "humidity", np.asarray(at.inputs["humidity_kg_kg"], float), "humidity")


def _saturation(at: DriverConditions) -> Iterable[DriverValues]:
    """Water that the air of the altitude can hold, which follows humidity where that is not recorded."""
    if "altitude_m" in at.inputs and any(isinstance(c, Ambient) for c in at.engine.network.components):
        T, p = standard_atmosphere(at.inputs["altitude_m"])
        x = np.asarray(saturated_water(T + at.inputs["dT_isa_K"], p), float)
        yield DriverValues(HUMIDITY, "humidity", x, "humidity")


def _inlet_state(engine: Engine) -> tuple[str, ...]:
    return f"T{_inlet(engine)}_K", f"P{_inlet(engine)}_Pa"


def _hot_state(engine: Engine) -> tuple[str, ...]:
    return f"T{_hot(engine)}_K", f"P{_hot(engine)}_Pa"


CONSTANT = Driver("constant", "nothing: the same in every record")
MACH = Driver("mach", "flight Mach number", values=_mach)
AMBIENT_PRESSURE = Driver(
    "ambient_pressure",
    "ambient pressure (altitude)",
    "ln(p0/p_ISA)",
    "1 at sea level",
    lambda engine: ("P0_Pa",),
    _ambient_pressure,
)
INLET_TEMPERATURE = Driver(
    "inlet_temperature",
    "total temperature at the engine's inlet",
    "K",
    columns=_inlet_state,
    values=_inlet_temperature,
)
CORRECTED_SPEED = Driver(
    "corrected_speed",
    "corrected shaft speed",
    "rpm",
    columns=lambda engine: (*_inlet_state(engine), *engine.network.speed_columns),
    values=_corrected_speed,
)
SHAFT_SPEED = Driver(
    "shaft_speed",
    "mechanical shaft speed",
    "rpm",
    columns=lambda engine: tuple(engine.network.speed_columns),
    values=_shaft_speed,
)
POWER = Driver(
    "power",
    "corrected power: burner temperature ratio T4/T2",
    "T4/T2",
    columns=lambda engine: (*_inlet_state(engine), *_hot_state(engine)),
    values=_power,
)
BURNER_TEMPERATURE = Driver(
    "burner_temperature",
    "burner temperature T4, of the gas itself",
    "K",
    columns=_hot_state,
    values=_burner_temperature,
)
REYNOLDS_INDEX = Driver(
    "reynolds_index",
    "Reynolds number index, at the inlet or the turbines",
    LOG_REYNOLDS,
    IN_STANDARD_AIR,
    lambda engine: (*_inlet_state(engine), *_hot_state(engine)),
    _reynolds_index,
)
HUMIDITY = Driver("humidity", "water in the air", "kg/kg", values=_humidity, true_values=_saturation)
HOURS = Driver("hours", "time in service", "h")
SWITCH = Driver("switch", "a commanded state that may be on or off")
NOZZLE_PRESSURE_RATIO = Driver(
    "nozzle_pressure_ratio",
    "pressure ratio of a nozzle",
    columns=lambda engine: tuple(_nozzles(engine)),
    values=_nozzle_pressure_ratio,
)
BYPASS_RATIO = Driver(
    "bypass_ratio",
    "bypass ratio",
    columns=lambda engine: ("BPR",) if "BPR" in engine.model_columns else (),
    values=_bypass_ratio,
)
COMPRESSOR_PRESSURE = Driver(
    "compressor_pressure",
    "pressure behind the last compressor",
    "Pa",
    columns=lambda engine: tuple(filter(None, [_last_compressor(engine)])),
    values=_compressor_pressure,
)
RATE = Driver("rate", "how fast what is commanded, or the engine, changes")
LAGGING = Driver("lagging", "what follows the power setting with a lag", "ln")
TIME = Driver("time", "time: a change that began at some record and stays", "step")

DRIVERS = (
    CONSTANT,
    MACH,
    AMBIENT_PRESSURE,
    INLET_TEMPERATURE,
    CORRECTED_SPEED,
    SHAFT_SPEED,
    POWER,
    BURNER_TEMPERATURE,
    REYNOLDS_INDEX,
    HUMIDITY,
    HOURS,
    SWITCH,
    NOZZLE_PRESSURE_RATIO,
    BYPASS_RATIO,
    COMPRESSOR_PRESSURE,
    RATE,
)
"""Those that terms name, in the order of lists."""

SEARCHED = (
    (MACH,),
    (AMBIENT_PRESSURE,),
    (INLET_TEMPERATURE,),
    (POWER,),
    (REYNOLDS_INDEX,),
    (CORRECTED_SPEED, SHAFT_SPEED),
    (BURNER_TEMPERATURE,),
    (NOZZLE_PRESSURE_RATIO,),
    (BYPASS_RATIO,),
    (COMPRESSOR_PRESSURE,),
    (HUMIDITY,),
)
"""The order in which a map tries them, and in which of two inseparable ones is named first; together: shaft by
shaft."""


def recorded_driver(column: str, values: np.ndarray) -> Driver:
    """What a recorded column (N,) is as a driver: hours by its unit, a switch if it holds nothing but 0, 1 and gaps,
    else the quantity that it is, in its unit."""
    unit = split_column(column)[1]
    if unit and find_unit(unit).name == "h":
        return HOURS
    known = values[np.isfinite(values)]
    if known.size and np.isin(known, (0.0, 1.0)).all():
        return SWITCH
    return Driver("recorded", column, unit or "1")


def drivers(
    engine: Engine,
    inputs: Mapping[str, np.ndarray],
    parameters: Mapping[str, float],
    recorded: Mapping[str, np.ndarray] | None = None,
    own: Sequence[Driver] = (),
) -> list[DriverValues]:
    """Drivers of N records at these parameters, those that move; NaN where the engine has no prediction.

    `recorded`: further columns (N,), such as hours or switches, that may drive an effect; `own`: drivers that terms
    bring.
    """
    every = [*(d for together in SEARCHED for d in together), *own]
    at = conditions(engine, inputs, parameters, every)
    found: list[DriverValues] = []
    for together in (*SEARCHED, *((d,) for d in own)):
        for alike in zip(*(d.values(at) for d in together), strict=True):
            found += alike
    for name, x in (recorded or {}).items():
        values = np.asarray(x, float)
        found.append(DriverValues(recorded_driver(name, values), name, values, name))
    return [d for d in found if d.moves]


def true_drivers(
    engine: Engine, inputs: Mapping[str, np.ndarray], parameters: Mapping[str, float], driver: Driver
) -> list[DriverValues]:
    """What a driver truly is in N records, whether or not what it needs was recorded and whether or not it moves."""
    at = conditions(engine, inputs, parameters, [driver])
    return list(driver.values(at)) or list(driver.true_values(at))


def conditions(
    engine: Engine, inputs: Mapping[str, np.ndarray], parameters: Mapping[str, float], along: Sequence[Driver]
) -> DriverConditions:
    """The records as these drivers read them."""
    wanted = tuple(dict.fromkeys(c for d in along for c in d.columns(engine)))
    if not wanted:
        return DriverConditions(engine, inputs, {})
    p = engine.predict(inputs, parameters, sensors=wanted)
    return DriverConditions(engine, inputs, dict(zip(wanted, np.where(p.ok[:, None], p.y, np.nan).T, strict=True)))


def groups(found: Sequence[DriverValues]) -> list[list[DriverValues]]:
    """Drivers that these records cannot separate, |correlation| > SAME, in the order of the drivers."""
    values = np.array([np.nan_to_num(d.values, nan=float(np.nanmean(d.values))) for d in found])
    r = np.abs(np.atleast_2d(np.corrcoef(values))) if len(found) > 1 else np.ones((1, 1))
    left, result = list(range(len(found))), []
    while left:
        first = left[0]
        same = [k for k in left if r[first, k] > SAME]
        result.append([found[k] for k in same])
        left = [k for k in left if k not in same]
    return result


def polynomials(values: np.ndarray, degree: int) -> np.ndarray:
    """Curves (N, degree) of unit mean square, orthogonal to a constant and to each other over the records; 0 where
    the value is missing. Fewer columns when the values do not carry that many."""
    good = np.isfinite(values)
    if not good.any():
        return np.zeros((len(values), 0))
    x = values[good] - values[good].mean()
    x = x / max(float(np.abs(x).max(initial=0.0)), 1e-300)
    V = np.vander(x, degree + 1, increasing=True)
    q, r = np.linalg.qr(V)
    keep = np.abs(np.diag(r)) > LEAST_PIVOT * np.abs(r[0, 0])
    curves = np.zeros((len(values), int(keep[1:].sum())))
    signs = np.sign(np.diag(r))[1:][keep[1:]]
    curves[good] = q[:, 1:][:, keep[1:]] * signs * np.sqrt(good.sum())
    return curves
