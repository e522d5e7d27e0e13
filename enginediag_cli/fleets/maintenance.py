"""What maintenance restored: the step of the path of health at it, by the one account of the engine's history.

Wear of the flights on either side, errors of instruments and what is uncertain about nominal are in that account, so
that they are no part of the step.

`maintenance_effects` estimates the events of one series; `assess_margins` the margin of engines whose flights are a
series, by the judgement of a fleet.
"""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from scipy.special import ndtr

from enginediag_cli.config.fields import near
from enginediag_cli.detection.series import FlightWindow, Series
from enginediag_cli.errors import DataError
from enginediag_cli.fleets.engine_judgement import changes_at_events, judge_with_account
from enginediag_cli.fleets.findings import EngineFinding, EngineHistory, FleetSettings, HealthChange, MaintenanceEvent
from enginediag_cli.fleets.margin import (
    NO_LIMIT,
    PASSED,
    MarginScale,
    PowerCourse,
    add_forecasts,
    available_power,
    learn_removal_limit,
    margin_scale,
)
from enginediag_cli.fleets.work_scope import ChangeMoments, Gain, PowerReference, WorkScopeEstimator
from enginediag_cli.history.engines import EngineTrend, HistoryWindows
from enginediag_cli.history.posterior import HealthStep
from enginediag_cli.parameters import Parameter
from enginediag_cli.probability import NORMAL_95
from enginediag_cli.residuals.monitor import Monitor


@dataclass(frozen=True)
class MaintenanceEffect:
    """The effect of maintenance before one flight.

    Attributes
    ----------
    flight : int
        Number of the first flight after it, from 1.
    flights_before, flights_after : int
        Flights between the maintenance before and this, and between this and the next.
    names : tuple of str
        Parameters that changed: the 95 % interval of the change excludes zero.
    probability : float
        That the least certain of them changed that way; without any, that of the most certain one.
    change, deviation : tuple of float
        Mean changes of these and standard deviations, in the parameters' units.
    gain : Gain or None
        Fall of temperature and fuel flow at equal power.
    reason : str
        Why there is no gain.
    """

    flight: int
    flights_before: int
    flights_after: int
    names: tuple[str, ...]
    probability: float
    change: tuple[float, ...]
    deviation: tuple[float, ...]
    gain: Gain | None
    reason: str = ""


def maintenance_effects(
    scoping: WorkScopeEstimator, story: EngineTrend, series: Series, engine: str, events: Sequence[str]
) -> Iterator[MaintenanceEffect]:
    """Estimate what maintenance restored on one engine.

    Parameters
    ----------
    scoping : WorkScopeEstimator
        Of the monitored engine.
    story : EngineTrend
        The account of its history, with the path of health and these flights as maintenance.
    series : Series
        Flights of engines.
    engine : str
        Name of the engine in the series.
    events : sequence of str
        First flights after maintenance: labels, or numbers from 1.

    Yields
    ------
    MaintenanceEffect
        One per event.

    Raises
    ------
    DataError
        For a flight that does not exist, or that is the first.
    """
    flights = sorted(set(maintenance_flights(series, engine, events)))
    if not flights:
        return
    if flights[0] == 1:
        raise DataError("--event: no flight lies before the maintenance at flight 1")
    health, recorded = story.posterior.health, mean_conditions(series.stretches[engine])
    ends = [1, *flights, story.flights + 1]
    for k, flight in enumerate(flights, start=1):
        epoch = int(np.searchsorted(story.first, flight - 1))
        step = next((x for x in health.steps if x.epoch == epoch), None) if health is not None else None
        around = (flight, flight - ends[k - 1], ends[k + 1] - flight)
        if step is None or health is None:
            yield MaintenanceEffect(*around, (), 0.0, (), (), None, "no flight is apart from those on its other side")
            continue
        described = [series.parameters[name] for name in health.parameters]
        yield _step_effect(scoping, described, step.select(range(len(described))), around, recorded)


def _step_effect(
    scoping: WorkScopeEstimator,
    described: Sequence[Parameter],
    step: HealthStep,
    around: tuple[int, int, int],
    recorded: Mapping[str, float],
) -> MaintenanceEffect:
    deviation = np.sqrt(np.maximum(np.diag(step.covariance), 0.0))
    size = np.abs(step.change) / np.maximum(deviation, LEAST_DEVIATION)
    named = np.flatnonzero(size > NORMAL_95).tolist()
    least = size[named].min() if len(named) else size.max(initial=0.0)
    touched = {described[i].component for i in named}  # what is not seen to have changed gains nothing
    own = step.select([i for i, p in enumerate(described) if not touched or p.component in touched])
    parameters = tuple(p.name for p in described if not touched or p.component in touched)
    gain, reason = scoping.maintenance_gain(own.before, ChangeMoments(parameters, own.change, own.covariance), recorded)
    return MaintenanceEffect(
        *around,
        tuple(described[i].name for i in named),
        float(2.0 * ndtr(least) - 1.0),
        tuple(step.change[named].tolist()),
        tuple(deviation[named].tolist()),
        gain,
        reason,
    )


LEAST_DEVIATION = 1e-12
"""Keeps a change that is known exactly from a division by zero."""


def maintenance_flights(series: Series, engine: str, events: Sequence[str]) -> list[int]:
    """Numbers, from 1, of the first flights after maintenance; `events`: labels or numbers. DataError for a flight that
    is not there."""
    return [_flight_number(series.stretches[engine], event, engine) for event in events]


def mean_conditions(stretches: Sequence[FlightWindow]) -> Mapping[str, float]:
    """Mean of each input over the stretches that have it."""
    columns = {c for x in stretches for c in x.window.conditions}
    return {c: float(np.mean([x.window.conditions[c] for x in stretches if c in x.window.conditions])) for c in columns}


def _flight_number(stretches: Sequence[FlightWindow], event: str, engine: str) -> int:
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


def events_by_engine(
    events: Sequence[MaintenanceEvent], engines: Collection[str], path: str
) -> tuple[dict[str, tuple[MaintenanceEvent, ...]], tuple[str, ...]]:
    """Events of a file by the `engines` that are recorded, and the names in it of which nothing is. One engine needs no
    name, in recordings or in events. Raises DataError where it is not known whose events are, or nobody's are here."""
    names = tuple(dict.fromkeys(e.engine for e in events if e.engine))
    told = ", ".join(names)
    if len(names) > 1 and "" in engines:
        raise DataError(f"{path}: events of several engines ({told}), and the recordings name none: keep those of one")
    if len(engines) > 1 and any(not e.engine for e in events):
        raise DataError(f"{path}: an event names no engine, and the recordings are of {len(engines)}")
    if set(engines) == {""}:
        return {"": tuple(events)}, ()
    unknown = tuple(name for name in names if name not in engines)
    if unknown and len(unknown) == len(names) and all(e.engine for e in events):
        raise DataError(f"{path}: no recording is of engine {told}; {near(unknown[0], engines)}")
    mine = {engine: tuple(e for e in events if e.engine in ("", engine)) for engine in engines}
    return mine, unknown


@dataclass(frozen=True)
class MarginSettings:
    """How the margin of engines is assessed.

    Attributes
    ----------
    limits_K : mapping of str to float
        Temperature column → its limit at the reference condition, K.
    consumed_limit_K : tuple of float or None
        Margin used at which an engine is removed from wing, with its standard deviation, K; where no limit of a
        temperature is known.
    taken_off : sequence of str
        Engines whose recordings end with their removal, from which that limit is estimated.
    events, events_file : sequence of MaintenanceEvent, str
        Maintenance, and the name of its file.
    baseline : int
        First flights of each engine, believed healthy; 0: those within its first `healthy` records.
    healthy : int
        First records, believed healthy.
    sensors : bool
        Whether instruments are suspects.
    limits : mapping of str to float
        Column of a speed, torque or power → its limit, in the column's unit.
    at : mapping of str to float
        Inputs of the condition of margin and available power that are stated.
    """

    limits_K: Mapping[str, float] = field(default_factory=dict)
    consumed_limit_K: tuple[float, float] | None = None
    taken_off: Sequence[str] = ()
    events: Sequence[MaintenanceEvent] = ()
    events_file: str = ""
    baseline: int = 0
    healthy: int = 0
    sensors: bool = True
    limits: Mapping[str, float] = field(default_factory=dict)
    at: Mapping[str, float] = field(default_factory=dict)


@dataclass(frozen=True)
class EventEffect:
    """What an event of maintenance did: changes of the parameters `names` with their standard `deviation`, and by how
    much temperature and fuel fell at equal power, None with the `reason`."""

    names: tuple[str, ...] = ()
    change: tuple[float, ...] = ()
    deviation: tuple[float, ...] = ()
    gain: Gain | None = None
    reason: str = ""


@dataclass(frozen=True)
class EngineMargin:
    """An engine with its margin, forecast and maintenance; effects: of each event of the finding, in its order, at
    `reference`; unknown_flights: flights of events that are not recorded, and what may be meant; power: what it
    delivers at its limits, in its last flights as many as it has values."""

    finding: EngineFinding
    effects: Sequence[EventEffect]
    reference: PowerReference | None
    unknown_flights: Mapping[str, str]
    power: PowerCourse = field(default_factory=PowerCourse)


@dataclass(frozen=True)
class SeriesMargins:
    """Margins of the engines of a series.

    Attributes
    ----------
    engines : mapping of str to EngineMargin
        Engine → its margin.
    series : Series
        Their flights.
    unknown_engines : sequence of str
        Engines that events name, and no recording.
    learnt_K : tuple of float or None
        Margin that engines had used when they were removed from wing, with its standard deviation, K, where it can be
        estimated.
    """

    engines: Mapping[str, EngineMargin]
    series: Series
    unknown_engines: Sequence[str]
    learnt_K: tuple[float, float] | None = None


def assess_margins(
    windows: HistoryWindows, series: Series, monitor: Monitor, question: MarginSettings
) -> SeriesMargins:
    """Assess the margin of each engine of some files, and the effect of its maintenance.

    Parameters
    ----------
    windows : HistoryWindows
        Windows of a series that were read.
    series : Series
        That series, with the covariance of its statistics.
    monitor : Monitor
        Gives the effect of a change on the temperature.
    question : MarginSettings
        Limits and maintenance.

    Returns
    -------
    SeriesMargins

    Raises
    ------
    DataError
        For a limit of a column that is no temperature of burnt gas, for events of engines without recording, for
        engines removed from wing that do not determine a limit, and when flights of an engine have statistics of
        different parameters.
    """
    series = replace(series, monitor=monitor)
    events, others = events_by_engine(question.events, series.stretches, question.events_file)
    settings = FleetSettings(
        sensors=question.sensors,
        limits_K=question.limits_K,
        consumed_limit_K=question.consumed_limit_K,
    )
    scale = _choose_scale(series, settings, question.at)
    histories = []
    for engine, stretches in series.stretches.items():
        baseline = question.baseline or series.healthy(engine, question.healthy)
        sums = windows.engines[engine]
        histories.append(EngineHistory(engine, "", stretches, sums, baseline, events.get(engine, ())))
    judged = [judge_with_account(history, series, settings, scale) for history in histories]
    findings = [_copy_reason(finding) for finding, _ in judged]
    settings = learn_removal_limit(settings, findings, question.taken_off, "--taken-off")
    findings = add_forecasts(findings, settings)
    learnt = settings.consumed_limit_K if question.taken_off else None
    scoping = WorkScopeEstimator(monitor)
    limits = {**question.limits_K, **question.limits}
    found = {}
    for finding, history, (_, account) in zip(findings, histories, judged, strict=True):
        power = PowerCourse(reason=finding.margin.reason or finding.reason)
        if account is not None and finding.margin.reason in ("", NO_LIMIT, PASSED):
            power = available_power(account, scoping, scale, limits)
        one = _engine_margin(finding, history, series, (scoping, settings))
        found[finding.serial] = replace(one, power=power)
    return SeriesMargins(found, series, others, learnt)


def _choose_scale(series: Series, settings: FleetSettings, at: Mapping[str, float]) -> MarginScale:
    """Of the hottest temperature, or of the hottest that has a limit."""
    assert series.monitor is not None
    limits, scale = settings.limits_K, margin_scale(series, at=at)
    for column in limits:
        if column not in series.monitor.sensors:
            known = [scale.column] if scale.column else []
            raise DataError(f"--limit: the engine has no sensor {column!r}; {near(column, known)}")
    if not limits or not scale.column or scale.column in limits:
        return scale
    own = margin_scale(series, limits, at)
    if not own.column:
        told = ", ".join(limits)
        raise DataError(f"--limit: {told} is no temperature of burnt gas; the hottest that is recorded: {scale.column}")
    return own


def _engine_margin(
    finding: EngineFinding, history: EngineHistory, series: Series, means: tuple[WorkScopeEstimator, FleetSettings]
) -> EngineMargin:
    scoping, settings = means
    recorded = mean_conditions(history.stretches)
    moved = list(finding.event_changes)
    if any(change is None for change in moved):
        across = changes_at_events(history, series, settings)
        moved = [mine or other for mine, other in zip(moved, across, strict=True)]
    told = [EventEffect() if change is None else _event_effect(change, scoping, recorded) for change in moved]
    return EngineMargin(finding, told, scoping.reference(recorded), _unknown_flights(history))


def _event_effect(moved: HealthChange, scoping: WorkScopeEstimator, recorded: Mapping[str, float]) -> EventEffect:
    """At equal power, by the path of health: what flights on either side wore is no part of it."""
    deviation = np.sqrt(np.diag(moved.covariance))
    change = ChangeMoments(moved.names, moved.mean, moved.covariance)
    gain, reason = scoping.maintenance_gain(moved.initial, change, recorded)
    return EventEffect(moved.names, tuple(moved.mean.tolist()), tuple(deviation.tolist()), gain, reason)


def _copy_reason(finding: EngineFinding) -> EngineFinding:
    """An engine that could not be followed has no margin for the same reason."""
    if finding.by_flight or finding.margin.reason:
        return finding
    return replace(finding, margin=replace(finding.margin, reason=finding.reason))


def _unknown_flights(history: EngineHistory) -> dict[str, str]:
    """Flights that events name and nobody recorded, each with a hint."""
    last = len(history.stretches)
    labels = [label for x in history.stretches if (label := x.window.flight)]
    found = {}
    for event in history.events:
        numbered = not labels and event.flight.isdigit() and int(event.flight) <= last
        if event.flight and event.flight not in labels and not numbered:
            found[event.flight] = near(event.flight, labels) if labels else f"its flights are numbered 1 to {last}"
    return found
