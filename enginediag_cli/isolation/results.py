"""The result of isolation: the set, its probability, alternatives and sizes; ambiguity groups; whether the answer fits.

Sizes. Restricted estimate: Δθ_S = I_SS⁻¹ b_S with covariance I_SS⁻¹, the parameters outside S unchanged. The
interval is conditional on S being the right set.

Ambiguity groups. Explanations that the data cannot separate are one answer with several members. A set T is an
exchange for the leading set S where each holds something that the other does not. While the posterior odds of S over T
are below ODDS the data do not separate them. S and all such T form a group: what all of them hold is shared, what a set
holds besides is its member, and a member that contains another one is dropped. The group is the answer where S has less
than CONVINCED of its probability. A set that only adds to S or omits from it is no exchange: the question is then
whether there is more, not which it is.

Adequacy. Whether the answer fits, and the probability of the alternative "something that is not listed".

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

Fingerprint. The deviation of each reading from nominal and the deviation that a set of changes predicts, from local
statistics alone. Where every sensor's bias b_x is among the parameters, ∂y_x/∂b_x = 1, so that s_x = Σ r_x e_x and
F_xq = Σ r_x ∂y_x/∂θ_q with the weights r_x of sensor x, what is uncertain about nominal taken out. The weighted mean
of the deviation of a reading, and that which a change Δ predicts, are

    d_x = s_x / F_xx ,   var d_x = V_xx / F_xx² ,   f_x(Δ) = Σ_q F_xq Δ_q / F_xx

and the change of a set A of parameters that is likeliest, with its prior Δ_q ~ N(0, σ_q²), is
Δ_A = (F_Aᵀ V⁻¹ F_A + diag σ⁻²)⁻¹ F_Aᵀ V⁻¹ s with F_A the columns of A.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from enginediag_cli.detection.verdict import lack_of_fit
from enginediag_cli.intake.agreement import RecordingMismatch
from enginediag_cli.isolation.advice import ODDS
from enginediag_cli.isolation.prior import SetPrior
from enginediag_cli.isolation.subsets import enumerate_sets
from enginediag_cli.parameters import UNLISTED
from enginediag_cli.probability import log_mean
from enginediag_cli.residuals.instruments import NoiseLevel, level_of_ratio
from enginediag_cli.residuals.score import Score
from enginediag_cli.residuals.statistics import LocalStatistics

CONVINCED = 0.9
"""Share of its group from which the leading set is an answer of its own: odds of nine to one."""
MOST_MEMBERS = 8
"""Members listed, the most probable first; the probability of the group counts all."""


@dataclass(frozen=True)
class AmbiguityGroup:
    """Explanations that the data cannot separate.

    Attributes
    ----------
    members : tuple of tuple of str
        Sets of parameters (or components), the most probable first. One of them changed.
    shared : tuple of str
        What changed besides, whichever member is right.
    probability : float
        Posterior probability of all members together.
    members_omitted : int
        Further members, not listed.
    separating_sensors : tuple of str
        Columns of sensors that would separate the two leading members if they were recorded, the best first; empty
        where there is none, or where none was sought.
    """

    members: tuple[tuple[str, ...], ...]
    shared: tuple[str, ...]
    probability: float
    members_omitted: int = 0
    separating_sensors: tuple[str, ...] = ()

    def add_separating_sensors(self, sensors: Sequence[str]) -> AmbiguityGroup:
        """The same with the sensors that would separate its members."""
        return replace(self, separating_sensors=tuple(sensors))

    @property
    def leading_pair(self) -> tuple[tuple[str, ...], tuple[str, ...]]:
        """The two likeliest explanations as whole sets."""
        first, second = self.members[:2]
        return (*self.shared, *first), (*self.shared, *second)


def ambiguity_group(
    names: Sequence[str], masks: np.ndarray, probabilities: np.ndarray, answer: int = 0
) -> AmbiguityGroup | None:
    """The class of the `answer`-th set, the leading one, among sets (M, p) bool of `names` (p,), by falling probability
    (M,); None where that set is an answer of its own, or is empty."""
    own = float(probabilities[answer])
    near = int(np.searchsorted(-probabilities, -own / ODDS, side="right"))
    sets, leader = masks[:near], masks[answer]
    exchanged = (leader & ~sets).any(axis=1) & (sets & ~leader).any(axis=1)
    held = own + float(probabilities[:near][exchanged].sum())
    if not leader.any() or not exchanged.any() or own >= CONVINCED * held:
        return None
    chosen = sets[np.concatenate([[answer], np.flatnonzero(exchanged)])]
    shared = chosen.all(axis=0)
    rest = chosen & ~shared
    minimal = [row for row in rest if not any(_is_proper_subset(other, row) for other in rest)]
    told = [tuple(np.asarray(names, object)[row]) for row in minimal]
    return AmbiguityGroup(
        tuple(told[:MOST_MEMBERS]), tuple(np.asarray(names, object)[shared]), held, max(len(told) - MOST_MEMBERS, 0)
    )


def _is_proper_subset(inner: np.ndarray, outer: np.ndarray) -> bool:
    """Whether the set `inner` is a part of `outer` and not the whole."""
    return bool(np.all(outer | ~inner) and np.any(outer & ~inner))


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
class SetIsolation:
    """The outcome of one isolation method.

    Attributes
    ----------
    method : str
        Name of the method.
    isolated : tuple of str
        Parameters that changed; empty when none.
    probability : float
        Posterior probability that these changed and nothing else of relevance (`least_relevant_change`); NaN for a
        method that states none.
    alternatives : tuple of Explanation
        Other sets that the data do not exclude, the most probable first; with the answer they hold `coverage`.
    alternatives_omitted : int
        Further alternatives, not listed.
    coverage : float
        Total probability of answer and alternatives.
    inclusion : dict of str to float
        Probability of each parameter to have changed; empty for a method that states none.
    sizes : tuple of ParameterChange
        Changes of the isolated parameters.
    complete : bool
        False when the method stopped at a limit; `note` says at which.
    ambiguity : AmbiguityGroup or None
        The group whose most probable member is the answer, where the data cannot separate its members. Sets that
        differ by the form of an instrument's error (bias, scale, drift) are one, named by the most probable form.
    forms : mapping
        Of each isolated instrument the probability of each form of its error, given that it is wrong.
    """

    method: str
    isolated: tuple[str, ...]
    probability: float
    alternatives: tuple[Explanation, ...]
    alternatives_omitted: int
    coverage: float
    inclusion: dict[str, float]
    sizes: tuple[ParameterChange, ...]
    complete: bool = True
    note: str = ""
    ambiguity: AmbiguityGroup | None = None
    forms: Mapping[str, Mapping[str, float]] = field(default_factory=dict)


FREE = (0.5, 1.5, 5.0, 20.0)
"""Sizes of the free vector in widths of the prior: from what is hardly seen to what no component and no instrument
shows."""
PAIR = 2
"""Changes together that are looked at for one that is impossible: a fault and what trades against it."""
CERTAIN = 1e-3
"""p value below which there is an excess of χ² whose share can be stated."""


@dataclass(frozen=True)
class Adequacy:
    """Whether an answer fits, and the probability of something that is not listed.

    Attributes
    ----------
    fit, fit_before : float
        Reduced χ² with the answer, NaN where nothing is left to test it by, and without any answer.
    explained : float
        Share of the excess χ² that the answer explains; NaN where there is no significant excess.
    noise : float
        Factor of the noise variance by which the evidence was divided.
    unlisted : float
        Probability that the change is none of those listed.
    impossible_change : tuple of (str, float) or None
        Parameter and size of a change, of the answer or of the best fit without bounds, that is physically impossible.
    disagreement : Disagreement or None
        Of the recording with the engine, where that was accepted.
    """

    fit: float = float("nan")
    fit_before: float = float("nan")
    explained: float = float("nan")
    noise: float = 1.0
    unlisted: float = 0.0
    impossible_change: tuple[str, float] | None = None
    disagreement: RecordingMismatch | None = None

    @property
    def is_listed(self) -> bool:
        """Whether something listed is likelier than something that is not."""
        return self.unlisted < 0.5

    def include_disagreement(self, disagreement: RecordingMismatch | None) -> Adequacy:
        """The same where the file itself may be wrong: what is listed explains a right one only."""
        if disagreement is None:
            return self
        unlisted = 1.0 - (1.0 - disagreement.wrong_file) * (1.0 - self.unlisted)
        return replace(self, unlisted=unlisted, disagreement=disagreement)


def noise_level(score: Score, statistics: LocalStatistics) -> NoiseLevel:
    """Of the statistics of which `score` was made; as stated where there are no degrees of freedom to estimate it."""
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
    return float(log_mean(np.array(each)))


def residual_fit(score: Score, statistics: LocalStatistics, names: Sequence[str]) -> Adequacy:
    """What the changes of `names` leave unexplained; score: from `statistics`, or about the estimate of a large
    fault."""
    from scipy.special import chdtrc

    rest = lack_of_fit(statistics)
    explained, rank = _explained_chi2(score, names)
    freedom = statistics.dof - rank
    if freedom <= 0:
        return Adequacy()
    ratio = (rest.statistic + max(score.glr - explained, 0.0)) / freedom
    before = rest.statistic + score.glr
    share = float("nan")
    if statistics.dof > 0 and chdtrc(statistics.dof, before) < CERTAIN:
        share = 1.0 - max(ratio - 1.0, 0.0) * freedom / (before - statistics.dof)
    return Adequacy(ratio, before / statistics.dof, min(max(share, 0.0), 1.0))


def temper(score: Score, noise: float) -> Score:
    """The score with its evidence divided by the noise factor `noise`."""
    if noise == 1.0:
        return score
    return replace(score, b=score.b / noise, information=score.information / noise, glr=score.glr / noise)


def find_impossible_change(score: Score, prior: SetPrior) -> tuple[str, float] | None:
    """Of the one or two changes that would fit best without bounds the one that is farthest beyond what a component or
    an instrument can do, with its size; None where they are possible."""
    b, information = prior.scaled(score)
    widest = FREE[-1]
    masks, quadratic, log_det = enumerate_sets(
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


def _explained_chi2(score: Score, names: Sequence[str]) -> tuple[float, int]:
    """b_SᵀI_SS⁺b_S and the rank of I_SS."""
    if not names:
        return 0.0, 0
    a = score.indices(names)
    b, information = score.scaled()
    eigenvalues, vectors = np.linalg.eigh(information[np.ix_(a, a)])
    seen = eigenvalues > 1e-9 * max(float(np.max(np.diag(information))), 1e-300)
    return float(np.sum((b[a] @ vectors[:, seen]) ** 2 / eigenvalues[seen])), int(seen.sum())


@dataclass(frozen=True)
class Fingerprint:
    """Of m readings, named by the parameter that is their bias: deviation (m,) and standard error (m,) in the reading's
    unit, and what each of n sets of changes foretells (n, m)."""

    biases: tuple[str, ...]
    deviation: np.ndarray
    error: np.ndarray
    predicted: np.ndarray


def fingerprint(statistics: LocalStatistics, sets: Sequence[Sequence[str]] = ()) -> Fingerprint | None:
    """None where no sensor's bias is among the parameters, or one of `sets` holds a parameter that is not."""
    names, meaning = statistics.parameters, statistics.meaning
    rows = [
        i
        for i, name in enumerate(names)
        if name in meaning and meaning[name].belongs_to_sensor and meaning[name].quantity == BIAS
    ]
    rows = [i for i in rows if statistics.F[i, i] > 0]
    if not rows or any(name not in names for one in sets for name in one):
        return None
    weight = np.diag(statistics.F)[rows]
    foretold = [
        statistics.F[np.ix_(rows, _positions(names, one))] @ likeliest_change(statistics, one) / weight for one in sets
    ]
    return Fingerprint(
        tuple(names[i] for i in rows),
        statistics.s[rows] / weight,
        np.sqrt(np.diag(statistics.V)[rows]) / weight,
        np.array(foretold).reshape(len(sets), len(rows)),
    )


BIAS = "bias"
"""The error of a sensor that acts on its reading one to one."""


def likeliest_change(statistics: LocalStatistics, changed: Sequence[str]) -> np.ndarray:
    """The likeliest change (q,) of the parameters `changed`, in their units."""
    return restricted_change(statistics, changed)[0]


def restricted_change(statistics: LocalStatistics, changed: Sequence[str]) -> tuple[np.ndarray, np.ndarray]:
    """Estimate the change of some parameters, if these alone may have changed.

    Parameters
    ----------
    statistics : LocalStatistics
        Of p parameters.
    changed : sequence of str
        q parameters A.

    Returns
    -------
    change, standard_error : ndarray of shape (q,)
        In parameter units. The error is the root of the diagonal of (F_Aᵀ V⁻¹ F_A + diag σ⁻²)⁻¹.
    """
    places = _positions(statistics.parameters, changed)
    if not places:
        return np.zeros(0), np.zeros(0)
    scale = statistics.prior_sigma
    V = statistics.V * scale * scale[:, None]
    F = (statistics.F * scale * scale[:, None])[:, places]
    weighted = np.linalg.pinv(V, hermitian=True) @ F
    covariance = np.linalg.inv(F.T @ weighted + np.eye(len(places)))
    change = covariance @ weighted.T @ (statistics.s * scale)
    return change * scale[places], np.sqrt(np.diag(covariance)) * scale[places]


def _positions(names: Sequence[str], wanted: Sequence[str]) -> list[int]:
    return [names.index(name) for name in wanted]
