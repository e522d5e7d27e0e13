"""Health over the flights of files: windows of a flight are added up, flights of an engine follow each other."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from enginediag_cli.detection.trend import TrendFit, fit_trends
from enginediag_cli.errors import DataError
from enginediag_cli.parameters import Parameter
from enginediag_cli.residuals.files import JudgedFiles
from enginediag_cli.residuals.statistics import LocalStatistics

FlightKey = tuple[str, str, str]
"""Engine, file, flight."""

FEWEST = 3
"""Flights that a trend needs: a level before, one after, and one to tell noise from either."""


@dataclass(frozen=True)
class FlightSums:
    """Statistics of each flight in order, what the parameters are, and `lost`: windows that had no statistics."""

    flights: Mapping[FlightKey, LocalStatistics]
    known: Mapping[str, Parameter]
    lost: int

    @property
    def engines(self) -> tuple[str, ...]:
        return tuple(dict.fromkeys(key[0] for key in self.flights))

    def of(self, engine: str) -> list[LocalStatistics]:
        return [statistics for key, statistics in self.flights.items() if key[0] == engine]


@dataclass(frozen=True)
class EngineTrend:
    """Trends of one engine over so many flights; `fit` is None where they are too few."""

    engine: str
    flights: int
    fit: TrendFit | None


def flight_sums(files: JudgedFiles) -> FlightSums:
    """Raises DataError when windows of a flight have different parameters."""
    flights: dict[FlightKey, LocalStatistics] = {}
    known: dict[str, Parameter] = {}
    lost = 0
    for window, its_own in files.windows():
        if window.statistics is None:
            lost += 1
            continue
        known.update(its_own)
        key = (window.engine, window.source, window.flight)
        try:
            flights[key] = flights[key] + window.statistics if key in flights else window.statistics
        except ValueError as error:
            raise DataError(f"{window.source}: flight {window.flight}: {error}") from None
    return FlightSums(flights, known, lost)


def engine_trends(sums: FlightSums) -> list[EngineTrend]:
    """One per engine. Raises DataError when its flights have statistics of different parameters."""
    found = []
    for engine in sums.engines:
        mine = sums.of(engine)
        if len(mine) >= FEWEST and any(x.parameters != mine[0].parameters for x in mine):
            name = f"engine {engine}: " if engine else ""
            raise DataError(f"{name}flights with statistics of different parameters have no common trend")
        found.append(EngineTrend(engine, len(mine), fit_trends(mine) if len(mine) >= FEWEST else None))
    return found
