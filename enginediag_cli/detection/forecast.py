"""When a margin is used up: the posterior of level and rate of deterioration, and the first passage of the limit.

The consumption y of a margin after t flights is

    y(t) = c + Σ_j r_j 1(t ≥ t_j) + L₀ (e^{κ t/τ} − 1)/(e^κ − 1) + error,      κ = 0:  L₀ t/τ,     t ≥ 0

an offset, a step at each maintenance event and of what came and levelled out (its course in place of the 1), and growth
that reaches L₀ after τ flights: straight (κ = 0) or ever faster (κ > 0, as C-MAPSS and most wear before a failure:
A. Saxena, K. Goebel, D. Simon, N. Eklund, PHM 2008), or none at all.
Given (τ, κ) offset and steps are Gaussian and are integrated out; (τ, κ) lie on a grid, and laws are averaged by their
posterior weights. How fast engines of the fleet wear, ln τ ~ N(μ, s²) and the weights of κ, is learnt from the others
(`learnt`; expectation–maximisation, A. P. Dempster, N. M. Laird, D. B. Rubin, JRSS B 39 (1977) 1–38), so that intervals
are honest while an engine has shown little itself. The limit L ~ N(limit, sd²) is passed first at

    t* = τ/κ ln(1 + (L − c − Σ r)/L₀ (e^κ − 1)),      κ = 0:  t* = τ (L − c − Σ r)/L₀

and the result is the distribution of t* − now given that it has not been passed yet, without further maintenance.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

TAU = np.geomspace(20.0, 50_000.0, 400)
"""Flights to the reference consumption that are looked at: from a few weeks to more than an engine's life."""
KAPPA = np.array([0.0, 1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 8.0, 10.0])
"""Curvatures: 0 is straight; by 10 nine tenths of the growth come in the last quarter of the life."""
STRAIGHT = 0.5
"""Probability of straight growth, where no fleet is known: as much as of all others together."""
NO_GROWTH = 0.5
"""Probability that nothing grows at all, where no fleet is known: slow laws of the grid are as good as none over few
flights, and an end that they alone give is no finding."""
NODES = 15
"""Points of the normal law of limit and offset: quantiles of equal weight, whose mean square is within 4 %."""
PASSES = 30
"""Rounds of expectation and maximisation; the population does not change by then."""
LEAST_SPREAD = 0.1
"""Smallest standard deviation of ln τ between the engines of a fleet: no two wear alike to a tenth."""
COUNTS = 0.5
"""Engines that each curvature, and no growth, counts beforehand (Jeffreys)."""
TINY = 1e-9
"""Keeps a fleet in which nothing grows from a division by nothing."""
LEAST_WEIGHT = 1e-12
"""Weight of a law below which it is not followed to the limit."""


@dataclass(frozen=True)
class MarginCourse:
    """Consumption of a margin over flights.

    Attributes
    ----------
    t : ndarray of shape (n,)
        Flights since the baseline, negative where nothing can have begun.
    y : ndarray of shape (n,)
        Consumption, in K or in another unit of the margin.
    noise : ndarray of shape (n, n)
        Covariance of its errors.
    now : float
        Flights so far.
    steps : ndarray of shape (n, e)
        What came and is no growth any more: 1 after each maintenance event; of what levels out its course, 1 now.
    offset, step : float
        Prior standard deviations of the offset c and of the steps r, in the unit of y.
    ahead : ndarray of shape (e,)
        Share of each step that is still to come: 0 but for what has not quite levelled out.
    """

    t: np.ndarray
    y: np.ndarray
    noise: np.ndarray
    now: float
    steps: np.ndarray
    offset: float
    step: float
    ahead: np.ndarray


@dataclass(frozen=True)
class Population:
    """How engines of a fleet wear.

    Attributes
    ----------
    mean, log_spread : float
        ln τ ~ N(mean, log_spread²); with infinite `log_spread` every τ of the grid is equally probable.
    weights : ndarray of shape (K,)
        Probability of each curvature κ.
    none : float
        Probability that nothing grows.
    """

    mean: float
    log_spread: float
    weights: np.ndarray
    none: float = NO_GROWTH

    @property
    def log_prior(self) -> np.ndarray:
        """log P (T, K) over the grid; with `none` it sums to 1."""
        x = np.log(TAU)
        log = np.zeros(len(TAU)) if np.isinf(self.log_spread) else -0.5 * ((x - self.mean) / self.log_spread) ** 2
        log = log - np.logaddexp.reduce(log) + np.log1p(-self.none)
        return np.asarray(log[:, None] + np.log(self.weights))


def unknown_population() -> Population:
    """A population of which nothing is known."""
    curved = (1 - STRAIGHT) / (len(KAPPA) - 1)
    return Population(0.0, np.inf, np.where(KAPPA == 0.0, STRAIGHT, curved))


@dataclass(frozen=True)
class FittedLaws:
    """What a course says of each law: log likelihood (T, K), and the consumption now: `base` (T, K), that of offset and
    steps together, its variance, and `growth_now` (T, K); approach (T, K): what steps are still to come to; the same
    without growth."""

    log: np.ndarray
    base: np.ndarray
    approach: np.ndarray
    variance: float
    growth_now: np.ndarray
    log_none: float
    base_none: float
    approach_none: float
    reference: float
    now: float


def growth(x: np.ndarray, kappa: np.ndarray) -> np.ndarray:
    """(e^{κx} − 1)/(e^κ − 1), x where κ = 0."""
    k = np.where(kappa == 0.0, 1.0, kappa)
    return np.asarray(np.where(kappa == 0.0, x, np.expm1(np.minimum(k * x, 700.0)) / np.expm1(k)))


def fit_laws(course: MarginCourse, reference: float) -> FittedLaws:
    """Fit every law of growth on the grid to a course.

    Parameters
    ----------
    course : MarginCourse
        Consumption over n flights.
    reference : float
        L₀, the consumption that growth reaches after τ flights, in the unit of the course.

    Returns
    -------
    FittedLaws
    """
    n = len(course.t)
    X = np.column_stack([np.ones(n), course.steps])
    prior = np.array([course.offset, *[course.step] * course.steps.shape[1]]) ** 2
    W = np.linalg.inv(course.noise + (X * prior) @ X.T)
    g = reference * growth(np.maximum(course.t, 0.0) / TAU[:, None, None], KAPPA[:, None]).reshape(-1, n)
    apart = np.abs(g) < 1e3 * (np.abs(course.y).max() + reference)  # what is off by so much has no likelihood
    dead = ~apart.all(axis=1)
    g = np.where(apart, g, 0.0)
    left = course.y - g
    told = left @ W
    log = -0.5 * np.einsum("gn,gn->g", told, left)
    log[dead] = -np.inf
    gain = prior * (X.T @ W).T  # (n, e + 1): what a reading says of offset and steps
    after, ahead = gain.sum(axis=1), gain[:, 1:] @ course.ahead
    covariance = np.diag(prior) - (prior[:, None] * X.T) @ W @ (X * prior)
    ones = np.ones(len(prior))
    shape = (len(TAU), len(KAPPA))
    now = reference * growth(course.now / TAU[:, None], KAPPA)
    none = -0.5 * float(course.y @ W @ course.y)
    return FittedLaws(
        log.reshape(shape),
        (left @ after).reshape(shape),
        (left @ ahead).reshape(shape),
        float(ones @ covariance @ ones),
        now,
        none,
        float(course.y @ after),
        float(course.y @ ahead),
        reference,
        course.now,
    )


def learn_population(courses: Sequence[FittedLaws], without: int | None = None) -> Population:
    """Learn how engines wear from the courses of a fleet.

    Parameters
    ----------
    courses : sequence of FittedLaws
        One per engine.
    without : int, optional
        Position of an engine that is excluded, for a forecast of its own.

    Returns
    -------
    Population
        `unknown_population` for fewer than three engines.

    References
    ----------
    A. P. Dempster, N. M. Laird, D. B. Rubin, JRSS B 39 (1977) 1–38.
    """
    population, mine = unknown_population(), [f for k, f in enumerate(courses) if k != without]
    if len(mine) < 3:
        return population
    x = np.log(TAU)
    for _ in range(PASSES):
        total, none, first, second = np.full(len(KAPPA), COUNTS), COUNTS, 0.0, 0.0
        for one in mine:
            w, still = _posterior(one, population)
            total += w.sum(axis=0)
            none += still
            along = w.sum(axis=1)
            first, second = first + along @ x, second + along @ x**2
        count = max(total.sum() - COUNTS * len(KAPPA), TINY)
        mean = first / count
        spread = float(np.sqrt(max(second / count - mean**2, LEAST_SPREAD**2)))
        population = Population(float(mean), spread, total / total.sum(), none / (len(mine) + 2 * COUNTS))
    return population


@dataclass(frozen=True)
class Forecast:
    """Law of the flights that remain: times (a,), ascending, with weights (a,) that sum to at most 1; the rest never
    reaches the limit. level, level_error: consumption now; rate, rate_error: of it per flight, now."""

    times: np.ndarray
    weights: np.ndarray
    level: float
    level_error: float
    rate: float
    rate_error: float

    def quantile(self, q: float) -> float:
        """Flights within which the limit is reached with probability q; infinite where that is never so likely."""
        total = np.cumsum(self.weights)
        k = int(np.searchsorted(total, q))
        return float(self.times[k]) if k < len(self.times) else float("inf")

    @property
    def shows_growth(self) -> bool:
        """Whether the flights leave less than 5 % to it that the limit is never reached."""
        return math.isfinite(self.quantile(0.95))

    @property
    def mean(self) -> float:
        """Mean of the flights that remain, if the limit is reached."""
        return float(self.times @ self.weights / self.weights.sum()) if self.weights.sum() > 0 else float("inf")


def forecast(fit: FittedLaws, population: Population, limit: float, deviation: float = 0.0) -> Forecast:
    """Forecast when the limit ~ N(limit, deviation²) is passed, given that it has not been passed.

    Parameters
    ----------
    fit : FittedLaws
        Of the engine's course.
    population : Population
        How engines of the fleet wear.
    limit, deviation : float
        Consumption at the limit and its standard deviation, in the unit of the course.

    Returns
    -------
    Forecast
        Flights to the limit with intervals.
    """
    from scipy.special import ndtri

    w, none = _posterior(fit, population)
    tau, kappa = np.broadcast_to(TAU[:, None], w.shape), np.broadcast_to(KAPPA, w.shape)
    # a law that has no weight may be out of all numbers by now
    slope, now = np.where(w > 0, _slope(fit, tau, kappa), 0.0), np.where(w > 0, fit.base + fit.growth_now, 0.0)
    level = float(np.sum(w * now) + none * fit.base_none)
    rate = float(np.sum(w * slope))
    second = float(np.sum(w * (now - level) ** 2) + none * (fit.base_none - level) ** 2)
    rate_error = float(np.sqrt(np.sum(w * (slope - rate) ** 2) + none * rate**2))
    some = w > LEAST_WEIGHT
    w, tau, kappa = w[some], tau[some], kappa[some]
    base = _levelled(fit.base[some], fit.approach[some], limit)
    spread = np.sqrt(fit.variance + deviation**2)
    chance = spread * ndtri((np.arange(NODES) + 0.5) / NODES)
    gap = limit - base[:, None] + chance
    times = first_passage(gap / fit.reference, tau[:, None], kappa[:, None]) - fit.now
    each = np.broadcast_to(w[:, None] / NODES, times.shape)
    ahead = times > 0
    nodes = limit - _levelled(np.array(fit.base_none), np.array(fit.approach_none), limit) + chance
    never = none * float(np.mean(nodes > 0))
    alive = float(each[ahead].sum()) + never
    if alive <= 0.0:  # the limit is behind it by all that is known
        return Forecast(np.zeros(1), np.ones(1), level, float(np.sqrt(second + fit.variance)), rate, rate_error)
    order = np.argsort(times[ahead])
    return Forecast(
        times[ahead][order], each[ahead][order] / alive, level, float(np.sqrt(second + fit.variance)), rate, rate_error
    )


def _levelled(base: np.ndarray, approach: np.ndarray, limit: float) -> np.ndarray:
    """Consumption by offset and steps when they have levelled out, where that is short of the limit; beyond it growth
    reaches the limit on the way, and is counted from now."""
    return np.where(base + approach < limit, base + approach, base)


def _posterior(fit: FittedLaws, population: Population) -> tuple[np.ndarray, float]:
    """Weights (T, K) of the laws, and of no growth."""
    log, none = fit.log + population.log_prior, fit.log_none + np.log(population.none)
    top = max(float(log.max()), none)
    w, still = np.exp(log - top), float(np.exp(none - top))
    total = w.sum() + still
    return w / total, still / total


def first_passage(gap: np.ndarray, tau: np.ndarray, kappa: np.ndarray) -> np.ndarray:
    """Flights after which growth reaches `gap`, in units of its reference; negative gaps were passed before."""
    k = np.where(kappa == 0.0, 1.0, kappa)
    curved = np.log(np.maximum(1 + gap * np.expm1(k), 1e-300)) / k
    return np.asarray(tau * np.where(kappa == 0.0, gap, curved))


def _slope(fit: FittedLaws, tau: np.ndarray, kappa: np.ndarray) -> np.ndarray:
    """Growth per flight, now."""
    k = np.where(kappa == 0.0, 1.0, kappa)
    curved = k * np.exp(np.minimum(k * fit.now / tau, 700.0)) / np.expm1(k)
    return np.asarray(fit.reference / tau * np.where(kappa == 0.0, 1.0, curved))
