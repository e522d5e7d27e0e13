"""Turbine with cooling flows before and after its rotor."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from enginediag_cli.config.fields import Field, Section
from enginediag_cli.engine import maps
from enginediag_cli.engine.atmosphere import P_ISA
from enginediag_cli.engine.components.base import FROM, NAME, TO, Component, Design, Unknown, scalar
from enginediag_cli.engine.dual import Value, log, sqrt, value
from enginediag_cli.engine.evaluation import Evaluation, Flow, mix
from enginediag_cli.engine.maps import RULES, TableMap, make_table, read_table
from enginediag_cli.parameters import Parameter

TABLE = Section(
    "table",
    "map file with speed lines and pressure ratios",
    (
        Field("file", "text", "CSV with columns Nc_map, PR_map, Wp_map, eff_map; path from the engine file"),
        Field("interpolation", "choice", "between the grid values", "linear", choices=RULES),
        Field("design_speed", "number", "map speed of the design point", 100.0, minimum=0.0),
        Field("design_pressure_ratio", "number", "map pressure ratio of the design point", 5.0, minimum=1.0),
        Field("speed_rpm_K", "number", "N/√T per map speed; default from the design point", None, unit="rpm/√K"),
        Field(
            "flow_parameter", "number", "W√T/P per map flow; default from the design point", None, unit="kg√K/(s Pa)"
        ),
        Field("pressure_ratio_scale", "number", "(PR − 1) per map (PR − 1); default from the design point", None),
        Field("efficiency_scale", "number", "efficiency per map efficiency; default from the design point", None),
    ),
)
LARGEST_LOG_RATIO = 3.5  # of a design point
NO_DEMAND = 1e-9
"""Share of the gas's enthalpy flow below which what a shaft needs is nothing."""
EXHAUST_SHARE = 0.97
"""Of the pressure ratio down to ambient, in a hint: what a nozzle or a stack behind the turbine must be left with."""
SHAPE = Section("map", "coefficients of the parametric map", maps.TURBINE_FIELDS)


class Turbine(Component):
    """Capacity and efficiency against pressure ratio and N/√T of the entering gas, before cooling air.

    Ideal work is the sum over separate streams: the main flow and every cooling flow before the rotor,
    each expanded alone through the turbine's pressure ratio; cooling after the rotor only mixes in:

        power = η Σ W_i Δh_s,i        W h_out = Σ W_i h_i − power
    """

    TYPE = "turbine"
    SECTION = Section(
        "turbine",
        "turbine",
        (
            NAME,
            FROM,
            TO,
            Field("shaft", "text", "shaft that it drives"),
            Field("isentropic_efficiency", "number", "at the design point", minimum=0.3, maximum=0.99),
            Field(
                "pressure_ratio",
                "number",
                "at the design point; default: what the shaft's power balance asks",
                None,
                minimum=1.001,
                maximum=60.0,
            ),
            Field("map", "section", "parametric map (used when there is no table)", {}, section=SHAPE),
            Field("table", "section", "tabulated map", None, section=TABLE),
            Field("cooling_before_rotor", "texts", "names of bleeds that mix in before the rotor and do work", ()),
            Field("cooling_after_rotor", "texts", "names of bleeds that mix in behind the rotor", ()),
            Field("rotor_inlet_station", "text", "label of the state after mixing the first cooling air", ""),
        ),
    )

    def __init__(self, values: Mapping[str, Any]):
        super().__init__(values)
        self.table: TableMap | None = None
        if self.values["table"]:
            t = self.values["table"]
            path = Path(self.values.get("directory", ".")) / t["file"]
            text = self.values.get("table_text")
            x, y, q = read_table(path, "Nc_map", "PR_map", ("Wp_map", "eff_map"), text)
            self.table = make_table(x, y, q, t["interpolation"], t["interpolation"])
        self.design_ratio = 2.0
        self.design_blade_speed = 1.0
        self.speed_scale = self.flow_scale = self.ratio_scale = self.efficiency_scale = 1.0

    @property
    def map_shapes(self) -> tuple[str, ...]:
        """Quantities that say of which shape the map is; none of a table."""
        return () if self.table is not None else tuple(f"map.{f.name}" for f in maps.TURBINE_FIELDS)

    def parameters(self) -> tuple[Parameter, ...]:
        found = [
            self.health("efficiency", "isentropic efficiency", words="isentropic efficiency", wear=-1),
            self.health("flow_capacity", "flow capacity W√T/P"),
        ]
        if self.table is None:
            for f, shape in zip(maps.TURBINE_FIELDS, self.map_shapes, strict=True):
                nominal = self.values["map"][f.name]
                found.append(
                    self.design(
                        shape,
                        Design(
                            nominal, max(0.25 * abs(nominal), 0.1), float(f.minimum or 0.0), float(f.maximum or 0.0)
                        ),
                        "1",
                        f.help,
                    )
                )
        return tuple(found)

    def unknowns(self) -> tuple[Unknown, ...]:
        return (Unknown(f"{self.name}.pressure_ratio", lower=0.005, upper=6.0),)

    def evaluate(self, e: Evaluation) -> None:
        inlet = e.flows[self.values["from"]]
        ratio = 1.0 + e[f"{self.name}.pressure_ratio"] * (self.design_ratio - 1.0)
        log_ratio = log(ratio)
        root = sqrt(inlet.T)
        N = e.shaft(self.values["shaft"]).speed_rpm
        speed = N / root * (1.0 / self.speed_scale)
        drop = inlet.h - inlet.expanded_enthalpy(log_ratio)
        capacity, efficiency = e[f"{self.name}.flow_capacity"], e[f"{self.name}.efficiency"]
        if self.table is None:
            shape = {k: e[f"{self.name}.map.{k}"] for k in maps.TURBINE_COEFFICIENTS}
            capacity = capacity * maps.relative_capacity(log_ratio, speed, np.log(self.design_ratio), shape)
            blade_speed = N / sqrt(drop) * (1.0 / self.design_blade_speed)
            efficiency = (
                efficiency * self.values["isentropic_efficiency"] * maps.relative_efficiency(blade_speed, shape)
            )
        else:
            map_ratio = 1.0 + (ratio - 1.0) * (1.0 / self.ratio_scale)
            (wp, eta), outside = self.table.lookup(speed, map_ratio)
            e.mark_outside(self.name, outside)
            capacity = capacity * wp
            efficiency = efficiency * (eta * self.efficiency_scale)
        e.balances[f"{self.name} flow"] = inlet.W * root / inlet.P / (capacity * self.flow_scale) - 1.0
        self._expand(e, inlet, drop, log_ratio, efficiency, inlet.P / ratio)

    def _expand(self, e: Evaluation, inlet: Flow, drop: Value, log_ratio: Value, efficiency: Value, P: Value) -> None:
        before = [e.bleeds.pop(name) for name in self.values["cooling_before_rotor"]]
        after = [e.bleeds.pop(name) for name in self.values["cooling_after_rotor"]]
        ideal = inlet.W * drop
        for flow in before:
            ideal = ideal + flow.W * (flow.h - flow.expanded_enthalpy(log_ratio))
        power = efficiency * ideal
        mixed = mix(inlet, *before)
        if self.values["rotor_inlet_station"]:
            e.flows[self.values["rotor_inlet_station"]] = mixed
        behind = Flow(mixed.gas, mixed.mixture, mixed.W, P, h=mixed.h - power / mixed.W)
        e.flows[self.values["to"]] = mix(behind, *after)
        shaft = e.shaft(self.values["shaft"])
        shaft.supply_W = shaft.supply_W + power
        e.outputs[f"{self.name}_power_W"] = power

    def size(self, e: Evaluation) -> None:
        inlet = e.flows[self.values["from"]]
        self.design_ratio = self.values["pressure_ratio"] or self._balancing_ratio(e, inlet)
        T = scalar(inlet.T)
        N = scalar(e.shaft(self.values["shaft"]).speed_rpm)
        parameter = scalar(inlet.W) * T**0.5 / scalar(inlet.P)
        drop = scalar(inlet.h - inlet.expanded_enthalpy(np.log(self.design_ratio)))
        self.design_blade_speed = N / drop**0.5
        if self.table is None:
            self.speed_scale, self.flow_scale = N / T**0.5, parameter
        else:
            t = self.values["table"]
            one = value(inlet.T) * 0.0
            (wp, eta), _ = self.table.lookup(one + t["design_speed"], one + t["design_pressure_ratio"])
            self.speed_scale = t["speed_rpm_K"] or N / T**0.5 / t["design_speed"]
            self.flow_scale = t["flow_parameter"] or parameter / scalar(wp)
            self.ratio_scale = t["pressure_ratio_scale"] or (self.design_ratio - 1.0) / (
                t["design_pressure_ratio"] - 1.0
            )
            self.efficiency_scale = t["efficiency_scale"] or self.values["isentropic_efficiency"] / scalar(eta)
        self.evaluate(e)

    def _balancing_ratio(self, e: Evaluation, inlet: Flow) -> float:
        """Design pressure ratio whose power meets the shaft's demand, by the secant method on ln PR."""
        shaft = e.shaft(self.values["shaft"])
        name = self.values["shaft"]
        wanted = scalar(
            (shaft.demand_W + e[f"{name}.power_offtake_W"] + shaft.load_W) / e[f"{name}.mechanical_efficiency"]
            - shaft.supply_W
        )
        streams = [inlet, *(e.bleeds[name] for name in self.values["cooling_before_rotor"])]

        def surplus(log_ratio: float) -> float:
            ideal = sum(scalar(f.W * (f.h - f.expanded_enthalpy(log_ratio))) for f in streams)
            return self.values["isentropic_efficiency"] * ideal / wanted - 1.0

        if not wanted > NO_DEMAND * scalar(inlet.W * inlet.h):
            raise ValueError(self._no_demand(e, inlet, scalar(self._to_ambient(e, inlet))))
        if surplus(LARGEST_LOG_RATIO) < 0.0:
            raise ValueError(self._report_deficit(inlet, scalar(self._to_ambient(e, inlet)), wanted, surplus))
        x0, x1 = 0.8, 1.2
        f0, f1 = surplus(x0), surplus(x1)
        while abs(f1) > 1e-13 and x1 != x0:
            x0, x1, f0 = x1, min(max(x1 - f1 * (x1 - x0) / (f1 - f0), 0.01), LARGEST_LOG_RATIO), f1
            f1 = surplus(x1)
            if abs(f1) >= abs(f0) and abs(f1) < 1e-11:
                break
        return float(np.exp(x1))

    def _to_ambient(self, e: Evaluation, inlet: Flow) -> Value:
        """ln PR of an expansion down to ambient pressure, less what the exhaust behind the turbine needs."""
        return log(inlet.P / e.outputs.get("P0_Pa", P_ISA) * EXHAUST_SHARE)

    def _no_demand(self, e: Evaluation, inlet: Flow, log_ratio: float) -> str:
        """Nothing before this turbine asks its shaft for power (a free turbine), so no balance gives its ratio."""
        shaft = self.values["shaft"]
        told = (
            f"{self.name}: nothing before it takes power from shaft '{shaft}', so that its pressure_ratio must be given"
        )
        if not log_ratio > 0.0:
            return told
        ideal = sum(
            scalar(f.W * (f.h - f.expanded_enthalpy(log_ratio)))
            for f in (inlet, *(e.bleeds[name] for name in self.values["cooling_before_rotor"]))
        )
        power = self.values["isentropic_efficiency"] * ideal
        return f"{told}; {np.exp(log_ratio):.3f} expands the gas to about ambient pressure and gives {_power(power)}"

    def _report_deficit(self, inlet: Flow, log_ratio: float, wanted: float, surplus: Callable[[float], float]) -> str:
        """The shaft's compressors need more than the gas has."""
        told = f"{self.name}: the gas cannot give the {_power(wanted)} that its shaft needs"
        if not log_ratio > 0.0:
            return told
        available = (1.0 + surplus(log_ratio)) * wanted
        hotter = scalar(inlet.T) * wanted / available
        return (
            f"{told}: down to ambient pressure it gives {_power(available)}; an exit_temperature_K with which it "
            f"enters at {hotter:.0f} K instead of {scalar(inlet.T):.0f} K, or compressors of "
            f"{available / wanted:.2f} times the work, would do"
        )


def _power(watt: float) -> str:
    return f"{watt / 1e6:.2f} MW" if abs(watt) >= 1e5 else f"{watt / 1e3:.2f} kW"
