"""The gas that passes from one component to the next, at total (stagnation) conditions."""

from __future__ import annotations

import numpy as np

from enginediag_cli.engine.dual import Value, chain, exp, log, sqrt, value
from enginediag_cli.engine.gas import DRY_AIR, Gas, Mixture


class Flow:
    """Mass flow W [kg/s], total pressure P [Pa], composition and total temperature T [K] or enthalpy h [J/kg].

    Made from T or from h; the other, and φ, are computed when first asked for.
    """

    __slots__ = ("P", "W", "_T", "_h", "_phi", "gas", "mixture")

    def __init__(
        self,
        gas: Gas,
        mixture: Mixture,
        W: Value,
        P: Value,
        *,
        T: Value | None = None,
        h: Value | None = None,
        phi: Value | None = None,
    ):
        self.gas, self.mixture, self.W, self.P = gas, mixture, W, P
        self._T, self._h, self._phi = T, h, phi

    @property
    def T(self) -> Value:
        if self._T is None:
            self._T, self._phi = self.gas.at_enthalpy(self._h, self.mixture)  # type: ignore[arg-type]
        return self._T

    @property
    def known_temperature(self) -> Value | None:
        """T if it has been needed already."""
        return self._T

    @property
    def h(self) -> Value:
        if self._h is None:
            self._h, self._phi = self.gas.enthalpy_and_entropy(self.T, self.mixture)
        return self._h

    @property
    def phi(self) -> Value:
        if self._phi is None:
            if self._h is None:
                self._h, self._phi = self.gas.enthalpy_and_entropy(self.T, self.mixture)
            else:
                self._T, self._phi = self.gas.at_enthalpy(self._h, self.mixture)
        return self._phi

    @property
    def R(self) -> Value:
        return self.gas.constant(self.mixture)

    def with_(self, *, W: Value | None = None, P: Value | None = None) -> Flow:
        """The same gas with another mass flow or total pressure."""
        return Flow(
            self.gas,
            self.mixture,
            self.W if W is None else W,
            self.P if P is None else P,
            T=self._T,
            h=self._h,
            phi=self._phi,
        )

    def expanded_enthalpy(self, log_pressure_ratio: Value) -> Value:
        """Enthalpy after isentropic expansion through ln(P_in/P_out): φ_out = φ_in − R ln PR."""
        return self.gas.at_entropy(self.phi - self.R * log_pressure_ratio, self.mixture)[1]


def mix(first: Flow, *others: Flow) -> Flow:
    """Flows mixed at the pressure of the first: mass, fuel, water and enthalpy add. A row to which the others bring
    nothing (their valves are closed) keeps the first flow to the last digit."""
    others = tuple(f for f in others if not _is_zero(f.W))
    if not others:
        return first
    flows = (first, *others)
    W: Value = 0.0
    H: Value = 0.0
    for f in flows:
        W = W + f.W
        H = H + f.W * f.h
    h = H / W
    idle = np.asarray(sum(np.abs(value(f.W)) for f in others) == 0.0)
    if idle.any():
        h = kept(idle, first.h, h)
    mixture = DRY_AIR
    if any(f.mixture.kind > 1 for f in flows):
        dry = [f.W / f.mixture.per_dry_air() for f in flows]
        total: Value = 0.0
        for d in dry:
            total = total + d
        far = _share([f.mixture.far for f in flows], dry, total)
        war = _share([f.mixture.war for f in flows], dry, total)
        if idle.any():
            far = _kept_share(idle, first.mixture.far, far)
            war = _kept_share(idle, first.mixture.war, war)
        mixture = Mixture(far, war)
    return Flow(first.gas, mixture, W, first.P, h=h)


def kept(rows: np.ndarray, old: Value, new: Value) -> Value:
    """`new` with the values of `old` in the rows (N,) where both are one but for rounding; derivatives of `new`."""
    return chain(np.where(rows, value(old), value(new)), (np.asarray(1.0), new))


def _kept_share(rows: np.ndarray, old: Value | None, new: Value | None) -> Value | None:
    return None if new is None else kept(rows, 0.0 if old is None else old, new)


def _share(ratios: list[Value | None], dry: list[Value], total: Value) -> Value | None:
    """Fuel or water per dry air of the mixture; None when no flow has any."""
    amount: Value | None = None
    for ratio, d in zip(ratios, dry, strict=True):
        if ratio is not None:
            amount = ratio * d if amount is None else amount + ratio * d
    return None if amount is None else amount / total


def _is_zero(W: Value) -> bool:
    return isinstance(W, float) and W == 0.0


def static_pressure(flow: Flow, area_m2: Value, iterations: int = 30) -> tuple[Value, Value]:
    """Static pressure [Pa] and velocity [m/s] of a subsonic total state passing through an area [m²].

    Solves ρ V A = W with V² = 2 (h − h_s), p_s = P exp((φ_s − φ)/R) for T_s by Newton's method on values;
    one Newton step in derivative arithmetic then gives the exact derivatives. NaN where the area chokes. A point that
    is there is left as it is while others go on.
    """
    gas, mixture = flow.gas, flow.mixture

    def excess(T_s: Value) -> tuple[Value, Value, Value]:
        """ln(ρ V A / W), V and ln p_s."""
        h_s, phi_s = gas.enthalpy_and_entropy(T_s, mixture)
        V = sqrt(2.0 * (flow.h - h_s))
        log_p = log(flow.P) + (phi_s - flow.phi) / flow.R
        return log_p - log(flow.R * T_s) + log(V * area_m2 / flow.W), V, log_p

    T, R = value(flow.T), value(flow.R)
    cp = value(gas.heat_capacity(flow.T, mixture))
    mach = np.clip(value(flow.W) * np.sqrt(R * T) / (value(flow.P) * value(area_m2)), 1e-6, 0.6)
    T_s = T - 0.5 * mach**2 * R * T / cp
    plain = mixture.plain
    f = slope = np.full(np.shape(T_s), np.nan)
    going = np.ones(np.shape(T_s), dtype=bool)
    for _ in range(iterations):
        h_s, phi_s = gas.enthalpy_and_entropy(T_s, plain)
        V = np.sqrt(np.maximum(2.0 * (value(flow.h) - h_s), 1e-12))
        left = (
            np.log(value(flow.P))
            + (phi_s - value(flow.phi)) / R
            - np.log(R * T_s)
            + np.log(V * value(area_m2) / value(flow.W))
        )
        cp = gas.heat_capacity(T_s, plain)
        # negative while subsonic
        f, slope = np.where(going, left, f), np.where(going, cp / (R * T_s) - 1.0 / T_s - cp / V**2, slope)
        step = np.where(going, np.clip(-f / slope, -0.5 * (T - T_s), 0.5 * (T - T_s)), 0.0)
        T_s = T_s + step
        going &= ~(np.abs(step) < 1e-11 * T)
        if not going.any():
            break
    T_s = np.where((slope < 0.0) & (np.abs(f) < 1e-8), T_s, np.nan)
    f_exact, _, _ = excess(T_s)
    _, V_exact, log_p = excess(chain(T_s, (-1.0 / slope, f_exact)))
    return exp(log_p), V_exact


def at_mach(flow: Flow, mach: float) -> tuple[Value, Value]:
    """Static pressure [Pa] of a total state at a Mach number, with γ of its total temperature, and the area [m²] that
    its flow then takes; arrays (N,)."""
    cp, R = flow.gas.heat_capacity(flow.T, flow.mixture), flow.R
    gamma = cp / (cp - R)
    T_s = flow.T / (1.0 + 0.5 * (gamma - 1.0) * mach * mach)
    h_s, phi_s = flow.gas.enthalpy_and_entropy(T_s, flow.mixture)
    p = flow.P * exp((phi_s - flow.phi) / R)
    V = sqrt(2.0 * (flow.h - h_s))
    return p, flow.W * R * T_s / (p * V)


def at_impulse(flow: Flow, impulse: Value, area: float, iterations: int = 30) -> tuple[Flow, np.ndarray]:
    """The flow at the total pressure that impulse I = W V + p A [N] leaves it in an area [m²], and where it is
    subsonic (N,): elsewhere it is choked, and means nothing.

    V from W = ρ V A, T from h − V²/2 and I, by Newton's method on values; one step more in derivative arithmetic gives
    the exact derivatives.
    """
    gas, mixture = flow.gas, flow.mixture
    plain = mixture.plain

    def state(V: Value, W: Value, h: Value, R: Value, total: Value, m: Mixture) -> tuple[Value, Value, Value, Value]:
        T_s, phi_s = gas.at_enthalpy(h - 0.5 * (V * V), m)
        p = (total - W * V) * (1.0 / area)
        return p * V * area - W * R * T_s, T_s, p, phi_s  # zero: W = p V A / (R T)

    W, h, R, total = (value(x) for x in (flow.W, flow.h, flow.R, impulse))
    V = W * R * value(flow.T) / total
    slope, going = np.ones(np.shape(V)), np.ones(np.shape(V), dtype=bool)
    for _ in range(iterations):
        f, T_s, _, _ = state(V, W, h, R, total, plain)
        cp = gas.heat_capacity(T_s, plain)
        # (γ R T − V²) W/(γ V), positive while subsonic
        slope = np.where(going, total - 2.0 * W * V + W * R * V / cp, slope)
        V = np.where(going, V - f / slope, V)
        going &= ~(np.abs(value(f)) < 1e-12 * np.abs(total * V))  # a point that is there is left as it is
        if not going.any():
            break
    subsonic = np.asarray((slope > 0.0) & (np.abs(value(f)) < 1e-8 * np.abs(total * V)))
    f_exact, _, _, _ = state(V, flow.W, flow.h, flow.R, impulse, mixture)
    V_exact = chain(V - value(f_exact) / slope, (-1.0 / slope, f_exact))
    _, _, p, phi_s = state(V_exact, flow.W, flow.h, flow.R, impulse, mixture)
    P = p * exp((flow.phi - phi_s) / flow.R)
    return flow.with_(P=P), subsonic
