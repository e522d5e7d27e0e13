"""Mixer: core and bypass flow join at equal static pressure and leave through one duct."""

from __future__ import annotations

import numpy as np

from enginediag_cli.config.fields import Field, Section
from enginediag_cli.engine.components.base import NAME, TO, Component, scalar
from enginediag_cli.engine.dual import Value, chain, exp, log, sqrt, value
from enginediag_cli.engine.evaluation import Evaluation
from enginediag_cli.engine.flow import Flow, mix, static_pressure
from enginediag_cli.engine.gas import Mixture


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
        e.flows[self.values["to"]] = _mixed_out(mix(core, bypass), impulse, self.core_area + self.bypass_area)

    def size(self, e: Evaluation) -> None:
        """Core area from the core Mach number; bypass area so that the static pressures agree."""
        core, bypass = e.flows[self.values["core"]], e.flows[self.values["bypass"]]
        cp, R = core.gas.heat_capacity(core.T, core.mixture), core.R
        gamma, M = cp / (cp - R), self.values["core_mach"]
        T_s = core.T / (1.0 + 0.5 * (gamma - 1.0) * M * M)
        h_s, phi_s = core.gas.enthalpy_and_entropy(T_s, core.mixture)
        p = core.P * exp((phi_s - core.phi) / R)
        self.design_ratio = scalar(bypass.P / core.P)
        pressures = f"{scalar(bypass.P):.0f} Pa against {scalar(core.P):.0f} Pa"
        V = sqrt(2.0 * (core.h - h_s))
        self.core_area = self.values["core_area_m2"] or scalar(core.W * R * T_s / (p * V))
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
        T_s, h_s = bypass.gas.at_entropy(bypass.phi - bypass.R * log_ratio, bypass.mixture)
        V = sqrt(2.0 * (bypass.h - h_s))
        self.bypass_area = self.values["bypass_area_m2"] or scalar(bypass.W * bypass.R * T_s / (p * V))
        self.evaluate(e)


def _mixed_out(flow: Flow, impulse: Value, area: float) -> Flow:
    """The flow at the total pressure that the momentum balance leaves; V found by Newton's method on values."""
    gas, mixture = flow.gas, flow.mixture
    plain = Mixture(*(None if x is None else value(x) for x in (mixture.far, mixture.war)))

    def state(V: Value, W: Value, h: Value, R: Value, total: Value, m: Mixture) -> tuple[Value, Value, Value, Value]:
        T_s, phi_s = gas.at_enthalpy(h - 0.5 * (V * V), m)
        p = (total - W * V) * (1.0 / area)
        return p * V * area - W * R * T_s, T_s, p, phi_s  # zero: W = p V A / (R T)

    W, h, R, total = (value(x) for x in (flow.W, flow.h, flow.R, impulse))
    V = W * R * value(flow.T) / total
    slope, going = np.ones(np.shape(V)), np.ones(np.shape(V), dtype=bool)
    for _ in range(30):
        f, T_s, _, _ = state(V, W, h, R, total, plain)
        cp = gas.heat_capacity(T_s, plain)
        slope = np.where(going, total - 2.0 * W * V + W * R * V / cp, slope)
        V = np.where(going, V - f / slope, V)
        going &= ~(np.abs(value(f)) < 1e-12 * np.abs(total * V))  # a point that is there is left as it is
        if not going.any():
            break
    f_exact, _, _, _ = state(V, flow.W, flow.h, flow.R, impulse, mixture)
    V_exact = chain(V - value(f_exact) / slope, (-1.0 / slope, f_exact))
    _, _, p, phi_s = state(V_exact, flow.W, flow.h, flow.R, impulse, mixture)
    P = p * exp((flow.phi - phi_s) / flow.R)
    return flow.with_(P=P)
