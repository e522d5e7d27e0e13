"""The events of an engine that stands out, by the judgement that `trend` makes of a series."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from enginediag_cli.detection.trend_of_files import Series
from enginediag_cli.fleet_judgement.finding import Estimate, FleetSettings, HealthRow
from enginediag_cli.fleet_judgement.history import EngineHistory
from enginediag_cli.fleet_judgement.rows import Flights
from enginediag_cli.isolation.over_time import OF_A_FLEET, TrendOptions, judge_series
from enginediag_cli.isolation.story import Story


def isolated(flights: Flights, series: Series, settings: FleetSettings, history: EngineHistory) -> Story:
    """What changed, and when; steps at maintenance are conditions like the weather, so that what is told grew or came
    between events."""
    readings = flights.readings
    if flights.steps.shape[1]:
        centred = flights.steps - flights.steps.mean(axis=0)
        columns = centred / centred.std(axis=0)
        readings = replace(readings, weather=np.concatenate([readings.weather, columns], axis=1))
    options = TrendOptions(
        healthy=history.baseline, sensors=settings.sensors, generic=settings.generic, governed=series.governed
    )
    return judge_series(readings.joined(OF_A_FLEET), series.known, options)


def by_story(health: Sequence[HealthRow], story: Story, history: EngineHistory) -> tuple[HealthRow, ...]:
    """The rows with kind, onset and probability as isolated."""
    return tuple(_told(row, story, history) for row in health)


def chances(story: Story, parameters: Sequence[str]) -> dict[int, float]:
    """Of each parameter, by position, the probability that it changed in one of the events."""
    found: dict[int, float] = {}
    for event in story.events:
        for member in event.members:
            for name, inclusion in zip(member.parameters, member.inclusion, strict=True):
                i = parameters.index(name)
                found[i] = max(found.get(i, 0.0), event.probability * member.probability * inclusion)
    return found


def _told(row: HealthRow, story: Story, history: EngineHistory) -> HealthRow:
    told = replace(
        row,
        kind="steady",
        probability=story.inclusion.get(row.component, 0.0) if not story.events else 0.0,
        onset=0,
        onset_low=0,
        onset_high=0,
        onset_flight="",
        rate_per_flight=Estimate(),
    )
    for event in story.events:
        for member in event.members:
            if row.parameter not in member.parameters:
                continue
            chance = event.probability * member.probability * member.inclusion[member.parameters.index(row.parameter)]
            if chance > told.probability:
                told = replace(
                    told,
                    kind=event.kind,
                    probability=chance,
                    onset=event.onset,
                    onset_low=event.low,
                    onset_high=event.high,
                    onset_flight=history.stretches[event.onset - 1].window.flight,
                )
    if told.kind == "deterioration":
        span = max(story.flights - told.onset, 1)
        c = told.change
        told = replace(told, rate_per_flight=Estimate(c.value / span, c.low / span, c.high / span))
    return told
