"""Passages of the gas path: ambient air, inlet, ducts and their losses, bleeds, splitter and mixer.

Duct: total pressure loss, and bleed air that returns to the gas path.

Total pressure loss of a passage: what ducts and the sides of heat exchangers share.

Bleed: air taken from a station, for a turbine's cooling, for another duct, or overboard.

Splitter: one flow divided into core and bypass; the bypass ratio is unknown.

Mixer: core and bypass flow join at equal static pressure and leave through one duct.

Inlet: pressure recovery, and the engine's air flow as an unknown.

Ambient: the air around the engine and its motion relative to it.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from enginediag_cli.config.fields import Field, Section
from enginediag_cli.engine.atmosphere import P_ISA, T_ISA, standard_atmosphere
from enginediag_cli.engine.components.base import (
    FROM,
    LEAST_BLEED,
    NAME,
    PART_ROAMS,
    RECOVERY_ROAMS,
    TO,
    VALVE,
    Component,
    Design,
    Unknown,
    Valves,
    scalar,
)
from enginediag_cli.engine.dual import Dual, Value, chain, exp, log, sqrt, value
from enginediag_cli.engine.evaluation import Evaluation, Flow, expand_to_mach, mix, solve_impulse, static_pressure
from enginediag_cli.engine.gas import DRY_AIR, Mixture
from enginediag_cli.parameters import Parameter

LAW = Field("law", "choice", "how the loss varies", "constant", choices=("constant", "corrected_flow_squared"))


class LossyPassage(Component):
    """P_out = P_in (1 − loss), the loss `pressure_loss` constant or ∝ (W√T/P)², the dynamic pressure at low Mach
    number; `law` says which."""

    flow_parameter = 1.0

    def loss_parameter(self) -> Parameter:
        return self.design(
            "pressure_loss",
            Design(self.values["pressure_loss"], 0.005, 0.0, 0.5, part=True),
            "1",
            "ΔP/P at design",
        )

    def exit_pressure(self, e: Evaluation, inlet: Flow) -> Value:
        """Total pressure behind the passage, Pa."""
        loss = e[f"{self.name}.pressure_loss"]
        if self.values["law"] == "corrected_flow_squared":
            parameter = inlet.W * sqrt(inlet.T) / inlet.P * (1.0 / self.flow_parameter)
            loss = loss * (parameter * parameter)
        return inlet.P * (1.0 - loss)

    def size_loss(self, inlet: Flow) -> None:
        self.flow_parameter = scalar(inlet.W * sqrt(inlet.T) / inlet.P)


class Duct(LossyPassage):
    """P_out = P_in (1 − loss); the loss is constant or ∝ (W√T/P)², the dynamic pressure at low Mach number."""

    TYPE = "duct"
    SECTION = Section(
        "duct",
        "pressure loss between two stations",
        (
            NAME,
            FROM,
            TO,
            Field("pressure_loss", "number", "ΔP/P at the design point", minimum=0.0, maximum=0.5),
            LAW,
            Field("receives", "texts", "names of bleeds that mix in before the loss", ()),
        ),
    )

    def parameters(self) -> tuple[Parameter, ...]:
        return (self.loss_parameter(),)

    def evaluate(self, e: Evaluation) -> None:
        inlet = mix(e.flows[self.values["from"]], *(e.bleeds.pop(b) for b in self.values["receives"]))
        e.flows[self.values["to"]] = inlet.replace(P=self.exit_pressure(e, inlet))

    def size(self, e: Evaluation) -> None:
        self.size_loss(mix(e.flows[self.values["from"]], *(e.bleeds[b] for b in self.values["receives"])))
        self.evaluate(e)


PORT = Section(
    "port",
    "one bleed of this station",
    (
        Field("name", "text", "name of the bleed; a bleed that no component receives goes overboard"),
        Field("fraction", "number", "bleed flow over the station's flow", minimum=0.0, maximum=0.6),
        VALVE,
    ),
)


class Bleed(Valves):
    """W_out = W (1 − Σ fractions); each bleed leaves at the station's total state."""

    TYPE = "bleed"
    SECTION = Section(
        "bleed",
        "takes air from a station",
        (
            NAME,
            FROM,
            TO,
            Field("ports", "sections", "the bleeds", section=PORT),
        ),
    )

    def parameters(self) -> tuple[Parameter, ...]:
        return tuple(
            self.design(
                "fraction",
                Design(
                    port["fraction"], 0.01, 0.0, 0.6, PART_ROAMS * max(port["fraction"], LEAST_BLEED), switches=True
                ),
                "1",
                "bleed flow over station flow",
                of=port["name"],
            )
            for port in self.values["ports"]
        )

    def evaluate(self, e: Evaluation) -> None:
        inlet = e.flows[self.values["from"]]
        inlet.h  # noqa: B018  computed once here for every branch
        W = inlet.W
        for port in self.values["ports"]:
            taken = inlet.W * self.bled(e, port)
            e.bleeds[port["name"]] = inlet.replace(W=taken)
            W = W - taken
        e.flows[self.values["to"]] = inlet.replace(W=W)


class Splitter(Component):
    """W_core = W/(1 + BPR), W_bypass = W BPR/(1 + BPR)."""

    TYPE = "splitter"
    SECTION = Section(
        "splitter",
        "divides core and bypass flow",
        (
            NAME,
            FROM,
            Field("core", "text", "station of the core flow"),
            Field("bypass", "text", "station of the bypass flow"),
            Field("bypass_ratio", "number", "bypass over core flow at the design point", minimum=0.01, maximum=30.0),
        ),
    )

    def unknowns(self) -> tuple[Unknown, ...]:
        return (Unknown(f"{self.name}.bypass_ratio", lower=0.05, upper=20.0),)

    def evaluate(self, e: Evaluation) -> None:
        inlet = e.flows[self.values["from"]]
        inlet.phi  # noqa: B018  computed once here for both branches
        ratio = e[f"{self.name}.bypass_ratio"] * self.values["bypass_ratio"]
        core = inlet.W / (1.0 + ratio)
        e.flows[self.values["core"]] = inlet.replace(W=core)
        e.flows[self.values["bypass"]] = inlet.replace(W=inlet.W - core)
        e.outputs["BPR"] = ratio


class PressureMismatchError(ValueError):
    """The two flows of a mixer cannot join at design; `ratio` is the bypass's total pressure over the core's."""

    def __init__(self, message: str, mixer: str, ratio: float):
        super().__init__(message)
        self.mixer, self.ratio = mixer, ratio


class Mixer(Component):
    """Balance p_s,core = p_s,bypass; constant-area mixing with mass, energy and momentum conserved.

    Impulse I = Σ (W V + p A); behind the mixer W = ρ V A, T from h − V²/2 and I = W V + p A give V.
    The areas are set at the design point from the core Mach number unless given.
    """

    TYPE = "mixer"
    SECTION = Section(
        "mixer",
        "joins core and bypass flow",
        (
            NAME,
            TO,
            Field("core", "text", "station of the core flow"),
            Field("bypass", "text", "station of the bypass flow"),
            Field("core_mach", "number", "core Mach number at the design point", 0.4, minimum=0.05, maximum=0.9),
            Field("core_area_m2", "number", "default from the design point", None, unit="m2", minimum=1e-6),
            Field("bypass_area_m2", "number", "default from the design point", None, unit="m2", minimum=1e-6),
        ),
    )

    core_area = bypass_area = 1.0  # m²
    design_ratio = 1.0  # of the bypass's total pressure to the core's

    def evaluate(self, e: Evaluation) -> None:
        core, bypass = e.flows[self.values["core"]], e.flows[self.values["bypass"]]
        p_core, V_core = static_pressure(core, self.core_area)
        p_bypass, V_bypass = static_pressure(bypass, self.bypass_area)
        e.balances[f"{self.name} static pressure"] = p_bypass / p_core - 1.0
        impulse = core.W * V_core + p_core * self.core_area + bypass.W * V_bypass + p_bypass * self.bypass_area
        e.flows[self.values["to"]] = solve_impulse(mix(core, bypass), impulse, self.core_area + self.bypass_area)[0]

    def size(self, e: Evaluation) -> None:
        """Core area from the core Mach number; bypass area so that the static pressures agree."""
        core, bypass = e.flows[self.values["core"]], e.flows[self.values["bypass"]]
        p, area = expand_to_mach(core, self.values["core_mach"])
        self.design_ratio = scalar(bypass.P / core.P)
        pressures = f"{scalar(bypass.P):.0f} Pa against {scalar(core.P):.0f} Pa"
        self.core_area = self.values["core_area_m2"] or scalar(area)
        log_ratio = log(bypass.P / p)
        if not scalar(log_ratio) > 0.0:
            raise PressureMismatchError(
                f"{self.name}: the bypass total pressure is below the core's static pressure at design (total "
                f"pressures {pressures})",
                self.name,
                self.design_ratio,
            )
        if scalar(log_ratio) > scalar(bypass.gas.critical_log_pressure_ratio(bypass.T, bypass.mixture)):
            raise PressureMismatchError(
                f"{self.name}: the bypass flow would be supersonic at design (total pressures {pressures})",
                self.name,
                self.design_ratio,
            )
        T_s, h_s = bypass.gas.temperature_from_entropy(bypass.phi - bypass.R * log_ratio, bypass.mixture)
        V = sqrt(2.0 * (bypass.h - h_s))
        self.bypass_area = self.values["bypass_area_m2"] or scalar(bypass.W * bypass.R * T_s / (p * V))
        self.evaluate(e)


class Inlet(Component):
    """P_out = recovery · P_in − ΔP_inlet; W = x · W_corrected,design · δ/√θ with x unknown.

    The recovery is one number, or a table against Mach number read linearly or in steps. A measured
    inlet (filter) loss may be an input column, `dP_inlet_Pa`.
    """

    TYPE = "inlet"
    SECTION = Section(
        "inlet",
        "inlet of the engine",
        (
            NAME,
            FROM,
            TO,
            Field("corrected_flow_kg_s", "number", "corrected air flow at the design point", unit="kg/s", minimum=1e-6),
            Field("pressure_recovery", "number", "total pressure recovery", 1.0, minimum=0.5, maximum=1.0),
            Field("recovery_mach", "numbers", "Mach numbers of a recovery table", ()),
            Field("recovery_table", "numbers", "total pressure recovery at these Mach numbers, a factor", ()),
            Field("recovery_rule", "choice", "how the table is read", "linear", choices=("linear", "step")),
            Field("measured_loss", "boolean", "the input column dP_inlet_Pa gives the inlet pressure loss", False),
        ),
    )

    def __init__(self, values: Mapping[str, Any]):
        super().__init__(values)
        self.mach = np.asarray(self.values["recovery_mach"], dtype=float)
        self.recovery = np.asarray(self.values["recovery_table"], dtype=float)
        if self.mach.size == 1 or self.mach.size != self.recovery.size or (np.diff(self.mach) <= 0.0).any():
            raise ValueError(
                f"{self.name}: recovery_mach must rise, with one recovery_table value for each, at least two"
            )

    def inputs(self) -> dict[str, float | None]:
        return {"dP_inlet_Pa": None} if self.values["measured_loss"] else {}

    def parameters(self) -> tuple[Parameter, ...]:
        return (
            self.design(
                "pressure_recovery",
                Design(self.values["pressure_recovery"], 0.005, 0.8, 1.02, roams=RECOVERY_ROAMS),
                "1",
                "inlet total pressure recovery",
            ),
        )

    def unknowns(self) -> tuple[Unknown, ...]:
        return (Unknown(f"{self.name}.corrected_flow", lower=0.02, upper=3.0, is_flow=True),)

    def evaluate(self, e: Evaluation) -> None:
        upstream = e.flows[self.values["from"]]
        recovery = e[f"{self.name}.pressure_recovery"]
        if self.mach.size:
            recovery = recovery * self._table(e["mach"])
        P: Value = upstream.P * recovery
        if self.values["measured_loss"]:
            P = P - e["dP_inlet_Pa"]
        flow = upstream.replace(P=P)
        e.theta2, e.delta2 = flow.T * (1.0 / T_ISA), P * (1.0 / P_ISA)
        flow.W = e[f"{self.name}.corrected_flow"] * (self.values["corrected_flow_kg_s"] * e.delta2 / sqrt(e.theta2))
        e.flows[self.values["to"]] = flow
        e.outputs["ram_drag_N"] = flow.W * e.outputs["V0_m_s"]

    def _table(self, mach: Value) -> Value:
        M = np.asarray(value(mach))
        if self.values["recovery_rule"] == "step":
            return self.recovery[np.clip(np.searchsorted(self.mach, M + 1e-9, side="right") - 1, 0, None)]
        slope = np.diff(self.recovery) / np.diff(self.mach)
        cell = np.clip(np.searchsorted(self.mach, M, side="right") - 1, 0, len(slope) - 1)
        inside = (self.mach[0] <= M) & (self.mach[-1] >= M)
        return chain(np.interp(M, self.mach, self.recovery), (np.where(inside, slope[cell], 0.0), mach))


class Ambient(Component):
    """Static and total conditions from altitude, Mach number and ISA deviation, or from measured air.

    T0 = T_ISA(h) + ΔT_ISA, V0 = M √(γ R T0), total enthalpy h0 + V0²/2, total pressure by isentropic
    stagnation. Humidity is kg of water vapour per kg of dry air.
    """

    TYPE = "ambient"
    SECTION = Section(
        "ambient",
        "air around the engine",
        (
            NAME,
            TO,
            Field(
                "conditions",
                "choice",
                "flight: altitude_m, mach, dT_isa_K are inputs; ground: ambient_pressure_Pa and ambient_temperature_K",
                "flight",
                choices=("flight", "ground"),
            ),
        ),
    )

    def inputs(self) -> dict[str, float | None]:
        if self.values["conditions"] == "ground":
            return {"ambient_pressure_Pa": None, "ambient_temperature_K": None, "humidity_kg_kg": 0.0}
        return {"altitude_m": None, "mach": None, "dT_isa_K": None, "humidity_kg_kg": 0.0}

    def evaluate(self, e: Evaluation) -> None:
        mixture = DRY_AIR
        humidity = e["humidity_kg_kg"]
        if isinstance(humidity, Dual) or np.any(np.asarray(value(humidity)) != 0.0):
            mixture = Mixture(war=humidity)
        if self.values["conditions"] == "ground":
            T0: Value = e["ambient_temperature_K"]
            P0: Value = e["ambient_pressure_Pa"]
            V0: Value = 0.0
            total = Flow(e.gas, mixture, 0.0, P0, T=T0)
        else:
            T0, P0 = standard_atmosphere(e["altitude_m"])
            T0 = T0 + e["dT_isa_K"]
            static = Flow(e.gas, mixture, 0.0, P0, T=T0)
            cp, R = e.gas.heat_capacity(T0, mixture), static.R
            V0 = e["mach"] * sqrt(cp / (cp - R) * (R * T0))
            total = Flow(e.gas, mixture, 0.0, P0, h=static.h + 0.5 * (V0 * V0))
            total.P = P0 * exp((total.phi - static.phi) / R)
        e.outputs["P0_Pa"], e.outputs["T0_K"], e.outputs["V0_m_s"] = P0, T0, V0
        e.flows[self.values["to"]] = total
