"""Enthalpy, entropy function, heat capacity and gas constant of air, combustion products and water vapour.

A working gas is dry air with fuel burnt in it (fuel–air ratio `far`) and water vapour (`war`), both per
kg of *dry air*. Its properties are mass averages of three pseudo-species: dry air, "fuel products" (the
CO2 and H2O that one kg of fuel makes, less the O2 it takes from the air: lean complete combustion, no
dissociation) and water. For h, φ = ∫cp/T dT and cp alike

    q(T, far, war) = [q_air(T) + far q_fuel(T) + war q_water(T)] / (1 + far + war).

The heat capacities are the NASA nine-coefficient polynomials, refitted once per engine as one polynomial in T over
200–2400 K (largest departure in h: 20 J/kg, 0.02 K, for air), so that h, φ, cp and dcp/dT of all points come from one
matrix product and are smooth. h and φ are zero at 298.15 K, where heating values are stated; the entropy is
s = φ − R ln P.

    cp/Ru = a1 T^-2 + a2 T^-1 + a3 + a4 T + a5 T^2 + a6 T^3 + a7 T^4    on 200–1000 K and 1000–6000 K

Source: B. J. McBride, M. J. Zehe, S. Gordon, "NASA Glenn Coefficients for Calculating Thermodynamic
Properties of Individual Species", NASA/TP-2002-211556 (2002).
"""

from __future__ import annotations

from collections.abc import Callable
from functools import cached_property, lru_cache
from typing import Any

import numpy as np

from enginediag_cli.engine.dual import Array, Dual, Value, chain, select, value

UNIVERSAL_GAS_CONSTANT = 8.314510  # J/(mol K), the value the coefficients were made with
T_BREAK = 1000.0  # K

MOLAR_MASS = {"N2": 28.0134e-3, "O2": 31.9988e-3, "Ar": 39.948e-3, "CO2": 44.0095e-3, "H2O": 18.01528e-3}  # kg/mol

DRY_AIR_MOLE_FRACTION = {"N2": 0.78084, "O2": 0.209476, "Ar": 0.009365, "CO2": 0.000319}  # same report

LOW = {
    "N2": (
        2.210371497e4,
        -3.818461820e2,
        6.082738360,
        -8.530914410e-3,
        1.384646189e-5,
        -9.625793620e-9,
        2.519705809e-12,
    ),
    "O2": (
        -3.425563420e4,
        4.847000970e2,
        1.119010961,
        4.293889240e-3,
        -6.836300520e-7,
        -2.023372700e-9,
        1.039040018e-12,
    ),
    "Ar": (0.0, 0.0, 2.5, 0.0, 0.0, 0.0, 0.0),
    "CO2": (
        4.943650540e4,
        -6.264116010e2,
        5.301725240,
        2.503813816e-3,
        -2.127308728e-7,
        -7.689988780e-10,
        2.849677801e-13,
    ),
    "H2O": (
        -3.947960830e4,
        5.755731020e2,
        9.317826530e-1,
        7.222712860e-3,
        -7.342557370e-6,
        4.955043490e-9,
        -1.336933246e-12,
    ),
}
"""a1 … a7 on 200–1000 K, from the report above."""
HIGH = {
    "N2": (
        5.877124060e5,
        -2.239249073e3,
        6.066949220,
        -6.139685500e-4,
        1.491806679e-7,
        -1.923105485e-11,
        1.061954386e-15,
    ),
    "O2": (
        -1.037939022e6,
        2.344830282e3,
        1.819732036,
        1.267847582e-3,
        -2.188067988e-7,
        2.053719572e-11,
        -8.193467050e-16,
    ),
    "Ar": (
        2.010538475e1,
        -5.992661070e-2,
        2.500069401,
        -3.992141160e-8,
        1.205272140e-11,
        -1.819015576e-15,
        1.078576636e-19,
    ),
    "CO2": (
        1.176962419e5,
        -1.788791477e3,
        8.291523190,
        -9.223156780e-5,
        4.863676880e-9,
        -1.891053312e-12,
        6.330036590e-16,
    ),
    "H2O": (
        1.034972096e6,
        -2.412698562e3,
        4.646110780,
        2.291998307e-3,
        -6.836830480e-7,
        9.426468930e-11,
        -4.822380530e-15,
    ),
}
"""a1 … a7 on 1000–6000 K, from the report above."""


def molar_heat_capacity(species: str, temperature_K: np.ndarray) -> np.ndarray:
    """cp of one species [J/(mol K)] at temperatures (N,) [K]; below 200 K the lower range is continued."""
    T = np.asarray(temperature_K, dtype=float)
    powers = np.stack([T**k for k in range(-2, 5)])
    low, high = (np.asarray(table[species]) @ powers for table in (LOW, HIGH))
    return UNIVERSAL_GAS_CONSTANT * np.where(T < T_BREAK, low, high)


class Mixture:
    """Composition of a working gas; None is exactly zero and costs nothing. What follows from it is computed once."""

    __slots__ = ("_constant", "_dry", "_floats", "_plain", "duals", "far", "kind", "war")

    def __init__(self, far: Value | None = None, war: Value | None = None):
        self.far, self.war = far, war
        self.kind = 3 if war is not None else 2 if far is not None else 1
        """How many pseudo-species it needs: 1 dry air, 2 with fuel, 3 with water."""
        self.duals = tuple((row, x) for row, x in ((1, far), (2, war)) if isinstance(x, Dual))
        """Row of the pseudo-species, and its amount, of those that carry derivatives."""
        self._dry: Value | None = None
        self._plain: tuple[Any, Any, Any] | None = None
        self._floats: tuple[float, float, float] | None = None
        self._constant: tuple[Gas, Value] | None = None

    @property
    def plain(self) -> Mixture:
        """The same without derivatives."""
        return Mixture(*(None if x is None else value(x) for x in (self.far, self.war)))

    def per_dry_air(self) -> Value:
        """kg of gas per kg of dry air, 1 + far + war."""
        if self._dry is None:
            total: Value = 1.0
            for part in (self.far, self.war):
                if part is not None:
                    total = total + part
            self._dry = total
        return self._dry

    def values(self) -> tuple[Any, Any, Any]:
        """Plain fuel and water per dry air, 0 where there is none, and dry air per gas."""
        if self._plain is None:
            far, war = (0.0 if x is None else value(x) for x in (self.far, self.war))
            self._plain = far, war, 1.0 / value(self.per_dry_air())
        return self._plain

    def floats(self) -> tuple[float, float, float]:
        """The same of one point."""
        if self._floats is None:
            far, war, inverse = (np.asarray(x).item() for x in self.values())
            self._floats = far, war, inverse
        return self._floats

    def constant(self, gas: Gas) -> Value:
        """Gas constant R [J/(kg K)] with the pseudo-species of `gas`."""
        if self._constant is None or self._constant[0] is not gas:
            Ra, Rf, Rw = gas.R_species
            R: Value = Ra
            if self.far is not None:
                R = R + self.far * Rf
            if self.war is not None:
                R = R + self.war * Rw
            self._constant = gas, R if self.kind == 1 else R / self.per_dry_air()
        return self._constant[1]


# Inverses at one point in plain floats: array operations cost more there than the arithmetic. The same formulas in the
# same order as with arrays, and products of the same matrices, so that the digits are the same. ArithmeticError where
# floats refuse what arrays answer by what is not finite: the caller asks the arrays then.

Composition = tuple[float, float, float]
"""Fuel and water per dry air, and dry air per gas."""
Limit = tuple[float, float]
COLUMNS = 4
"""Columns of a matrix product whose sums are those of longer ones; of one column they would differ."""


def invert_enthalpy(start: Array, rows: Array, limit: Limit, h: float, of: Composition) -> tuple[Array, Array]:
    """T [K] and φ, each (1,), where the enthalpy is h [J/kg]. `start`: coefficients of the starting temperature, `rows`
    of h, φ, cp, dcp/dT of the pseudo-species; `limit` of the start."""
    T0 = _start(start, h * 1e-6, limit, of)
    q, phi, cp, dcp = _properties(rows, T0, of)
    f = q - h
    dT = f / (0.5 * f * dcp / cp - cp)
    return np.array([T0 + dT]), np.array([phi - f / (T0 + 0.5 * dT)])


def invert_entropy(start: Array, rows: Array, limit: Limit, phi: float, of: Composition) -> tuple[Array, Array]:
    """T [K] and h [J/kg], each (1,), where the entropy function is φ; `start` and `limit` of ln T."""
    T0 = float(np.exp(_start(start, phi * 1e-3, limit, of)))
    h, q, cp, dcp = _properties(rows, T0, of)
    f = q - phi
    slope = cp / T0
    dT = f / (0.5 * f * (dcp - slope) / cp - slope)
    return np.array([T0 + dT]), np.array([h - f * (T0 + 0.5 * dT)])


def _powers(t: float) -> list[float]:
    t2 = t * t
    t3 = t2 * t
    t4 = t3 * t
    t5 = t4 * t
    t6 = t5 * t
    t7 = t6 * t
    t8 = t7 * t
    t9 = t8 * t
    return [1.0, t, t2, t3, t4, t5, t6, t7, t8, t9, t9 * t]


def _start(coefficients: Array, x: float, limit: Limit, of: Composition) -> float:
    rows = _product(coefficients, _powers(x))
    q = rows[0]
    if len(rows) > 1:
        q += of[0] * (rows[1] + of[0] * rows[2])
    if len(rows) > 3:
        q += of[1] * (rows[3] + of[0] * rows[4])
    return float(min(max(q, limit[0]), limit[1]))


def _properties(rows: Array, T: float, of: Composition) -> list[float]:
    """Those of the mixture, from rows of pseudo-species for each."""
    t = T * 1e-3
    X = _product(rows, [*_powers(t), float(np.log(t))])
    if len(X) == 4:
        return X
    far, war, inverse = of
    if len(X) == 8:
        return [(X[k] + far * X[k + 1]) * inverse for k in (0, 2, 4, 6)]
    return [(X[k] + far * X[k + 1] + war * X[k + 2]) * inverse for k in (0, 3, 6, 9)]


def _product(rows: Array, column: list[float]) -> list[float]:
    found: list[float] = rows.dot(np.array(column).repeat(COLUMNS).reshape(-1, COLUMNS))[:, 0].tolist()
    return found


T_REFERENCE = 298.15  # K, zero of h and φ
T_FIT = (200.0, 2400.0)  # K
T_NOZZLE = (180.0, 1700.0)  # K, total temperatures at which nozzles are met
T_HOT_NOZZLE = (1600.0, 2600.0)  # K, the same behind an afterburner
FIT_DEGREES = (10, 9, 8, 8, 6)  # in x, of the terms (1, far, far², war, war·far)
T_LIMIT = (150.0, 2500.0)  # K, where an operating point is still called inside the gas data
DEGREE = 9
"""Of the polynomial for cp: over T_FIT it leaves 20 J/kg, 0.02 K, in h for air."""
START_LIMIT = ((130.0, 2700.0), (np.log(130.0), np.log(2700.0)))  # K, ln K
FEW_COLUMNS = 32
"""Columns up to which one operation along the powers is cheaper than one for each; the digits are the same."""
H, PHI, CP, DCP = range(4)
"""Rows of the fitted properties."""
TERMS = (0, 1, 3, 5)
"""Terms (1, far, far², war, war·far) of a fitted polynomial, by the number of pseudo-species."""
MOLAR_MASS_C, MOLAR_MASS_H = 12.0107e-3, 1.00794e-3  # kg/mol


DRY_AIR = Mixture()


class Gas:
    """Gas data for one fuel. Methods take temperatures [K], enthalpies [J/kg] or φ [J/(kg K)] of shape (N,)."""

    def __init__(self, hydrogen_carbon_ratio: float = 1.9185):
        species = _pseudo_species(hydrogen_carbon_ratio)
        self._oxygen = tuple(s.get("O2", 0.0) for s in species[:2])
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
                (CP,),
                (H, PHI),
                (H, CP),
                (CP, DCP),
                (H, PHI, CP),
                (H, CP, DCP),
                (H, PHI, CP, DCP),
            )
        }
        self._start_h = self._fitted(*T_LIMIT, lambda T, m: (value(self.enthalpy(T, m)) * 1e-6, T))
        self._start_phi = self._fitted(
            *T_LIMIT, lambda T, m: (self._mixed(self._species(T, m, (PHI,)), m)[0] * 1e-3, np.log(T))
        )
        self._critical = self._fitted(*T_NOZZLE, lambda T, m: (T * 1e-3, self._critical_exactly(T, m)))
        self._critical_slope = _derivative(self._critical)

    @cached_property
    def _critical_hot(self) -> tuple[Array, Array]:
        found = self._fitted(*T_HOT_NOZZLE, lambda T, m: (T * 1e-3, self._critical_exactly(T, m)))
        return found, _derivative(found)

    def constant(self, mixture: Mixture) -> Value:
        """Gas constant R [J/(kg K)]."""
        return mixture.constant(self)

    def enthalpy(self, T: Value, mixture: Mixture) -> Value:
        """h(T) [J/kg]."""
        if not isinstance(T, Dual) and not mixture.duals:
            return self._mixed(self._species(T, mixture, (H,)), mixture)[0]
        X = self._species(value(T), mixture, (H, CP))
        h, cp = self._mixed(X, mixture)
        return self._chain(h, X[0], cp, T, mixture)

    def enthalpy_and_entropy(self, T: Value, mixture: Mixture) -> tuple[Value, Value]:
        """h(T) [J/kg] and φ(T) = ∫cp/T dT [J/(kg K)]."""
        if not isinstance(T, Dual) and not mixture.duals:
            h, phi = self._mixed(self._species(T, mixture, (H, PHI)), mixture)
            return h, phi
        X = self._species(value(T), mixture, (H, PHI, CP))
        h, phi, cp = self._mixed(X, mixture)
        return self._chain(h, X[0], cp, T, mixture), self._chain(phi, X[1], cp / value(T), T, mixture)

    def heat_capacity(self, T: Value, mixture: Mixture) -> Value:
        """cp(T) [J/(kg K)]."""
        if not isinstance(T, Dual) and not mixture.duals:
            return self._mixed(self._species(T, mixture, (CP,)), mixture)[0]
        X = self._species(value(T), mixture, (CP, DCP))
        cp, dcp = self._mixed(X, mixture)
        return self._chain(cp, X[0], dcp, T, mixture)

    def temperature_from_enthalpy(self, h: Value, mixture: Mixture) -> tuple[Value, Value]:
        """T [K] and φ where h(T) = h: polynomial start and one Halley step (1e-8 K; 4e-7 K in very humid air);
        dφ = dh/T, from the start at the temperature between."""
        if (one := self._invert_scalar(invert_enthalpy, self._start_h, START_LIMIT[0], h, mixture)) is not None:
            return one
        target = value(h)
        T0 = self._start(self._start_h, target * 1e-6, mixture, START_LIMIT[0])
        X = self._species(T0, mixture, (H, PHI, CP, DCP))
        q, phi, cp, dcp = self._mixed(X, mixture)
        f = q - target
        dT = f / (0.5 * f * dcp / cp - cp)
        T = T0 + dT
        phi = phi - f / (T0 + 0.5 * dT)
        if not isinstance(h, Dual) and not mixture.duals:
            return T, phi
        return self._inverted(T, phi, 1.0 / (cp + dcp * dT), 1.0 / T, h, self._shifted(X, dT, T0, mixture, H), mixture)

    def temperature_from_entropy(self, phi: Value, mixture: Mixture) -> tuple[Value, Value]:
        """T [K] and h where φ(T) = phi, likewise; dh = T dφ."""
        if (one := self._invert_scalar(invert_entropy, self._start_phi, START_LIMIT[1], phi, mixture)) is not None:
            return one
        target = value(phi)
        T0 = np.exp(self._start(self._start_phi, target * 1e-3, mixture, START_LIMIT[1]))
        X = self._species(T0, mixture, (H, PHI, CP, DCP))
        h, q, cp, dcp = self._mixed(X, mixture)
        f = q - target
        slope = cp / T0
        dT = f / (0.5 * f * (dcp - slope) / cp - slope)
        T = T0 + dT
        h = h - f * (T0 + 0.5 * dT)
        if not isinstance(phi, Dual) and not mixture.duals:
            return T, h
        return self._inverted(T, h, T / (cp + dcp * dT), T, phi, self._shifted(X, dT, T0, mixture, PHI), mixture)

    def critical_log_pressure_ratio(self, T: Value, mixture: Mixture) -> Value:
        """ln(P/p_*) of an isentropic expansion from total temperature T [K] to Mach 1.

        A polynomial in T and composition fitted to the exact solution of h(T) − h(T_*) = γ(T_*) R T_*/2
        with these gas data (to 2e-5, which moves the choked flow by 1e-10), so that nozzles need no iteration. Above
        T_NOZZLE, where no gas is before an afterburner burns, another one.
        """
        hot = np.asarray(value(T) > T_NOZZLE[1])
        found = self._critical_ratio(self._critical, self._critical_slope, T, mixture)
        if hot.any():
            found = select(hot, self._critical_ratio(*self._critical_hot, T, mixture), found)
        return found

    def _critical_ratio(self, coefficients: Array, derivative: Array, T: Value, mixture: Mixture) -> Value:
        t = value(T) * 1e-3
        P = _gas_powers(t, False)
        rows = coefficients[: TERMS[mixture.kind]].dot(P)[:, : t.size]
        q = self._composed(rows, mixture)
        if not isinstance(T, Dual) and not mixture.duals:
            return q
        slopes = derivative[: TERMS[mixture.kind]].dot(P)[:, : t.size]
        terms: list[tuple[Array, Value]] = [(self._composed(slopes, mixture) * 1e-3, T)]
        far, war, _ = mixture.values()
        for row, part in mixture.duals:
            slope = rows[3] + far * rows[4] if row == 2 else rows[1] + 2.0 * far * rows[2]
            terms.append((slope + war * rows[4] if row == 1 and mixture.kind == 3 else slope, part))
        return chain(q, *terms)

    # Of the pseudo-species (dry air, fuel, water), by quantity: (q, kind, N); of the mixture: (q, N).

    def _species(self, T: Value, mixture: Mixture, quantities: tuple[int, ...]) -> Array:
        T = np.asarray(T)
        X = self._blocks[mixture.kind, quantities].dot(_gas_powers(T * 1e-3, PHI in quantities))
        return X[:, : T.size].reshape(len(quantities), mixture.kind, T.size)

    @property
    def stoichiometric_far(self) -> float:
        """Fuel per dry air that takes all of its oxygen."""
        return -self._oxygen[0] / self._oxygen[1]

    @staticmethod
    def _mixed(X: Array, mixture: Mixture) -> Array:
        if mixture.kind == 1:
            return X[:, 0]
        far, war, inverse = mixture.values()
        mixed = X[:, 1] * far
        mixed += X[:, 0]
        if mixture.kind == 3:
            mixed += X[:, 2] * war
        mixed *= inverse
        return np.asarray(mixed)

    @staticmethod
    def _chain(q: Array, X: Array, slope: Array, T: Value, mixture: Mixture) -> Value:
        """q(T, far, war), whose pseudo-species have X (kind, N): ∂q/∂far = (q_fuel − q)/(1 + far + war)."""
        inverse = mixture.values()[2]
        return chain(q, (slope, T), *(((X[row] - q) * inverse, part) for row, part in mixture.duals))

    @staticmethod
    def _shifted(X: Array, dT: Array, T0: Array, mixture: Mixture, given: int) -> list[tuple[Array, Array]]:
        """∂q/∂x and ∂r/∂x at constant T0 + dT for every part x of the composition that carries derivatives, of h and φ
        or φ and h in the order given, from h, φ, cp, dcp/dT of the pseudo-species at T0."""
        if not mixture.duals:
            return []
        h, phi, cp, dcp = X
        h = h + (cp + 0.5 * dT * dcp) * dT
        phi = phi + (cp + 0.5 * dT * (dcp - cp / T0)) * (dT / T0)
        inverse = mixture.values()[2]
        found = []
        for q in (h, phi):
            mixed = Gas._mixed(q[None], mixture)[0]
            found.append([(q[row] - mixed) * inverse for row, _ in mixture.duals])
        return list(zip(*(found if given == H else found[::-1]), strict=True))

    @staticmethod
    def _inverted(
        T: Array, r: Array, dT_dq: Array, dr_dq: Array, q: Value, parts: list[tuple[Array, Array]], mixture: Mixture
    ) -> tuple[Value, Value]:
        """T(q, far, war) and another quantity r there: dT = dT_dq · (dq − ∂q/∂far dfar …), dr likewise + ∂r/∂far dfar
        …"""
        of = [(gq, gr, part) for (gq, gr), (_, part) in zip(parts, mixture.duals, strict=True)]
        return (
            chain(T, (dT_dq, q), *((-dT_dq * gq, part) for gq, _, part in of)),
            chain(r, (dr_dq, q), *((gr - dr_dq * gq, part) for gq, gr, part in of)),
        )

    def _invert_scalar(
        self,
        invert: Callable[..., tuple[Array, Array]],
        start: Array,
        limit: tuple[float, float],
        given: Value,
        mixture: Mixture,
    ) -> tuple[Array, Array] | None:
        """The inverse in plain floats; None where there are more points, derivatives, or no such floats."""
        if isinstance(given, Dual) or mixture.duals or np.size(given) != 1:
            return None
        kind = mixture.kind
        try:
            number = np.asarray(given).item()
            return invert(start[: TERMS[kind]], self._blocks[kind, (H, PHI, CP, DCP)], limit, number, mixture.floats())
        except (ArithmeticError, ValueError):
            return None

    def _start(self, coefficients: Array, x: Array, mixture: Mixture, limit: tuple[float, float]) -> Array:
        """Starting T or ln T from a polynomial in x = h or φ (scaled), corrected for fuel and water."""
        rows = coefficients[: TERMS[mixture.kind]].dot(_gas_powers(x, False))[:, : x.size]
        return np.minimum(np.maximum(self._composed(rows, mixture), limit[0]), limit[1])

    @staticmethod
    def _composed(rows: Array, mixture: Mixture) -> Array:
        """Terms (1, far, far², war, war·far) · rows, as many as the mixture has."""
        if mixture.kind == 1:
            return rows[0]
        far, war, _ = mixture.values()
        q = rows[0] + far * (rows[1] + far * rows[2])
        return q if mixture.kind == 2 else q + war * (rows[3] + far * rows[4])

    def _fitted(self, low: float, high: float, make: Callable[[Array, Mixture], tuple[Array, Array]]) -> Array:
        """Least-squares coefficients (5, 11) of y on powers of x times (1, far, far², war, war·far), where
        make(T, mixture) gives x and y over temperatures low … high."""
        nodes = 0.5 * (low + high) - 0.5 * (high - low) * np.cos(np.linspace(0, np.pi, 60))
        T, far, war = (g.ravel() for g in np.meshgrid(nodes, np.linspace(0, 0.05, 4), [0.0, 0.02], indexing="ij"))
        x, y = make(T, Mixture(far, war))
        powers = _gas_powers(x, False)[:, : x.size]
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
        h, phi = self._mixed(self._species(T, mixture, (H, PHI)), mixture)
        T_star = T / 1.17
        for _ in range(6):
            h_star, cp, dcp = self._mixed(self._species(T_star, mixture, (H, CP, DCP)), mixture)
            half_gamma_R = 0.5 * cp * R / (cp - R)
            slope = -cp - half_gamma_R * (1.0 - T_star * dcp * R / (cp * (cp - R)))
            T_star = T_star - (h - h_star - half_gamma_R * T_star) / slope
        return (phi - self._mixed(self._species(T_star, mixture, (PHI,)), mixture)[0]) / R


@lru_cache(maxsize=8)
def shared_gas(hydrogen_carbon_ratio: float) -> Gas:
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
    at_reference = rows @ _gas_powers(np.array([t0]), True)[:, 0]
    rows[H, :, 0] -= at_reference[H]
    rows[PHI, :, 0] -= at_reference[PHI]
    return rows


def _derivative(coefficients: Array) -> Array:
    """Of polynomials (k, 11), in the same powers."""
    found = np.zeros_like(coefficients)
    found[:, :-1] = coefficients[:, 1:] * np.arange(1, coefficients.shape[1])
    return found


def _gas_powers(t: Array, with_log: bool) -> Array:
    """(1, t, …, t^(DEGREE+1), ln t), shape (DEGREE + 3, N); without the logarithm one row less."""
    n = t.size
    # matrix products sum differently at the end of a number of columns that is odd
    P = np.empty((DEGREE + 2 + with_log, -(-n // COLUMNS) * COLUMNS))
    P[1, :n] = t
    P[1, n:] = 1.0
    t = P[1]
    if n <= FEW_COLUMNS:
        P[2 : DEGREE + 2] = t
        np.multiply.accumulate(P[1 : DEGREE + 2], axis=0, out=P[1 : DEGREE + 2])
    else:
        rows = tuple(P)
        for k in range(2, DEGREE + 2):
            np.multiply(rows[k - 1], t, rows[k])
    P[0] = 1.0
    if with_log:
        np.log(t, P[DEGREE + 2])
    return P
