"""The judgement of one engine: since when, in what, and how far towards its limit."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from enginediag_cli.detection.trend_of_files import FEWEST, Series, Stretch
from enginediag_cli.fleet_judgement.finding import (
    CHANGED,
    HEALTHY,
    NO_VERDICT,
    EngineFinding,
    Estimate,
    FleetSettings,
    HealthRow,
)
from enginediag_cli.fleet_judgement.history import EngineHistory
from enginediag_cli.intervals import NORMAL_95
from enginediag_cli.isolation.over_time import TrendOptions, judge_series
from enginediag_cli.isolation.story import Story

EPOCHS = 40
"""Epochs of a series that are judged at once: work grows with their third power."""


def judged_engine(history: EngineHistory, series: Series, settings: FleetSettings) -> EngineFinding:
    """What the history of one engine says; `series`: what its parameters are, and its monitor. Raises DataError when
    its flights have statistics of different parameters."""
    flights, records = len(history.stretches), sum(x.window.records for x in history.stretches)
    if flights < FEWEST:
        reason = f"{flights} flights are too few, a trend needs {FEWEST}"
        return EngineFinding(history.serial, history.build, flights, records, NO_VERDICT, reason)
    mine = replace(series, stretches={history.serial: history.stretches})
    options = TrendOptions(
        healthy=history.baseline, sensors=settings.sensors, generic=settings.generic, governed=series.governed
    )
    story = judge_series(mine.readings(history.serial).joined(EPOCHS), series.known, options)
    verdict = CHANGED if story.events else NO_VERDICT if story.undecided else HEALTHY
    reason = "the readings may wander by themselves" if story.undecided else ""
    health = tuple(_rows(story, series, history.stretches))
    return EngineFinding(history.serial, history.build, flights, records, verdict, reason, health=health)


def _rows(story: Story, series: Series, stretches: Sequence[Stretch]) -> list[HealthRow]:
    rows = []
    for name, parameter in series.known.items():
        told = HealthRow(name, parameter.component, parameter.words, parameter.shown_unit, Estimate(0.0), "steady", 0.0)
        for event in story.events:
            for member in event.members:
                if name not in member.parameters:
                    continue
                q = member.parameters.index(name)
                chance = event.probability * member.probability * member.inclusion[q]
                if chance <= told.probability:
                    continue
                half = NORMAL_95 * member.deviation[q]
                change = Estimate(member.change[q], member.change[q] - half, member.change[q] + half)
                told = replace(
                    told,
                    change=change,
                    kind=event.kind,
                    probability=chance,
                    onset=event.onset,
                    onset_low=event.low,
                    onset_high=event.high,
                    onset_flight=stretches[event.onset - 1].window.flight,
                )
        rows.append(told)
    return rows
