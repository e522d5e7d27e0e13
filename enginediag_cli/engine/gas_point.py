"""Inverses of the gas data at one operating point in plain floats: calls of array operations cost more there than the
arithmetic.

The same formulas as in `gas` in the same order, and products of the same matrices, so that the numbers are the same to
the last digit. ArithmeticError where floats refuse what arrays answer by what is not finite: the caller asks the arrays
then.
"""

from __future__ import annotations

import numpy as np

from enginediag_cli.engine.dual import Array

Composition = tuple[float, float, float]
"""Fuel and water per dry air, and dry air per gas."""
Limit = tuple[float, float]
COLUMNS = 4
"""Columns of a matrix product whose sums are those of longer ones; of one column they would differ."""


def at_enthalpy(start: Array, rows: Array, limit: Limit, h: float, of: Composition) -> tuple[Array, Array]:
    """T [K] and φ, each (1,), where the enthalpy is h [J/kg]. `start`: coefficients of the starting temperature, `rows`
    of h, φ, cp, dcp/dT of the pseudo-species; `limit` of the start."""
    T0 = _start(start, h * 1e-6, limit, of)
    q, phi, cp, dcp = _properties(rows, T0, of)
    f = q - h
    dT = f / (0.5 * f * dcp / cp - cp)
    return np.array([T0 + dT]), np.array([phi - f / (T0 + 0.5 * dT)])


def at_entropy(start: Array, rows: Array, limit: Limit, phi: float, of: Composition) -> tuple[Array, Array]:
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
