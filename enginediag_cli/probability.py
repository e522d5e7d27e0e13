"""The reach of a 95 % interval, written once, sums over hypotheses in logarithms of weights, and tails of χ² and F.

**Tail probabilities** of χ² and F, and the values that are exceeded with a given probability. The functions of
scipy.special of the same names, to 1e-12, for degrees of freedom up to `MOST`, as windows have them; beyond, or where
an argument is out of range, scipy.special itself is used. Importing it takes longer than judging a flight: a quarter of
the time in which a command starts.

    Q(a, x) = 1 − P(a, x),   P by its series for x < a + 1, Q by its continued fraction above
    I_x(a, b) by its continued fraction, from the side on which that converges fast

Source: W. H. Press et al., Numerical Recipes, 3rd ed. (2007), sections 6.2 and 6.4; continued fractions by the
modified Lentz method.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import lru_cache

import numpy as np

NORMAL_95 = 1.959964
"""Standard errors on either side of the mean that hold 95 % of a normal law: the quantile of 0.975, Φ⁻¹(0.975) =
1.959963984…, to seven digits. 95 % because that is what engineers quote."""

MOST = 2000.0
"""Degrees of freedom up to which the logarithms of Γ cost no more than two of the digits."""
ITERATIONS = 2000
"""No fraction or series below takes so many terms up to `MOST`."""
WEIGHTS = 500.0
"""Degrees of freedom up to which the first Poisson weight exp(−λ/2) of a sum that is needed is a number."""
TINY = 1e-300
"""In place of a denominator of zero in a continued fraction."""
EPSILON = 1e-16
"""Relative size of a term or correction that no longer counts."""
BEYOND = 1e3
"""Stands for the logarithm of a tail that is too small for a number."""
WIDEN = 1.5
"""Step of the search for values on either side of a quantile."""


def log_sum(log: np.ndarray, axis: int | None = None) -> np.ndarray:
    """Logarithm of the sum of exp(log) over `axis`, or over all where that is None; −inf of no weight at all."""
    most = np.max(log, axis=axis, keepdims=True)
    most = np.where(np.isfinite(most), most, 0.0)
    with np.errstate(divide="ignore"):
        found = np.log(np.sum(np.exp(log - most), axis=axis, keepdims=True)) + most
    return np.asarray(found.reshape(()) if axis is None else np.squeeze(found, axis))


def normalized_weights(log: np.ndarray, axis: int | None = 0) -> np.ndarray:
    """Weights exp(log) that sum to 1 over `axis`, or over all where that is None."""
    total = log_sum(log, axis)
    return np.asarray(np.exp(log - (total if axis is None else np.expand_dims(total, axis))))


def log_mean(log: np.ndarray, axis: int = 0) -> np.ndarray:
    """Logarithm of the mean of exp(log) over `axis`: evidence of hypotheses that are equally probable a priori."""
    return np.asarray(log_sum(log, axis) - np.log(np.shape(log)[axis]))


def chdtrc(dof: float, x: float) -> float:
    """Probability that χ²(dof) exceeds x."""
    if not (0.0 < dof <= MOST and 0.0 <= x < math.inf):
        from scipy import special

        return float(special.chdtrc(dof, x))
    return _upper_gamma(0.5 * dof, 0.5 * x)


@lru_cache(maxsize=256)
def chdtri(dof: float, probability: float) -> float:
    """The value that χ²(dof) exceeds with this probability; windows ask for the same again and again."""
    if not (0.0 < dof <= MOST and 1e-30 < probability < 0.9999):
        from scipy import special

        return float(special.chdtri(dof, probability))
    return _root(lambda x: chdtrc(dof, x), probability, dof)


def fdtrc(dof1: float, dof2: float, x: float) -> float:
    """Probability that F(dof1, dof2) exceeds x."""
    if not (0.0 < dof1 <= MOST and 0.0 < dof2 <= MOST and 0.0 <= x < math.inf):
        from scipy import special

        return float(special.fdtrc(dof1, dof2, x))
    return _beta(0.5 * dof2, 0.5 * dof1, dof2 / (dof2 + dof1 * x), dof1 * x / (dof2 + dof1 * x))


def fdtri(dof1: float, dof2: float, probability: float) -> float:
    """The value that F(dof1, dof2) stays below with this probability."""
    if not (0.0 < dof1 <= MOST and 0.0 < dof2 <= MOST and 1e-4 < probability < 1.0 - 1e-15):
        from scipy import special

        return float(special.fdtri(dof1, dof2, probability))
    return _root(lambda x: fdtrc(dof1, dof2, x), 1.0 - probability, 1.0)


def noncentral_chdtrc(dof: float, noncentrality: float, x: float) -> float:
    """Probability that χ²(dof; λ) exceeds x: Σ_j Poisson(j; λ/2) Q(dof/2 + j, x/2), with the recurrence

    Q(a + 1, x) = Q(a, x) + x^a e^(−x)/Γ(a + 1)
    """
    mean, half, a = 0.5 * noncentrality, 0.5 * x, 0.5 * dof
    upper, step = chdtrc(dof, x), math.exp(a * math.log(half) - half - math.lgamma(a + 1.0)) if half else 0.0
    weight = math.exp(-mean)
    total, left = weight * upper, 1.0 - weight
    for j in range(1, ITERATIONS):
        upper, step = upper + step, step * half / (a + j)
        weight *= mean / j
        total, left = total + weight * upper, left - weight
        if j > mean and (left < EPSILON or weight < EPSILON):
            break
    return min(total, 1.0)


@lru_cache(maxsize=1024)
def noncentrality_for_power(dof: float, x: float, probability: float) -> float:
    """λ at which χ²(dof; λ) exceeds x with this probability; 0 where it does so without."""
    if dof > WEIGHTS or x > 2.0 * WEIGHTS:
        from scipy import special

        return max(float(special.chndtrinc(x, dof, 1.0 - probability)), 0.0)
    if chdtrc(dof, x) >= probability:
        return 0.0
    return _root(lambda value: 1.0 - noncentral_chdtrc(dof, value, x), 1.0 - probability, x)


def _upper_gamma(a: float, x: float) -> float:
    """Q(a, x)."""
    if x == 0.0:
        return 1.0
    exponent = a * math.log(x) - x - math.lgamma(a)
    if x < a + 1.0:
        term = total = 1.0 / a
        for k in range(1, ITERATIONS):
            term *= x / (a + k)
            total += term
            if term < EPSILON * total:
                break
        return 1.0 - total * math.exp(exponent)
    b = x + 1.0 - a
    c, d = 1.0 / TINY, 1.0 / b
    h = d
    for k in range(1, ITERATIONS):
        numerator = -k * (k - a)
        b += 2.0
        d = 1.0 / (numerator * d + b or TINY)
        c = b + numerator / c or TINY
        h *= d * c
        if abs(d * c - 1.0) <= EPSILON:
            break
    return h * math.exp(exponent)


def _beta(a: float, b: float, x: float, rest: float) -> float:
    """I_x(a, b) with rest = 1 − x."""
    if x <= 0.0 or rest <= 0.0:
        return 0.0 if x <= 0.0 else 1.0
    front = math.exp(math.lgamma(a + b) - math.lgamma(a) - math.lgamma(b) + a * math.log(x) + b * math.log(rest))
    if x < (a + 1.0) / (a + b + 2.0):
        return front * _beta_fraction(a, b, x) / a
    return 1.0 - front * _beta_fraction(b, a, rest) / b


def _beta_fraction(a: float, b: float, x: float) -> float:
    c, d = 1.0, 1.0 / (1.0 - (a + b) * x / (a + 1.0) or TINY)
    h = d
    for m in range(1, ITERATIONS):
        even = m * (b - m) * x / ((a + 2 * m - 1.0) * (a + 2 * m))
        odd = -(a + m) * (a + b + m) * x / ((a + 2 * m) * (a + 2 * m + 1.0))
        for numerator in (even, odd):
            d = 1.0 / (1.0 + numerator * d or TINY)
            c = 1.0 + numerator / c or TINY
            h *= d * c
        if abs(d * c - 1.0) <= EPSILON:
            break
    return h


def _root(tail: Callable[[float], float], probability: float, guess: float) -> float:
    """Where the falling function `tail` is `probability`: a bracket around the guess, then false position on ln tail
    (Illinois rule), halved where that is slow."""

    def surplus(x: float) -> float:
        q = tail(x)
        return math.log(q / probability) if q > 0.0 else -BEYOND

    low = high = guess
    f_low = f_high = surplus(guess)
    while f_high > 0.0:
        low, f_low, high = high, f_high, high * WIDEN
        f_high = surplus(high)
    while f_low <= 0.0:
        high, f_high, low = low, f_low, low / WIDEN
        f_low = surplus(low)
    kept = 0  # how often in a row the same end stayed
    while high - low > 4e-16 * high:
        width = high - low
        x = low + width * f_low / (f_low - f_high) if abs(kept) < 4 else 0.5 * (low + high)
        x = x if low < x < high else 0.5 * (low + high)
        f = surplus(x)
        if f == 0.0 or x in (low, high):
            return x
        if f > 0.0:
            low, f_low = x, f
            kept = max(kept, 0) + 1
            f_high *= 0.5 if kept > 1 else 1.0
        else:
            high, f_high = x, f
            kept = min(kept, 0) - 1
            f_low *= 0.5 if kept < -1 else 1.0
    return 0.5 * (low + high)
