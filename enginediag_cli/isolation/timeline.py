"""What has changed during a series, what kind of change it is and since when: one judgement over all suspects.

A suspect is a component, with all or one of its parameters, or an instrument. An event is a change of one suspect with
one course (`detection/wander.py`), and has the prior

    P(suspect changes) P(kind | suspect) P(onset | kind) P(parameters | suspect),    δ ~ mean over slabs of N(0, slab²)

Instruments step, at once and for good; components wear or are damaged. All suspects, kinds and onsets are enumerated
for one event, the others of the series given. What is likeliest is added, or exchanged for another event, and the
scatter is estimated again without it: an event stays where the series and the events together become more probable. No
suspect is reported as less probable than it is by the scatter that its own event leaves.

Search. How large an event is depends on the scatter that it is judged by, and the scatter on what was taken out: by
that of a series which still holds an event any size passes for small, and by that which was read without one
suspect's change all others leave what it cannot be, whoever it was. So where no other event makes the series
likelier each suspect that was tried is evaluated again by the scatter that its own event leaves, until that is
settled, and suspects are compared as they are then.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from enginediag_cli.detection.series import FEWEST, FlightWindow, Readings, Series
from enginediag_cli.detection.verdict import glr_test
from enginediag_cli.detection.wander import (
    DETERIORATION,
    STEP,
    Courses,
    ScatterLaws,
    Wander,
    candidate_courses,
    pair_places,
    score_table,
)
from enginediag_cli.isolation.events import (
    HALF,
    SIZE,
    TINY,
    UNRECORDED,
    EventModel,
    EventSearch,
    EventSuspect,
    SeriesDiagnosis,
    SeriesEvent,
    SeriesFit,
    SuspectGroups,
    group_slabs,
    log_kind_prior,
    suspect_groups,
)
from enginediag_cli.isolation.prior import SEPARATED, SetPrior
from enginediag_cli.isolation.results import probability_of_unlisted
from enginediag_cli.parallel import parallel_imap
from enginediag_cli.parameters import Parameter, meanings
from enginediag_cli.progress import each, stage
from enginediag_cli.residuals.instruments import level_of_ratio
from enginediag_cli.residuals.score import fisher_score

LAWS = (False, True)
"""Laws of scatter, each as probable as the other: readings scatter by themselves, or wander."""
MAX_EVENTS = 4
"""Events in one series at most: a stop, since each must be more probable than none."""
PASSES = 8
"""Exchanges of events at most, each of which makes the series likelier."""
SETTLED = 0.1
"""Nats by which another look at a series must make it likelier: less changes no answer."""
READ_AGAIN = 3
"""Times that the scatter is read again for one suspect; the first time does most."""
REACH = 20.0
"""Nats that reading the scatter again for one suspect does not make up for; of a fleet of 100 up to 13 were seen."""
KEPT_BYTES = 150e6
"""Size of the laws of scatter that are remembered: of series of forty epochs all, of the longest those of a few looks,
each of which takes as long as a look to find again."""
OWNERS = 3
"""Suspects of which the first event is tried: the likeliest by the scatter of a series with the event still in it need
not be the likeliest by that without it."""


@dataclass(frozen=True)
class EventSet:
    """Events, and the log probability of them and of the scatter that they leave."""

    chosen: tuple[EventModel, ...]
    log: float


@dataclass(frozen=True)
class EventEvidence:
    """Evidence for one event, given the `others`: log_odds that it happened, with the scatter read again without it;
    alternatives: log odds of other suspects against its own, each with the scatter that its event leaves.
    """

    others: tuple[EventModel, ...]
    log_odds: float
    alternatives: Mapping[str, float]


@dataclass(frozen=True)
class SeriesSearch:
    """What is looked for in a series: suspects with the log priors of their kinds (G, L), courses, slabs of sizes,
    doubt (G,) about effects; at: places of pairs of parameters in tables."""

    readings: Readings
    suspects: SuspectGroups
    courses: Courses
    kinds: np.ndarray
    slabs: tuple[float, ...]
    doubt: np.ndarray
    pair_positions: np.ndarray
    _scatter: ScatterLaws = field(init=False, repr=False, compare=False)
    _scatter_cache: dict[tuple[EventModel, ...], list[Wander]] = field(default_factory=dict, repr=False, compare=False)
    _evaluated: dict[tuple[EventModel, ...], EventSet] = field(default_factory=dict, repr=False, compare=False)
    _first_evaluated: dict[tuple[tuple[int, int, bool], ...], EventSet] = field(
        default_factory=dict, repr=False, compare=False
    )

    def __post_init__(self) -> None:
        object.__setattr__(self, "_scatter", ScatterLaws(self.readings))

    def find_events(self) -> tuple[EventSet, EventSearch, bool]:
        """The events that make the series likeliest, the posterior beside them, and whether the search settled."""
        best, settled = self.evaluate(()), False
        for _ in range(PASSES):
            searched = self.next_event(best)
            proposed = list(_proposals(searched, best.chosen))
            trials = [self._first_evaluation(found) for found in proposed]
            better = max(trials, key=lambda trial: trial.log, default=best)
            if better.log <= best.log + SETTLED:
                rivals = self._best_by_suspect([best, *trials, *map(self.evaluate, proposed)], best.log - REACH)
                better = max(map(self._refine_last_event, rivals), key=lambda trial: trial.log, default=best)
            settled = better.log <= best.log + SETTLED
            if settled:
                break
            best = better
        return best, searched if settled else self.next_event(best), settled

    def event_evidence(self, best: EventSet) -> list[EventEvidence]:
        """Each event of `best` with what speaks against it."""
        found = []
        for k in range(len(best.chosen)):
            others = (*best.chosen[:k], *best.chosen[k + 1 :])
            found.append(
                EventEvidence(others, best.log - self.evaluate(others).log, self._alternative_suspects(best, k))
            )
        return found

    def evaluate(self, chosen: Sequence[EventModel]) -> EventSet:
        """The series with these events taken out."""
        key = tuple(sorted(chosen, key=lambda event: event.key))
        if key not in self._evaluated:
            left = self.residual_scatter(chosen)
            prior = sum(
                float(self.suspects.log_odds[e.group] + self.kinds[e.group, e.course]) - SIZE * e.parameter_count
                for e in chosen
            )
            log = float(np.logaddexp.reduce([wander.log_without_events for wander in left])) + prior
            self._evaluated[key] = EventSet(tuple(chosen), log)
        return self._evaluated[key]

    def residual_scatter(self, chosen: Sequence[EventModel]) -> list[Wander]:
        """The laws of the scatter that these events leave; those of a few looks are remembered."""
        key = tuple(chosen)
        if key not in self._scatter_cache:
            left = self._scatter.estimate(event_effect(self.readings, self.suspects, self.courses, chosen), LAWS)
            size = sum(law.inverse.nbytes for law in left)
            while self._scatter_cache and (len(self._scatter_cache) + 1) * size > KEPT_BYTES:
                del self._scatter_cache[next(iter(self._scatter_cache))]
            self._scatter_cache[key] = left
        return self._scatter_cache[key]

    def next_event(self, at: EventSet) -> EventSearch:
        """The posterior over one more event by the scatter of a look."""
        tables = tuple(
            score_table(self.readings, wander, self.courses, self.pair_positions)
            for wander in self.residual_scatter(at.chosen)
        )
        return EventSearch(tables, self.courses, self.suspects, self.slabs, self.kinds, self.doubt)

    def _first_evaluation(self, chosen: Sequence[EventModel]) -> EventSet:
        """The first look at events of these suspects and courses, whatever their sizes were then: on the way sizes only
        have to be of the right order."""
        key = tuple(sorted(event.key for event in chosen))
        if key not in self._first_evaluated:
            self._first_evaluated[key] = self.evaluate(chosen)
        return self._first_evaluated[key]

    def _best_by_suspect(self, looks: Iterable[EventSet], least: float) -> list[EventSet]:
        """The likeliest of the looks by suspect of the last event and number of events, where it is above `least`."""
        found: dict[tuple[int, str], EventSet] = {}
        for look in looks:
            if look.chosen and look.log > least:
                key = len(look.chosen), self.suspects.owner[look.chosen[-1].group]
                found[key] = max(found.get(key, look), look, key=lambda trial: trial.log)
        return list(found.values())

    def _refine_last_event(self, look: EventSet) -> EventSet:
        """The same suspects with the last event as it is by the scatter that it leaves, by the likelier law of it."""
        *others, event = look.chosen
        owner = self.suspects.owner[event.group]
        for _ in range(READ_AGAIN):
            law = max(self.residual_scatter(look.chosen), key=lambda wander: wander.log_without_events)
            trials = [self.evaluate([*others, again]) for again in self._suspect_candidates(law, others, owner)]
            better = max(trials, key=lambda trial: trial.log)
            if better.log <= look.log + SETTLED:
                break
            look = better
        return look

    def _suspect_candidates(self, law: Wander, others: Sequence[EventModel], owner: str) -> Iterator[EventModel]:
        """The likeliest event of one suspect by one law of scatter, of one law of growth and of several."""
        mine = self.suspects.members(owner)
        members = {i for k in mine for i in self.suspects.groups[k]}
        inside = np.array([i in members for i in range(len(self.pair_positions) - 1)])
        t = score_table(
            self.readings,
            law,
            self.courses,
            pair_places((self.pair_positions[:-1, :-1] >= 0) & inside & inside[:, None]),
        )
        search = EventSearch((t,), self.courses, self.suspects, self.slabs, self.kinds, self.doubt)
        log = np.stack([search.group_sizes(others, k)[0].log for k in mine])
        log += self.suspects.log_odds[mine, None] + self.kinds[mine]
        place, course = (int(i) for i in np.unravel_index(int(np.argmax(log)), log.shape))
        found = EventModel(mine[place], course, tuple(search.group_sizes(others, mine[place])[0].mean[course].tolist()))
        yield found
        if grown := search.mix_growth_laws(t, others, found):
            yield grown

    def _alternative_suspects(self, best: EventSet, k: int) -> dict[str, float]:
        """log odds of the suspects that were tried in the place of the k-th event of `best`, the others as they are,
        each by the scatter that its own event leaves and by how large that is."""
        owner = self.suspects.owner
        rest = Counter(event.key for event in best.chosen) - Counter([best.chosen[k].key])
        own = best.log + self._log_size_prior(best.chosen[k])
        found: dict[str, float] = {}
        for look in self._evaluated.values():
            other = Counter(event.key for event in look.chosen) - rest
            if len(look.chosen) == len(best.chosen) and other.total() == 1:
                event = next(event for event in look.chosen if event.key in other)
                name, log = owner[event.group], look.log + self._log_size_prior(event) - own
                if name != owner[best.chosen[k].group]:
                    found[name] = max(found.get(name, -np.inf), log)
        return found

    def _log_size_prior(self, event: EventModel) -> float:
        """log prior of a change of this size, relative to a small one: the mixture of slabs."""
        slabs = np.array(group_slabs(self.suspects, event.group, self.slabs))
        density = -len(event.size) * np.log(slabs)
        square = float(np.sum(np.square(event.size)))
        return float(np.logaddexp.reduce(density - 0.5 * square / slabs**2) - np.logaddexp.reduce(density))


def event_effect(
    readings: Readings, suspects: SuspectGroups, among: Courses, chosen: Sequence[EventModel]
) -> np.ndarray:
    """What the events add to the readings (n, m)."""
    known = np.zeros_like(readings.z)
    for event in chosen:
        group = list(suspects.groups[event.group])
        added = readings.J[:, :, group] @ np.array(event.size)
        if not suspects.self_evident[event.group]:
            added[:, added.shape[1] - readings.inputs :] = 0.0
        known += event.course_values(among)[:, None] * added
    return known


def _proposals(search: EventSearch, chosen: Sequence[EventModel]) -> Iterator[list[EventModel]]:
    """What may be likelier: one event more, by each law of scatter alone, or another one for any; one less."""
    for k in range(len(chosen) + 1):
        others = [*chosen[:k], *chosen[k + 1 :]]
        if k < len(chosen):
            yield others
        elif len(others) >= MAX_EVENTS:
            continue
        for t in search.tables:
            for found in _best_events(replace(search, tables=(t,)), others, 1 if others else OWNERS):
                yield [*others, found]
                if grown := search.mix_growth_laws(t, others, found):
                    yield [*others, grown]


def _best_events(search: EventSearch, others: Sequence[EventModel], most: int) -> list[EventModel]:
    """The likeliest further event of each of the `most` likeliest owners, none where no event at all is likelier."""
    log, nothing = search.posterior(others)
    if np.logaddexp.reduce(log, axis=None) <= np.logaddexp.reduce(nothing):
        return []
    over = np.logaddexp.reduce(log, axis=0)
    suspects = search.suspects
    by_owner = {c: float(np.logaddexp.reduce(over[suspects.members(c)], axis=None)) for c in suspects.components}
    found = []
    for owner in sorted(by_owner, key=lambda name: -by_owner[name])[:most]:
        mine = suspects.members(owner)
        place, course = np.unravel_index(int(np.argmax(over[mine])), over[mine].shape)
        group = mine[int(place)]
        law = int(np.argmax(log[:, group, course]))
        size = search.group_sizes(others, group)[law].mean[course]
        found.append(EventModel(group, int(course), tuple(size.tolist())))
    return found


EPOCHS, FLEET_EPOCHS = 400, 40
"""Epochs of one series that are judged at once, alone and where there are several: work grows with their third power.
Longer ones are joined."""
OPERATION = 0.5
"""Share of the steps of components, where readings wander, that is a change of operation nobody recorded. Judgement."""
LISTED = 0.5
"""Probability from which an event is one."""
DECIDED = 5.0
"""Log odds by which a change must show by one law of scatter alone, and by which all laws together must speak against
it, to be plain: laws are read from the series that they judge, and odds between them are worth less than those within
one (decisive by R. E. Kass and A. E. Raftery, JASA 90 (1995) 773–795)."""
GENERIC, KNOWN = 0.1, 0.03
"""Share to which the effect of a component on the readings is known where the maps are generic (half the standard
deviation of their slopes, of which the effect is a part) and where they are the engine's."""
INPUTS = 0.03
"""The same of an input, whose effect is mostly thermodynamics: pressures and temperatures scale with it."""


@dataclass(frozen=True)
class TrendOptions:
    """Options of the judgement of a series.

    Attributes
    ----------
    prior : SetPrior
        Probabilities of changes of components and sensors, and their sizes.
    healthy : int
        First epochs in which nothing began.
    sensors : bool
        Whether instruments are suspects.
    generic : bool
        Whether the maps are not the engine's own.
    governed : collection of str
        Errors of inputs that a governor may hold where they were read.
    """

    prior: SetPrior = field(default_factory=SetPrior)
    healthy: int = 0
    sensors: bool = True
    generic: bool = True
    governed: Collection[str] = ()


def epoch_limit(series: int) -> int:
    """Epochs that each of so many series is judged by."""
    return EPOCHS if series == 1 else FLEET_EPOCHS


@stage("judging the series")
def judge_series(
    readings: Readings, meaning: Mapping[str, Parameter], options: TrendOptions | None = None
) -> SeriesDiagnosis:
    """Find the events of a series.

    Parameters
    ----------
    readings : Readings
        n epochs of m readings and p parameters.
    meaning : mapping of str to Parameter
        Meaning of the parameters.
    options : TrendOptions, optional
        Prior and suspects.

    Returns
    -------
    SeriesDiagnosis

    Raises
    ------
    ValueError
        For fewer than three epochs.
    """
    if len(readings) < 3:
        raise ValueError("a trend needs at least three flights")
    options = options or TrendOptions()
    described = tuple(meanings(meaning, readings.parameters).values())
    suspects = suspect_groups(described, options.prior, options.sensors, options.governed)
    among = candidate_courses(readings.clock, int(np.searchsorted(readings.first, options.healthy)))
    together = np.zeros((len(described),) * 2, bool)
    for group in suspects.groups:
        together[np.ix_(group, group)] = True
    at = pair_places(together)
    of_sensors = [all(described[i].belongs_to_sensor for i in group) for group in suspects.groups]
    doubt = np.where(suspects.instrument, INPUTS, GENERIC if options.generic else KNOWN)
    doubt[of_sensors] = 0.0
    kinds = log_kind_prior(suspects, among)
    looks = SeriesSearch(readings, suspects, among, kinds, options.prior.slabs, doubt, at)
    best, searched, settled = looks.find_events()
    return _series_diagnosis(readings, replace(searched, tails=True), best.chosen, looks.event_evidence(best), settled)


def _series_diagnosis(
    readings: Readings, search: EventSearch, chosen: Sequence[EventModel], found: Sequence[EventEvidence], settled: bool
) -> SeriesDiagnosis:
    missed = {c: 1.0 for c in search.suspects.components}
    events = []
    for one in found:
        event = _describe_event(readings, search, one.others, one.log_odds, one.alternatives)
        if event.probability >= LISTED:
            events.append(event)
        for member in event.members:
            if member.component != UNRECORDED:
                missed[member.component] *= 1 - event.probability * member.probability
    if {search.suspects.owner[c.group] for c in chosen} < set(search.suspects.owner):  # others may have changed as well
        more = _describe_event(readings, search, chosen)
        for member in more.members:
            if member.component != UNRECORDED:
                missed[member.component] *= 1 - more.probability * member.probability
    events.sort(key=lambda e: -e.weight)
    fit = _series_fit(readings, search, chosen)
    level = level_of_ratio(max(fit.chi2_after, TINY), readings.z.size)
    unlisted = probability_of_unlisted(level, 0.0, -np.inf) if events else 0.0
    listed = 1.0 - unlisted
    events = [replace(event, probability=listed * event.probability) for event in events] if listed > HALF else []
    return SeriesDiagnosis(
        tuple(events),
        int(readings.flights.sum()),
        {c: listed * (1 - m) for c, m in missed.items()},
        settled,
        fit,
        None if events or unlisted else _undecided_event(readings, search, chosen),
        unlisted,
    )


def _undecided_event(readings: Readings, search: EventSearch, chosen: Sequence[EventModel]) -> SeriesEvent | None:
    """A further event by the law of scatter that shows it, where it is not settled that the other one holds."""
    log, nothing = search.posterior(chosen)
    by_law = np.logaddexp.reduce(log, axis=(1, 2))
    if np.logaddexp.reduce(by_law) - np.logaddexp.reduce(nothing) < -DECIDED:
        return None
    shown = by_law - nothing
    law = int(np.argmax(shown))
    one = replace(search, tables=(search.tables[law],))
    return _describe_event(readings, one, chosen) if shown[law] > DECIDED else None


def _describe_event(
    readings: Readings,
    search: EventSearch,
    others: Sequence[EventModel],
    most: float = np.inf,
    instead: Mapping[str, float] | None = None,
) -> SeriesEvent:
    """most: log odds of the event where the scatter is read again without it; instead: of other suspects against the
    likeliest, where it is read again without theirs. By a scatter that was read without one suspect's change the others
    leave what it cannot be, whoever it was."""
    log, nothing = search.posterior(others)
    log = _raise_alternatives(search.suspects, log, instead or {})
    total, none = np.logaddexp.reduce(log, axis=None), np.logaddexp.reduce(nothing)
    weight = np.exp(log - total)
    suspects, among = search.suspects, search.courses
    chance = {c: float(weight[:, suspects.members(c)].sum()) for c in suspects.components}
    order = sorted(chance, key=lambda c: -chance[c])
    mine = weight[:, suspects.members(order[0])].sum(axis=(0, 1))
    growing = bool(mine[among.growing].sum() > mine[~among.growing].sum())
    at = among.growing == growing
    onset, low, high = _onset_interval(among.onset[at], mine[at], readings)
    odds = min(float(total - none), most)
    members = [_describe_suspect(readings, search, others, weight, c, chance[c]) for c in order if chance[c] >= 0.01]
    members = _split_with_operation(search, weight, members)
    return SeriesEvent(
        float(1 / (1 + np.exp(-np.clip(odds, -700, 700)))),
        tuple(members),
        DETERIORATION if growing else STEP,
        onset,
        low,
        high,
        odds,
    )


def _raise_alternatives(suspects: SuspectGroups, log: np.ndarray, instead: Mapping[str, float]) -> np.ndarray:
    """log probabilities (h, G, L) with those suspects raised that are likelier by the scatter that they leave."""
    log = log.copy()
    over = {c: float(np.logaddexp.reduce(log[:, suspects.members(c)], axis=None)) for c in suspects.components}
    top = max(over.values())
    for component, odds in instead.items():
        if np.isfinite(over[component]):
            log[:, suspects.members(component)] += max(top + odds - over[component], 0.0)
    return log


def _split_with_operation(
    search: EventSearch, weight: np.ndarray, members: Sequence[EventSuspect]
) -> list[EventSuspect]:
    """Members, likeliest first, where readings wander with operation as an alternative to every component that steps.

    What wanders is what nobody models, such as guide vanes. It moves all readings at once, as a component does, and
    components seldom change at once: of such a step one half is believed."""
    wander = np.array([t.wander.slow for t in search.tables])
    steps = ~search.courses.growing
    found, unrecorded = [], 0.0
    for member in members:
        if not member.instrument:
            mine = search.suspects.members(member.component)
            doubted = OPERATION * float(weight[np.ix_(wander, np.array(mine), steps)].sum())
            unrecorded += doubted
            member = replace(member, probability=member.probability - doubted)
        found.append(member)
    if unrecorded >= 0.01:
        found.append(EventSuspect(UNRECORDED, unrecorded, (), (), (), (), True))
    return sorted(found, key=lambda member: -member.probability)


def _describe_suspect(
    readings: Readings,
    search: EventSearch,
    others: Sequence[EventModel],
    weight: np.ndarray,
    component: str,
    chance: float,
) -> EventSuspect:
    from scipy.stats import norm

    suspects = search.suspects
    mine = suspects.members(component)
    positions = tuple(sorted({i for k in mine for i in suspects.groups[k]}))
    inclusion, weighed, first, second = (np.zeros(len(positions)) for _ in range(4))
    joint, held = np.zeros((len(positions), len(positions))), 0.0
    for k in mine:
        if weight[:, k].sum() < 1e-3 * chance:
            continue
        at = [positions.index(i) for i in suspects.groups[k]]
        for w, sizes in zip(weight[:, k] / chance, search.group_sizes(others, k), strict=True):
            own = np.einsum("lqq->lq", sizes.covariance)
            square = sizes.mean**2 + own
            # a share of the largest change below that to which effects are known is no change of its own
            least = search.doubt[k] * np.abs(sizes.mean).max(axis=1, keepdims=True)
            inclusion[at] += w @ (
                norm.sf((least - sizes.mean) / np.sqrt(own)) + norm.cdf((-least - sizes.mean) / np.sqrt(own))
            )
            weighed[at] += w.sum()
            first[at] += w @ sizes.mean
            second[at] += w @ square
            both = sizes.covariance + sizes.mean[:, :, None] * sizes.mean[:, None, :]
            joint[np.ix_(at, at)] += np.einsum("l,lij->ij", w, both)
            held += float(w.sum())
    instrument = bool(suspects.instrument[mine[0]])
    if instrument:  # wrong in one form: that one stands for it, with the size that it has then
        share = weighed / max(weighed.sum(), 1e-300)
        k = int(np.argmax(share)) if share.max() >= SEPARATED else 0
        one = [k]
        positions, inclusion = (positions[k],), np.array([inclusion.sum()])
        weighed, first, second, joint = weighed[one], first[one], second[one], joint[np.ix_(one, one)]
        held = float(weighed[0])
    given = np.maximum(weighed, 1e-300)
    mean = first / given
    deviation = np.sqrt(np.maximum(second / given - mean**2, 0.0))
    expected = first / max(held, 1e-300)
    described, unit = [suspects.described[i] for i in positions], readings.D[list(positions)]
    covariance = unit[:, None] * (joint / max(held, 1e-300) - np.outer(expected, expected)) * unit
    return EventSuspect(
        component,
        chance,
        tuple(p.name for p in described),
        tuple(inclusion.tolist()),
        tuple((unit * mean).tolist()),
        tuple((unit * deviation).tolist()),
        instrument,
        tuple((unit * expected).tolist()),
        tuple(map(tuple, covariance.tolist())),
    )


def _onset_interval(onset: np.ndarray, weight: np.ndarray, readings: Readings) -> tuple[int, int, int]:
    """Number of the first changed flight, from 1: most probable, and the 95 % interval."""
    each = np.zeros(len(readings))
    np.add.at(each, onset, weight)
    each /= each.sum()
    order = np.argsort(-each, kind="stable")
    chosen = order[: int(np.searchsorted(np.cumsum(each[order]), 0.95)) + 1]
    best, low, high = (int(readings.first[k]) + 1 for k in (np.argmax(each), chosen.min(), chosen.max()))
    return best, low, high


def _series_fit(readings: Readings, search: EventSearch, chosen: Sequence[EventModel]) -> SeriesFit:
    wander = max((t.wander for t in search.tables), key=lambda w: w.log)
    left = readings.z - event_effect(readings, search.suspects, search.courses, chosen)
    dof = left.size

    def chi2(z: np.ndarray) -> float:
        return float(np.einsum("nk,knj,jk->", z @ wander.W, wander.inverse, z @ wander.W)) / dof

    return SeriesFit(chi2(readings.z), chi2(left))


GROSS = 1e-4
"""Chance of one flight among all of a healthy series to count as one that differs from nominal for certain."""


def departing_flights(stretches: Sequence[FlightWindow]) -> tuple[int, ...]:
    """Numbers, from 1, of the flights that differ from nominal for certain, each by itself."""
    found = []
    for number, stretch in enumerate(stretches, start=1):
        score = fisher_score(stretch.statistics.drop_parameters(stretch.window.silent))
        if glr_test(score, GROSS / len(stretches)).alarm:
            found.append(number)
    return tuple(found)


def diagnose_engines(
    series: Series, *, reference: int = 0, sensors: bool = True, generic: bool = True, against_nominal: bool = False
) -> Iterator[tuple[str, SeriesDiagnosis]]:
    """Find the events of every engine of a series that has flights enough.

    Parameters
    ----------
    series : Series
        Flights of engines.
    reference : int
        First records of each engine in which nothing began.
    sensors, generic : bool
        As of `TrendOptions`.
    against_nominal : bool
        Whether the statistics hold the uncertainty of nominal, too, so that each flight can be tested by itself.

    Returns
    -------
    iterator of (str, SeriesDiagnosis)
        Engine and diagnosis, in the order of the engines.

    Raises
    ------
    DataError
        When flights of an engine have statistics of different parameters.
    """
    engines = [engine for engine, stretches in series.stretches.items() if len(stretches) >= FEWEST]
    most = epoch_limit(len(series.stretches))

    def judged(k: int) -> SeriesDiagnosis:
        options = TrendOptions(
            healthy=series.healthy(engines[k], reference),
            sensors=sensors,
            generic=generic,
            governed=series.power_errors,
        )
        story = judge_series(series.readings(engines[k]).merge_epochs(most), series.parameters, options)
        return replace(story, departures=departing_flights(series.stretches[engines[k]])) if against_nominal else story

    stories = zip(engines, parallel_imap(judged, len(engines)), strict=True)
    return each(stories, "engines judged", len(engines))
