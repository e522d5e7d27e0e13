"""A recuperated, intercooled single-shaft engine with a generator, written as an engine file."""

RECUPERATED = """\
kind: engine
description: recuperated gas turbine for tests
name: recuperated
power_setting: T4_K
components:
  - {type: ambient, name: ambient, to: "1", conditions: ground}
  - {type: inlet, name: inlet, from: "1", to: "2", corrected_flow_kg_s: 0.8}
  - {type: compressor, name: compressor, from: "2", to: "3", shaft: rotor, pressure_ratio: 4.2,
     isentropic_efficiency: 0.78}
  - {type: recuperator, name: recuperator, from: "3", to: "35", effectiveness: 0.87, pressure_loss: 0.02}
  - {type: burner, name: burner, from: "35", to: "4", exit_temperature_K: 1200, pressure_loss: 0.03}
  - {type: turbine, name: turbine, from: "4", to: "5", shaft: rotor, pressure_ratio: 3.7, isentropic_efficiency: 0.84}
  - {type: recuperator_hot, name: gas_side, from: "5", to: "6", recuperator: recuperator, pressure_loss: 0.04}
  - {type: exhaust, name: exhaust, from: "6"}
  - {type: load, name: generator, shaft: rotor, law: surplus, efficiency: 0.95}
shafts:
  - {name: rotor, speed_label: N1, design_speed_rpm: 70000, speed: input}
sensors:
  T5_K: {noise_sigma: 2}
  P3_Pa: {noise_sigma: 1000}
envelope: {T4_K: {low: 900, high: 1300}}
power_range: [1000, 1200]
"""
WITHOUT = (
    RECUPERATED.replace("type: recuperator, ", "type: duct, ")
    .replace("effectiveness: 0.87, ", "")
    .replace("type: recuperator_hot, ", "type: duct, ")
    .replace("recuperator: recuperator, ", "")
)

__all__ = ["RECUPERATED", "WITHOUT"]
