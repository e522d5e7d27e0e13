"""Forward-mode derivatives for whole batches: one model source gives values and exact Jacobians.

A `Dual` carries a value `v` of shape (N,) and the derivatives `d` of shape (m, N) with respect to the
first m *directions* of a pass. Directions are numbered in the order in which the model first reads their
leaves, so a quantity early in the gas path carries few rows; quantities with different m combine on the
common prefix. The model functions below accept floats, arrays (N,) or Duals alike; the value of a Dual is what plain
numbers would give, to the last digit.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, Union

import numpy as np

Array = np.ndarray
Value = Union[float, Array, "Dual"]


class Dual:
    """Value (N,) with derivatives (m, N) along the first m directions."""

    __array_ufunc__ = None  # so that array * Dual calls Dual.__rmul__
    __slots__ = ("d", "v")

    def __init__(self, v: Array, d: Array):
        self.v = v
        self.d = d

    def __add__(self, other: Value) -> Dual:
        if not isinstance(other, Dual):
            return Dual(self.v + other, self.d)
        a, b = (self, other) if len(self.d) >= len(other.d) else (other, self)
        m = len(b.d)
        if m == len(a.d):
            return Dual(a.v + b.v, a.d + b.d)
        d = a.d.copy()
        d[:m] += b.d
        return Dual(a.v + b.v, d)

    __radd__ = __add__

    def __neg__(self) -> Dual:
        return Dual(-self.v, -self.d)

    def __sub__(self, other: Value) -> Dual:
        if not isinstance(other, Dual):
            return Dual(self.v - other, self.d)
        m, k = len(self.d), len(other.d)
        if m == k:
            return Dual(self.v - other.v, self.d - other.d)
        if m > k:
            d = self.d.copy()
            d[:k] -= other.d
        else:
            d = -other.d
            d[:m] += self.d
        return Dual(self.v - other.v, d)

    def __rsub__(self, other: float | Array) -> Dual:
        return Dual(np.asarray(other - self.v), -self.d)

    def __mul__(self, other: Value) -> Dual:
        if not isinstance(other, Dual):
            return Dual(self.v * other, self.d * other)
        return _combine(self.v * other.v, self, other.v, other, self.v)

    __rmul__ = __mul__

    def __pow__(self, exponent: float) -> Dual:
        result = power(self, exponent)
        assert isinstance(result, Dual)
        return result

    def __truediv__(self, other: Value) -> Dual:
        if not isinstance(other, Dual):
            return Dual(self.v / other, self.d * (1.0 / other))
        inverse = 1.0 / other.v
        v = self.v / other.v
        return _combine(v, self, inverse, other, -v * inverse)

    def __rtruediv__(self, other: float | Array) -> Dual:
        v = other / self.v
        return Dual(v, self.d * (-v / self.v))


def _combine(v: Array, a: Dual, da: Array, b: Dual, db: Array) -> Dual:
    """Value v with derivatives a.d·da + b.d·db on the common prefix of directions."""
    m, k = len(a.d), len(b.d)
    if m >= k:
        d = a.d * da
        d[:k] += b.d * db
    else:
        d = b.d * db
        d[:m] += a.d * da
    return Dual(v, d)


def value(x: Value) -> Any:
    """The plain value of a float, array or Dual."""
    return x.v if isinstance(x, Dual) else x


def chain(v: Array, *terms: tuple[Array, Value]) -> Value:
    """A primitive's result: value v with dv = Σ ∂v/∂x · dx over `terms` = (∂v/∂x, x); plain x add nothing."""
    duals = [(g, x) for g, x in terms if isinstance(x, Dual)]
    if not duals:
        return v
    duals.sort(key=lambda t: -len(t[1].d))
    g, x = duals[0]
    d = x.d * g
    for g, x in duals[1:]:
        d[: len(x.d)] += x.d * g
    return Dual(v, d)


def locally(function: Callable[..., tuple[Value, ...]], *arguments: Value) -> tuple[Value, ...]:
    """function(*arguments), differentiated along its own arguments first and then chained to the directions
    of the pass: the cheaper way for a long formula of few arguments."""
    duals = [a for a in arguments if isinstance(a, Dual)]
    if not duals or max(len(a.d) for a in duals) <= len(duals):
        return function(*arguments)
    seeds = iter(np.eye(len(duals))[:, :, None] * np.ones(duals[0].v.size))
    results = function(*(Dual(a.v, next(seeds)) if isinstance(a, Dual) else a for a in arguments))
    return tuple(chain(r.v, *zip(r.d, duals, strict=True)) if isinstance(r, Dual) else r for r in results)


def exp(x: Value) -> Value:
    if isinstance(x, Dual):
        v = np.exp(x.v)
        return Dual(v, x.d * v)
    return np.exp(x)


def log(x: Value) -> Value:
    if isinstance(x, Dual):
        return Dual(np.log(x.v), x.d / x.v)
    return np.log(x)


def sqrt(x: Value) -> Value:
    if isinstance(x, Dual):
        v = np.sqrt(x.v)
        return Dual(v, x.d * (0.5 / v))
    return np.sqrt(x)


def power(x: Value, exponent: Value) -> Value:
    """x**exponent for x > 0; exponents 1 and 2 cost multiplications only."""
    v = value(x) ** value(exponent)
    if not isinstance(x, Dual) and not isinstance(exponent, Dual):
        return v
    terms: list[tuple[Array, Value]] = []
    if isinstance(x, Dual):
        square = np.ndim(value(exponent)) == 0 and value(exponent) == 2.0
        terms.append((2.0 * x.v if square else value(exponent) * (v / x.v), x))
    if isinstance(exponent, Dual):
        terms.append((v * np.log(value(x)), exponent))
    return chain(v, *terms)


def select(condition: Array, a: Value, b: Value) -> Value:
    """a where the condition holds, else b; derivatives follow the chosen side."""
    if not isinstance(a, Dual) and not isinstance(b, Dual):
        return np.where(condition, a, b)
    v = np.where(condition, value(a), value(b))
    m = max(len(x.d) for x in (a, b) if isinstance(x, Dual))
    d = np.zeros((m, v.size))
    if isinstance(a, Dual):
        d[: len(a.d)] += np.where(condition, a.d, 0.0)
    if isinstance(b, Dual):
        d[: len(b.d)] += np.where(condition, 0.0, b.d)
    return Dual(v, d)


def maximum(a: Value, b: Value) -> Value:
    return select(np.asarray(value(a) >= value(b)), a, b)


def minimum(a: Value, b: Value) -> Value:
    return select(np.asarray(value(a) <= value(b)), a, b)
