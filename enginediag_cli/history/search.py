"""The search for what changed: sets of events, each before the background of the others.

Which changes together: a beam over sets of events, with adding, exchanging and dropping.

An event that is accepted becomes part of the background, with its size free within its slab, and with what is in doubt
about it, each by the amount that the data make likeliest:

    effect    the readings follow the event but for a share of the whole, in any direction that they distinguish, and
              the event turns within its component: maps have slopes of their own
    course    the event may be off its course by 10 % of its size in smooth modes while it lasts; or by all of it from
              its onset on: then it has no shape that is listed, and is irregular
    end       what ended may have left something: 20 % of its size from there on

so that a large change does not raise small ones beside it. Log probability of a set: the sum of the log odds of its
events, each before the background of those before it.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from scipy.special import expit

from enginediag_cli.history.background import (
    WANDER_MULTIPLES,
    WANDER_PRIOR,
    Background,
    History,
    add_wander,
    wander_modes,
)
from enginediag_cli.history.hypotheses import (
    COMPONENT_PRIOR,
    FROM_START,
    INSTRUMENT_PRIOR,
    INTERMITTENT,
    IRREGULAR,
    KINDS,
    RESTORED,
    UNLISTED,
    Event,
    HypothesisSpace,
    Scan,
    ShapeTable,
    Suspect,
    coarse_shapes,
    join_scans,
    moved_shapes,
    nearby_patterns,
    nearby_shapes,
    neighbours,
    open_cells,
    with_patterns,
)
from enginediag_cli.probability import normalized_weights

EFFECT_DOUBTS = (0.05, 0.12, 0.3)
"""Shares to which the effect of a change on all readings may be known, alike in prior: a model that is right but linear
about nominal, up to one whose maps have slopes of their own. Of maps whose shape is off by 1 % it is 0.05 to 0.4."""
SEEN = 1e-8
"""Share of the largest information from which a direction is distinguished from none: rounding is a millionth of it."""
LEFT = 0.2
"""Share of an event's size that may be left after its end: no wash and no repair restores all."""
SHAPE_DOUBT = 0.1
"""Share of an event's size by which its course may be off, in smooth modes: no fouling is an exponential."""
BEAM, DEPTH = 2, 4
"""Sets that are followed at once, and events of a set at most: engines seldom have more in one history."""
PASSES = 2
"""Rounds of looking at each event again with the others as they are."""
OPENED, OPENED_SHARE, ROUNDS = 12, 1e-4, 6
"""Cells of onsets that are opened at once, least share of the likeliest's probability of those, and rounds at most."""
CLIMBED, CLIMBED_SHARE = 12.0, 0.3
"""Nats below the best, and share of its log odds, to which a kind of shape is climbed to its likeliest onset and end: a
step that is looked at two flights beside its onset loses a part of what it explains, not all."""
QUIET = -2.5
"""Log odds of a first change below which nothing is looked at more closely: neither onsets flight by flight, nor more
wander, make up for them."""
KEPT_BACKGROUNDS = 2
"""Backgrounds with events that are kept: those before which several suspects are looked at in turn."""
LIKELY = 0.5
"""Probability from which an event's course is taken to have no shape that is listed."""
RIVAL = 10.0
"""Nats below the best beyond which another amount of wander, or another set of the beam, is not followed."""
NAMED, GROUP = 0.9, 0.95
"""Probability from which one suspect is named, and which an ambiguity group holds where none is."""


def leading_suspects(suspects: Iterable[tuple[str, float]], whole: float = 1.0) -> list[tuple[str, float]]:
    """The suspect that is named, or the ambiguity group: of suspects with their probabilities, likeliest first, which
    come to `whole` in all."""
    chosen: list[tuple[str, float]] = []
    total = 0.0
    for name, probability in suspects:
        chosen.append((name, probability))
        total += probability
        if total >= (NAMED if len(chosen) == 1 else GROUP) * whole:
            break
    return chosen


def owner_shares(owners: Mapping[str, float]) -> dict[str, float]:
    """Probability of each owner by its log odds, likeliest first, that there is a change."""
    weights = normalized_weights(np.array(list(owners.values())))
    named = sorted(zip(owners, weights.tolist(), strict=True), key=lambda item: -item[1])
    return {name: weight for name, weight in named if weight >= 1e-4}


@dataclass(frozen=True)
class EventSetFit:
    """Events, and the log probability of their set against none."""

    events: tuple[Event, ...]
    log: float


@dataclass(frozen=True)
class HistorySearch:
    """A history ready to be searched: background without events, and hypotheses."""

    history: History
    background: Background
    space: HypothesisSpace
    _scans: dict[tuple[object, ...], Scan] = field(default_factory=dict, repr=False, compare=False)
    _conditions: dict[tuple[object, ...], Background] = field(default_factory=dict, repr=False, compare=False)

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
            parts.append(self.effect_doubt(event))
            real = np.concatenate([real, np.zeros(parts[-1].shape[2])])
        return np.concatenate(parts, axis=2), real

    def effect_doubt(self, event: Event) -> np.ndarray:
        """h (T, p, c): what the model may get wrong about the readings with this change, while it lasts. With M the
        information on all parameters of its course and δ its size, of a share a

            N(0, a² δᵀMδ / k · M⁻¹) in all k directions that the flights distinguish, and
            N(0, a² |δ|² I) among its own parameters

        so that the size is found with the weights of the noise, while what is smaller than the error and has the same
        course is no further change."""
        own = list(event.suspect.positions)
        M = self.background.project(event.course[None])[1][0]
        value, vector = np.linalg.eigh(M)
        seen = value > SEEN * value.max(initial=0.0)
        visible = max(event.size @ M[np.ix_(own, own)] @ event.size, 0.0) / max(seen.sum(), 1)
        turned = np.zeros((len(M), len(own)))
        turned[own, range(len(own))] = np.linalg.norm(event.size)
        wrong = np.concatenate([np.sqrt(visible / value[seen]) * vector[:, seen], turned], axis=1)
        return np.asarray(event.doubt * event.course[:, None, None] * wrong)

    def shape_doubt(self, event: Event) -> np.ndarray:
        """h (T, p, c): modes while the event lasts, each of the parameters together; of an irregular one in full, from
        its onset on."""
        T, p = len(self.history), self.history.width
        irregular = event.irregular >= LIKELY
        there = np.flatnonzero(event.course > 0)
        there = np.arange(there[0], T) if irregular else there
        lasting = wander_modes(len(there))
        modes = np.zeros((T, lasting.shape[1]))
        modes[there] = lasting
        direction = np.zeros(p)
        direction[list(event.suspect.positions)] = (1.0 if irregular else SHAPE_DOUBT) * event.size
        return np.asarray(direction[None, :, None] * modes[:, None, :])

    def condition_on(self, events: Sequence[Event]) -> Background:
        """The background with these events in it, whatever their size."""
        key = tuple(event.key for event in events)
        if key not in self._conditions:
            found = self.background
            for event in events:
                found = found.add_columns(self.event_columns(event)[0])
            while len(self._conditions) >= KEPT_BACKGROUNDS:
                self._conditions.pop(next(iter(self._conditions)))
            self._conditions[key] = found
        return self._conditions[key]

    def scan(self, events: Sequence[Event]) -> Scan:
        """The posterior over one more change; cells of onsets that matter are opened."""
        key = tuple(sorted(event.key for event in events))
        if key not in self._scans:
            background = self.condition_on(events)
            self._scans[key] = self._opened(with_patterns(self.space, background).scan(background), background)
        return self._scans[key]

    def scan_near(self, others: Sequence[Event], event: Event) -> Scan:
        """The posterior over kinds and onsets near those of an event, the others given, with its course in doubt; of an
        intermittent one over the flights that it is in."""
        background = self.condition_on(others)
        if event.kind == INTERMITTENT:
            return self._scan_shapes(nearby_patterns(event.course), background)
        shapes = nearby_shapes(event.shape, len(self.history), self.history.maintenance)
        return self._scan_shapes(shapes, background.add_columns(self.shape_doubt(event)))

    def take(self, others: Sequence[Event], owner: str = "") -> Event:
        """The likeliest further event, of one owner where that is named, with what the data leave of the doubts about
        its course and its effect."""
        event, before = self.scan(others).best_event(owner), self.condition_on(others)

        def log_evidence(one: Event) -> float:
            return before.add_columns(self.event_columns(one)[0]).log_evidence

        if event.kind != INTERMITTENT:
            prior = (INSTRUMENT_PRIOR if event.suspect.instrument else COMPONENT_PRIOR)[IRREGULAR]
            moved = log_evidence(replace(event, irregular=1.0)) - log_evidence(event)
            event = replace(event, irregular=float(expit(moved + np.log(prior / (1 - prior)))))
        if all(self.history.parameters[i].belongs_to_sensor for i in event.suspect.positions):
            return event
        log = np.array([log_evidence(replace(event, doubt=share)) for share in EFFECT_DOUBTS])
        return replace(event, doubt=float(np.sqrt(normalized_weights(log) @ np.square(EFFECT_DOUBTS))))

    def irregular_onsets(self, others: Sequence[Event], event: Event) -> np.ndarray:
        """Probability (T,) of the onsets near that of an irregular event, the others given."""
        before, T = self.condition_on(others), len(self.history)
        shapes = moved_shapes(event.shape, T, self.history.maintenance)
        each = [replace(event, shape=shapes.select(np.array([k]))) for k in range(len(shapes))]
        log = [before.add_columns(self.event_columns(one)[0]).log_evidence for one in each]
        found = np.zeros(T)
        found[shapes.onset] = normalized_weights(np.array(log))
        return found

    def smooth_levels(self, events: Sequence[Event]) -> tuple[np.ndarray, np.ndarray]:
        """Level and standard deviation (T, p) of each parameter by the events with their doubts, in prior ones."""
        T, p = len(self.history), self.history.width
        if not events:
            return np.zeros((T, p)), np.zeros((T, p))
        columns = [self.event_columns(event) for event in events]
        h = np.concatenate([c for c, _ in columns], axis=2)
        b, M = self.background.joint(h)
        h = h * np.concatenate([real for _, real in columns])
        covariance = np.linalg.inv(M + np.eye(len(b)))
        return h @ (covariance @ b), np.sqrt(np.einsum("tpc,cd,tpd->tp", h, covariance, h))

    def alternatives(self, events: Sequence[Event]) -> list[tuple[float, Sequence[Event]]]:
        """Sets of events with their probabilities: in the place of the least certain event each suspect of its
        ambiguity group."""
        least, found = 1.0, [(1.0, events)]
        for k in range(len(events)):
            others = [*events[:k], *events[k + 1 :]]
            shares = {name: p for name, p in owner_shares(self.scan(others).owners()).items() if name != UNLISTED}
            group = leading_suspects(shares.items(), sum(shares.values()))
            if len(group) > 1 and group[0][1] < least:
                least, whole = group[0][1], sum(p for _, p in group)
                found = [(p / whole, [*others, self.take(others, name)]) for name, p in group]
        return found

    def log_probability(self, events: Sequence[Event]) -> float:
        """Of a set of events with their shapes, against none: marginal likelihood times prior."""
        moved = self.condition_on(events).log_evidence - self.background.log_evidence
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
    return HistorySearch(history, background, space)


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
    where it has several: what one event cannot be moved to, none of them may need; and whether what was taken for the
    model's error about them is another, of the same flight."""
    events = exchange(search, events)
    while len(events) < DEPTH and any(event.doubt > EFFECT_DOUBTS[0] for event in events):
        firm = tuple(replace(event, doubt=min(event.doubt, EFFECT_DOUBTS[0])) for event in events)
        again = add_events(search, firm, 1)
        if len(again) <= len(events) or search.log_probability(again) <= search.log_probability(events):
            break
        events = again
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
            if scan.log_odds < 0:
                events = others
                continue
            changed = (*events[:k], search.take(others), *events[k + 1 :])
            if search.log_probability(changed) > search.log_probability(events):
                events = changed
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
    """Amounts of wander, each with what one event adds. What wanders more hides more: where the least amount leaves no
    change likelier than not, it and the likeliest amount are enough."""
    nominal = Background.from_history(history)
    searches = [prepare_search(history, nominal, WANDER_MULTIPLES[0], suspects)]
    first = searches[0].scan(()).log_odds
    if first >= QUIET:
        searches += [prepare_search(history, nominal, multiple, suspects) for multiple in WANDER_MULTIPLES[1:]]
    evidence = np.array([search.background.log_evidence for search in searches])
    log = np.log(WANDER_PRIOR[: len(searches)]) + evidence
    if first >= 0:
        weighed = [0, *(1 + np.flatnonzero(evidence[1:] >= evidence[0] - RIVAL)).tolist()]
    else:
        weighed = sorted({0, int(np.argmax(log))})
    found = []
    for k in weighed:
        scan = searches[k].scan(())
        weight = float(log[k] + np.logaddexp(0.0, scan.log_odds))
        found.append(WanderChoice(WANDER_MULTIPLES[k], searches[k], scan, weight))
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
