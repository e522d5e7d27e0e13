"""What has changed during a series, what kind of change it is and since when: one judgement over all suspects.

A suspect is a component, with all or one of its parameters, or an instrument. An event is a change of one suspect with
one course (`detection/course.py`), and has the prior

    P(suspect changes) P(kind | suspect) P(onset | kind) P(parameters | suspect),    δ ~ mean over slabs of N(0, slab²)

Instruments step, at once and for good; components wear or are damaged. All suspects, kinds and onsets are enumerated
for one event, the others of the series given. What is likeliest is added, or exchanged for another event, and the
scatter is read again without it: the series and the events together become likelier by it, or it does not stay
(`series_looks.py`). No suspect is told to be less probable than it is by the scatter that its own event leaves.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from enginediag_cli.detection.course import DETERIORATION, STEP, courses, places
from enginediag_cli.detection.readings import Readings
from enginediag_cli.isolation.adequacy import probability_of_unlisted
from enginediag_cli.isolation.prior import SEPARATED, SetPrior
from enginediag_cli.isolation.series_looks import Found, Looks, effect
from enginediag_cli.isolation.series_search import TINY, Chosen, Search
from enginediag_cli.isolation.story import HALF, UNRECORDED, Event, Fit, Member, Story
from enginediag_cli.isolation.suspects import Suspects, log_of_kinds, suspects_of
from enginediag_cli.parameters import Parameter, meanings
from enginediag_cli.progress import stage
from enginediag_cli.residuals.noise import level_of_ratio

EPOCHS, OF_A_FLEET = 400, 40
"""Epochs of one series that are judged at once, alone and where there are several: work grows with their third power.
Longer ones are joined."""
OPERATION = 0.5
"""Share of the steps of components, where readings wander, that is a change of operation nobody recorded. Judgement."""
TOLD = 0.5
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
    """`prior`: chances of components and sensors, and sizes; healthy: so many epochs at the beginning in which nothing
    began; sensors: instruments are suspects; generic: the maps are not the engine's own; governed: errors of inputs
    that a governor may hold where they were read."""

    prior: SetPrior = field(default_factory=SetPrior)
    healthy: int = 0
    sensors: bool = True
    generic: bool = True
    governed: Collection[str] = ()


def epochs_of(series: int) -> int:
    """Epochs that each of so many series is judged by."""
    return EPOCHS if series == 1 else OF_A_FLEET


@stage("judging the series")
def judge_series(readings: Readings, meaning: Mapping[str, Parameter], options: TrendOptions | None = None) -> Story:
    """What has happened in a series of three epochs at least; ValueError otherwise."""
    if len(readings) < 3:
        raise ValueError("a trend needs at least three flights")
    options = options or TrendOptions()
    described = tuple(meanings(meaning, readings.parameters).values())
    suspects = suspects_of(described, options.prior, options.sensors, options.governed)
    among = courses(readings.clock, int(np.searchsorted(readings.first, options.healthy)))
    together = np.zeros((len(described),) * 2, bool)
    for group in suspects.groups:
        together[np.ix_(group, group)] = True
    at = places(together)
    of_sensors = [all(described[i].of_sensor for i in group) for group in suspects.groups]
    doubt = np.where(suspects.instrument, INPUTS, GENERIC if options.generic else KNOWN)
    doubt[of_sensors] = 0.0
    kinds = log_of_kinds(suspects, among)
    looks = Looks(readings, suspects, among, kinds, options.prior.slabs, doubt, at)
    best, searched, settled = looks.likeliest()
    return _told(readings, replace(searched, tails=True), best.chosen, looks.found(best), settled)


def _told(readings: Readings, search: Search, chosen: Sequence[Chosen], found: Sequence[Found], settled: bool) -> Story:
    missed = {c: 1.0 for c in search.suspects.components}
    events = []
    for one in found:
        event = _event(readings, search, one.others, one.gain, one.instead)
        if event.probability >= TOLD:
            events.append(event)
        for member in event.members:
            if member.component != UNRECORDED:
                missed[member.component] *= 1 - event.probability * member.probability
    if {search.suspects.owner[c.group] for c in chosen} < set(search.suspects.owner):  # others may have changed as well
        more = _event(readings, search, chosen)
        for member in more.members:
            if member.component != UNRECORDED:
                missed[member.component] *= 1 - more.probability * member.probability
    events.sort(key=lambda e: -e.weight)
    fit = _fit(readings, search, chosen)
    level = level_of_ratio(max(fit.after, TINY), readings.z.size)
    unlisted = probability_of_unlisted(level, 0.0, -np.inf) if events else 0.0
    listed = 1.0 - unlisted
    events = [replace(event, probability=listed * event.probability) for event in events] if listed > HALF else []
    return Story(
        tuple(events),
        int(readings.flights.sum()),
        {c: listed * (1 - m) for c, m in missed.items()},
        settled,
        fit,
        None if events or unlisted else _undecided(readings, search, chosen),
        unlisted,
    )


def _undecided(readings: Readings, search: Search, chosen: Sequence[Chosen]) -> Event | None:
    """A further event by the law of scatter that shows it, where it is not settled that the other one holds."""
    log, nothing = search.posterior(chosen)
    by_law = np.logaddexp.reduce(log, axis=(1, 2))
    if np.logaddexp.reduce(by_law) - np.logaddexp.reduce(nothing) < -DECIDED:
        return None
    shown = by_law - nothing
    law = int(np.argmax(shown))
    one = replace(search, tables=(search.tables[law],))
    return _event(readings, one, chosen) if shown[law] > DECIDED else None


def _event(
    readings: Readings,
    search: Search,
    others: Sequence[Chosen],
    most: float = np.inf,
    instead: Mapping[str, float] | None = None,
) -> Event:
    """most: log odds of the event where the scatter is read again without it; instead: of other suspects against the
    likeliest, where it is read again without theirs. By a scatter that was read without one suspect's change the others
    leave what it cannot be, whoever it was."""
    log, nothing = search.posterior(others)
    log = _with_own_scatter(search.suspects, log, instead or {})
    total, none = np.logaddexp.reduce(log, axis=None), np.logaddexp.reduce(nothing)
    weight = np.exp(log - total)
    suspects, among = search.suspects, search.courses
    chance = {c: float(weight[:, suspects.members(c)].sum()) for c in suspects.components}
    order = sorted(chance, key=lambda c: -chance[c])
    mine = weight[:, suspects.members(order[0])].sum(axis=(0, 1))
    growing = bool(mine[among.growing].sum() > mine[~among.growing].sum())
    at = among.growing == growing
    onset, low, high = _onset(among.onset[at], mine[at], readings)
    odds = min(float(total - none), most)
    members = [_member(readings, search, others, weight, c, chance[c]) for c in order if chance[c] >= 0.01]
    members = _beside_operation(search, weight, members)
    return Event(
        float(1 / (1 + np.exp(-np.clip(odds, -700, 700)))),
        tuple(members),
        DETERIORATION if growing else STEP,
        onset,
        low,
        high,
        odds,
    )


def _with_own_scatter(suspects: Suspects, log: np.ndarray, instead: Mapping[str, float]) -> np.ndarray:
    """log probabilities (h, G, L) with those suspects raised that are likelier by the scatter that they leave."""
    log = log.copy()
    over = {c: float(np.logaddexp.reduce(log[:, suspects.members(c)], axis=None)) for c in suspects.components}
    top = max(over.values())
    for component, odds in instead.items():
        if np.isfinite(over[component]):
            log[:, suspects.members(component)] += max(top + odds - over[component], 0.0)
    return log


def _beside_operation(search: Search, weight: np.ndarray, members: Sequence[Member]) -> list[Member]:
    """Members, likeliest first, where readings wander with operation as a rival of every component that steps.

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
        found.append(Member(UNRECORDED, unrecorded, (), (), (), (), True))
    return sorted(found, key=lambda member: -member.probability)


def _member(
    readings: Readings, search: Search, others: Sequence[Chosen], weight: np.ndarray, component: str, chance: float
) -> Member:
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
        for w, sizes in zip(weight[:, k] / chance, search.told(others, k), strict=True):
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
    return Member(
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


def _onset(onset: np.ndarray, weight: np.ndarray, readings: Readings) -> tuple[int, int, int]:
    """Number of the first changed flight, from 1: most probable, and the 95 % interval."""
    each = np.zeros(len(readings))
    np.add.at(each, onset, weight)
    each /= each.sum()
    order = np.argsort(-each, kind="stable")
    chosen = order[: int(np.searchsorted(np.cumsum(each[order]), 0.95)) + 1]
    best, low, high = (int(readings.first[k]) + 1 for k in (np.argmax(each), chosen.min(), chosen.max()))
    return best, low, high


def _fit(readings: Readings, search: Search, chosen: Sequence[Chosen]) -> Fit:
    wander = max((t.wander for t in search.tables), key=lambda w: w.log)
    left = readings.z - effect(readings, search.suspects, search.courses, chosen)
    dof = left.size

    def chi2(z: np.ndarray) -> float:
        return float(np.einsum("nk,knj,jk->", z @ wander.W, wander.inverse, z @ wander.W)) / dof

    return Fit(chi2(readings.z), chi2(left))
