"""One evaluation of the network: the leaves that it reads, and the flows, powers, balances and readings that it makes.

Everything that a model reads is a *leaf*: an input column, a parameter, or an unknown, or it is `derived` from such
leaves when it is first read, as the position of an actuator that a control sets. A leaf named in `wrt` becomes a
direction of differentiation when it is first read, so directions follow the gas path.

Components know nothing of effects. What a component reads (`e["hpc.efficiency"]`) passes through the leaf hooks
of that name, the flow that it delivers through the hooks of its station, and what a sensor reads through those
of its column. A network without effects has no hooks and is untouched to the last digit.

ISO 2533 / US 1976 standard atmosphere up to 20 km, with altitude as geopotential height.
"""

from __future__ import annotations

import operator
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any
from weakref import ref

import numpy as np

from enginediag_cli.engine.dual import Array, Dual, Value, chain, exp, log, power, select, sqrt, value
from enginediag_cli.engine.gas import DRY_AIR, Gas, Mixture
from enginediag_cli.parameters import FARTHEST_READING, Parameter
from enginediag_cli.units import split_column

if TYPE_CHECKING:
    from enginediag_cli.engine.recall import Memory


T_ISA, P_ISA = 288.15, 101325.0  # K, Pa: reference conditions of all corrected quantities too
LAPSE = 0.0065  # K/m
GRAVITY, R_AIR = 9.80665, 287.05287  # m/s², J/(kg K)
H_TROPOPAUSE = 11000.0  # m
T_TROPOPAUSE = T_ISA - LAPSE * H_TROPOPAUSE
P_TROPOPAUSE = P_ISA * (T_TROPOPAUSE / T_ISA) ** (GRAVITY / (R_AIR * LAPSE))
WATER_OVER_AIR = 0.62198  # molar masses
ICE_POINT = 273.15  # K


def standard_atmosphere(altitude_m: Value) -> tuple[Value, Value]:
    """Temperature and pressure of the standard atmosphere.

    Parameters
    ----------
    altitude_m
        Pressure altitude, m: a number, (N,), or with derivatives.

    Returns
    -------
    tuple
        Temperature, K, and pressure, Pa.

    References
    ----------
    ISO 2533 / US 1976 standard atmosphere up to 20 km, with altitude as geopotential height.
    Troposphere T = T0 − L h, p = p0 (T/T0)^(g/(R L)); above 11 km isothermal, p = p11 exp(−g (h − h11)/(R T11)).
    """
    below = np.asarray(value(altitude_m) < H_TROPOPAUSE)
    T_low = T_ISA - LAPSE * altitude_m
    P_low = P_ISA * power(select(below, T_low, T_TROPOPAUSE + 0.0 * T_low) / T_ISA, GRAVITY / (R_AIR * LAPSE))
    if below.all():
        return T_low, P_low
    P_high = P_TROPOPAUSE * exp((H_TROPOPAUSE - altitude_m) * (GRAVITY / (R_AIR * T_TROPOPAUSE)))
    return select(below, T_low, T_TROPOPAUSE + 0.0 * T_low), select(below, P_low, P_high)


def saturated_water(T_K: Value, p_Pa: Value) -> Value:
    """Water of saturated air [kg per kg of dry air]: 0.622 e/(p − e), e(T) over liquid water by Buck's formula,
    e = 611.21 Pa · exp[(18.678 − t/234.5) t/(257.14 + t)], t in °C (Buck 1981, J. Appl. Meteorol. 20, 1527, with
    the constants of 1996)."""
    t = T_K - ICE_POINT
    vapour = 611.21 * exp((18.678 - t * (1.0 / 234.5)) * t / (257.14 + t))
    return WATER_OVER_AIR * vapour / (p_Pa - vapour)


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
            self._T, self._phi = self.gas.temperature_from_enthalpy(self._h, self.mixture)  # type: ignore[arg-type]
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
                self._T, self._phi = self.gas.temperature_from_enthalpy(self._h, self.mixture)
        return self._phi

    @property
    def R(self) -> Value:
        return self.gas.constant(self.mixture)

    def replace(self, *, W: Value | None = None, P: Value | None = None) -> Flow:
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
        return self.gas.temperature_from_entropy(self.phi - self.R * log_pressure_ratio, self.mixture)[1]


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
        h = keep_old_values(idle, first.h, h)
    mixture = DRY_AIR
    if any(f.mixture.kind > 1 for f in flows):
        dry = [f.W / f.mixture.per_dry_air() for f in flows]
        total: Value = 0.0
        for d in dry:
            total = total + d
        far = _share([f.mixture.far for f in flows], dry, total)
        war = _share([f.mixture.war for f in flows], dry, total)
        if idle.any():
            far = _share_change(idle, first.mixture.far, far)
            war = _share_change(idle, first.mixture.war, war)
        mixture = Mixture(far, war)
    return Flow(first.gas, mixture, W, first.P, h=h)


def keep_old_values(rows: np.ndarray, old: Value, new: Value) -> Value:
    """`new` with the values of `old` in the rows (N,) where both are one but for rounding; derivatives of `new`."""
    return chain(np.where(rows, value(old), value(new)), (np.asarray(1.0), new))


def _share_change(rows: np.ndarray, old: Value | None, new: Value | None) -> Value | None:
    return None if new is None else keep_old_values(rows, 0.0 if old is None else old, new)


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


def expand_to_mach(flow: Flow, mach: float) -> tuple[Value, Value]:
    """Static pressure [Pa] of a total state at a Mach number, with γ of its total temperature, and the area [m²] that
    its flow then takes; arrays (N,)."""
    cp, R = flow.gas.heat_capacity(flow.T, flow.mixture), flow.R
    gamma = cp / (cp - R)
    T_s = flow.T / (1.0 + 0.5 * (gamma - 1.0) * mach * mach)
    h_s, phi_s = flow.gas.enthalpy_and_entropy(T_s, flow.mixture)
    p = flow.P * exp((phi_s - flow.phi) / R)
    V = sqrt(2.0 * (flow.h - h_s))
    return p, flow.W * R * T_s / (p * V)


def solve_impulse(flow: Flow, impulse: Value, area: float, iterations: int = 30) -> tuple[Flow, np.ndarray]:
    """The flow at the total pressure that impulse I = W V + p A [N] leaves it in an area [m²], and where it is
    subsonic (N,): elsewhere it is choked, and means nothing.

    V from W = ρ V A, T from h − V²/2 and I, by Newton's method on values; one step more in derivative arithmetic gives
    the exact derivatives.
    """
    gas, mixture = flow.gas, flow.mixture
    plain = mixture.plain

    def state(V: Value, W: Value, h: Value, R: Value, total: Value, m: Mixture) -> tuple[Value, Value, Value, Value]:
        T_s, phi_s = gas.temperature_from_enthalpy(h - 0.5 * (V * V), m)
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
    return flow.replace(P=P), subsonic


ValueHook = Callable[["Evaluation", Value], Value]
FlowHook = Callable[["Evaluation", "Flow"], "Flow"]


@dataclass(frozen=True)
class SolvedLeaf:
    """An unknown `name` that stands for what `read` gives at the end of a pass, above 0: x / read = 1; `start`: of the
    iteration."""

    name: str
    read: Callable[[Evaluation], Value]
    start: float


@dataclass
class Hooks:
    """Functions by the name of the leaf, the station or the sensor column that they change, in order; what is
    remembered and what is solved for."""

    leaves: dict[str, list[ValueHook]] = field(default_factory=dict)
    stations: dict[str, list[FlowHook]] = field(default_factory=dict)
    readings: dict[str, list[ValueHook]] = field(default_factory=dict)
    memories: list[Memory] = field(default_factory=list)
    solved: list[SolvedLeaf] = field(default_factory=list)

    def leaf(self, e: Evaluation, name: str, x: Value) -> Value:
        for hook in self.leaves.get(name, ()):
            x = hook(e, x)
        return x

    def reading(self, e: Evaluation, column: str, x: Value) -> Value:
        for hook in self.readings.get(column, ()):
            x = hook(e, x)
        return x


class Stations(dict[str, "Flow"]):
    """Flows by station; a flow passes through its station's hooks when it is delivered.

    The evaluation that owns it is held weakly: a ring of the two would keep all derivatives until the collector runs.
    """

    def __init__(self, e: Evaluation, hooks: Hooks):
        super().__init__()
        self._e, self._hooks = ref(e), hooks

    def __setitem__(self, station: str, flow: Flow) -> None:
        for hook in self._hooks.stations.get(station, ()):
            e = self._e()
            assert e is not None  # its owner is delivering the flow
            flow = hook(e, flow)
        super().__setitem__(station, flow)


Exchange = Callable[["Evaluation", Flow], Flow]
"""What a heat exchanger makes of the flow that enters its hot side."""


@dataclass
class Shaft:
    """What turns together: rotational speed and the powers put in and taken out so far [W]: by turbines, by
    compressors, and by what it drives outside the gas path."""

    speed_rpm: Value
    supply_W: Value = 0.0
    demand_W: Value = 0.0
    load_W: Value = 0.0


@dataclass
class Evaluation:
    """State of one pass through the network for N operating points."""

    gas: Gas
    size: int
    leaves: Mapping[str, Value]
    wrt: frozenset[str] = frozenset()
    directions: dict[str, int] = field(default_factory=dict)
    flows: dict[str, Flow] = field(default_factory=dict)
    bleeds: dict[str, Flow] = field(default_factory=dict)
    exchanges: dict[str, Exchange] = field(default_factory=dict)  # by the exchanger whose cold side has been passed
    shafts: dict[str, Shaft] = field(default_factory=dict)
    balances: dict[str, Value] = field(default_factory=dict)
    outputs: dict[str, Value] = field(default_factory=dict)
    outside: dict[str, Array] = field(default_factory=dict)
    theta2: Value = 1.0
    delta2: Value = 1.0
    make_shaft: Callable[[Evaluation, str], Shaft] | None = None
    hooks: Hooks | None = None
    derived: Mapping[str, Callable[[Evaluation], Value]] = field(default_factory=dict)
    signals: dict[str, Value] = field(default_factory=dict)  # of what is remembered, by the name of the memory
    _read: dict[str, Value] = field(default_factory=dict)

    def __post_init__(self) -> None:
        if self.hooks is not None and self.hooks.stations:
            self.flows = Stations(self, self.hooks)

    def __getitem__(self, name: str) -> Value:
        """A leaf's value, as the effects on it leave it; a direction of differentiation if it is requested."""
        if name in self._read:
            return self._read[name]
        x = self.derived[name](self) if name in self.derived else self.leaves[name]
        if name in self.wrt:
            k = self.directions[name] = len(self.directions)
            d = np.zeros((k + 1, self.size))
            d[k] = 1.0
            x = Dual(np.broadcast_to(np.asarray(x, dtype=float), (self.size,)), d)
        if self.hooks is not None:
            x = self.hooks.leaf(self, name, x)
        self._read[name] = x
        return x

    def shaft(self, name: str) -> Shaft:
        """A shaft, its speed read when it is first met in the gas path."""
        if name not in self.shafts:
            assert self.make_shaft is not None
            self.shafts[name] = self.make_shaft(self, name)
        return self.shafts[name]

    def has_leaf(self, name: str) -> bool:
        return name in self.leaves

    def add_output(self, name: str, x: Value) -> None:
        """Adds to an output that several components contribute to (thrust, power)."""
        self.outputs[name] = self.outputs[name] + x if name in self.outputs else x

    def mark_outside(self, component: str, mask: Array, what: str = "") -> None:
        """Points (N,) that lie outside `what`, by default the map of a component."""
        self.outside[what or f"the map of {component}"] = mask


SUTHERLAND_K = 110.4  # Sutherland's constant of air


def viscosity_ratio(T_K: Value) -> Value:
    """μ(T)/μ(288.15 K) by Sutherland's law, μ ∝ T^1.5/(T + 110.4 K) (U.S. Standard Atmosphere 1976, eq. 51)."""
    t = T_K * (1.0 / T_ISA)
    return power(t, 1.5) * ((T_ISA + SUTHERLAND_K) / (T_K + SUTHERLAND_K))


def reynolds_index(flow: Flow) -> Value:
    """RNI = (P/P_ISA)(μ_ISA/μ)√(T_ISA/T): Reynolds number at equal Mach numbers over that at ISA sea level."""
    return reynolds_index_from_state(flow.T, flow.P)


def corrected_flow(flow: Flow) -> Value:
    """W √θ/δ [kg/s]."""
    return flow.W * sqrt(flow.T * (1.0 / T_ISA)) / (flow.P * (1.0 / P_ISA))


def reynolds_index_from_state(T_K: Value, P_Pa: Value) -> Value:
    """RNI at total temperature [K] and pressure [Pa]."""
    return P_Pa * (1.0 / P_ISA) / (viscosity_ratio(T_K) * sqrt(T_K * (1.0 / T_ISA)))


READING_ROAMS = 0.02
"""How far (rms) a sensor's scale may plausibly vary along a driver, where physics of the reading is missing."""


@dataclass(frozen=True)
class Sensor:
    """One measured output; numbers in the column's unit."""

    column: str
    quantity: str
    unit: str
    noise_sigma: float
    maximum: float | None
    reads: Mapping[str, float]
    denominator: str | None
    bias_sigma: float
    scale_sigma: float
    soak: str | None
    soak_sigma: float

    @staticmethod
    def from_mapping(column: str, values: Mapping[str, Any]) -> Sensor:
        quantity, unit = split_column(column)
        bias = values["bias_sigma"]
        return Sensor(
            column,
            quantity,
            unit,
            values["noise_sigma"],
            values["maximum"],
            {k: float(v) for k, v in (values["reads"] or {column: 1.0}).items()},
            values["over"],
            3.0 * values["noise_sigma"] if bias is None else bias,
            values["scale_sigma"],
            values["soak"],
            values["soak_sigma"],
        )

    def parameters(self, largest: float = 0.0) -> tuple[Parameter, ...]:
        """Its errors; `largest`: largest reading that was seen, in its unit, 0 where that is not known."""
        size = largest or self.maximum or float("inf")
        q = f"sensor.{self.quantity}"
        part = f"{self.quantity} sensor"
        big = 1e3 * max(self.bias_sigma, self.noise_sigma, 1e-12)
        found = [
            Parameter(
                f"{q}.bias",
                "sensor",
                0.0,
                -big,
                big,
                self.bias_sigma,
                self.unit or "1",
                f"{self.quantity} sensor bias",
                q,
                "bias",
                f"{self.quantity} sensor bias",
                part,
                reach=FARTHEST_READING * size / self.bias_sigma if self.bias_sigma else float("inf"),
            ),
            Parameter(
                f"{q}.scale",
                "sensor",
                1.0,
                0.5,
                1.5,
                self.scale_sigma,
                "1",
                f"{self.quantity} sensor scale",
                q,
                "scale",
                f"{self.quantity} sensor scale factor",
                part,
                roams=READING_ROAMS,
                reach=FARTHEST_READING / self.scale_sigma if self.scale_sigma else float("inf"),
            ),
        ]
        if self.soak:
            found.append(
                Parameter(
                    f"{q}.soak",
                    "sensor",
                    0.0,
                    -1e3 * self.soak_sigma,
                    1e3 * self.soak_sigma,
                    self.soak_sigma,
                    f"{self.unit} per {self.soak}",
                    f"heat soak of the {self.quantity} reading",
                    q,
                    "soak",
                    f"{self.quantity} soak",
                    part,
                )
            )
        return tuple(found)

    def read(self, columns: Callable[[Evaluation, str], Value], e: Evaluation) -> Value:
        """The reading without noise (N,) where `columns` gives the model's."""
        total: Value = 0.0
        for column, weight in self.reads.items():
            x = columns(e, column)
            total = total + (x if weight == 1.0 else x * weight)
        if self.denominator:
            total = total / columns(e, self.denominator)
        if e.hooks is not None:
            total = e.hooks.reading(e, self.column, total)
        q = f"sensor.{self.quantity}"
        for name, nothing, apply in ((f"{q}.scale", 1.0, operator.mul), (f"{q}.bias", 0.0, operator.add)):
            p = e[name]
            if not (isinstance(p, float) and p == nothing):
                total = apply(total, p)
        if self.soak and self.soak in e.leaves:
            total = total + e[f"{q}.soak"] * e[self.soak]
        return total
