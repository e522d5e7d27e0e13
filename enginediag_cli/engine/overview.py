"""An engine at a glance: its design point, the corners of its envelope, and its fuel.

The lower heating value of a hydrocarbon follows from its ratio of hydrogen to carbon:

    HHV = 0.3491 C + 1.1783 H,        LHV = HHV − 2.442 · 8.937 H

in MJ/kg with C and H in % and 8.937 kg of water per kg of hydrogen, of 2.442 MJ/kg at 25 °C. Source: S. A. Channiwala
and P. P. Parikh, Fuel 81 (2002) 1051–1063. The formula is right to 1.5 % for fuels from methane to heavy oil.

The component reference is made from small engines that contain every component type (`component_example`).
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cache
from itertools import product
from typing import TYPE_CHECKING

import numpy as np

from enginediag_cli.config.document import parse_document
from enginediag_cli.config.validate import validate
from enginediag_cli.engine.components import COMPONENTS, Component
from enginediag_cli.engine.declaration import ENGINE_FILE
from enginediag_cli.engine.evaluation import Evaluation
from enginediag_cli.engine.gas import shared_gas
from enginediag_cli.engine.load import size
from enginediag_cli.engine.network import Network
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
        names.append(", ".join(_format_value(c, v) for c, v in zip(varied, corner, strict=True)))
    return (names, rows) if engine.power_range is not None else (names[:1], rows[:1])


def _format_value(column: str, value: float) -> str:
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


HEAD = """\
kind: engine
description: an example
name: example
power_setting: Wf_kg_s
sensors: {T3_K: {noise_sigma: 1.5}}
envelope: {Wf_kg_s: {low: 0.05, high: 2.0}}
power_range: [0.3, 0.7]
"""
MIXED_FLOW = """\
  - {type: ambient, name: ambient, to: "1"}
  - {type: inlet, name: inlet, from: "1", to: "2", corrected_flow_kg_s: 80}
  - {type: compressor, name: fan, from: "2", to: "21", shaft: lp, pressure_ratio: 2.5, isentropic_efficiency: 0.85}
  - {type: splitter, name: splitter, from: "21", core: "25", bypass: "13", bypass_ratio: 1.2}
  - type: compressor
    name: hpc
    from: "25"
    to: "3"
    shaft: hp
    pressure_ratio: 8
    isentropic_efficiency: 0.85
    map: {work_slope: 1.5, choking_exponent: 4}
    ports: [{name: cabin, fraction: 0.01, work_fraction: 0.4, pressure_fraction: 0.3}]
  - type: bleed
    name: cooling
    from: "3"
    to: "31"
    ports: [{name: vanes, fraction: 0.05}]
  - {type: burner, name: burner, from: "31", to: "4", exit_temperature_K: 1450, pressure_loss: 0.05}
  - type: turbine
    name: hpt
    from: "4"
    to: "45"
    shaft: hp
    isentropic_efficiency: 0.87
    cooling_before_rotor: [vanes]
  - {type: turbine, name: lpt, from: "45", to: "5", shaft: lp, isentropic_efficiency: 0.89}
  - {type: duct, name: bypass_duct, from: "13", to: "15", pressure_loss: 0.02, law: corrected_flow_squared}
  - {type: mixer, name: mixer, core: "5", bypass: "15", to: "6", core_mach: 0.4}
  - {type: nozzle, name: nozzle, from: "6"}
"""
MIXED_FLOW_SHAFTS = """\
  - {name: lp, speed_label: N1, design_speed_rpm: 9000}
  - {name: hp, speed_label: N2, design_speed_rpm: 15000}
"""
SINGLE_SHAFT = """\
  - {type: ambient, name: ambient, to: "1", conditions: ground}
  - {type: inlet, name: inlet, from: "1", to: "2", corrected_flow_kg_s: 20}
  - {type: compressor, name: compressor, from: "2", to: "3", shaft: rotor, pressure_ratio: 12,
     isentropic_efficiency: 0.85}
  - {type: burner, name: burner, from: "3", to: "4", exit_temperature_K: 1350}
  - {type: turbine, name: turbine, from: "4", to: "5", shaft: rotor, pressure_ratio: 11, isentropic_efficiency: 0.88}
  - {type: exhaust, name: exhaust, from: "5"}
  - {type: load, name: generator, shaft: rotor, law: surplus, efficiency: 0.97}
"""
SINGLE_SHAFT_SHAFTS = "  - {name: rotor, speed_label: N1, design_speed_rpm: 11000, speed: constant}\n"
TURBOPROP = """\
  - {type: ambient, name: ambient, to: "1"}
  - {type: inlet, name: inlet, from: "1", to: "2", corrected_flow_kg_s: 4}
  - {type: compressor, name: compressor, from: "2", to: "3", shaft: gas_generator, pressure_ratio: 9,
     isentropic_efficiency: 0.81}
  - {type: burner, name: burner, from: "3", to: "4", exit_temperature_K: 1300}
  - type: load
    name: starter_generator
    shaft: gas_generator
    law: given
    design_power_W: 6000
    efficiency: 0.85
  - {type: turbine, name: gas_generator_turbine, from: "4", to: "45", shaft: gas_generator, isentropic_efficiency: 0.84}
  - {type: propeller, name: propeller, shaft: propeller, diameter_m: 2.5, solidity: 0.11, design_power_W: 6.0e5}
  - {type: gearbox, name: reduction_gear, shaft: power_turbine, drives: propeller, ratio: 15, efficiency: 0.985}
  - {type: turbine, name: power_turbine, from: "45", to: "5", shaft: power_turbine, isentropic_efficiency: 0.87}
  - {type: nozzle, name: nozzle, from: "5"}
"""
TURBOPROP_SHAFTS = """\
  - {name: gas_generator, speed_label: N1, design_speed_rpm: 37500}
  - {name: power_turbine, speed_label: N2, design_speed_rpm: 30000}
  - {name: propeller, speed_label: N3, design_speed_rpm: 2000}
"""
AFTERBURNING = MIXED_FLOW.replace(
    """  - {type: nozzle, name: nozzle, from: "6"}
""",
    """  - {type: afterburner, name: afterburner, from: "6", to: "7", inlet_mach: 0.25}
  - {type: condi_nozzle, name: nozzle, from: "7", area_ratio: 1.3, opening_range: [0.9, 1.8]}
""",
)
RECUPERATED = """\
  - {type: ambient, name: ambient, to: "1", conditions: ground}
  - {type: inlet, name: inlet, from: "1", to: "2", corrected_flow_kg_s: 20}
  - {type: compressor, name: low, from: "2", to: "24", shaft: rotor, pressure_ratio: 2.5,
     isentropic_efficiency: 0.85}
  - {type: intercooler, name: intercooler, from: "24", to: "25", effectiveness: 0.85}
  - {type: compressor, name: high, from: "25", to: "3", shaft: rotor, pressure_ratio: 2.5,
     isentropic_efficiency: 0.85}
  - {type: recuperator, name: recuperator, from: "3", to: "35", effectiveness: 0.88, effectiveness_law: ntu}
  - {type: water_injection, name: steam, from: "35", to: "36", largest_flow_kg_s: 1, phase: steam}
  - {type: burner, name: burner, from: "36", to: "4", exit_temperature_K: 1350}
  - {type: turbine, name: turbine, from: "4", to: "5", shaft: rotor, pressure_ratio: 5.4, isentropic_efficiency: 0.88}
  - {type: recuperator_hot, name: gas_side, from: "5", to: "6", recuperator: recuperator, pressure_loss: 0.03}
  - {type: exhaust, name: exhaust, from: "6"}
  - {type: load, name: generator, shaft: rotor, law: surplus, efficiency: 0.97}
"""
ENGINES = tuple(
    f"{HEAD}components:\n{components}shafts:\n{shafts}"
    for components, shafts in (
        (MIXED_FLOW, MIXED_FLOW_SHAFTS),
        (SINGLE_SHAFT, SINGLE_SHAFT_SHAFTS),
        (AFTERBURNING, MIXED_FLOW_SHAFTS),
        (RECUPERATED, SINGLE_SHAFT_SHAFTS),
        (TURBOPROP, TURBOPROP_SHAFTS),
    )
)


@dataclass(frozen=True)
class ComponentExample:
    """A component at work: it, its lines of YAML, and the balances and output columns that it alone brings."""

    component: Component
    text: str
    balances: tuple[str, ...]
    outputs: tuple[str, ...]


def component_example(type_name: str) -> ComponentExample:
    """The last component of this type in the examples, which uses the most keys. Raises KeyError."""
    return _component_examples()[type_name]


@cache
def _component_examples() -> dict[str, ComponentExample]:
    found: dict[str, ComponentExample] = {}
    for text in ENGINES:
        network = _sized(text)
        e = network.design_point
        assert e is not None
        again = Evaluation(network.gas, 1, e.leaves)
        again.make_shaft = e.make_shaft
        for c, lines in zip(network.components, _blocks(text), strict=True):
            before = set(again.balances), set(again.outputs)
            with np.errstate(all="ignore"):
                c.evaluate(again)
            balances = tuple(b for b in again.balances if b not in before[0])
            outputs = tuple(o for o in again.outputs if o not in before[1])
            if c.TYPE not in found or len(lines) > len(found[c.TYPE].text):
                found[c.TYPE] = ComponentExample(c, lines, balances, outputs)
    return found


def _sized(text: str) -> Network:
    checked = validate(parse_document(text, "example"), ENGINE_FILE)
    values = checked.values
    components = [COMPONENTS[c["type"]](c) for c in values["components"]]
    gas = shared_gas(values["fuel_hydrogen_carbon_ratio"])
    network = Network(gas, components, values["shafts"], values["power_setting"], values["design"], values["start"])
    size(network, values, checked)
    return network


def _blocks(text: str) -> list[str]:
    """The lines of each component, in order."""
    listed = text.split("components:\n")[1].split("shafts:\n")[0]
    return [f"  - {block}".rstrip() for block in listed.split("  - ")[1:]]
