"""The forms that a law may have. To add one, add it to FORMS: nothing else lists them.

In a form's text x and y stand for variables, x0 and y0 for what they are at the design point, a for the amplitude,
which is sought; other letters are its shape. Every form is 0 at the design point, and bounded where its variables are.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from enginediag_cli.physics.laws.expression import Expression

WITHIN = (0.1, 0.3, 0.5, 0.7, 0.9)
"""Quantiles of a variable over the records at which a form may have its place."""
WIDTHS = (0.25, 1.0)
"""Widths of a form, of the range that its variable has in the records (5 to 95 %)."""
EXPONENTS = (-3.0, -2.0, -1.0, -0.5, 0.5, 2.0, 3.0)
"""Of a ratio. One near 0 is the logarithm, 1 the straight line."""

Tries = Callable[[np.ndarray], tuple[float, ...]]


@dataclass(frozen=True)
class Shape:
    """One letter of a form; `tries`: values to begin with, of a variable's values in the records (N,); `share`: its
    prior standard deviation, of the variable's range or, with `of_range` not set, as it stands."""

    letter: str
    tries: Tries
    share: float
    of_range: bool = True


@dataclass(frozen=True)
class Form:
    """`text` of one or two variables; `ratios`: they must be above 0; `weight`: prior, of all forms."""

    name: str
    words: str
    text: str
    shapes: tuple[Shape, ...] = ()
    ratios: bool = False
    weight: float = 1.0

    @property
    def expression(self) -> Expression:
        return Expression.parsed(self.text)

    @property
    def pairs(self) -> bool:
        """Whether it is of two variables."""
        return "y" in self.expression.names


def span(x: np.ndarray) -> float:
    """The range of a variable (N,) in the records."""
    low, high = np.nanquantile(x, [0.05, 0.95])
    return float(high - low)


def _places(x: np.ndarray) -> tuple[float, ...]:
    return tuple(float(v) for v in np.nanquantile(x, WITHIN))


def _widths(x: np.ndarray) -> tuple[float, ...]:
    return tuple(w * span(x) for w in WIDTHS)


PLACE = Shape("c", _places, 0.5)
WIDTH = Shape("w", _widths, 0.5)
EXPONENT = Shape("n", lambda x: EXPONENTS, 1.0, of_range=False)

FORMS = (
    Form("linear", "in proportion to", "a * (x - x0)", weight=4.0),
    Form("logarithm", "as the logarithm of", "a * ln(x)", ratios=True, weight=3.0),
    Form("power", "as a power of", "a * (x ** n - 1)", (EXPONENT,), ratios=True, weight=3.0),
    Form("optimum", "as a parabola about an optimum of", "a * ((x - c) ** 2 - (x0 - c) ** 2)", (PLACE,)),
    Form("approach", "levelling off with", "a * (exp(-x0 / w) - exp(-x / w))", (WIDTH,)),
    Form("above", "beyond a threshold of", "a * (max(x - c, 0) - max(x0 - c, 0))", (PLACE,)),
    Form("below", "below a threshold of", "a * (min(x - c, 0) - min(x0 - c, 0))", (PLACE,)),
    Form("step", "as a smooth step in", "a * (tanh((x - c) / w) - tanh((x0 - c) / w))", (PLACE, WIDTH)),
    Form("bump", "near one value of", "a * (exp(-((x - c) / w) ** 2) - exp(-((x0 - c) / w) ** 2))", (PLACE, WIDTH)),
    Form("both", "as the product of what moves", "a * (x - x0) * (y - y0)"),
    Form("product", "as the product of", "a * (x * y - x0 * y0)"),
    Form("quotient", "as the quotient of", "a * (x / y - 1)", ratios=True),
)
"""What a law may be, simple forms first."""
