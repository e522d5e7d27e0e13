"""Enthalpy, entropy function, heat capacity and gas constant of air, combustion products and water vapour.

A working gas is dry air with fuel burnt in it (fuel–air ratio `far`) and water vapour (`war`), both per
kg of *dry air*. Its properties are mass averages of three pseudo-species: dry air, "fuel products" (the
CO2 and H2O that one kg of fuel makes, less the O2 it takes from the air: lean complete combustion, no
dissociation) and water. For h, φ = ∫cp/T dT and cp alike

    q(T, far, war) = [q_air(T) + far q_fuel(T) + war q_water(T)] / (1 + far + war).

The heat capacities are the NASA nine-coefficient polynomials (`nasa9`), refitted once per engine as one
polynomial in T over 200–2400 K (largest departure in h: 20 J/kg, 0.02 K), so that h, φ, cp and dcp/dT of
all points come from one matrix product and are smooth. h and φ are zero at 298.15 K, where heating values
are stated; the entropy is s = φ − R ln P.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from enginediag_cli.engine.dual import Array, Value, chain, value
from enginediag_cli.engine.nasa9 import (
    DRY_AIR_MOLE_FRACTION,
    MOLAR_MASS,
    UNIVERSAL_GAS_CONSTANT,
    molar_heat_capacity,
)

T_REFERENCE = 298.15  # K, zero of h and φ
T_FIT = (200.0, 2400.0)  # K
T_LIMIT = (150.0, 2500.0)  # K, where an operating point is still called inside the gas data
DEGREE = 9
LOG_T_START = (np.log(T_LIMIT[0] - 20.0), np.log(T_LIMIT[1] + 200.0))
H, PHI, CP, DCP = range(4)
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
        self._blocks = {
            (kind, quantities): np.concatenate([self._rows[q, :kind] for q in quantities])
            for kind in (1, 2, 3)
            for quantities in ((H,), (PHI,), (H, PHI), (H, CP, DCP), (PHI, CP, DCP), (H, CP), (PHI, CP), (CP, DCP))
        }
        self._start_h = self._fit_start(H, degree=9)
        self._start_phi = self._fit_start(PHI, degree=9)

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
        return self._chain(h, cp[0], T, H, h, mixture)

    def entropy(self, T: Value, mixture: Mixture) -> Value:
        """φ(T) = ∫cp/T dT [J/(kg K)]."""
        phi, cp = self._mixed(value(T), mixture, (PHI, CP))
        return self._chain(phi, cp[0] / value(T), T, PHI, phi, mixture)

    def heat_capacity(self, T: Value, mixture: Mixture) -> Value:
        """cp(T) [J/(kg K)]."""
        cp, dcp = self._mixed(value(T), mixture, (CP, DCP))
        return self._chain(cp, dcp[0], T, CP, cp, mixture)

    def h_cp_dcp(self, T: Array, mixture: Mixture) -> tuple[Array, Array, Array]:
        """Plain values of h, cp and dcp/dT at T (N,)."""
        h, cp, dcp = self._mixed(T, mixture, (H, CP, DCP))
        return h[0], cp[0], dcp[0]

    def temperature_from_enthalpy(self, h: Value, mixture: Mixture) -> Value:
        """T [K] with h(T) = h: polynomial start, one Halley and one Newton step (error below 1e-10 K)."""
        target = value(h)
        T = self._start(self._start_h, target * 1e-6, mixture)
        q, cp, dcp = self._mixed(T, mixture, (H, CP, DCP))
        f = q[0] - target
        T = T - f / (cp[0] - 0.5 * f * dcp[0] / cp[0])
        q, cp = self._mixed(T, mixture, (H, CP))
        return self._invert(T + (target - q[0]) / cp[0], 1.0 / cp[0], h, q, mixture)

    def temperature_from_entropy(self, phi: Value, mixture: Mixture) -> Value:
        """T [K] with φ(T) = phi, likewise."""
        target = value(phi)
        T = self._start(self._start_phi, target * 1e-3, mixture)
        q, cp, dcp = self._mixed(T, mixture, (PHI, CP, DCP))
        f = q[0] - target
        slope = cp[0] / T
        T = T - f / (slope - 0.5 * f * (dcp[0] - slope) / cp[0])
        q, cp = self._mixed(T, mixture, (PHI, CP))
        per_phi = T / cp[0]
        return self._invert(T + (target - q[0]) * per_phi, per_phi, phi, q, mixture)

    # A mixed quantity is (kind, N): row 0 the mixture's value, rows 1.. the pseudo-species' own (fuel, water).

    def _mixed(self, T: Array, mixture: Mixture, quantities: tuple[int, ...]) -> list[Array]:
        kind = mixture.kind
        X = self._blocks[kind, quantities] @ _powers(T * 1e-3, PHI in quantities)
        parts = [X[i * kind:(i + 1) * kind] for i in range(len(quantities))]
        if kind > 1:
            far = value(mixture.far) if mixture.far is not None else 0.0
            inverse = 1.0 / value(mixture.per_dry_air())
            for part in parts:
                mix = part[0] + far * part[1]
                if kind == 3:
                    mix += value(mixture.war) * part[2]
                part[0] = mix * inverse
        return parts

    @staticmethod
    def _chain(parts: Array, slope: Array, x: Value, quantity: int, q: Array, mixture: Mixture) -> Value:
        """q(x, far, war) with ∂q/∂far = (q_fuel − q)/(1 + far + war)."""
        if mixture.kind == 1:
            return chain(parts[0], (slope, x))
        inverse = 1.0 / value(mixture.per_dry_air())
        terms = [(slope, x)]
        for row, part in ((1, mixture.far), (2, mixture.war)):
            if part is not None:
                terms.append(((parts[row] - parts[0]) * inverse, part))
        return chain(parts[0], *terms)

    @staticmethod
    def _invert(T: Array, dT_dq: Array, q: Value, parts: Array, mixture: Mixture) -> Value:
        """T(q, far, war): dT = dT_dq · (dq − ∂q/∂far dfar − ∂q/∂war dwar)."""
        terms = [(dT_dq, q)]
        if mixture.kind > 1:
            inverse = 1.0 / value(mixture.per_dry_air())
            for row, part in ((1, mixture.far), (2, mixture.war)):
                if part is not None:
                    terms.append((-dT_dq * (parts[row] - parts[0]) * inverse, part))
        return chain(T, *terms)

    def _start(self, coefficients: Array, x: Array, mixture: Mixture) -> Array:
        """Starting ln T from a polynomial in x = h or φ (scaled), corrected for fuel and water."""
        kind = mixture.kind
        rows = coefficients[: (1, 3, 4)[kind - 1]] @ _powers(x, False)[: coefficients.shape[1]]
        log_T = rows[0]
        if kind > 1 and mixture.far is not None:
            far = value(mixture.far)
            log_T = log_T + far * (rows[1] + far * rows[2])
        if kind == 3:
            log_T = log_T + value(mixture.war) * rows[3]
        return np.exp(np.minimum(np.maximum(log_T, LOG_T_START[0]), LOG_T_START[1]))

    def _fit_start(self, quantity: int, degree: int) -> Array:
        """Least-squares coefficients (4, degree + 1) of ln T on powers of q times (1, far, far², war)."""
        scale = 1e-6 if quantity == H else 1e-3
        nodes = 0.5 * (T_LIMIT[0] + T_LIMIT[1]) - 0.5 * (T_LIMIT[1] - T_LIMIT[0]) * np.cos(np.linspace(0, np.pi, 60))
        T, far, war = (g.ravel() for g in np.meshgrid(nodes, np.linspace(0, 0.05, 4), [0.0, 0.02], indexing="ij"))
        q = self._mixed(T, Mixture(far, war), (quantity,))[0][0] * scale
        degrees = (degree, degree - 1, degree - 2, degree - 2)
        powers = _powers(q, False)
        columns = [w * powers[k] for w, d in zip((1.0, far, far**2, war), degrees, strict=True) for k in range(d + 1)]
        solution = np.linalg.lstsq(np.stack(columns, axis=1), np.log(T), rcond=None)[0]
        coefficients = np.zeros((4, degree + 1))
        at = 0
        for row, d in enumerate(degrees):
            coefficients[row, : d + 1] = solution[at:at + d + 1]
            at += d + 1
        return coefficients


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
    """(1, t, …, t^(DEGREE+1), ln t), shape (DEGREE + 3, N); the last row is left zero if not wanted."""
    P = np.empty((DEGREE + 3, t.size))
    P[0] = 1.0
    P[1] = t
    P[2] = t * t
    P[3:5] = P[1:3] * P[2]
    P[5:9] = P[1:5] * P[4]
    P[9:11] = P[1:3] * P[8]
    P[11] = np.log(t) if with_log else 0.0
    return P
