"""The search for the events of a series: looks at it with events taken out, each by the scatter that these leave.

How large an event is depends on the scatter that it is judged by, and the scatter on what was taken out: by that of a
series which still holds an event any size passes for small, and by that which was read without one suspect's change
all others leave what it cannot be, whoever it was. So where no other event makes the series likelier each suspect that
was tried is looked at again by the scatter that its own event leaves, until that is settled, and suspects are compared
as they are then.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from enginediag_cli.detection.course import Courses, places, table
from enginediag_cli.detection.readings import Readings
from enginediag_cli.detection.wander import Scatter, Wander
from enginediag_cli.isolation.series_search import SIZE, Chosen, Search, slabs_of
from enginediag_cli.isolation.suspects import Suspects

LAWS = (False, True)
"""Laws of scatter, each as probable as the other: readings scatter by themselves, or wander."""
MAX_EVENTS = 4
"""Events told apart in one series at most: a stop, since each must be more probable than none."""
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
class Look:
    """Events, and the log probability of them and of the scatter that they leave."""

    chosen: tuple[Chosen, ...]
    log: float


@dataclass(frozen=True)
class Found:
    """An event beside `others`; gain: log odds that it is one, the scatter read again without it; instead: log odds of
    other suspects against its own, with the scatter that each of them leaves."""

    others: tuple[Chosen, ...]
    gain: float
    instead: Mapping[str, float]


@dataclass(frozen=True)
class Looks:
    """What is looked for in a series: suspects with the log priors of their kinds (G, L), courses, slabs of sizes,
    doubt (G,) about effects; at: places of pairs of parameters in tables."""

    readings: Readings
    suspects: Suspects
    among: Courses
    kinds: np.ndarray
    slabs: tuple[float, ...]
    doubt: np.ndarray
    at: np.ndarray
    _scatter: Scatter = field(init=False, repr=False, compare=False)
    _latest: dict[tuple[Chosen, ...], list[Wander]] = field(default_factory=dict, repr=False, compare=False)
    _looked: dict[tuple[Chosen, ...], Look] = field(default_factory=dict, repr=False, compare=False)
    _glanced: dict[tuple[tuple[int, int, bool], ...], Look] = field(default_factory=dict, repr=False, compare=False)

    def __post_init__(self) -> None:
        object.__setattr__(self, "_scatter", Scatter(self.readings))

    def likeliest(self) -> tuple[Look, Search, bool]:
        """The events that make the series likeliest, the posterior beside them, and whether the search settled."""
        best, settled = self.look(()), False
        for _ in range(PASSES):
            searched = self.search(best)
            proposed = list(_proposals(searched, best.chosen))
            trials = [self._glance(found) for found in proposed]
            better = max(trials, key=lambda trial: trial.log, default=best)
            if better.log <= best.log + SETTLED:
                rivals = self._by_suspect([best, *trials, *map(self.look, proposed)], best.log - REACH)
                better = max(map(self._by_its_own, rivals), key=lambda trial: trial.log, default=best)
            settled = better.log <= best.log + SETTLED
            if settled:
                break
            best = better
        return best, searched if settled else self.search(best), settled

    def found(self, best: Look) -> list[Found]:
        """Each event of `best` with what speaks against it."""
        found = []
        for k in range(len(best.chosen)):
            others = (*best.chosen[:k], *best.chosen[k + 1 :])
            found.append(Found(others, best.log - self.look(others).log, self._instead(best, k)))
        return found

    def look(self, chosen: Sequence[Chosen]) -> Look:
        """The series with these events taken out."""
        key = tuple(sorted(chosen, key=lambda event: event.place))
        if key not in self._looked:
            left = self.scatter(chosen)
            prior = sum(
                float(self.suspects.log_odds[e.group] + self.kinds[e.group, e.course]) - SIZE * e.fitted for e in chosen
            )
            log = float(np.logaddexp.reduce([wander.beside for wander in left])) + prior
            self._looked[key] = Look(tuple(chosen), log)
        return self._looked[key]

    def scatter(self, chosen: Sequence[Chosen]) -> list[Wander]:
        """The laws of the scatter that these events leave; those of a few looks are remembered."""
        key = tuple(chosen)
        if key not in self._latest:
            left = self._scatter.without(effect(self.readings, self.suspects, self.among, chosen), LAWS)
            size = sum(law.inverse.nbytes for law in left)
            while self._latest and (len(self._latest) + 1) * size > KEPT_BYTES:
                del self._latest[next(iter(self._latest))]
            self._latest[key] = left
        return self._latest[key]

    def search(self, at: Look) -> Search:
        """The posterior over one more event by the scatter of a look."""
        tables = tuple(table(self.readings, wander, self.among, self.at) for wander in self.scatter(at.chosen))
        return Search(tables, self.among, self.suspects, self.slabs, self.kinds, self.doubt)

    def _glance(self, chosen: Sequence[Chosen]) -> Look:
        """The first look at events of these suspects and courses, whatever their sizes were then: on the way sizes only
        have to be of the right order."""
        key = tuple(sorted(event.place for event in chosen))
        if key not in self._glanced:
            self._glanced[key] = self.look(chosen)
        return self._glanced[key]

    def _by_suspect(self, looks: Iterable[Look], least: float) -> list[Look]:
        """The likeliest of the looks by suspect of the last event and number of events, where it is above `least`."""
        found: dict[tuple[int, str], Look] = {}
        for look in looks:
            if look.chosen and look.log > least:
                key = len(look.chosen), self.suspects.owner[look.chosen[-1].group]
                found[key] = max(found.get(key, look), look, key=lambda trial: trial.log)
        return list(found.values())

    def _by_its_own(self, look: Look) -> Look:
        """The same suspects with the last event as it is by the scatter that it leaves, by the likelier law of it."""
        *others, event = look.chosen
        owner = self.suspects.owner[event.group]
        for _ in range(READ_AGAIN):
            law = max(self.scatter(look.chosen), key=lambda wander: wander.beside)
            trials = [self.look([*others, again]) for again in self._again(law, others, owner)]
            better = max(trials, key=lambda trial: trial.log)
            if better.log <= look.log + SETTLED:
                break
            look = better
        return look

    def _again(self, law: Wander, others: Sequence[Chosen], owner: str) -> Iterator[Chosen]:
        """The likeliest event of one suspect by one law of scatter, of one law of growth and of several."""
        mine = self.suspects.members(owner)
        members = {i for k in mine for i in self.suspects.groups[k]}
        inside = np.array([i in members for i in range(len(self.at) - 1)])
        t = table(self.readings, law, self.among, places((self.at[:-1, :-1] >= 0) & inside & inside[:, None]))
        search = Search((t,), self.among, self.suspects, self.slabs, self.kinds, self.doubt)
        log = np.stack([search.told(others, k)[0].log for k in mine])
        log += self.suspects.log_odds[mine, None] + self.kinds[mine]
        place, course = (int(i) for i in np.unravel_index(int(np.argmax(log)), log.shape))
        found = Chosen(mine[place], course, tuple(search.told(others, mine[place])[0].mean[course].tolist()))
        yield found
        if grown := search.grown(t, others, found):
            yield grown

    def _instead(self, best: Look, k: int) -> dict[str, float]:
        """log odds of the suspects that were tried in the place of the k-th event of `best`, the others as they are,
        each by the scatter that its own event leaves and by how large that is."""
        owner = self.suspects.owner
        rest = Counter(event.place for event in best.chosen) - Counter([best.chosen[k].place])
        own = best.log + self._log_of_size(best.chosen[k])
        found: dict[str, float] = {}
        for look in self._looked.values():
            other = Counter(event.place for event in look.chosen) - rest
            if len(look.chosen) == len(best.chosen) and other.total() == 1:
                event = next(event for event in look.chosen if event.place in other)
                name, log = owner[event.group], look.log + self._log_of_size(event) - own
                if name != owner[best.chosen[k].group]:
                    found[name] = max(found.get(name, -np.inf), log)
        return found

    def _log_of_size(self, event: Chosen) -> float:
        """log prior of a change of this size, relative to a small one: the mixture of slabs."""
        slabs = np.array(slabs_of(self.suspects, event.group, self.slabs))
        density = -len(event.size) * np.log(slabs)
        square = float(np.sum(np.square(event.size)))
        return float(np.logaddexp.reduce(density - 0.5 * square / slabs**2) - np.logaddexp.reduce(density))


def effect(readings: Readings, suspects: Suspects, among: Courses, chosen: Sequence[Chosen]) -> np.ndarray:
    """What the events add to the readings (n, m)."""
    known = np.zeros_like(readings.z)
    for event in chosen:
        group = list(suspects.groups[event.group])
        effect = readings.J[:, :, group] @ np.array(event.size)
        if not suspects.shown[event.group]:
            effect[:, effect.shape[1] - readings.inputs :] = 0.0
        known += event.along(among)[:, None] * effect
    return known


def _proposals(search: Search, chosen: Sequence[Chosen]) -> Iterator[list[Chosen]]:
    """What may be likelier: one event more, by each law of scatter alone, or another one for any; one less."""
    for k in range(len(chosen) + 1):
        others = [*chosen[:k], *chosen[k + 1 :]]
        if k < len(chosen):
            yield others
        elif len(others) >= MAX_EVENTS:
            continue
        for t in search.tables:
            for found in _best(replace(search, tables=(t,)), others, 1 if others else OWNERS):
                yield [*others, found]
                if grown := search.grown(t, others, found):
                    yield [*others, grown]


def _best(search: Search, others: Sequence[Chosen], most: int) -> list[Chosen]:
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
        size = search.told(others, group)[law].mean[course]
        found.append(Chosen(group, int(course), tuple(size.tolist())))
    return found
