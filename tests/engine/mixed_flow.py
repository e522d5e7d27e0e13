"""A small mixed-flow turbofan with an interstage bleed to its bypass duct, written as an engine file."""

MIXED_FLOW = """\
kind: engine
description: Two-spool mixed-flow turbofan for tests
name: mixed
design: {altitude_m: 0, mach: 0, dT_isa_K: 0}
power_setting: Wf_kg_s
components:
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
    ports:
      - {name: valve, fraction: 0.02, work_fraction: 0.4, pressure_fraction: 0.3}
      - {name: vanes, fraction: 0.05}
      - {name: cabin, fraction: 0.01}
  - {type: burner, name: burner, from: "3", to: "4", exit_temperature_K: 1450}
  - {type: turbine, name: hpt, from: "4", to: "45", shaft: hp, isentropic_efficiency: 0.87,
     cooling_before_rotor: [vanes]}
  - {type: turbine, name: lpt, from: "45", to: "5", shaft: lp, isentropic_efficiency: 0.89}
  - {type: duct, name: bypass_duct, from: "13", to: "15", pressure_loss: 0.02, law: corrected_flow_squared,
     receives: [valve]}
  - {type: mixer, name: mixer, core: "5", bypass: "15", to: "6", core_mach: 0.4}
  - {type: nozzle, name: nozzle, from: "6"}
shafts:
  - {name: lp, speed_label: N1, design_speed_rpm: 9000, mechanical_efficiency: 0.99}
  - {name: hp, speed_label: N2, design_speed_rpm: 15000, power_offtake_W: 50000}
sensors:
  N1_rpm: {noise_sigma: 5}
  N2_rpm: {noise_sigma: 10}
  T3_K: {noise_sigma: 1.5}
  P3_Pa: {noise_sigma: 5000}
  T5_K: {noise_sigma: 2}
  P6_Pa: {noise_sigma: 400}
  Fn_N: {noise_sigma: 100}
envelope:
  altitude_m: {low: 0, high: 12000}
  mach: {low: 0, high: 0.9}
  dT_isa_K: {low: -25, high: 25}
  Wf_kg_s: {low: 0.05, high: 2.0}
power_range: [0.3, 0.7]
"""
