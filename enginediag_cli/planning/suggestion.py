"""A recording that was judged, and the best of each kind."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass

import numpy as np

from enginediag_cli.planning.flight import RECORDS, PlannedFlight
from enginediag_cli.planning.separation import Outlook

SAME, SWITCH, SENSOR = "same", "switch", "sensor"
"""Of recordings that are no planned flight: more like those there are, the same with an effect switched off and on by
turns, the same with a further sensor."""
BEYOND = 0.2
"""Share of a flight outside of what was flown from which it is told to go beyond that."""


@dataclass(frozen=True)
class Suggestion:
    """One recording judged. `what`: the flight in words, the effect that is switched, or the column of the sensor;
    `chance`: that the right rival stands out after RECORDS records; `records`: the fewest that are enough, inf where
    none are; `known`: whether it keeps to conditions that were flown."""

    kind: str
    what: str
    chance: float
    records: float
    flight: PlannedFlight | None = None
    known: bool = True

    @classmethod
    def judged(
        cls, outlook: Outlook, kind: str, what: str = "", flight: PlannedFlight | None = None, known: bool = True
    ) -> Suggestion:
        return cls(kind, what, outlook.chance(RECORDS), outlook.records, flight, known)


def best_first(found: Iterable[Suggestion]) -> list[Suggestion]:
    """Soonest enough first; of those that RECORDS records are not enough of, likeliest after so many."""
    return sorted(found, key=lambda s: (min(s.records, RECORDS + 1.0), -s.chance, s.records))


def best_of_each_kind(found: Iterable[Suggestion]) -> list[Suggestion]:
    """The first of every kind of suggestions in their order."""
    best: dict[str, Suggestion] = {}
    for s in found:
        best.setdefault(s.kind, s)
    return list(best.values())


def keeps_to(flown: Mapping[str, np.ndarray], inputs: Mapping[str, np.ndarray]) -> bool:
    """Whether most of a flight lies within the ranges of what was flown, columns → (N,) each."""
    outside = np.zeros(len(next(iter(inputs.values()))), bool)
    for c, values in inputs.items():
        was = np.asarray(flown.get(c, values), float)
        outside |= (values < np.nanmin(was)) | (values > np.nanmax(was))
    return bool(outside.mean() <= BEYOND)
