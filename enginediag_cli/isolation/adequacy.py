"""Does the answer fit? What it leaves unexplained, and whether changes of its size can be.

With the set S of the answer, b_S, I_SS its score and information, and χ²_rest what no parameter explains,

    χ²(S) = χ²_rest + bᵀI⁺b − b_SᵀI_SS⁺b_S ~ χ²(measurements − rank I_SS),    ĉ = χ²(S)/freedom.

Before any answer it is χ²(∅) per measurement, and of its excess over chance the answer explains
1 − (χ²(S) − freedom)/(χ²(∅) − measurements).

ĉ is 1 when the set is right and the model and its noise are too. Where ĉ of all parameters together is larger for
certain, and by more than noise that was estimated explains, no set is right and evidence is divided by its lower bound:
b/ĉ, I/ĉ,
the quasi-likelihood of P. McCullagh and J. A. Nelder, Generalized Linear Models, 2nd ed. (1989), chapter 9. Intervals
widen by √ĉ and probabilities come nearer to the prior. (ĉ of a set that is too small would hold what it lacks against
the larger one.)

A model that is wrong can also be bent until it fits. Then ĉ is near 1 and the changes tell. With δ̃ the mean of the
changes under the widest slab w of large faults, which keeps small what the data do not show, the answer is not believed
where the k parameters of the engine have

    Σ (δ̃/w)² > χ²(k) at CERTAIN,    or an efficiency rises by more than w.

A sensor may be wrong by anything.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from enginediag_cli.detection.lack_of_fit import lack_of_fit
from enginediag_cli.isolation.sizes import estimate_sizes
from enginediag_cli.residuals.score import Score
from enginediag_cli.residuals.statistics import LocalStatistics

CERTAIN = 1e-3
"""p value below which a lack of fit is certain."""
LARGE = 4.0
"""χ² per degree of freedom up to which probabilities stay as they are: readings are missed by twice the noise. Models
with generic maps leave 2 to 4 and name the right components."""
LIMIT = 6.0
"""χ² per degree of freedom beyond which no answer stands, whatever its probability: 6 to 10 speak of the structure of
the model rather than of its noise (K. P. Burnham and D. R. Anderson, Model Selection and Multimodel Inference, 2nd ed.
(2002), section 2.5)."""
CONVINCING = 0.5
"""Least probability, after the evidence was divided by ĉ, of an answer that stands."""
WIDEST = 5.0
"""The widest slab of large faults in prior_sigma: 10 % where prior_sigma is 2 %."""
DETERMINED = 0.5
"""Standard error, in widest slabs, up to which the data count as determining a change."""


@dataclass(frozen=True)
class Adequacy:
    """`fit` = ĉ after the answer (NaN where nothing is left to test it by) with its p value; `least`: ĉ is no less, for
    certain (a few independent readings say little of it). before: χ² per degree of freedom without any answer;
    explained: what the answer takes away of its excess over chance, NaN where there is none for certain.

    dispersion: by what the evidence was divided, 1 where the model fits; misfit: the answer does not stand because
    of ĉ; beyond: parameter and size of the change because of which it does not stand, or None.
    """

    fit: float = float("nan")
    p_value: float = float("nan")
    least: float = float("nan")
    before: float = float("nan")
    explained: float = float("nan")
    dispersion: float = 1.0
    misfit: bool = False
    beyond: tuple[str, float] | None = None

    @property
    def gross(self) -> bool:
        """Whether the lack of fit is certain and large."""
        return bool(self.least > LARGE)

    @property
    def stands(self) -> bool:
        return not self.misfit and self.beyond is None


def fit_after(score: Score, statistics: LocalStatistics, names: Sequence[str]) -> Adequacy:
    """What the changes of `names` leave unexplained.

    score: from `statistics`, or about the estimate of a large fault. Where noise was estimated, A₂/rank of the score's
    doubt is the squared error of the logarithm of its variance, 2/ν, and ĉ has the F(freedom, ν) distribution.
    """
    from scipy.special import chdtrc, chdtri, fdtrc, fdtri

    rest = lack_of_fit(statistics)
    explained, rank = _explained(score, names)
    freedom = statistics.dof - rank
    if freedom <= 0:
        return Adequacy()
    ratio = (rest.statistic + max(score.glr - explained, 0.0)) / freedom
    doubt = score.doubt[1] / score.rank if score.rank else 0.0
    if doubt > 0:
        p, chance = fdtrc(freedom, 2 / doubt, ratio), fdtri(freedom, 2 / doubt, 1.0 - CERTAIN)
    else:
        p, chance = chdtrc(freedom, ratio * freedom), chdtri(freedom, CERTAIN) / freedom
    before = rest.statistic + score.glr
    share = float("nan")
    if statistics.dof > 0 and chdtrc(statistics.dof, before) < CERTAIN:
        share = 1.0 - max(ratio - 1.0, 0.0) * freedom / (before - statistics.dof)
    return Adequacy(ratio, float(p), float(ratio / chance), before / statistics.dof, min(max(share, 0.0), 1.0))


def dispersed(found: Adequacy) -> Adequacy:
    """`found` with what its fit makes of the evidence: divided by the least ĉ where the lack of fit is gross."""
    return replace(found, dispersion=found.least) if found.gross else found


def tempered(score: Score, dispersion: float) -> Score:
    """The score with its evidence divided by `dispersion`."""
    return replace(
        score, b=score.b / dispersion, information=score.information / dispersion, glr=score.glr / dispersion
    )


def judged(found: Adequacy, score: Score, names: Sequence[str], probability: float) -> Adequacy:
    """`found` with what speaks against the answer `names`, which has `probability`; no change always stands."""
    if not names:
        return found
    misfit = found.gross and (found.fit > LIMIT or probability < CONVINCING)
    return replace(found, misfit=misfit, beyond=_not_believed(score, names))


def _not_believed(score: Score, names: Sequence[str]) -> tuple[str, float] | None:
    """The change of the engine that makes the answer incredible, with its size, if there is one."""
    from scipy.special import chdtrc

    a = score.indices(names)
    parameters = [score.described[i] for i in a]
    engine = np.array([not p.of_instrument for p in parameters])
    if not engine.any():
        return None
    b, information = score.scaled()
    held = np.linalg.solve(information[np.ix_(a, a)] + np.eye(len(a)) / WIDEST**2, b[a]) / WIDEST
    sizes = estimate_sizes(score, names)
    scale = WIDEST * score.prior_sigma[a]
    determined = np.array([size.standard_error for size in sizes]) < DETERMINED * scale
    change = np.where(determined, np.array([size.change for size in sizes]) / scale, held)
    rise = np.where([p.wear < 0 for p in parameters], change, 0.0)
    k = int(np.argmax(rise))
    if rise[k] <= 1:
        if chdtrc(int(engine.sum()), float(np.sum(held[engine] ** 2))) >= CERTAIN:
            return None
        k = int(np.argmax(np.where(engine, np.abs(held), 0.0)))
    return names[k], sizes[k].change


def _explained(score: Score, names: Sequence[str]) -> tuple[float, int]:
    """b_SᵀI_SS⁺b_S and the rank of I_SS."""
    if not names:
        return 0.0, 0
    a = score.indices(names)
    b, information = score.scaled()
    eigenvalues, vectors = np.linalg.eigh(information[np.ix_(a, a)])
    seen = eigenvalues > 1e-9 * max(float(np.max(np.diag(information))), 1e-300)
    return float(np.sum((b[a] @ vectors[:, seen]) ** 2 / eigenvalues[seen])), int(seen.sum())
