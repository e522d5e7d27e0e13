"""The forms that a law may have. To add one, add it to FORMS: nothing else lists them.

In a form's text x and y stand for variables, x0 and y0 for what they are at the design point, a for the amplitude,
which is sought; other letters are its shape. Every form is 0 at the design point, bounded where its variables are, and
smooth: a threshold has a width, since Newton's method stalls at a kink.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from enginediag_cli.physics.law import Expression

WITHIN = (0.1, 0.3, 0.5, 0.7, 0.9)
"""Quantiles of a variable over the records at which a form may have its place."""
FINELY = tuple(np.linspace(0.05, 0.95, 10))
"""The same of a threshold that is passed now and then."""
WITHIN_OF_TWO = (0.3, 0.7)
"""The same of a form of two variables, of which there are many: shapes are sought from there."""
WIDTHS = (0.25, 1.0)
"""Widths of a form, of the range that its variable has in the records (5 to 95 %)."""
TURNS = (0.05, 0.3)
"""Widths of a threshold, likewise: sharp and gradual."""
SHARPLY = (0.03, 0.15)
"""Of a switch, which is sharp or gradual."""
WIDTH_OF_TWO = (0.4,)
"""Of a form of two variables, likewise."""
FINER_WIDTHS = (0.12, 0.4)
"""The same where forms of few variables are tried."""
EDGES_OF_STEPS = (0.02, 0.98)
"""Quantiles of a variable over the records between which the steps of a smooth curve lie."""
NARROWEST, WIDEST = 0.02, 5.0
"""Widths may be, likewise: less lies between two records, more is a straight line."""
FARTHEST = 3.0
"""How far the value of a variable at which a product with it is nothing may lie outside, likewise: from there on it
hardly varies."""
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
SECONDS, LONG, LONGEST = (10.0, 60.0, 300.0), 200.0, 5000.0
"""Time constants that a lag may have, and times that a limited rate takes over a variable's range, s: what metal and
actuators take; the standard deviation of their prior, and what they are at most."""
PLAY, MOST_PLAY = (0.03, 0.08, 0.2), 0.6
"""Of a switch, half of what it takes to switch back, of the range that its variable has in the records."""
LEAST_HALF, MOST_HALF = 0.02, 20.0
"""Of those: nothing that varies, and a straight line."""

_parsed = lru_cache(maxsize=None)(Expression.parse)

Tries = Callable[[np.ndarray], tuple[float, ...]]
Bounds = Callable[[np.ndarray], tuple[float, float]]
Over = Callable[[np.ndarray], float]


def span(x: np.ndarray) -> float:
    """The range of a variable (N,) in the records."""
    low, high = np.nanquantile(x, [0.05, 0.95])
    return float(high - low)


def as_it_stands(x: np.ndarray) -> float:
    """Of a shape that no variable's range says anything of."""
    return 1.0


@dataclass(frozen=True)
class Shape:
    """One letter of a form; `tries`: values to begin with, of a variable's values in the records (N,), which are also
    where its prior lies; `share`: the standard deviation of that, in what `over` makes of these, the variable's range;
    `bounds`: how far it may go; `of`: which of a form's variables it is of; `finer`: more values to begin with, where
    few forms are tried; `unit`: it is none of the variable's."""

    letter: str
    tries: Tries
    share: float
    bounds: Bounds
    over: Over = span
    of: int = 0
    finer: Tries | None = None
    unit: str = "1"

    def sigma(self, x: np.ndarray) -> float:
        """The prior's standard deviation."""
        return self.share * self.over(x)

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
        return _parsed(self.text)

    @property
    def listed(self) -> bool:
        """Whether it has a formula of its own; a curve of steps has none."""
        return bool(self.text)

    @property
    def remembers(self) -> bool:
        """Whether it follows a variable along time."""
        return self.listed and bool(self.expression.memory_calls)

    @property
    def pairs(self) -> bool:
        """Whether it is of two variables."""
        return "y" in self.expression.names


def _place(
    within: tuple[float, ...], letter: str = "c", of: int = 0, finer: tuple[float, ...] | None = WITHIN
) -> Shape:
    def at(shares: tuple[float, ...]) -> Tries:
        return lambda x: tuple(float(v) for v in np.nanquantile(x, shares))

    return Shape(letter, at(within), 0.5, _near, of=of, finer=at(finer) if finer else None)


def _zero() -> Shape:
    """The value of the second variable at which a product with it is nothing."""

    def tries(x: np.ndarray) -> tuple[float, ...]:
        low, middle, high = np.nanquantile(x, [0.05, 0.5, 0.95])
        return tuple(float(v) for v in (2.0 * low - high, middle, 2.0 * high - low))

    def bounds(x: np.ndarray) -> tuple[float, float]:
        return float(np.nanmin(x)) - FARTHEST * span(x), float(np.nanmax(x)) + FARTHEST * span(x)

    return Shape("d", tries, 1.0, bounds, of=1)


def _near(x: np.ndarray) -> tuple[float, float]:
    return float(np.nanmin(x)) - OUTSIDE * span(x), float(np.nanmax(x)) + OUTSIDE * span(x)


def _of_span(shares: tuple[float, ...]) -> Tries:
    return lambda x: tuple(w * span(x) for w in shares)


def _width(shares: tuple[float, ...], letter: str = "w", of: int = 0, finer: tuple[float, ...] | None = None) -> Shape:
    def bounds(x: np.ndarray) -> tuple[float, float]:
        return NARROWEST * span(x), WIDEST * span(x)

    return Shape(letter, _of_span(shares), 0.5, bounds, of=of, finer=_of_span(finer) if finer else None)


def _exponent(letter: str, tries: tuple[float, ...]) -> Shape:
    return Shape(letter, lambda x: tries, 2.0, lambda x: (-STEEPEST, STEEPEST), as_it_stands)


PLACE, PLACE_OF_TWO = _place(WITHIN), _place(WITHIN_OF_TWO)
SWITCHED = _place(FINELY, finer=None)
SHARP = _width(SHARPLY)
WIDTH, TURN, WIDE = _width(WIDTHS), _width(TURNS), _width(WIDTH_OF_TWO, finer=FINER_WIDTHS)
EXPONENT = _exponent("n", EXPONENTS)
BOTH_EXPONENTS = (_exponent("n", EXPONENTS_OF_TWO), _exponent("m", EXPONENTS_OF_TWO))
HALF = Shape("k", lambda x: HALVES, 1.5, lambda x: (LEAST_HALF, MOST_HALF), as_it_stands)


def _seconds() -> Shape:
    return Shape("t", lambda x: SECONDS, LONG, lambda x: (0.0, LONGEST), as_it_stands, unit="s")


def _slowness() -> Shape:
    """Seconds for the variable's range, over that."""

    def tries(x: np.ndarray) -> tuple[float, ...]:
        return tuple(t / span(x) for t in SECONDS)

    return Shape("s", tries, LONG, lambda x: (0.0, LONGEST / span(x)), lambda x: 1.0 / span(x), unit="s")


def _play() -> Shape:
    """Half of what lies between where it switches on the way up and on the way down."""
    return Shape("h", _of_span(PLAY), 0.2, lambda x: (0.0, MOST_PLAY * span(x)))


PLAYING = (SWITCHED, SHARP, _play())


DRAGGED = "backlash(x, h)"
"""A variable with a play."""


def _moved(text: str) -> str:
    """What a text is, less what it is at the design point, where a variable with a play is what it is itself."""
    there = re.sub(r"\b[xy]\b", lambda m: f"{m[0]}0", text.replace(DRAGGED, "x"))
    return f"({text} - {there})"


TANH, PEAK = "tanh((x - c) / w)", "exp(-((x - c) / w) ** 2)"
HYPERBOLA = "sqrt((x - c) ** 2 + w ** 2)"
"""|x − c| with a width: with ±(x − x0) it is straight on one side of c and constant on the other."""
RAMP_UP, RAMP_DOWN = f"(x - c + {HYPERBOLA})", f"(x - c - {HYPERBOLA})"
STEP, BUMP, TURNING, WAVE = _moved(TANH), _moved(PEAK), _moved(HYPERBOLA), _moved(f"(x - c) / w * {PEAK}")
ROOT_UP, ROOT_DOWN = _moved(f"sqrt{RAMP_UP}"), _moved(f"sqrt(-{RAMP_DOWN})")
"""What flows through an opening that a pressure begins to hold open."""
LATCH = f"tanh(({DRAGGED} - h - c) / w)"
SWITCH = _moved(LATCH)
"""Off below c on the way down, and on from c + 2h on the way up: each has a letter of its own that it is told by."""
ON_THE_WAY_UP = _moved(f"(1 - {LATCH}) * (1 + {TANH})")
ON_THE_WAY_DOWN = _moved(f"(1 + {LATCH}) * (1 - tanh((x - c - 2 * h) / w))")
"""Between c and c + 2h, after coming from below, or from above."""
STEPS = _moved(f"{TANH} * tanh((y - d) / v)")
SPOT = _moved("exp(-((x - c) / w) ** 2 - ((y - d) / v) ** 2)")
DISTANCE = _moved("sqrt(((x - c) / w) ** 2 + ((y - d) / v) ** 2 + 1)")
CROSSED = _moved("tanh((x - c) / w * ((y - d) / v))")


def _ramps(first: str, second: str) -> str:
    """The product of what each of two variables does beyond (+) or below (-) a threshold of it."""
    u, v = "(x - c) / w", "(y - d) / v"
    return _moved(f"({u} {first} sqrt(({u}) ** 2 + 1)) * ({v} {second} sqrt(({v}) ** 2 + 1))")


def _from(of_first: str) -> str:
    """What the first variable does, times how far the second is from a value of it."""
    return _moved(f"{of_first} * (y - d)")


OF_TWO = (PLACE_OF_TWO, WIDE)
FROM = (*OF_TWO, _zero())
"""Shapes of a form of the first variable that is multiplied by how far the second is from a value of it."""
WIDE_OF_SECOND = _width(WIDTH_OF_TWO, "v", 1, FINER_WIDTHS)
EACH = (*OF_TWO, _place(WITHIN_OF_TWO, "d", 1), WIDE_OF_SECOND)
"""Shapes of a form that has a place and a width of each."""
OF_BOTH = (*OF_TWO, _place((0.5,), "d", 1, None), WIDE_OF_SECOND)
"""Shapes of a form of a weighted sum, whose one place c and d say together."""
AS_A_STEP, NEAR_ONE = "as a smooth step in the first", "near one value of the first"
BEYOND, BELOW = "beyond a threshold of the first", "below a threshold of the first"
FROM_A_VALUE = "the more the farther the second is from one value, of"
BELOW_SECOND, PRODUCT = "below one of the second", "in proportion to the product of"
HOW_FAR = "how far each is from a value of it, of"
THE_MORE = "the more the larger the second, of"


def _of_a_group(name: str, words: str, text: str) -> Iterator[Form]:
    """What one variable does as z, done by a weighted sum and by a weighted difference of two: by a group of them that
    nobody has formed."""
    for group, sign in (("sum", "+"), ("difference", "-")):
        of_both = _moved(re.sub(r"\bz\b", f"((x - c) / w {sign} (y - d) / v)", text))
        yield Form(f"{name}_of_{group}", f"{words} a weighted {group} of", f"a * {of_both}", OF_BOTH, weight=0.25)


def _selected() -> Iterator[Form]:
    """The higher, or the lower, of two straight lines, each of a variable, both rising, or the second falling."""
    for group, (own, other) in (("rising", "+-"), ("opposed", "-+")):
        lines = f"(x - c) / w {own} (y - d) / v"
        apart = f"sqrt(((x - c) / w {other} (y - d) / v) ** 2 + 1)"
        for word, sign in (("higher", "+"), ("lower", "-")):
            text = _moved(f"({lines} {sign} {apart})")
            yield Form(
                f"{word}_{group}", f"as the {word} of two lines, {group}, in", f"a * {text}", OF_BOTH, weight=0.25
            )


SWITCHING = Form("switch", "as a switch with hysteresis in", f"a * {SWITCH}", PLAYING, weight=0.5)
FORMS = (
    Form("linear", "in proportion to", "a * (x - x0)", weight=4.0),
    Form("logarithm", "as the logarithm of", "a * ln(x)", ratios=True, weight=3.0),
    Form("power", "as a power of", "a * (x ** n - 1)", (EXPONENT,), ratios=True, weight=3.0),
    Form("optimum", "as a parabola about an optimum of", "a * ((x - c) ** 2 - (x0 - c) ** 2)", (PLACE,)),
    Form("approach", "levelling off with", "a * (1 - exp((x0 - x) / w))", (WIDTH,)),
    Form("saturation", "saturating with", "a * (x / (x + k) - 1 / (1 + k))", (HALF,), ratios=True),
    Form("above", "beyond a threshold of", f"a * (x - x0 + {TURNING})", (PLACE, TURN)),
    Form("below", "below a threshold of", f"a * (x - x0 - {TURNING})", (PLACE, TURN)),
    Form("root_above", "as the root beyond a threshold of", f"a * {ROOT_UP}", (PLACE, TURN), weight=0.5),
    Form("root_below", "as the root below a threshold of", f"a * {ROOT_DOWN}", (PLACE, TURN), weight=0.5),
    Form("step", "as a smooth step in", f"a * {STEP}", (PLACE, WIDTH)),
    Form("bump", "near one value of", f"a * {BUMP}", (PLACE, WIDTH)),
    Form("wave", "as a wave about one value of", f"a * {WAVE}", (PLACE, WIDTH), weight=0.5),
    Form("valley", "by the distance from one value of", f"a * {TURNING}", (PLACE, TURN)),
    Form("lagged", "with a lag, in proportion to", "a * (lagged(x, t) - x0)", (_seconds(),), weight=0.5),
    Form("limited", "at a limited rate, in proportion to", "a * (limited(x, s, s) - x0)", (_slowness(),), weight=0.5),
    SWITCHING,
    Form("both", "as the product of what moves of", "a * (x - x0) * (y - y0)"),
    Form("by", f"as the first, {THE_MORE}", "a * (x - x0) * y", turned=True),
    Form("product", "as the product of", "a * (x * y - x0 * y0)"),
    Form("quotient", "as the quotient of", "a * (x / y - 1)", ratios=True, turned=True),
    Form("powers", "as the product of powers of", "a * (x ** n * y ** m - 1)", BOTH_EXPONENTS, ratios=True),
    Form("step_by", f"{AS_A_STEP}, {THE_MORE}", f"a * {STEP} * y", OF_TWO, weight=0.5, turned=True),
    Form("bump_by", f"{NEAR_ONE}, {THE_MORE}", f"a * {BUMP} * y", OF_TWO, weight=0.5, turned=True),
    Form("above_by", f"{BEYOND}, {THE_MORE}", f"a * (x - x0 + {TURNING}) * y", OF_TWO, weight=0.5, turned=True),
    Form("below_by", f"{BELOW}, {THE_MORE}", f"a * (x - x0 - {TURNING}) * y", OF_TWO, weight=0.5, turned=True),
    Form("step_from", f"{AS_A_STEP}, {FROM_A_VALUE}", f"a * {_from(TANH)}", FROM, weight=0.5, turned=True),
    Form("bump_from", f"{NEAR_ONE}, {FROM_A_VALUE}", f"a * {_from(PEAK)}", FROM, weight=0.5, turned=True),
    Form("above_from", f"{BEYOND}, {FROM_A_VALUE}", f"a * {_from(RAMP_UP)}", FROM, weight=0.5, turned=True),
    Form("below_from", f"{BELOW}, {FROM_A_VALUE}", f"a * {_from(RAMP_DOWN)}", FROM, weight=0.5, turned=True),
    Form("steps", "as the product of smooth steps in", f"a * {STEPS}", EACH, weight=0.5),
    Form("spot", "near one point of", f"a * {SPOT}", EACH, weight=0.5),
    Form("distance", "by the distance from one point of", f"a * {DISTANCE}", EACH, weight=0.5),
    Form("crossed", f"as a smooth step in the product of {HOW_FAR}", f"a * {CROSSED}", EACH, weight=0.5),
    Form("above_above", f"beyond a threshold of each, {PRODUCT}", f"a * {_ramps('+', '+')}", EACH, weight=0.25),
    Form("below_below", f"below a threshold of each, {PRODUCT}", f"a * {_ramps('-', '-')}", EACH, weight=0.25),
    Form(
        "above_below",
        f"{BEYOND} and {BELOW_SECOND}, {PRODUCT}",
        f"a * {_ramps('+', '-')}",
        EACH,
        weight=0.25,
        turned=True,
    ),
    *_selected(),
    *_of_a_group("root_above", "as the root beyond a threshold of", "sqrt(z + sqrt(z ** 2 + 1))"),
    *_of_a_group("root_below", "as the root below a threshold of", "sqrt(sqrt(z ** 2 + 1) - z)"),
    *_of_a_group("step", "as a smooth step in", "tanh(z)"),
    *_of_a_group("bump", "near one value of", "exp(-z ** 2)"),
    *_of_a_group("above", "beyond a threshold of", "(z + sqrt(z ** 2 + 1))"),
    *_of_a_group("below", "below a threshold of", "(z - sqrt(z ** 2 + 1))"),
)
"""What a law may be, simple forms first."""

RISING = Form("rising", "on the way up between two values of", f"a * {ON_THE_WAY_UP}", PLAYING, weight=0.5)
FALLING = Form("falling", "on the way down between two values of", f"a * {ON_THE_WAY_DOWN}", PLAYING, weight=0.5)
LATCHES = (SWITCHING, RISING, FALLING)
"""What a switch may do whose states say where its thresholds lie: without these the last two are not sought."""
