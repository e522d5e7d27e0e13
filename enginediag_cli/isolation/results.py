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
vector δ ~ N(0, w²D²) of everything that is watched, w one of FREE_SIZES. A listed set explains the same with fewer
numbers, and is likelier by what these cost, if it explains it.

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

Advice. At which operating condition, with which further sensor or on which flight alternative hypotheses separate
soonest. If the set A changed by Δ, the best account by the set B instead falls short, over records of information I, by

    λ = Δᵀ (I_AA − I_AB I_BB⁺ I_BA) Δ,

the non-centrality of the likelihood ratio between the two sets; n further records of information G each raise the
expected log odds of A over B by ½ [λ(I + nG) − λ(I)]. The advice is for the least favourable Δ of those that the
data allow, and for the less favourable of "A is true" and "B is true". A set that contains the other cannot lose
to it by this measure; then only the larger one being true counts. The gain is λ(n) of `planned_flights`, for what B
predicts when it is fitted to what A has shown so far, and may adapt within what is known of it and of nominal.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from itertools import permutations
from typing import Any

import numpy as np

from enginediag_cli.detection.verdict import lack_of_fit
from enginediag_cli.intake.agreement import RecordingMismatch
from enginediag_cli.isolation.planned_flights import (
    BEYOND,
    Outlook,
    Separation,
    Suggestion,
    best_first,
    fewest,
    flights,
)
from enginediag_cli.isolation.prior import SetPrior
from enginediag_cli.isolation.subsets import enumerate_sets
from enginediag_cli.parameters import UNLISTED
from enginediag_cli.probability import log_mean
from enginediag_cli.residuals.instruments import NoiseLevel, NoiseModel, level_of_ratio
from enginediag_cli.residuals.monitor import Monitor
from enginediag_cli.residuals.score import Score
from enginediag_cli.residuals.statistics import LocalStatistics, covariance_root, whiten

ODDS = 20.0
"""Odds to one from which explanations count as separated: those of a 95 % test."""
ALLOWED = 0.8
"""Probability of the changes among which the least favourable is sought."""
MOST_RECORDS = 100_000
"""More records than any recording has: reported as “never”."""
FREE = 1e-10
"""Share of the largest information of a set below which a direction of it counts as unknown."""
LEADING = 4
"""Sets that flights are to separate, the most probable first. Judgement."""
POINTS = 24
"""Records by which a flight is judged: its course has a few corners."""
COMPUTED = 0.8
"""Share of a flight that the engine must have a prediction for."""


@dataclass(frozen=True)
class RecordingOption:
    """What could be recorded next: `label` and values in words' place, information per record (p_all, p_all) of
    the monitor's parameters, `inside_envelope`: identification has seen this operating condition."""

    label: str
    values: Mapping[str, float]
    information: np.ndarray
    inside_envelope: bool = True


@dataclass(frozen=True)
class Advice:
    """One option judged: non-centrality between the two sets per record, for a hundred records, and records needed
    for expected odds of `odds` to one (inf: more than MOST_RECORDS)."""

    label: str
    values: Mapping[str, float]
    noncentrality: float
    records: float
    odds: float
    inside_envelope: bool


def advise(
    score: Score,
    rivals: tuple[Sequence[str], Sequence[str]],
    options: Sequence[RecordingOption],
    uncertainty: np.ndarray,
    *,
    odds: float = ODDS,
    allowed: float = ALLOWED,
) -> list[Advice]:
    """Options by falling usefulness for separating the two `rivals`, sets of monitored parameters.

    uncertainty (p_all, p_all): covariance of what is uncertain about nominal and sensors, drawn anew for the
    further records. ValueError when both are the same set.
    """
    cases, root, wanted = _hardest_cases(score, rivals, allowed), _root(uncertainty), 2 * float(np.log(odds))
    judged = []
    for option in options:
        found = _separations(score, option.information, root, cases)
        needed = fewest(partial(_separates, found, wanted), MOST_RECORDS)
        judged.append(
            Advice(
                option.label, option.values, _least_separation(found, 100.0) / 100, needed, odds, option.inside_envelope
            )
        )
    return sorted(judged, key=lambda advice: (advice.records, -advice.noncentrality))


def noncentrality_gains(
    score: Score,
    rivals: tuple[Sequence[str], Sequence[str]],
    informations: Sequence[np.ndarray],
    *,
    allowed: float = ALLOWED,
) -> np.ndarray:
    """Gain (k,) of the non-centrality between the two sets from each of k further pieces of information (p, p) of the
    score's parameters, all else certain."""
    cases, certain = _hardest_cases(score, rivals, allowed), np.zeros((len(score.information), 0))
    return np.array(
        [_least_separation(_separations(score, information, certain, cases), 1.0) for information in informations]
    )


def _hardest_cases(
    score: Score, rivals: tuple[Sequence[str], Sequence[str]], allowed: float
) -> list[tuple[np.ndarray, np.ndarray, np.ndarray]]:
    """One set, the other, and the change of the first that is hardest to detect, for each set that may be true."""
    a, b = (score.indices(list(names)) for names in rivals)
    if set(a.tolist()) == set(b.tolist()):
        raise ValueError("the alternatives are the same set")
    changes = [_allowed_change(score, own, other, allowed) for own, other in ((a, b), (b, a))]
    return [(own, other, c) for (own, other), c in zip(((a, b), (b, a)), changes, strict=True) if c is not None]


def separable_information(information: np.ndarray, own: np.ndarray, other: np.ndarray) -> np.ndarray:
    """I_AA − I_AB I_BB⁺ I_BA (k, k): what the set `own` shows beyond what `other` can imitate."""
    if not len(other):
        return np.asarray(information[np.ix_(own, own)])
    eigenvalues, vectors = np.linalg.eigh(information[np.ix_(other, other)])
    kept = eigenvalues > 1e-10 * max(float(eigenvalues[-1]), 1e-300)
    half = information[np.ix_(own, other)] @ (vectors[:, kept] / np.sqrt(eigenvalues[kept]))
    return np.asarray(information[np.ix_(own, own)] - half @ half.T)


def _allowed_change(score: Score, own: np.ndarray, other: np.ndarray, allowed: float) -> np.ndarray | None:
    """Of the changes (k,), in prior_sigma, of the set `own` that the data allow, the one `other` imitates best.

    Minimum of a quadratic form over an ellipsoid about the estimate, by its Lagrange multiplier. None when
    `other` contains `own`.
    """
    if not len(own) or set(own.tolist()) <= set(other.tolist()):
        return None
    from scipy.optimize import brentq
    from scipy.special import chdtri

    b, information = score.scaled()
    I = information[np.ix_(own, own)] + 1e-9 * np.max(np.diag(information)) * np.eye(len(own))
    Q = separable_information(information, own, other)
    estimate = np.linalg.solve(I, b[own])
    radius = float(chdtri(len(own), 1 - allowed))

    def change(multiplier: float) -> np.ndarray:
        return np.asarray(np.linalg.solve(Q + multiplier * I, multiplier * I @ estimate))

    def excess(log_multiplier: float) -> float:
        away = change(float(np.exp(log_multiplier))) - estimate
        return float(away @ I @ away) - radius

    low, high = -30.0, 15.0
    return change(float(np.exp(low if excess(low) <= 0 else brentq(excess, low, high))))


def _separations(
    score: Score,
    information: np.ndarray,
    root: np.ndarray,
    cases: Sequence[tuple[np.ndarray, np.ndarray, np.ndarray]],
) -> list[Separation]:
    """λ(n) of each case from n further records of `information` (p_all, p_all); root (p_all, r): of the covariance of
    what is uncertain about nominal and sensors."""
    I, p = score.scaled()[1], len(score.parameters)
    found = []
    for own, other, change in cases:
        values, vectors = np.linalg.eigh(I[np.ix_(other, other)]) if len(other) else (np.zeros(0), np.zeros((0, 0)))
        # what nothing was told of is free to follow, or nearly so
        known = np.maximum(values, FREE * max(float(values.max(initial=0.0)), FREE))
        adapted = vectors @ ((vectors.T @ I[np.ix_(other, own)] @ change) / known)
        V = np.zeros((len(information), 1 + len(other) + root.shape[1]))
        V[own, 0] = change
        V[other, 0] -= adapted
        V[other, 1 : 1 + len(other)] = vectors / np.sqrt(known)
        V[:p] *= score.prior_sigma[:, None]
        V[:, 1 + len(other) :] = root
        found.append(Separation.from_gram(V.T @ information @ V))
    return found


def _root(uncertainty: np.ndarray) -> np.ndarray:
    spread = np.sqrt(np.diag(uncertainty))
    return covariance_root(uncertainty, np.where(spread > 0, spread, 1.0))


def _least_separation(separations: Sequence[Separation], n: float) -> float:
    return min(s(n) for s in separations)


def _separates(separations: Sequence[Separation], wanted: float, n: float) -> bool:
    return _least_separation(separations, n) >= wanted


def _informations(monitor: Monitor, conditions: Mapping[str, np.ndarray]) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Of each operating condition, inputs column -> (C,): information of a record (C, p_all, p_all), whether the engine
    can compute it, and whether identification has seen such a condition."""
    predicted, J, ok, _ = monitor.predict(dict(conditions), monitor.theta0)
    G = whiten(np.zeros_like(predicted), J, monitor.noise)[1]
    seen = np.ones(len(ok), bool)
    if monitor.envelope is not None:
        seen = ~np.asarray(monitor.envelope.outside(conditions))
    return np.swapaxes(G, 1, 2) @ G, np.asarray(ok), seen


def condition_options(monitor: Monitor, conditions: Mapping[str, np.ndarray]) -> list[RecordingOption]:
    """One option per operating condition, inputs column -> (C,), that the engine can compute."""
    G, ok, seen = _informations(monitor, conditions)
    return [
        RecordingOption(
            "condition", {column: float(values[k]) for column, values in conditions.items()}, G[k], bool(seen[k])
        )
        for k in np.flatnonzero(ok)
    ]


def advise_flights(
    score: Score, sets: Sequence[tuple[Sequence[str], float]], monitor: Monitor, flown: Mapping[str, np.ndarray]
) -> list[Suggestion]:
    """Flights that the engine's envelope allows, best first, for telling the leading `sets` of changes, with their
    probabilities, apart; `flown`: operating conditions so far, column -> (N,)."""
    leading = [(list(names), p) for names, p in sets[:LEADING]]
    chosen = flights(monitor.engine, flown)  # type: ignore[arg-type]
    if len(leading) < 2 or not chosen:
        return []
    pairs = {}
    for h, g in permutations(range(len(leading)), 2):
        own, other = (score.indices(leading[k][0]) for k in (h, g))
        change = _allowed_change(score, own, other, ALLOWED)
        if change is not None:
            pairs[h, g] = own, other, change
    parts = [f.inputs(monitor.engine, POINTS) for f in chosen]  # type: ignore[arg-type]
    G, ok, seen = _informations(monitor, {c: np.concatenate([p[c] for p in parts]) for c in parts[0]})
    root, found = _root(monitor.uncertainty), []
    for k, flight in enumerate(chosen):
        rows = slice(k * POINTS, (k + 1) * POINTS)
        if ok[rows].mean() < COMPUTED:
            continue
        mean = G[rows][ok[rows]].mean(axis=0)
        told = dict(zip(pairs, _separations(score, mean, root, list(pairs.values())), strict=True))
        table = [[told.get((h, g)) for g in range(len(leading))] for h in range(len(leading))]
        outlook = Outlook(np.array([p for _, p in leading]), table)
        known = bool(seen[rows].mean() >= 1.0 - BEYOND)
        found.append(Suggestion.from_outlook(outlook, flight.kind, flight.words, flight, known))
    return best_first(found)


def sensor_options(
    monitor: Monitor, inputs: Mapping[str, np.ndarray], noises: Mapping[str, float]
) -> list[RecordingOption]:
    """One option per further sensor (model column -> noise sigma, in the column's unit), recorded together with
    the present sensors at operating conditions like those of `inputs`, column -> (N,); before them the present
    sensors alone, for comparison. Empty when the engine can compute none of these conditions."""
    _, J, ok, _ = monitor.predict(dict(inputs), monitor.theta0)
    if not ok.any():
        return []
    q = len(monitor.names) - len(monitor.offsets)
    values: dict[str, Any] = dict(monitor.base)
    values.update(zip(monitor.names[:q], monitor.theta0[:q].tolist(), strict=True))
    columns = tuple(noises)
    if columns:
        extra = monitor.engine.predict(inputs, values, sensors=columns, wrt=monitor.names[:q])
        ok = ok & np.asarray(extra.ok)
    present = whiten(np.zeros_like(J[ok, :, 0]), J[ok], monitor.noise)[1].reshape(-1, len(monitor.names))
    base = present.T @ present / ok.sum()
    options = [RecordingOption("present sensors", {}, base)]
    if not columns:
        return options
    noise = NoiseModel(np.array([noises[c] for c in columns], float), np.zeros(len(columns)))
    full = np.zeros((int(ok.sum()), len(columns), len(monitor.names)))
    full[:, :, :q] = np.asarray(extra.jacobian)[ok]
    added = whiten(np.zeros(full.shape[:2]), full, noise)[1]
    for j, column in enumerate(columns):
        options.append(RecordingOption(column, {column: noises[column]}, base + added[:, j].T @ added[:, j] / ok.sum()))
    return options


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


FREE_SIZES = (0.5, 1.5, 5.0, 20.0)
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
    for size in FREE_SIZES:
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
    widest = FREE_SIZES[-1]
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
