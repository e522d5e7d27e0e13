"""What is asked of a refinement before it may be written, each criterion a fact with its numbers.

- `Significance`, by the flights that are fitted: the effect's coefficients differ from those of its absence, by Wald's
  test given the whole error model (noise correlated in time; amounts of map error and offsets marginalised) and by
  stretches of records.
- `Prediction`, by the unseen flights jointly: their χ² falls at the point prediction, in the same covariance for both,
  so that doubt gains nothing. With the predicted change d and what is left without the effect e, the readings ask for
  the share α = dᵀV⁻¹e/dᵀV⁻¹d of it: χ² falls by (2α − 1) dᵀV⁻¹d, and it is asked that α be above ½ significantly.
- For an effect that switches without a column showing it, `Prediction` is of the records where it is on, and so is a
  second one, `CONTRAST`, of on against off with every instrument's zero of every flight left free.

The log predictive density is told, but decides nothing: a wider prediction may gain by it alone.

Sources: A. Wald, Trans. Am. Math. Soc. 54 (1943) 426–482; F. X. Diebold and R. S. Mariano, J. Bus. Econ. Stat. 13
(1995) 253–263 (comparing predictions whose errors are correlated in time).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from enum import Enum

import numpy as np
from scipy import stats

from enginediag_cli.mismatch.fit.stretches import TINY

LEVEL = 0.05
"""Of each criterion: the usual one. All must be met."""
LEAST_STRETCHES = 8.0
"""Independent stretches below which their scatter says little of an error, and the error model alone, with noise as
large as the flights show, must do. Judgement: a variance from eight is known to a half."""
BETTER = 0.5
"""Share of the predicted change from which χ² falls."""
POWER = 0.8
"""Probability with which a right change must be seen before not seeing it refuses: the usual one."""


class Verdict(Enum):
    """What becomes of a refinement."""

    ACCEPTED = "accepted"
    REFUSED = "refused"
    NOT_JUDGED = "cannot be judged"


@dataclass(frozen=True)
class Significance:
    """Of one effect's k coefficients: Wald's statistic by the error model, with noise `dispersion` times as large where
    the flights show so, and by `effective` independent stretches, where they are enough; the smaller counts."""

    label: str
    coefficients: int
    by_model: float
    dispersion: float
    by_stretches: float
    effective: float

    @property
    def p(self) -> float:
        k = self.coefficients
        by_model = float(stats.chi2.sf(self.by_model / max(self.dispersion, 1.0), k))
        if self.effective - k < LEAST_STRETCHES:
            return by_model
        return max(by_model, float(stats.f.sf(self.by_stretches / k, k, self.effective - k)))

    @property
    def met(self) -> bool:
        return self.p < LEVEL


class Records(Enum):
    """Which records of the unseen flights a prediction is judged by."""

    ALL = "all"
    ON = "where it is on"
    CONTRAST = "on against off"


@dataclass(frozen=True)
class Prediction:
    """`share` α of the predicted change that unseen readings ask for; `information` dᵀV⁻¹d, in which the fall of χ² is
    (2α − 1); `dispersion` of what is left at that share, 1 where V is right; `by_stretches`: standard error of α by
    `effective` independent stretches of `length` records; `records` that tell of it."""

    of: Records
    share: float
    information: float
    dispersion: float
    by_stretches: float
    effective: float
    length: int
    records: int

    @property
    def fall(self) -> float:
        """Of χ² in the baseline's covariance."""
        return (2.0 * self.share - 1.0) * self.information

    @property
    def by_model(self) -> float:
        """Standard error of the share by the error model, noise as large as the flights show."""
        return float(np.sqrt(max(self.dispersion, 1.0) / self.information)) if self.information > 0.0 else np.inf

    @property
    def standard_error(self) -> float:
        """Of the share, the larger of both where there are enough stretches."""
        return max(self.by_model, self.by_stretches) if self._enough else self.by_model

    @property
    def told(self) -> bool:
        """Whether the flights would show a change that is right, α = 1, with probability POWER."""
        return self._surprise(1.0 - float(stats.norm.ppf(POWER)) * self.standard_error) < LEVEL

    @property
    def p(self) -> float:
        """Probability of such a share by chance where χ² does not fall."""
        return self._surprise(self.share)

    @property
    def met(self) -> bool | None:
        """None: these flights cannot tell."""
        return True if self.p < LEVEL else (False if self.told else None)

    @property
    def _enough(self) -> bool:
        return self.effective >= LEAST_STRETCHES

    def _surprise(self, share: float) -> float:
        if not self.information > 0.0:
            return 1.0
        over = share - BETTER
        p = float(stats.norm.sf(over / self.by_model))
        if self._enough:
            p = max(p, float(stats.t.sf(over / max(self.by_stretches, TINY), self.effective - 1.0)))
        return p


Criterion = Significance | Prediction


def verdict(criteria: Sequence[Criterion]) -> Verdict:
    """One that is not met refuses; else one that cannot be judged leaves it open."""
    if any(c.met is False for c in criteria):
        return Verdict.REFUSED
    return Verdict.ACCEPTED if criteria and all(c.met for c in criteria) else Verdict.NOT_JUDGED
