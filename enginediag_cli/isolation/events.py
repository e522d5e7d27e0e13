"""Events of a series: what changed, how and since when, as a posterior over suspects, kinds and onsets.

The posterior is that of one more event, given the events already found.
The effect of a component is known to a share only (slopes of maps); in each mode it may be off by that share of
itself, which is marginalised, so that no difference of directions below it decides between components. A change that
is given takes with it everything of its course within that share.

Prior. A suspect is a component, with all or one of its parameters, or an instrument, with one form of its error:

    P(suspect changes) · P(parameters | suspect) · P(kind | suspect) · P(onset | kind)
"""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, cast

import numpy as np

from enginediag_cli.detection.wander import Courses, ScoreTable, course_sums
from enginediag_cli.isolation.prior import SERIES_PRIOR, SetPrior
from enginediag_cli.isolation.subsets import piecewise_normal_moments
from enginediag_cli.parameters import Parameter

CHANGED, STEADY, CANNOT_TELL = "changed", "steady", "cannot tell"
FROM_THE_FIRST = "differs from nominal from the first flight on"
HALF = 0.5
"""Probability from which something that is not listed is likelier than what is."""
CONVINCED = 0.9
"""Probability from which one suspect is named; below it the likeliest form an ambiguity group."""
UNRECORDED = "unrecorded operation"
"""Member of an event that is no component: guide vanes, bleed or load that moved and that nobody recorded."""
CLASS = 0.95
"""Probability that the members of a class hold together."""


@dataclass(frozen=True)
class EventSuspect:
    """One suspect of an event: a component or an instrument.

    Attributes
    ----------
    component : str
        Its name.
    probability : float
        That it is the one that changed, given the event.
    parameters : tuple of str
        Its parameters (q).
    inclusion, change, deviation : tuple of float
        Of each parameter: probability that it changed; change since the onset with its standard deviation, in its unit,
        given that it changed.
    instrument : bool
        Whether it is an instrument.
    expected, covariance : tuple
        Mean (q,) and covariance (q, q) of the changes, those of zero counted, given this suspect.
    """

    component: str
    probability: float
    parameters: tuple[str, ...]
    inclusion: tuple[float, ...]
    change: tuple[float, ...]
    deviation: tuple[float, ...]
    instrument: bool = False
    expected: tuple[float, ...] = ()
    covariance: tuple[tuple[float, ...], ...] = ()


@dataclass(frozen=True)
class SeriesEvent:
    """A change during the series.

    Attributes
    ----------
    probability : float
        That there is such an event, given the other events.
    members : tuple of EventSuspect
        Suspects, likeliest first.
    kind : str
        The likeliest kind.
    onset, low, high : int
        Number of the first changed flight, from 1 (of a growing change of the last unchanged one): most probable, and
        95 % interval.
    weight : float
        Log odds of the event.
    """

    probability: float
    members: tuple[EventSuspect, ...]
    kind: str
    onset: int
    low: int
    high: int
    weight: float = 0.0

    @property
    def named(self) -> tuple[EventSuspect, ...]:
        """The suspect that is named, or the ambiguity group of those that the data cannot separate."""
        told: list[EventSuspect] = []
        for member in self.members:
            told.append(member)
            if sum(m.probability for m in told) >= (CONVINCED if len(told) == 1 else CLASS):
                break
        return tuple(told)


@dataclass(frozen=True)
class SeriesFit:
    """χ² per degree of freedom of the readings by the scatter found, without any event (`chi2_before`) and with the
    events (`chi2_after`)."""

    chi2_before: float
    chi2_after: float


@dataclass(frozen=True)
class SeriesDiagnosis:
    """What changed during one series.

    Attributes
    ----------
    events : tuple of SeriesEvent
        Surest first.
    flights : int
        Flights of the series.
    inclusion : mapping of str to float
        Component → probability that it changed.
    converged : bool
        Whether the search converged.
    fit : SeriesFit
        χ² per degree of freedom without and with the events.
    undecided : SeriesEvent or None
        Without an event, a change that the series shows plainly if its readings scatter by themselves, and does not if
        they wander, when it is not settled that they do.
    unlisted : float
        Probability that the change is none of the suspects'; where it is likely there are no events.
    departures : tuple of int
        Numbers, from 1, of flights that differ from nominal for certain.
    """

    events: tuple[SeriesEvent, ...]
    flights: int
    inclusion: Mapping[str, float]
    converged: bool = True
    fit: SeriesFit = SeriesFit(1.0, 1.0)
    undecided: SeriesEvent | None = None
    unlisted: float = 0.0
    departures: tuple[int, ...] = ()

    @property
    def differs_from_start(self) -> bool:
        """Whether the engine, or what was recorded of it, differed from nominal before anything could change."""
        return 1 in self.departures and 2 * len(self.departures) > self.flights

    @property
    def verdict(self) -> str:
        """The result for the series as a whole; never "steady" where flights differ from nominal for certain."""
        if self.events:
            return CHANGED
        if self.differs_from_start:
            return FROM_THE_FIRST
        return CANNOT_TELL if self.undecided or self.departures or self.unlisted >= HALF else STEADY


@dataclass(frozen=True)
class SuspectGroups:
    """Groups of parameters (positions) that change together, the component of each, whether it is an instrument (G,),
    whether its own readings show it (G,), and its log prior odds (G,)."""

    described: tuple[Parameter, ...]
    groups: tuple[tuple[int, ...], ...]
    owner: tuple[str, ...]
    instrument: np.ndarray
    self_evident: np.ndarray
    log_odds: np.ndarray

    @property
    def components(self) -> tuple[str, ...]:
        """In the order of their parameters."""
        return tuple(dict.fromkeys(self.owner))

    def members(self, component: str) -> list[int]:
        """Positions of its groups, the one of all its parameters first."""
        return [k for k, owner in enumerate(self.owner) if owner == component]


def suspect_groups(
    described: Sequence[Parameter], prior: SetPrior, sensors: bool = True, governed: Collection[str] = ()
) -> SuspectGroups:
    """sensors: instruments may have changed, too; governed: errors of inputs that a governor may hold where they were
    read: its instrument steps either in its readings or, with the governor after it, in all others."""
    members: dict[str, list[int]] = {}
    for i, parameter in enumerate(described):
        if sensors or not parameter.belongs_to_instrument:
            members.setdefault(parameter.component, []).append(i)
    groups: list[tuple[int, ...]] = []
    owner, wrong, shown, log_odds = [], [], [], []
    for component, mine in members.items():
        instrument = all(described[i].belongs_to_instrument for i in mine)
        chance = prior.sensor if instrument else prior.inclusion
        each, whole = [(i,) for i in mine], [tuple(mine)]
        # an instrument is wrong in one of its forms, a component in all of its parameters or in one
        sets = each if instrument or len(mine) == 1 else [*whole, *each]
        for group in sets:
            share = 1 / len(sets) if sets is each else 0.5 if group == whole[0] else 0.5 / len(mine)
            groups.append(group)
            owner.append(component)
            wrong.append(instrument)
            shown.append(True)
            log_odds.append(np.log(chance / (1 - chance) * share))
            if any(described[i].name in governed for i in group):
                groups.append(group)
                owner.append(component)
                wrong.append(instrument)
                shown.append(False)
                log_odds[-1] -= np.log(2)
                log_odds.append(log_odds[-1])
    return SuspectGroups(
        tuple(described),
        tuple(groups),
        tuple(owner),
        np.array(wrong, bool),
        np.array(shown, bool),
        np.array(log_odds),
    )


def log_kind_prior(suspects: SuspectGroups, among: Courses) -> np.ndarray:
    """log P(kind | suspect) P(course | kind) (G, L): all courses of a kind alike."""
    found = np.full((len(suspects.groups), len(among.g)), -np.inf)
    for instrument, step in SERIES_PRIOR.p_step.items():
        for growing, chance in ((False, step), (True, 1 - step)):
            at = among.growing == growing
            if at.any():
                found[np.ix_(suspects.instrument == instrument, at)] = np.log(chance / at.sum())
    return found


FREEDOM = 30.0
"""Degrees of freedom ν of what readings wander by at once. Judgement: with tails that are much longer, no change in a
single jump could be separated from scatter; settled on shifted readings of the power plant."""
SIZE = 4.6
"""What the log probability of an event loses for each size that is fitted to it: a hundred times as wide beforehand as
afterwards."""
TINY = 1e-300
"""Keeps what a course does not touch from being divided by nothing."""


@dataclass(frozen=True)
class EventModel:
    """An event as the others are judged with it: positions of its group and of its course, and its size (q,) in prior
    standard deviations; shares: how much of each law of growth with its onset, where that is not its course alone."""

    group: int
    course: int
    size: tuple[float, ...] = ()
    shares: tuple[float, ...] = ()

    @property
    def key(self) -> tuple[int, int, bool]:
        """Group and course, and whether it grows by several laws."""
        return self.group, self.course, bool(self.shares)

    def course_values(self, courses: Courses) -> np.ndarray:
        """Its course (n,)."""
        if not self.shares:
            return np.asarray(courses.g[self.course])
        return np.asarray(np.array(self.shares) @ courses.laws(self.course))

    @property
    def parameter_count(self) -> int:
        """How many numbers are fitted to it."""
        return len(self.size) + max(len(self.shares) - 1, 0)


@dataclass(frozen=True)
class SizePosterior:
    """Given that a group changed with each course: log Bayes factor (L,), mean (L, q) and covariance (L, q, q)."""

    log: np.ndarray
    mean: np.ndarray
    covariance: np.ndarray


@dataclass(frozen=True)
class EventSearch:
    """One look at a series: tables of the laws of scatter, courses, suspects and their priors; log_kind (G, L);
    doubt (G,): share to which the effect of each group is known; tails: scatter has longer tails than the normal
    law."""

    tables: tuple[ScoreTable, ...]
    courses: Courses
    suspects: SuspectGroups
    slabs: tuple[float, ...]
    log_kind: np.ndarray
    doubt: np.ndarray
    tails: bool = False
    _cache: dict[tuple[Any, ...], Any] = field(default_factory=dict, repr=False, compare=False)

    def posterior(self, others: Sequence[EventModel]) -> tuple[np.ndarray, np.ndarray]:
        """log probability (h, G, L) of scatter, group and course beside other events, and (h,) of nothing more. Which
        law of scatter is likelier is judged without long tails, which one of them alone has."""
        log, nothing = self._posterior(others)
        if not self.tails:
            return log, nothing
        plain = replace(self, tails=False)._posterior(others)
        (with_tails, without) = (
            np.logaddexp(np.logaddexp.reduce(of_all, axis=(1, 2)), of_none)
            for of_all, of_none in ((log, nothing), plain)
        )
        return log + (without - with_tails)[:, None, None], nothing + without - with_tails

    def _posterior(self, others: Sequence[EventModel]) -> tuple[np.ndarray, np.ndarray]:
        found, nothing = [], []
        for t in self.tables:
            log = self._cached_table(t, others)[2]
            found.append(
                np.stack([self._cached_sizes(t, others, k).log for k in range(len(self.suspects.groups))]) + log
            )
            nothing.append(log)
        prior = self.suspects.log_odds[:, None] + self.log_kind
        done = {self.suspects.owner[e.group] for e in others}
        again = np.array([o in done for o in self.suspects.owner])
        total = np.stack(found) + prior
        total[:, again] = -np.inf  # what a component has done since its onset, of any law, is one event
        return total, np.array(nothing)

    def group_sizes(self, others: Sequence[EventModel], group: int) -> list[SizePosterior]:
        """Sizes of a group beside other events, for each scatter."""
        return [self._cached_sizes(t, others, group) for t in self.tables]

    def mix_growth_laws(self, t: ScoreTable, others: Sequence[EventModel], event: EventModel) -> EventModel | None:
        """A growing event with as much of each law with its onset as the series has by one scatter: wear that is slow
        at first and fast at last is none of them. None for a step."""
        if not self.courses.growing[event.course]:
            return None
        count = len(t.wander.inverse)
        own = np.arange(count) >= count - t.wander.inputs
        X = self._columns(t.effect, event, own)
        c = t.wander.c.copy()
        for other in others:
            c -= np.einsum("kij,kj->ki", t.wander.inverse, self._event_effect(t.effect, other, own))
        score, H = np.einsum("knr,kn->r", X, c), np.einsum("knr,knm,kms->rs", X, t.wander.inverse, X, optimize=True)
        at = np.all(self.courses.laws(event.course) == self.courses.g[event.course], axis=1).astype(float)
        shares = at + np.linalg.solve(np.eye(len(at)) + H, score - H @ at)
        return replace(event, shares=tuple(shares.tolist()))

    def _event_effect(self, effect: np.ndarray, event: EventModel, own: np.ndarray) -> np.ndarray:
        """What an event adds to each mode (k, n)."""
        found = effect[:, :, list(self.suspects.groups[event.group])] @ np.array(event.size)
        if not self.suspects.self_evident[event.group]:
            found[own] = 0.0
        return np.asarray(found * event.course_values(self.courses))

    def _cached_sizes(self, t: ScoreTable, others: Sequence[EventModel], group: int) -> SizePosterior:
        """Of one group beside other events, computed once."""
        key = (id(t), tuple(others), group, self.tails)
        if key not in self._cache:
            self._cache[key] = self.sizes(*self._cached_table(t, others)[:2], group, t)
        return cast(SizePosterior, self._cache[key])

    def _cached_table(self, t: ScoreTable, others: Sequence[EventModel]) -> tuple[np.ndarray, np.ndarray, float]:
        """Scores, information and log likelihood of a scatter with other events, whatever their size; once."""
        key = (id(t), tuple(others))
        if key not in self._cache:
            self._cache[key] = self._marginalise_events(t, others) if others else (t.b, t.S, t.wander.log)
        return cast(tuple[np.ndarray, np.ndarray, float], self._cache[key])

    def _marginalise_events(self, t: ScoreTable, others: Sequence[EventModel]) -> tuple[np.ndarray, np.ndarray, float]:
        first, second = t.pairs
        count = len(t.wander.inverse)
        own = np.arange(count) >= count - t.wander.inputs
        X = np.concatenate([self._columns(t.effect, event, own) for event in others], axis=2)
        KX = t.wander.inverse @ X
        H = np.eye(X.shape[2]) + np.swapaxes(X, 1, 2) @ KX
        score = np.einsum("knr,kn->kr", X, t.wander.c)
        solved = np.linalg.solve(H, score[:, :, None])[:, :, 0]
        log = t.wander.log + 0.5 * float(np.sum(score * solved)) - 0.5 * float(np.linalg.slogdet(H)[1].sum())
        root = np.linalg.inv(np.linalg.cholesky(H))
        b, S = t.b.copy(), t.S.copy()
        for k in np.flatnonzero(X.any(axis=(1, 2))):
            cross = course_sums(t.effect[k][:, :, None] * KX[k][:, None, :], self.courses)
            b[:, k] -= cross @ solved[k]
            white = cross @ root[k].T
            S[:, k] -= np.einsum("lpr,lpr->lp", white[:, first], white[:, second])
        return b, S, log

    def _columns(self, effect: np.ndarray, event: EventModel, own: np.ndarray) -> np.ndarray:
        """What an event may add to each mode (k, n, r), of every law that it may have; effect (k, n, p); own (k,): of
        an input."""
        group = list(self.suspects.groups[event.group])
        laws = self.courses.laws(event.course)
        found = (effect[:, :, group] @ np.array(event.size))[:, :, None] * laws.T
        if not self.suspects.self_evident[event.group]:
            found[own] = 0.0
        return np.asarray(found)

    def sizes(self, b: np.ndarray, S: np.ndarray, k: int, t: ScoreTable) -> SizePosterior:
        """Of one group with each course, by scores and information in the places of a table: two passes, the first of
        which finds how large its doubt is.

        Where readings wander the change is within one jump of theirs. With long tails that jump, in all modes together
        of χ² Q before, the largest of any course, and Q' after the change, is judged by Student's t,  ½(ν + m) ln((ν +
        Q)/(ν + Q')),  where the normal law has  ½(Q − Q').

        What an input read may speak against its instrument without bound. For it, it speaks no more than a true change
        of the same size at the same epoch would cost: weather and governor change it, too.
        """
        group, wander = np.array(self.suspects.groups[k]), t.wander
        own, at = b.shape[1] - wander.inputs, t.places[np.ix_(group, group)]
        read, reads = b[:, own:, group].sum(axis=1), S[:, own:, at].sum(axis=1)
        if not self.suspects.self_evident[k]:
            read, reads = np.zeros_like(read), np.zeros_like(reads)
        b, S = b[:, :own], S[:, :own]
        mine, info = b[:, :, group], S[:, :, at]
        doubt = self.doubt[k]
        slabs = group_slabs(self.suspects, k, self.slabs)
        first = _slab_average(mine.sum(axis=1) + read, info.sum(axis=1) + reads, slabs)[1]
        off = np.zeros(len(b))
        if doubt:
            told = np.einsum("lkpq,lq->lkp", info, first)
            square = np.maximum(np.einsum("lkp,lp->lk", told, first), 0.0)
            along_it = np.einsum("lkp,lp->lk", mine, first)
            factor = doubt**2 / (1 + doubt**2 * square)
            mine = mine - factor[..., None] * along_it[..., None] * told
            info = info - factor[..., None, None] * told[..., None] * told[..., None, :]
            off = 0.5 * np.sum(factor * along_it**2 - np.log1p(doubt**2 * square), axis=1)
        summed, told = mine.sum(axis=1), info.sum(axis=1)
        most = np.log(self.courses.g.shape[1]) + SIZE
        log, mean, covariance = _slab_average(summed + read, told + reads, slabs)
        log = log + off - np.maximum(_log_likelihood_gain(read, reads, mean) - most, 0.0)
        if self.tails and wander.slow:
            taken = np.maximum(2 * _log_likelihood_gain(summed, told, mean) + 2 * off, 0.0)
            # a course that leaves a jump to scatter pays for that jump as no event at all does
            alone = np.sum(b[:, :, -1] ** 2 / np.maximum(S[:, :, t.places[-1, -1]], TINY), axis=1)
            whole = float(np.max(np.maximum(alone, taken)))
            fallen = np.log1p(whole / FREEDOM) - np.log1p((whole - taken) / FREEDOM)
            log += np.minimum(0.5 * (FREEDOM + b.shape[1]) * fallen, 0.5 * taken) - 0.5 * taken
        log += self._signs(group, mean, covariance)
        return SizePosterior(log, mean, covariance)

    def _signs(self, group: np.ndarray, mean: np.ndarray, covariance: np.ndarray) -> np.ndarray:
        """log of how much likelier the sizes are when wear moves a value one way only, mostly, and none goes beyond
        what a component can do."""
        described = [self.suspects.described[i] for i in group]
        prior, wear = SetPrior(p_recovery=SERIES_PRIOR.p_recovery), np.array([p.wear for p in described])
        low, high = prior.bounds(described)
        spread = np.sqrt(np.einsum("lqq->lq", covariance))
        rises = SERIES_PRIOR.p_recovery
        up = 2 * np.where(wear > 0, 1 - rises, np.where(wear < 0, rises, 0.5))
        cut = ((low - mean) / spread, -mean / spread, (high - mean) / spread)
        return np.asarray(piecewise_normal_moments(*cut, 2 - up, up)[0][:, np.isfinite(high)].sum(axis=1))


def group_slabs(suspects: SuspectGroups, group: int, slabs: Sequence[float]) -> list[float]:
    """Sizes of a change of one group, in prior standard deviations, each as probable as the others."""
    found = [min(slab, SERIES_PRIOR.instrument_slab) for slab in slabs] if suspects.instrument[group] else [*slabs]
    return found + ([SERIES_PRIOR.failed_slab] if suspects.instrument[group] else [])


def _log_likelihood_gain(b: np.ndarray, S: np.ndarray, size: np.ndarray) -> np.ndarray:
    """By how much a change of this size (L, q) is likelier than none (L,)."""
    return np.einsum("lp,lp->l", b, size) - 0.5 * np.einsum("lp,lpq,lq->l", size, S, size)


def _slab_average(b: np.ndarray, S: np.ndarray, slabs: Sequence[float]) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """log Bayes factor (L,), mean (L, q) and covariance (L, q, q) of changes N(0, slab²), averaged over the slabs."""
    variance = np.square(slabs)[:, None, None, None]
    inner = np.eye(b.shape[1]) + variance * S
    covariances = variance * np.linalg.inv(inner)
    means = (covariances @ b[:, :, None])[..., 0]
    logs = 0.5 * np.sum(b * means, axis=2) - 0.5 * np.linalg.slogdet(inner)[1]
    log = np.logaddexp.reduce(logs, axis=0)
    w = np.exp(logs - log)
    mean = np.einsum("sl,slp->lp", w, means)
    spread = means - mean
    covariance = np.einsum("sl,slpq->lpq", w, covariances + spread[..., :, None] * spread[..., None, :])
    return log - np.log(len(slabs)), mean, covariance
