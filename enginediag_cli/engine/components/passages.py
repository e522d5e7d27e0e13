"""Passages of the gas path: ambient air, inlet, ducts, bleeds, splitter, mixer and heat exchangers.

- Ambient: the air around the engine and its motion relative to it.
- Inlet: pressure recovery, and the engine's air flow as an unknown.
- Duct: total pressure loss, and bleed air that returns to the gas path.
- Bleed: air taken from a station, for a turbine's cooling, for another duct, or overboard.
- Splitter: one flow divided into core and bypass; the bypass ratio is an unknown.
- Mixer: core and bypass flow join at equal static pressure and leave through one duct.
- Intercooler: heat from compressed air to a coolant of known temperature.
- Recuperator: heat from the turbine's exhaust to the air before the burner.

The effectiveness of heat exchangers of given conductance is that of W. M. Kays and A. L. London, Compact Heat
Exchangers.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from enginediag_cli.config.fields import Field, Section
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
from enginediag_cli.engine.dual import Dual, Value, chain, exp, log, power, select, sqrt, value
from enginediag_cli.engine.evaluation import (
    P_ISA,
    T_ISA,
    Evaluation,
    Flow,
    expand_to_mach,
    mix,
    solve_impulse,
    standard_atmosphere,
    static_pressure,
)
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


BALANCED = 1e-12
"""1 − C_r below which both sides have the same heat capacity."""
NEARLY_BALANCED = 1e-3
"""NTU (1 − C_r) below which (1 − e^−x)/x is its series: right to 1e-14 there."""
EFFECTIVENESS_LAW = Field(
    "effectiveness_law",
    "choice",
    "constant, or that of an exchanger of given conductance, which falls with flow",
    "constant",
    choices=("constant", "ntu"),
)
CONDUCTANCE_EXPONENT = Field(
    "conductance_exponent",
    "number",
    "m of conductance ∝ W^m of the air, for law ntu: 0 laminar, 0.6 to 0.8 turbulent",
    0.0,
    minimum=0.0,
    maximum=1.0,
)


def check_conductance(values: Mapping[str, Any]) -> None:
    """Raises ValueError where no conductance gives the effectiveness."""
    if values["effectiveness_law"] == "ntu" and values["effectiveness"] == 1.0:
        raise ValueError(f"{values['name']}: an effectiveness of 1 needs endless conductance; law ntu takes less")


def counterflow(ntu: Value, capacity_ratio: Value) -> Value:
    """ε of a counterflow exchanger, (N,): with g = (1 − e^−x)/x, x = NTU (1 − C_r), it is NTU g/(1 + C_r NTU g), which
    has no hole at C_r = 1."""
    x = ntu * (1.0 - capacity_ratio)
    near = np.asarray(np.abs(value(x)) < NEARLY_BALANCED)
    apart = select(near, 1.0, x)
    series = 1.0 - x * (0.5 - x * (1.0 / 6.0 - x * (1.0 / 24.0)))
    g = select(near, series, (1.0 - exp(-1.0 * apart)) / apart)
    return ntu * g / (1.0 + capacity_ratio * (ntu * g))


def transfer_units(effectiveness: float, capacity_ratio: float) -> float:
    """NTU of a counterflow exchanger of this effectiveness: the inverse of `counterflow`."""
    if abs(1.0 - capacity_ratio) < BALANCED:
        return effectiveness / (1.0 - effectiveness)
    ratio = (1.0 - effectiveness * capacity_ratio) / (1.0 - effectiveness)
    return float(np.log(ratio)) / (1.0 - capacity_ratio)


class Intercooler(LossyPassage):
    """h_out = h_in − ε [h_in − h(T_coolant)], P_out = P_in (1 − loss).

    There is as much coolant as it takes; it is the ambient air, or an input column. The effectiveness is constant, or
    that of a given conductance (law `ntu`): ε = 1 − exp(−NTU), NTU ∝ W^(m − 1). Water that the air would lose when
    cooled below its dew point stays in it.
    """

    TYPE = "intercooler"
    SECTION = Section(
        "intercooler",
        "cooler between compressors",
        (
            NAME,
            FROM,
            TO,
            Field("effectiveness", "number", "ε at the design point", minimum=0.0, maximum=1.0),
            EFFECTIVENESS_LAW,
            CONDUCTANCE_EXPONENT,
            Field(
                "coolant",
                "choice",
                "what it is cooled towards: the ambient temperature, or the input column <name>_coolant_K",
                "ambient",
                choices=("ambient", "column"),
            ),
            Field("design_coolant_K", "number", "<name>_coolant_K at the design point", T_ISA, unit="K", minimum=200.0),
            Field("pressure_loss", "number", "ΔP/P at the design point", 0.02, minimum=0.0, maximum=0.5),
            LAW,
        ),
    )

    def __init__(self, values: Mapping[str, Any]):
        super().__init__(values)
        check_conductance(self.values)
        self.design_flow = 1.0

    @property
    def _column(self) -> str:
        return f"{self.name}_coolant_K"

    def inputs(self) -> dict[str, float | None]:
        return {self._column: None} if self.values["coolant"] == "column" else {}

    def design_inputs(self) -> dict[str, float]:
        return {self._column: self.values["design_coolant_K"]} if self.values["coolant"] == "column" else {}

    def parameters(self) -> tuple[Parameter, ...]:
        return (self.health("effectiveness", "effectiveness, factor", 0.02, wear=-1), self.loss_parameter())

    def evaluate(self, e: Evaluation) -> None:
        inlet = e.flows[self.values["from"]]
        coolant = e.outputs["T0_K"] if self.values["coolant"] == "ambient" else e[self._column]
        effectiveness = e[f"{self.name}.effectiveness"] * self._effectiveness(inlet)
        h = inlet.h - effectiveness * (inlet.h - inlet.gas.enthalpy(coolant, inlet.mixture))
        e.flows[self.values["to"]] = Flow(inlet.gas, inlet.mixture, inlet.W, self.exit_pressure(e, inlet), h=h)
        e.outputs[f"{self.name}_heat_W"] = inlet.W * (inlet.h - h)

    def _effectiveness(self, inlet: Flow) -> Value:
        if self.values["effectiveness_law"] == "constant":
            return self.values["effectiveness"]
        flow = inlet.W * (1.0 / self.design_flow)
        ntu = transfer_units(self.values["effectiveness"], 0.0)
        return counterflow(power(flow, self.values["conductance_exponent"] - 1.0) * ntu, 0.0)

    def size(self, e: Evaluation) -> None:
        self.design_flow = scalar(e.flows[self.values["from"]].W)
        self.size_loss(e.flows[self.values["from"]])
        self.evaluate(e)


AIR_CP = 1005.0  # J/(kg K), of which a heat balance is told in parts, so that it is of order one
SETTLED = 1e-12
"""Relative change of the temperature behind the cold side at which a design point has settled."""


class ColdGasError(ValueError):
    """The gas of a recuperator is colder than its air at design; `surplus_K`: by how much, negative."""

    def __init__(self, message: str, surplus_K: float):
        super().__init__(message)
        self.surplus_K = surplus_K


class Recuperator(LossyPassage):
    """Cold side: T_out is unknown, and W_c (h_out − h_in) = ε Q_max its balance, which the hot side closes.

    Q_max is what the smaller of the two heat capacities can take between the inlet temperatures, by enthalpies:
    min[W_c (h_c(T_hot) − h_c(T_cold)), W_h (h_h(T_hot) − h_h(T_cold))]. The effectiveness ε is constant, or that of a
    counterflow exchanger whose conductance is constant or ∝ W_c^m (law `ntu`; W. M. Kays, A. L. London, Compact Heat
    Exchangers): NTU = UA/C_min, ε = (1 − e^−x)/(1 − C_r e^−x), x = NTU (1 − C_r).
    """

    TYPE = "recuperator"
    SECTION = Section(
        "recuperator",
        "heat exchanger, cold side",
        (
            NAME,
            FROM,
            TO,
            Field("effectiveness", "number", "ε at the design point", minimum=0.0, maximum=1.0),
            EFFECTIVENESS_LAW,
            CONDUCTANCE_EXPONENT,
            Field("pressure_loss", "number", "ΔP/P of the cold side at design", 0.02, minimum=0.0, maximum=0.5),
            LAW,
        ),
    )

    def __init__(self, values: Mapping[str, Any]):
        super().__init__(values)
        self.design_exit_K: float | None = None  # assumed while the design point has not settled
        self._settled = False
        self.design_ntu, self.design_capacity, self.design_flow = 0.0, 1.0, 1.0
        check_conductance(self.values)

    def parameters(self) -> tuple[Parameter, ...]:
        return (
            self.health("effectiveness", "effectiveness, factor", 0.02, wear=-1),
            self.loss_parameter(),
        )

    def unknowns(self) -> tuple[Unknown, ...]:
        return (Unknown(f"{self.name}.temperature", lower=0.1, upper=5.0),)

    def evaluate(self, e: Evaluation) -> None:
        inlet = e.flows[self.values["from"]]
        T = e[f"{self.name}.temperature"] * self.design_exit_K  # type: ignore[operator]
        outlet = Flow(inlet.gas, inlet.mixture, inlet.W, self.exit_pressure(e, inlet), T=T)

        def cooled(e: Evaluation, hot: Flow) -> Flow:
            heat = inlet.W * (outlet.h - inlet.h)
            wanted, _ = self._heat(e, inlet, hot)
            e.balances[f"{self.name} heat"] = (heat - wanted) / (inlet.W * inlet.T * AIR_CP)
            e.outputs[f"{self.name}_heat_W"] = heat
            return Flow(hot.gas, hot.mixture, hot.W, hot.P, h=hot.h - heat / hot.W)

        e.exchanges[self.name] = cooled
        e.flows[self.values["to"]] = outlet

    def _heat(self, e: Evaluation, cold: Flow, hot: Flow) -> tuple[Value, tuple[Value, Value]]:
        """ε Q_max [W], and what each side could take or give, cold and hot."""
        into = cold.W * (cold.gas.enthalpy(hot.T, cold.mixture) - cold.h)
        out = hot.W * (hot.h - hot.gas.enthalpy(cold.T, hot.mixture))
        less = np.asarray(np.abs(value(into)) <= np.abs(value(out)))
        least = select(less, into, out)
        effectiveness: Value = self.values["effectiveness"]
        if self.values["effectiveness_law"] == "ntu" and self.design_ntu > 0.0:
            conductance = power(cold.W * (1.0 / self.design_flow), self.values["conductance_exponent"])
            capacity = least / (hot.T - cold.T) * (1.0 / self.design_capacity)
            effectiveness = counterflow(conductance / capacity * self.design_ntu, least / select(less, out, into))
        return e[f"{self.name}.effectiveness"] * effectiveness * least, (into, out)

    def size(self, e: Evaluation) -> None:
        """Assumes the temperature behind it: that of the inlet first, then what the hot side of the last pass gave."""
        inlet = e.flows[self.values["from"]]
        self.size_loss(inlet)
        if self.design_exit_K is None:
            self.design_exit_K = scalar(inlet.T)
        self.evaluate(e)
        outlet = e.flows[self.values["to"]]

        def sized(e: Evaluation, hot: Flow) -> Flow:
            self.design_ntu = 0.0
            wanted, (into, out) = self._heat(e, inlet, hot)
            low, high = sorted((scalar(into), scalar(out)))
            if not low > 0.0:
                raise ColdGasError(
                    f"{self.name}: the gas at {scalar(hot.T):.0f} K cannot heat the air at {scalar(inlet.T):.0f} K at "
                    "design",
                    scalar(hot.T - inlet.T),
                )
            if self.values["effectiveness_law"] == "ntu":
                self.design_flow = scalar(inlet.W)
                self.design_capacity = low / scalar(hot.T - inlet.T)
                self.design_ntu = transfer_units(self.values["effectiveness"], low / high)
            there = scalar(inlet.gas.temperature_from_enthalpy(inlet.h + wanted / inlet.W, inlet.mixture)[0])
            self._settled = abs(there / scalar(outlet.T) - 1.0) <= SETTLED
            self.design_exit_K = there
            heat = inlet.W * (outlet.h - inlet.h)
            e.outputs[f"{self.name}_heat_W"] = heat
            return Flow(hot.gas, hot.mixture, hot.W, hot.P, h=hot.h - heat / hot.W)

        e.exchanges[self.name] = sized

    def converged(self) -> bool:
        return self._settled


class RecuperatorHotSide(LossyPassage):
    """W_h (h_in − h_out) is what the cold side takes; P_out = P_in (1 − loss)."""

    TYPE = "recuperator_hot"
    SECTION = Section(
        "recuperator_hot",
        "heat exchanger, hot side",
        (
            NAME,
            FROM,
            TO,
            Field("recuperator", "text", "name of the recuperator whose hot side it is"),
            Field("pressure_loss", "number", "ΔP/P of the hot side at design", 0.03, minimum=0.0, maximum=0.5),
            LAW,
        ),
    )

    def parameters(self) -> tuple[Parameter, ...]:
        return (self.loss_parameter(),)

    def evaluate(self, e: Evaluation) -> None:
        inlet = e.flows[self.values["from"]]
        cooled = e.exchanges.pop(self.values["recuperator"])(e, inlet)
        e.flows[self.values["to"]] = cooled.replace(P=self.exit_pressure(e, inlet))

    def size(self, e: Evaluation) -> None:
        self.size_loss(e.flows[self.values["from"]])
        self.evaluate(e)
