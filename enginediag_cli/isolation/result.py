"""What isolation hands over: the set, how sure, its rivals, the sizes.

How large the change of each isolated parameter is, with an interval.

Restricted estimate: Δθ_S = I_SS⁻¹ b_S with covariance I_SS⁻¹, the parameters outside S unchanged. The
interval is conditional on S being the right set.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from enginediag_cli.isolation.classes import Class
from enginediag_cli.residuals.score import Score


@dataclass(frozen=True)
class ParameterChange:
    """Estimated change of a parameter in its own unit, with standard error and interval.

    `nominal` is θ0; infinite bounds mean that the data do not determine this parameter within the set. `change`, its
    error and `reach`, by how much it may be larger, are given that it changed; where that is not sure the interval may
    end at no change.
    """

    parameter: str
    nominal: float
    change: float
    standard_error: float
    lower: float
    upper: float
    reach: float

    @property
    def percent(self) -> float:
        """Change in per cent of nominal; NaN where nominal is 0."""
        return 100 * self.change / self.nominal if self.nominal else float("nan")


def estimate_sizes(score: Score, names: Sequence[str], confidence: float = 0.95) -> tuple[ParameterChange, ...]:
    """Changes of `names` when nothing else changed, with two-sided intervals of level `confidence`."""
    from scipy.special import ndtri

    if not names:
        return ()
    a = score.indices(names)
    b, information = score.scaled()
    eigenvalues, vectors = np.linalg.eigh(information[np.ix_(a, a)])
    seen = eigenvalues > 1e-9 * max(float(np.max(np.diag(information))), 0.0)
    inverse = (vectors[:, seen] / eigenvalues[seen]) @ vectors[:, seen].T
    change = inverse @ b[a] * score.prior_sigma[a]
    error = np.sqrt(np.diag(inverse)) * score.prior_sigma[a]
    blind = np.any(np.abs(vectors[:, ~seen]) > 1e-3, axis=1)
    error = np.where(blind, np.inf, error)
    reach = -ndtri((1 - confidence) / 2) * error
    return tuple(
        ParameterChange(name, float(score.theta0[i]), float(d), float(se), float(d - r), float(d + r), float(r))
        for name, i, d, se, r in zip(names, a, change, error, reach, strict=True)
    )


@dataclass(frozen=True)
class Explanation:
    """A set of changed parameters with its probability (posterior) or p value (tests)."""

    parameters: tuple[str, ...]
    probability: float


@dataclass(frozen=True)
class IsolationResult:
    """Outcome of one isolation method.

    isolated: changed parameters, empty when none; probability that these changed and nothing else that matters
    (`averaging.least_that_matters`; NaN for methods without one); rivals: other sets that the data cannot exclude,
    likeliest first, which together with the answer hold `coverage`; rivals_left_out: how many more were not listed;
    inclusion: probability per parameter that it changed (empty for methods without one); sizes of the isolated
    parameters; complete: False when the method stopped at a limit before it was satisfied; note says why in plain
    words. one_of: the class of which the answer is the likeliest member, where these data cannot tell its members
    apart, or None. Sets that differ by the form of an instrument's error (bias, scale, drift) are one, named by the
    likeliest form; forms: of an isolated instrument the chance of each form, given that it is wrong.
    """

    method: str
    isolated: tuple[str, ...]
    probability: float
    rivals: tuple[Explanation, ...]
    rivals_left_out: int
    coverage: float
    inclusion: dict[str, float]
    sizes: tuple[ParameterChange, ...]
    complete: bool = True
    note: str = ""
    one_of: Class | None = None
    forms: Mapping[str, Mapping[str, float]] = field(default_factory=dict)
