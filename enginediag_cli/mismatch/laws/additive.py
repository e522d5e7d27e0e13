"""All smooth curves of a variable, or all sums of one of each of two, as one thing that a law may be.

    f = Σ_v Σ_k a_vk s_k(x_v)        a_vk ~ N(0, σ²)        s_k: steps (`steps`), of any number and σ
    f = Σ_v Σ_i α_vi q_i(x_v)        α_vi ~ N(0, A_v² ρⁱ)   q_i: polynomials (`polynomials`), of any A and ρ

both kinds as likely beforehand. What all of them say is averaged by their evidence: that errs less than the likeliest
of them, and of kinds that err each in its own way less than of one. In a linear twin of the search (maps that may err
by 0.3 %, 109 laws of one variable of forms that no list holds) steps leave 19 beyond noise, polynomials 27, both
together 13, and the likeliest of all listed forms and curves 16.

Source: T. Hastie, R. Tibshirani, Generalized Additive Models (1990), chapter 4.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from enginediag_cli.mismatch.laws.linear import Linear, ln_mean
from enginediag_cli.mismatch.laws.polynomials import Polynomials
from enginediag_cli.mismatch.laws.posterior import shares
from enginediag_cli.mismatch.laws.said import Says
from enginediag_cli.mismatch.laws.scan import KnownVariable
from enginediag_cli.mismatch.laws.steps import formula_of, steps_over, tried_of

THE_SAME = 0.1
"""Non-centrality at which two curves are one."""


@dataclass(frozen=True)
class Additive:
    """The average of smooth curves of variables, or of sums of them: `sizes` of as many steps of each as it takes, of
    which `count` are along most of it; `evidence`: ln, of all, against the fit without the law that is carried."""

    of: tuple[KnownVariable, ...]
    count: int
    sizes: tuple[np.ndarray, ...]
    evidence: float

    @property
    def curve(self) -> np.ndarray:
        """Over the records (N,)."""
        each = [steps_over(k, self.count) @ a for k, a in zip(self.of, self.sizes, strict=True)]
        return np.asarray(np.sum(each, axis=0))

    @property
    def text(self) -> str:
        """Its formula."""
        return " + ".join(formula_of(k, self.count, a) for k, a in zip(self.of, self.sizes, strict=True))


def additive_of(says: Says, of: Sequence[KnownVariable]) -> Additive:
    """Of what a place says of curves of one variable, or of two."""
    tried = tried_of(says, of)
    kinds: list[list[Linear]] = [[*tried.values()], [Polynomials.of(of).at(says, float(np.std(says.f)))]]
    likely = [np.concatenate([t.evidence for t in kind]) for kind in kinds]
    curves = np.concatenate([t.curves for kind in kinds for t in kind])
    # of a kind that has many choices each is less likely beforehand
    weight = shares([e for own in likely for e in own - np.log(len(own))])
    counts = sorted({n for each in tried for n in each})
    evidence = says.gain + ln_mean([ln_mean(own) for own in likely])
    return Additive(tuple(of), *_fewest(says, of, counts, weight @ curves), evidence)


def _fewest(
    says: Says, of: Sequence[KnownVariable], counts: Sequence[int], curve: np.ndarray
) -> tuple[int, tuple[np.ndarray, ...]]:
    """How many steps are the fewest that a curve (N,) cannot be told from, and their sizes of each variable; else the
    most."""
    for count in counts:
        each = [steps_over(k, count) for k in of]
        steps = np.hstack(each)
        sizes = np.linalg.lstsq(steps, curve, rcond=None)[0]
        if says.any.apart(steps @ sizes, curve) < THE_SAME:
            break
    return count, tuple(np.split(sizes, np.cumsum([e.shape[1] for e in each])[:-1]))
