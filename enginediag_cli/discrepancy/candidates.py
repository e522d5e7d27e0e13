"""What may be missing at a place: a switch, an amplitude free in every record, a free curve along one driver.

Every candidate is a set of columns with independent standard normal amplitudes times one size. At fixed noise its
evidence over no effect follows from Q = ΓᵀC⁻¹Γ (N, N) and h = ΓᵀC⁻¹y (N,) of its place, which are the same for all:

    ½ |L⁻¹ s Φᵀh|² − ½ ln|I + s² ΦᵀQΦ|,   L Lᵀ = I + s² ΦᵀQΦ

C. E. Rasmussen and C. K. I. Williams, Gaussian Processes for Machine Learning (2006), section 2.7.

The path of a switch is found by toggling whole intervals. An amplitude a ~ N(0, s²) in the records where z = 1 has

    L(z) = ½ (zᵀh)² / (zᵀQz + s⁻²) − ½ ln(1 + s² zᵀQz) + ln p(z)

Toggling an interval changes zᵀh and zᵀQz by sums over it, read from cumulative sums, so that all N²/2 intervals are
scored exactly at once; the best is toggled until none gains. p(z) is a Markov chain in time with a stated mean dwell
time in either state; flights begin in either.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy import linalg
from scipy.special import log_ndtr

from enginediag_cli.discrepancy.linearised import LinearProblem
from enginediag_cli.discrepancy.noise import MemberColumns, StructuredNoise, Whitened

SWITCH, PER_RECORD, CURVE, STEP, MAP = "two states", "free in every record", "curve", "step", "map error"
KINDS = (SWITCH, PER_RECORD, CURVE, STEP, MAP)
LENGTHS = (0.5, 1.5)
"""Length scales of free curves, in standard deviations of the driver: with a bend or two, and nearly straight."""
SIZE_SPREAD = 1.0
"""Standard deviation of ln size of what varies along a driver or from record to record."""
USUAL_SHARE = 0.5
"""Median of that size over how far the place may vary."""
SIZES = np.exp(np.linspace(-2.0, 2.0, 6))
"""Sizes over the median at which candidates are screened."""
RANK = 12
"""Functions of a free curve at most; what more would hold is below a thousandth of its variance."""
LEAST_SIDE = 3
"""Records on either side of a step along a driver at least: fewer are outliers."""
LEAST_SHARE = 1e-3
"""Of the variance of a curve's largest function."""
DWELL_S = 400.0
"""Mean time that a switched system stays on, or off: minutes of an air-conditioning or anti-icing setting. Between 100
and 1600 s answers hardly differ."""
DWELL_RECORDS = 4.0
"""The same in records, where there is no clock."""
LEAST_GAIN = 1e-6
"""ln evidence by which a toggled interval must gain: rounding."""
COARSE = 100
"""Segments of records that a path is screened in; the leaders' paths are then toggled record by record."""
MOST_TOGGLES = 30
"""Toggled intervals of one path at most: more is no switch."""


@dataclass(frozen=True)
class StateChain:
    """ln probabilities of staying and of changing at the N + 1 edges of N records; 0 where a flight begins or ends."""

    stay: np.ndarray
    change: np.ndarray

    @staticmethod
    def from_times(time_s: np.ndarray, flight: np.ndarray) -> StateChain:
        """The chain of N records by their times, NaN without a clock, and the numbers of their flights."""
        N = len(flight)
        stay, change = np.zeros(N + 1), np.zeros(N + 1)
        gap = np.diff(time_s) / DWELL_S
        gap = np.where(np.isfinite(gap), np.abs(gap), 1.0 / DWELL_RECORDS)
        p = 0.5 * -np.expm1(-2.0 * np.maximum(gap, 1e-6))
        inside = flight[1:] == flight[:-1]
        stay[1:N] = np.where(inside, np.log1p(-p), 0.0)
        change[1:N] = np.where(inside, np.log(p), 0.0)
        return StateChain(stay, change)

    def value(self, z: np.ndarray) -> float:
        """ln p(z)."""
        moved = np.concatenate([[False], z[1:] != z[:-1], [False]])
        return float(np.where(moved, self.change, self.stay).sum())

    def coarse(self, edges: np.ndarray) -> StateChain:
        """The chain of segments between these edges (k + 1,); what stays within a segment has stayed."""
        return StateChain(self.stay[edges], self.change[edges])

    def toggle_gains(self, z: np.ndarray) -> np.ndarray:
        """(N + 1,): change of ln p(z) where one side of an edge is toggled."""
        moved = np.concatenate([[False], z[1:] != z[:-1], [False]])
        return np.where(moved, self.stay - self.change, self.change - self.stay)


def path_evidence(b: np.ndarray, q: np.ndarray, size: float, sign: int) -> np.ndarray:
    """½ b²/(q + s⁻²) − ½ ln(1 + s²q) of an amplitude N(0, s²), of one sign where physics gives it."""
    q = np.maximum(q, 0.0)
    held = q + size**-2
    value = 0.5 * b**2 / held - 0.5 * np.log1p(size**2 * q)
    if sign:
        value = value + np.log(2.0) + log_ndtr(sign * b / np.sqrt(held))
    return np.asarray(value)


@dataclass(frozen=True)
class StatePath:
    """z (N,) of 0 and 1, and its ln evidence over no effect, `prior` = ln p(z) included."""

    z: np.ndarray
    evidence: float
    prior: float


def best_path(
    Q: np.ndarray, h: np.ndarray, size: float, sign: int, chain: StateChain, start: np.ndarray | None = None
) -> StatePath:
    """The likeliest path from a start (default: off throughout), toggling intervals until none gains."""
    N = len(h)
    z = np.zeros(N) if start is None else np.asarray(start, float).copy()
    current = _evidence(Q, h, z, size, sign, chain)
    lower = np.tri(N + 1, k=0, dtype=bool)
    for _ in range(MOST_TOGGLES):
        w = 1.0 - 2.0 * z
        Qz = Q @ z
        whole = np.zeros((N + 1, N + 1))
        np.cumsum(np.cumsum(Q * np.outer(w, w), axis=0), axis=1, out=whole[1:, 1:])
        corner = np.diag(whole)
        single = np.concatenate([[0.0], np.cumsum(w * h)])
        cross = np.concatenate([[0.0], np.cumsum(w * Qz)])
        # interval [i, j): rows i, columns j
        b = float(z @ h) + single[None, :] - single[:, None]
        q = float(z @ Qz) + 2.0 * (cross[None, :] - cross[:, None])
        q += corner[None, :] + corner[:, None] - whole - whole.T
        gains = chain.toggle_gains(z)
        score = path_evidence(b, q, size, sign) + gains[None, :] + gains[:, None]
        score[lower] = -np.inf
        i, j = np.unravel_index(int(np.argmax(score)), score.shape)
        if score[i, j] + chain.value(z) <= current + LEAST_GAIN:
            break
        z[i:j] = 1.0 - z[i:j]
        current = _evidence(Q, h, z, size, sign, chain)
    return StatePath(z, current, chain.value(z))


def screened_path(
    Q: np.ndarray, h: np.ndarray, size: float, sign: int, chain: StateChain, starts: Sequence[np.ndarray]
) -> StatePath:
    """The likeliest of paths from several starts, in segments of a hundredth of the records each."""
    N = len(h)
    edges = np.unique(np.linspace(0, N, min(COARSE, N) + 1).round().astype(int))
    first, own = edges[:-1], chain.coarse(edges)
    within = float(chain.stay.sum() - own.stay.sum())
    q = np.add.reduceat(np.add.reduceat(Q, first, axis=0), first, axis=1)
    g = np.add.reduceat(h, first)
    found = [best_path(q, g, size, sign, own, np.round(np.add.reduceat(z, first) / np.diff(edges))) for z in starts]
    best = max(found, key=lambda p: p.evidence)
    return StatePath(np.repeat(best.z, np.diff(edges)), best.evidence + within, best.prior + within)


def _evidence(Q: np.ndarray, h: np.ndarray, z: np.ndarray, size: float, sign: int, chain: StateChain) -> float:
    own = path_evidence(np.array(z @ h), np.array(z @ Q @ z), size, sign)
    return float(own) + chain.value(z)


def path_from_amplitudes(a: np.ndarray, sign: int) -> np.ndarray:
    """Two states from amplitudes (N,): above and below the middle of their range, on where the sign of physics is."""
    on = a > 0.5 * (np.quantile(a, 0.1) + np.quantile(a, 0.9))
    return np.asarray(~on if sign < 0 else on, float)


@dataclass(frozen=True)
class Candidate:
    """One thing that may be missing: a kind at a place. `patterns` (N, k): its amplitudes' values in the records;
    `size` of the amplitudes, `prior` of ln size, None where the size is the place's own; `price`: ln prior of what was
    chosen beside the place: path, driver and `length`, of a step the value of the driver at which it is;
    `evidence`: ln evidence over the current hypothesis at fixed noise, price included."""

    kind: str
    place: int
    patterns: np.ndarray
    size: float
    prior: tuple[float, float] | None
    price: float
    evidence: float
    driver: str = ""
    length: float = 0.0
    sign: int = 0

    def columns(self, problem: LinearProblem) -> MemberColumns:
        """For the noise model."""
        values = problem.G[:, :, self.place, None] * self.patterns[:, None, :]
        return MemberColumns(values, self.size, self.prior)

    @property
    def key(self) -> tuple[str, int, str]:
        """What makes it another hypothesis: kind, place and driver."""
        return self.kind, self.place, self.driver

    def free_maps(self, problem: LinearProblem) -> list[int]:
        """Numbers of the groups of map errors whose size it sets free."""
        if self.kind != MAP:
            return []
        component = problem.places[self.place].component
        own = (problem.places[problem.place(n)].component for n in problem.machines)
        return [k for k, c in enumerate(own, start=1) if c == component]

    def same(self, other: Candidate) -> bool:
        """Whether another is the same, with the same path."""
        return self.key == other.key and np.array_equal(self.patterns, other.patterns)

    def label(self, problem: LinearProblem) -> str:
        """In words."""
        where = problem.places[self.place].words
        return f"{where}: {self.kind}" + (f" along {self.driver}" if self.driver else "")


@dataclass(frozen=True)
class PlaceScore:
    """Q (N, N) and h (N,) of one place at one point of the noise."""

    place: int
    Q: np.ndarray
    h: np.ndarray


class Screening:
    """All candidates of a problem, scored at points of the noise."""

    def __init__(self, problem: LinearProblem):
        self.problem = problem
        self.moment, time_s, aircraft = problem.moments
        self.chain = StateChain.from_times(time_s, aircraft)
        self.curves = list(_curve_patterns(problem))
        finite = [d for d in problem.drivers if np.isfinite(d.values).all()]
        self.orders = [(d.short, np.argsort(d.values, kind="stable"), d.values) for d in finite]

    def place_scores(self, noise: StructuredNoise, white: Whitened) -> Iterator[PlaceScore]:
        """One place after the other."""
        N, m, L = self.problem.G.shape
        for place in range(L):
            if not self.problem.G[:, :, place].any():
                continue
            g = np.zeros((m, N))
            g[noise.sensor, noise.record] = self.problem.G[noise.record, noise.sensor, place]
            yield PlaceScore(place, *_collapsed(noise, white, g[noise.sensor, noise.record], N))

    def score_all(self, noise: StructuredNoise, white: Whitened) -> list[Candidate]:
        """Every candidate at one point of the noise, best first; of every kind and place the best."""
        found: list[Candidate] = []
        for score in self.place_scores(noise, white):
            found += self.candidates(score)
        return sorted(found, key=lambda c: -c.evidence)

    def candidates(self, score: PlaceScore) -> list[Candidate]:
        """Of one place."""
        p = self.problem.places[score.place]
        free = self._per_record(score, p.abrupt)
        return [free, self._switch(score, free), *self._curves(score, p.scale), *self._steps(score)]

    def _per_record(self, score: PlaceScore, scale: float) -> Candidate:
        N = len(score.h)
        prior = (float(np.log(USUAL_SHARE * scale)), SIZE_SPREAD)
        values = [_gaussian(score.Q, score.h, s) for s in np.exp(prior[0]) * SIZES]
        best = np.exp(prior[0]) * SIZES[int(np.argmax(values))]
        evidence = _averaged(values)
        return Candidate(PER_RECORD, score.place, np.eye(N), float(best), prior, 0.0, evidence)

    def _switch(self, score: PlaceScore, free: Candidate) -> Candidate:
        p = self.problem.places[score.place]
        s, (Q, h) = free.size, self._by_moment(score)
        a = s**2 * (h - Q @ np.linalg.solve(np.eye(len(h)) / s**2 + Q, h))
        starts = [np.zeros(len(h)), path_from_amplitudes(a, p.sign)]
        path = screened_path(Q, h, p.abrupt, p.sign, self.chain, starts)
        return Candidate(
            SWITCH, score.place, path.z[self.moment, None], p.abrupt, None, path.prior, path.evidence, sign=p.sign
        )

    def _steps(self, score: PlaceScore) -> list[Candidate]:
        """The best step along each driver: on above or below a value of it, every value between records tried."""
        p, N = self.problem.places[score.place], len(score.h)
        price = -float(np.log(2.0 * max(N - 1, 1) * max(len(self.orders), 1)))
        found = []
        for driver, order, value in self.orders:
            whole = np.cumsum(np.cumsum(score.Q[np.ix_(order, order)], axis=0), axis=1)
            b, corner = np.cumsum(score.h[order]), np.diag(whole)
            below = path_evidence(b, corner, p.scale, p.sign)
            above = path_evidence(b[-1] - b, whole[-1, -1] - 2.0 * whole[-1] + corner, p.scale, p.sign)
            both = np.stack([below, above])[:, LEAST_SIDE - 1 : N - LEAST_SIDE]
            if not both.size:
                continue
            side, k = np.unravel_index(int(np.argmax(both)), both.shape)
            last = k + LEAST_SIDE - 1
            z = np.zeros(N)
            z[order[: last + 1]] = 1.0
            z = z if side == 0 else 1.0 - z
            threshold = 0.5 * float(value[order[last]] + value[order[last + 1]])
            evidence = float(both[side, k]) + price
            found.append(
                Candidate(STEP, score.place, z[:, None], p.scale, None, price, evidence, driver, threshold, p.sign)
            )
        return found

    def _curves(self, score: PlaceScore, scale: float) -> list[Candidate]:
        prior = (float(np.log(USUAL_SHARE * scale)), SIZE_SPREAD)
        price = -float(np.log(max(len(self.curves), 1)))
        found: dict[str, Candidate] = {}
        for driver, length, patterns in self.curves:
            Q, h = patterns.T @ score.Q @ patterns, patterns.T @ score.h
            values = [_gaussian(Q, h, s) for s in np.exp(prior[0]) * SIZES]
            best = float(np.exp(prior[0]) * SIZES[int(np.argmax(values))])
            evidence = _averaged(values) + price
            if driver not in found or evidence > found[driver].evidence:
                found[driver] = Candidate(CURVE, score.place, patterns, best, prior, price, evidence, driver, length)
        return list(found.values())

    def again(self, candidate: Candidate, noise: StructuredNoise, white: Whitened) -> Candidate:
        """A switch with its path at another point of the noise, from the path that it has; others as they are."""
        if candidate.kind != SWITCH:
            return candidate
        g = self.problem.G[noise.record, noise.sensor, candidate.place]
        score = PlaceScore(candidate.place, *_collapsed(noise, white, g, len(self.problem)))
        Q, h = self._by_moment(score)
        z = np.zeros(len(h))
        z[self.moment] = candidate.patterns[:, 0]
        path = best_path(Q, h, candidate.size, candidate.sign, self.chain, z)
        return replace(candidate, patterns=path.z[self.moment, None], price=path.prior, evidence=path.evidence)

    def _by_moment(self, score: PlaceScore) -> tuple[np.ndarray, np.ndarray]:
        """Q and h of an amplitude that is one for all records of a moment."""
        T = len(self.chain.stay) - 1
        if len(score.h) == T:
            return score.Q, score.h
        P = np.zeros((len(score.h), T))
        P[np.arange(len(score.h)), self.moment] = 1.0
        return P.T @ score.Q @ P, P.T @ score.h

    def map_candidates(self) -> list[Candidate]:
        """Errors of each machine's map of free size: its place is that of its first quantity."""
        problem = self.problem
        found: dict[str, int] = {}
        for name in problem.machines:
            place = problem.place(name)
            found.setdefault(problem.places[place].component, place)
        empty = np.zeros((len(problem), 0))
        return [Candidate(MAP, place, empty, 1.0, None, 0.0, 0.0) for place in found.values()]


def _collapsed(noise: StructuredNoise, white: Whitened, g: np.ndarray, N: int) -> tuple[np.ndarray, np.ndarray]:
    """Q = ΓᵀC⁻¹Γ (N, N) and h = ΓᵀC⁻¹y (N,), from the column (n,) by rows."""
    Q, h = np.zeros((N, N)), np.zeros(N)
    for s, rows in enumerate(noise.blocks):
        own = noise.record[rows]
        h[own] += g[rows] * white.alpha[rows]
        for other in noise.blocks[s:]:
            part = g[rows, None] * white.precision[np.ix_(rows, other)] * g[None, other]
            Q[np.ix_(own, noise.record[other])] += part
            if other is not rows:
                Q[np.ix_(noise.record[other], own)] += part.T
    return Q, h


def _gaussian(Q: np.ndarray, h: np.ndarray, s: float) -> float:
    """ln evidence over no effect of independent amplitudes of standard deviation s."""
    L = np.linalg.cholesky(np.eye(len(h)) + s**2 * Q)
    w = linalg.solve_triangular(L, s * h, lower=True)
    return 0.5 * float(w @ w) - float(np.log(np.diag(L)).sum())


def _averaged(values: Sequence[float]) -> float:
    """ln of the evidence averaged over SIZES by their prior."""
    weight = -0.5 * (np.log(SIZES) / SIZE_SPREAD) ** 2
    weight -= np.logaddexp.reduce(weight)
    return float(np.logaddexp.reduce(np.array(values) + weight))


def _curve_patterns(problem: LinearProblem) -> Iterator[tuple[str, float, np.ndarray]]:
    """Driver, length and functions (N, k) of every free curve: a centred Gaussian process of unit variance."""
    N = len(problem)
    for d in problem.drivers:
        x = np.where(np.isfinite(d.values), d.values, np.nanmean(d.values))
        if not x.std() > 0.0:
            continue
        x = (x - x.mean()) / x.std()
        for length in LENGTHS:
            K = np.exp(-0.5 * ((x[:, None] - x[None, :]) / length) ** 2)
            K = K - K.mean(axis=0)
            K = K - K.mean(axis=1)[:, None]
            few = min(RANK, N)
            values, vectors = linalg.eigh(K, subset_by_index=[N - few, N - 1])
            keep = values > LEAST_SHARE * values[-1]
            yield d.short, length, vectors[:, keep] * np.sqrt(values[keep])
