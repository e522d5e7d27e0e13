"""Enthalpy, entropy function, heat capacity and gas constant of air, combustion products and water vapour.

A working gas is dry air with fuel burnt in it (fuel–air ratio `far`) and water vapour (`war`), both per
kg of *dry air*. Its properties are mass averages of three pseudo-species: dry air, "fuel products" (the
CO2 and H2O that one kg of fuel makes, less the O2 it takes from the air: lean complete combustion, no
dissociation) and water. For h, φ = ∫cp/T dT and cp alike

    q(T, far, war) = [q_air(T) + far q_fuel(T) + war q_water(T)] / (1 + far + war).

The heat capacities are the NASA nine-coefficient polynomials (`nasa9`), refitted once per engine as one
polynomial in T over 200–2400 K (largest departure in h: 20 J/kg, 0.02 K, for air), so that h, φ, cp and dcp/dT of
all points come from one matrix product and are smooth. h and φ are zero at 298.15 K, where heating values
are stated; the entropy is s = φ − R ln P.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from enginediag_cli.engine.dual import Array, Dual, Value, chain, value
from enginediag_cli.engine.nasa9 import (
    DRY_AIR_MOLE_FRACTION,
    MOLAR_MASS,
    UNIVERSAL_GAS_CONSTANT,
    molar_heat_capacity,
)

T_REFERENCE = 298.15  # K, zero of h and φ
T_FIT = (200.0, 2400.0)  # K
T_NOZZLE = (180.0, 1700.0)  # K, total temperatures at which nozzles are met
FIT_DEGREES = (10, 9, 8, 8, 6)  # in x, of the terms (1, far, far², war, war·far)
T_LIMIT = (150.0, 2500.0)  # K, where an operating point is still called inside the gas data
DEGREE = 9
"""Of the polynomial for cp: over T_FIT it leaves 20 J/kg, 0.02 K, in h for air."""
START_LIMIT = ((130.0, 2700.0), (np.log(130.0), np.log(2700.0)))  # K, ln K
COLUMNS = 4
"""Matrix products are made of a multiple of so many columns: what they give for a point does not depend on the others
then, to the last digit."""
H, PHI, CP, DCP = range(4)
"""Rows of the fitted properties."""
MOLAR_MASS_C, MOLAR_MASS_H = 12.0107e-3, 1.00794e-3  # kg/mol


@dataclass(frozen=True)
class Mixture:
    """Composition of a working gas; None is exactly zero and costs nothing."""

    far: Value | None = None
    war: Value | None = None

    @property
    def kind(self) -> int:
        """How many pseudo-species it needs: 1 dry air, 2 with fuel, 3 with water."""
        return 3 if self.war is not None else 2 if self.far is not None else 1

    def per_dry_air(self) -> Value:
        """kg of gas per kg of dry air, 1 + far + war."""
        total: Value = 1.0
        for part in (self.far, self.war):
            if part is not None:
                total = total + part
        return total


DRY_AIR = Mixture()


class Gas:
    """Gas data for one fuel. Methods take temperatures [K], enthalpies [J/kg] or φ [J/(kg K)] of shape (N,)."""

    def __init__(self, hydrogen_carbon_ratio: float = 1.9185):
        species = _pseudo_species(hydrogen_carbon_ratio)
        self.R_species = np.array([UNIVERSAL_GAS_CONSTANT * sum(s.values()) for s in species])
        T = 0.5 * (T_FIT[0] + T_FIT[1]) - 0.5 * (T_FIT[1] - T_FIT[0]) * np.cos(np.linspace(0, np.pi, 800))
        cp = np.stack([sum(n * molar_heat_capacity(name, T) for name, n in s.items()) for s in species])
        self._rows = _quantity_rows(T, cp)
        self._blocks: dict[tuple[int, tuple[int, ...]], Array] = {
            (kind, quantities): np.ascontiguousarray(
                np.concatenate([self._rows[q, :kind] for q in quantities])[:, : DEGREE + 2 + (PHI in quantities)]
            )
            for kind in (1, 2, 3)
            for quantities in (
                (H,),
                (PHI,),
                (H, PHI),
                (H, CP),
                (CP, DCP),
                (H, PHI, CP),
                (H, CP, DCP),
                (H, PHI, CP, DCP),
                (PHI, H, CP, DCP),
            )
        }
        self._start_h = self._fitted(*T_LIMIT, lambda T, m: (self._mixed(T, m, (H,))[0][0] * 1e-6, T))
        self._start_phi = self._fitted(*T_LIMIT, lambda T, m: (self._mixed(T, m, (PHI,))[0][0] * 1e-3, np.log(T)))
        self._critical = self._fitted(*T_NOZZLE, lambda T, m: (T * 1e-3, self._critical_exactly(T, m)))
        self._critical_slope = np.zeros_like(self._critical)
        self._critical_slope[:, :-1] = self._critical[:, 1:] * np.arange(1, 11)

    def constant(self, mixture: Mixture) -> Value:
        """Gas constant R [J/(kg K)]."""
        Ra, Rf, Rw = self.R_species
        R: Value = Ra
        if mixture.far is None and mixture.war is None:
            return R
        if mixture.far is not None:
            R = R + mixture.far * Rf
        if mixture.war is not None:
            R = R + mixture.war * Rw
        return R / mixture.per_dry_air()

    def enthalpy(self, T: Value, mixture: Mixture) -> Value:
        """h(T) [J/kg]."""
        h, cp = self._mixed(value(T), mixture, (H, CP))
        return self._chain(h, cp[0], T, mixture)

    def enthalpy_and_entropy(self, T: Value, mixture: Mixture) -> tuple[Value, Value]:
        """h(T) [J/kg] and φ(T) = ∫cp/T dT [J/(kg K)]."""
        h, phi, cp = self._mixed(value(T), mixture, (H, PHI, CP))
        return self._chain(h, cp[0], T, mixture), self._chain(phi, cp[0] / value(T), T, mixture)

    def heat_capacity(self, T: Value, mixture: Mixture) -> Value:
        """cp(T) [J/(kg K)]."""
        cp, dcp = self._mixed(value(T), mixture, (CP, DCP))
        return self._chain(cp, dcp[0], T, mixture)

    def at_enthalpy(self, h: Value, mixture: Mixture) -> tuple[Value, Value]:
        """T [K] and φ where h(T) = h: polynomial start and one Halley step (1e-8 K; 4e-7 K in very humid air);
        dφ = dh/T."""
        target = value(h)
        T0 = self._start(self._start_h, target * 1e-6, mixture)
        q, phi, cp, dcp = self._mixed(T0, mixture, (H, PHI, CP, DCP))
        f = q[0] - target
        dT = f / (0.5 * f * dcp[0] / cp[0] - cp[0])
        T = T0 + dT
        phi += (cp + 0.5 * dT * (dcp - cp / T0)) * (dT / T0)
        q += (cp + 0.5 * dT * dcp) * dT
        cp = cp[0] + dcp[0] * dT
        return self._inverse(T, 1.0 / cp, h, q, mixture), self._transfer(phi, 1.0 / T, h, q, mixture)

    def at_entropy(self, phi: Value, mixture: Mixture) -> tuple[Value, Value]:
        """T [K] and h where φ(T) = phi, likewise; dh = T dφ."""
        target = value(phi)
        T0 = np.exp(self._start(self._start_phi, target * 1e-3, mixture))
        q, h, cp, dcp = self._mixed(T0, mixture, (PHI, H, CP, DCP))
        f = q[0] - target
        slope = cp[0] / T0
        dT = f / (0.5 * f * (dcp[0] - slope) / cp[0] - slope)
        T = T0 + dT
        q += (cp + 0.5 * dT * (dcp - cp / T0)) * (dT / T0)
        h += (cp + 0.5 * dT * dcp) * dT
        cp = cp[0] + dcp[0] * dT
        return self._inverse(T, T / cp, phi, q, mixture), self._transfer(h, T, phi, q, mixture)

    def critical_log_pressure_ratio(self, T: Value, mixture: Mixture) -> Value:
        """ln(P/p_*) of an isentropic expansion from total temperature T [K] to Mach 1.

        A polynomial in T and composition fitted to the exact solution of h(T) − h(T_*) = γ(T_*) R T_*/2
        with these gas data (to 2e-5, which moves the choked flow by 1e-10), so that nozzles need no iteration.
        """
        t = value(T) * 1e-3
        P = _powers(t, False)
        kind = mixture.kind
        rows = (self._critical[: (1, 3, 5)[kind - 1]] @ P)[:, : t.size]
        slopes = (self._critical_slope[: (1, 3, 5)[kind - 1]] @ P)[:, : t.size]
        far = value(mixture.far) if mixture.far is not None else 0.0
        war_value: Value = 0.0 if mixture.war is None else mixture.war
        war = value(war_value)
        q, dq = rows[0], slopes[0]
        terms: list[tuple[Array, Value]] = []
        if kind > 1:
            q = q + far * (rows[1] + far * rows[2])
            dq = dq + far * (slopes[1] + far * slopes[2])
            dfar = rows[1] + 2.0 * far * rows[2]
            if kind == 3:
                q = q + war * (rows[3] + far * rows[4])
                dq = dq + war * (slopes[3] + far * slopes[4])
                dfar = dfar + war * rows[4]
                terms.append((rows[3] + far * rows[4], war_value))
            if mixture.far is not None:
                terms.append((dfar, mixture.far))
        return chain(q, (dq * 1e-3, T), *terms)

    # A mixed quantity is (kind, N): row 0 the mixture's value, rows 1.. the pseudo-species' own (fuel, water).

    def _mixed(self, T: Array, mixture: Mixture, quantities: tuple[int, ...]) -> list[Array]:
        kind = mixture.kind
        X = (self._blocks[kind, quantities] @ _powers(T * 1e-3, PHI in quantities))[:, : T.size]
        parts = [X[i * kind : (i + 1) * kind] for i in range(len(quantities))]
        if kind > 1:
            far = value(mixture.far) if mixture.far is not None else 0.0
            war = value(mixture.war) if mixture.war is not None else 0.0
            inverse = 1.0 / value(mixture.per_dry_air())
            for part in parts:
                mix = part[0] + far * part[1]
                if kind == 3:
                    mix += war * part[2]
                part[0] = mix * inverse
        return parts

    @staticmethod
    def _composition(parts: Array, mixture: Mixture) -> Iterator[tuple[Array, Value]]:
        """∂q/∂far and ∂q/∂war at constant T, (q_species − q)/(1 + far + war), with what they multiply."""
        if mixture.kind > 1:
            inverse = 1.0 / value(mixture.per_dry_air())
            for row, part in ((1, mixture.far), (2, mixture.war)):
                if isinstance(part, Dual):
                    yield (parts[row] - parts[0]) * inverse, part

    def _chain(self, parts: Array, slope: Array, T: Value, mixture: Mixture) -> Value:
        """q(T, far, war)."""
        return chain(parts[0], (slope, T), *self._composition(parts, mixture))

    def _inverse(self, T: Array, dT_dq: Array, q: Value, parts: Array, mixture: Mixture) -> Value:
        """T(q, far, war): dT = dT_dq · (dq − ∂q/∂far dfar − ∂q/∂war dwar)."""
        return chain(T, (dT_dq, q), *((-dT_dq * g, x) for g, x in self._composition(parts, mixture)))

    def _transfer(self, other: Array, slope: Array, q: Value, parts: Array, mixture: Mixture) -> Value:
        """Another quantity r at given q: dr = slope · (dq − ∂q/∂far dfar …) + ∂r/∂far dfar …"""
        composition = zip(self._composition(other, mixture), self._composition(parts, mixture), strict=True)
        return chain(other[0], (slope, q), *((gr - slope * gq, x) for (gr, x), (gq, _) in composition))

    def _start(self, coefficients: Array, x: Array, mixture: Mixture) -> Array:
        """Starting T or ln T from a polynomial in x = h or φ (scaled), corrected for fuel and water."""
        kind = mixture.kind
        rows = (coefficients[: (1, 3, 5)[kind - 1]] @ _powers(x, False))[:, : x.size]
        start = rows[0]
        if kind > 1 and mixture.far is not None:
            far = value(mixture.far)
            start = start + far * (rows[1] + far * rows[2])
        if kind == 3:
            far = 0.0 if mixture.far is None else value(mixture.far)
            war = 0.0 if mixture.war is None else value(mixture.war)
            start = start + war * (rows[3] + far * rows[4])
        low, high = START_LIMIT[coefficients is self._start_phi]
        return np.minimum(np.maximum(start, low), high)

    def _fitted(self, low: float, high: float, make: Callable[[Array, Mixture], tuple[Array, Array]]) -> Array:
        """Least-squares coefficients (5, 11) of y on powers of x times (1, far, far², war, war·far), where
        make(T, mixture) gives x and y over temperatures low … high."""
        nodes = 0.5 * (low + high) - 0.5 * (high - low) * np.cos(np.linspace(0, np.pi, 60))
        T, far, war = (g.ravel() for g in np.meshgrid(nodes, np.linspace(0, 0.05, 4), [0.0, 0.02], indexing="ij"))
        x, y = make(T, Mixture(far, war))
        powers = _powers(x, False)[:, : x.size]
        weights = (np.ones_like(T), far, far**2, war, war * far)
        columns = [w * powers[k] for w, d in zip(weights, FIT_DEGREES, strict=True) for k in range(d + 1)]
        solution = np.linalg.lstsq(np.stack(columns, axis=1), y, rcond=None)[0]
        coefficients = np.zeros((5, 11))
        at = 0
        for row, d in enumerate(FIT_DEGREES):
            coefficients[row, : d + 1] = solution[at : at + d + 1]
            at += d + 1
        return coefficients

    def _critical_exactly(self, T: Array, mixture: Mixture) -> Array:
        """ln(P/p_*) by Newton's method on T_*."""
        R = value(self.constant(mixture))
        h, phi = (q[0] for q in self._mixed(T, mixture, (H, PHI)))
        T_star = T / 1.17
        for _ in range(6):
            h_star, cp, dcp = (q[0] for q in self._mixed(T_star, mixture, (H, CP, DCP)))
            half_gamma_R = 0.5 * cp * R / (cp - R)
            slope = -cp - half_gamma_R * (1.0 - T_star * dcp * R / (cp * (cp - R)))
            T_star = T_star - (h - h_star - half_gamma_R * T_star) / slope
        return (phi - self._mixed(T_star, mixture, (PHI,))[0][0]) / R


@lru_cache(maxsize=8)
def gas_for(hydrogen_carbon_ratio: float) -> Gas:
    """The gas data of a fuel, made once."""
    return Gas(hydrogen_carbon_ratio)


def _pseudo_species(hydrogen_carbon_ratio: float) -> tuple[dict[str, float], ...]:
    """mol per kg of dry air, of "fuel products" (per kg of fuel CHx + (1 + x/4) O2 → CO2 + x/2 H2O) and of water."""
    x = hydrogen_carbon_ratio
    air_mass = sum(n * MOLAR_MASS[s] for s, n in DRY_AIR_MOLE_FRACTION.items())
    air = {s: n / air_mass for s, n in DRY_AIR_MOLE_FRACTION.items()}
    carbon = 1.0 / (MOLAR_MASS_C + x * MOLAR_MASS_H)
    fuel = {"CO2": carbon, "H2O": 0.5 * x * carbon, "O2": -(1.0 + 0.25 * x) * carbon}
    return air, fuel, {"H2O": 1.0 / MOLAR_MASS["H2O"]}


def _quantity_rows(T: Array, cp: Array) -> Array:
    """Coefficients (4 quantities, 3 species, DEGREE + 3) on (1, t, …, t^(DEGREE+1), ln t), t = T/1000."""
    t = T * 1e-3
    rows = np.zeros((4, len(cp), DEGREE + 3))
    j = np.arange(1, DEGREE + 1)
    t0 = T_REFERENCE * 1e-3
    for species, y in enumerate(cp):
        c = np.polynomial.Chebyshev.fit(t, y, DEGREE).convert(kind=np.polynomial.Polynomial).coef
        rows[CP, species, : DEGREE + 1] = c
        rows[DCP, species, :DEGREE] = j * c[1:] * 1e-3  # per K
        rows[H, species, 1 : DEGREE + 2] = 1e3 * c / np.arange(1, DEGREE + 2)
        rows[PHI, species, 1 : DEGREE + 1] = c[1:] / j
        rows[PHI, species, -1] = c[0]
    at_reference = rows @ _powers(np.array([t0]), True)[:, 0]
    rows[H, :, 0] -= at_reference[H]
    rows[PHI, :, 0] -= at_reference[PHI]
    return rows


def _powers(t: Array, with_log: bool) -> Array:
    """(1, t, …, t^(DEGREE+1), ln t), shape (DEGREE + 3, N); without the logarithm one row less."""
    n = t.size
    # matrix products sum differently at the end of a number of columns that is odd
    P = np.empty((DEGREE + 2 + with_log, -(-n // COLUMNS) * COLUMNS))
    P[:, n:] = 1.0
    P[0] = 1.0
    P[1, :n] = t
    np.multiply(P[1], P[1], out=P[2])
    np.multiply(P[1:3], P[2], out=P[3:5])
    np.multiply(P[1:5], P[4], out=P[5:9])
    np.multiply(P[1:3], P[8], out=P[9:11])
    if with_log:
        np.log(P[1], out=P[11])
    return P
