"""Small engines that hold every component type: the component reference is made from them."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache

import numpy as np

from enginediag_cli.config.document import parse_document
from enginediag_cli.config.validate import validate
from enginediag_cli.engine.components import COMPONENTS, Component
from enginediag_cli.engine.declaration import ENGINE_FILE
from enginediag_cli.engine.evaluation import Evaluation
from enginediag_cli.engine.gas import gas_for
from enginediag_cli.engine.load import size
from enginediag_cli.engine.network import Network

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
class Shown:
    """A component at work: it, its lines of YAML, and the balances and output columns that it alone brings."""

    component: Component
    text: str
    balances: tuple[str, ...]
    outputs: tuple[str, ...]


def shown(type_name: str) -> Shown:
    """The last component of this type in the examples, which uses the most keys. Raises KeyError."""
    return _all()[type_name]


@cache
def _all() -> dict[str, Shown]:
    found: dict[str, Shown] = {}
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
                found[c.TYPE] = Shown(c, lines, balances, outputs)
    return found


def _sized(text: str) -> Network:
    checked = validate(parse_document(text, "example"), ENGINE_FILE)
    values = checked.values
    components = [COMPONENTS[c["type"]](c) for c in values["components"]]
    gas = gas_for(values["fuel_hydrogen_carbon_ratio"])
    network = Network(gas, components, values["shafts"], values["power_setting"], values["design"], values["start"])
    size(network, values, checked)
    return network


def _blocks(text: str) -> list[str]:
    """The lines of each component, in order."""
    listed = text.split("components:\n")[1].split("shafts:\n")[0]
    return [f"  - {block}".rstrip() for block in listed.split("  - ")[1:]]
