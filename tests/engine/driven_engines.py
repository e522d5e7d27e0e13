"""Engines whose shafts drive something: a turboprop, a geared turbofan, a gas generator with several loads."""

HEAD = """\
kind: engine
description: an engine for tests
name: driven
power_setting: {setting}
sensors: {{T3_K: {{noise_sigma: 1.5}}}}
envelope:
  altitude_m: {{low: 0, high: 9000}}
  mach: {{low: 0, high: 0.6}}
  dT_isa_K: {{low: -20, high: 20}}
  Wf_kg_s: {{low: 0.01, high: 2.0}}
power_range: [{low}, {high}]
design: {{altitude_m: {altitude}, mach: {mach}, dT_isa_K: 0}}
"""
CORE = """\
components:
  - {type: ambient, name: ambient, to: "1"}
  - {type: inlet, name: inlet, from: "1", to: "2", corrected_flow_kg_s: 4}
  - {type: compressor, name: compressor, from: "2", to: "3", shaft: gas_generator, pressure_ratio: 9,
     isentropic_efficiency: 0.81}
  - {type: burner, name: burner, from: "3", to: "4", exit_temperature_K: 1300}
  - {type: load, name: starter_generator, shaft: gas_generator, law: given, design_power_W: 6000, efficiency: 0.85}
  - {type: turbine, name: hpt, from: "4", to: "45", shaft: gas_generator, isentropic_efficiency: 0.84}
"""
PROPELLER = (
    "  - {type: propeller, name: propeller, shaft: propeller, diameter_m: 2.5, solidity: 0.11, design_power_W: 6.0e5}\n"
)
GEAR = "  - {type: gearbox, name: reduction, shaft: free, drives: propeller, ratio: 15, efficiency: 0.985}\n"
FREE = """\
  - {type: turbine, name: lpt, from: "45", to: "5", shaft: free, isentropic_efficiency: 0.87}
  - {type: nozzle, name: nozzle, from: "5"}
shafts:
  - {name: gas_generator, speed_label: N1, design_speed_rpm: 37500, mechanical_efficiency: 0.99}
  - {name: free, speed_label: N2, design_speed_rpm: 30000}
  - {name: propeller, speed_label: N3, design_speed_rpm: 2000, mechanical_efficiency: 0.995, power_offtake_W: 2000}
"""


def turboprop(setting="Wf_kg_s", mach=0.0, altitude=0.0, core=CORE, propeller=PROPELLER):
    head = HEAD.format(setting=setting, low=0.02, high=0.062, mach=mach, altitude=altitude)
    return head + core + propeller + GEAR + FREE


GEARED_FAN = (
    HEAD.format(setting="Wf_kg_s", low=0.2, high=0.9, mach=0.0, altitude=0.0)
    + """\
components:
  - {type: ambient, name: ambient, to: "1"}
  - {type: inlet, name: inlet, from: "1", to: "2", corrected_flow_kg_s: 300}
  - {type: compressor, name: fan, from: "2", to: "21", shaft: fan, pressure_ratio: 1.45, isentropic_efficiency: 0.9}
  - {type: splitter, name: splitter, from: "21", core: "22", bypass: "13", bypass_ratio: 10}
  - {type: compressor, name: booster, from: "22", to: "25", shaft: lp, pressure_ratio: 2.5, isentropic_efficiency: 0.88}
  - {type: compressor, name: hpc, from: "25", to: "3", shaft: hp, pressure_ratio: 11, isentropic_efficiency: 0.86}
  - {type: gearbox, name: fan_gear, shaft: lp, drives: fan, efficiency: 0.993}
  - {type: burner, name: burner, from: "3", to: "4", exit_temperature_K: 1650}
  - {type: turbine, name: hpt, from: "4", to: "45", shaft: hp, isentropic_efficiency: 0.89}
  - {type: turbine, name: lpt, from: "45", to: "5", shaft: lp, isentropic_efficiency: 0.91}
  - {type: nozzle, name: core_nozzle, from: "5"}
  - {type: nozzle, name: bypass_nozzle, from: "13"}
shafts:
  - {name: fan, speed_label: N1, design_speed_rpm: 3300, mechanical_efficiency: 0.999}
  - {name: lp, speed_label: N3, design_speed_rpm: 9900}
  - {name: hp, speed_label: N2, design_speed_rpm: 20000}
"""
)
