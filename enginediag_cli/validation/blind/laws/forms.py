"""Forms of concealed laws: some of the grammar that a search tries, and more that it does not have.

In a form's text x and y stand for variables, x0 and y0 for what they are at the design point, u and v for both less a
place within the records over a width, s for u kept within −1 and 1. What stands there is taken to be 0 at the design
point and multiplied by the law's size a.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from enginediag_cli.mismatch.laws.grammar import FORMS, Form, span
from enginediag_cli.mismatch.laws.scan import Known
from enginediag_cli.physics.laws.expression import Expression

INSIDE = (0.1, 0.9)
"""Quantiles of a variable over the records between which a place lies."""
WIDTH = (0.2, 0.8)
"""Widths of a form, over the range of its variable, from and to, evenly in the logarithm."""
SATURATION = (0.5, 6.0)
"""b of x²/(1 + b x²), from and to, evenly in the logarithm: x is 1 at the design point."""
SHARE = (0.3, 1.0)
"""Of a second form in a sum, from and to; of either sign."""
ODD = (-3, -1, 1, 3)
"""Exponents of a sum of powers."""
DIGITS = 5
"""Of the numbers in a formula; those that make it 0 at the design point have all."""

SINE = "s * (1 - s ** 2) * (3.14159 - 2.0094 * s ** 2 + 0.4386 * s ** 4)"
"""sin πs over −1 ≤ s ≤ 1, to 0.2 %: its zeros, its slopes there and its peaks."""

OUTSIDE: Mapping[str, str] = {
    "sine": SINE,
    "odd bump": "u ** 3 * exp(-u ** 2)",
    "flat bump": "exp(-max(u, -u) ** 3)",
    "rational": "x ** 2 / (1 + b * x ** 2)",
    "ramp": "min(max(u, -1), 1)",
    "uneven step": "exp(-exp(-u))",
    "growth": "exp(u)",
    "step and slope": "tanh(u) + q * u",
    "bump and slope": "exp(-u ** 2) + q * u",
    "cubic": "u ** 3 - u",
    "Runge": "1 / (1 + u ** 2)",
    "odd powers": "x ** n + q * y ** m",
    "saddle": "u * v / (1 + max(u * v, -u * v))",
    "ratio with offset": "x / (1 + b * y)",
    "Keijzer 12": "u ** 4 - u ** 3 + v ** 2 / 2 - v",
    "Keijzer 14": "1 / (2 + u ** 2 + v ** 2)",
    "Keijzer 15": "u ** 3 / 5 + v ** 3 / 2 - v - u",
    "Pagie": "u ** 4 / (1 + u ** 4) + v ** 4 / (1 + v ** 4)",
    "Kotanchek": "exp(-u ** 2) / (1.2 + v ** 2)",
}
"""Forms that no grammar holds, by name; of two variables where y or v stands in them. Those with the name of a person
are of lists on which others have tried symbolic regression: C. Runge (1901); M. Keijzer, EuroGP (2003) 70–82; L. Pagie,
P. Hogeweg, Evol. Comput. 5 (1997) 401–418; E. Vladislavleva et al., IEEE Trans. Evol. Comput. 13 (2009) 333–349."""
RATIOS = ("rational", "odd powers", "ratio with offset")
"""Those whose variables must be above 0."""


@dataclass(frozen=True)
class Shaped:
    """A form with numbers in it: `text` in the names of its variables and the size a, `outside` the grammar or not."""

    name: str
    outside: bool
    text: str


def of_grammar(of: Sequence[Known], rng: np.random.Generator) -> Shaped:
    """A form that the search has, with a shape that it need not try."""
    pairs = len(of) == 2
    static = (f for f in FORMS if not f.remembers)  # marks compare curves over what variables are
    usable = [f for f in static if f.pairs == pairs and not (f.ratios and _recorded(of))]
    form = usable[int(rng.integers(len(usable)))]
    return Shaped(form.name, False, _written(form.text, of, _shape(form, of, rng)))


def of_none(of: Sequence[Known], rng: np.random.Generator) -> Shaped:
    """A form that the grammar does not have."""
    pairs = len(of) == 2
    usable = [n for n, t in OUTSIDE.items() if _pairs(t) == pairs and not (n in RATIOS and _recorded(of))]
    name = usable[int(rng.integers(len(usable)))]
    text = re.sub(r"\bs\b", "max(min(u, 1), -1)", OUTSIDE[name])
    letters = {n: draw(rng) for n, draw in _LETTERS.items()}
    for letter, known in zip("uv", of, strict=False):
        along = "xy"["uv".index(letter)]
        place, width = _place(known, rng), _width(known, rng)
        text = re.sub(rf"\b{letter}\b", f"(({along} - {place:.{DIGITS}g}) / {width:.{DIGITS}g})", text)
    text = _written(text, of, letters)
    names = {k.variable.name: k.variable.reference for k in of}
    there = float(np.asarray(Expression.parsed(text).at(names)))
    return Shaped(name, True, f"a * ({text} - ({there!r}))")


def _shape(form: Form, of: Sequence[Known], rng: np.random.Generator) -> dict[str, str]:
    """Numbers for a grammar's letters, between the least and the largest that a search begins with."""
    found = {}
    for s in form.shapes:
        tries = s.tries(of[s.of].values)
        low, high = min(tries), max(tries)
        drawn = np.exp(rng.uniform(np.log(low), np.log(high))) if low > 0.0 else rng.uniform(low, high)
        found[s.letter] = f"{drawn:.{DIGITS}g}"
    return found


_LETTERS: Mapping[str, Callable[[np.random.Generator], str]] = {
    "b": lambda rng: f"{np.exp(rng.uniform(*np.log(SATURATION))):.{DIGITS}g}",
    "q": lambda rng: f"({rng.choice((-1, 1)) * rng.uniform(*SHARE):.{DIGITS}g})",
    "n": lambda rng: f"({int(rng.choice(ODD))})",
    "m": lambda rng: f"({int(rng.choice(ODD))})",
}
"""Letter of a form outside the grammar → the number in its place."""


def _place(x: Known, rng: np.random.Generator) -> float:
    return float(np.quantile(x.values, rng.uniform(*INSIDE)))


def _width(x: Known, rng: np.random.Generator) -> float:
    return float(span(x.values) * np.exp(rng.uniform(*np.log(WIDTH))))


def _written(text: str, of: Sequence[Known], letters: Mapping[str, str]) -> str:
    """With variables by their names and letters by their numbers."""
    by = {letter: k.variable for letter, k in zip("xy", of, strict=False)}
    words = dict(letters) | {n: v.name for n, v in by.items()} | {f"{n}0": f"{v.reference!r}" for n, v in by.items()}
    return re.sub(r"\b[a-z]\d?\b", lambda m: words.get(m[0], m[0]), text)


def _pairs(text: str) -> bool:
    return bool(re.search(r"\b[yv]\b", text))


def _recorded(of: Sequence[Known]) -> bool:
    return any(k.variable.recorded for k in of)
