"""pyCycle's afterburning turbojet against the numbers that its own regression test prints.

Source: OpenMDAO/pyCycle, example_cycles/tests/benchmark_ab_turbojet.py (tolerance 1e-3 there): one shaft, two cooling
bleeds, an afterburner, and a convergent–divergent nozzle whose throat and exit follow: the R-line 2 of the compressor
is held by the throat, the exit expands to ambient pressure. Off-design points need component maps, which are not part
of the project. Its last point, at 70,000 ft, lies above the standard atmosphere that is known here.
"""

from __future__ import annotations

import json
from copy import copy
from pathlib import Path
from typing import Any

import numpy as np
import shared_data
import yaml
from pycycle_hbtf import LB, _write_map
from scipy.optimize import brentq

from enginediag_cli.config.files import outside_allowed
from enginediag_cli.engine.components.base import scalar
from enginediag_cli.engine.engine import Engine
from enginediag_cli.physics.engine_file import load_engine

FOLDER = "pycycle_examples"
LBF, FT, RANKINE = 4.4482216152605, 0.3048, 1.0 / 1.8
JP7_HEATING_VALUE = 45.306e6
"""J/kg of C2H4.0044: fuel enters at zero enthalpy on the scale of its elements, so that heats of formation of CO2
(393.51 kJ/mol) and H2O (241.83 kJ/mol) are released in full."""
JP7_RATIO = 2.0022
"""Atoms of hydrogen per carbon of that fuel."""
T4_K = 2370.0 * RANKINE
LIT_AT_DESIGN = 0.031523391  # fuel over all gas that enters the afterburner
LIT_AT_MACH_08 = 0.022759941
RLINE = 2.0

MACH = np.array([1e-6, 0.8, 1.00001, 1.2, 0.6, 1.6, 1.6])
ALTITUDE_FT = np.array([0.0, 0.0, 15e3, 25e3, 35e3, 35e3, 50e3])
PRINTED = {
    "air": [168.005, 225.917, 166.073, 141.201, 61.708, 145.635, 71.539],  # lb/s
    "OPR": [13.500, 11.971, 12.526, 12.636, 16.956, 11.765, 11.876],
    "fuel-air ratio": [0.01755, 0.01629, 0.01680, 0.01689, 0.01873, 0.01608, 0.01620],
    "N1": [8070.00, 8288.85, 8197.38, 8181.03, 8902.24, 8326.59, 8306.00],
    "gross thrust": [11800.0, 17210.0, 13881.2, 12589.2, 5109.4, 14061.9, 6930.5],  # lbf
    "T3": [1190.18, 1280.18, 1243.86, 1237.20, 1105.24, 1294.80, 1286.85],  # °R
}
"""Points with the afterburner off, in the order of MACH."""
PRINTED_LIT = {"gross thrust": (17799.7, 24085.2), "SFC": (1.61420, 1.71066)}
"""Lit: at design and at Mach 0.8; lbf, and lb of all fuel per hour and lbf of net thrust."""


def maps() -> dict[str, Any] | None:
    """Component maps of pyCycle, exported beside the public data; None without."""
    path = shared_data.DATA / FOLDER / "maps.json"
    return json.loads(path.read_text()) if path.exists() else None


def engine(scratch: Path, tables: dict[str, Any] | None = None, lit_K: float | None = None) -> Engine:
    """The turbojet; `lit_K`: exit temperature of the afterburner at the design point."""
    cooling = [{"name": "cool1", "fraction": 0.0789}, {"name": "cool2", "fraction": 0.0383}]
    heat = {"combustion_efficiency": 1.0, "lower_heating_value_J_kg": JP7_HEATING_VALUE}
    compressor = {"shaft": "hp", "pressure_ratio": 13.5, "isentropic_efficiency": 0.83, "ports": cooling}
    turbine = {"shaft": "hp", "isentropic_efficiency": 0.86}
    turbine |= {"cooling_before_rotor": ["cool1"], "cooling_after_rotor": ["cool2"]}
    if tables is not None:
        _write_map(scratch / "comp.csv", tables["AXI5"], turbine=False)
        _write_map(scratch / "turb.csv", tables["LPT2269"], turbine=True)
        at = tables["AXI5"]["defaults"]
        about = {"file": "comp.csv", "interpolation": "linear"}
        compressor["table"] = about | {"design_speed": at["NcMap"], "design_rline": at["RlineMap"]}
        at = tables["LPT2269"]["defaults"]
        turbine["table"] = {"file": "turb.csv", "design_speed": at["NpMap"], "design_pressure_ratio": at["PRmap"]}
    afterburner = {"set_by": "fuel_flow", "upper_stop": 5.0, "pressure_loss": 0.06, **heat} | (
        {"exit_temperature_K": lit_K} if lit_K else {}
    )
    made = {
        "kind": "engine",
        "description": "pyCycle afterburning turbojet",
        "name": "ab_turbojet",
        "power_setting": "T4_K",
        "fuel_hydrogen_carbon_ratio": JP7_RATIO,
        "design": {"altitude_m": 0, "mach": 1e-6, "dT_isa_K": 0},
        "components": [
            {"type": "ambient", "name": "ambient", "to": "1"},
            _part("inlet", "inlet", "1", "11", corrected_flow_kg_s=168.005 * LB),
            _part("duct", "duct", "11", "2", pressure_loss=0.02),
            _part("compressor", "comp", "2", "3", **compressor),
            _part("burner", "burner", "3", "4", exit_temperature_K=T4_K, pressure_loss=0.03, **heat),
            _part("turbine", "turb", "4", "5", **turbine),
            _part("afterburner", "ab", "5", "7", **afterburner),
            {"type": "condi_nozzle", "name": "nozzle", "from": "7", "velocity_coefficient": 0.99},
        ],
        "shafts": [{"name": "hp", "speed_label": "N1", "design_speed_rpm": 8070}],
        "sensors": {"T3_K": {"noise_sigma": 1.0}},
        "envelope": {"mach": {"low": 0, "high": 2.0}},
        "power_range": [1000, 1400],
    }
    path = scratch / "ab_turbojet.yaml"
    path.write_text(yaml.safe_dump(made, sort_keys=False))
    with outside_allowed():
        return load_engine(path)


def _part(type_: str, name: str, start: str, end: str, **keys: Any) -> dict[str, Any]:
    return {"type": type_, "name": name, "from": start, "to": end, **keys}


Compared = dict[str, tuple[float, float]]
"""Quantity → here, printed there, both in the units of the printed numbers."""


def dry_at_design(scratch: Path) -> Compared:
    made = engine(scratch)
    o = made.network.design_point
    assert o is not None
    fuel, thrust = (scalar(o.outputs[c]) for c in ("Wf_kg_s", "gross_thrust_N"))
    return {
        "T3": (scalar(o.flows["3"].T) / RANKINE, 1190.18),
        "pressure ratio of the turbine": (scalar(o.flows["4"].P / o.flows["5"].P), 4.4613),
        "fuel-air ratio": (fuel / scalar(o.flows["3"].W), 0.01755),
        "gross thrust": (thrust / LBF, 11800.0),
        "SFC": (fuel / LB * 3600.0 / (thrust / LBF), 0.79415),
    }


def lit_at_design(scratch: Path) -> Compared:
    """The core at its design point, as the nozzle opens; the exit temperature is sought that takes the fuel."""

    def surplus(lit_K: float) -> float:
        o = engine(scratch, lit_K=lit_K).network.design_point
        assert o is not None
        return scalar(o.outputs["ab_fuel_kg_s"]) - LIT_AT_DESIGN * scalar(o.flows["5"].W)

    o = engine(scratch, lit_K=brentq(surplus, 1800.0, 2100.0, xtol=1e-6)).network.design_point
    assert o is not None
    thrust, fuel = scalar(o.outputs["gross_thrust_N"]) / LBF, scalar(o.outputs["Wf_total_kg_s"]) / LB
    return {
        "gross thrust": (thrust, PRINTED_LIT["gross thrust"][0]),
        "SFC": (fuel * 3600.0 / thrust, PRINTED_LIT["SFC"][0]),
    }


def off_design(scratch: Path, tables: dict[str, Any]) -> dict[str, tuple[np.ndarray, np.ndarray]]:
    """Quantity → here and printed there, at the seven points with the afterburner off."""
    made = engine(scratch, tables)
    y = _held(made, _points(slice(None)))
    found = {
        "air": y["W2_kg_s"] / LB,
        "OPR": y["P3_Pa"] / y["P2_Pa"],
        "fuel-air ratio": y["Wf_kg_s"] / y["W3_kg_s"],
        "N1": y["N1_rpm"],
        "gross thrust": y["gross_thrust_N"] / LBF,
        "T3": y["T3_K"] / RANKINE,
    }
    return {name: (x, np.array(PRINTED[name])) for name, x in found.items()}


def lit_at_mach_08(scratch: Path, tables: dict[str, Any]) -> Compared:
    made, U = engine(scratch, tables), _points(slice(1, 2))
    fuel = LIT_AT_MACH_08 * float(_held(made, U)["W5_kg_s"][0])  # the core is that without afterburner
    lit = copy(made)
    lit.network = copy(made.network)
    lit.network.neutral = {**made.network.neutral, "ab.fuel_kg_s": fuel}
    lit._strategy = copy(made._strategy)
    lit._strategy.network = lit.network
    y = {c: float(x[0]) for c, x in _held(lit, U, near=1.3).items()}
    sfc = y["Wf_total_kg_s"] / y["Fn_N"] * 3600.0 * LBF / LB
    return {
        "gross thrust": (y["gross_thrust_N"] / LBF, PRINTED_LIT["gross thrust"][1]),
        "SFC": (sfc, PRINTED_LIT["SFC"][1]),
    }


def _points(at: slice) -> dict[str, np.ndarray]:
    n = MACH[at].size
    return {"altitude_m": ALTITUDE_FT[at] * FT, "mach": MACH[at], "dT_isa_K": np.zeros(n), "T4_K": np.full(n, T4_K)}


def _held(made: Engine, U: dict[str, np.ndarray], near: float = 1.0) -> dict[str, np.ndarray]:
    """Model columns with the throat that holds the compressor's R-line, found by the secant method; `near`: about how
    large it is."""
    columns = ("W2_kg_s", "P2_Pa", "P3_Pa", "Wf_kg_s", "W3_kg_s", "N1_rpm", "gross_thrust_N", "T3_K", "W5_kg_s")
    columns = (*columns, "Wf_total_kg_s", "Fn_N")
    rline = [u.name for u in made.unknowns].index("comp.rline")
    before, area = np.full(U["mach"].size, 0.98 * near), np.full(U["mach"].size, near)
    p = made.predict(U, {"nozzle.area": before}, sensors=columns)
    last = p.x[rline] - RLINE
    for _ in range(30):
        p = made.predict(U, {"nozzle.area": area}, sensors=columns)
        off = p.x[rline] - RLINE
        if np.abs(off).max() < 1e-9:
            return dict(zip(columns, p.y.T, strict=True))
        slope = (off - last) / np.where(area == before, 1.0, area - before)
        before, last = area, off
        area = np.clip(area - off / np.where(slope == 0.0, np.inf, slope), 0.3, 3.0)
    raise RuntimeError(f"no throat holds R-line {RLINE:g}: {off}")
