"""The forms that a law may have. To add one, add it to FORMS: nothing else lists them.

In a form's text x and y stand for variables, x0 and y0 for what they are at the design point, a for the amplitude,
which is sought; other letters are its shape. Every form is 0 at the design point, bounded where its variables are, and
smooth: a threshold has a width, since Newton's method stalls at a kink.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from enginediag_cli.physics.laws.expression import Expression

WITHIN = (0.1, 0.3, 0.5, 0.7, 0.9)
"""Quantiles of a variable over the records at which a form may have its place."""
WITHIN_OF_TWO = (0.3, 0.7)
"""The same of a form of two variables: there are many of them, and a fit moves what it begins with."""
WIDTHS = (0.25, 1.0)
"""Widths of a form, of the range that its variable has in the records (5 to 95 %)."""
TURNS = (0.05, 0.3)
"""Widths of a threshold, likewise: sharp and gradual."""
WIDTH_OF_TWO = (0.4,)
"""Of a form of two variables, likewise."""
EDGES_OF_STEPS = (0.02, 0.98)
"""Quantiles of a variable over the records between which the steps of a smooth curve lie."""
NARROWEST, WIDEST = 0.02, 5.0
"""Widths may be, likewise: less lies between two records, more is a straight line."""
OUTSIDE = 0.5
"""How far a place may lie outside what was flown, likewise: from there on no record tells where it is."""
EXPONENTS = (-3.0, -2.0, -1.0, -0.5, 0.5, 2.0, 3.0)
"""Of a ratio. One near 0 is the logarithm, 1 the straight line."""
EXPONENTS_OF_TWO = (-1.5, -0.5, 0.5, 1.5)
"""Of two ratios that are multiplied: over small ranges only how they are to each other matters."""
STEEPEST = 6.0
"""Exponents may be: more grows beyond all bounds where nobody flew."""
HALVES = (0.3, 1.0, 3.0)
"""Values of a ratio at which what saturates is half of all."""
LEAST_HALF, MOST_HALF = 0.02, 20.0
"""Of those: nothing that varies, and a straight line."""

Tries = Callable[[np.ndarray], tuple[float, ...]]
Bounds = Callable[[np.ndarray], tuple[float, float]]


def span(x: np.ndarray) -> float:
    """The range of a variable (N,) in the records."""
    low, high = np.nanquantile(x, [0.05, 0.95])
    return float(high - low)


@dataclass(frozen=True)
class Shape:
    """One letter of a form; `tries`: values to begin with, of a variable's values in the records (N,), which are also
    where its prior lies; `share`: the standard deviation of that, of the variable's range or, with `of_range` not set,
    as it stands; `bounds`: how far it may go."""

    letter: str
    tries: Tries
    share: float
    bounds: Bounds
    of_range: bool = True

    def sigma(self, x: np.ndarray) -> float:
        """The prior's standard deviation."""
        return self.share * (span(x) if self.of_range else 1.0)

    def centre(self, x: np.ndarray) -> float:
        """The prior's mean."""
        return float(np.mean(self.tries(x)))


@dataclass(frozen=True)
class Form:
    """`text` of one or two variables; `ratios`: they must be above 0; `weight`: prior, of all forms; `turned`: another
    law with its two variables exchanged."""

    name: str
    words: str
    text: str
    shapes: tuple[Shape, ...] = ()
    ratios: bool = False
    weight: float = 1.0
    turned: bool = False

    @property
    def expression(self) -> Expression:
        return Expression.parsed(self.text)

    @property
    def listed(self) -> bool:
        """Whether it has a formula of its own; a curve of steps has none."""
        return bool(self.text)

    @property
    def pairs(self) -> bool:
        """Whether it is of two variables."""
        return "y" in self.expression.names


def _place(within: tuple[float, ...]) -> Shape:
    def tries(x: np.ndarray) -> tuple[float, ...]:
        return tuple(float(v) for v in np.nanquantile(x, within))

    return Shape("c", tries, 0.5, _near)


def _near(x: np.ndarray) -> tuple[float, float]:
    return float(np.nanmin(x)) - OUTSIDE * span(x), float(np.nanmax(x)) + OUTSIDE * span(x)


def _width(shares: tuple[float, ...]) -> Shape:
    def tries(x: np.ndarray) -> tuple[float, ...]:
        return tuple(w * span(x) for w in shares)

    def bounds(x: np.ndarray) -> tuple[float, float]:
        return NARROWEST * span(x), WIDEST * span(x)

    return Shape("w", tries, 0.5, bounds)


def _exponent(letter: str, tries: tuple[float, ...]) -> Shape:
    return Shape(letter, lambda x: tries, 2.0, lambda x: (-STEEPEST, STEEPEST), of_range=False)


PLACE, PLACE_OF_TWO = _place(WITHIN), _place(WITHIN_OF_TWO)
WIDTH, TURN, WIDE = _width(WIDTHS), _width(TURNS), _width(WIDTH_OF_TWO)
EXPONENT = _exponent("n", EXPONENTS)
BOTH_EXPONENTS = (_exponent("n", EXPONENTS_OF_TWO), _exponent("m", EXPONENTS_OF_TWO))
HALF = Shape("k", lambda x: HALVES, 1.5, lambda x: (LEAST_HALF, MOST_HALF), of_range=False)

STEP = "(tanh((x - c) / w) - tanh((x0 - c) / w))"
BUMP = "(exp(-((x - c) / w) ** 2) - exp(-((x0 - c) / w) ** 2))"
TURNING = "(sqrt((x - c) ** 2 + w ** 2) - sqrt((x0 - c) ** 2 + w ** 2))"
"""A hyperbola, |x − c| with a width: with ±(x − x0) it is straight on one side of c and constant on the other."""

OF_TWO = (PLACE_OF_TWO, WIDE)
AS_A_STEP = "as a smooth step in the first"
BEYOND, BELOW = "beyond a threshold of the first", "below a threshold of the first"
THE_MORE = "the more the larger the second, of"

FORMS = (
    Form("linear", "in proportion to", "a * (x - x0)", weight=4.0),
    Form("logarithm", "as the logarithm of", "a * ln(x)", ratios=True, weight=3.0),
    Form("power", "as a power of", "a * (x ** n - 1)", (EXPONENT,), ratios=True, weight=3.0),
    Form("optimum", "as a parabola about an optimum of", "a * ((x - c) ** 2 - (x0 - c) ** 2)", (PLACE,)),
    Form("approach", "levelling off with", "a * (1 - exp((x0 - x) / w))", (WIDTH,)),
    Form("saturation", "saturating with", "a * (x / (x + k) - 1 / (1 + k))", (HALF,), ratios=True),
    Form("above", "beyond a threshold of", f"a * (x - x0 + {TURNING})", (PLACE, TURN)),
    Form("below", "below a threshold of", f"a * (x - x0 - {TURNING})", (PLACE, TURN)),
    Form("step", "as a smooth step in", f"a * {STEP}", (PLACE, WIDTH)),
    Form("bump", "near one value of", f"a * {BUMP}", (PLACE, WIDTH)),
    Form("both", "as the product of what moves of", "a * (x - x0) * (y - y0)"),
    Form("by", f"as the first, {THE_MORE}", "a * (x - x0) * y", turned=True),
    Form("product", "as the product of", "a * (x * y - x0 * y0)"),
    Form("quotient", "as the quotient of", "a * (x / y - 1)", ratios=True, turned=True),
    Form("powers", "as the product of powers of", "a * (x ** n * y ** m - 1)", BOTH_EXPONENTS, ratios=True),
    Form("step_by", f"{AS_A_STEP}, {THE_MORE}", f"a * {STEP} * y", OF_TWO, weight=0.5, turned=True),
    Form("bump_by", f"near one value of the first, {THE_MORE}", f"a * {BUMP} * y", OF_TWO, weight=0.5, turned=True),
    Form("above_by", f"{BEYOND}, {THE_MORE}", f"a * (x - x0 + {TURNING}) * y", OF_TWO, weight=0.5, turned=True),
    Form("below_by", f"{BELOW}, {THE_MORE}", f"a * (x - x0 - {TURNING}) * y", OF_TWO, weight=0.5, turned=True),
)
"""What a law may be, simple forms first."""
