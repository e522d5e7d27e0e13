"""Does the answer fit, and what if nothing that is listed is it: the alternative "something that is not listed".

Noise. With χ²_rest what no parameter explains, of f degrees of freedom, and its ratio r = χ²_rest/f,

    ln r ~ N(ln v, s²),   s² = 2/f + 2/ν

where v is the factor by which the variance of the noise is larger than stated and 2/ν, of noise that was estimated, the
squared error of the logarithm of its variance (A₂/rank of the score's doubt). Where the model is right v is near 1,
ln v ~ N(0, KNOWN²), and evidence is divided by what it then is most likely (b/v, I/v: the quasi-likelihood of P.
McCullagh and J. A. Nelder, Generalized Linear Models, 2nd ed. (1989), chapter 9). Where something is missing that moves
readings in a way of its own, v may be anything up to LARGEST.

Readings. What is not listed may as well look like all suspects at once, by any amounts and beyond all bounds: a free
vector δ ~ N(0, w²D²) of everything that is watched, w one of FREE. A listed set explains the same with fewer numbers,
and is likelier by what these cost, if it explains it.

The posterior. With Z = Σ_S P(S) p(data | S) over all listed sets, that of no change included, E that of the free
vector, both against no change, and ℓ(v) the likelihood of r where noise is as stated, ℓ(U) where it may be anything,

    P(not listed | data) ∝ UNLISTED · ⅓ [ℓ(U) Z + ℓ(v) E + ℓ(U) E],     P(listed | data) ∝ (1 − UNLISTED) ℓ(v) Z

so that an answer whose reduced χ² stays at 4 is improbable however far it is ahead of the other listed ones. The share
of the excess χ² that an answer takes away is 1 − (χ²(S) − freedom)/(χ²(∅) − measurements).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from enginediag_cli.detection.verdict import lack_of_fit
from enginediag_cli.faults.chances import UNLISTED
from enginediag_cli.intake.agreement import Disagreement
from enginediag_cli.isolation.posterior import all_sets
from enginediag_cli.isolation.prior import SetPrior
from enginediag_cli.isolation.result import estimate_sizes
from enginediag_cli.residuals.instruments import NoiseLevel, level_of_ratio
from enginediag_cli.residuals.score import Score
from enginediag_cli.residuals.statistics import LocalStatistics

FREE = (0.5, 1.5, 5.0, 20.0)
"""Sizes of the free vector in widths of the prior: from what is hardly seen to what no component and no instrument
shows."""
PAIR = 2
"""Changes together that are looked at for one that is impossible: a fault and what trades against it."""
CERTAIN = 1e-3
"""p value below which there is an excess of χ² whose share can be stated."""


@dataclass(frozen=True)
class Adequacy:
    """`fit`: χ² per degree of freedom after the answer, NaN where nothing is left to test it by; before: without any
    answer; explained: what the answer takes away of the excess over chance, NaN where there is none for certain.

    noise: by what the evidence was divided; unlisted: probability that it is something that is not listed; beyond:
    parameter and size of a change of the answer, or of what would fit best without bounds, that is impossible.
    disagreement: of the recording with the engine, where that was accepted.
    """

    fit: float = float("nan")
    before: float = float("nan")
    explained: float = float("nan")
    noise: float = 1.0
    unlisted: float = 0.0
    beyond: tuple[str, float] | None = None
    disagreement: Disagreement | None = None

    @property
    def stands(self) -> bool:
        """Whether something listed is likelier than something that is not."""
        return self.unlisted < 0.5

    def of_file(self, disagreement: Disagreement | None) -> Adequacy:
        """The same where the file itself may be wrong: what is listed explains a right one only."""
        if disagreement is None:
            return self
        unlisted = 1.0 - (1.0 - disagreement.wrong_file) * (1.0 - self.unlisted)
        return replace(self, unlisted=unlisted, disagreement=disagreement)


def noise_level(score: Score, statistics: LocalStatistics) -> NoiseLevel:
    """Of the statistics of which `score` was made; as stated where nothing is left to tell it by."""
    rest = lack_of_fit(statistics)
    if not rest.dof > 0 or not rest.consistent or not rest.ratio > 0:
        return NoiseLevel()
    return level_of_ratio(rest.ratio, rest.dof, score.doubt[1] / score.rank if score.rank else 0.0)


def probability_of_unlisted(level: NoiseLevel, log_listed: float, log_free: float) -> float:
    """P(not listed | data); log_listed: ln Z of all listed sets; log_free: ln E."""
    stated, anything = level.log_stated, level.log_anything
    several = np.logaddexp.reduce([anything + log_listed, stated + log_free, anything + log_free]) - np.log(3)
    odds = np.log(UNLISTED) - np.log1p(-UNLISTED) + several - stated - log_listed
    return float(1 / (1 + np.exp(-np.clip(odds, -700.0, 700.0))))


def log_of_free_vector(score: Score, prior: SetPrior) -> float:
    """ln E: marginal likelihood of all suspects off at once, without bounds, against no change."""
    b, information = prior.scaled(score)
    each = []
    for size in FREE:
        A = np.eye(len(b)) + size**2 * information
        each.append(0.5 * size**2 * float(b @ np.linalg.solve(A, b)) - 0.5 * float(np.linalg.slogdet(A)[1]))
    return float(np.logaddexp.reduce(each) - np.log(len(each)))


def fit_after(score: Score, statistics: LocalStatistics, names: Sequence[str]) -> Adequacy:
    """What the changes of `names` leave unexplained; score: from `statistics`, or about the estimate of a large
    fault."""
    from scipy.special import chdtrc

    rest = lack_of_fit(statistics)
    explained, rank = _explained(score, names)
    freedom = statistics.dof - rank
    if freedom <= 0:
        return Adequacy()
    ratio = (rest.statistic + max(score.glr - explained, 0.0)) / freedom
    before = rest.statistic + score.glr
    share = float("nan")
    if statistics.dof > 0 and chdtrc(statistics.dof, before) < CERTAIN:
        share = 1.0 - max(ratio - 1.0, 0.0) * freedom / (before - statistics.dof)
    return Adequacy(ratio, before / statistics.dof, min(max(share, 0.0), 1.0))


def tempered(score: Score, noise: float) -> Score:
    """The score with its evidence divided by `noise`."""
    if noise == 1.0:
        return score
    return replace(score, b=score.b / noise, information=score.information / noise, glr=score.glr / noise)


def beyond_bounds(score: Score, prior: SetPrior) -> tuple[str, float] | None:
    """Of the one or two changes that would fit best without bounds the one that is farthest beyond what a component or
    an instrument can do, with its size; None where they are possible."""
    b, information = prior.scaled(score)
    widest = FREE[-1]
    masks, quadratic, log_det = all_sets(
        widest * b[None], np.eye(len(b)) + widest**2 * information[None], min(PAIR, len(b))
    )
    a = np.flatnonzero(masks[int(np.argmax(quadratic[0] - log_det[0]))])
    if not a.size:
        return None
    low, high = prior.bounds([score.described[i] for i in a])
    change = np.array([size.change for size in estimate_sizes(score, [score.parameters[i] for i in a])])
    ratio = change / score.prior_sigma[a]
    over = np.where(ratio > 0, ratio / high, ratio / low)
    k = int(np.argmax(over))
    return (score.parameters[a[k]], float(change[k])) if over[k] > 1 else None


def _explained(score: Score, names: Sequence[str]) -> tuple[float, int]:
    """b_SᵀI_SS⁺b_S and the rank of I_SS."""
    if not names:
        return 0.0, 0
    a = score.indices(names)
    b, information = score.scaled()
    eigenvalues, vectors = np.linalg.eigh(information[np.ix_(a, a)])
    seen = eigenvalues > 1e-9 * max(float(np.max(np.diag(information))), 1e-300)
    return float(np.sum((b[a] @ vectors[:, seen]) ** 2 / eigenvalues[seen])), int(seen.sum())
