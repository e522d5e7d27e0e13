"""Nozzles and exhausts, where gas leaves the engine.

A convergent nozzle has a swallowing capacity and gives thrust. A convergent–divergent nozzle can have a supersonic
exit, over- or under-expanded. An exhaust is the discharge of a turbine to ambient through a diffuser and a stack.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np

from enginediag_cli.config.fields import Field, Section
from enginediag_cli.engine.components.base import FROM, NAME, Actuator, Component, Design, scalar
from enginediag_cli.engine.dual import Value, chain, exp, log, maximum, select, sqrt, value
from enginediag_cli.engine.evaluation import Evaluation, Flow
from enginediag_cli.parameters import Parameter, spelled

SMALLEST_LOG_RATIO = 1e-4  # within it the flow passes linearly through zero
OPENING = Field(
    "opening_range",
    "range",
    "least and greatest throat area over that of the design point, of a nozzle whose area the actuator "
    "<nozzle>.opening varies; default a fixed area",
    None,
)


class NozzleExpansion(NamedTuple):
    """What a nozzle makes of a flow, arrays (N,): mass flux at the throat [kg/(s m²)], velocity at the exit [m/s], the
    force of the exit's pressure above ambient per throat area [Pa], and exit over throat area where they differ."""

    flux: Value
    V: Value
    excess_Pa: Value
    area_ratio: Value | None = None


class Nozzle(Component):
    """Throat flow ρ V A C_d at ambient pressure, or at the critical pressure once choked.

    Throat state from φ_th = φ − R ln(P/p_th), V² = 2 (h − h_th); critical where h − h_* = γ_* R T_*/2. Gross
    thrust W V C_v + A C_d (p_th − p_0). A nozzle whose area can be varied has its throat times the opening.
    """

    TYPE = "nozzle"
    SECTION = Section(
        "nozzle",
        "convergent nozzle to ambient",
        (
            NAME,
            FROM,
            Field(
                "area_m2", "number", "throat area; default: what the design point needs", None, unit="m2", minimum=1e-6
            ),
            Field("discharge_coefficient", "number", "C_d", 1.0, minimum=0.5, maximum=1.05),
            Field("velocity_coefficient", "number", "C_v", 1.0, minimum=0.5, maximum=1.05),
            OPENING,
        ),
    )
    reference_area_m2 = 1.0
    converges = True  # its throat is its exit

    def __init__(self, values: Mapping[str, Any]):
        super().__init__(values)
        stops = self.values["opening_range"]
        if stops and not 0.0 < stops[0] <= 1.0 <= stops[1]:
            raise ValueError(f"{self.name}: opening_range must hold 1, the area of the design point, and be above 0")

    def actuators(self) -> tuple[Actuator, ...]:
        stops = self.values["opening_range"]
        if not stops:
            return ()
        return (Actuator(f"{self.name}.opening", "1", 1.0, stops[0], stops[1], f"{spelled(self.name)} opening"),)

    def parameters(self) -> tuple[Parameter, ...]:
        return (
            self.health("area", "throat area, factor", 0.02),
            self.design(
                "velocity_coefficient", Design(self.values["velocity_coefficient"], 0.005, 0.5, 1.05), "1", "C_v"
            ),
        )

    def evaluate(self, e: Evaluation) -> None:
        flow = e.flows[self.values["from"]]
        p0 = e.outputs["P0_Pa"]
        log_ratio = log(flow.P / p0)
        found = self._expanded(flow, log_ratio, p0)
        area = self._throat_area(e)
        e.balances[f"{self.name} flow"] = 1.0 - found.flux * area / flow.W
        C_v = e[f"{self.name}.velocity_coefficient"]
        e.add_output("gross_thrust_N", self._thrust(flow.W * found.V * C_v + area * found.excess_Pa))
        e.outputs[f"{self.name}_pressure_ratio"] = exp(log_ratio)
        if found.area_ratio is not None:
            e.outputs[f"{self.name}_area_ratio"] = found.area_ratio

    def _expanded(self, flow: Flow, log_ratio: Value, p0: Value) -> NozzleExpansion:
        flux, V, p_throat = throat(flow, log_ratio, p0)
        return NozzleExpansion(flux, V, p_throat - p0)

    def _thrust(self, gross: Value) -> Value:
        return gross

    def _throat_area(self, e: Evaluation) -> Value:
        """A C_d [m²] as the factor on it and the opening leave it."""
        area = e[f"{self.name}.area"] * (self.reference_area_m2 * self.values["discharge_coefficient"])
        return area * e[f"{self.name}.opening"] if self.values["opening_range"] else area

    def size(self, e: Evaluation) -> None:
        flow = e.flows[self.values["from"]]
        log_ratio = log(flow.P / e.outputs["P0_Pa"])
        if not scalar(log_ratio) > 0.0:
            ambient = scalar(e.outputs["P0_Pa"])
            raise ValueError(
                f"{self.name}: total pressure {scalar(flow.P):.0f} Pa is below ambient at design ({ambient:.0f} Pa): "
                f"{ambient / scalar(flow.P):.3f} times as much is the least; compressors give more at a higher "
                "pressure_ratio, and turbines take less from gas of a higher exit_temperature_K"
            )
        flux = self._expanded(flow, log_ratio, e.outputs["P0_Pa"]).flux
        needed = scalar(flow.W / flux) / self.values["discharge_coefficient"]
        self.reference_area_m2 = self.values["area_m2"] or needed
        self.evaluate(e)


def throat(flow: Flow, log_ratio: Value, p0: Value) -> tuple[Value, Value, Value]:
    """Mass flux ρV [kg/(s m²)], velocity [m/s] and static pressure [Pa] at the throat; arrays (N,)."""
    critical = flow.gas.critical_log_pressure_ratio(flow.T, flow.mixture)
    choked = np.asarray(value(log_ratio) > value(critical))
    expansion = select(choked, critical, log_ratio)
    backward = np.asarray(value(log_ratio) < SMALLEST_LOG_RATIO)
    if backward.any():  # met on the way to a solution only: flow out of ambient, the mirror image of flow into it
        expansion = select(backward, maximum(-1.0 * log_ratio, SMALLEST_LOG_RATIO), expansion)
        expansion = select(np.asarray(value(expansion) > value(critical)), critical, expansion)
    T, h = flow.gas.temperature_from_entropy(flow.phi - flow.R * expansion, flow.mixture)
    V = sqrt(2.0 * (flow.h - h))
    p = select(choked, flow.P * exp(-critical), p0)
    flux = p * V / (flow.R * T)
    if backward.any():
        flux = select(backward, flux * (log_ratio / expansion), flux)
    return flux, V, p


SMALLEST_AREA_RATIO = 1.01
"""Of exit over throat: nearer to 1 it is a convergent nozzle, and the Mach number behind the throat has no derivative
by the area."""
LARGEST_AREA_RATIO = 20.0
"""Far more than any nozzle in air needs."""
ALWAYS_CHOKED = 50.0
"""A logarithm of pressure ratio at which any nozzle is."""
ITERATIONS = 30
"""Newton's method on the exit's pressure comes from one side and doubles its digits; a handful are needed."""

SETTLED = 1e-12
"""Last step of it: the next would be below rounding. A row that has settled stays, however long others take."""


class CondiNozzle(Nozzle):
    """Throat as of a convergent nozzle; the exit is ε = A_e/(A C_d) times as large.

    Exit state, from the flow and h − V²/2: supersonic, at the pressure p_e that ε leaves; or with a normal shock inside
    at ambient pressure, where that has the larger impulse W V + p A; or subsonic at ambient pressure with a throat that
    is not choked. Without ε the exit follows ideal expansion, p_e = p_0, up to `largest_area_ratio`. Gross thrust
    C_fg [W V C_v + ε A C_d (p_e − p_0)]: where the shock leaves the nozzle V jumps, and with it what C_v takes; C_fg
    takes evenly. The flow fills the nozzle: separation from the wall is not modelled, with which a far over-expanded
    nozzle has more thrust.
    """

    TYPE = "condi_nozzle"
    SECTION = Section(
        "condi_nozzle",
        "convergent–divergent nozzle",
        (
            NAME,
            FROM,
            Field(
                "area_m2", "number", "throat area; default: what the design point needs", None, unit="m2", minimum=1e-6
            ),
            Field(
                "area_ratio",
                "number",
                "exit over effective throat area, fixed; default: it follows ideal expansion",
                None,
                minimum=SMALLEST_AREA_RATIO,
                maximum=LARGEST_AREA_RATIO,
            ),
            Field(
                "largest_area_ratio",
                "number",
                "how far an exit that follows ideal expansion opens; default: as far as it takes",
                None,
                minimum=SMALLEST_AREA_RATIO,
                maximum=LARGEST_AREA_RATIO,
            ),
            Field("discharge_coefficient", "number", "C_d", 1.0, minimum=0.5, maximum=1.05),
            Field("velocity_coefficient", "number", "C_v, on the velocity at the exit", 1.0, minimum=0.5, maximum=1.05),
            Field("thrust_coefficient", "number", "C_fg, on the whole gross thrust", 1.0, minimum=0.5, maximum=1.05),
            OPENING,
        ),
    )
    converges = False

    def __init__(self, values: Mapping[str, Any]):
        super().__init__(values)
        if self.values["area_ratio"] and self.values["largest_area_ratio"]:
            raise ValueError(f"{self.name}: area_ratio is fixed, so that largest_area_ratio has no meaning; give one")

    def _expanded(self, flow: Flow, log_ratio: Value, p0: Value) -> NozzleExpansion:
        choking, _, _ = throat(flow, log_ratio * 0.0 + ALWAYS_CHOKED, p0)
        flux, V, p = throat(flow, log_ratio, p0)
        choked = np.asarray(value(p) > value(p0))
        if self.values["area_ratio"]:
            return _fixed(flow, p0, choking, select(choked, choking, flux), self.values["area_ratio"])
        return self._ideal(flow, log_ratio, p0, NozzleExpansion(flux, V, p))

    def _thrust(self, gross: Value) -> Value:
        return gross * self.values["thrust_coefficient"]

    def _ideal(self, flow: Flow, log_ratio: Value, p0: Value, at_throat: NozzleExpansion) -> NozzleExpansion:
        """The exit at ambient pressure; as far as it opens."""
        choked = np.asarray(value(at_throat.excess_Pa) > value(p0))
        T, h = flow.gas.temperature_from_entropy(flow.phi - flow.R * log_ratio, flow.mixture)
        drop = select(choked, flow.h - h, 0.5 * (at_throat.V * at_throat.V))
        V = select(choked, sqrt(2.0 * drop), at_throat.V)
        ratio = select(choked, at_throat.flux * flow.R * T / (p0 * V), 1.0)
        excess: Value = 0.0
        limit = self.values["largest_area_ratio"]
        beyond = np.asarray(value(ratio) > limit) if limit else np.zeros(1, dtype=bool)
        if beyond.any():
            V_e, p_e = _supersonic(flow, at_throat.flux * (1.0 / limit), limit)
            V, excess = select(beyond, V_e, V), select(beyond, (p_e - p0) * limit, 0.0)
            ratio = select(beyond, limit, ratio)
        return NozzleExpansion(at_throat.flux, V, excess, ratio)


def _fixed(flow: Flow, p0: Value, choking: Value, flux: Value, ratio: float) -> NozzleExpansion:
    """Exit over throat area `ratio`; `choking`: the flux of a choked throat, `flux`: that of a convergent nozzle."""
    venturi = np.asarray(value(flux) * ratio < value(choking))  # subsonic to the exit, at ambient pressure there
    flux = select(venturi, flux * ratio, choking)
    out = flux * (1.0 / ratio)
    T_2, V_2 = _expand_to_pressure(flow, out, p0)
    V_1, p_1 = _supersonic(flow, choking * (1.0 / ratio), ratio)
    cp, R = value(flow.gas.heat_capacity(value(T_2), flow.mixture.plain)), value(flow.R)
    subsonic = value(V_2) ** 2 < cp / (cp - R) * R * value(T_2)
    shock = subsonic & np.asarray(value(out * V_2 + p0) > value(out * V_1 + p_1))
    at_ambient = venturi | shock
    V, excess = select(at_ambient, V_2, V_1), select(at_ambient, 0.0 * p_1, (p_1 - p0) * ratio)
    return NozzleExpansion(flux, V, excess, ratio)


def _expand_to_pressure(flow: Flow, flux: Value, p: Value) -> tuple[Value, Value]:
    """Static temperature and velocity where a flow of total enthalpy h has this flux and static pressure, whatever its
    losses before: h_s + V²/2 = h with V = flux R T/p."""
    k = flux * flow.R / p
    gas, plain, kv, h = flow.gas, flow.mixture.plain, value(k), value(flow.h)
    T = value(flow.T)
    open_still = np.ones(np.shape(T), dtype=bool)
    for _ in range(ITERATIONS):
        slope = value(gas.heat_capacity(T, plain)) + kv * kv * T
        step = (value(gas.enthalpy(T, plain)) + 0.5 * (kv * T) ** 2 - h) / slope
        T = np.where(open_still, T - step, T)
        open_still = open_still & (np.abs(step) > SETTLED * T)
        if not open_still.any():
            break
    V = k * T
    T_exact = chain(T, (-1.0 / slope, gas.enthalpy(T, flow.mixture) + 0.5 * (V * V) - flow.h))
    return T_exact, k * T_exact


def _supersonic(flow: Flow, flux: Value, ratio: float) -> tuple[Value, Value]:
    """Velocity and static pressure of the isentropic supersonic flow of this flux; `ratio`: of the choked flux to it.

    ln(ρ V) is concave in x = ln(P/p) behind the throat, with slope R T/V² − 1/γ: Newton's method from a larger x.
    """
    gas, R, T_0 = flow.gas, value(flow.R), value(flow.T)
    plain, far = flow.mixture.plain, np.log(ratio)
    target, start = value(flux), value(gas.critical_log_pressure_ratio(T_0, plain))
    x = start + 1.05 * (1.25 * np.sqrt(far) + 1.35 * far)
    open_still = np.ones(np.shape(x), dtype=bool)
    for _ in range(ITERATIONS):
        T, h = gas.temperature_from_entropy(value(flow.phi) - R * x, plain)
        V = np.sqrt(2.0 * (value(flow.h) - h))
        slope = R * T / V**2 - 1.0 + R / value(gas.heat_capacity(T, plain))
        step = np.log(value(flow.P) * np.exp(-x) * V / (R * T * target)) / slope
        x = np.where(open_still, x - step, x)
        open_still = open_still & (np.abs(step) > SETTLED)
        if not open_still.any():
            break

    def state(x: Value) -> tuple[Value, Value, Value]:
        T, h = gas.temperature_from_entropy(flow.phi - flow.R * x, flow.mixture)
        return T, sqrt(2.0 * (flow.h - h)), flow.P * exp(-1.0 * x)

    T_e, V_e, p_e = state(x)
    _, V_e, p_e = state(chain(x, (-1.0 / slope, log(p_e * V_e / (flow.R * T_e * flux)))))
    return V_e, p_e


class Exhaust(Component):
    """P (1 − loss (W√T/P)²/(W√T/P)²_design) = p_0 + ΔP_exhaust.

    ΔP_exhaust is an input column when the machine measures its exhaust back pressure. The loss at the
    design point is what the turbine's design pressure ratio leaves above ambient; the kinetic energy of
    the discharge belongs to it.
    """

    TYPE = "exhaust"
    SECTION = Section(
        "exhaust",
        "discharge to ambient",
        (
            NAME,
            FROM,
            Field(
                "measured_back_pressure", "boolean", "the input column dP_exhaust_Pa adds to ambient pressure", False
            ),
            Field("design_back_pressure_Pa", "number", "dP_exhaust_Pa at the design point", 0.0, unit="Pa"),
        ),
    )
    flow_parameter = 1.0
    design_loss = 0.0

    def inputs(self) -> dict[str, float | None]:
        return {"dP_exhaust_Pa": None} if self.values["measured_back_pressure"] else {}

    def parameters(self) -> tuple[Parameter, ...]:
        return (
            self.design(
                "loss_factor",
                Design(1.0, 0.3, 0.0, 5.0, part=True),
                "1",
                "pressure loss, factor on the design point's",
            ),
        )

    def evaluate(self, e: Evaluation) -> None:
        flow = e.flows[self.values["from"]]
        ambient = e.outputs["P0_Pa"]
        if self.values["measured_back_pressure"]:
            ambient = ambient + e["dP_exhaust_Pa"]
        parameter = flow.W * sqrt(flow.T) / flow.P * (1.0 / self.flow_parameter)
        loss = e[f"{self.name}.loss_factor"] * (parameter * parameter * self.design_loss)
        e.balances[f"{self.name} pressure"] = flow.P * (1.0 - loss) / ambient - 1.0

    def size(self, e: Evaluation) -> None:
        flow = e.flows[self.values["from"]]
        self.flow_parameter = scalar(flow.W * sqrt(flow.T) / flow.P)
        ambient = value(e.outputs["P0_Pa"])
        if self.values["measured_back_pressure"]:
            ambient = ambient + self.values["design_back_pressure_Pa"]
        self.design_loss = 1.0 - scalar(ambient / flow.P)
        if self.design_loss < 0.0:
            raise ValueError(
                f"{self.name}: total pressure {scalar(flow.P):.0f} Pa is below the exhaust's back pressure "
                f"{scalar(ambient):.0f} Pa at design; the pressure_ratio of the turbine before it must be at most "
                f"{scalar(flow.P / ambient):.3f} times what it is"
            )
        self.evaluate(e)
