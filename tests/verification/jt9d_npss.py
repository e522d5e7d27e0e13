"""The public JT9D model with its own tabulated maps, against 89 operating points solved by NPSS 2.4.

The engine file is written from the published design data; all scalings are converted to SI here.
"""

from __future__ import annotations

import csv
import json
from pathlib import Path
from typing import Any

import numpy as np
import yaml

from enginediag_cli.config.files import outside_allowed
from enginediag_cli.engine.engine import Engine
from enginediag_cli.physics.engine_file import load_engine

LB, PSI = 0.45359237, 6894.757293168
TURBINE_FLOW = LB / (1.8**0.5 * PSI)  # lb/s √R / psi → kg/s √K / Pa
STATIONS = ("2", "13", "21", "25", "3", "4", "45", "5")


def engine_file(folder: Path, power_setting: str = "Wf_kg_s") -> dict[str, Any]:
    """The engine as an engine file (a dict), maps read from the data folder."""
    design = json.loads((folder / "design.json").read_text())
    scale, ducts, burner = design["map_scalars_imperial"], design["duct_dp"], design["burner"]
    recovery = design["inlet_pressure_recovery"]
    case = next(csv.DictReader((folder / "cases.csv").open()))

    def compressor(name: str, key: str, file: str, start: str, end: str, shaft: str) -> dict[str, Any]:
        s = scale[key]
        return {
            "type": "compressor",
            "name": name,
            "from": start,
            "to": end,
            "shaft": shaft,
            "pressure_ratio": float(case[f"{key}_PR"]),
            "isentropic_efficiency": float(case[f"{key}_eff"]),
            "table": {
                "file": str(folder / file),
                "interpolation": "quadratic",
                "design_speed": float(case[f"{key}_NcMap"]),
                "design_rline": float(case[f"{key}_Rline"]),
                "speed_rpm": s["s_Nc"],
                "flow_kg_s": s["s_Wc"] * LB,
                "pressure_ratio_scale": s["s_PR"],
                "efficiency_scale": s["s_eff"],
            },
        }

    def turbine(name: str, key: str, file: str, start: str, end: str, shaft: str, **more: Any) -> dict[str, Any]:
        s = scale[key]
        return {
            "type": "turbine",
            "name": name,
            "from": start,
            "to": end,
            "shaft": shaft,
            "isentropic_efficiency": float(case[f"{key}_eff"]),
            "pressure_ratio": float(case[f"{key}_PR"]),
            "table": {
                "file": str(folder / file),
                "interpolation": "linear",
                "design_speed": 100.0,
                "design_pressure_ratio": float(case[f"{key}_PRmap"]),
                "speed_rpm_K": s["s_Nc"] * 1.8**0.5,
                "flow_parameter": s["s_Wc"] * TURBINE_FLOW,
                "pressure_ratio_scale": s["s_PR"],
                "efficiency_scale": s["s_eff"],
            },
            **more,
        }

    def duct(name: str, start: str, end: str, key: str) -> dict[str, Any]:
        return {"type": "duct", "name": name, "from": start, "to": end, "pressure_loss": ducts[key]}

    inlet_bleed, exit_bleed = design["bleed"]["fraction_of_W3"]["HPT_inlet_then_exit"]
    theta = float(case["T2_K"]) / 288.15
    corrected = float(case["W2_kg_s"]) * theta**0.5 / (float(case["P2_Pa"]) / 101325.0)
    return {
        "kind": "engine",
        "description": "public JT9D model",
        "name": "jt9d",
        "power_setting": power_setting,
        "design": {"altitude_m": 0, "mach": 0, "dT_isa_K": 15},
        "components": [
            {"type": "ambient", "name": "ambient", "to": "1"},
            {
                "type": "inlet",
                "name": "inlet",
                "from": "1",
                "to": "2",
                "corrected_flow_kg_s": corrected,
                "recovery_mach": recovery["mach"],
                "recovery_table": recovery["recovery"],
                "recovery_rule": "step",
            },
            compressor("fan", "Fan", "map_fan.csv", "2", "21", "lp"),
            {
                "type": "splitter",
                "name": "splitter",
                "from": "21",
                "core": "22",
                "bypass": "13",
                "bypass_ratio": float(case["BPR"]),
            },
            duct("gooseneck", "22", "23", "22-23"),
            compressor("booster", "LPC", "map_lpc.csv", "23", "24", "lp"),
            duct("interduct", "24", "25", "24-25"),
            compressor("hpc", "HPC", "map_hpc.csv", "25", "3", "hp"),
            {
                "type": "bleed",
                "name": "cooling",
                "from": "3",
                "to": "31",
                "ports": [{"name": "hpt_vanes", "fraction": inlet_bleed}, {"name": "hpt_exit", "fraction": exit_bleed}],
            },
            {
                "type": "burner",
                "name": "burner",
                "from": "31",
                "to": "4",
                "exit_temperature_K": float(case["T4_K"]),
                "combustion_efficiency": burner["eff"],
                "pressure_loss": burner["dp"],
                "lower_heating_value_J_kg": burner["efficiency_times_lower_heating_value_J_kg"] / burner["eff"],
            },
            turbine(
                "hpt",
                "HPT",
                "map_hpt.csv",
                "4",
                "45",
                "hp",
                cooling_before_rotor=["hpt_vanes"],
                cooling_after_rotor=["hpt_exit"],
                rotor_inlet_station="41",
            ),
            duct("turbine_duct", "45", "48", "45-48"),
            turbine("lpt", "LPT", "map_lpt.csv", "48", "5", "lp"),
            duct("tailpipe", "5", "7", "5-7"),
            {
                "type": "nozzle",
                "name": "core_nozzle",
                "from": "7",
                "area_m2": float(case["Core_Nozz_Ath_m2"]),
                "velocity_coefficient": float(case["Core_Nozz_Cv"]),
            },
            duct("bypass_duct", "13", "17", "15-17"),
            {
                "type": "nozzle",
                "name": "bypass_nozzle",
                "from": "17",
                "area_m2": float(case["Byp_Nozz_Ath_m2"]),
                "velocity_coefficient": float(case["Byp_Nozz_Cv"]),
            },
        ],
        "shafts": [
            {"name": "lp", "speed_label": "N1", "design_speed_rpm": float(case["N1_rpm"])},
            {"name": "hp", "speed_label": "N2", "design_speed_rpm": float(case["N2_rpm"])},
        ],
        "sensors": {"T3_K": {"noise_sigma": 1.0}},
        "envelope": {
            "altitude_m": {"low": 0, "high": 12500},
            "mach": {"low": 0, "high": 0.9},
            "dT_isa_K": {"low": -30, "high": 30},
            power_setting: {"low": 0.2, "high": 3.0} if power_setting == "Wf_kg_s" else {"low": 1500, "high": 4200},
        },
        "power_range": [0.5, 2.4] if power_setting == "Wf_kg_s" else [1800, 3900],
    }


def load(folder: Path, scratch: Path, power_setting: str = "Wf_kg_s") -> Engine:
    path = scratch / f"jt9d_{power_setting}.yaml"
    path.write_text(yaml.safe_dump(engine_file(folder, power_setting), sort_keys=False))
    with outside_allowed():  # its maps lie beside the public cases
        return load_engine(path)


def compare(folder: Path, scratch: Path, power_setting: str = "Wf_kg_s") -> dict[str, np.ndarray]:
    """|calculated/NPSS − 1| in %, per column an array over the 89 cases; NaN where a case did not solve."""
    engine = load(folder, scratch, power_setting)
    with (folder / "cases.csv").open() as file:
        cases = list(csv.DictReader(file))
    truth = {c: np.array([float(r[c]) for r in cases]) for c in cases[0]}
    columns = [f"{w}{s}_{u}" for s in STATIONS for w, u in (("T", "K"), ("P", "Pa"), ("W", "kg_s"))]
    columns += ["N1_rpm", "N2_rpm", "Fn_N", "BPR", "Wf_kg_s"]
    result = engine.predict({c: truth[c] for c in engine.inputs}, sensors=columns)
    return {c: 100.0 * np.abs(y / truth[c] - 1.0) for c, y in zip(columns, result.y.T, strict=True)}
