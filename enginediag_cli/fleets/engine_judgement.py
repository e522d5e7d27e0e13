"""The judgement of one engine: whether it has changed, since when, in what, and how far towards its limit.

What changed is what the account of its history says, the one that `trend` shows (`history.engines`), the engine's first
flights being its reference:

    an event that came while it flew     changed; its suspect is named, or those that are indistinguishable
    nothing that is listed               changed; cannot tell what
    off nominal from the first flight    no verdict: there is no healthy state to compare with
    single flights that differ           no verdict
    too few flights to show a change     no verdict
    otherwise                            healthy
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

from enginediag_cli.detection.series import FEWEST, Series
from enginediag_cli.fleets.findings import (
    CHANGED,
    HEALTHY,
    NO_VERDICT,
    EngineFinding,
    EngineFlights,
    EngineHistory,
    EventRow,
    FinalReadings,
    FleetSettings,
    FlightRow,
    HealthChange,
    HealthRow,
    IntervalEstimate,
    MaintenanceEvent,
    engine_flights,
    event_number,
    movable_parameters,
    washable_components,
)
from enginediag_cli.fleets.margin import (
    CANNOT_TELL_WHAT,
    EngineConsumption,
    MarginScale,
    engine_consumption,
    engine_severity,
    interval_estimate,
    margin_scale,
)
from enginediag_cli.history.engines import (
    COMES_AND_GOES,
    DETERIORATION,
    STEADY,
    EngineTrend,
    HistoryOptions,
    judge_engine_history,
)
from enginediag_cli.history.hypotheses import FROM_START, INTERMITTENT
from enginediag_cli.history.posterior import EVENT, ChangeEvent, HealthStep, HistoryChange
from enginediag_cli.parameters import Parameter

LAST = 10
"""Flights at the end that say what an engine has come to, for what a fleet has in common."""


@dataclass(frozen=True)
class _JudgedFlights:
    """What is known of an engine when its rows are made; parameters: of the account, in its order; moved: of each event
    of the flights, what it may have moved."""

    trend: EngineTrend
    parameters: tuple[Parameter, ...]
    flights: EngineFlights
    moved: tuple[frozenset[str], ...]


def judge_engine(
    history: EngineHistory, series: Series, settings: FleetSettings, scale: MarginScale | None = None
) -> EngineFinding:
    """The finding alone of `judge_with_account`."""
    return judge_with_account(history, series, settings, scale)[0]


def judge_with_account(
    history: EngineHistory, series: Series, settings: FleetSettings, scale: MarginScale | None = None
) -> tuple[EngineFinding, EngineTrend | None]:
    """Judge the history of one engine: whether it has changed, since when, in what, and how far towards its limit.

    Parameters
    ----------
    history : EngineHistory
        Flights of the engine, its baseline, and its maintenance.
    series : Series
        Meaning of its parameters, and its monitor.
    settings : FleetSettings
        What may have changed, and the limits.
    scale : MarginScale, optional
        What a change of health means for the margin; `margin_scale` computes it once for all engines of a series.

    Returns
    -------
    EngineFinding
    EngineTrend or None
        The account of its history since it was renewed last, where it has flights enough.

    Raises
    ------
    DataError
        When its flights have statistics of different parameters.
    """
    records = sum(x.window.records for x in history.stretches)
    nothing = EngineFinding(
        history.serial, history.build, len(history.stretches), records, NO_VERDICT, "", baseline=history.baseline
    )
    current, earlier = _history_since_renewal(history)
    if (after := len(current.stretches) - current.baseline) < FEWEST:
        new = " since the engine was renewed" if earlier else ""
        beside = " beside the baseline" if current.baseline else ""
        reason = f"too few flights{new}{beside}: {max(after, 0)}, and {FEWEST} are needed"
        return replace(nothing, reason=reason), None
    flights = engine_flights(current, series)
    if len(flights) - flights.baseline < FEWEST:
        return replace(nothing, reason="too few flights determine all readings"), None
    found = _judge_flights(flights, current, series, settings)
    verdict, reason = _verdict(found.trend)
    unknown = _unknown_health(found)
    scale = margin_scale(series) if scale is None else scale
    used = engine_consumption(found.trend, scale, settings.limits_K, current.baseline)
    if unknown:
        used = used.withhold(unknown)
    began = min(found.trend.changes, key=lambda event: event.onset, default=None)
    since = (0, 0, 0) if began is None else found.trend.onset_numbers(began)
    best, low, high = since
    finding = replace(
        nothing,
        verdict=verdict,
        reason="; ".join(dict.fromkeys(filter(None, [reason, unknown]))),
        unlisted=found.trend.posterior.unlisted,
        probability=found.trend.probability,
        prior=found.trend.posterior.prior,
        since=best + earlier if best else 0,
        since_low=low + earlier if best else 0,
        since_high=high + earlier if best else 0,
        since_flight=current.stretches[best - 1].window.flight if best else "",
        severity=IntervalEstimate() if unknown else engine_severity(found.trend, used, found.parameters),
        severity_unit="K" if used.margin.column else "sigma",
        health=tuple(_health_rows(found, current, earlier)),
        by_flight=_flight_rows(found, used, current, earlier, (verdict, best)),
        events=_event_rows(found, used, (history, current), earlier),
        margin=used.margin,
        course=used.course,
        state=_final_readings(flights),
        event_changes=_event_changes(found, current, history),
    )
    return finding, found.trend


def _judge_flights(
    flights: EngineFlights, current: EngineHistory, series: Series, settings: FleetSettings
) -> _JudgedFlights:
    """The account of the history, in which maintenance is a known move of what it may have moved."""
    compressors = washable_components(series)
    moved = [movable_parameters(e, flights.described, compressors) for e in flights.events]
    numbers = [event_number(e, current) + 1 for e in flights.events]
    shifts = [
        (number, {flights.described[i].name: size for i, size in own.items()})
        for number, own in zip(numbers, moved, strict=True)
    ]
    options = HistoryOptions(current.baseline, settings.sensors, numbers, shifts, health=True)
    trend = judge_engine_history(current.sums, series.parameters, options)
    parameters = tuple(series.parameters[name] for name in trend.posterior.parameters)
    return _JudgedFlights(trend, parameters, flights, tuple(frozenset(own) for _, own in shifts))


def _verdict(trend: EngineTrend) -> tuple[str, str]:
    """The verdict, and what has to be said with it."""
    if trend.changes:
        words = [_ambiguity_words(event) for event in trend.changes if len(event.group) > 1]
        return CHANGED, "; ".join(filter(None, [*words, trend.reason]))
    if trend.differs_from_start:
        names = ", ".join(event.group[0] for event in trend.events)
        what = f" ({names})" if names else ""
        return NO_VERDICT, f"differs from nominal from its first flight on{what}: no healthy state to compare with"
    if trend.posterior.changed:
        return CHANGED, trend.reason
    return (NO_VERDICT if trend.undecided else HEALTHY), trend.reason


def _ambiguity_words(event: ChangeEvent) -> str:
    """Suspects that are indistinguishable."""
    each = [f"{name} ({event.probability * event.suspects[name]:.2g})" for name in event.group]
    return f"not separated: {' or '.join(each)}"


def _unknown_health(found: _JudgedFlights) -> str:
    """Why no health is read from the history: what changed is not listed, or may be the engine or an instrument; ""
    where it can be."""
    trend = found.trend
    if trend.posterior.unlisted >= EVENT or (trend.posterior.changed and not trend.events):
        return trend.reason or CANNOT_TELL_WHAT
    instruments = {p.component for p in found.parameters if p.belongs_to_instrument}
    for event in trend.changes:
        if len({name in instruments for name in event.group}) > 1:
            return "whether the engine or an instrument changed is not separated, so that no margin is read"
    return ""


def _health_rows(found: _JudgedFlights, current: EngineHistory, earlier: int) -> Iterator[HealthRow]:
    """One row per parameter: the change of those that an event moved, and of the others that they are steady."""
    trend = found.trend
    parts = {part.name: (event, part) for event in trend.events for part in event.changes}
    for p in found.parameters:
        chance = trend.parameter_probability(p.name, p.component)
        row = HealthRow(
            p.name, p.component, p.words or p.name, p.shown_unit, IntervalEstimate(), trend.calm_kind(p.name), chance
        )
        row = replace(row, family=p.family, quantity=p.quantity, part=p.part)
        if p.name not in parts:
            yield row
            continue
        event, part = parts[p.name]
        change = _reported_change(found, event, part)
        row = replace(row, change=change, kind=trend.family(event) if part.probability >= EVENT else STEADY)
        if row.kind not in (FROM_START, STEADY):
            best, low, high = trend.onset_numbers(event)
            label = current.stretches[best - 1].window.flight
            best, low, high = best + earlier, low + earlier, high + earlier
            row = replace(row, onset=best, onset_low=low, onset_high=high, onset_flight=label)
            if row.kind == DETERIORATION and event.end < 0:
                span = max(trend.flights + earlier - best + 1, 1)
                rate = IntervalEstimate(change.value / span, change.low / span, change.high / span)
                row = replace(row, rate_per_flight=rate)
        yield row


def _reported_change(found: _JudgedFlights, event: ChangeEvent, part: HistoryChange) -> IntervalEstimate:
    """Change of a parameter at the last flight; what maintenance is known to have moved is part of it. Of what comes
    and goes, its largest."""
    if found.trend.family(event) in (COMES_AND_GOES, INTERMITTENT):
        return IntervalEstimate(part.largest, part.largest_low, part.largest_high)
    health = found.trend.posterior.health
    if health is None or not any(part.name in moved for moved in found.moved):
        return IntervalEstimate(part.now, part.now_low, part.now_high)
    i = health.parameters.index(part.name)
    return interval_estimate(health.level[-1, i], np.sqrt(health.covariance[-1, i, i]))


def _history_since_renewal(history: EngineHistory) -> tuple[EngineHistory, int]:
    """The history since the whole engine was overhauled or exchanged last, and how many flights were before: after
    that it is an engine of its own, with a baseline of its own."""
    whole = [e for e in history.events if e.kind != "wash" and not e.component]
    first = max((k for e in whole if (k := event_number(e, history)) < len(history.stretches)), default=0)
    if not first:
        return history, 0
    later = [e for e in history.events if e not in whole and event_number(e, history) > first]
    since = history.sums.since(first)
    return replace(history, stretches=history.stretches[first:], events=later, sums=since), first


def _flight_rows(
    found: _JudgedFlights, used: EngineConsumption, current: EngineHistory, earlier: int, outcome: tuple[str, int]
) -> tuple[FlightRow, ...]:
    """outcome: the verdict, and the number of the first changed flight, 0 where there is none."""
    verdict, since = outcome
    rows, usual = [], NO_VERDICT if verdict == NO_VERDICT else HEALTHY
    for k, stretch in enumerate(current.stretches):
        changed = since and k + 1 >= since
        by_then = CHANGED if changed else "baseline" if k < current.baseline else usual
        window, taken = stretch.window, (float(used.used[k]), float(used.used_error[k]))
        rows.append(FlightRow(k + 1 + earlier, window.flight, window.records, by_then, *taken))
    return tuple(rows)


def _final_readings(flights: EngineFlights) -> FinalReadings:
    """The last flights against the baseline; what follows the conditions, as differences of neighbours show it, taken
    out of both."""
    weather = flights.readings.weather
    z = flights.z
    if weather.shape[1]:
        moved = np.diff(weather, axis=0)
        z = z - weather @ np.linalg.solve(moved.T @ moved + np.eye(weather.shape[1]), moved.T @ np.diff(z, axis=0))
    scatter, n = flights.scatter(), np.arange(len(flights))
    last = flights.weight * (n >= max(len(flights) - LAST, flights.baseline))
    before = flights.weight**2 * (n < flights.baseline)
    w = last**2 / np.sum(last**2)
    level = before @ z / before.sum() if before.sum() else np.zeros(z.shape[1])
    share = np.sum(w**2 / flights.weight**2) + 1 / max(before.sum(), 1.0)
    names = tuple(p.name for p in flights.described)
    return FinalReadings(names, flights.readings.D, w @ z - level, share * scatter, flights.J.mean(axis=0))


def _event_step(found: _JudgedFlights, current: EngineHistory, event: MaintenanceEvent) -> HealthStep | None:
    """What an event changed, of what it may have moved; None where the flights do not show it."""
    health = found.trend.posterior.health
    if health is None or event not in found.flights.events:
        return None
    epoch = int(np.searchsorted(found.trend.first, event_number(event, current)))
    moved = found.moved[found.flights.events.index(event)]
    at = [i for i, name in enumerate(health.parameters) if name in moved]
    step = next((step for step in health.steps if step.epoch == epoch), None)
    return None if step is None else step.select(at)


def _moved_names(found: _JudgedFlights, event: MaintenanceEvent) -> tuple[str, ...]:
    """Health parameters that an event may have moved, in their order."""
    health, moved = found.trend.posterior.health, found.moved[found.flights.events.index(event)]
    return tuple(name for name in health.parameters if name in moved) if health is not None else ()


def _event_rows(
    found: _JudgedFlights, used: EngineConsumption, histories: tuple[EngineHistory, EngineHistory], earlier: int
) -> tuple[EventRow, ...]:
    """histories: of all flights, and of those since the engine was renewed."""
    history, current = histories
    rows: list[EventRow] = []
    for event in history.events:
        number = event_number(event, history)
        step = _event_step(found, current, event)
        if step is None:
            reason = _unknown_reason(event, number, earlier, len(history.stretches))
            rows.append(EventRow(event, number + 1 if number < len(history.stretches) else 0, {}, reason=reason))
            continue
        deviation = np.sqrt(np.diag(step.covariance))
        gains = {
            name: interval_estimate(value, error)
            for name, value, error in zip(_moved_names(found, event), step.change, deviation, strict=True)
        }
        recovered = used.recovered.get(found.trend.flight_number(step.epoch), IntervalEstimate())
        rows.append(EventRow(event, number + 1, gains, recovered))
    return tuple(rows)


def _unknown_reason(event: MaintenanceEvent, number: int, earlier: int, flights: int) -> str:
    """Why the effect of an event before flight `number`, from 0, is not known."""
    if number >= flights:
        return "no flight is after it"
    if not event.component and event.kind != "wash" and number == earlier:
        return "the engine is another one since"
    return "it was before the engine was renewed" if number < earlier else "no flight is before it"


def changes_at_events(
    history: EngineHistory, series: Series, settings: FleetSettings
) -> tuple[HealthChange | None, ...]:
    """What each event did, by one account over all flights: those that renewed the whole engine, too, and those before,
    which the judgement of an engine does not include. None where flights are on one side alone."""
    found = _judge_flights(engine_flights(history, series), history, series, settings)
    return _event_changes(found, history, history)


def _event_changes(
    found: _JudgedFlights, current: EngineHistory, history: EngineHistory
) -> tuple[HealthChange | None, ...]:
    changes: list[HealthChange | None] = []
    for event in history.events:
        step = _event_step(found, current, event)
        changes.append(
            None
            if step is None
            else HealthChange(_moved_names(found, event), step.before, step.change, step.covariance)
        )
    return tuple(changes)
