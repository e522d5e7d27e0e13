"""What may have changed, and how probable that is by the data: every suspect with every shape and onset at once.

A change of the parameters e (q,) of one suspect with the shape g has, of scores b and information M,

    δ ~ mean over slabs σ of N(0, σ² I):    ln BF(σ) = ½ bᵀ(M + σ⁻²)⁻¹b − ½ ln|I + σ² M|

Then the sign: efficiencies fall, and what is found to have risen is as improbable as a repair is rare,

    ln BF += ln Π_j 2 [(1 − w_j) P(δ_j in the way of wear) + w_j P(against it)]

"Something else": all sensors off by independent amounts, with one step or ramp. Nothing is named after it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
from scipy.special import ndtr

from enginediag_cli.history.background import Background
from enginediag_cli.history.records import History
from enginediag_cli.history.shapes import (
    COMPONENT_PRIOR,
    INSTRUMENT_PRIOR,
    INTERMITTENT,
    KINDS,
    RAMP,
    STEP,
    ShapeTable,
    join_shapes,
)
from enginediag_cli.parameters import Parameter

SLABS = (0.05, 0.15, 0.5, 1.5, 5.0, 20.0)
"""Sizes of changes in prior standard deviations: from a tenth of a per cent of an efficiency to a broken instrument."""
SLAB_WEIGHTS = (0.1, 0.25, 0.3, 0.2, 0.1, 0.05)
"""Their probabilities: most changes are of the size that a prior standard deviation states. Judgement."""
COMPONENT_RATE, INSTRUMENT_RATE, UNLISTED_RATE = 0.03, 0.015, 0.01
"""Probability that a component, an instrument, and something not listed, changes during a history. Judgement."""
TOGETHER = 0.6
"""Probability that efficiency and flow capacity of a component change together; else either alone."""
AGAINST_EFFICIENCY, AGAINST_FLOW = 0.05, 0.15
"""Probability that an efficiency, a flow capacity of a compressor, changes against its wear: a repair in service."""
UNLISTED = "something else"
UNLISTED_SHAPES = float(np.log(INSTRUMENT_PRIOR[STEP] + INSTRUMENT_PRIOR[RAMP]))
"""Log probability of the shapes that are looked at for it, whose own sum is one."""
PATTERNS = 4
"""Patterns of an intermittent fault by how many flights it is in, each way, for each suspect that is looked at."""
PATTERN_SUSPECTS = 4
"""Suspects for which patterns are looked at: those that scatter most from flight to flight."""


@dataclass(frozen=True)
class Suspect:
    """What may have changed: positions of its parameters, the component or instrument that owns them, log prior
    probability, and per parameter the way of wear (−1, 0, +1) with the probability of the other way."""

    positions: tuple[int, ...]
    owner: str
    log_prior: float
    instrument: bool
    wear: tuple[int, ...]
    against: tuple[float, ...]


def _way_of_wear(parameter: Parameter) -> tuple[int, float]:
    if parameter.wear:
        return parameter.wear, AGAINST_EFFICIENCY
    return 0, 0.5


def list_suspects(parameters: Sequence[Parameter], sensors: bool = True) -> tuple[Suspect, ...]:
    """All of them, those of one component next to each other. sensors: instruments may have changed."""
    members: dict[str, list[int]] = {}
    for i, parameter in enumerate(parameters):
        if sensors or not parameter.belongs_to_instrument:
            members.setdefault(parameter.component, []).append(i)
    found = []
    for owner, own in members.items():
        instrument = all(parameters[i].belongs_to_instrument for i in own)
        rate = INSTRUMENT_RATE if instrument else COMPONENT_RATE
        sets: list[tuple[tuple[int, ...], float]] = [((i,), 1 / len(own)) for i in own]
        if not instrument and len(own) > 1:
            sets = [(tuple(own), TOGETHER)] + [((i,), (1 - TOGETHER) / len(own)) for i in own]
        for positions, share in sets:
            ways = [_way_of_wear(parameters[i]) for i in positions]
            wear, against = tuple(w for w, _ in ways), tuple(a for _, a in ways)
            found.append(Suspect(positions, owner, float(np.log(rate * share)), instrument, wear, against))
    everything = tuple(i for i, p in enumerate(parameters) if p.belongs_to_sensor and p.quantity == "bias")
    if sensors and len(everything) > 1:
        none = (0,) * len(everything)
        found.append(Suspect(everything, UNLISTED, float(np.log(UNLISTED_RATE)), True, none, (0.5,) * len(none)))
    return tuple(found)


@dataclass(frozen=True)
class Event:
    """One change: the suspect, its shape (a table of one), its size (q,) at the shape's largest value and the slab that
    holds it, in prior standard deviations; doubt: share to which its effect on each sensor is known;
    irregular: probability that its course is of none of the shapes."""

    suspect: Suspect
    shape: ShapeTable
    size: np.ndarray
    slab: float
    doubt: float = 0.0
    irregular: float = 0.0

    @property
    def course(self) -> np.ndarray:
        """g (T,)."""
        return np.asarray(self.shape.values[0])

    @property
    def kind(self) -> str:
        return KINDS[int(self.shape.kind[0])]

    @property
    def key(self) -> tuple[tuple[int, ...], bytes, float, float, bool]:
        """What tells it from others."""
        doubts = round(self.doubt, 3), self.irregular >= 0.5
        return self.suspect.positions, self.course.tobytes(), round(self.slab, 3), *doubts

    @property
    def log_prior(self) -> float:
        """Of the suspect, the shape and the slab."""
        slab = SLAB_WEIGHTS[int(np.argmin(np.abs(np.log(np.array(SLABS) / self.slab))))]
        shape = float(self.shape.log_prior[int(self.suspect.instrument), 0])
        return self.suspect.log_prior + shape + float(np.log(slab))


@dataclass(frozen=True)
class Sizes:
    """Of one suspect for K shapes and L slabs: log Bayes factor (K, L), mean (K, L, q), covariance (K, L, q, q)."""

    log: np.ndarray
    mean: np.ndarray
    covariance: np.ndarray


def size_posterior(b: np.ndarray, M: np.ndarray, suspect: Suspect) -> Sizes:
    """Of scores b (K, q) and information M (K, q, q)."""
    q = b.shape[1]
    sigma = np.array(SLABS)
    precision = M[:, None] + (sigma**-2)[:, None, None] * np.eye(q)
    covariance = np.asarray(1 / precision if q == 1 else np.linalg.inv(precision))
    log_det = np.log(precision[..., 0, 0]) if q == 1 else np.linalg.slogdet(precision)[1]
    mean = np.einsum("klij,kj->kli", covariance, b)
    log = 0.5 * np.einsum("kli,ki->kl", mean, b) - 0.5 * (log_det + 2 * q * np.log(sigma))
    for j, (way, against) in enumerate(zip(suspect.wear, suspect.against, strict=True)):
        if way:
            p = ndtr(way * mean[..., j] / np.sqrt(covariance[..., j, j]))
            log = log + np.log(2 * ((1 - against) * p + against * (1 - p)))
    return Sizes(log + np.log(SLAB_WEIGHTS), mean, covariance)


@dataclass(frozen=True)
class Scan:
    """The posterior over one more change: shapes (K), b (K, p), M (K, p, p), log (G, K): log prior probability times
    Bayes factor of each suspect with each shape."""

    shapes: ShapeTable
    suspects: tuple[Suspect, ...]
    b: np.ndarray
    M: np.ndarray
    log: np.ndarray

    @property
    def log_odds(self) -> float:
        """That there is one more change, listed or not, against none."""
        return float(np.logaddexp.reduce(self.log, axis=None))

    def owners(self) -> dict[str, float]:
        """Log odds of each owner."""
        each = np.logaddexp.reduce(self.log, axis=1)
        found: dict[str, float] = {}
        for suspect, log in zip(self.suspects, each, strict=True):
            found[suspect.owner] = float(np.logaddexp(found.get(suspect.owner, -np.inf), log))
        return found

    def sizes(self, suspect: int, shapes: np.ndarray) -> Sizes:
        """Of one suspect, for some shapes."""
        own = np.array(self.suspects[suspect].positions)
        b, M = self.b[np.ix_(shapes, own)], self.M[np.ix_(shapes, own, own)]
        return size_posterior(b, M, self.suspects[suspect])

    def event(self, suspect: int, shape: int) -> Event:
        """One of the hypotheses with its likeliest size."""
        sizes = self.sizes(suspect, np.array([shape]))
        share = np.exp(sizes.log[0] - np.logaddexp.reduce(sizes.log[0]))
        size = share @ sizes.mean[0]
        slab = float(max(SLABS[int(np.argmax(share))], np.abs(size).max()))
        return Event(self.suspects[suspect], self.shapes.select(np.array([shape])), size, slab)

    def best_event(self, owner: str = "") -> Event:
        """The likeliest event, of one owner where that is named."""
        log = self.log
        if owner:
            log = np.where(np.array([s.owner == owner for s in self.suspects])[:, None], log, -np.inf)
        g, k = (int(i) for i in np.unravel_index(int(np.argmax(log)), log.shape))
        return self.event(g, k)


def join_scans(one: Scan, kept: np.ndarray, other: Scan) -> Scan:
    """The shapes `kept` of one scan with all of another of the same background."""
    return Scan(
        join_shapes([one.shapes.select(kept), other.shapes]),
        one.suspects,
        np.concatenate([one.b[kept], other.b]),
        np.concatenate([one.M[kept], other.M]),
        np.concatenate([one.log[:, kept], other.log], axis=1),
    )


@dataclass(frozen=True)
class HypothesisSpace:
    """Suspects and shapes that are looked at in a history; owners (K,): the suspect that alone may have each shape, −1
    where all may."""

    history: History
    suspects: tuple[Suspect, ...]
    shapes: ShapeTable
    owners: np.ndarray = field(default_factory=lambda: np.zeros(0, int))

    def scan(self, background: Background) -> Scan:
        """The posterior over one more change before this background."""
        b, M = background.project(self.shapes.values)
        log = np.full((len(self.suspects), len(self.shapes)), -np.inf)
        plain = np.isin(self.shapes.kind, (KINDS.index(STEP), KINDS.index(RAMP)))
        for k, suspect in enumerate(self.suspects):
            rows = np.flatnonzero(plain if suspect.owner == UNLISTED else (self.owners < 0) | (self.owners == k))
            own = np.array(suspect.positions)
            sizes = size_posterior(b[np.ix_(rows, own)], M[np.ix_(rows, own, own)], suspect)
            prior = suspect.log_prior + self.shapes.log_prior[int(suspect.instrument), rows]
            if suspect.owner == UNLISTED:
                prior = prior - UNLISTED_SHAPES
            log[k, rows] = prior + np.logaddexp.reduce(sizes.log, axis=1)
        return Scan(self.shapes, self.suspects, b, M, log)


def pattern_shapes(
    background: Background, suspects: Sequence[Suspect], flights: int
) -> tuple[ShapeTable, np.ndarray] | None:
    """Shapes of intermittent faults that single flights suggest, and the suspect (K,) of each: the k flights in which
    it is estimated largest, and smallest, for several k.

    Prior of a pattern: a two-state Markov chain whose two probabilities of changing are uniform,
    P = B(n01 + 1, n00 + 1) B(n10 + 1, n11 + 1), with two appearances at least.
    """
    if flights < 6:
        return None
    single = [k for k, s in enumerate(suspects) if len(s.positions) == 1]
    estimate, weight = background.single_flights(np.array([suspects[k].positions[0] for k in single]))
    level = np.median(estimate, axis=0)
    scatter = np.sum(weight * (estimate - level) ** 2, axis=0)
    patterns, owner = [], []
    for c in np.argsort(-scatter)[:PATTERN_SUSPECTS]:
        b, K = background.flights(suspects[single[c]].positions[0])
        for way in (1.0, -1.0):
            found = _best_patterns(way * (estimate[:, c] - level[c]), weight[:, c])
            patterns += [*found, _climb_pattern(found[0], b, K)]
            owner += [single[c]] * (len(found) + 1)
    g, who = np.array(patterns), np.array(owner)
    kept = np.isfinite(_log_markov(g))
    return (_pattern_table(g[kept]), who[kept]) if kept.any() else None


def nearby_patterns(pattern: np.ndarray) -> ShapeTable:
    """A pattern (T,) of an intermittent fault, and those that differ from it in one flight."""
    g = np.concatenate([pattern[None], np.abs(pattern - np.eye(len(pattern)))])
    return _pattern_table(g[np.isfinite(_log_markov(g))])


def _pattern_table(g: np.ndarray) -> ShapeTable:
    """Patterns (K, T) of intermittent faults with their priors."""
    count, flights = g.shape
    prior = np.log([[COMPONENT_PRIOR[INTERMITTENT]], [INSTRUMENT_PRIOR[INTERMITTENT]]]) + _log_markov(g)
    first, kind = g.argmax(axis=1), np.full(count, KINDS.index(INTERMITTENT))
    none, ones = np.zeros(count), np.ones((count, 2), int)
    return ShapeTable(g, kind, first, np.full(count, flights), none, none, ones, prior)


def _best_patterns(estimate: np.ndarray, weight: np.ndarray) -> np.ndarray:
    """Sets of flights (n, T) in which estimates (T,), of information `weight` (T,), are largest: for the numbers k that
    explain them best, each by itself, ½ (Σ w e)²/Σ w plus the log prior of the pattern."""
    T = len(estimate)
    order = np.argsort(-estimate, kind="stable")
    place = np.empty(T, int)
    place[order] = np.arange(T)
    k = np.arange(2, T // 2 + 2)
    g = (place[None, :] < k[:, None]).astype(float)
    moved = np.cumsum((weight * estimate)[order])[k - 1]
    gain = 0.5 * np.maximum(moved, 0.0) ** 2 / np.cumsum(weight[order])[k - 1] + _log_markov(g)
    return np.asarray(g[np.argsort(-gain, kind="stable")[:PATTERNS]])


def _climb_pattern(g: np.ndarray, b: np.ndarray, K: np.ndarray) -> np.ndarray:
    """The pattern (T,) with flights exchanged one by one, each time the one that adds most to

        ½ (gᵀb)² / (gᵀKg + 1) + ln P(g)

    of scores b (T,) and information K (T, T) that all flights share what is uncertain beside the fault."""
    T = len(g)
    flip = np.eye(T)
    for _ in range(T):
        turned = np.concatenate([g[None], np.abs(g - flip)])
        change = 1 - 2 * g
        Kg = K @ g
        total = g @ b + np.concatenate([[0.0], change * b])
        known = g @ Kg + np.concatenate([[0.0], 2 * change * Kg + np.diag(K)])
        gain = 0.5 * total**2 / (np.maximum(known, 0.0) + 1) + _log_markov(turned)
        k = int(np.argmax(gain))
        if k == 0 or gain[k] <= 0:
            break
        g = turned[k]
    return g


def _log_markov(g: np.ndarray) -> np.ndarray:
    """Log prior (K,) of patterns g (K, T) of 0 and 1; −inf with fewer than two appearances."""
    from scipy.special import betaln

    before, after = g[:, :-1], g[:, 1:]
    n01, n10 = np.sum((1 - before) * after, axis=1), np.sum(before * (1 - after), axis=1)
    n00, n11 = np.sum((1 - before) * (1 - after), axis=1), np.sum(before * after, axis=1)
    log = betaln(n01 + 1, n00 + 1) + betaln(n10 + 1, n11 + 1) - np.log(2)
    return np.where(n01 + g[:, 0] >= 2, log, -np.inf)


def with_patterns(space: HypothesisSpace, background: Background) -> HypothesisSpace:
    """The space with intermittent shapes that single flights suggest before this background."""
    found = pattern_shapes(background, space.suspects, len(space.history))
    plain = space.shapes.select(np.flatnonzero(space.shapes.kind != KINDS.index(INTERMITTENT)))
    nobody = np.full(len(plain), -1)
    if found is None:
        return HypothesisSpace(space.history, space.suspects, plain, nobody)
    table, who = found
    shapes = join_shapes([plain, table])
    return HypothesisSpace(space.history, space.suspects, shapes, np.concatenate([nobody, who]))
