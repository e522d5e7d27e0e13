"""Components that a shaft drives: loads, gearboxes and propellers.

A load is a machine outside the engine (generator, pump). A gearbox makes two shafts turn together at a fixed ratio
(geared fan, propeller gearbox). A propeller gives thrust and takes power by its advance ratio and pitch.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from enginediag_cli.config.fields import Field, Section
from enginediag_cli.engine.components.base import NAME, Actuator, Component, Design, scalar
from enginediag_cli.engine.dual import Value, chain, power, sqrt, value
from enginediag_cli.engine.evaluation import Evaluation, Shaft
from enginediag_cli.engine.maps import RULES, TableMap, make_table, read_table
from enginediag_cli.parameters import Parameter
from enginediag_cli.units import RAD_S_PER_RPM


def spare(e: Evaluation, shaft: str) -> Value:
    """Power that the turbines of a shaft met so far give beyond what is taken from it so far, W."""
    s = e.shaft(shaft)
    return s.supply_W * e[f"{shaft}.mechanical_efficiency"] - s.demand_W - e[f"{shaft}.power_offtake_W"] - s.load_W


def report_power(e: Evaluation, name: str, shaft: Shaft, taken_W: Value, delivered_W: Value) -> None:
    """Columns <name>_power_W, delivered, and <name>_torque_N_m on the shaft; power_W is the sum of all powers."""
    e.outputs[f"{name}_torque_N_m"] = taken_W / (shaft.speed_rpm * RAD_S_PER_RPM)
    e.outputs[f"{name}_power_W"] = delivered_W
    e.add_output("power_W", delivered_W)


SURPLUS = "surplus"
"""The law of a load that takes the surplus."""


class Load(Component):
    """Law `surplus`: takes what the shaft has to spare, at a speed that is given; the power is an output.

    Other laws take a power P of their own, from which the speed follows: `cube` P_design (N/N_design)³ (propeller or
    water brake); `torque` T(N) ω with T ∝ N^torque_exponent, or from a table of torque against speed (brake, pump);
    `given` what is demanded, a number or the input column <name>_power_demand_W. A shaft may have several loads; one
    that takes the surplus is the last. The output <name>_power_W is what is delivered, η P, <name>_torque_N_m is P/ω;
    power_W is the sum over all driven machines.
    """

    TYPE = "load"
    SECTION = Section(
        "load",
        "driven machine on a shaft",
        (
            NAME,
            Field("shaft", "text", "shaft that drives it"),
            Field("law", "choice", "what it takes", SURPLUS, choices=(SURPLUS, "cube", "torque", "given")),
            Field(
                "efficiency",
                "number",
                "delivered power over shaft power (generator, gearbox)",
                1.0,
                minimum=0.3,
                maximum=1.0,
            ),
            Field(
                "design_power_W",
                "number",
                "delivered at the design point (not of law surplus); default: what the shaft has to spare",
                None,
                unit="W",
                minimum=0.0,
            ),
            Field(
                "demand",
                "choice",
                "law given: constant, the design power always; input, the column <name>_power_demand_W",
                "constant",
                choices=("constant", "input"),
            ),
            Field("torque_exponent", "number", "law torque: of the speed", 0.0, minimum=-2.0, maximum=4.0),
            Field("speeds_rpm", "numbers", "law torque: rising speeds of a table, read linearly", ()),
            Field("torques_N_m", "numbers", "law torque: torque that it takes at these speeds, N m", ()),
        ),
    )
    design_power_W = 1.0  # taken from the shaft
    design_speed_rpm = 1.0

    def __init__(self, values: Mapping[str, Any]):
        super().__init__(values)
        self.speeds = np.asarray(self.values["speeds_rpm"], dtype=float)
        self.torques = np.asarray(self.values["torques_N_m"], dtype=float)
        if self.speeds.size == 1 or self.speeds.size != self.torques.size or (np.diff(self.speeds) <= 0.0).any():
            raise ValueError(f"{self.name}: speeds_rpm must rise, with one of torques_N_m for each, at least two")
        if self.values["law"] == SURPLUS and self.values["design_power_W"] is not None:
            raise ValueError(
                f"{self.name}: a load of law surplus takes what its shaft has to spare, and has no design_power_W"
            )

    @property
    def demand_column(self) -> str | None:
        """The input column that says what it takes."""
        asked = self.values["law"] == "given" and self.values["demand"] == "input"
        return f"{self.name}_power_demand_W" if asked else None

    @property
    def states_power(self) -> bool:
        """Whether it says itself what it takes at the design point."""
        return self.values["law"] != SURPLUS and (self.values["design_power_W"] is not None or self.speeds.size > 0)

    def inputs(self) -> dict[str, float | None]:
        return {self.demand_column: None} if self.demand_column else {}

    def design_inputs(self) -> dict[str, float]:
        stated = self.values["design_power_W"]
        return {self.demand_column: stated} if self.demand_column and stated is not None else {}

    def parameters(self) -> tuple[Parameter, ...]:
        return (
            self.design(
                "efficiency",
                Design(self.values["efficiency"], 0.01, 0.3, 1.05, part=True),
                "1",
                "delivered over shaft power",
                wear=-1,
            ),
        )

    def evaluate(self, e: Evaluation) -> None:
        if self.values["law"] == SURPLUS:
            self._take(e, spare(e, self.values["shaft"]))
        else:
            self._take(e, self._law_power(e))

    def _law_power(self, e: Evaluation) -> Value:
        """Power that the law takes from the shaft, W."""
        if self.values["law"] == "given":
            demanded = e[self.demand_column] / e[f"{self.name}.efficiency"] if self.demand_column else None
            return self.design_power_W if demanded is None else demanded
        N = e.shaft(self.values["shaft"]).speed_rpm
        if self.speeds.size:
            return self._tabulated(N) * N * RAD_S_PER_RPM
        n = N * (1.0 / self.design_speed_rpm)
        if self.values["law"] == "cube":
            return n * n * n * self.design_power_W
        return power(n, 1.0 + self.values["torque_exponent"]) * self.design_power_W

    def _tabulated(self, N: Value) -> Value:
        """Torque at a speed, N m; beyond the table on the straight line through its last two values."""
        at = np.asarray(value(N), dtype=float)
        slope = np.diff(self.torques) / np.diff(self.speeds)
        cell = np.clip(np.searchsorted(self.speeds, at, side="right") - 1, 0, len(slope) - 1)
        return chain(self.torques[cell] + slope[cell] * (at - self.speeds[cell]), (slope[cell], N))

    def _take(self, e: Evaluation, taken: Value) -> None:
        shaft = e.shaft(self.values["shaft"])
        if self.values["law"] != SURPLUS:
            shaft.load_W = shaft.load_W + taken
        report_power(e, self.name, shaft, taken, taken * e[f"{self.name}.efficiency"])

    def size(self, e: Evaluation) -> None:
        shaft = e.shaft(self.values["shaft"])
        self.design_speed_rpm = scalar(shaft.speed_rpm)
        stated = self.values["design_power_W"]
        if self.speeds.size:
            self.design_power_W = scalar(self._law_power(e))
        elif stated is not None:
            self.design_power_W = stated / self.values["efficiency"]
        else:
            self.design_power_W = scalar(spare(e, self.values["shaft"]))
        self._take(e, self.design_power_W)


class Gearbox(Component):
    """N_driven = N_driving / ratio; P_driving = P_driven / η.

    P_driven is all that the driven shaft takes: its compressors, loads, propellers, off-take and bearings. The ratio is
    that of the shafts' design speeds. A gearbox stands behind everything on the shaft that it drives and before
    the turbine of the one that drives it, whose pressure ratio then follows.
    """

    TYPE = "gearbox"
    SECTION = Section(
        "gearbox",
        "couples two shafts at a ratio",
        (
            NAME,
            Field("shaft", "text", "shaft that drives it"),
            Field("drives", "text", "shaft that it drives; that has no turbine, and no speed of its own"),
            Field(
                "ratio",
                "number",
                "driving over driven speed; default: that of the shafts' design speeds, with which it must agree",
                None,
                minimum=0.01,
                maximum=100.0,
            ),
            Field("efficiency", "number", "power out over power in", 0.99, minimum=0.5, maximum=1.0),
        ),
    )

    def parameters(self) -> tuple[Parameter, ...]:
        return (
            self.design(
                "efficiency",
                Design(self.values["efficiency"], 0.005, 0.5, 1.0),
                "1",
                "power out over power in",
                wear=-1,
            ),
        )

    def evaluate(self, e: Evaluation) -> None:
        name = self.values["drives"]
        driven, driving = e.shaft(name), e.shaft(self.values["shaft"])
        out = (driven.demand_W + driven.load_W + e[f"{name}.power_offtake_W"]) / e[f"{name}.mechanical_efficiency"]
        taken = out / e[f"{self.name}.efficiency"]
        driving.load_W = driving.load_W + taken
        e.outputs[f"{self.name}_torque_N_m"] = out / (driven.speed_rpm * RAD_S_PER_RPM)
        e.outputs[f"{self.name}_power_W"] = out


PITCH_DEG = (2.0, 80.0)
"""Blade angles between which the laws hold and a design pitch is sought: forward thrust, from fine to feathered."""
HALVINGS = 60
"""Of that range: to the last digit."""
STATION = 0.75
"""Share of the radius at which the angle of a propeller blade is measured, by custom."""
TABLE = Section(
    "table",
    "coefficients against pitch and advance ratio",
    (
        Field("file", "text", "CSV with columns pitch_deg, J, CT, CP; path from the engine file"),
        Field("interpolation", "choice", "between the grid values", "linear", choices=RULES),
    ),
)


class Propeller(Component):
    """T = C_T ρ n² D⁴, P = C_P ρ n³ D⁵ with J = V/(n D), n in turns per second.

    Blade element with ideal twist and actuator disc (Glauert; Gessow and Myers, Aerodynamics of the Helicopter), in
    terms of the advance ratio J' = (V + v)/(n D) through the disc, v induced:

        C_T = (π² σ a/16) (J_0 − J') = (π/2) J' (J' − J),      J_0 = ¾ π tan β
        C_P = C_T J' + (π⁴ σ c_d/32) (1 + 3 (J'/π)²),          c_d = c_d0 + k c_l²,  c_l = 24 C_T/(π³ σ)

    with pitch β at ¾ of the radius, solidity σ, lift slope a; drag after Bailey, NACA report 716. Stall and
    compressibility are not in it; a table of C_T, C_P against β, J replaces the law. At the design point the pitch is
    that which takes the design power.
    """

    TYPE = "propeller"
    SECTION = Section(
        "propeller",
        "propeller on a shaft",
        (
            NAME,
            Field("shaft", "text", "shaft that drives it"),
            Field("diameter_m", "number", "of the disc", unit="m", minimum=0.05),
            Field("solidity", "number", "blade area over disc area", 0.12, minimum=0.01, maximum=1.0),
            Field("lift_slope", "number", "of the blade sections, per radian", 5.73, minimum=3.0, maximum=7.0),
            Field("drag_coefficient", "number", "of the sections without lift", 0.0087, minimum=0.0, maximum=0.1),
            Field("drag_rise", "number", "of it, with the square of the lift coefficient", 0.0122, minimum=0.0),
            Field("table", "section", "measured coefficients instead of the law", None, section=TABLE),
            Field(
                "design_power_W",
                "number",
                "that it takes at the design point; default: what the shaft has to spare",
                None,
                unit="W",
                minimum=1.0,
            ),
        ),
    )
    design_pitch_deg = 25.0

    def __init__(self, values: Mapping[str, Any]):
        super().__init__(values)
        self.table: TableMap | None = None
        if self.values["table"]:
            t = self.values["table"]
            path = Path(self.values.get("directory", ".")) / t["file"]
            x, y, q = read_table(path, "pitch_deg", "J", ("CT", "CP"), self.values.get("table_text"))
            self.table = make_table(x, y, q, t["interpolation"], t["interpolation"])

    @property
    def states_power(self) -> bool:
        """Whether it says itself what it takes at the design point."""
        return self.values["design_power_W"] is not None

    @property
    def _pitches(self) -> tuple[float, float]:
        return PITCH_DEG if self.table is None else (float(self.table.x[0]), float(self.table.x[-1]))

    def actuators(self) -> tuple[Actuator, ...]:
        words = f"{self.name} blade angle at {STATION:g} of the radius"
        return (Actuator(f"{self.name}.pitch_deg", "deg", self.design_pitch_deg, *self._pitches, words),)

    def parameters(self) -> tuple[Parameter, ...]:
        return (
            self.health("efficiency", "thrust at given power, factor", words="propeller efficiency", wear=-1),
            self.health("power_coefficient", "power taken at given pitch and advance ratio, factor"),
        )

    def evaluate(self, e: Evaluation) -> None:
        self._turn(e, e[f"{self.name}.pitch_deg"])

    def coefficients(self, pitch_deg: Value, J: Value) -> tuple[Value, Value, np.ndarray]:
        """C_T, C_P at a pitch and an advance ratio (N,), and which points lie outside the table."""
        if self.table is not None:
            (C_T, C_P), outside = self.table.lookup(pitch_deg, J)
            return C_T, C_P, outside
        sigma = self.values["solidity"]
        K = math.pi**2 * sigma * self.values["lift_slope"] / 16.0
        angle = np.radians(np.asarray(value(pitch_deg), dtype=float))
        scale = STATION * math.pi
        J_0 = chain(scale * np.tan(angle), (scale * math.pi / 180.0 / np.cos(angle) ** 2, pitch_deg))
        half = 0.5 * J - K / math.pi
        through = half + sqrt(half * half + J_0 * (2.0 * K / math.pi))
        C_T = K * (J_0 - through)
        lift = C_T * (24.0 / (math.pi**3 * sigma))
        drag = self.values["drag_coefficient"] + lift * lift * self.values["drag_rise"]
        flow = through * (1.0 / math.pi)
        profile = drag * (flow * flow * 3.0 + 1.0) * (math.pi**4 * sigma / 32.0)
        return C_T, C_T * through + profile, np.zeros(np.shape(angle), dtype=bool)

    def _turn(self, e: Evaluation, pitch_deg: Value) -> None:
        shaft = e.shaft(self.values["shaft"])
        n, D, density = shaft.speed_rpm * (1.0 / 60.0), self.values["diameter_m"], self._density(e)
        C_T, C_P, outside = self.coefficients(pitch_deg, e.outputs["V0_m_s"] / (n * D))
        if self.table is not None:
            e.mark_outside(self.name, outside)
        C_P = C_P * e[f"{self.name}.power_coefficient"]
        taken = C_P * density * (n * n * n) * D**5
        thrust = C_T * density * (n * n) * (D**4 * e[f"{self.name}.efficiency"])
        shaft.load_W = shaft.load_W + taken
        e.outputs[f"{self.name}_thrust_N"] = thrust
        e.add_output("Fn_N", thrust)
        report_power(e, self.name, shaft, taken, taken)

    def _density(self, e: Evaluation) -> Value:
        """Of the air around, kg/m³."""
        air = next(iter(e.flows.values()))
        return e.outputs["P0_Pa"] / (air.R * e.outputs["T0_K"])

    def size(self, e: Evaluation) -> None:
        """The pitch that takes the design power; C_P rises with it."""
        shaft = e.shaft(self.values["shaft"])
        n, D = scalar(shaft.speed_rpm) / 60.0, self.values["diameter_m"]
        J = e.outputs["V0_m_s"] / (n * D)
        stated = self.values["design_power_W"]
        wanted = scalar(spare(e, self.values["shaft"])) if stated is None else stated
        per = scalar(self._density(e)) * n**3 * D**5
        low, high = self._pitches
        least, most = (scalar(self.coefficients(np.full(1, b), J)[1]) * per for b in (low, high))
        if not 0.0 < wanted < most or wanted < least:
            nearest = least if wanted < least else most
            raise ValueError(
                f"{self.name}: at {60.0 * n:.0f} rpm it takes {least / 1e3:.1f} to {most / 1e3:.1f} kW between {low:g} "
                f"and {high:g} deg of pitch, and {wanted / 1e3:.1f} kW are wanted; power rises with about the fifth "
                f"power of diameter_m: {D * (wanted / nearest) ** 0.2:.2f} m is the nearest that would do"
            )
        for _ in range(HALVINGS):
            middle = 0.5 * (low + high)
            below = scalar(self.coefficients(np.full(1, middle), J)[1]) * per < wanted
            low, high = (middle, high) if below else (low, middle)
        self.design_pitch_deg = 0.5 * (low + high)
        self._turn(e, np.full(1, self.design_pitch_deg))
