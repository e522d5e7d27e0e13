"""What is known after the flights: whether anything changed, what, how, since when, how much now.

`judge_history` is the whole chain: offsets learnt and marginalised, wander weighed, events searched, each looked at
again with the others as they are. Every number is averaged over shapes, onsets and parameters of the suspect that is
named; the size includes what its course may be off by.

The health of an engine over its flights, instruments' errors aside: what margins and forecasts are made of.

    θ_t = Σ_i a_i g_i(t) + w(t) + Σ_e r_e 1[t ≥ t_e]      (of components)

a_i: the events as found, with their doubts, those of instruments beside them; w: a free smooth change of each health
parameter, a Brownian motion whose size is weighed by its evidence, since a component may have worn by what is no
event yet; r_e: what maintenance may have moved. All of it is one Gaussian, given the events: level and covariance per
flight, and what each maintenance changed. What the model gets wrong about an event stands beside it: it is no health of
the component that is named, but the readings have it, and a temperature has it.

`knots` are the same flights without the prior of a course, for a forecast that fits a law of growth to them: the
health of each stretch of flights by itself, with the covariance of its errors.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import product

import numpy as np
from scipy.special import expit, ndtr
from scipy.stats import chi2

from enginediag_cli.history.background import (
    Background,
    History,
    OffsetModel,
    inner,
    learn_offsets,
    marginalise_offsets,
    nominal_basis,
    wander_modes,
)
from enginediag_cli.history.hypotheses import (
    FROM_START,
    GROWING,
    INTERMITTENT,
    IRREGULAR,
    KINDS,
    PULSE,
    UNLISTED,
    WASHED,
    WITH_END,
    Event,
    Scan,
    list_suspects,
)
from enginediag_cli.history.search import (
    HistorySearch,
    WanderChoice,
    exchange,
    find_with_wander,
    leading_suspects,
    owner_shares,
    prepare_search,
    weigh_wander,
)
from enginediag_cli.probability import NORMAL_95, normalized_weights

FREE_SIZES = (0.03, 0.1, 0.3)
"""Standard deviation of the free change at the end, in prior ones: hardly, as much as is no event yet in a few flights,
and what is seen as an event otherwise."""
FREE_WEIGHTS = (0.5, 0.3, 0.2)
"""Probability of each before the flights are seen, as of instruments that wander."""
LEVEL_SIZES, LEVEL_WEIGHTS = (0.03, 0.1, 0.3, 1.0), (0.4, 0.3, 0.2, 0.1)
"""Standard deviation of what an engine had worn before its first flight here beside what the events say, in prior ones,
and the probability of each beforehand: as of the free change, and seldom as far as a change plausibly goes."""
RESTORED = 0.5
"""Standard deviation of what maintenance moves beside what the events say, in prior ones: half of a change."""
KNOTS = 24
"""Stretches of flights of a forecast at most: a law of growth has three free numbers, and each takes a few."""
OPEN, CLOSED = 2.0, FREE_SIZES[-1]
"""Standard deviation of health of a stretch beforehand, in prior ones, of what changed by the events and of what did
not: hardly more than the flights themselves say, and what is no event."""


@dataclass(frozen=True)
class HealthStep:
    """What maintenance before epoch `epoch`, from 0, changed: level (w,) before it, change (w,) with its covariance
    (w, w), as the levels of a `HealthPath`."""

    epoch: int
    before: np.ndarray
    change: np.ndarray
    covariance: np.ndarray

    def select(self, at: Sequence[int]) -> HealthStep:
        """Of the parameters at positions `at` (k,) alone."""
        return HealthStep(self.epoch, self.before[at], self.change[at], self.covariance[np.ix_(at, at)])


@dataclass(frozen=True)
class HealthPath:
    """Health parameters over T epochs, in their units.

    A level has w = q + m numbers: the q health parameters, and by what m readings differ from what the model makes of
    the changes of these, `readings` by the names of their biases: of the engine, not of instruments.

    level (T, w), covariance (T, w, w): what changed since the first; total (T, w), total_covariance (T, w, w): from
    nominal, with the engine's own level where it has one; steps: of each maintenance; knots (E,): first epoch of each
    stretch of a forecast; stretch (E q,), stretch_covariance (E q, E q): health of each by itself and its errors.
    """

    parameters: tuple[str, ...]
    readings: tuple[str, ...]
    level: np.ndarray
    covariance: np.ndarray
    total: np.ndarray
    total_covariance: np.ndarray
    steps: tuple[HealthStep, ...]
    knots: np.ndarray
    stretch: np.ndarray
    stretch_covariance: np.ndarray

    @staticmethod
    def mixture(weights: Sequence[float], paths: Sequence[HealthPath]) -> HealthPath:
        """Mean and covariance of several paths of one history, by their probabilities."""

        def mix(means: Sequence[np.ndarray], covariances: Sequence[np.ndarray]) -> tuple[np.ndarray, np.ndarray]:
            w = np.array(weights)
            mean = np.tensordot(w, np.stack(means), 1)
            off = np.stack(means) - mean
            spread = np.stack(covariances) + off[..., :, None] * off[..., None, :]
            return mean, np.tensordot(w, spread, 1)

        level = mix([x.level for x in paths], [x.covariance for x in paths])
        total = mix([x.total for x in paths], [x.total_covariance for x in paths])
        steps = []
        for same in zip(*(x.steps for x in paths), strict=True):
            before = np.tensordot(np.array(weights), np.stack([x.before for x in same]), 1)
            change = mix([x.change for x in same], [x.covariance for x in same])
            steps.append(HealthStep(same[0].epoch, before, *change))
        stretch = mix([x.stretch for x in paths], [x.stretch_covariance for x in paths])
        one = paths[0]
        return HealthPath(one.parameters, one.readings, *level, *total, tuple(steps), one.knots, *stretch)

    def reading_slope(self, slope: np.ndarray, reading: str = "") -> np.ndarray:
        """Derivatives (w,) of what follows the health parameters by slope (q,), as the flights show it: with what the
        model gets wrong about changes where it has a reading, named by its bias."""
        return np.concatenate([slope, [float(name == reading) for name in self.readings]])

    def project_level(self, slope: np.ndarray, *, total: bool = False) -> tuple[np.ndarray, np.ndarray]:
        """Mean and standard deviation (T,) of slope (w,) times the level, or the total."""
        level, C = (self.total, self.total_covariance) if total else (self.level, self.covariance)
        return level @ slope, np.sqrt(np.maximum(np.einsum("i,tij,j->t", slope, C, slope), 0.0))

    def project_stretches(self, slope: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Of each stretch (E,), with the covariance (E, E) of its errors."""
        E, q = len(self.knots), len(self.parameters)
        blocks = self.stretch_covariance.reshape(E, q, E, q)
        return self.stretch.reshape(E, q) @ slope, np.einsum("i,eifj,j->ef", slope, blocks, slope)


def health_path(
    history: History, background: Background, events: tuple[np.ndarray, np.ndarray], wrong: np.ndarray
) -> HealthPath:
    """The health of a history whose offsets are marginalised, beside the background without events.

    events (T, p, c), (2, c): columns of all events and their doubts, of standard normal amount, and whether each is a
    change, and an error of the model about a component's; wrong (T, p, d): of those of instruments alone.
    """
    H = np.array([i for i, p in enumerate(history.parameters) if not p.belongs_to_instrument], int)
    S = history.sensors
    names, readings = (tuple(history.parameters[i].name for i in at) for at in (H, S))
    own, unit = history.unit[H], history.unit[np.concatenate([H, S])]
    knots = _knots(len(history), history.maintenance)
    both = np.outer(unit, unit)
    smooth = _smooth(history, background, events, H)
    r = len(background.d)
    moved_by = [0.0 * shift.course if shift.constant else shift.course for shift in history.shifts]
    level, covariance = smooth.evaluate(smooth.rows, KnownMoves.from_history(history, H, r, moved_by))
    every = [shift.course for shift in history.shifts]
    total, total_covariance = smooth.evaluate(smooth.rows, KnownMoves.from_history(history, H, r, every))
    moved = []
    for t in history.maintenance:
        across = KnownMoves.from_history(history, H, r, [np.diff(shift.course)[t - 1 : t] for shift in history.shifts])
        rows = smooth.rows[t : t + 1] - smooth.rows[t - 1 : t]
        (change,), (error,) = smooth.evaluate(rows, across if history.shifts else KnownMoves.none(1, len(unit), r))
        moved.append(HealthStep(t, unit * total[t - 1], unit * change, both * error))
    changed = np.any((events[0] * events[1][0])[:, H] != 0, axis=(0, 2))
    stretch, errors = _stretches(history, background, wrong, (H, changed), knots)
    scale = np.tile(own, len(knots))
    return HealthPath(
        names,
        readings,
        unit * level,
        both * covariance,
        unit * total,
        both * total_covariance,
        tuple(moved),
        knots,
        scale * stretch,
        scale[:, None] * errors * scale,
    )


def _knots(T: int, maintenance: Sequence[int]) -> np.ndarray:
    even = np.linspace(0, T, min(KNOTS, T), endpoint=False).round().astype(int)
    return np.unique(np.concatenate([even, np.array(maintenance, int)]))


@dataclass(frozen=True)
class _SmoothHealth:
    """rows (T, w, c): health by coefficients x of events, free change and maintenance, whose law is a mixture of normal
    ones: mean (c,) and covariance (c, c) of each, with weights `share`. Unit normals z that all flights share are

    z | x ~ N(A⁻¹(d − Nᵀx), A⁻¹),   N = hᵀB

    and move health by shifts that are known."""

    rows: np.ndarray
    found: Sequence[tuple[np.ndarray, np.ndarray]]
    share: np.ndarray
    inverse: np.ndarray
    d: np.ndarray
    N: np.ndarray

    def evaluate(self, rows: np.ndarray, shifts: KnownMoves) -> tuple[np.ndarray, np.ndarray]:
        """Mean (n, w) and covariance (n, w, w) of rows (n, w, c) x + shifts (n, w, r) z."""
        W = shifts.moves @ self.inverse
        rows = rows - W @ self.N.T
        means = [rows @ mean for mean, _ in self.found]
        mean = np.einsum("s,stq->tq", self.share, np.stack(means))
        covariance = W @ shifts.moves.transpose(0, 2, 1) + shifts.unknown
        for w, own, (_, C) in zip(self.share, means, self.found, strict=True):
            off = own - mean
            covariance += w * (rows @ C @ rows.transpose(0, 2, 1) + off[:, :, None] * off[:, None, :])
        return mean + W @ self.d, covariance


@dataclass(frozen=True)
class KnownMoves:
    """What the unit normals z move levels by: moves (n, w, r), and covariance (n, w, w) of what flights do not know of
    it at all."""

    moves: np.ndarray
    unknown: np.ndarray

    @staticmethod
    def none(n: int, w: int, r: int) -> KnownMoves:
        return KnownMoves(np.zeros((n, w, r)), np.zeros((n, w, w)))

    @staticmethod
    def from_history(history: History, H: np.ndarray, r: int, courses: Sequence[np.ndarray]) -> KnownMoves:
        """Along courses (n,) of the shifts of a history, in their order; r unit normals are uncertain."""
        basis, width = nominal_basis(history), len(H) + len(history.sensors)
        if not courses:
            return KnownMoves.none(len(history), width, r)
        n = len(courses[0])
        full = np.zeros((n, width, len(basis)))
        place = {int(i): k for k, i in enumerate(H)}
        for shift, course in zip(history.shifts, courses, strict=True):
            for j, (i, size) in enumerate(zip(shift.positions, shift.sizes, strict=True)):
                if int(i) in place:
                    full[:, place[int(i)], shift.first + j] += course * size
        moves = np.zeros((n, width, r))
        moves[:, :, : basis.shape[1]] = full @ basis
        return KnownMoves(moves, full @ full.transpose(0, 2, 1) - moves @ moves.transpose(0, 2, 1))


def _smooth(
    history: History, background: Background, found_events: tuple[np.ndarray, np.ndarray], H: np.ndarray
) -> _SmoothHealth:
    """Health by events, a free change and what maintenance restored, in prior standard deviations."""
    events, (real, in_error) = found_events
    T, p = len(history), history.width
    walk = _each_parameter(wander_modes(T), H, p)
    # an engine whose own first flights are no reference may have been worn before them
    worn = _each_parameter(np.ones((T, 0 if any(s.constant for s in history.shifts) else 1)), H, p)
    known = [int(np.argmax(shift.course > 0)) for shift in history.shifts]
    restored = np.array([t for t in history.maintenance if t not in known], int)
    at = (np.arange(T)[:, None] >= restored[None, :]).astype(float)
    h = np.concatenate([events, walk, worn, RESTORED * _each_parameter(at, H, p)], axis=2)
    b, M = background.joint(h)
    log, found = [], []
    first, second = events.shape[2], events.shape[2] + walk.shape[2]
    levels = list(zip(LEVEL_SIZES, LEVEL_WEIGHTS, strict=True)) if worn.shape[2] else [(1.0, 1.0)]
    for (size, likely), (level, also) in product(zip(FREE_SIZES, FREE_WEIGHTS, strict=True), levels):
        scale = np.ones(len(b))
        scale[first:second] = size
        scale[second : second + worn.shape[2]] = level
        posterior = np.linalg.inv(scale[:, None] * M * scale + np.eye(len(b)))
        mean = posterior @ (scale * b)
        log.append(
            np.log(likely * also) + 0.5 * float(mean @ (scale * b)) + 0.5 * float(np.linalg.slogdet(posterior)[1])
        )
        found.append((scale * mean, scale[:, None] * posterior * scale))
    share = normalized_weights(np.array(log))
    N = inner(h, background.B)
    rest = np.ones(h.shape[2] - len(real))
    change, error = h * np.concatenate([real, rest]), h * np.concatenate([in_error, 0 * rest])
    # an error ε of the model, in terms of the parameters, as it is in the readings: e = F_SS⁻¹ F_S ε
    F, S = history.information[:, :, :p], history.sensors
    read = np.linalg.pinv(F[:, S[:, None], S], hermitian=True) @ F[:, S] @ error
    rows = np.concatenate([change[:, H], read], axis=1)
    return _SmoothHealth(rows, found, share, np.linalg.inv(background.A), background.d, N)


def _stretches(
    history: History,
    background: Background,
    wrong: np.ndarray,
    health: tuple[np.ndarray, np.ndarray],
    knots: np.ndarray,
) -> tuple[np.ndarray, np.ndarray]:
    """Health (E q,) of each stretch by itself, what instruments are wrong by marginalised, and its sampling errors;
    health (q,), (q,): positions of its parameters, and which of them changed by the events."""
    T, p = len(history), history.width
    H, changed = health
    number = np.searchsorted(knots, np.arange(T), side="right") - 1
    own = (number[:, None] == np.arange(len(knots))).astype(float)
    h = np.concatenate([_each_parameter(own, H, p), wrong], axis=2)
    b, M = background.joint(h)
    E = len(knots) * len(H)
    precision = np.tile(np.where(changed, OPEN, CLOSED) ** -2.0, len(knots))
    inverse = np.linalg.inv(M + np.diag(np.concatenate([precision, np.ones(len(b) - E)])))
    return (inverse @ b)[:E], (inverse @ M @ inverse)[:E, :E]


def _each_parameter(courses: np.ndarray, H: np.ndarray, p: int) -> np.ndarray:
    """Columns (T, p, k q) of courses (T, k), each of every parameter at positions H (q,)."""
    T, k = courses.shape
    h = np.zeros((T, p, k, len(H)))
    for c, i in enumerate(H):
        h[:, i, :, c] = courses
    return h.reshape(T, p, k * len(H))


FEWEST_FLIGHTS = 3
"""A level before, one after, and one to tell scatter from either."""
ONSET_SET = 0.95
"""Probability of a set of onsets."""
EVENT = 0.5
"""Probability from which an event is reported as one: likelier than not."""
AVERAGED, AVERAGED_SHARE = 12, 0.02
"""Hypotheses over which a size is averaged at most, and least probability of each."""
PLAIN = 50.0
"""Log odds of an event beyond which its course is doubted: below, the doubt is less than what the data leave open."""
CLEARLY = 0.67
"""Share of its variance to which an offset must fall without the events to be worth another judgement: a fifth in size
is less than what twenty flights know of it."""
NOTICED = 0.1
"""Variance of an offset, in those of a flight's mean reading, below which it takes too little information to matter."""
LARGEST_STEP = 0.25
"""Share of a component's largest change that it loses from one flight to the next where something was restored."""
GROWN_AND_ENDED = WASHED
"""Shape of growth that maintenance took back, in whole or in part."""
LEAST_SPREAD = 1e-9
"""Standard deviation, in prior ones, of what is known to be zero."""


@dataclass(frozen=True)
class HistoryChange:
    """Change of one parameter by one event in its unit: now (at the last flight) and at its largest, with 95 %
    intervals; probability that it takes part."""

    name: str
    probability: float
    now: float
    now_low: float
    now_high: float
    largest: float
    largest_low: float
    largest_high: float

    @property
    def sign(self) -> int:
        """Way of the change at its largest; 0 where its interval holds both."""
        return int(np.sign(self.largest)) if self.largest_low * self.largest_high > 0 else 0


@dataclass(frozen=True)
class ChangeEvent:
    """One change. probability: that it happened, the others given; suspects: component or instrument → probability,
    likeliest first; shapes: kind → probability; onset: first flight with an effect, from 0, and the flights of its 95 %
    set; end: first flight without effect again, −1 where there is none; changes: of the likeliest suspect's
    parameters; covariance (q, q): of these at the last flight, that they may be zero counted; rivals: changes of the
    parameters of the others of its ambiguity group, each if it was that."""

    probability: float
    suspects: Mapping[str, float]
    instrument: bool
    shapes: Mapping[str, float]
    onset: int
    onset_set: tuple[int, ...]
    end: int
    changes: tuple[HistoryChange, ...]
    covariance: np.ndarray = field(default_factory=lambda: np.zeros((0, 0)))
    rivals: tuple[HistoryChange, ...] = ()

    @property
    def group(self) -> tuple[str, ...]:
        """The suspect that is named, or the ambiguity group."""
        return tuple(name for name, _ in leading_suspects(self.suspects.items()))

    @property
    def kind(self) -> str:
        """The likeliest shape."""
        return max(self.shapes, key=lambda name: self.shapes[name])

    @property
    def growing(self) -> float:
        """Probability that it grows, or grew until its end."""
        return sum(p for name, p in self.shapes.items() if name in GROWING)


@dataclass(frozen=True)
class PredictiveCheck:
    """χ² per degree of freedom of the mean readings of all flights about the fitted events, and the probability that it
    is as large by chance; scatter: sensors whose flights scatter more than was learnt → ratio of variances."""

    ratio: float
    level: float
    scatter: Mapping[str, float] = field(default_factory=dict)


@dataclass(frozen=True)
class HistoryPosterior:
    """The one account of change over the T flights of an engine.

    probability: that anything changed, or was off nominal from the first flight; prior: the same before the flights
    are seen, by the rates of changes; events: most probable first; unlisted: probability that what happened is nothing
    that is listed; inclusion: component or instrument → probability that it changed; level, deviation (T, p): smooth
    estimate of each parameter, in its unit; offsets (p,): size of what instruments are off by in single flights, in
    their units; health: of components, what is no event included, where it was required.
    """

    flights: int
    parameters: tuple[str, ...]
    probability: float
    prior: float
    events: tuple[ChangeEvent, ...]
    unlisted: float
    inclusion: Mapping[str, float]
    level: np.ndarray
    deviation: np.ndarray
    offsets: np.ndarray
    check: PredictiveCheck
    quiet: PredictiveCheck
    health: HealthPath | None = None

    @property
    def changed(self) -> bool:
        """Whether a change is likelier than none."""
        return self.probability >= EVENT


def judge_history(
    history: History, *, sensors: bool = True, health: bool = False, offsets: OffsetModel | None = None
) -> HistoryPosterior:
    """What changed in a history of `FEWEST_FLIGHTS` flights at least; ValueError otherwise.

    Parameters
    ----------
    history
        Scores and information of each flight.
    sensors
        Whether instruments may have changed.
    health
        Whether the path of health is computed, which margins need.
    offsets
        Of single flights, where they were learnt already.

    References
    ----------
    R. E. Kass and A. E. Raftery (1995) Bayes factors, Journal of the American Statistical Association 90, 773-795.
    """
    if len(history) < FEWEST_FLIGHTS:
        raise ValueError(f"a history needs {FEWEST_FLIGHTS} flights at least, not {len(history)}")
    offsets = offsets or learn_offsets(history)
    calm = marginalise_offsets(history, offsets)
    suspects = list_suspects(history.parameters, sensors)
    choices = weigh_wander(calm, suspects)
    share = normalized_weights(np.array([c.log for c in choices]))
    probability = float(share @ expit(np.array([c.first.log_odds for c in choices])))
    best, fit = find_with_wander(choices)
    search, chosen, offsets = judge_again(history, best, fit.events, offsets)
    events = [describe_event(search, event, [*chosen[:k], *chosen[k + 1 :]]) for k, event in enumerate(chosen)]
    more = search.scan(chosen)
    level, deviation = search.smooth_levels(chosen)
    unit = history.unit
    events = merge_events([e for e in events if e.probability >= EVENT], history, level, deviation)
    return HistoryPosterior(
        len(history),
        tuple(p.name for p in history.parameters),
        min(max(probability, float(expit(fit.log)) if fit.events else 0.0), 1.0),
        float(expit(np.logaddexp.reduce([s.log_prior for s in suspects]))),
        tuple(sorted(events, key=lambda e: -e.probability)),
        max([0.0, *(e.probability * e.suspects.get(UNLISTED, 0.0) for e in events)]),
        _inclusion(events, more),
        level * unit,
        deviation * unit,
        unit * np.sqrt(offsets.variance),
        check_fit(search, chosen),
        check_fit(search, ()),
        _health(search, chosen) if health else None,
    )


def _health(search: HistorySearch, events: Sequence[Event]) -> HealthPath:
    """The path of health by the events that were found, averaged over the suspects of the least certain one."""
    none = np.zeros((len(search.history), search.history.width, 0))
    weights, paths = [], []
    for weight, mine in search.alternatives(events):
        columns = [search.event_columns(event) for event in mine]
        every = np.concatenate([none, *(h for h, _ in columns)], 2)
        shares = [(r, 0 * r if e.suspect.instrument else 1 - r) for (_, r), e in zip(columns, mine, strict=True)]
        real = np.concatenate([np.zeros((2, 0)), *map(np.stack, shares)], 1)
        own = [h for (h, _), event in zip(columns, mine, strict=True) if event.suspect.instrument]
        weights.append(weight)
        paths.append(health_path(search.history, search.background, (every, real), np.concatenate([none, *own], 2)))
    return paths[0] if len(paths) == 1 else HealthPath.mixture(weights, paths)


def judge_again(
    history: History, choice: WanderChoice, events: tuple[Event, ...], offsets: OffsetModel
) -> tuple[HistorySearch, tuple[Event, ...], OffsetModel]:
    """The search and its events with offsets that were learnt without the events, where that makes them clearly
    smaller: what comes and goes, and what grows fast, is in the differences of flights."""
    if not events:
        return choice.search, events, offsets
    level, _ = choice.search.smooth_levels(events)
    p = history.width
    without = replace(history, score=history.score - np.einsum("tmp,tp->tm", history.information[:, :, :p], level))
    again = learn_offsets(without)
    noise = np.median(np.einsum("tii->ti", history.information), axis=0)[:p]
    known = offsets.variance * noise > NOTICED
    if not np.any(again.variance[known] < CLEARLY * offsets.variance[known]):
        return choice.search, events, offsets
    again = again.limit(offsets.variance)
    calm = marginalise_offsets(history, again)
    search = prepare_search(calm, Background.from_history(calm), choice.multiple, choice.search.space.suspects)
    return search, exchange(search, events), again


def _inclusion(events: Sequence[ChangeEvent], more: Scan) -> dict[str, float]:
    """Probability that each suspect changed by any event, or by one more."""
    missed: dict[str, float] = {}
    for event in events:
        for name, share in event.suspects.items():
            missed[name] = missed.get(name, 1.0) * (1 - event.probability * share)
    for name, share in owner_shares(more.owners()).items():
        missed[name] = missed.get(name, 1.0) * (1 - float(expit(more.log_odds)) * share)
    return {name: 1 - m for name, m in missed.items() if name != UNLISTED}


def describe_event(search: HistorySearch, event: Event, others: Sequence[Event]) -> ChangeEvent:
    """One event from the posterior over it, the others given: whether and who; then how, since when and how much, with
    its course in doubt where the event is plain: no onset and no kind is known better than the course itself."""
    scan = search.scan(others)
    suspects = owner_shares(scan.owners())
    owner = next(iter(suspects))
    mine = _forms(scan, owner)
    going = event.kind == INTERMITTENT and scan.best_event(owner).kind == INTERMITTENT
    plain = event.suspect.owner == owner and (scan.log_odds > PLAIN or going)
    near = search.scan_near(others, event) if plain else scan
    if plain and event.suspect.instrument:
        mine = [scan.suspects.index(event.suspect)]
    weight = normalized_weights(near.log[mine], axis=None)
    by_shape = weight.sum(axis=0)
    irregular = plain and event.irregular >= EVENT
    kinds = _kinds(near, by_shape, event.irregular if plain else 0.0)
    onsets = _onset_distribution(near, by_shape, len(search.history))
    cases = _likely_events(near, mine, weight, event.doubt)
    if irregular:
        onsets, cases = search.irregular_onsets(others, event), [(1.0, event)]
    kind = max(kinds, key=lambda name: kinds[name])
    best = int(np.argmax(np.where(near.shapes.kind == KINDS.index(kind), by_shape, -1.0)))
    order = np.argsort(-onsets, kind="stable")
    count = int(np.searchsorted(np.cumsum(onsets[order]), ONSET_SET * onsets.sum())) + 1
    found = ChangeEvent(
        float(expit(scan.log_odds)),
        suspects,
        scan.suspects[mine[0]].instrument,
        kinds,
        int(order[0]),
        tuple(sorted(order[:count].tolist())),
        int(near.shapes.end[best]) if kind in WITH_END else -1,
        *_changes(search, cases, others),
    )
    rivals: list[HistoryChange] = []
    for name in found.group[1:]:
        if name == UNLISTED:
            continue
        other = _forms(scan, name)
        weight = normalized_weights(scan.log[other], axis=None)
        rivals += _changes(search, _likely_events(scan, other, weight, event.doubt), others)[0]
    return replace(found, rivals=tuple(rivals))


def _forms(scan: Scan, owner: str) -> list[int]:
    """Hypotheses of an owner; an instrument is wrong in one form, and the likeliest stands for it."""
    mine = [k for k, s in enumerate(scan.suspects) if s.owner == owner]
    if scan.suspects[mine[0]].instrument:
        return [max(mine, key=lambda k: float(np.logaddexp.reduce(scan.log[k])))]
    return mine


def _kinds(scan: Scan, by_shape: np.ndarray, irregular: float) -> dict[str, float]:
    """Kind of course → probability, the likeliest first."""
    kinds = {KINDS[k]: (1 - irregular) * float(by_shape[scan.shapes.kind == k].sum()) for k in scan.shapes.kind}
    kinds[IRREGULAR] = irregular
    return {name: p for name, p in sorted(kinds.items(), key=lambda item: -item[1]) if p >= 1e-3}


def _likely_events(scan: Scan, mine: Sequence[int], weight: np.ndarray, doubt: float) -> list[tuple[float, Event]]:
    """The likeliest hypotheses of a suspect as events, with their weights."""
    order = np.argsort(-weight, axis=None)[:AVERAGED]
    order = order[weight.ravel()[order] >= min(AVERAGED_SHARE, weight.max())]
    found = []
    for flat in order:
        row, k = np.unravel_index(int(flat), weight.shape)
        event = replace(scan.event(mine[int(row)], int(k)), doubt=doubt)
        found.append((float(weight[row, k]), event))
    return found


def _onset_distribution(scan: Scan, by_shape: np.ndarray, T: int) -> np.ndarray:
    """Probability (T,) of each first flight with an effect; a cell's is spread over it."""
    found = np.zeros(T)
    for k in np.flatnonzero(by_shape > 1e-6 * by_shape.max()):
        n = int(scan.shapes.cell[k, 0])
        start = int(scan.shapes.onset[k]) - n // 2
        if KINDS[scan.shapes.kind[k]] == FROM_START:
            start, n = 0, 1
        found[max(start, 0) : start + n] += by_shape[k] / n
    return found


def _changes(
    search: HistorySearch, cases: Sequence[tuple[float, Event]], others: Sequence[Event]
) -> tuple[tuple[HistoryChange, ...], np.ndarray]:
    """Sizes, and their covariance at the last flight, of the parameters of one suspect, averaged over weighted
    events."""
    background = search.condition_on(others)
    p, T = search.history.width, len(search.history)
    means, deviations = [], []
    taking, second = np.zeros(p), np.zeros((p, p))
    share = np.array([weight for weight, _ in cases])
    share /= share.sum()
    for weight, (_, event) in zip(share, cases, strict=True):
        h, real = search.event_columns(event)
        b, M = background.joint(h)
        h = h * real
        covariance = np.linalg.inv(M + np.eye(len(b)))
        level = h @ (covariance @ b)
        own = list(event.suspect.positions)
        at = np.array([T - 1, int(np.argmax(np.linalg.norm(level[:, own], axis=1)))])
        means.append(level[at])
        deviations.append(np.sqrt(np.einsum("tpc,cd,tpd->tp", h[at], covariance, h[at])))
        second += weight * (h[-1] @ covariance @ h[-1].T + np.outer(level[-1], level[-1]))
        taking[own] += weight
    mean, deviation = np.stack(means), np.stack(deviations)
    unit, kept = search.history.unit, np.flatnonzero(taking >= AVERAGED_SHARE)
    found = []
    for i in kept:
        sizes = [_mixture_interval(share, mean[:, j, i], deviation[:, j, i]) for j in (0, 1)]
        now, largest = ((float(unit[i]) * x for x in size) for size in sizes)
        found.append(HistoryChange(search.history.parameters[i].name, float(taking[i]), *now, *largest))
    expected = share @ mean[:, 0]
    spread = unit[:, None] * (second - np.outer(expected, expected)) * unit
    return tuple(found), spread[np.ix_(kept, kept)]


def _mixture_interval(share: np.ndarray, mean: np.ndarray, deviation: np.ndarray) -> tuple[float, float, float]:
    """Mean, and the 2.5 and 97.5 % points, of a mixture of normal laws."""
    sd = np.maximum(deviation, LEAST_SPREAD)
    low, high = float(np.min(mean - 5 * sd)), float(np.max(mean + 5 * sd))
    grid = np.linspace(low, high, 4001)
    mass = ndtr((grid[:, None] - mean) / sd) @ share
    tail = ndtr(-NORMAL_95)
    return float(share @ mean), float(np.interp(tail, mass, grid)), float(np.interp(1 - tail, mass, grid))


def merge_events(
    events: Sequence[ChangeEvent], history: History, level: np.ndarray, deviation: np.ndarray
) -> list[ChangeEvent]:
    """Events of one component or instrument as one: fouling that a wash ends and that begins anew is one story. Its
    size is that of the smooth level (T, p), its end where a later event takes back what an earlier one did."""
    by_owner: dict[str, list[ChangeEvent]] = {}
    for event in events:
        by_owner.setdefault(event.group[0], []).append(event)
    return [own[0] if len(own) == 1 else _merged(own, history, level, deviation) for own in by_owner.values()]


def _merged(own: Sequence[ChangeEvent], history: History, level: np.ndarray, deviation: np.ndarray) -> ChangeEvent:
    own = sorted(own, key=lambda e: e.onset)
    first = own[0]
    names = {c.name for e in own for c in e.changes}
    changes, end, variance = [], -1, []
    for i, parameter in enumerate(history.parameters):
        if parameter.name not in names:
            continue
        at = int(np.argmax(np.abs(level[:, i])))
        now, largest = (
            [float(history.unit[i] * x) for x in (m, m - NORMAL_95 * d, m + NORMAL_95 * d)]
            for m, d in ((level[k, i], deviation[k, i]) for k in (-1, at))
        )
        taking = max(c.probability for e in own for c in e.changes if c.name == parameter.name)
        changes.append(HistoryChange(parameter.name, taking, *now, *largest))
        variance.append(float(history.unit[i] * deviation[-1, i]) ** 2)
        fall = -np.diff(np.abs(level[:, i]))
        if fall.max(initial=0.0) > LARGEST_STEP * np.abs(level[at, i]) and end < 0:
            end = int(np.argmax(fall)) + 1
    kind = first.kind
    if end >= 0:
        kind = GROWN_AND_ENDED if any(e.growing >= EVENT for e in own) else PULSE
    elif any(abs(c.now) < (1 - LARGEST_STEP) * abs(c.largest) for c in changes):
        kind = IRREGULAR  # it came and went little by little
    shapes = first.shapes if kind == first.kind else {kind: 1.0}
    return replace(
        first,
        probability=max(e.probability for e in own),
        shapes=shapes,
        end=end,
        changes=tuple(changes),
        covariance=np.diag(variance),
    )


def check_fit(search: HistorySearch, events: Sequence[Event]) -> PredictiveCheck:
    """Whether the readings of flights scatter about the events as they should."""
    S = search.history.sensors
    before = search.condition_on(events)
    if not len(S):
        return PredictiveCheck(1.0, 0.5)
    z = np.linalg.solve(before.A, before.d)
    left = (before.s - before.B @ z)[:, S]
    known = before.F[:, S[:, None], S]
    inverse = np.linalg.pinv(known, hermitian=True)
    squares = np.einsum("ti,tij,tj->t", left, inverse, left)
    present = np.einsum("tij,tji->", known, inverse)
    own = before.B[:, S]
    used = float(np.sum(inner(own, inverse @ own) * np.linalg.inv(before.A)))
    dof = max(present - used, 1.0)
    reading = np.einsum("tij,tj->ti", inverse, left) ** 2 / np.maximum(np.einsum("tii->ti", inverse), 1e-12)
    ratio = reading.mean(axis=0) * present / dof
    limit = chi2.isf(1e-3 / len(S), len(left)) / len(left)
    names = [search.history.parameters[i].component for i in S]
    scatter = {n: float(r) for n, r in zip(names, ratio, strict=True) if r > limit}
    return PredictiveCheck(float(squares.sum()) / dof, float(chi2.sf(squares.sum(), dof)), scatter)
