"""Recordings of shipped engines with single mistakes of the people who export them: what was done, and to which column.

Inputs are flights that `simulate` flies; the engine is one of its kind: health, and what identification may move, are
drawn from their priors.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from enginediag_cli.engine.engine import Engine
from enginediag_cli.intake.comparison import engine_reference
from enginediag_cli.recordings.derived import SEA_LEVEL_PA, SOUND_AT_SEA_LEVEL_M_S, isa_pressure, isa_temperature
from enginediag_cli.units import known_unit, split_column

Columns = dict[str, np.ndarray]


@dataclass(frozen=True)
class Made:
    """A recording with a mistake: `columns`; `column`: the one that is wrong, `words`: of which one must be in the name
    that is given to it."""

    kind: str
    columns: Columns
    column: str
    words: tuple[str, ...]


def recording(engine: Engine, inputs: Columns, rng: np.random.Generator, *, identified: bool = False) -> Columns:
    """Inputs and noisy readings of an engine of the kind, or of the engine of the file where it is `identified`."""
    values: dict[str, float] = {}
    yardstick = engine_reference(engine)
    for name, spread in zip(yardstick.names, yardstick.spread, strict=True):
        parameter = engine.parameters.get(name)
        if identified or parameter is None or parameter.belongs_to_instrument:
            continue
        share = 0.7 if parameter.family == "design" else 1.0  # dozens of shapes at once are seldom all typical
        drawn = parameter.nominal + share * spread * rng.standard_normal()
        values[name] = float(np.clip(drawn, parameter.lower, parameter.upper))
    answer = engine.predict(inputs, values)
    columns = {c: v[answer.ok] for c, v in inputs.items()}
    for j, (column, sensor) in enumerate(engine.sensors.items()):
        noise = (sensor.noise_sigma or 0.0) * rng.standard_normal(len(answer.y))
        columns[column] = (answer.y[:, j] + noise)[answer.ok]
    return columns


def _sound(c: Columns) -> np.ndarray:
    return 20.0468 * np.sqrt(isa_temperature(c["altitude_m"]) + c["dT_isa_K"])


def _calibrated(c: Columns) -> np.ndarray:
    impact = isa_pressure(c["altitude_m"]) * ((1 + 0.2 * c["mach"] ** 2) ** 3.5 - 1)
    return SOUND_AT_SEA_LEVEL_M_S * np.sqrt(5 * ((impact / SEA_LEVEL_PA + 1) ** (2 / 7) - 1))


def _ambient(c: Columns) -> np.ndarray:
    return c["ambient_pressure_Pa"] if "ambient_pressure_Pa" in c else isa_pressure(c["altitude_m"])


def _total(c: Columns) -> np.ndarray:
    standard = isa_temperature(c["altitude_m"])
    return (standard + c["dT_isa_K"]) * (1 + 0.2 * c["mach"] ** 2) - standard


def _dimension(column: str) -> str:
    unit = known_unit(split_column(column)[1])
    return unit.dimension if unit is not None else ""


TEMPERATURES: dict[str, tuple[Callable[[np.ndarray], np.ndarray], tuple[str, ...]]] = {
    "degC for K": (lambda v: v - 273.15, ("degC",)),
    "degF for K": (lambda v: v * 1.8 - 459.67, ("degF",)),
    "degR for K": (lambda v: v * 1.8, ("degR",)),
    "degF for degC": (lambda v: v * 1.8 - 459.67 + 273.15, ("degF",)),
}
COLUMNS: dict[str, tuple[str, Callable[[Columns], np.ndarray], tuple[str, ...]]] = {
    "kg/h for kg/s": ("Wf_kg_s", lambda c: c["Wf_kg_s"] * 3600, ("kg_h",)),
    "lb/h for kg/h": ("Wf_kg_s", lambda c: c["Wf_kg_s"] / 0.45359237, ("lb_",)),
    "ft for m": ("altitude_m", lambda c: c["altitude_m"] / 0.3048, (" ft",)),
    "kft for m": ("altitude_m", lambda c: c["altitude_m"] / 304.8, ("kft",)),
    "total for static temperature": ("dT_isa_K", _total, ("total",)),
    "indicated speed for Mach": ("mach", lambda c: _calibrated(c) / _sound(c), ("indicated", "calibrated")),
    "knots for Mach": ("mach", lambda c: c["mach"] * _sound(c) / (1852 / 3600), ("true airspeed in kt",)),
}
"""Mistakes of one column: the column, what it then holds, and words of which one must be in the name given."""
PRESSURES = {"psi for Pa": 1 / 6894.757, "kPa for Pa": 1e-3, "bar for Pa": 1e-5}


def mistaken(columns: Columns, engine: Engine, kind: str, rng: np.random.Generator) -> Made | None:
    """The columns with a mistake of a kind; None where the engine has no such column."""
    c = dict(columns)

    def one_of(dimension: str) -> list[str]:
        found = [x for x in c if _dimension(x) == dimension]
        return [x for x in found if not x.startswith(("dT", "dP", "ambient_pressure"))]

    def any_of(dimension: str) -> str:
        found = one_of(dimension)
        return found[rng.integers(len(found))] if found else ""

    if kind in TEMPERATURES:
        column, (change, words) = any_of("temperature"), TEMPERATURES[kind]
        return Made(kind, {**c, column: change(c[column])}, column, words) if column else None
    if kind in COLUMNS:
        column, of, words = COLUMNS[kind]
        known = column in c and (column not in ("mach", "dT_isa_K") or {"altitude_m", "mach", "dT_isa_K"} <= set(c))
        return Made(kind, {**c, column: of(c)}, column, words) if known else None
    if kind in PRESSURES:
        column = any_of("pressure")
        return Made(kind, {**c, column: c[column] * PRESSURES[kind]}, column, (kind.split()[0],)) if column else None
    if kind == "gauge":
        column = any_of("pressure")
        return Made(kind, {**c, column: c[column] - _ambient(c)}, column, ("gauge",)) if column else None
    if kind == "% for rpm":
        full = {f"{s['speed_label']}_rpm": s["design_speed_rpm"] for s in engine.declared["shafts"]}
        found = [x for x in full if x in c]
        column = found[rng.integers(len(found))] if found else ""
        scale = 100 * rng.uniform(0.97, 1.03) / full[column] if column else 0.0
        return Made(kind, {**c, column: c[column] * scale}, column, ("%",)) if column else None
    if kind == "swapped":
        pairs = [p for p in map(one_of, ("temperature", "pressure", "rotational speed")) if len(p) > 1]
        a, b = rng.choice(pairs[rng.integers(len(pairs))], 2, replace=False) if pairs else ("", "")
        names = tuple(f"{x} and {y} are swapped" for x, y in ((a, b), (b, a)))
        return Made(kind, {**c, a: c[b], b: c[a]}, "", names) if pairs else None
    return Made(kind, c, "", ())


KINDS = (*TEMPERATURES, *COLUMNS, *PRESSURES, "gauge", "% for rpm", "swapped")
