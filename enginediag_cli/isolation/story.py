"""What happened during a series: events, each with its suspects, its kind and its onset."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

CHANGED, STEADY, CANNOT_TELL = "changed", "steady", "cannot tell"
FROM_THE_FIRST = "differs from nominal from the first flight on"
HALF = 0.5
"""Probability from which something that is not listed is likelier than what is."""
CONVINCED = 0.9
"""Probability from which one suspect is named; below it the likeliest are told as a class."""
UNRECORDED = "unrecorded operation"
"""Member of an event that is no component: guide vanes, bleed or load that moved and that nobody recorded."""
CLASS = 0.95
"""Probability that the members of a class hold together."""


@dataclass(frozen=True)
class Member:
    """One suspect of an event: a component or instrument, the chance that it is the one that changed, and its
    parameters: chance of each to have changed, change since the onset with its standard deviation, in its unit, given
    that it changed; expected, covariance: of the changes of all of them, those of zero counted, given this suspect."""

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
class Event:
    """A change during the series. probability: that there is one at all, the other events given; members: suspects,
    likeliest first; kind: the likeliest; onset, low, high: number of the first changed flight (of a growing change: of
    the last unchanged), from 1, most probable and 95 % interval; weight: log odds that it happened."""

    probability: float
    members: tuple[Member, ...]
    kind: str
    onset: int
    low: int
    high: int
    weight: float = 0.0

    @property
    def named(self) -> tuple[Member, ...]:
        """The suspect that is named, or the class of those that the data cannot tell apart."""
        told: list[Member] = []
        for member in self.members:
            told.append(member)
            if sum(m.probability for m in told) >= (CONVINCED if len(told) == 1 else CLASS):
                break
        return tuple(told)


@dataclass(frozen=True)
class Fit:
    """χ² per degree of freedom of the readings by the scatter found, `before` any event and `after` those told."""

    before: float
    after: float


@dataclass(frozen=True)
class Story:
    """Events of one series of `flights` flights, surest first; inclusion: component → chance that it changed;
    converged: the search settled; fit: what is left unexplained; undecided: where nothing is told, a change that the
    series shows plainly if its readings scatter by themselves, and does not if they wander, when it is not settled that
    they do; unlisted: probability that what happened is something that is not listed, and then no event is told;
    departures: numbers, from 1, of flights that differ from nominal for certain."""

    events: tuple[Event, ...]
    flights: int
    inclusion: Mapping[str, float]
    converged: bool = True
    fit: Fit = Fit(1.0, 1.0)
    undecided: Event | None = None
    unlisted: float = 0.0
    departures: tuple[int, ...] = ()

    @property
    def from_the_first(self) -> bool:
        """Whether the engine, or what was recorded of it, differed from nominal before anything could change."""
        return 1 in self.departures and 2 * len(self.departures) > self.flights

    @property
    def verdict(self) -> str:
        """What is told of the series as a whole; never "steady" where flights differ from nominal for certain."""
        if self.events:
            return CHANGED
        if self.from_the_first:
            return FROM_THE_FIRST
        return CANNOT_TELL if self.undecided or self.departures or self.unlisted >= HALF else STEADY
