"""Known directions of change: signs of single parameters, and the named faults of a catalogue.

Signs. Efficiencies fall; a catalogue says which way capacities go. With the slab prior cut to the known side of the
parameters Z of a set S, its marginal likelihood is

    p₊(data | S) = p(data | S) · P(right signs | data, S) / P(right signs | S),     P(right signs | S) = 2^−|Z|

(probability mass of a Gaussian beyond a cut, before and after the data). The signs may be wrong altogether with the
probability `doubt`, so that an efficiency that does rise is not excluded:

    p(data | S, signs) = (1 − doubt) p₊(data | S) + doubt p(data | S).

Named faults. They are directional hypotheses next to free sets of parameters. A fault of the catalogue moves the
parameters along its direction, Δθ = a d, severity a > 0. Ratios within d are not universal, so d stands for a cone: Δθ
= Σ w_i d_i, w_i > 0, a = Σ w_i, whose ratios lie within `ratio_spread` of the catalogue's. With β_i = d_iᵀb, κ_ij =
d_iᵀI d_j, half-normal weights of scale τ and A = κ + 1/τ², the marginal likelihood of a fault of q generators is

    mean over τ of  2^q τ^−q (det A)^−½ exp(½ βᵀA⁻¹β) P(w > 0),   w ~ N(A⁻¹β, A⁻¹),

and that of two faults together the same with the generators of both. Bias and scale faults of sensors go either
way. A fault is present with the probability `presence`; if something changed, it is none of the catalogue with
the probability `unlisted`, and then any set of parameters, as in the posterior over sets.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from itertools import combinations
from typing import TYPE_CHECKING

import numpy as np

from enginediag_cli.errors import DataError
from enginediag_cli.faults.catalogue import FaultSet
from enginediag_cli.isolation.posterior import SetPosterior, reweight, set_posterior
from enginediag_cli.isolation.prior import DEFAULT_CATALOGUE_PRIOR, CataloguePrior, InstrumentForms, SetPrior
from enginediag_cli.isolation.results import Explanation
from enginediag_cli.isolation.subsets import sets_by_size
from enginediag_cli.parameters import Parameter
from enginediag_cli.probability import normalized_weights
from enginediag_cli.residuals.score import Score

if TYPE_CHECKING:
    from enginediag_cli.faults.catalogue import ComponentFault


POINTS = 256
"""Points of the orthant integral: error below 0.002 up to five dimensions."""
BATCH = 100
"""Sets whose orthant integrals are computed at once."""
NEGLIGIBLE = 1e-4
"""Sets are weighed until all others, even with every sign right, hold less than this share."""
MAX_WEIGHED = 3000
"""Sets that are weighed at most, a second's work; the likeliest come first."""


def known_signs(parameters: Sequence[Parameter], faults: Iterable[ComponentFault] = ()) -> np.ndarray:
    """Sign of a change of each parameter (p,): −1, +1, or 0 where it is not known.

    Wear says which way: efficiencies fall. Of others the sign is that of the catalogue's `faults`, where those agree.
    """
    seen: dict[str, set[float]] = {}
    for fault in faults:
        for name, change in fault.changes.items():
            seen.setdefault(name, set()).add(float(np.sign(change * fault.severity)))
    signs = np.zeros(len(parameters))
    for i, p in enumerate(parameters):
        if p.wear:
            signs[i] = p.wear
        elif len(seen.get(p.name, ())) == 1:
            signs[i] = next(iter(seen[p.name]))
    return signs


def orthant_probability(mean: np.ndarray, covariance: np.ndarray, points: int = POINTS) -> np.ndarray:
    """P(x > 0) (w,) of w Gaussians of d dimensions, mean (w, d), covariance (w, d, d) positive definite.

    Separation of variables with fixed quasi-random points, all w at once, which scipy's integral does not
    offer: Genz, A. (1992) J. Computational and Graphical Statistics 1, 141–149.
    """
    if mean.shape[1] == 0:
        return np.ones(len(mean))
    return np.asarray(_separate_variables(mean, covariance, points)[0].mean(axis=1))


def orthant_moments(
    mean: np.ndarray, covariance: np.ndarray, points: int = POINTS
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """P(x > 0) (w,), and mean (w, d) and covariance (w, d, d) of w Gaussians cut to x > 0, by the same points."""
    weight, y, L = _separate_variables(mean, covariance, points)
    x = np.maximum(mean[:, None, :] + np.einsum("wij,wnj->wni", L, y), 0.0)
    weight = np.maximum(weight, 1e-300)  # an orthant as improbable as that has no moments worth having
    share = weight / weight.sum(axis=1, keepdims=True)
    centre = np.einsum("wn,wni->wi", share, x)
    away = x - centre[:, None, :]
    return weight.mean(axis=1), centre, np.einsum("wn,wni,wnj->wij", share, away, away)


def _separate_variables(
    mean: np.ndarray, covariance: np.ndarray, points: int
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Weights (w, n) of points x = mean + L y in the positive orthant, y (w, n, d), and L (w, d, d)."""
    from scipy.special import ndtr, ndtri

    w, d = mean.shape
    L = np.linalg.cholesky(covariance)
    lattice = np.arange(1, points + 1)[:, None] * np.sqrt(_PRIMES[:d])
    uniform = np.abs(2 * np.mod(lattice, 1.0) - 1)  # Richtmyer's points, folded to be smooth at the edges
    y = np.zeros((w, points, d))
    weight = np.ones((w, points))
    for i in range(d):
        centre = mean[:, i, None] + np.einsum("wnj,wj->wn", y[:, :, :i], L[:, i, :i])
        inside = np.maximum(ndtr(centre / L[:, i, i, None]), 1e-300)
        weight *= inside
        # of the standard normal beyond −centre/L_ii, the quantile of each point
        y[:, :, i] = -ndtri(np.maximum(inside * uniform[:, i], 1e-300))
    return weight, y, L


_PRIMES = np.array(
    [2, 3, 5, 7, 11, 13, 17, 19, 23, 29, 31, 37, 41, 43, 47, 53, 59, 61, 67, 71, 73, 79, 83, 89, 97], float
)


def one_sided_posterior(
    score: Score,
    posterior: SetPosterior,
    signs: np.ndarray,
    prior: SetPrior | None = None,
    *,
    doubt: float = 0.05,
) -> SetPosterior:
    """The posterior over sets when the signs (p,) of changes are known, 0 where not.

    `posterior` must come from the same score and prior. Sets are weighed in the order of the most that signs
    could make of them; those left, together below NEGLIGIBLE, are taken as having all signs right as often as
    before the data.
    """
    prior = prior or SetPrior()
    if not 0 <= doubt <= 1:
        raise ValueError("`doubt` must lie in [0, 1]")
    if len(signs) != len(score.parameters):
        raise ValueError("`signs` must give one sign per parameter")
    # a set has at most as many informative signs as integration points have dimensions
    signed = (posterior.masks & (signs != 0)).sum(axis=1)
    ceiling = posterior.probabilities * ((1 - doubt) * 2.0 ** np.minimum(signed, len(_PRIMES)) + doubt)
    order = np.argsort(-ceiling, kind="stable")
    left = ceiling.sum() - np.cumsum(ceiling[order])
    weights = posterior.probabilities.copy()
    total, first = 0.0, 0
    while first < min(len(order), MAX_WEIGHED):
        chosen = order[first : first + BATCH]
        weights[chosen] *= sign_factors(score, posterior.masks[chosen], signs, prior, doubt)
        total += float(weights[chosen].sum())
        first += len(chosen)
        if left[first - 1] <= NEGLIGIBLE * total:
            break
    return reweight(posterior, weights)


def sign_factors(score: Score, masks: np.ndarray, signs: np.ndarray, prior: SetPrior, doubt: float = 0.0) -> np.ndarray:
    """Factor (w,) by which knowing the signs (p,) changes the marginal likelihood of each set (w, p)."""
    b, information = prior.scaled(score)
    slabs = np.asarray(prior.slabs, float)[:, None, None]
    factors = np.ones(len(masks))
    for rows, sets in sets_by_size(masks):
        # in widths of each slab, where A = 1 + w² I_SS
        A = np.eye(sets.shape[1]) + slabs[..., None] ** 2 * information[sets[:, :, None], sets[:, None, :]]
        right, covariance = slabs * b[sets], np.linalg.inv(A)
        mean = np.einsum("wsij,wsj->wsi", covariance, right)
        share = normalized_weights(0.5 * np.sum(mean * right, axis=2) - 0.5 * np.linalg.slogdet(A)[1])
        known = signs[sets]
        probability = np.array([_sign_probability(m, C, known) for m, C in zip(mean, covariance, strict=True)])
        count = (known != 0).sum(axis=1)
        factors[rows] = (1 - doubt) * 2.0**count * np.sum(share * probability, axis=0) + doubt
    return factors


def _sign_probability(mean: np.ndarray, covariance: np.ndarray, signs: np.ndarray) -> np.ndarray:
    """P(all known signs right) (w,) for posteriors of w sets of one size, signs (w, size)."""
    probability = np.ones(len(mean))
    counts = (signs != 0).sum(axis=1)
    for count in np.unique(counts[counts > 0]):
        rows = np.flatnonzero(counts == count)
        at = np.nonzero(signs[rows])[1].reshape(len(rows), count)[:, : len(_PRIMES)]
        turn = np.take_along_axis(signs[rows], at, 1)
        m = turn * np.take_along_axis(mean[rows], at, 1)
        C = covariance[rows[:, None, None], at[:, :, None], at[:, None, :]] * turn[:, :, None] * turn[:, None, :]
        probability[rows] = orthant_probability(m, C)
    return probability


@dataclass(frozen=True)
class NamedFault:
    """A fault of the catalogue that the data could show.

    `generators` (q, p): changes in parameter units that span its cone; with weights w ≥ 0 the change is
    Σ w_i generator_i at the severity Σ w_i, and equal weights give the catalogue's own direction. `one_sided`:
    its severity cannot be negative.
    """

    name: str
    generators: np.ndarray
    one_sided: bool

    @property
    def own(self) -> np.ndarray:
        """The catalogue's direction (p,): changes at severity 1."""
        return np.asarray(self.generators.mean(axis=0))


def named_faults(
    catalogue: FaultSet, parameters: Sequence[str], theta0: np.ndarray, *, ratio_spread: float = 1.7
) -> tuple[tuple[NamedFault, ...], dict[str, str]]:
    """Faults of the catalogue as directions over monitored `parameters`, and those that cannot be, with reasons.

    theta0 (p,): nominal values; changes are relative to them where they are not 0. ratio_spread ≥ 1: ratios of
    the changes lie within this factor of the catalogue's.
    """
    if ratio_spread < 1:
        raise ValueError("`ratio_spread` must be at least 1")
    position = {name: i for i, name in enumerate(parameters)}
    found: list[NamedFault] = []
    untestable: dict[str, str] = {}
    for fault in catalogue.components:
        if any(fault.name == other.name for other in found):
            continue  # the same fault, described in another file as a part of something
        missing = [name for name in fault.changes if name not in position]
        if missing:
            untestable[fault.name] = f"{', '.join(missing)} not monitored"
            continue
        own = np.zeros(len(parameters))
        for name, change in fault.changes.items():
            own[position[name]] = fault.severity * change * (theta0[position[name]] or 1.0)
        found.append(NamedFault(fault.name, _cone(own, ratio_spread), True))
    for sensor in catalogue.sensors:
        if any(sensor.name == other.name for other in found):
            continue
        kind, size = sensor.effect["type"], sensor.effect.get("size", sensor.effect.get("change", 0.0))
        possible = [f"sensor.{quantity}.{kind}" for quantity in _quantities(sensor.column)]
        name = next((candidate for candidate in possible if candidate in position), possible[-1])
        if kind not in ("bias", "scale"):
            untestable[sensor.name] = f"a reading that is {kind} is no change of a parameter"
        elif name not in position or not size:
            untestable[sensor.name] = f"{name} not monitored"
        else:
            own = np.zeros(len(parameters))
            own[position[name]] = size
            found.append(NamedFault(sensor.name, own[None], False))
    return tuple(found), untestable


def _quantities(column: str) -> list[str]:
    """What a column may be of, its unit cut off bit by bit: `Wf_kg_s` → Wf_kg_s, Wf_kg, Wf."""
    parts = column.split("_")
    return ["_".join(parts[:k]) for k in range(len(parts), 0, -1)]


def _cone(own: np.ndarray, spread: float) -> np.ndarray:
    """Generators (q, p) of the cone about `own` (p,): one of its q changes large against the others each.

    With two changes, ratios within the factor `spread` of the catalogue's.
    """
    at = np.flatnonzero(own)
    q = len(at)
    if q < 2 or spread == 1:
        return own[None]
    factors = np.where(np.eye(q, dtype=bool), spread**0.5, spread**-0.5)
    generators = np.tile(own, (q, 1))
    generators[:, at] *= factors / factors.mean(axis=0)
    return generators


FREE_LISTED = 50
"""Free sets listed one by one among the alternatives."""


@dataclass(frozen=True)
class Severity:
    """Estimated severity of a named fault, 1 being the catalogue's size, with standard error and interval."""

    fault: str
    value: float
    standard_error: float
    lower: float
    upper: float


@dataclass(frozen=True)
class NamedIsolation:
    """The most probable explanation of the data in terms of a catalogue.

    Attributes
    ----------
    faults : tuple of str
        Faults of the answer; empty when nothing changed, or when the change is not in the catalogue.
    free : tuple of str
        In that case the most probable set of parameters.
    probability : float
        Of the answer; of all free sets together where the answer is one.
    severities : tuple of Severity
        Of the named faults.
    alternatives : tuple of Explanation
        Other answers, the most probable first; with the answer they hold `coverage`. A free one is named by its
        parameters.
    unlisted : float
        Probability that the change is not in the catalogue.
    untestable : dict of str to str
        Faults that these data cannot show, with the reason.
    """

    faults: tuple[str, ...]
    free: tuple[str, ...]
    probability: float
    severities: tuple[Severity, ...]
    alternatives: tuple[Explanation, ...]
    coverage: float
    unlisted: float
    untestable: dict[str, str]


def isolate_named(
    score: Score,
    catalogue: FaultSet,
    *,
    prior: SetPrior | None = None,
    expected: CataloguePrior = DEFAULT_CATALOGUE_PRIOR,
    coverage: float = 0.95,
    confidence: float = 0.95,
    largest: int | None = None,
) -> NamedIsolation:
    """Compare no change, each fault, each two faults, and free sets, by marginal likelihood.

    Parameters
    ----------
    score : Score
        Score and information of p parameters.
    catalogue : FaultSet
        Faults of components and of sensors.
    prior : SetPrior, optional
        Of free sets of parameters.
    expected : CataloguePrior
        Of the faults of the catalogue.
    coverage : float
        Probability that the answer and its alternatives hold together.
    confidence : float
        Level of the intervals of severities.
    largest : int, optional
        Most parameters of a free set.

    Returns
    -------
    NamedIsolation

    Raises
    ------
    DataError
        When these data can show no fault of the catalogue.
    """
    faults, untestable = named_faults(catalogue, score.parameters, score.theta0, ratio_spread=expected.ratio_spread)
    if not faults:
        reasons = "; ".join(f"{name}: {reason}" for name, reason in untestable.items())
        raise DataError(f"these parameters show no fault of the catalogue ({reasons})")
    prior = prior or SetPrior()
    named = _named_answers(score, faults, expected)
    sets = set_posterior(score, prior, largest=largest)
    log_free = _free_log_evidence(score, sets, prior, expected, len(faults))
    probabilities = normalized_weights(np.array([log for _, log in named] + [log_free]))
    unlisted = float(probabilities[-1])
    listed = [
        Explanation(tuple(faults[i].name for i in members), float(q))
        for (members, _), q in zip(named, probabilities, strict=False)
    ]
    free = _free_answers(sets, unlisted)
    best = int(np.argmax(probabilities[:-1]))
    free_first = probabilities[-1] > probabilities[best]
    answer = free[0] if free_first else listed[best]
    probability = unlisted if free_first else answer.probability
    others = sorted(
        (e for e in (listed if free_first else [*listed, *free]) if e is not answer), key=lambda e: -e.probability
    )
    chosen = [] if free_first else [faults[i] for i in named[best][0]]
    return NamedIsolation(
        () if free_first else answer.parameters,
        answer.parameters if free_first else (),
        probability,
        tuple(_severities(score, chosen, expected.scales, confidence)),
        tuple(_take_probability(others, coverage - probability)),
        coverage,
        unlisted,
        untestable,
    )


def _named_answers(
    score: Score, faults: Sequence[NamedFault], expected: CataloguePrior
) -> list[tuple[tuple[int, ...], float]]:
    """No change, each fault, and each two faults of different parameters: positions, and log joint probability."""
    n, presence = len(faults), expected.presence
    answers: list[tuple[tuple[int, ...], float]] = [((), n * np.log1p(-presence))]
    for size in (1, 2):
        for members in combinations(range(n), size):
            if size == 2 and _same_parameters(faults[members[0]], faults[members[1]]):
                continue
            log_prior = size * np.log(presence) + (n - size) * np.log1p(-presence)
            chosen = [faults[i] for i in members]
            answers.append((members, log_prior + _fault_moments(score, chosen, expected.scales)[0]))
    return answers


def _free_log_evidence(score: Score, sets: SetPosterior, prior: SetPrior, expected: CataloguePrior, n: int) -> float:
    """Log joint probability of all free sets with a change, which have together the share `unlisted` of the prior of a
    change; n: number of faults of the catalogue."""
    nothing = np.zeros((1, len(score.parameters)), bool)
    changed = float(-np.expm1(prior.log_probability(nothing, InstrumentForms.from_parameters(score.described))[0]))
    evidence = sets.log_evidence - np.log(changed) + float(np.log1p(-changed))
    odds = expected.unlisted / (1 - expected.unlisted)
    return float(np.log(odds) + np.log(-np.expm1(n * np.log1p(-expected.presence))) + evidence)


def _free_answers(sets: SetPosterior, probability: float) -> list[Explanation]:
    """The leading free sets with a change, which all together have this probability."""
    changed = sets.masks.any(axis=1)
    shares = sets.probabilities[changed] / sets.probabilities[changed].sum()
    return [
        Explanation(sets.names(int(i)), float(probability * q))
        for i, q in zip(np.flatnonzero(changed)[:FREE_LISTED], shares[:FREE_LISTED], strict=False)
    ]


def _take_probability(entries: Sequence[Explanation], wanted: float) -> list[Explanation]:
    """The first entries, until they hold the probability `wanted`."""
    kept: list[Explanation] = []
    for entry in entries:
        if sum(e.probability for e in kept) >= wanted or entry.probability < 1e-4:
            break
        kept.append(entry)
    return kept


def _same_parameters(one: NamedFault, other: NamedFault) -> bool:
    return bool(np.array_equal(one.own != 0, other.own != 0))


def _fault_moments(
    score: Score, faults: Sequence[NamedFault], scales: Sequence[float]
) -> tuple[float, np.ndarray, np.ndarray, np.ndarray]:
    """log marginal likelihood of `faults` together; per scale of severity its share (h,), and mean (h, k) and
    covariance (h, k, k) of the severities."""
    D = np.concatenate([f.generators for f in faults])
    counts = np.array([len(f.generators) for f in faults])
    owner = np.repeat(np.arange(len(faults)), counts)
    # weights of q generators such that the severity, their sum, has the mean square of its scale
    q = counts[owner]
    unit = 1 / np.sqrt(q * (1 + (q - 1) * 2 / np.pi))
    tau = np.asarray(scales, float)[:, None] * unit
    beta = D @ score.b
    A = D @ score.information @ D.T + np.eye(len(D)) / tau[:, :, None] ** 2
    covariance = np.linalg.inv(A)
    mean = covariance @ beta
    log = 0.5 * mean @ beta - 0.5 * np.linalg.slogdet(A)[1] - np.log(tau).sum(axis=1)
    cut = np.array([f.one_sided for f in faults])[owner]
    if cut.any():
        positive, mean, covariance = _truncate(mean, covariance, cut)
        log = log + cut.sum() * np.log(2) + np.log(positive)
    total = float(np.logaddexp.reduce(log))
    to_severity = (owner == np.arange(len(faults))[:, None]).astype(float)
    return (
        total - float(np.log(len(log))),
        np.exp(log - total),
        mean @ to_severity.T,
        to_severity @ covariance @ to_severity.T,
    )


def _truncate(mean: np.ndarray, covariance: np.ndarray, cut: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """P(w_cut > 0) (h,), and mean (h, k) and covariance (h, k, k) given that; the others follow linearly."""
    inner = covariance[:, cut][:, :, cut]
    positive, centre, spread = orthant_moments(mean[:, cut], inner)
    gain = np.swapaxes(np.linalg.solve(inner, covariance[:, cut]), 1, 2)  # of all on the cut ones
    new_mean = mean + np.einsum("hij,hj->hi", gain, centre - mean[:, cut])
    return positive, new_mean, covariance + gain @ (spread - inner) @ np.swapaxes(gain, 1, 2)


def _severities(
    score: Score, faults: Sequence[NamedFault], scales: Sequence[float], confidence: float
) -> list[Severity]:
    """Severity of each fault: moments of the mixture over scales, with a normal interval cut at zero."""
    from scipy.special import ndtri

    if not faults:
        return []
    _, shares, mean, covariance = _fault_moments(score, faults, scales)
    found = []
    for i, fault in enumerate(faults):
        value = float(shares @ mean[:, i])
        error = float(np.sqrt(shares @ (covariance[:, i, i] + mean[:, i] ** 2) - value**2))
        reach = float(-ndtri((1 - confidence) / 2)) * error
        lower = max(value - reach, 0.0) if fault.one_sided else value - reach
        found.append(Severity(fault.name, value, error, lower, value + reach))
    return found
