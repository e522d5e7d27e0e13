"""Example engines of pyCycle against the numbers that its own regression tests print.

Source: OpenMDAO/pyCycle, example_cycles/tests/benchmark_single_spool_turboshaft.py, benchmark_multi_spool_turboshaft.py
and benchmark_mixedflow_turbofan.py (CEA equilibrium gas; its own tolerances are 1e-5, 1e-3 and 1e-5). The engines are
described here from the design data of those examples; maps, which off-design points need, are not part of the project
(`pycycle_maps.py`).
"""

from __future__ import annotations

import importlib.util
import json
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import pycycle_maps
import shared_data
import yaml
from pycycle_hbtf import EFFECTIVE_HEATING_VALUE, LB, _write_map
from scipy.optimize import brentq

from enginediag_cli.config.files import outside_allowed
from enginediag_cli.engine.engine import Engine
from enginediag_cli.physics.engine_file import load_engine

FOLDER = "pycycle_examples"
HP, LBF, FT, RANKINE = 745.6998715822702, 4.4482216152605, 0.3048, 1.0 / 1.8
SEA_LEVEL = (101325.0, 288.15)
JP7_HEATING_VALUE = 45.306e6
"""J/kg of C2H4.0044: fuel enters at zero enthalpy on the scale of its elements, so that heats of formation of CO2
(393.51 kJ/mol) and H2O (241.83 kJ/mol) are released in full."""
JP7_RATIO = 2.0022
"""Atoms of hydrogen per carbon of that fuel."""


def maps() -> dict[str, Any] | None:
    """Component maps of pyCycle: exported beside the public data, or from an installed pyCycle; None without."""
    path = shared_data.DATA / FOLDER / "maps.json"
    if path.exists():
        return json.loads(path.read_text())
    return pycycle_maps.exported() if importlib.util.find_spec("pycycle") else None


@dataclass
class Described:
    """An engine file in the making; `tables` are the maps, or nothing for a design point alone."""

    name: str
    design: dict[str, float]
    scratch: Path
    tables: dict[str, Any] | None = None
    heating_value: float = EFFECTIVE_HEATING_VALUE
    hydrogen_carbon: float = 23 / 12
    components: list[dict[str, Any]] = field(default_factory=list)
    shafts: list[dict[str, Any]] = field(default_factory=list)

    def add(self, type_: str, name: str, start: str = "", end: str = "", **keys: Any) -> None:
        ends = {k: v for k, v in (("from", start), ("to", end)) if v}
        self.components.append({"type": type_, "name": name, **ends, **keys})

    def air(self, corrected_flow_lb_s: float, recovery: float = 1.0) -> None:
        self.add("ambient", "ambient", end="1")
        self.add("inlet", "inlet", "1", "2", corrected_flow_kg_s=corrected_flow_lb_s * LB, pressure_recovery=recovery)

    def compressor(self, name: str, ends: tuple[str, str], shaft: str, ratio: float, eta: float, **keys: Any) -> None:
        source = keys.pop("source")
        keys |= self._table(source, name, turbine=False)
        self.add("compressor", name, *ends, shaft=shaft, pressure_ratio=ratio, isentropic_efficiency=eta, **keys)

    def turbine(self, name: str, ends: tuple[str, str], shaft: str, eta: float, **keys: Any) -> None:
        source = keys.pop("source")
        self.add(
            "turbine",
            name,
            *ends,
            shaft=shaft,
            isentropic_efficiency=eta,
            **keys,
            **self._table(source, name, turbine=True),
        )

    def burner(self, ends: tuple[str, str], T4_degR: float, loss: float) -> None:
        self.add(
            "burner",
            "burner",
            *ends,
            exit_temperature_K=T4_degR * RANKINE,
            combustion_efficiency=1.0,
            pressure_loss=loss,
            lower_heating_value_J_kg=self.heating_value,
        )

    def shaft(self, name: str, label: str, rpm: float, **keys: Any) -> None:
        self.shafts.append({"name": name, "speed_label": label, "design_speed_rpm": rpm, **keys})

    def _table(self, source: str, name: str, turbine: bool) -> dict[str, Any]:
        if self.tables is None:
            return {}
        data = self.tables[source]
        _write_map(self.scratch / f"{name}.csv", data, turbine)
        at = data["defaults"]
        of = {"design_speed": at["NpMap"], "design_pressure_ratio": at["PRmap"]} if turbine else {}
        of = of or {"design_speed": at["NcMap"], "design_rline": at["RlineMap"]}
        return {"table": {"file": f"{name}.csv", "interpolation": "linear", **of}}

    def load(self, power_setting: str = "T4_K") -> Engine:
        path = self.scratch / f"{self.name}.yaml"
        made = {
            "kind": "engine",
            "description": f"pyCycle {self.name}",
            "name": self.name,
            "power_setting": power_setting,
            "fuel_hydrogen_carbon_ratio": self.hydrogen_carbon,
            "design": self.design,
            "components": self.components,
            "shafts": self.shafts,
            "sensors": {"T3_K": {"noise_sigma": 1.0}},
            "envelope": {"mach": {"low": 0, "high": 0.9}},
            "power_range": [1000, 1500],
        }
        path.write_text(yaml.safe_dump(made, sort_keys=False))
        with outside_allowed():
            return load_engine(path)


def corrected(flow_lb_s: float, T_K: float, P_Pa: float) -> float:
    return flow_lb_s * (T_K / SEA_LEVEL[1]) ** 0.5 / (P_Pa / SEA_LEVEL[0])


def turboshaft(scratch: Path, tables: dict[str, Any] | None = None, power_setting: str = "T4_K") -> Engine:
    """Single-spool gas generator with a free power turbine: 4000 hp at sea level."""
    d = Described(
        "single_spool_turboshaft",
        {"altitude_m": 0, "mach": 1e-6, "dT_isa_K": 0},
        scratch,
        tables,
        JP7_HEATING_VALUE,
        JP7_RATIO,
    )
    d.air(27.265342457866705)
    d.compressor("comp", ("2", "3"), "hp", 13.5, 0.83, source="AXI5")
    d.burner(("3", "4"), 2370.0, 0.03)
    d.turbine("turb", ("4", "45"), "hp", 0.86, source="LPT2269")
    # what leaves the nozzle a pressure ratio of 1.2
    ratio = 13.5 * 0.97 / 3.876811443569159 / 1.2
    d.turbine("pt", ("45", "5"), "lp", 0.9, pressure_ratio=ratio, source="LPT2269")
    d.add("nozzle", "nozzle", "5", velocity_coefficient=0.99)
    d.add("load", "load", shaft="lp")
    d.shaft("hp", "N1", 8070.0)
    d.shaft("lp", "N2", 5000.0, speed="input")
    return d.load(power_setting)


def multi_spool(scratch: Path, tables: dict[str, Any] | None = None, power_setting: str = "T4_K") -> Engine:
    """Two-spool gas generator with a free power turbine, cooled, at 28,000 ft and Mach 0.5: 1800 hp."""
    d = Described("multi_spool_turboshaft", {"altitude_m": 28000 * FT, "mach": 0.5, "dT_isa_K": 0}, scratch, tables)
    d.air(corrected(10.774, 440.0037 * RANKINE, 5.66633 * 6894.757293168))
    d.compressor("lpc", ("2", "24"), "ip", 5.0, 0.89, source="LPCMap")
    d.add("duct", "icduct", "24", "25", pressure_loss=0.002)
    d.compressor("hpc_axi", ("25", "26"), "hp", 3.0, 0.89, source="HPCMap")
    ports = [{"name": "cool1", "fraction": 0.024}, {"name": "cool2", "fraction": 0.0146}]
    d.add("bleed", "bld25", "26", "27", ports=ports)
    d.compressor("hpc_centri", ("27", "3"), "hp", 2.7, 0.88, source="HPCMap")
    ports = [{"name": "cool3", "fraction": 0.1705}, {"name": "cool4", "fraction": 0.1209}]
    d.add("bleed", "bld3", "3", "31", ports=ports)
    d.burner(("31", "4"), 2740.0, 0.05)
    d.turbine(
        "hpt", ("4", "43"), "hp", 0.89, cooling_before_rotor=["cool3"], cooling_after_rotor=["cool4"], source="HPTMap"
    )
    d.add("duct", "duct43", "43", "44", pressure_loss=0.0051)
    d.turbine(
        "lpt", ("44", "45"), "ip", 0.9, cooling_before_rotor=["cool1"], cooling_after_rotor=["cool2"], source="LPTMap"
    )
    d.turbine("pt", ("45", "5"), "lp", 0.85, pressure_ratio=4.921, source="LPTMap")
    d.add("nozzle", "nozzle", "5", velocity_coefficient=0.99)
    d.add("load", "load", shaft="lp")
    d.shaft("lp", "N3", 12750.0, speed="input")
    d.shaft("ip", "N1", 12000.0)
    d.shaft("hp", "N2", 14800.0)
    return d.load(power_setting)


MIXER_RATIO = 1.05
"""Core over bypass total pressure at the mixer of the mixed-flow example: the bypass ratio follows from it."""


def mixed_flow(scratch: Path) -> Engine:
    """The mixed-flow turbofan at 35,000 ft and Mach 0.8, its afterburner lit; its bypass ratio makes MIXER_RATIO."""

    def engine(bypass_ratio: float) -> Engine:
        return _mixed_flow(scratch, bypass_ratio)

    def surplus(bypass_ratio: float) -> float:
        e = engine(bypass_ratio).network.design_point
        return float(e.flows["5"].P[0] / e.flows["15"].P[0]) - MIXER_RATIO

    return engine(brentq(surplus, 2.36, 2.49, xtol=1e-6))


def _mixed_flow(scratch: Path, bypass_ratio: float) -> Engine:
    d = Described("mixed_flow_turbofan", {"altitude_m": 35000 * FT, "mach": 0.8, "dT_isa_K": 0}, scratch)
    recovery = 0.9990 * (1 - 0.0107)
    T, P = 218.808 * (1 + 0.2 * 0.8**2), 23842.3 * (1 + 0.2 * 0.8**2) ** 3.5 * recovery
    d.air(corrected(53.83467876114857, T, P), recovery)
    d.compressor("fan", ("2", "21"), "lp", 3.3, 0.8948, source="AXI5")
    d.add("splitter", "splitter", "21", core="22", bypass="13", bypass_ratio=bypass_ratio)
    d.components[-1].pop("to", None)
    d.add("duct", "core_duct", "22", "23", pressure_loss=0.0048)
    d.compressor("lpc", ("23", "24"), "lp", 1.935, 0.9243, source="LPCMap")
    d.add("duct", "lpc_duct", "24", "25", pressure_loss=0.0101)
    port = {"name": "cool1", "fraction": 0.050708, "work_fraction": 0.5, "pressure_fraction": 0.5}
    d.compressor("hpc", ("25", "3"), "hp", 4.9, 0.8707, ports=[port], source="HPCMap")
    d.add("bleed", "bld3", "3", "31", ports=[{"name": "cool3", "fraction": 0.067214}])
    d.burner(("31", "4"), 3200.0, 0.054)
    d.turbine("hpt", ("4", "44"), "hp", 0.8888, cooling_before_rotor=["cool3"], source="HPTMap")
    d.add("duct", "hpt_duct", "44", "45", pressure_loss=0.0051)
    d.turbine("lpt", ("45", "49"), "lp", 0.8996, cooling_before_rotor=["cool1"], source="LPTMap")
    d.add("duct", "lpt_duct", "49", "5", pressure_loss=0.0107)
    d.add("duct", "bypass_duct", "13", "15", pressure_loss=0.0107)
    d.add("mixer", "mixer", end="6", core="5", bypass="15", core_mach=0.4463)
    d.add("duct", "mixer_duct", "6", "61", pressure_loss=0.0107)
    d.add(
        "afterburner",
        "afterburner",
        "61",
        "7",
        exit_temperature_K=3400.0 * RANKINE,
        combustion_efficiency=1.0,
        pressure_loss=0.054,
        lower_heating_value_J_kg=EFFECTIVE_HEATING_VALUE,
    )
    d.add("condi_nozzle", "nozzle", "7", thrust_coefficient=0.9933)
    d.shaft("lp", "N1", 4666.1)
    # its balance at the design point leaves the off-take of 250 hp out of the powers that it compares
    d.shaft("hp", "N2", 14705.7)
    return d.load()


Compared = dict[str, tuple[float, float]]
"""Quantity → here, printed there, both in the units of the printed tables (lb/s, hp, lbf, °R)."""


def _answers(engine: Engine, inputs: dict[str, float], columns: dict[str, str]) -> dict[str, float]:
    design = {c: v for c, v in engine.declared["design"].items() if c in engine.inputs}
    p = engine.predict({**design, **inputs}, sensors=list(columns.values()))
    assert p.ok.all(), p.reason(0)
    return dict(zip(columns, p.y[0].tolist(), strict=True))


COLUMNS = {
    "air": "W2_kg_s",
    "OPR": "OPR",
    "fuel": "Wf_kg_s",
    "burner air": "W3_kg_s",
    "T3": "T3_K",
    "P4": "P4_Pa",
    "P45": "P45_Pa",
    "N1": "N1_rpm",
    "thrust": "gross_thrust_N",
    "power": "power_W",
}


def turboshaft_at_design(scratch: Path, tables: dict[str, Any] | None = None) -> Compared:
    y = _answers(turboshaft(scratch, tables), {"T4_K": 2370.0 * RANKINE, "N2_rpm": 5000.0}, COLUMNS)
    return {
        "air flow": (y["air"] / LB, 27.265342457866705),
        "fuel-air ratio": (y["fuel"] / y["burner air"], 0.01755077946196377),
        "T3": (y["T3"] / RANKINE, 1190.1777648503974),
        "pressure ratio of the turbine": (y["P4"] / y["P45"], 3.876811443569159),
        "gross thrust": (y["thrust"] / LBF, 800.8503668285215),
        "fuel over thrust": (y["fuel"] / LB * 3600.0 / (y["thrust"] / LBF), 2.151092078410839),
        "power": (y["power"] / HP, 4000.0),
    }


def turboshaft_off_design(scratch: Path, tables: dict[str, Any]) -> Compared:
    """3500 hp at Mach 0.1 at sea level."""
    given = {"mach": 0.1, "N2_rpm": 5000.0, "power_W": 3500.0 * HP}
    y = _answers(turboshaft(scratch, tables, "power_W"), given, COLUMNS)
    return {
        "air flow": (y["air"] / LB, 25.897231212494944),
        "OPR": (y["OPR"], 12.42972778706185),
        "fuel-air ratio": (y["fuel"] / y["burner air"], 0.016304387482120156),
        "N1": (y["N1"], 7853.753342243985),
        "T3": (y["T3"] / RANKINE, 1158.5197002795887),
        "gross thrust": (y["thrust"] / LBF, 696.618372248896),
    }


def multi_spool_at_design(scratch: Path, tables: dict[str, Any] | None = None) -> Compared:
    columns = COLUMNS | {"burner air": "W31_kg_s", "P43": "P43_Pa", "P44": "P44_Pa"}
    y = _answers(multi_spool(scratch, tables), {"T4_K": 2740.0 * RANKINE, "N3_rpm": 12750.0}, columns)
    return {
        "OPR": (y["OPR"], 40.419),
        "fuel-air ratio": (y["fuel"] / y["burner air"], 0.02135),
        "T3": (y["T3"] / RANKINE, 1377.8),
        "pressure ratio of the HPT": (y["P4"] / y["P43"], 4.2325),
        "pressure ratio of the LPT": (y["P44"] / y["P45"], 1.9782),
        "power": (y["power"] / HP, 1800.0),
        "fuel over power": (y["fuel"] / LB * 3600.0 / (y["power"] / HP), 0.31342),
    }


def multi_spool_off_design(scratch: Path, tables: dict[str, Any]) -> Compared:
    """1600 hp at the design altitude and Mach number."""
    columns = COLUMNS | {"burner air": "W31_kg_s", "N2": "N2_rpm"}
    given = {"power_W": 1600.0 * HP, "N3_rpm": 12750.0}
    y = _answers(multi_spool(scratch, tables, "power_W"), given, columns)
    return {
        "air flow": (y["air"] / LB, 10.235),
        "OPR": (y["OPR"], 37.711),
        "fuel-air ratio": (y["fuel"] / y["burner air"], 0.020230),
        "N1": (y["N1"], 11557.0),
        "N2": (y["N2"], 14620.0),
        "T3": (y["T3"] / RANKINE, 1346.0),
        "fuel over power": (y["fuel"] / LB * 3600.0 / 1600.0, 0.31738),
    }


def mixed_flow_at_design(scratch: Path) -> Compared:
    columns = {k: COLUMNS[k] for k in ("air", "fuel", "T3", "P4", "P45")}
    columns |= {"burner air": "W31_kg_s", "P44": "P44_Pa", "P49": "P49_Pa", "gas": "W61_kg_s"}
    columns |= {"afterburner fuel": "afterburner_fuel_kg_s", "thrust": "gross_thrust_N"}
    engine = mixed_flow(scratch)
    design = engine.network.design_point  # the afterburner is lit there alone
    y = {name: float(np.ravel(engine.network.read(design, c))[0]) for name, c in columns.items()}
    return {
        "air flow": (y["air"] / LB, 53.83467876114857),
        "fuel-air ratio": (y["fuel"] / y["burner air"], 0.0311108),
        "T3": (y["T3"] / RANKINE, 1287.084732),
        "pressure ratio of the HPT": (y["P4"] / y["P44"], 2.0430265465465354),
        "pressure ratio of the LPT": (y["P45"] / y["P49"], 4.098132533864145),
        "afterburner fuel over gas": (y["afterburner fuel"] / y["gas"], 0.038716210473225536),
        "gross thrust, lit": (y["thrust"] / LBF, 6802.813118292415),
    }


def nitric_oxide_heat(T_K: float, nitrogen: float, oxygen: float) -> float:
    """Heat that nitric oxide in equilibrium takes, J per mole of gas: x_NO = √(x_N2 x_O2) exp(−ΔG/RT), with 90.3 kJ/mol
    of formation and 12.66 J/(mol K) of entropy (½ N2 + ½ O2 = NO)."""
    heat, entropy = 90.3e3, 12.66
    return float(heat * (nitrogen * oxygen) ** 0.5 * np.exp(-(heat - entropy * T_K) / (8.314 * T_K)))
