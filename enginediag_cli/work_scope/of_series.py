"""Maintenance in the series of an engine: which flight it comes before, and what it did bring."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence

import numpy as np

from enginediag_cli.config.hints import near
from enginediag_cli.detection.trend_of_files import Series, Stretch
from enginediag_cli.errors import DataError
from enginediag_cli.isolation.flips.errors import SPREAD, stated_errors
from enginediag_cli.work_scope.maintenance import Maintenance, maintenance
from enginediag_cli.work_scope.scope import Scoping


def maintenance_of(scoping: Scoping, series: Series, engine: str, events: Sequence[str]) -> Iterator[Maintenance]:
    """What the maintenance before each of the flights `events`, labels or numbers from 1, did bring to an engine.

    DataError for a flight that is not there, or that is the first.
    """
    stretches = series.stretches[engine]
    flights = [_number(stretches, event, engine) for event in events]
    monitor, conditions = series.monitor, conditions_of(stretches)
    spread = {}
    if monitor is not None and flights:
        readings = {**conditions, **stretches[0].window.readings}
        stated = stated_errors(monitor, readings, {})
        spread = {name: s.sigma for name, s in stated.items() if s.origin == SPREAD}
    statistics = [x.statistics for x in stretches]
    for flight in sorted(set(flights)):
        try:
            yield maintenance(scoping, statistics, flight, flights, spread, conditions)
        except ValueError as error:
            raise DataError(f"--event: {error}") from None


def conditions_of(stretches: Sequence[Stretch]) -> Mapping[str, float]:
    """Mean of each input over the stretches that have it."""
    columns = {c for x in stretches for c in x.window.conditions}
    return {c: float(np.mean([x.window.conditions[c] for x in stretches if c in x.window.conditions])) for c in columns}


def _number(stretches: Sequence[Stretch], event: str, engine: str) -> int:
    """Number, from 1, of the flight that has this label, alone or behind its file, or else this number."""
    labels = [x.window.flight for x in stretches]
    full = [f"{x.window.source}:{x.window.flight}" for x in stretches]
    if event in full:
        return full.index(event) + 1
    if labels.count(event) > 1:
        one, other = [name for name, label in zip(full, labels, strict=True) if label == event][:2]
        raise DataError(f"--event: several flights are called {event!r}; say {one!r} or {other!r}")
    if event in labels:
        return labels.index(event) + 1
    if event.isdigit() and 1 <= int(event) <= len(stretches) and not any(labels):
        return int(event)
    whose = f"engine {engine} " if engine else "the series "
    hint = f"; {near(event, labels)}" if any(labels) else f": its stretches are 1 to {len(stretches)}"
    raise DataError(f"--event: {whose}has no flight {event!r}{hint}")
