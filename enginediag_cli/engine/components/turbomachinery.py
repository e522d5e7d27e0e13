"""Compressors with interstage bleed ports, and turbines with cooling flows before and after the rotor."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from enginediag_cli.config.fields import Field, Section
from enginediag_cli.engine import maps
from enginediag_cli.engine.components.base import (
    FROM,
    LEAST_BLEED,
    NAME,
    PART_ROAMS,
    TO,
    VALVE,
    Actuator,
    Component,
    Design,
    Unknown,
    Valves,
    scalar,
)
from enginediag_cli.engine.dual import Array, Value, exp, locally, log, sqrt, value
from enginediag_cli.engine.evaluation import P_ISA, T_ISA, Evaluation, Flow, mix
from enginediag_cli.engine.gas import DRY_AIR, Gas
from enginediag_cli.engine.maps import (
    RULES,
    SURGE_LINE,
    VANES,
    SurgeLine,
    TableMap,
    closed_efficiency,
    closed_flow,
    make_table,
    read_table,
)
from enginediag_cli.parameters import Parameter, spelled

PORT = Section(
    "port",
    "bleed port between the stages",
    (
        Field("name", "text", "name of the bleed, for the component that receives it"),
        Field("fraction", "number", "bleed flow over compressor inlet flow", minimum=0.0, maximum=0.5),
        Field(
            "work_fraction", "number", "share of the enthalpy rise done on the bleed air", 1.0, minimum=0.0, maximum=1.0
        ),
        Field("pressure_fraction", "number", "share of the pressure rise at the port", 1.0, minimum=0.0, maximum=1.0),
        VALVE,
    ),
)
TABLE = Section(
    "table",
    "map file with speed lines and R-lines",
    (
        Field("file", "text", "CSV with columns Nc_map, Rline, Wc_map, PR_map, eff_map; path from the engine file"),
        Field("interpolation", "choice", "between the grid values", "quadratic", choices=RULES),
        Field("design_speed", "number", "map speed of the design point", 1.0, minimum=0.0),
        Field("design_rline", "number", "R-line of the design point", 2.0),
        Field("speed_rpm", "number", "corrected speed per map speed; default from the design point", None, unit="rpm"),
        Field("flow_kg_s", "number", "corrected flow per map flow; default from the design point", None, unit="kg/s"),
        Field("pressure_ratio_scale", "number", "(PR − 1) per map (PR − 1); default from the design point", None),
        Field("efficiency_scale", "number", "efficiency per map efficiency; default from the design point", None),
    ),
)
SHAPE = Section("map", "coefficients of the parametric map", maps.COMPRESSOR_FIELDS)

VANE_DEFAULTS = {f.name: f.default for f in VANES.fields}
"""What vanes do to a map whose engine file does not say: the usual figures of the form."""


LINE_POINTS, LINE_REACH = 25, (0.86, 1.08)
"""Points of a speed line that is drawn, and flow of a parametric one in shares of that of the best efficiency."""


class Compressor(Valves):
    """Enthalpy rise Δh and pressure ratio from corrected speed and flow.

    With a parametric map (work and flow) the isentropic work gives the pressure: φ(T_s) − φ_in = R ln PR.
    With a table the R-line is unknown and the balance is map flow = actual flow. Health parameters scale
    isentropic efficiency and corrected flow; vanes closed by Δφ degrees make it W_c exp(−a Δφ) and η/(1 + b Δφ²).
    """

    TYPE = "compressor"
    SECTION = Section(
        "compressor",
        "fan, booster or compressor",
        (
            NAME,
            FROM,
            TO,
            Field("shaft", "text", "shaft that drives it"),
            Field("pressure_ratio", "number", "total pressure ratio at the design point", minimum=1.001, maximum=60.0),
            Field("isentropic_efficiency", "number", "at the design point", minimum=0.3, maximum=0.99),
            Field("map", "section", "parametric map (used when there is no table)", {}, section=SHAPE),
            Field("table", "section", "tabulated map", None, section=TABLE),
            Field("ports", "sections", "interstage bleed ports", (), section=PORT),
            Field("vanes", "section", "guide vanes; default none", None, section=VANES),
            Field(
                "surge_line",
                "section",
                "adds the output <compressor>_surge_margin = PR_surge/PR − 1 at constant corrected flow",
                None,
                section=SURGE_LINE,
            ),
        ),
    )

    def __init__(self, values: Mapping[str, Any]):
        super().__init__(values)
        self.table: TableMap | None = None
        if self.values["table"]:
            t = self.values["table"]
            path = Path(self.values.get("directory", ".")) / t["file"]
            x, y, q = read_table(
                path, "Nc_map", "Rline", ("Wc_map", "PR_map", "eff_map"), self.values.get("table_text")
            )
            self.table = make_table(x, y, q, t["interpolation"], t["interpolation"])
        self.speed_scale = self.flow_scale = self.ratio_scale = self.efficiency_scale = 1.0
        self.work_scale = self.design_loss = 1.0
        try:
            self.surge_line = SurgeLine(self.values["surge_line"]) if self.values["surge_line"] else None
        except ValueError as error:
            raise ValueError(f"{self.name}: {error}") from error
        vanes = self.values["vanes"]
        if vanes and not vanes["open_stop_deg"] <= 0.0 <= vanes["closed_stop_deg"]:
            raise ValueError(
                f"{self.name}: open_stop_deg must be at most 0 and closed_stop_deg at least 0, where the map holds"
            )

    def actuators(self) -> tuple[Actuator, ...]:
        vanes = self.values["vanes"]
        if not vanes:
            return super().actuators()
        return (
            *super().actuators(),
            Actuator(
                f"{self.name}.vane_closing_deg",
                "deg",
                0.0,
                vanes["open_stop_deg"],
                vanes["closed_stop_deg"],
                f"{spelled(self.name)} guide vanes, closing",
            ),
        )

    @property
    def map_shapes(self) -> tuple[str, ...]:
        """Quantities that say of which shape the map is; none of a table."""
        return () if self.table is not None else tuple(f"map.{f.name}" for f in maps.COMPRESSOR_FIELDS)

    def parameters(self) -> tuple[Parameter, ...]:
        # to first order vanes off their schedule are a change of flow capacity: one answer for both
        capacity = "flow capacity (or variable vanes off schedule)" if self.values["vanes"] else ""
        found = [
            self.health("efficiency", "isentropic efficiency", words="isentropic efficiency", wear=-1),
            self.health("flow_capacity", "corrected flow", words=capacity, wear=-1),
        ]
        if self.table is None:
            for f, shape in zip(maps.COMPRESSOR_FIELDS, self.map_shapes, strict=True):
                nominal = self.values["map"][f.name]
                sigma = max(0.25 * abs(nominal), 0.2)
                found.append(
                    self.design(
                        shape,
                        Design(nominal, sigma, float(f.minimum or 0.0), float(f.maximum or 0.0)),
                        "1",
                        f.help,
                    )
                )
        found += self._actuator_parameters()
        if self.values["vanes"]:
            found += self._vane_parameters(self.values["vanes"])
        for port in self.values["ports"]:
            found.append(
                self.design(
                    "fraction",
                    Design(
                        port["fraction"], 0.01, 0.0, 0.5, PART_ROAMS * max(port["fraction"], LEAST_BLEED), switches=True
                    ),
                    "1",
                    "bleed flow over compressor inlet flow",
                    of=port["name"],
                )
            )
        return tuple(found)

    def _actuator_parameters(self) -> list[Parameter]:
        """A bleed valve at the exit that stands open, overboard, and vanes off their schedule; both nominally not."""
        valve, vane, part = f"bleed.{self.name}", f"vane.{self.name}", spelled(self.name)
        open_by = f"flow that a bleed valve at the exit of the {part} takes overboard, over its flow"
        off_by = f"closing of the {part} vanes beyond their schedule"
        bleed, vanes = f"{part} exit bleed valve", f"{part} vanes"
        flow, angle = f"{part} exit bleed flow", f"{part} vane angle"
        return [
            Parameter(
                f"{valve}.fraction", "actuator", 0.0, -0.02, 0.3, 0.02, "1", open_by, valve, "fraction", flow, bleed, 1
            ),
            Parameter(
                f"{vane}.offset_deg", "actuator", 0.0, -30.0, 30.0, 2.0, "deg", off_by, vane, "offset_deg", angle, vanes
            ),
        ]

    def _vane_parameters(self, vanes: Mapping[str, Any]) -> list[Parameter]:
        a, b = vanes["flow_per_deg"], vanes["loss_per_deg2"]
        return [
            self.design("flow_per_deg", Design(a, 0.003, 0.0, 0.05), "1/deg", "fall of flow per degree", of="vanes"),
            self.design("loss_per_deg2", Design(b, 1e-4, 0.0, 5e-3), "1/deg2", "fall of efficiency", of="vanes"),
        ]

    def unknowns(self) -> tuple[Unknown, ...]:
        if self.table is None:
            return ()
        low, high = self.table.y[0], self.table.y[-1]
        margin = 0.5 * (high - low)
        return (
            Unknown(f"{self.name}.rline", self.values["table"]["design_rline"], max(low - margin, 1e-3), high + margin),
        )

    def evaluate(self, e: Evaluation) -> None:
        inlet = e.flows[self.values["from"]]
        theta, root = inlet.T * (1.0 / T_ISA), sqrt(inlet.T * (1.0 / T_ISA))
        corrected_speed = e.shaft(self.values["shaft"]).speed_rpm / root
        capacity = e[f"{self.name}.flow_capacity"]
        corrected_flow = inlet.W * root / (inlet.P * (1.0 / P_ISA))
        efficiency = e[f"{self.name}.efficiency"]
        if self.values["vanes"]:
            closing = e[f"{self.name}.vane_closing_deg"]
            capacity = closed_flow(capacity, e[f"{self.name}.vanes.flow_per_deg"], closing)
            efficiency = closed_efficiency(efficiency, e[f"{self.name}.vanes.loss_per_deg2"], closing)
        off = e[f"vane.{self.name}.offset_deg"]
        if not (isinstance(off, float) and off == 0.0):
            of = self.values["vanes"] or VANE_DEFAULTS
            capacity = closed_flow(capacity, of["flow_per_deg"], off)
            efficiency = closed_efficiency(efficiency, of["loss_per_deg2"], off)
        e.outputs[f"{self.name}_corrected_rpm"] = corrected_speed
        if self.table is None:
            n = corrected_speed * (1.0 / self.speed_scale)
            w = corrected_flow * (1.0 / self.flow_scale) / capacity
            shape = [e[f"{self.name}.map.{k}"] for k in maps.COMPRESSOR_COEFFICIENTS]
            work, loss = locally(self._work_and_loss, n, w, *shape)
            scale = theta * self.work_scale
            rise = work * scale
            ideal = efficiency * ((work - loss) * scale)
            phi_s = e.gas.temperature_from_enthalpy(inlet.h + ideal, inlet.mixture)[1]
            log_ratio = (phi_s - inlet.phi) / inlet.R
        else:
            n = corrected_speed * (1.0 / self.speed_scale)
            (wc, pr, eta), outside = self.table.lookup(n, e[f"{self.name}.rline"])
            e.mark_outside(self.name, outside)
            e.balances[f"{self.name} flow"] = corrected_flow / (wc * self.flow_scale * capacity) - 1.0
            log_ratio = log(1.0 + (pr - 1.0) * self.ratio_scale)
            ideal = inlet.expanded_enthalpy(-log_ratio) - inlet.h
            rise = ideal / (eta * self.efficiency_scale * efficiency)
        ratio = exp(log_ratio)
        self._deliver(e, inlet, rise, ratio)
        if self.surge_line is not None:
            e.outputs[f"{self.name}_surge_margin"] = self._surge_ratio(corrected_flow / capacity) / ratio - 1.0

    def _surge_ratio(self, flow: Value) -> Value:
        """Pressure ratio of surge at a corrected flow [kg/s] of the map: vanes and wear move the line with the map."""
        assert self.surge_line is not None
        if self.table is None:
            return self.surge_line.pressure_ratio(flow)
        return 1.0 + (self.surge_line.pressure_ratio(flow * (1.0 / self.flow_scale)) - 1.0) * self.ratio_scale

    def speed_line(self, gas: Gas, speed: float) -> tuple[Array, Array]:
        """Corrected flow, kg/s, and pressure ratio (n,) along one corrected speed, in shares of the design's, of the
        new component in dry air at 288.15 K; vanes where the map holds."""
        if self.table is not None:
            (flow, ratio, _), _ = self.table.lookup(np.full(LINE_POINTS, speed * self.design_map_speed), self._rlines)
            return value(flow) * self.flow_scale, 1.0 + (value(ratio) - 1.0) * self.ratio_scale
        shape = self.values["map"]
        x = np.linspace(*LINE_REACH, LINE_POINTS)
        w = x * speed ** shape["flow_speed_exponent"]
        work, loss = maps.work_and_loss(np.full(LINE_POINTS, speed), w, self.design_loss, shape)
        inlet = Flow(gas, DRY_AIR, w, np.full(LINE_POINTS, P_ISA), T=np.full(LINE_POINTS, T_ISA))
        ideal = inlet.h + (value(work) - value(loss)) * self.work_scale
        entropy = gas.temperature_from_enthalpy(ideal, DRY_AIR)[1]
        return w * self.flow_scale, np.exp(value((entropy - inlet.phi) / inlet.R))

    @property
    def design_map_speed(self) -> float:
        """Speed of the map at the design point, which a parametric map counts from."""
        return float(self.values["table"]["design_speed"]) if self.values["table"] else 1.0

    @property
    def _rlines(self) -> Array:
        assert self.table is not None
        return np.linspace(self.table.y[0], self.table.y[-1], LINE_POINTS)

    def surge_points(self) -> tuple[Array, Array] | None:
        """Corrected flow, kg/s, and pressure ratio of the points of the surge line; None without one."""
        if self.surge_line is None:
            return None
        flow = self.surge_line.flow * (1.0 if self.table is None else self.flow_scale)
        return flow, np.asarray(value(self._surge_ratio(flow)))

    def _work_and_loss(self, n: Value, w: Value, *shape: Value) -> tuple[Value, Value]:
        return maps.work_and_loss(n, w, self.design_loss, dict(zip(maps.COMPRESSOR_COEFFICIENTS, shape, strict=True)))

    def _deliver(self, e: Evaluation, inlet: Flow, rise: Value, ratio: Value) -> None:
        """Outlet flow, bleeds and shaft power W Δh − Σ W_b (1 − work fraction) Δh."""
        outlet = Flow(inlet.gas, inlet.mixture, inlet.W, inlet.P * ratio, h=inlet.h + rise)
        demand = inlet.W * rise
        for port in self.values["ports"]:
            taken = inlet.W * self.bled(e, port)
            part = port["work_fraction"]
            P = inlet.P + (outlet.P - inlet.P) * port["pressure_fraction"]
            e.bleeds[port["name"]] = Flow(inlet.gas, inlet.mixture, taken, P, h=inlet.h + rise * part)
            demand = demand - taken * (rise * (1.0 - part))
            outlet.W = outlet.W - taken
        lost = e[f"bleed.{self.name}.fraction"]
        if not (isinstance(lost, float) and lost == 0.0):
            outlet.W = outlet.W * (1.0 - lost)
        shaft = e.shaft(self.values["shaft"])
        shaft.demand_W = shaft.demand_W + demand
        e.flows[self.values["to"]] = outlet
        e.outputs[f"{self.name}_pressure_ratio"] = ratio
        e.outputs[f"{self.name}_power_W"] = demand

    def size(self, e: Evaluation) -> None:
        inlet = e.flows[self.values["from"]]
        theta = scalar(inlet.T) / T_ISA
        speed = scalar(e.shaft(self.values["shaft"]).speed_rpm) / theta**0.5
        flow = scalar(inlet.W) * theta**0.5 / (scalar(inlet.P) / P_ISA)
        ratio, efficiency = self.values["pressure_ratio"], self.values["isentropic_efficiency"]
        if self.table is None:
            ideal = scalar(inlet.expanded_enthalpy(-log(ratio)) - inlet.h)
            self.work_scale = ideal / efficiency / theta
            self.design_loss = 1.0 - efficiency
            self.speed_scale, self.flow_scale = speed, flow
        else:
            t = self.values["table"]
            (wc, pr, eta), _ = self.table.lookup(
                value(inlet.T) * 0 + t["design_speed"], value(inlet.T) * 0 + t["design_rline"]
            )
            self.speed_scale = t["speed_rpm"] or speed / t["design_speed"]
            self.flow_scale = t["flow_kg_s"] or flow / scalar(wc)
            self.ratio_scale = t["pressure_ratio_scale"] or (ratio - 1.0) / (scalar(pr) - 1.0)
            self.efficiency_scale = t["efficiency_scale"] or efficiency / scalar(eta)
        self.evaluate(e)


TURBINE_TABLE = Section(
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
TURBINE_SHAPE = Section("map", "coefficients of the parametric map", maps.TURBINE_FIELDS)


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
            Field("map", "section", "parametric map (used when there is no table)", {}, section=TURBINE_SHAPE),
            Field("table", "section", "tabulated map", None, section=TURBINE_TABLE),
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
        message = (
            f"{self.name}: nothing before it takes power from shaft '{shaft}', so that its pressure_ratio must be given"
        )
        if not log_ratio > 0.0:
            return message
        ideal = sum(
            scalar(f.W * (f.h - f.expanded_enthalpy(log_ratio)))
            for f in (inlet, *(e.bleeds[name] for name in self.values["cooling_before_rotor"]))
        )
        power = self.values["isentropic_efficiency"] * ideal
        return f"{message}; {np.exp(log_ratio):.3f} expands the gas to about ambient pressure and gives {_power(power)}"

    def _report_deficit(self, inlet: Flow, log_ratio: float, wanted: float, surplus: Callable[[float], float]) -> str:
        """The shaft's compressors need more than the gas has."""
        message = f"{self.name}: the gas cannot give the {_power(wanted)} that its shaft needs"
        if not log_ratio > 0.0:
            return message
        available = (1.0 + surplus(log_ratio)) * wanted
        hotter = scalar(inlet.T) * wanted / available
        return (
            f"{message}: down to ambient pressure it gives {_power(available)}; an exit_temperature_K with which it "
            f"enters at {hotter:.0f} K instead of {scalar(inlet.T):.0f} K, or compressors of "
            f"{available / wanted:.2f} times the work, would do"
        )


def _power(watt: float) -> str:
    return f"{watt / 1e6:.2f} MW" if abs(watt) >= 1e5 else f"{watt / 1e3:.2f} kW"
