"""What is known after the flights: whether anything changed, what, how, since when, how much now.

`judge_history` is the whole chain: offsets learnt and marginalised, wander weighed, events searched, each looked at
again with the others as they are. Every number is averaged over shapes, onsets and parameters of the suspect that is
named; the size includes what its course may be off by.

Which changes together: a beam over sets of events, with adding, exchanging and dropping.

An event that is accepted becomes part of the background, with its size free within its slab, and with two doubts:

    effect    each sensor follows the event to a share of what the model says: the amount that the data make likeliest
    shape     the event's course may be off by 10 % of its size, in six smooth modes while it lasts
    end       what ended may have left something: 20 % of its size from there on

so that a large change does not raise small ones beside it. Log probability of a set: the sum of the log odds of its
events, each before the background of those before it.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from scipy.special import expit, ndtr
from scipy.stats import chi2

from enginediag_cli.history.background import (
    WANDER_MULTIPLES,
    WANDER_PRIOR,
    Background,
    OffsetModel,
    add_wander,
    inner,
    learn_offsets,
    marginalise_offsets,
    wander_modes,
)
from enginediag_cli.history.health import HealthPath, health_path
from enginediag_cli.history.hypotheses import (
    UNLISTED,
    Event,
    HypothesisSpace,
    Scan,
    Suspect,
    join_scans,
    list_suspects,
    with_patterns,
)
from enginediag_cli.history.records import History
from enginediag_cli.history.shapes import (
    FROM_START,
    GROWING,
    INTERMITTENT,
    KINDS,
    PULSE,
    RESTORED,
    WASHED,
    WITH_END,
    ShapeTable,
    coarse_shapes,
    nearby_shapes,
    neighbours,
    open_cells,
)
from enginediag_cli.probability import NORMAL_95, normalized_weights

EFFECT_DOUBTS = (0.01, 0.04, 0.15)
"""Shares to which the effect of a change on each sensor may be known, alike in prior: a model that is right but linear
about nominal, one whose maps are off by some per cent, and a change far beyond what was linearised."""
LEFT = 0.2
"""Share of an event's size that may be left after its end: no wash and no repair restores all."""
SHAPE_DOUBT, SHAPE_MODES = 0.1, 6
"""Share of an event's size by which its course may be off, and smooth modes of that: no fouling is an exponential."""
BEAM, DEPTH = 2, 4
"""Sets that are followed at once, and events of a set at most: engines seldom have more in one history."""
PASSES = 2
"""Rounds of looking at each event again with the others as they are."""
OPENED, OPENED_SHARE, ROUNDS = 12, 1e-4, 6
"""Cells of onsets that are opened at once, least share of the likeliest's probability of those, and rounds at most."""
CLIMBED, CLIMBED_SHARE = 12.0, 0.6
"""Nats below the best, and share of its log odds, to which a kind of shape is climbed to its likeliest onset and end: a
step that is looked at two flights beside its onset loses a part of what it explains, not all."""
QUIET = -2.5
"""Log odds of a first change below which nothing is looked at more closely: neither onsets flight by flight, nor more
wander, make up for them."""
RIVAL = 10.0
"""Nats below the best beyond which another amount of wander, or another set of the beam, is not followed."""
TINY = 1e-12
"""Keeps a division by no information from failing."""


@dataclass(frozen=True)
class EventSetFit:
    """Events, and the log probability of their set against none."""

    events: tuple[Event, ...]
    log: float


@dataclass(frozen=True)
class HistorySearch:
    """A history ready to be searched: background without events, hypotheses, effect (k, p) of each parameter on the
    mean readings of sensors at positions `sensors` (k,)."""

    history: History
    background: Background
    space: HypothesisSpace
    sensors: np.ndarray
    effect: np.ndarray
    _scans: dict[tuple[object, ...], Scan] = field(default_factory=dict, repr=False, compare=False)

    def event_columns(self, event: Event) -> tuple[np.ndarray, np.ndarray]:
        """h (T, p, c): of the event's size, of what is left after its end, of its course's doubt and of its effect's;
        and whether (c,) each is a change, 1, or an error of the model about it, 0."""
        T, p = len(self.history), self.history.width
        g, own = event.course, list(event.suspect.positions)
        size = np.zeros((T, p, len(own)))
        size[:, own, range(len(own))] = event.slab * g[:, None]
        parts = [size, self.shape_doubt(event)]
        if event.kind in RESTORED:
            left = np.zeros((T, p, len(own)))
            left[int(event.shape.end[0]) :, own, range(len(own))] = LEFT * np.abs(event.size)
            parts.append(left)
        real = np.ones(sum(h.shape[2] for h in parts))
        if event.doubt:
            at = [*self.sensors, *own]
            follows = np.linalg.norm(self.effect[:, own] * event.size, axis=1)
            turned = np.full(len(own), np.linalg.norm(event.size))
            doubt = np.zeros((T, p, len(at)))
            doubt[:, at, range(len(at))] = g[:, None] * event.doubt * np.concatenate([follows, turned])
            parts.append(doubt)
            real = np.concatenate([real, np.zeros(len(at))])
        return np.concatenate(parts, axis=2), real

    def shape_doubt(self, event: Event) -> np.ndarray:
        """h (T, p, c): modes while the event lasts, each of the parameters together."""
        T, p = len(self.history), self.history.width
        there = np.flatnonzero(event.course > 0)
        modes = np.zeros((T, min(SHAPE_MODES, max(len(there) // 3, 1))))
        lasting = wander_modes(len(there))[:, : modes.shape[1]]
        modes[there, : lasting.shape[1]] = lasting
        direction = np.zeros(p)
        direction[list(event.suspect.positions)] = SHAPE_DOUBT * event.size
        return np.asarray(direction[None, :, None] * modes[:, None, :])

    def before(self, events: Sequence[Event]) -> Background:
        """The background with these events in it, whatever their size."""
        found = self.background
        for event in events:
            found = found.add_columns(self.event_columns(event)[0])
        return found

    def scan(self, events: Sequence[Event]) -> Scan:
        """The posterior over one more change; cells of onsets that matter are opened."""
        key = tuple(sorted(event.key for event in events))
        if key not in self._scans:
            background = self.before(events)
            self._scans[key] = self._opened(with_patterns(self.space, background).scan(background), background)
        return self._scans[key]

    def scan_near(self, others: Sequence[Event], event: Event) -> Scan:
        """The posterior over kinds and onsets near those of an event, the others given, with its course in doubt."""
        background = self.before(others).add_columns(self.shape_doubt(event))
        return self._scan_shapes(nearby_shapes(event.shape, len(self.history), self.history.maintenance), background)

    def take(self, others: Sequence[Event], owner: str = "") -> Event:
        """The likeliest further event, of one owner where that is named, with what the data leave of the doubt about
        its effect."""
        event = self.scan(others).best_event(owner)
        if all(self.history.parameters[i].belongs_to_sensor for i in event.suspect.positions):
            return event
        before = self.before(others)
        made = [replace(event, doubt=share) for share in EFFECT_DOUBTS]
        log = np.array([before.add_columns(self.event_columns(one)[0]).log_evidence for one in made])
        return replace(event, doubt=float(np.sqrt(normalized_weights(log) @ np.square(EFFECT_DOUBTS))))

    def log_probability(self, events: Sequence[Event]) -> float:
        """Of a set of events with their shapes, against none: marginal likelihood times prior."""
        moved = self.before(events).log_evidence - self.background.log_evidence
        return moved + sum(event.log_prior for event in events)

    def _opened(self, scan: Scan, background: Background) -> Scan:
        """The scan with onsets and ends looked at flight by flight where it matters: each kind of shape is climbed to
        its likeliest ones, then the cells of the likeliest shapes of all are opened."""
        T, maintenance = len(self.history), self.history.maintenance
        if scan.log_odds < QUIET:
            return scan
        for _ in range(ROUNDS):
            beside = neighbours(scan.shapes, _tops(scan), T, maintenance)
            if beside is None:
                break
            best = float(scan.log.max())
            scan = join_scans(scan, np.arange(len(scan.shapes)), self._scan_shapes(beside, background))
            if scan.log.max() <= best:
                break
        for _ in range(ROUNDS):
            each = np.logaddexp.reduce(scan.log, axis=0)
            wide = (scan.shapes.cell.max(axis=1) > 1) & (each > each.max() + np.log(OPENED_SHARE))
            order = np.argsort(-each, kind="stable")
            rows = order[wide[order]][:OPENED]
            if not len(rows):
                break
            shapes = open_cells(scan.shapes, rows, T, maintenance)
            kept = np.setdiff1d(np.arange(len(each)), rows)
            scan = join_scans(scan, kept, self._scan_shapes(shapes, background))
        return scan

    def _scan_shapes(self, shapes: ShapeTable, background: Background) -> Scan:
        return replace(self.space, shapes=shapes, owners=np.full(len(shapes), -1)).scan(background)


def _tops(scan: Scan) -> np.ndarray:
    """The likeliest shape (k,) of each kind and time constant, of those that explain half as much as the best."""
    each = scan.log.max(axis=0)
    least = min(each.max() - CLIMBED, CLIMBED_SHARE * each.max())
    number = {}
    for k in np.argsort(-each, kind="stable"):
        kind = KINDS[scan.shapes.kind[k]]
        key = kind, float(scan.shapes.scale[k])
        if each[k] >= least and kind not in (FROM_START, INTERMITTENT) and key not in number:
            number[key] = int(k)
    return np.array(list(number.values()), int)


def prepare_search(
    history: History, nominal: Background, multiple: float, suspects: Sequence[Suspect]
) -> HistorySearch:
    """A history whose offsets are marginalised, with instruments that wander by so much beside what is uncertain about
    nominal."""
    background = add_wander(nominal, history, multiple)
    shapes = coarse_shapes(len(history), history.maintenance)
    space = HypothesisSpace(history, tuple(suspects), shapes, np.full(len(shapes), -1))
    S = history.sensors
    total = history.information.sum(axis=0)
    effect = np.linalg.pinv(total[S[:, None], S] + TINY * np.eye(len(S))) @ total[S, : history.width]
    return HistorySearch(history, background, space, S, effect)


def find_events(search: HistorySearch, first: Scan) -> EventSetFit:
    """The likeliest set of events; first: the posterior over the first one."""
    beam = [(EventSetFit((), 0.0), first)]
    best = beam[0][0]
    for _ in range(DEPTH):
        grown = []
        for fit, scan in beam:
            owners = scan.owners()
            top, *others = sorted(owners, key=lambda name: -owners[name])[:BEAM]
            if scan.log_odds > 0:  # that something changed may be certain while nobody is likelier than not
                grown.append(EventSetFit((*fit.events, search.take(fit.events, top)), fit.log + scan.log_odds))
            for owner in others:
                if owners[owner] > 0:
                    grown.append(EventSetFit((*fit.events, search.take(fit.events, owner)), fit.log + owners[owner]))
        grown = sorted(grown, key=lambda fit: -fit.log)[:BEAM]
        grown = [fit for fit in grown if fit.log > grown[0].log - RIVAL]
        if not grown:
            break
        best = max([best, *grown], key=lambda fit: fit.log)
        beam = [(fit, search.scan(fit.events)) for fit in grown]
    return EventSetFit(improve(search, best.events), best.log)


def improve(search: HistorySearch, events: tuple[Event, ...]) -> tuple[Event, ...]:
    """Exchange and drop: each event looked at again with the others as they are; then all events of one owner at once,
    where it has several: what one event cannot be moved to, none of them may need."""
    events = exchange(search, events)
    for owner in {e.suspect.owner for e in events if sum(x.suspect.owner == e.suspect.owner for x in events) > 1}:
        others = tuple(e for e in events if e.suspect.owner != owner)
        again = exchange(search, add_events(search, others, DEPTH - len(others)))
        if search.log_probability(again) > search.log_probability(events):
            events = again
    return events


def add_events(search: HistorySearch, events: tuple[Event, ...], most: int) -> tuple[Event, ...]:
    """The likeliest further events, one after the other, as long as each is likelier than not."""
    for _ in range(most):
        scan = search.scan(events)
        if scan.log_odds < 0:
            break
        events = (*events, search.take(events))
        events = exchange(search, events)
    return events


def exchange(search: HistorySearch, events: tuple[Event, ...]) -> tuple[Event, ...]:
    """Each event exchanged for the likeliest with the others as they are, or dropped where none is likely."""
    if len(events) < 2:
        return events
    for _ in range(PASSES):
        before = [e.key for e in events]
        for k in range(len(events) - 1, -1, -1):
            others = (*events[:k], *events[k + 1 :])
            scan = search.scan(others)
            events = others if scan.log_odds < 0 else (*events[:k], search.take(others), *events[k + 1 :])
        if [e.key for e in events] == before:
            break
    return events


@dataclass(frozen=True)
class WanderChoice:
    """A search with one amount of wander, a multiple of the unit: its first scan, and the log probability of the
    history with it."""

    multiple: float
    search: HistorySearch
    first: Scan
    log: float


def weigh_wander(history: History, suspects: Sequence[Suspect]) -> list[WanderChoice]:
    """All amounts of wander, each with what one event adds."""
    found: list[WanderChoice] = []
    nominal = Background.from_history(history)
    for multiple, prior in zip(WANDER_MULTIPLES, WANDER_PRIOR, strict=True):
        search = prepare_search(history, nominal, multiple, suspects)
        if found and search.background.log_evidence < found[0].search.background.log_evidence - RIVAL:
            continue
        first = search.scan(())
        log = np.log(prior) + search.background.log_evidence + np.logaddexp(0.0, first.log_odds)
        found.append(WanderChoice(multiple, search, first, float(log)))
        if first.log_odds < QUIET:
            break
    return found


def find_with_wander(choices: Sequence[WanderChoice]) -> tuple[WanderChoice, EventSetFit]:
    """The likeliest amount of wander with the likeliest set of events: what one event leaves may be another or wander,
    so that amounts are compared with all events each."""
    most = max(choice.log for choice in choices)
    found = []
    for choice in choices:
        if choice.log > most - RIVAL or choice.log == most:
            fit = find_events(choice.search, choice.first)
            found.append((choice.log - float(np.logaddexp(0.0, choice.first.log_odds)) + fit.log, choice, fit))
            if choice.first.log_odds < 0 and choice.log == most:
                break
    _, best, fit = max(found, key=lambda item: item[0])
    return best, fit


# The result

FEWEST_FLIGHTS = 3
"""A level before, one after, and one to tell scatter from either."""
NAMED = 0.9
"""Probability from which one suspect is named; below it those that hold `GROUP` of it are an ambiguity group."""
GROUP, ONSET_SET = 0.95, 0.95
"""Probability of an ambiguity group, and of a set of onsets."""
EVENT = 0.5
"""Probability from which an event is reported as one: likelier than not."""
AVERAGED, AVERAGED_SHARE = 12, 0.02
"""Hypotheses over which a size is averaged at most, and least probability of each."""
PLAIN = 50.0
"""Log odds of an event beyond which its course is doubted: below, the doubt is less than what the data leave open."""
CLEARLY = 0.67
"""Share of its variance to which an offset must fall without the events to be worth another judgement: a fifth in size
is less than what twenty flights know of it."""
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
    parameters; covariance (q, q): of these at the last flight, that they may be zero counted."""

    probability: float
    suspects: Mapping[str, float]
    instrument: bool
    shapes: Mapping[str, float]
    onset: int
    onset_set: tuple[int, ...]
    end: int
    changes: tuple[HistoryChange, ...]
    covariance: np.ndarray = field(default_factory=lambda: np.zeros((0, 0)))

    @property
    def group(self) -> tuple[str, ...]:
        """The suspect that is named, or the ambiguity group."""
        chosen: list[str] = []
        total = 0.0
        for name, probability in self.suspects.items():
            chosen.append(name)
            total += probability
            if total >= (NAMED if len(chosen) == 1 else GROUP):
                break
        return tuple(chosen)

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

    probability: that anything changed, or was off nominal from the first flight; events: most probable first; unlisted:
    probability that what happened is nothing that is listed; inclusion: component or instrument → probability that it
    changed; level, deviation (T, p): smooth estimate of each parameter, in its unit; offsets (p,): size of what
    instruments are off by in single flights, in their units; health: of components, what is no event included, where
    it was required.
    """

    flights: int
    parameters: tuple[str, ...]
    probability: float
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


def judge_history(history: History, *, sensors: bool = True, health: bool = False) -> HistoryPosterior:
    """What changed in a history of `FEWEST_FLIGHTS` flights at least; ValueError otherwise.

    Parameters
    ----------
    history
        Scores and information of each flight.
    sensors
        Whether instruments may have changed.
    health
        Whether the path of health is computed, which margins need.

    References
    ----------
    R. E. Kass and A. E. Raftery (1995) Bayes factors, Journal of the American Statistical Association 90, 773-795.
    """
    if len(history) < FEWEST_FLIGHTS:
        raise ValueError(f"a history needs {FEWEST_FLIGHTS} flights at least, not {len(history)}")
    offsets = learn_offsets(history)
    calm = marginalise_offsets(history, offsets)
    suspects = list_suspects(history.parameters, sensors)
    choices = weigh_wander(calm, suspects)
    share = normalized_weights(np.array([c.log for c in choices]))
    probability = float(share @ expit(np.array([c.first.log_odds for c in choices])))
    best, fit = find_with_wander(choices)
    search, chosen, offsets = judge_again(history, best, fit.events, offsets)
    events = [describe_event(search, event, [*chosen[:k], *chosen[k + 1 :]]) for k, event in enumerate(chosen)]
    more = search.scan(chosen)
    level, deviation = smooth_levels(search, chosen)
    unit = history.unit
    events = merge_events([e for e in events if e.probability >= EVENT], history, level, deviation)
    return HistoryPosterior(
        len(history),
        tuple(p.name for p in history.parameters),
        min(max(probability, float(expit(fit.log)) if fit.events else 0.0), 1.0),
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
    """The path of health by the events that were found."""
    none = np.zeros((len(search.history), search.history.width, 0))
    every, wrong = (
        np.concatenate([none, *[search.event_columns(e)[0] for e in events if e.suspect.instrument or not alone]], 2)
        for alone in (False, True)
    )
    return health_path(search.history, search.background, every, wrong)


def judge_again(
    history: History, choice: WanderChoice, events: tuple[Event, ...], offsets: OffsetModel
) -> tuple[HistorySearch, tuple[Event, ...], OffsetModel]:
    """The search and its events with offsets that were learnt without the events, where that makes them clearly
    smaller: what comes and goes, and what grows fast, is in the differences of flights."""
    if not events:
        return choice.search, events, offsets
    level, _ = smooth_levels(choice.search, events)
    p = history.width
    without = replace(history, score=history.score - np.einsum("tmp,tp->tm", history.information[:, :, :p], level))
    again = learn_offsets(without)
    known = offsets.variance > 0
    if not np.any(again.variance[known] < CLEARLY * offsets.variance[known]):
        return choice.search, events, offsets
    again = OffsetModel(np.minimum(again.variance, offsets.variance), again.inflation)
    calm = marginalise_offsets(history, again)
    search = prepare_search(calm, Background.from_history(calm), choice.multiple, choice.search.space.suspects)
    return search, exchange(search, events), again


def _owner_shares(scan: Scan) -> dict[str, float]:
    owners = scan.owners()
    weights = normalized_weights(np.array(list(owners.values())))
    named = sorted(zip(owners, weights.tolist(), strict=True), key=lambda item: -item[1])
    return {name: weight for name, weight in named if weight >= 1e-4}


def _inclusion(events: Sequence[ChangeEvent], more: Scan) -> dict[str, float]:
    """Probability that each suspect changed by any event, or by one more."""
    missed: dict[str, float] = {}
    for event in events:
        for name, share in event.suspects.items():
            missed[name] = missed.get(name, 1.0) * (1 - event.probability * share)
    for name, share in _owner_shares(more).items():
        missed[name] = missed.get(name, 1.0) * (1 - float(expit(more.log_odds)) * share)
    return {name: 1 - m for name, m in missed.items() if name != UNLISTED}


def describe_event(search: HistorySearch, event: Event, others: Sequence[Event]) -> ChangeEvent:
    """One event from the posterior over it, the others given: whether and who; then how, since when and how much, with
    its course in doubt where the event is plain: no onset and no kind is known better than the course itself."""
    scan = search.scan(others)
    suspects = _owner_shares(scan)
    owner = next(iter(suspects))
    mine = [k for k, s in enumerate(scan.suspects) if s.owner == owner]
    if scan.suspects[mine[0]].instrument:  # wrong in one form: the likeliest stands for it
        mine = [max(mine, key=lambda k: float(np.logaddexp.reduce(scan.log[k])))]
    plain = scan.log_odds > PLAIN and event.suspect.owner == owner and event.kind != INTERMITTENT
    near = search.scan_near(others, event) if plain else scan
    weight = normalized_weights(near.log[mine], axis=None)
    by_shape = weight.sum(axis=0)
    kinds = {KINDS[k]: float(by_shape[near.shapes.kind == k].sum()) for k in np.unique(near.shapes.kind)}
    kinds = {name: p for name, p in sorted(kinds.items(), key=lambda item: -item[1]) if p >= 1e-3}
    kind = next(iter(kinds))
    best = int(np.argmax(np.where(near.shapes.kind == KINDS.index(kind), by_shape, -1.0)))
    onsets = _onset_distribution(near, by_shape, len(search.history))
    order = np.argsort(-onsets, kind="stable")
    count = int(np.searchsorted(np.cumsum(onsets[order]), ONSET_SET * onsets.sum())) + 1
    return ChangeEvent(
        float(expit(scan.log_odds)),
        suspects,
        scan.suspects[mine[0]].instrument,
        kinds,
        int(order[0]),
        tuple(sorted(order[:count].tolist())),
        int(near.shapes.end[best]) if kind in WITH_END else -1,
        *_changes(search, near, event.doubt, others, mine, weight),
    )


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
    search: HistorySearch,
    scan: Scan,
    doubt: float,
    others: Sequence[Event],
    mine: Sequence[int],
    weight: np.ndarray,
) -> tuple[tuple[HistoryChange, ...], np.ndarray]:
    """Sizes, and their covariance at the last flight, of the parameters of one suspect, averaged over its likeliest
    hypotheses."""
    background = search.before(others)
    order = np.argsort(-weight, axis=None)[:AVERAGED]
    order = order[weight.ravel()[order] >= min(AVERAGED_SHARE, weight.max())]
    p, T = search.history.width, len(search.history)
    parts: list[tuple[float, np.ndarray, np.ndarray]] = []
    taking, second = np.zeros(p), np.zeros((p, p))
    for flat in order:
        row, k = np.unravel_index(int(flat), weight.shape)
        event = replace(scan.event(mine[int(row)], int(k)), doubt=doubt)
        h, real = search.event_columns(event)
        b, M = background.joint(h)
        h = h * real
        covariance = np.linalg.inv(M + np.eye(len(b)))
        at = np.array([T - 1, int(np.argmax(event.course))])
        mean = h[at] @ (covariance @ b)
        variance = np.einsum("tpc,cd,tpd->tp", h[at], covariance, h[at])
        second += weight[row, k] * (h[-1] @ covariance @ h[-1].T + np.outer(mean[0], mean[0]))
        parts.append((float(weight[row, k]), mean, np.sqrt(variance)))
        taking[list(event.suspect.positions)] += weight[row, k]
    share = np.array([w for w, _, _ in parts])
    second /= share.sum()
    share /= share.sum()
    mean, deviation = np.stack([m for _, m, _ in parts]), np.stack([d for _, _, d in parts])
    found, kept = [], []
    own = sorted({i for k in mine for i in scan.suspects[k].positions})
    for i in own:
        taken = float(taking[i] / sum(w for w, _, _ in parts))
        if taken < AVERAGED_SHARE:
            continue
        sizes = [_mixture_interval(share, mean[:, j, i], deviation[:, j, i]) for j in (0, 1)]
        now, largest = ((float(search.history.unit[i]) * x for x in size) for size in sizes)
        kept.append(i)
        found.append(HistoryChange(search.history.parameters[i].name, taken, *now, *largest))
    expected, unit = share @ mean[:, 0], search.history.unit
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
    shapes = first.shapes if kind == first.kind else {kind: 1.0}
    return replace(
        first,
        probability=max(e.probability for e in own),
        shapes=shapes,
        end=end,
        changes=tuple(changes),
        covariance=np.diag(variance),
    )


def smooth_levels(search: HistorySearch, events: Sequence[Event]) -> tuple[np.ndarray, np.ndarray]:
    """Level and standard deviation (T, p) of each parameter by the events with their doubts, in prior ones."""
    T, p = len(search.history), search.history.width
    if not events:
        return np.zeros((T, p)), np.zeros((T, p))
    columns = [search.event_columns(event) for event in events]
    h = np.concatenate([c for c, _ in columns], axis=2)
    b, M = search.background.joint(h)
    h = h * np.concatenate([real for _, real in columns])
    covariance = np.linalg.inv(M + np.eye(len(b)))
    return h @ (covariance @ b), np.sqrt(np.einsum("tpc,cd,tpd->tp", h, covariance, h))


def check_fit(search: HistorySearch, events: Sequence[Event]) -> PredictiveCheck:
    """Whether the readings of flights scatter about the events as they should."""
    S = search.sensors
    before = search.before(events)
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
