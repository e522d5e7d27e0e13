"""A CFM56-class turbofan solved by pyCycle 4.4, against the same maps and design point in this model.

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
EFFECTIVE_HEATING_VALUE = 44.84e6  # J/kg: fuel enters at zero enthalpy on the scale of its elements


def _write_map(path: Path, data: dict[str, Any], turbine: bool) -> None:
    """One component map as a table of this tool, first sheet of the stacked map."""
    x, y = (data["NpMap"], data["PRmap"]) if turbine else (data["NcMap"], data["Rline"])
    sheets = ("WpMap", "effMap") if turbine else ("WcMap_lbms", "PRmap", "effMap")
    header = "Nc_map,PR_map,Wp_map,eff_map" if turbine else "Nc_map,Rline,Wc_map,PR_map,eff_map"
    tables = [data[s][0] for s in sheets]
    rows = [",".join(map(repr, (a, b, *(t[i][j] for t in tables)))) for i, a in enumerate(x) for j, b in enumerate(y)]
    path.write_text("\n".join([header, *rows]) + "\n")


def engine_file(folder: Path, scratch: Path) -> dict[str, Any]:
    """The engine as an engine file (a dict), with N1 as power setting."""
    design = json.loads((folder / "design.json").read_text())
    maps = json.loads((folder / "maps.json").read_text())
    parts, fraction, stations = design["components"], design["bleeds"], design["stations"]
    loss = design["params"]

    def compressor(name: str, start: str, end: str, shaft: str, ports: tuple[str, ...] = ()) -> dict[str, Any]:
        _write_map(scratch / f"{name}.csv", maps[name], turbine=False)
        c = parts[name]
        return {
            "type": "compressor",
            "name": name,
            "from": start,
            "to": end,
            "shaft": shaft,
            "pressure_ratio": c["PR"],
            "isentropic_efficiency": c["eff_adiab"],
            "table": {
                "file": f"{name}.csv",
                "interpolation": "linear",
                "design_speed": c["map_NcMap"],
                "design_rline": c["map_Rline"],
                "speed_rpm": c["s_Nc"],
                "flow_kg_s": c["s_Wc"] * LB,
                "pressure_ratio_scale": c["s_PR"],
                "efficiency_scale": c["s_eff"],
            },
            "ports": [
                {
                    "name": p,
                    "fraction": fraction[f"{name}.{p}:frac_W"],
                    "work_fraction": fraction[f"{name}.{p}:frac_work"],
                    "pressure_fraction": fraction[f"{name}.{p}:frac_P"],
                }
                for p in ports
            ],
        }

    def turbine(name: str, start: str, end: str, shaft: str, before: str, after: str) -> dict[str, Any]:
        _write_map(scratch / f"{name}.csv", maps[name], turbine=True)
        c = parts[name]
        return {
            "type": "turbine",
            "name": name,
            "from": start,
            "to": end,
            "shaft": shaft,
            "isentropic_efficiency": c["eff_adiab"],
            "pressure_ratio": c["PR"],
            "table": {
                "file": f"{name}.csv",
                "interpolation": "linear",
                "design_speed": c["map_NpMap"],
                "design_pressure_ratio": c["map_PR"],
                "speed_rpm_K": c["s_Np"] * 1.8**0.5,
                "flow_parameter": c["s_Wp"] * TURBINE_FLOW,
                "pressure_ratio_scale": c["s_PR"],
                "efficiency_scale": c["s_eff"],
            },
            "cooling_before_rotor": [before],
            "cooling_after_rotor": [after],
        }

    def duct(name: str, start: str, end: str) -> dict[str, Any]:
        return {"type": "duct", "name": name, "from": start, "to": end, "pressure_loss": loss[f"{name}.dPqP"]}

    def bleed(name: str, start: str, end: str, *ports: str) -> dict[str, Any]:
        return {
            "type": "bleed",
            "name": name,
            "from": start,
            "to": end,
            "ports": [{"name": p, "fraction": fraction[f"{name}.{p}:frac_W"]} for p in ports],
        }

    inlet = stations["2"]
    return {
        "kind": "engine",
        "description": "pyCycle high-bypass turbofan",
        "name": "hbtf",
        "power_setting": "N1_rpm",
        "fuel_hydrogen_carbon_ratio": 23 / 12,
        "design": {"altitude_m": 10668, "mach": 0.8, "dT_isa_K": 0},
        "components": [
            {"type": "ambient", "name": "ambient", "to": "1"},
            {
                "type": "inlet",
                "name": "inlet",
                "from": "1",
                "to": "2",
                "pressure_recovery": loss["inlet.ram_recovery"],
                "corrected_flow_kg_s": inlet["W_kgs"] * (inlet["Tt_K"] / 288.15) ** 0.5 / (inlet["Pt_Pa"] / 101325.0),
            },
            compressor("fan", "2", "21", "lp"),
            {
                "type": "splitter",
                "name": "splitter",
                "from": "21",
                "core": "22",
                "bypass": "13",
                "bypass_ratio": design["overall"]["BPR"],
            },
            duct("duct4", "22", "23"),
            compressor("lpc", "23", "24", "lp"),
            duct("duct6", "24", "25"),
            compressor("hpc", "25", "3", "hp", ports=("cool1", "cool2", "cust")),
            bleed("bld3", "3", "31", "cool3", "cool4"),
            {
                "type": "burner",
                "name": "burner",
                "from": "31",
                "to": "4",
                "exit_temperature_K": stations["4_burner_exit"]["Tt_K"],
                "combustion_efficiency": 1.0,
                "pressure_loss": loss["burner.dPqP"],
                "lower_heating_value_J_kg": EFFECTIVE_HEATING_VALUE,
            },
            turbine("hpt", "4", "44", "hp", "cool3", "cool4"),
            duct("duct11", "44", "45"),
            turbine("lpt", "45", "5", "lp", "cool1", "cool2"),
            duct("duct13", "5", "7"),
            {
                "type": "nozzle",
                "name": "core_nozzle",
                "from": "7",
                "area_m2": parts["core_nozz"]["A_throat_m2"],
                "velocity_coefficient": parts["core_nozz"]["Cv"],
            },
            bleed("byp_bld", "13", "16", "bypBld"),
            duct("duct15", "16", "17"),
            {
                "type": "nozzle",
                "name": "bypass_nozzle",
                "from": "17",
                "area_m2": parts["byp_nozz"]["A_throat_m2"],
                "velocity_coefficient": parts["byp_nozz"]["Cv"],
            },
        ],
        "shafts": [
            {"name": "lp", "speed_label": "N1", "design_speed_rpm": design["shafts"]["LP_rpm"]},
            {
                "name": "hp",
                "speed_label": "N2",
                "design_speed_rpm": design["shafts"]["HP_rpm"],
                "power_offtake_W": design["shafts"]["HPX_W"],
            },
        ],
        "sensors": {"T3_K": {"noise_sigma": 1.0}},
        "envelope": {
            "altitude_m": {"low": 0, "high": 12500},
            "mach": {"low": 0, "high": 0.9},
            "dT_isa_K": {"low": -30, "high": 30},
            "N1_rpm": {"low": 1500, "high": 5200},
        },
        "power_range": [2500, 5200],
    }


def load(folder: Path, scratch: Path) -> Engine:
    path = scratch / "hbtf.yaml"
    path.write_text(yaml.safe_dump(engine_file(folder, scratch), sort_keys=False))
    with outside_allowed():  # its maps lie beside the public cases
        return load_engine(path)


def compare(folder: Path, scratch: Path) -> dict[str, np.ndarray]:
    """|calculated/pyCycle − 1| in %, per column an array over the nominal points; NaN where one did not solve."""
    engine = load(folder, scratch)
    with (folder / "nominal.csv").open() as file:
        rows = list(csv.DictReader(file))
    truth = {c: np.array([float(r[c]) for r in rows]) for c in rows[0]}
    columns = [c for c in truth if c not in engine.inputs and c != "Ps3_Pa"]
    result = engine.predict({c: truth[c] for c in engine.inputs}, sensors=columns)
    return {c: 100.0 * np.abs(y / truth[c] - 1.0) for c, y in zip(columns, result.y.T, strict=True)}
