"""Heat exchangers: their effectiveness, intercoolers and recuperators.

Effectiveness of heat exchangers of given conductance, by W. M. Kays and A. L. London, Compact Heat Exchangers.

Intercooler: heat from compressed air to a coolant of known temperature.

Recuperator: heat from the turbine's exhaust to the air before the burner; its cold side, and its hot side.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from enginediag_cli.config.fields import Field, Section
from enginediag_cli.engine.atmosphere import T_ISA
from enginediag_cli.engine.components.base import FROM, NAME, TO, Unknown, scalar
from enginediag_cli.engine.components.passages import LAW, LossyPassage
from enginediag_cli.engine.dual import Value, exp, power, select, value
from enginediag_cli.engine.evaluation import Evaluation, Flow
from enginediag_cli.parameters import Parameter

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
