"""The history of one engine, and everything in it that is uncertain in all flights alike, marginalised.

A history has per flight a score and an information matrix of what they speak of,

    s_t ~ N(F_t (θ_t, ν), F_t),      θ_t (p,) monitored parameters, ν (r,) ~ N(0, I) uncertain about nominal,
                                     the same in all flights

in units of prior standard deviations. Nothing is marginalised yet: what is uncertain about nominal counts once for all
flights, and an instrument's offset once for each.

The background of a history is block diagonal minus low rank:

    x_t = Σ_e g_e(t) δ_e + H_t z,     z ~ N(0, I): nominal's uncertainty, wander of instruments, doubt about events

With 𝔽 the information on the stacked x of all flights and r the score,

    𝔽 = blockdiag F_t − B A⁻¹ Bᵀ,   r = s − B A⁻¹ d,    B_t = F_t H_t,  A = I + Σ H_tᵀ F_t H_t,  d = Σ H_tᵀ s_t

so that a course g of any parameters has the score b and the information M

    b = Σ_t g_t s_t − N A⁻¹ d,     M = Σ_t g_t² F_t − N A⁻¹ Nᵀ,      N = Σ_t g_t B_t

Nothing is larger than (T, p, r): cost and memory are linear in flights.

What instruments are off by in single flights: learnt from flights next to each other and three apart, marginalised.

    θ_t = … + b_t,      b_t ~ N(0, Q), over the errors of all instruments

Errors of sensors in a flight, e_t = R_t s_S with R_t = (F_SS)⁻¹ (S: all their forms, biases and scales), differ from
those of the flight before by noise, by what both flights' conditions make of ν, and by offsets:

    e_t+1 − e_t ~ N(ΔH ν, R_t + R_t+1 + 2 L Q Lᵀ),     H_t = R_t F_Sν,  L = [1, R_t F_S,inputs]

ν is one draw for all flights, and learnt from all differences: N(0, I) in each of them anew would explain scatter that
is the offsets'. Q is a full matrix: what the model misses at an operating point moves several readings at once, and
with independent offsets a flight far along one of these directions would be a change for certain.

Q by expectation and maximisation with weights of Student's t, so that a change is in one difference and counts little.
Then, flight by flight (Woodbury),

    F̃ = F − F_o (Q⁻¹ + F_oo)⁻¹ F_oᵀ,      s̃ = s − F_o (Q⁻¹ + F_oo)⁻¹ s_o
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from scipy.linalg import solve_triangular
from scipy.special import chdtri

from enginediag_cli.detection.verdict import format_size
from enginediag_cli.parameters import Parameter

LEAST_INFORMATION = 0.5
"""Information of a unit normal over all flights below which it is left out: what it adds to the variance of any
estimate is a half of what noise has at most, and of one that a change would need, a hundredth. Results of histories
with and without those of less have the same three digits, in half the time."""


@dataclass(frozen=True)
class KnownShift:
    """Parameters at `positions` (c,) that may have moved by the standard deviations `sizes` (c,), in prior ones, along
    a course (T,), for a reason that is known and no change: the unit normals from number `first` on, from 0, among
    those that all flights share. A course of ones is the engine's own level."""

    first: int
    positions: np.ndarray
    sizes: np.ndarray
    course: np.ndarray

    @property
    def constant(self) -> bool:
        """Whether it is in all flights alike."""
        return bool(np.all(self.course == 1.0))


@dataclass(frozen=True)
class History:
    """T flights in order of time.

    score (T, m), information (T, m, m): of the p monitored `parameters` first, then of r unit normals that all flights
    share. unit (p,): prior standard deviations, in the parameters' units. labels (T,): what the flights are called.
    maintenance: positions of flights before which somebody worked on the engine, in rising order. shifts: which
    of the unit normals move parameters for a reason that is known. baseline: first flights in which nothing begins.
    """

    parameters: tuple[Parameter, ...]
    unit: np.ndarray
    score: np.ndarray
    information: np.ndarray
    labels: tuple[str, ...] = ()
    maintenance: tuple[int, ...] = ()
    shifts: tuple[KnownShift, ...] = ()
    baseline: int = 0

    def __post_init__(self) -> None:
        T, m = self.score.shape
        if self.information.shape != (T, m, m):
            raise ValueError(f"`information` must have shape {(T, m, m)}, not {self.information.shape}")
        if len(self.unit) != len(self.parameters) or len(self.unit) > m:
            raise ValueError("every monitored parameter needs a unit and a score")

    def __len__(self) -> int:
        return len(self.score)

    @property
    def width(self) -> int:
        """How many parameters are monitored."""
        return len(self.parameters)

    @property
    def sensors(self) -> np.ndarray:
        """Positions of the biases of sensors: an epoch's readings."""
        return np.array([i for i, p in enumerate(self.parameters) if p.belongs_to_sensor and p.quantity == "bias"], int)

    def instruments(self) -> dict[str, list[int]]:
        """Positions of the forms of error of each instrument, its usual one first."""
        found: dict[str, list[int]] = {}
        for i, parameter in enumerate(self.parameters):
            if parameter.belongs_to_instrument:
                found.setdefault(parameter.component, []).append(i)
        return found


WANDER_MODES = 8
"""Modes of a Brownian motion: the ninth has a 300th of the variance of the first."""
WANDER_UNIT = 0.01
"""Standard deviation of wander at the end of the history for a multiple of one, in prior standard deviations."""
WANDER_MULTIPLES = (1.0, 4.0, 16.0)
"""How far instruments wander, in `WANDER_UNIT`: hardly, noticeably, much. Bounded, so that a drift is no wander."""
WANDER_PRIOR = (0.5, 0.3, 0.2)
"""Probability of each. Judgement: most instruments hold their calibration."""


@dataclass(frozen=True)
class Background:
    """F (T, p, p), s (T, p): information and score of each flight; B (T, p, r), A (r, r), d (r,) as above."""

    F: np.ndarray
    s: np.ndarray
    B: np.ndarray
    A: np.ndarray
    d: np.ndarray

    @staticmethod
    def from_history(history: History) -> Background:
        """With what is uncertain about nominal."""
        p = history.width
        F, s, U = history.information, history.score, nominal_basis(history)
        value = np.einsum("ij,ik,kj->j", U, F[:, p:, p:].sum(axis=0), U)
        return Background(F[:, :p, :p], s[:, :p], F[:, :p, p:] @ U, np.diag(1 + value), s[:, p:].sum(axis=0) @ U)

    def add_columns(self, h: np.ndarray) -> Background:
        """With columns h (T, p, c) of standard normal amount; those without information are left out."""
        Fh = self.F @ h
        own = inner(h, Fh)
        value, vector = np.linalg.eigh(own)
        U = vector[:, value > LEAST_INFORMATION]
        h, Fh, own = h @ U, Fh @ U, U.T @ own @ U
        cross = inner(self.B, h)
        A = np.block([[self.A, cross], [cross.T, np.eye(len(own)) + own]])
        d = np.concatenate([self.d, inner(h, self.s[:, :, None])[:, 0]])
        return Background(self.F, self.s, np.concatenate([self.B, Fh], axis=2), A, d)

    @cached_property
    def _root(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """A⁻½ (r, r) with A⁻¹ = A⁻½ A⁻½ᵀ, B A⁻½ (T, p, r) and A⁻½ᵀ d (r,)."""
        lower = np.linalg.cholesky(self.A)
        half = np.linalg.inv(lower).T
        T, p, r = self.B.shape
        return half, (self.B.reshape(T * p, r) @ half).reshape(T, p, r), half.T @ self.d

    @property
    def log_evidence(self) -> float:
        """Log marginal likelihood relative to nothing being uncertain: ½ dᵀA⁻¹d − ½ ln|A|."""
        lower = np.linalg.cholesky(self.A)
        w = solve_triangular(lower, self.d, lower=True, check_finite=False)
        return float(0.5 * w @ w - np.sum(np.log(np.diag(lower))))

    def project(self, g: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Scores b (K, p) and information M (K, p, p) of the courses g (K, T), of all parameters at once."""
        b, N = self._project_scores(g)
        p = N.shape[1]
        return b, (g**2 @ self.F.reshape(len(self.F), p * p)).reshape(len(g), p, p) - N @ N.transpose(0, 2, 1)

    def project_pairs(self, g: np.ndarray, pairs: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Scores b (K, p) of the courses g (K, T), and the elements (K, c) of their information M at `pairs` (2, c)."""
        b, N = self._project_scores(g)
        i, j = pairs
        M = g**2 @ self.F[:, i, j]
        for c, (first, second) in enumerate(zip(i, j, strict=True)):
            M[:, c] -= np.einsum("kr,kr->k", N[:, first], N[:, second])
        return b, M

    def _project_scores(self, g: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Scores b (K, p) of the courses g (K, T), and N A⁻½ (K, p, r)."""
        _, whitened, w = self._root
        T, p, r = whitened.shape
        N = (g @ whitened.reshape(T, p * r)).reshape(len(g), p, r)
        return g @ self.s - N @ w, N

    def single_flights(self, at: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Estimates and information (T, k) of the parameters `at` (k,), each alone and in each flight alone."""
        _, whitened, w = self._root
        N = whitened[:, at]
        weight = np.maximum(self.F[:, at, at] - np.sum(N**2, axis=2), TINY)
        return (self.s[:, at] - N @ w) / weight, weight

    def flights(self, position: int) -> tuple[np.ndarray, np.ndarray]:
        """Scores b (T,) and information K (T, T) of one parameter in single flights: of a course g, gᵀb and gᵀKg."""
        _, whitened, w = self._root
        N = whitened[:, position]
        return self.s[:, position] - N @ w, np.diag(self.F[:, position, position]) - N @ N.T

    def joint(self, h: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Score (c,) and information (c, c) of columns h (T, p, c), the background marginalised."""
        _, whitened, w = self._root
        N = inner(h, whitened)
        return inner(h, self.s[:, :, None])[:, 0] - N @ w, inner(h, self.F @ h) - N @ N.T


def nominal_basis(history: History) -> np.ndarray:
    """Directions (r, k) of the r unit normals that the flights know of."""
    p = history.width
    value, vector = np.linalg.eigh(history.information[:, p:, p:].sum(axis=0))
    return np.asarray(vector[:, value > LEAST_INFORMATION])


def inner(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Σ_t a_tᵀ b_t (c, d) of a (T, p, c) and b (T, p, d)."""
    rows = a.shape[0] * a.shape[1]
    return np.asarray(a.reshape(rows, a.shape[2]).T @ b.reshape(rows, b.shape[2]))


def wander_modes(flights: int) -> np.ndarray:
    """Karhunen–Loève modes (T, k) of a Brownian motion of variance 1 at the end: √2 sin((j − ½)π t)/((j − ½)π)."""
    k = min(WANDER_MODES, max(flights // 3, 1))
    t = (np.arange(flights) + 0.5) / flights
    j = np.pi * (np.arange(k) + 0.5)
    return np.sqrt(2.0) * np.sin(np.outer(t, j)) / j


def add_wander(background: Background, history: History, multiple: float) -> Background:
    """With instruments that wander slowly, each in its usual form of error."""
    modes = wander_modes(len(history))
    usual = [forms[0] for forms in history.instruments().values()]
    h = np.zeros((len(history), history.width, len(usual) * modes.shape[1]))
    for c, i in enumerate(usual):
        h[:, i, c * modes.shape[1] : (c + 1) * modes.shape[1]] = multiple * WANDER_UNIT * modes
    return background.add_columns(h) if usual else background


# Offsets of single flights

FREEDOM = 4.0
"""Degrees of freedom of Student's t by which differences are weighed: a step of any size then counts as a few."""
LAGS = (1, 3)
"""Flights by which those lie apart that are compared: of neighbours alone, sizes are half as well known, and what
wanders for a few flights is missed."""
LONGEST = 0.1
"""Share of the flights by which those lie apart at most: a step is in as many differences."""
ROUNDS = 15
"""Of expectation and maximisation; sizes only have to be known to a few per cent."""
SHARED_ROUNDS = 2
"""Times that what all flights share is learnt beside the sizes of offsets, these once more each time."""
LEAST_SHARE = 0.01
"""Smallest variance of an offset, in variances of the flight's mean reading: no instrument is better."""
START_SHARE = 4.0
"""Variance with which inputs begin, in the same unit: from small ones the iteration hardly moves."""
MEDIAN = 0.455
"""Median of the square of a standard normal variable."""
CAP = 1.5
"""Largest size of a sensor's offset, in sizes by the median of its differences: a fault that comes and goes in less
than a half of the flights does not pass for scatter."""
TWO_LEVELS = 0.15
"""Share of a sensor's scatter that two levels leave where it comes and goes: a normal law leaves 0.36, a ramp 0.25."""
SHARES = (1.0, 0.5, 0.25, 0.1, 0.0)
"""Shares of all variances together that are tried: the iteration is slow where they are small, and twenty-five that are
a little too large take a quarter of the information."""
ALONE = 60.0
"""Differences for which it counts that offsets of different instruments are independent: of thirty flights, each being
in two."""
CORRELATED_ROUNDS = 12
"""Of expectation and maximisation of their covariance."""
FEWEST_DIFFERENCES = 10
"""Differences from which their median is worth a factor: to a third, of ten times nine sensors."""
RIDGE = 1e-6
"""Information that a reading's errors have at least: one that is missing is known to a thousand prior deviations."""
TINY = 1e-12
"""Keeps a division by no information from failing."""


@dataclass(frozen=True)
class OffsetModel:
    """Covariance (p, p) of what parameters are off by in single flights, 0 of what is no instrument's; inflation:
    factor by which differences of flights are larger than offsets and noise explain, 1 at least."""

    covariance: np.ndarray
    inflation: float = 1.0

    @property
    def variance(self) -> np.ndarray:
        """(p,)."""
        return np.asarray(np.diag(self.covariance))

    def limit(self, most: np.ndarray) -> OffsetModel:
        """With variances of at most `most` (p,)."""
        inside = np.sqrt(np.minimum(most / np.maximum(self.variance, TINY), 1.0))
        return replace(self, covariance=inside[:, None] * self.covariance * inside)


def learn_offsets(history: History) -> OffsetModel:
    """The sizes of offsets from differences of flights; two flights at least, else none."""
    p = history.width
    S = np.array([i for i, parameter in enumerate(history.parameters) if parameter.belongs_to_sensor], int)
    forms = np.array([i for own in history.instruments().values() for i in own], int)
    covariance = np.zeros((p, p))
    if not len(S) or len(history) < 2:
        return OffsetModel(covariance)
    F, s = history.information, history.score
    R = np.linalg.inv(F[:, S[:, None], S] + RIDGE * np.eye(len(S)))
    e = np.einsum("tij,tj->ti", R, s[:, S])
    H = R @ F[:, S, p:]
    L = np.median(R @ F[:, S[:, None], forms], axis=0)
    information = np.einsum("tii->ti", F)[:, forms]
    strength = np.maximum(np.median(information, axis=0), TINY)
    single = np.diff(remove_second_level(s[:, forms] / np.maximum(information, TINY)), axis=0)
    sensor = np.array([history.parameters[i].belongs_to_sensor for i in forms], bool)
    cap = np.where(sensor, CAP**2 * np.median(single**2, axis=0) / MEDIAN / 2, np.inf)
    least = LEAST_SHARE / strength
    start = np.where(sensor, np.maximum(cap, least), START_SHARE / strength)
    most = np.maximum(cap, least)
    shared = SharedNormals(e, _apart(R, 1.0), H, _apart(H), np.zeros(H.shape[2]), np.eye(H.shape[2]))
    alone = _expectation_maximisation(*shared.differences(), L, start, least, most)
    for _ in range(SHARED_ROUNDS):
        shared = shared.learn(2 * (L * alone) @ L.T)
        alone = _expectation_maximisation(*shared.differences(), L, alone, least, most)
    d, V = shared.differences()
    Q = _correlate(d, V, L, alone, most)
    covariance[np.ix_(forms, forms)] = Q
    return OffsetModel(covariance, _inflation(d, V + 2 * L @ Q @ L.T))


def _apart(x: np.ndarray, sign: float = -1.0) -> np.ndarray:
    """Differences (n, …) of x (T, …) between flights that are `LAGS` apart, or their sums."""
    lags = [lag for lag in LAGS if lag <= max(LONGEST * len(x), LAGS[0])]
    return np.concatenate([x[lag:] + sign * x[:-lag] for lag in lags])


@dataclass(frozen=True)
class SharedNormals:
    """What unit normals ν ~ N(mean (r,), covariance (r, r)) that all flights share make of the errors e (T, k) of
    sensors: effect H (T, k, r), moved (n, k, r) by which it differs between two flights, noise (n, k, k) of their
    difference."""

    e: np.ndarray
    noise: np.ndarray
    H: np.ndarray
    moved: np.ndarray
    mean: np.ndarray
    covariance: np.ndarray

    def differences(self) -> tuple[np.ndarray, np.ndarray]:
        """Of flights (n, k) without the mean of what is shared, and their covariance (n, k, k)."""
        d = _apart(remove_second_level(self.e - self.H @ self.mean))
        return d, self.noise + self.moved @ self.covariance @ self.moved.transpose(0, 2, 1)

    def learn(self, offsets: np.ndarray) -> SharedNormals:
        """By all differences together, of flights whose offsets add the covariance `offsets` (k, k): what is the same
        in all flights is no scatter. Differences are weighed by Student's t."""
        d, V = self.differences()
        k, r = self.moved.shape[1:]
        z = np.linalg.solve(V + offsets, d[:, :, None])[:, :, 0]
        weight = (FREEDOM + k) / (FREEDOM + np.sum(z * d, axis=1))
        solved = np.linalg.solve(self.noise + offsets, self.moved) * weight[:, None, None]
        share = len(self.e) / len(d)  # every flight is in several differences, and counts once
        known = np.linalg.inv(np.eye(r) + share * inner(self.moved, solved))
        mean = known @ (share * inner(solved, (d + self.moved @ self.mean)[:, :, None])[:, 0])
        return replace(self, mean=mean, covariance=known)


def remove_second_level(e: np.ndarray) -> np.ndarray:
    """Estimates e (T, k) with what is plainly at one of two levels brought to one: of all ways to cut the sorted values
    of a column in two, the one that leaves the least scatter about both means."""
    T = len(e)
    order = np.argsort(e, axis=0)
    value = np.take_along_axis(e, order, axis=0) - e.mean(axis=0)
    n = np.arange(1, T)[:, None]
    below = np.cumsum(value, axis=0)[:-1]
    between = below**2 / n + below**2 / (T - n)  # the sum of all values is zero
    cut = np.argmax(between, axis=0)
    at = np.arange(e.shape[1])
    two = np.sum(value**2, axis=0) - between[cut, at] < TWO_LEVELS * np.sum(value**2, axis=0)
    step = -below[cut, at] * (1 / (T - 1 - cut) + 1 / (cut + 1))
    above = np.empty_like(e)
    np.put_along_axis(above, order, (np.arange(T)[:, None] > cut).astype(float), axis=0)
    return np.asarray(e - above * step * two)


def _inflation(d: np.ndarray, total: np.ndarray) -> float:
    """Median of dᵀ Σ⁻¹ d of differences d (n, k) of covariance (n, k, k) over that of χ²(k): a change is in few.
    Of too few differences nothing is inferred."""
    n, k = d.shape
    squares = np.einsum("ni,ni->n", d, np.linalg.solve(total, d[:, :, None])[:, :, 0])
    ratio = float(np.median(squares)) / float(chdtri(k, 0.5))
    return max(ratio, 1.0) if n >= FEWEST_DIFFERENCES else 1.0


def _expectation_maximisation(
    d: np.ndarray, V: np.ndarray, L: np.ndarray, start: np.ndarray, least: np.ndarray, most: np.ndarray
) -> np.ndarray:
    """Variances (c,) of offsets with the effects L (k, c) from differences d (n, k), of covariance V (n, k, k)
    without; where they start, and what they are at least and at most (c,)."""
    k = d.shape[1]
    q = start.copy()
    for _ in range(ROUNDS):
        total = V + 2 * (L * q) @ L.T
        inverse = np.linalg.inv(total)
        z = np.einsum("nij,nj->ni", inverse, d)
        weight = (FREEDOM + k) / (FREEDOM + np.sum(z * d, axis=1))
        mean = 2 * q * (z @ L)
        shrink = 2 * q - 4 * q**2 * np.sum(L * (inverse @ L), axis=1)
        q = np.clip((weight[:, None] * mean**2 + shrink).mean(axis=0) / 2, least, most)
    return max((np.maximum(share * q, least) for share in SHARES), key=lambda one: _log_likelihood(d, V, L, one))


def _correlate(d: np.ndarray, V: np.ndarray, L: np.ndarray, alone: np.ndarray, most: np.ndarray) -> np.ndarray:
    """Covariance (c, c) of offsets from differences d (n, k) of covariance V (n, k, k) without: what the model misses
    at an operating point moves several readings at once. Offsets of variance `alone` (c,), each by itself, count for
    `ALONE` differences; `most` (c,): what variances are at most."""
    k, n = d.shape[1], len(d)
    Q = np.diag(alone)
    for _ in range(CORRELATED_ROUNDS):
        inverse = np.linalg.inv(V + 2 * L @ Q @ L.T)
        z = np.einsum("nij,nj->ni", inverse, d)
        weight = (FREEDOM + k) / (FREEDOM + np.sum(z * d, axis=1))
        mean = 2 * z @ L @ Q
        left = n * 2 * Q - 4 * Q @ L.T @ inverse.sum(axis=0) @ L @ Q
        Q = (ALONE * np.diag(alone) + (mean.T @ (weight[:, None] * mean) + left) / 2) / (ALONE + n)
        inside = np.sqrt(np.minimum(most / np.diag(Q), 1.0))
        Q = inside[:, None] * Q * inside
    return Q


def _log_likelihood(d: np.ndarray, V: np.ndarray, L: np.ndarray, q: np.ndarray) -> float:
    """Of differences d (n, k) by Student's law with offsets of variance q (c,)."""
    total = V + 2 * (L * q) @ L.T
    z = np.linalg.solve(total, d[:, :, None])[:, :, 0]
    k = d.shape[1]
    tail = (FREEDOM + k) / 2 * np.log1p(np.sum(z * d, axis=1) / FREEDOM)
    return float(-np.sum(tail) - 0.5 * np.sum(np.linalg.slogdet(total)[1]))


def marginalise_offsets(history: History, offsets: OffsetModel) -> History:
    """The history with each flight's offsets counted as noise of that flight."""
    o = np.flatnonzero(offsets.variance)
    if not len(o):
        return history
    F, s = history.information, history.score
    inner = F[:, o[:, None], o] + np.linalg.inv(offsets.covariance[np.ix_(o, o)])
    cross = F[:, o]  # (T, o, m)
    solved = np.linalg.solve(inner, np.concatenate([cross, s[:, o, None]], axis=2))
    information = F - cross.transpose(0, 2, 1) @ solved[:, :, :-1]
    score = s - np.einsum("tom,to->tm", cross, solved[:, :, -1])
    return replace(history, information=information / offsets.inflation, score=score / offsets.inflation)


VISIBLE = 30.0
"""Squared standard deviations by which a plausible change must stand out where an engine is called steady: of these a
tenth less than twenty goes on the prior of one suspect, shape and onset, the rest is what chance may take away."""
PLAUSIBLE = 2.0
"""Change, in prior standard deviations, which an engine that is called healthy must have been able to show."""
LEAST_SHOWN = 1e-9
"""Information of a parameter, in squared prior standard deviations, below which no reading shows it."""


@dataclass(frozen=True)
class StepVisibility:
    """Which steps after the baseline a history would have shown, nothing else having changed.

    squared: how plainly a plausible step of the component that shows best stands out, in squared standard deviations;
    parameter, needed: of it the parameter that moves most, and by how much in its unit it would have to move at least;
    smallest: parameter → step of it alone that is seen, in its unit; unseen: parameters of which a plausible step is
    not."""

    squared: float
    parameter: Parameter
    needed: float
    smallest: Mapping[str, float]
    unseen: frozenset[str]

    @property
    def enough(self) -> bool:
        """Whether a history without a change says that there was none."""
        return self.squared >= VISIBLE

    @property
    def words(self) -> str:
        """By how much what shows best would have to change."""
        name, size = self.parameter.words or self.parameter.name, format_size(self.parameter, self.needed)
        return f"even {name}, which shows best, would have to change by {size}"


def step_visibility(calm: History, epoch: int) -> StepVisibility:
    """How plainly a plausible step of the component that shows best would stand out from an epoch on, of a history
    without offsets: its efficiency and flow by PLAUSIBLE together, the second half as far as the first and so on; of an
    instrument where no component is among the suspects."""
    parts: dict[str, list[int]] = {}
    for i, parameter in enumerate(calm.parameters):
        if not parameter.belongs_to_instrument:
            parts.setdefault(parameter.component, []).append(i)
    background = add_wander(Background.from_history(calm), calm, WANDER_MULTIPLES[0])
    _, M = background.project((np.arange(len(calm)) >= epoch).astype(float)[None])
    best, first, moved = -1.0, 0, 0.0
    for at in parts.values() or [[i] for i in range(calm.width)]:
        size = 0.5 ** np.arange(len(at))
        change = -PLAUSIBLE * size / np.linalg.norm(size)
        squared = float(change @ M[0][np.ix_(at, at)] @ change)
        if squared > best:
            best, first, moved = squared, at[0], abs(float(change[0]))
    needed = moved * float(calm.unit[first]) * (VISIBLE / max(best, LEAST_SHOWN)) ** 0.5
    shown = np.diag(M[0])
    # in prior standard deviations
    alone = np.where(shown > LEAST_SHOWN, (VISIBLE / np.maximum(shown, LEAST_SHOWN)) ** 0.5, np.inf)
    names = [p.name for p in calm.parameters]
    unseen = frozenset(name for name, size in zip(names, alone, strict=True) if size > PLAUSIBLE)
    smallest = dict(zip(names, (alone * calm.unit).tolist(), strict=True))
    return StepVisibility(best, calm.parameters[first], needed, smallest, unseen)
