"""What may have changed, and how probable that is by the data: every suspect with every shape and onset at once.

A change of the parameters e (q,) of one suspect with the shape g has, of scores b and information M,

    δ ~ mean over slabs σ of N(0, σ² I):    ln BF(σ) = ½ bᵀ(M + σ⁻²)⁻¹b − ½ ln|I + σ² M|

Then the sign: efficiencies fall, and what is found to have risen is as improbable as a repair is rare,

    ln BF += ln Π_j 2 [(1 − w_j) P(δ_j in the way of wear) + w_j P(against it)]

"Something else": all sensors off by independent amounts, with one step or ramp. Nothing is named after it.

Courses in time: how a change may come, stay, grow and go.

    step        g(t) = 1[t ≥ onset]                        ramp        (t − onset + 1)₊, 1 at the last flight
    saturating  1 − exp(−(t − onset + 1)/τ)                ramp, then steady    min((t − onset + 1)/duration, 1)
    pulse       1[onset ≤ t < end]                         ended       a ramp or saturating until `end`, 0 from there
    accelerating    (t − onset + 1)₊ᵏ: damage that feeds itself
    from the start  1                                      intermittent  1 in a set of flights that the data show

    growing, restored, growing    G(t) until `end`; then from L = kept · G(end − 1) on at the same rate, L + G(t − end),
                                  or with the same asymptote, L + (1 − L) G(t − end)

all scaled so that the largest value is 1; `onset` is the first flight with an effect, from 0. Onsets and ends are
looked at coarsely first: a course stands for the onsets and ends of its cell, and has their prior. Where it matters,
cells are opened.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property, lru_cache

import numpy as np
from scipy.special import gammaln, ndtr

from enginediag_cli.history.background import Background, History
from enginediag_cli.parameters import Parameter
from enginediag_cli.probability import log_sum, normalized_weights

FROM_START, STEP, RAMP, SATURATING, RAMP_HOLD = "from start", "step", "ramp", "saturating", "ramp, then steady"
PULSE, ENDED, RAMP_ENDED, WASHED = "pulse", "saturating, ended", "ramp, ended", "growing, restored, growing"
INTERMITTENT, IRREGULAR, ACCELERATING = "intermittent", "irregular", "accelerating"
LASTING = (STEP, RAMP, SATURATING, RAMP_HOLD, ACCELERATING)
"""Kinds that begin and last."""
KINDS = (FROM_START, *LASTING, PULSE, ENDED, RAMP_ENDED, WASHED, INTERMITTENT, IRREGULAR)
GROWING = frozenset({RAMP, SATURATING, ACCELERATING, RAMP_HOLD, ENDED, RAMP_ENDED, WASHED})
"""Kinds that grow for a while."""
WITH_END = frozenset({PULSE, ENDED, RAMP_ENDED, WASHED})
"""Kinds that something ends: afterwards the engine is as before, or partly so and grows worse again."""
RESTORED = WITH_END - {WASHED}
"""Kinds after whose end nothing grows again."""

COMPONENT_PRIOR: Mapping[str, float] = {
    STEP: 0.2,
    SATURATING: 0.2,
    RAMP: 0.15,
    ACCELERATING: 0.05,
    RAMP_HOLD: 0.1,
    PULSE: 0.06,
    ENDED: 0.03,
    RAMP_ENDED: 0.02,
    WASHED: 0.04,
    FROM_START: 0.05,
    INTERMITTENT: 0.04,
    IRREGULAR: 0.06,
}
"""How a component changes: wear and fouling as often as damage. Judgement; odds of ten between kinds cost 2.3 nats."""
INSTRUMENT_PRIOR: Mapping[str, float] = {
    STEP: 0.4,
    RAMP: 0.19,
    ACCELERATING: 0.01,
    FROM_START: 0.1,
    PULSE: 0.1,
    INTERMITTENT: 0.1,
    IRREGULAR: 0.03,
    SATURATING: 0.01,
    RAMP_HOLD: 0.04,
    ENDED: 0.004,
    RAMP_ENDED: 0.014,
    WASHED: 0.002,
}
"""How an instrument fails: mostly at once. Judgement."""

TAUS = (1.5, 2.5, 4.0, 6.0, 10.0, 18.0, 35.0)
"""Time constants of saturating growth, in flights: fouling after a wash takes tens of flights at most."""
ENDED_TAUS = (2.5, 6.0, 14.0)
"""Of growth that is ended: every other one, since its end is seen beside it."""
KEPT, KEPT_STEP = (0.2,), 0.05
"""Share of what had grown that stays after a wash, as looked at first, and by how much it is moved then."""
MOST_KEPT = 0.9
"""Largest share that stays after a wash: what brings back less is none."""
POWERS = (2.0, 4.0)
"""Of accelerating growth: a rate that rises evenly, and one that multiplies towards the end."""
DURATIONS = (0.15, 0.3, 0.5)
"""Of a ramp that ends by itself, in histories."""
ONSETS, ENDS = 30, 12
"""Onsets of courses without an end, and onsets and ends of those with one, that are looked at first."""
NEARBY = 8
"""Flights to either side of a plain event's onset at which its course is looked at again."""
REACH = 2
"""Flights by which onsets and ends are moved at once where a shape is climbed to its likeliest ones."""
PARTS = 4
"""Parts into which a cell is opened, each way: two rounds open the cells of two hundred flights."""
AT_MAINTENANCE = 0.8
"""Probability that what ends does so with recorded maintenance, where there is any: washes are recorded."""


@dataclass(frozen=True)
class ShapeTable:
    """K courses: values (K, T); kind (K,) position in `KINDS`; onset, end (K,), `end` T where there is none; scale (K,)
    time constant, duration or power, 0 of even growth; kept (K,): share that stays after a wash; cell (K, 2): how
    many onsets and ends each stands for; log_prior (2, K) of a component and of an instrument."""

    values: np.ndarray
    kind: np.ndarray
    onset: np.ndarray
    end: np.ndarray
    scale: np.ndarray
    kept: np.ndarray
    cell: np.ndarray
    log_prior: np.ndarray

    def __len__(self) -> int:
        return len(self.values)

    def select(self, rows: np.ndarray) -> ShapeTable:
        return ShapeTable(
            self.values[rows],
            self.kind[rows],
            self.onset[rows],
            self.end[rows],
            self.scale[rows],
            self.kept[rows],
            self.cell[rows],
            self.log_prior[:, rows],
        )


def shape_values(
    kind: str, onset: np.ndarray, end: np.ndarray, scale: np.ndarray, kept: np.ndarray, T: int
) -> np.ndarray:
    """g (K, T) of courses of one kind, the largest value of each 1."""
    if kind == WASHED:
        return _washed_values(onset, end, scale, kept, T)
    since = np.arange(T) - onset[:, None] + 1.0
    there = since > 0
    if kind in (SATURATING, ENDED):
        g = -np.expm1(-np.maximum(since, 0.0) / scale[:, None])
    elif kind == RAMP_HOLD:
        g = np.clip(since / scale[:, None], 0.0, 1.0)
    elif kind == ACCELERATING:
        g = (np.maximum(since, 0.0) / (T - onset[:, None])) ** scale[:, None]
    elif kind in (RAMP, RAMP_ENDED):
        g = np.maximum(since, 0.0)
    else:
        g = np.ones_like(since)
    g = np.where(there & (np.arange(T) < end[:, None]), g, 0.0)
    return np.asarray(g / np.maximum(g.max(axis=1, keepdims=True), 1e-9))


def _washed_values(onset: np.ndarray, end: np.ndarray, scale: np.ndarray, kept: np.ndarray, T: int) -> np.ndarray:
    t, tau = np.arange(T), scale[:, None]

    def grown(since: np.ndarray) -> np.ndarray:
        positive = np.maximum(since, 0.0)
        return np.where(tau > 0, -np.expm1(-positive / np.maximum(tau, 1e-9)), positive / T)

    before, again = grown(t - onset[:, None] + 1.0), grown(t - end[:, None] + 1.0)
    level = kept[:, None] * grown((end - onset)[:, None] + 0.0)
    after = level + np.where(tau > 0, 1 - level, 1.0) * again
    g = np.where(t < end[:, None], before, after)
    return np.asarray(g / np.maximum(g.max(axis=1, keepdims=True), 1e-9))


def _cells(first: int, last: int, most: int) -> tuple[np.ndarray, np.ndarray]:
    """Middles and sizes of the cells into which first … last are cut, `most` at most."""
    edges = np.unique(np.linspace(first, last + 1, min(most, last + 1 - first) + 1).round().astype(int))
    size = np.diff(edges)
    return edges[:-1] + size // 2, size


def _log_end_prior(end: np.ndarray, cell: np.ndarray, T: int, maintenance: Sequence[int]) -> np.ndarray:
    """Log probability of the ends of cells: any flight alike, or mostly those with maintenance."""
    anywhere = cell / max(T - 1, 1)
    if not len(maintenance):
        return np.asarray(np.log(anywhere))
    exact = np.isin(end, maintenance) & (cell == 1)
    return np.asarray(np.log((1 - AT_MAINTENANCE) * anywhere + AT_MAINTENANCE * exact / len(maintenance)))


def build_shapes(
    kind: str,
    onset: np.ndarray,
    end: np.ndarray,
    scale: np.ndarray,
    cell: np.ndarray,
    T: int,
    maintenance: Sequence[int],
    kept: np.ndarray | None = None,
) -> ShapeTable:
    """Courses of one kind with their priors: onsets uniform, time constants alike."""
    kept = np.zeros(len(onset)) if kept is None else kept
    alike = len(_scales(kind, T)) * (len(KEPT) if kind == WASHED else 1)
    log = np.zeros(len(onset)) - np.log(alike)
    if kind in WITH_END:
        log += np.log(cell[:, 0] / np.maximum(end - 1, 1)) + _log_end_prior(end, cell[:, 1], T, maintenance)
    elif kind != FROM_START:
        log += np.log(cell[:, 0] / (T - 1))
    number = KINDS.index(kind)
    prior = np.array([COMPONENT_PRIOR[kind], INSTRUMENT_PRIOR[kind]])
    values = shape_values(kind, onset, end, scale, kept, T)
    return ShapeTable(values, np.full(len(onset), number), onset, end, scale, kept, cell, np.log(prior)[:, None] + log)


def join_shapes(parts: Sequence[ShapeTable]) -> ShapeTable:
    """All of them."""
    return ShapeTable(
        np.concatenate([c.values for c in parts]),
        np.concatenate([c.kind for c in parts]),
        np.concatenate([c.onset for c in parts]),
        np.concatenate([c.end for c in parts]),
        np.concatenate([c.scale for c in parts]),
        np.concatenate([c.kept for c in parts]),
        np.concatenate([c.cell for c in parts]),
        np.concatenate([c.log_prior for c in parts], axis=1),
    )


def _taus(T: int) -> list[float]:
    return [tau for tau in TAUS if tau <= max(T / 3, TAUS[0])]


def _scales(kind: str, T: int) -> list[float]:
    if kind == SATURATING:
        return _taus(T)
    return {
        ENDED: list(ENDED_TAUS),
        WASHED: [0.0, *_taus(T)[1::2]],
        ACCELERATING: list(POWERS),
        RAMP_HOLD: [max(d * T, 2.0) for d in DURATIONS],
    }.get(kind, [0.0])


@lru_cache(maxsize=8)
def coarse_shapes(T: int, maintenance: tuple[int, ...] = ()) -> ShapeTable:
    """The courses that are looked at first; engines of a fleet mostly have as many flights."""
    none = np.zeros(1, int)
    parts = [build_shapes(FROM_START, none, none + T, none, np.ones((1, 2), int), T, maintenance)]
    onset, size = _cells(1, T - 1, ONSETS)
    for kind in LASTING:
        scale = np.repeat(_scales(kind, T), len(onset))
        many = len(_scales(kind, T))
        at, cell = np.tile(onset, many), np.column_stack([np.tile(size, many), np.ones(many * len(onset), int)])
        parts.append(build_shapes(kind, at, np.full(len(at), T), scale, cell, T, maintenance))
    first, first_size = _cells(0, T - 2, ENDS)
    last, last_size = _ends(T, maintenance)
    i, j = (x.ravel() for x in np.meshgrid(np.arange(len(first)), np.arange(len(last)), indexing="ij"))
    for kind in (PULSE, ENDED, RAMP_ENDED, WASHED):
        shortest = 1 if kind == PULSE else 3  # what grows for less than three flights is a pulse
        fits = last[j] - first[i] >= shortest
        for tau in _scales(kind, T):
            for kept in KEPT if kind == WASHED else KEPT[:1]:
                cell = np.column_stack([first_size[i], last_size[j]])[fits]
                at, end = first[i][fits], last[j][fits]
                same = np.ones(len(at))
                parts.append(build_shapes(kind, at, end, tau * same, cell, T, maintenance, kept * same))
    return join_shapes(parts)


def _ends(T: int, maintenance: Sequence[int]) -> tuple[np.ndarray, np.ndarray]:
    """Ends that are looked at first: those with maintenance, each by itself, and cells of all others."""
    last, size = _cells(1, T - 1, ENDS)
    known = np.array([k for k in maintenance if 0 < k < T], int)
    own = np.isin(last, known)
    return np.concatenate([last[~own], known]), np.concatenate([size[~own], np.ones(len(known), int)])


def open_cells(shapes: ShapeTable, rows: np.ndarray, T: int, maintenance: Sequence[int] = ()) -> ShapeTable:
    """The parts of the cells of the shapes `rows`."""
    parts: dict[str, list[np.ndarray]] = {}
    for k in rows:
        name = KINDS[shapes.kind[k]]
        n, e = (int(c) for c in shapes.cell[k])
        start = int(shapes.onset[k]) - n // 2
        onset, onset_size = _cells(start, start + n - 1, PARTS)
        end, end_size = np.array([T]), np.ones(1, int)
        if name in WITH_END:
            stop = int(shapes.end[k]) - e // 2
            end, end_size = _cells(stop, stop + e - 1, PARTS)
        i, j = np.nonzero(end > onset[:, None])
        same = np.ones(len(i))
        row = (onset[i], end[j], onset_size[i], end_size[j], shapes.scale[k] * same, shapes.kept[k] * same)
        parts.setdefault(name, []).append(np.stack(row))
    found = []
    for name, columns in parts.items():
        onset, end, onset_size, end_size, scale, kept = np.concatenate(columns, axis=1)
        cell = np.column_stack([onset_size, end_size]).astype(int)
        found.append(build_shapes(name, onset.astype(int), end.astype(int), scale, cell, T, maintenance, kept))
    return join_shapes(found)


def neighbours(shapes: ShapeTable, rows: np.ndarray, T: int, maintenance: Sequence[int] = ()) -> ShapeTable | None:
    """Shapes with onset and end up to `REACH` flights beside those of the shapes `rows`, as far as they are not there
    yet, each by itself; None where all are."""
    table = (shapes.kind, shapes.onset, shapes.end, shapes.scale.round(6), shapes.kept.round(6))
    known = set(zip(*(column.tolist() for column in table), strict=True))
    parts = []
    for k in rows:
        kind, onset, stop, scale, kept = (column[k].item() for column in table)
        name = KINDS[kind]
        first, reach = (0, 1) if name == WASHED else (0 if name in WITH_END else 1, REACH)
        onsets = range(max(onset - reach, first), min(onset + reach, T - 1) + 1)
        ends = range(max(stop - reach, 1), min(stop + reach, T - 1) + 1) if name in WITH_END else [T]
        moves = (-KEPT_STEP, 0.0, KEPT_STEP) if name == WASHED else (0.0,)
        shares = {round(min(max(kept + move, 0.0), MOST_KEPT), 6) for move in moves}
        new = [(n, e, r) for n in onsets for e in ends for r in shares if n < e and (kind, n, e, scale, r) not in known]
        if new:
            at, end, stays = (np.array(x) for x in zip(*new, strict=True))
            ones = np.ones((len(new), 2), int)
            parts.append(build_shapes(name, at, end, np.full(len(new), scale), ones, T, maintenance, stays))
    return join_shapes(parts) if parts else None


def nearby_shapes(shape: ShapeTable, T: int, maintenance: Sequence[int] = ()) -> ShapeTable:
    """Courses of all kinds with an onset near that of a shape (a table of one), each by itself: those that end where it
    ends, or those without an end where it has none."""
    onset, end = int(shape.onset[0]), int(shape.end[0])
    ended = KINDS[shape.kind[0]] in WITH_END
    none = np.zeros(1, int)
    parts = [shape]
    if not ended and onset <= NEARBY:
        parts.append(build_shapes(FROM_START, none, none + T, none, np.ones((1, 2), int), T, maintenance))
    first = np.arange(max(onset - NEARBY, 0 if ended else 1), min(onset + NEARBY, end - 1) + 1)
    for kind in KINDS:
        if (kind in WITH_END) != ended or kind in (FROM_START, INTERMITTENT, IRREGULAR):
            continue
        share = float(shape.kept[0]) or KEPT[0]
        for scale in _scales(kind, T):
            same, ones = np.full(len(first), scale), np.ones((len(first), 2), int)
            kept = np.full(len(first), share if kind == WASHED else 0.0)
            parts.append(build_shapes(kind, first, np.full(len(first), end), same, ones, T, maintenance, kept))
    return join_shapes(parts)


def moved_shapes(shape: ShapeTable, T: int, maintenance: Sequence[int] = ()) -> ShapeTable:
    """A shape (a table of one) with onsets up to `NEARBY` flights beside its own."""
    kind, own = KINDS[shape.kind[0]], int(shape.onset[0])
    if kind == FROM_START:
        return shape
    onset = np.arange(max(own - NEARBY, 0 if kind in WITH_END else 1), min(own + NEARBY, int(shape.end[0]) - 1) + 1)
    end, scale, kept = (np.full(len(onset), column[0]) for column in (shape.end, shape.scale, shape.kept))
    return build_shapes(kind, onset, end, scale, np.ones((len(onset), 2), int), T, maintenance, kept)


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
    """Of one suspect for K shapes and L slabs: log Bayes factor (K, L), mean and variance (K, L, q)."""

    log: np.ndarray
    mean: np.ndarray
    variance: np.ndarray


def size_posterior(b: np.ndarray, M: np.ndarray, suspect: Suspect) -> Sizes:
    """Of scores b (K, q) and information M (K, q, q)."""
    return _slab_posterior(b, M, np.array(suspect.wear), np.array(suspect.against))


def _slab_posterior(b: np.ndarray, M: np.ndarray, wear: np.ndarray, against: np.ndarray) -> Sizes:
    """Of scores b (…, q) and information M (…, q, q), along whose own directions the slabs are independent; wear,
    against (…, q): of a suspect, or of several along the last axis but one of b."""
    sigma, alone = np.array(SLABS)[:, None], b.shape[-1] == 1
    if alone:
        value, along = M[..., 0], b
    else:
        value, U = np.linalg.eigh(M)
        along = (b[..., None, :] @ U)[..., 0, :]
    value = np.maximum(value, 0.0)[..., None, :]
    spread = 1 / (value + sigma**-2)  # (…, L, q)
    shift = spread * along[..., None, :]
    log = 0.5 * np.sum(shift * along[..., None, :] - np.log1p(sigma**2 * value), axis=-1)
    mean, variance = shift, spread
    if not alone:
        back = np.swapaxes(U, -1, -2)
        mean, variance = shift @ back, spread @ back**2
    if wear.any():
        p = ndtr(wear[..., None, :] * mean / np.sqrt(variance))
        other = against[..., None, :]
        log += np.log(2 * (other + (1 - 2 * other) * p)).sum(axis=-1)
    return Sizes(log + np.log(SLAB_WEIGHTS), mean, variance)


@dataclass(frozen=True)
class SuspectGroup:
    """Suspects number `rows` (G,) with as many parameters each, all with a way of wear or none: their positions, wear
    and against (G, q), log prior (G,), and whether each is an instrument (G,); unlisted: it is what is not listed."""

    rows: np.ndarray
    positions: np.ndarray
    wear: np.ndarray
    against: np.ndarray
    log_prior: np.ndarray
    instrument: np.ndarray
    unlisted: bool


@dataclass(frozen=True)
class InformationBlocks:
    """Which elements of the information suspects need: pairs (2, c) of positions, and place (p, p) of each of these
    among the c, −1 of others; groups of suspects that are looked at together."""

    pairs: np.ndarray
    place: np.ndarray
    groups: tuple[SuspectGroup, ...]

    @staticmethod
    @lru_cache(maxsize=16)
    def from_suspects(suspects: tuple[Suspect, ...], width: int) -> InformationBlocks:
        """Those of the parameters that change together."""
        used = np.zeros((width, width), bool)
        members: dict[tuple[int, bool, bool], list[int]] = {}
        for k, suspect in enumerate(suspects):
            used[np.ix_(suspect.positions, suspect.positions)] = True
            key = len(suspect.positions), suspect.owner == UNLISTED, any(suspect.wear)
            members.setdefault(key, []).append(k)
        pairs = np.stack(np.nonzero(np.triu(used)))
        place = np.full((width, width), -1)
        place[pairs[0], pairs[1]] = place[pairs[1], pairs[0]] = np.arange(pairs.shape[1])
        groups = []
        for (_, unlisted, _), rows in members.items():
            own = [suspects[k] for k in rows]
            positions, wear, against = (
                np.array([getattr(s, name) for s in own]) for name in ("positions", "wear", "against")
            )
            prior = np.array([s.log_prior for s in own]) - unlisted * UNLISTED_SHAPES
            kind = np.array([int(s.instrument) for s in own])
            groups.append(SuspectGroup(np.array(rows), positions, wear, against, prior, kind, unlisted))
        return InformationBlocks(pairs, place, tuple(groups))

    def select(self, M: np.ndarray, own: np.ndarray) -> np.ndarray:
        """Information (n, …, q, q) of the parameters `own` (…, q), of M (n, c)."""
        return np.asarray(M[:, self.place[own[..., :, None], own[..., None, :]]])


@dataclass(frozen=True)
class Scan:
    """The posterior over one more change: shapes (K), b (K, p), M (K, c) by its blocks, log (G, K): log prior
    probability times Bayes factor of each suspect with each shape."""

    shapes: ShapeTable
    suspects: tuple[Suspect, ...]
    blocks: InformationBlocks
    b: np.ndarray
    M: np.ndarray
    log: np.ndarray

    @cached_property
    def log_odds(self) -> float:
        """That there is one more change, listed or not, against none."""
        return float(log_sum(self.log))

    def owners(self) -> dict[str, float]:
        """Log odds of each owner."""
        each = log_sum(self.log, 1)
        found: dict[str, float] = {}
        for suspect, log in zip(self.suspects, each, strict=True):
            found[suspect.owner] = float(np.logaddexp(found.get(suspect.owner, -np.inf), log))
        return found

    def sizes(self, suspect: int, shapes: np.ndarray) -> Sizes:
        """Of one suspect, for some shapes."""
        own = np.array(self.suspects[suspect].positions)
        M = self.blocks.select(self.M[shapes], own)
        return size_posterior(self.b[np.ix_(shapes, own)], M, self.suspects[suspect])

    def event(self, suspect: int, shape: int) -> Event:
        """One of the hypotheses with its likeliest size."""
        sizes = self.sizes(suspect, np.array([shape]))
        share = normalized_weights(sizes.log[0])
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
        one.blocks,
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
        blocks = InformationBlocks.from_suspects(self.suspects, self.history.width)
        b, M = background.project_pairs(self.shapes.values, blocks.pairs)
        log = np.full((len(self.suspects), len(self.shapes)), -np.inf)
        plain = np.flatnonzero(np.isin(self.shapes.kind, (KINDS.index(STEP), KINDS.index(RAMP))))
        for group in blocks.groups:
            rows = plain if group.unlisted else np.arange(len(self.shapes))
            own = group.positions
            sizes = _slab_posterior(b[rows][:, own], blocks.select(M[rows], own), group.wear, group.against)
            prior = group.log_prior[:, None] + self.shapes.log_prior[group.instrument][:, rows]
            log[np.ix_(group.rows, rows)] = prior + log_sum(sizes.log, -1).T
        owned = self.owners >= 0
        log[:, owned] = np.where(np.arange(len(log))[:, None] == self.owners[owned], log[:, owned], -np.inf)
        within = (self.shapes.onset < self.history.baseline) & (self.shapes.kind != KINDS.index(FROM_START))
        log[:, within] = -np.inf
        return Scan(self.shapes, self.suspects, blocks, b, M, log)


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
    before, after = g[:, :-1], g[:, 1:]
    n01, n10 = np.sum((1 - before) * after, axis=1), np.sum(before * (1 - after), axis=1)
    n00, n11 = np.sum((1 - before) * (1 - after), axis=1), np.sum(before * after, axis=1)
    counts = np.stack([n01, n00, n01 + n00 + 1, n10, n11, n10 + n11 + 1]).astype(int)
    factorial = gammaln(np.arange(g.shape[1] + 2) + 1.0)[counts]
    log = np.array([1.0, 1.0, -1.0, 1.0, 1.0, -1.0]) @ factorial - np.log(2)
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
