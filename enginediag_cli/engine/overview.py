"""An engine at a glance: what it does at its design conditions and in the corners of its envelope, and its fuel.

The lower heating value of a hydrocarbon follows from its ratio of hydrogen to carbon:

    HHV = 0.3491 C + 1.1783 H,        LHV = HHV − 2.442 · 8.937 H

in MJ/kg with C and H in % and 8.937 kg of water per kg of hydrogen, of 2.442 MJ/kg at 25 °C. Source: S. A. Channiwala
and P. P. Parikh, Fuel 81 (2002) 1051–1063, whose formula is right to 1.5 % of fuels from methane to heavy oil.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import product
from typing import TYPE_CHECKING

import numpy as np

from enginediag_cli.units import UNITS, known_unit, split_column

if TYPE_CHECKING:
    from enginediag_cli.engine.engine import Engine

MASS_H_OVER_C = 1.008 / 12.011
"""Mass of an atom of hydrogen over that of one of carbon (IUPAC 2021)."""
HHV_C, HHV_H = 34.91e6, 117.83e6
"""J per kg of carbon and of hydrogen in a fuel (Channiwala and Parikh)."""
WATER_J_KG = 2.442e6 * 8.937
"""Heat of condensation at 25 °C of the water that a kilogram of hydrogen burns to, J."""
FITS = 0.04
"""Relative deviation of a stated heating value that the formula, and fuels with a little sulphur or inert gas, explain;
the higher value is 6.5 % above the lower one of kerosene, and 11 % of methane."""
HYDROCARBONS = (0.5, 4.0)
"""Hydrogen atoms per atom of carbon for which the formula was made: from tars to methane."""
FIRST = ("Fn_N", "power_W", "Wf_kg_s", "SFC_kg_Ns", "OPR", "EPR", "BPR")
"""Columns that are shown first where a model has them; then temperatures, flows and speeds."""
FLIGHT = ("altitude_m", "mach", "dT_isa_K", "ambient_temperature_K", "ambient_pressure_Pa")
"""Inputs of which the corners of an envelope are made: what is outside the engine."""


def heating_values(hydrogen_carbon_ratio: float) -> tuple[float, float]:
    """Lower and higher heating value, J/kg, of a hydrocarbon with so many atoms of hydrogen per atom of carbon."""
    hydrogen = hydrogen_carbon_ratio * MASS_H_OVER_C / (1.0 + hydrogen_carbon_ratio * MASS_H_OVER_C)
    higher = HHV_C * (1.0 - hydrogen) + HHV_H * hydrogen
    return higher - WATER_J_KG * hydrogen, higher


@dataclass(frozen=True)
class HeatingValueDoubt:
    """A burner's stated lower heating value, J/kg, that does not fit the fuel; `lower`, `higher`: those of the fuel;
    is_higher: whether the higher one was stated."""

    burner: str
    place: int
    stated: float
    hydrogen_carbon_ratio: float
    lower: float
    higher: float

    @property
    def is_higher(self) -> bool:
        return abs(self.stated / self.higher - 1.0) <= FITS

    def __str__(self) -> str:
        fuel = f"a fuel of {self.hydrogen_carbon_ratio:g} H per C has {self.lower / 1e6:.1f} MJ/kg"
        said = f"{self.burner}: lower_heating_value_J_kg is {self.stated / 1e6:.4g} MJ/kg, and {fuel}"
        return said + (f"; {self.higher / 1e6:.1f} MJ/kg is its higher heating value" if self.is_higher else "")


def heating_value_doubts(engine: Engine) -> Iterator[HeatingValueDoubt]:
    """The burners whose heating value does not fit `fuel_hydrogen_carbon_ratio`."""
    ratio = float(engine.declared["fuel_hydrogen_carbon_ratio"])
    if not HYDROCARBONS[0] <= ratio <= HYDROCARBONS[1]:
        return
    lower, higher = heating_values(ratio)
    for place, component in enumerate(engine.declared["components"]):
        stated = component.get("lower_heating_value_J_kg")
        if stated is not None and abs(stated / lower - 1.0) > FITS:
            yield HeatingValueDoubt(component["name"], place, float(stated), ratio, lower, higher)


@dataclass(frozen=True)
class DesignTable:
    """Operating points (N) by their words, with values (N, m) of `columns` in SI, NaN where a point has none, and why
    it has none, "" where it has."""

    points: tuple[str, ...]
    columns: tuple[str, ...]
    values: np.ndarray
    reasons: tuple[str, ...]


def design_table(engine: Engine) -> DesignTable:
    """The engine at rating and idle in its design conditions, and at rating in the corners of its envelope."""
    names, rows = _points(engine)
    inputs = {c: np.array([row.get(c, 0.0) for row in rows]) for c in (*engine.inputs, *engine.optional_inputs)}
    if engine.power_range is not None:
        fraction = np.array([row["fraction"] for row in rows])
        inputs[engine.power_setting] = engine.power_from_fraction(fraction, inputs)
    columns = _columns(engine)
    answer = engine.predict(inputs, sensors=columns)
    reasons = tuple("" if ok else answer.reason(k) for k, ok in enumerate(answer.ok))
    return DesignTable(tuple(names), columns, np.asarray(answer.y), reasons)


def _points(engine: Engine) -> tuple[list[str], list[dict[str, float]]]:
    design = {c: float(v) for c, v in engine.declared["design"].items()}
    for shaft in engine.declared["shafts"]:
        design[f"{shaft['speed_label']}_rpm"] = float(shaft["design_speed_rpm"])
    middle = {c: 0.5 * (low + high) for c, (low, high) in engine.envelope.items() if c not in FLIGHT}
    base = {**engine.optional_inputs, **middle, **design}
    varied = [c for c in FLIGHT if c in engine.inputs and c in engine.envelope]
    names, rows = ["design, rating", "design, idle"], [{**base, "fraction": 1.0}, {**base, "fraction": 0.0}]
    for corner in product(*(engine.envelope[c] for c in varied)) if varied else ():
        rows.append({**base, **dict(zip(varied, corner, strict=True)), "fraction": 1.0})
        names.append(", ".join(_said(c, v) for c, v in zip(varied, corner, strict=True)))
    return (names, rows) if engine.power_range is not None else (names[:1], rows[:1])


def _said(column: str, value: float) -> str:
    quantity, _, unit = column.rpartition("_")
    if column == "dT_isa_K":
        return f"ISA {value:+g} K"
    return (
        f"{quantity.removeprefix('ambient_').replace('_', ' ')} {value:g} {unit}" if quantity else f"{column} {value:g}"
    )


def _columns(engine: Engine) -> tuple[str, ...]:
    there = engine.model_columns
    stations = [c for c in there if known_unit(split_column(c)[1]) is UNITS["K"]]
    flows = [c for c in ("W2_kg_s",) if c in there]
    speeds = [f"{s['speed_label']}_rpm" for s in engine.declared["shafts"]]
    hot = [c for c in stations if c in engine.sensors or c in ("T3_K", "T4_K")]
    first = [c for c in FIRST if c in there and (c != "SFC_kg_Ns" or "Fn_N" in there)]
    chosen = [*first, *hot, *flows, *(c for c in speeds if c in there)]
    return tuple(dict.fromkeys(chosen))
