"""The judgement of one engine: whether it has changed, since when, in what, and how far towards its limit.

An engine that is flagged is isolated as `trend` does it, for its events.

The baseline is tested for a drift: an engine that wears during its baseline is compared with its own wear, and no later
change is significant.

Per reading j, with r its deviations (conditions taken out) over the b flights of the baseline and t = 1 … b,

    T_j = Σ (t − t̄) r_j / (Σ (t − t̄)²)^½ ,      T_j² / S_jj ~ F(1, ν)

where S is the scatter from one flight to the next, which a slow course hardly changes, of ν differences; the smallest p
of m readings is taken m times.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.special import stdtr

from enginediag_cli.detection.sequential import EPath, SuspectDirections, e_path, onset_posterior
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
    HealthCourse,
    HealthRow,
    IntervalEstimate,
    Margin,
    engine_flights,
    event_number,
    fit_course,
    movable_parameters,
    washable_components,
)
from enginediag_cli.fleets.margin import (
    Consumption,
    MarginScale,
    condition_effects,
    engine_severity,
    margin_consumption,
    margin_scale,
)
from enginediag_cli.isolation.events import SeriesDiagnosis
from enginediag_cli.isolation.prior import SetPrior
from enginediag_cli.isolation.timeline import FLEET_EPOCHS, TrendOptions, judge_series
from enginediag_cli.probability import NORMAL_95


def isolate_history(
    flights: EngineFlights, series: Series, settings: FleetSettings, history: EngineHistory
) -> SeriesDiagnosis:
    """What changed, and when; steps at maintenance are conditions like the weather, so that the events found began
    between them."""
    readings = flights.readings
    if flights.steps.shape[1]:
        centred = flights.steps - flights.steps.mean(axis=0)
        columns = centred / centred.std(axis=0)
        readings = replace(readings, weather=np.concatenate([readings.weather, columns], axis=1))
    options = TrendOptions(
        healthy=history.baseline, sensors=settings.sensors, generic=settings.generic, governed=series.power_errors
    )
    return judge_series(readings.merge_epochs(FLEET_EPOCHS), series.parameters, options)


def apply_diagnosis(
    health: Sequence[HealthRow], story: SeriesDiagnosis, history: EngineHistory
) -> tuple[HealthRow, ...]:
    """The rows with kind, onset and probability as isolated."""
    return tuple(_apply_to_row(row, story, history) for row in health)


def change_probabilities(story: SeriesDiagnosis, parameters: Sequence[str]) -> dict[int, float]:
    """Of each parameter, by position, the probability that it changed in one of the events."""
    found: dict[int, float] = {}
    for event in story.events:
        for member in event.members:
            for name, inclusion in zip(member.parameters, member.inclusion, strict=True):
                i = parameters.index(name)
                found[i] = max(found.get(i, 0.0), event.probability * member.probability * inclusion)
    return found


def _apply_to_row(row: HealthRow, story: SeriesDiagnosis, history: EngineHistory) -> HealthRow:
    told = replace(
        row,
        kind="steady",
        probability=story.inclusion.get(row.component, 0.0) if not story.events else 0.0,
        onset=0,
        onset_low=0,
        onset_high=0,
        onset_flight="",
        rate_per_flight=IntervalEstimate(),
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
        told = replace(told, rate_per_flight=IntervalEstimate(c.value / span, c.low / span, c.high / span))
    return told


MOVES = 0.01
"""Probability from which on a baseline that stands still is taken for one that moves: of a hundred healthy engines one
gets no verdict for it."""


def p_steady_baseline(flights: EngineFlights, course: HealthCourse) -> float:
    """Probability that a baseline which stands still has as much of a course; NaN of fewer than three flights."""
    b = flights.baseline
    if b < 3:
        return float("nan")
    r = (flights.z - condition_effects(flights, course))[:b]
    t = np.arange(b) - 0.5 * (b - 1)
    contrast = t @ r / np.sqrt(t @ t)
    size = np.abs(contrast) / np.sqrt(np.diag(course.scatter))
    p = 2.0 * stdtr(max(len(flights) - 1, 1), -size)
    return float(min(1.0, len(p) * p.min()))


BELIEVED = 0.1
"""Prior probability that an engine has changed. Judgement."""
SUSPECTED = 0.5
"""Probability from which an instrument is taken for the one that changed, so that no health is read from it, and from
which what changed is not listed."""
LAST = 10
"""Flights at the end that say what an engine has come to, for what a fleet has in common."""
PLAUSIBLE = 2.0
"""Change, in prior standard deviations, which an engine that is called healthy must have been able to show."""


@dataclass(frozen=True)
class _EngineState:
    """What is known of an engine when its rows are made."""

    flights: EngineFlights
    suspects: SuspectDirections
    members: Sequence[tuple[int, ...]]
    path: EPath
    course: HealthCourse


def judge_engine(
    history: EngineHistory, series: Series, settings: FleetSettings, scale: MarginScale | None = None
) -> EngineFinding:
    """Judge the history of one engine: whether it has changed, since when, in what, and how far towards its limit.

    Parameters
    ----------
    history : EngineHistory
        Flights of the engine, its baseline, and its maintenance.
    series : Series
        Meaning of its parameters, and its monitor.
    settings : FleetSettings
        Levels of the tests, and how thorough the judgement is.
    scale : MarginScale, optional
        What a change of health means for the margin; `margin_scale` computes it once for all engines of a series.

    Returns
    -------
    EngineFinding

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
        return replace(nothing, reason=f"{max(after, 0)} flights{new} beside the baseline are too few, {FEWEST} needed")
    flights = engine_flights(current, series)
    if len(flights) - flights.baseline < FEWEST:
        return replace(nothing, reason="too few flights determine all readings")
    found, story = _engine_state(flights, current, series, settings)
    log_e, chance = found.path.log_e, _change_probability(found.path.log_e[-1])
    verdict, reason = _verdict(found, settings)
    flagged = verdict == CHANGED or _is_discovery(found.path, settings)
    used = margin_consumption(flights, found.course, margin_scale(series) if scale is None else scale, settings)
    since = (0, 0, 0)
    if settings.onsets and (flagged or chance >= SUSPECTED):
        since = _onset_interval(onset_posterior(flights.rows(), found.suspects, flights.baseline), flights)
    health = _health_rows(found, chance, since, current)
    best, low, high = since if flagged else (0, 0, 0)
    if story is not None:
        health = apply_diagnosis(health, story, current)
    if earlier:
        health = tuple(_shift_onset(row, earlier) for row in health)
    unlisted, why = _unlisted_reason(found, health, story)
    if why:
        health = tuple(_clear_onset(row, 1.0 - unlisted) for row in health)
    return replace(
        nothing,
        verdict=verdict,
        reason="; ".join(filter(None, [reason, why])),
        unlisted=unlisted,
        log10_e=float(log_e[-1] / np.log(10)),
        since=best + earlier if best else 0,
        since_low=low + earlier if best else 0,
        since_high=high + earlier if best else 0,
        since_flight=current.stretches[best - 1].window.flight if best else "",
        severity=IntervalEstimate() if why else engine_severity(used, found.course),
        severity_unit="K" if used.margin.column else "sigma",
        health=health,
        by_flight=_flight_rows(found, used, settings, current, earlier, verdict),
        events=_event_rows(found, used, history, earlier),
        margin=_unknown_margin(used.margin, why) if why else used.margin,
        state=_final_readings(found),
        event_changes=_event_changes(flights, found.course, history),
    )


def _engine_state(
    flights: EngineFlights, current: EngineHistory, series: Series, settings: FleetSettings
) -> tuple[_EngineState, SeriesDiagnosis | None]:
    """E-value and course of health of the engine; the events of its series where it is flagged and judged thoroughly.

    The course leaves out the instruments that are taken for what changed.
    """
    suspects, members = flights.suspects(settings.sensors)
    path = e_path(flights.rows(), suspects, flights.baseline)
    is_isolated = settings.thorough and _is_discovery(path, settings)
    story = isolate_history(flights, series, settings, current) if is_isolated else None
    if story is None:
        chance = _change_probability(path.log_e[-1])
        changed = {i: w * chance for i, w in _parameter_weights(path, members).items()}
    else:
        changed = change_probabilities(story, [p.name for p in flights.described])
    compressors = washable_components(series)
    moved = [movable_parameters(e, flights.described, compressors) for e in flights.events]
    course = fit_course(flights, moved, _faulty_instruments(flights, changed))
    return _EngineState(flights, suspects, members, path, course), story


def _is_discovery(path: EPath, settings: FleetSettings) -> bool:
    """Whether the evidence now, of this engine alone, reaches the false discovery rate of the fleet."""
    return bool(path.log_e[-1] >= -np.log(settings.false_discovery))


def _unknown_margin(margin: Margin, reason: str) -> Margin:
    """The margin without its figures, where what changed is not known."""
    nothing = IntervalEstimate()
    return replace(margin, consumed_K=nothing, now_K=nothing, remaining_flights=nothing, reason=reason)


def _unlisted_reason(
    found: _EngineState, health: Sequence[HealthRow], story: SeriesDiagnosis | None
) -> tuple[float, str]:
    """Probability that what changed is something that is not among the suspects, NaN where nothing was isolated, and
    why nothing is named, "" where something listed is likelier. A change that is named, or certain, and beyond what a
    component or an instrument can do is none that is listed."""
    unlisted = float("nan") if story is None else story.unlisted
    flights = found.flights
    low, high = SetPrior().bounds(flights.described)
    size = {p.name: k for k, p in enumerate(flights.described)}
    for row in health:
        k = size[row.parameter]
        at, least, most = np.array([row.change.value, row.change.low, row.change.high]) / flights.readings.D[k]
        named = row.onset and row.probability >= SUSPECTED
        if (named and (at < low[k] or at > high[k])) or least > high[k] or most < low[k]:
            what = "an instrument" if flights.described[k].belongs_to_instrument else "a component"
            why = f"it would take a change of {row.words} outside what {what} can do: check units and engine file"
            return np.fmax(row.probability, unlisted) if named else unlisted, f"cannot tell what changed: {why}"
    if unlisted >= SUSPECTED:
        return unlisted, "cannot tell what changed: something that is not among the suspects"
    return unlisted, ""


def _clear_onset(row: HealthRow, listed: float) -> HealthRow:
    """The row where it is not among what is listed, with the probability that it is."""
    told = replace(row, kind="steady", probability=listed * row.probability, onset=0, onset_low=0, onset_high=0)
    return replace(told, onset_flight="", rate_per_flight=IntervalEstimate())


def _parameter_weights(path: EPath, members: Sequence[tuple[int, ...]]) -> dict[int, float]:
    """Of each parameter, by position, the probability that it is what changed, given that something did."""
    found: dict[int, float] = {}
    for at, weight in zip(members, path.suspect, strict=True):
        for i in at:
            found[i] = found.get(i, 0.0) + float(weight)
    return found


def _faulty_instruments(flights: EngineFlights, changed: Mapping[int, float]) -> list[int]:
    """Positions of the errors of instruments that are taken for what changed: of each instrument the likeliest of its
    forms, which exclude each other, where together they are probable enough. changed: position → probability."""
    forms: dict[str, list[int]] = {}
    for i in changed:
        if flights.described[i].belongs_to_instrument:
            forms.setdefault(flights.described[i].component, []).append(i)
    return [max(at, key=lambda i: changed[i]) for at in forms.values() if sum(changed[i] for i in at) >= SUSPECTED]


def _history_since_renewal(history: EngineHistory) -> tuple[EngineHistory, int]:
    """The history since the whole engine was overhauled or exchanged last, and how many flights were before: after
    that it is an engine of its own, with a baseline of its own."""
    whole = [e for e in history.events if e.kind != "wash" and not e.component]
    first = max((k for e in whole if (k := event_number(e, history)) < len(history.stretches)), default=0)
    if not first:
        return history, 0
    later = [e for e in history.events if e not in whole and event_number(e, history) > first]
    return replace(history, stretches=history.stretches[first:], events=later), first


def _change_probability(log_e: float) -> float:
    """Probability that an engine has changed."""
    return float(1 / (1 + np.exp(-np.clip(log_e + np.log(BELIEVED / (1 - BELIEVED)), -700, 700))))


def _verdict(found: _EngineState, settings: FleetSettings) -> tuple[str, str]:
    highest, last = float(found.path.log_e.max()), float(found.path.log_e[-1])
    if highest >= -np.log(settings.false_alarm):
        fell = last < -np.log(settings.false_alarm)
        return CHANGED, "the evidence has been stronger than it is now" if fell else ""
    flights, beyond = found.flights, -np.log(settings.false_alarm)
    told = _visible_change(found)
    shown = f"; its flights show {told}" if told else ""
    if _detectable_log_e(found, settings) < beyond:
        b, n, m = flights.baseline, len(flights) - flights.baseline, flights.z.shape[1]
        return NO_VERDICT, f"a baseline of {b} flights and {n} after it cannot show a change of {m} readings{shown}"
    if p_steady_baseline(found.flights, found.course) < MOVES:
        b = flights.baseline
        return (
            NO_VERDICT,
            f"its readings move during its baseline, the first {b} flights: there is no healthy state to compare with",
        )
    if told:
        return NO_VERDICT, f"its flights show {told}, not yet certain beside readings that may wander"
    return HEALTHY, ""


def _detectable_log_e(found: _EngineState, settings: FleetSettings) -> float:
    """Logarithm of the E that the readings of this engine would have come to, had the component that shows best changed
    with the first flight after the baseline: its parameters by PLAUSIBLE together, the second half as far as the first
    and so on, since what changes is along none of the directions weighed beforehand."""
    flights = found.flights
    parts: dict[str, list[int]] = {}
    for i in flights.health:
        parts.setdefault(flights.described[i].component, []).append(int(i))
    changes = np.zeros((len(parts), flights.J.shape[2]))
    for change, at in zip(changes, parts.values(), strict=True):
        size = 0.5 ** np.arange(len(at))
        change[at] = -PLAUSIBLE * size / np.linalg.norm(size)
    if not len(changes):
        return float("inf")
    d = changes @ flights.J.mean(axis=0).T
    best = changes[np.argmax(np.einsum("cm,mk,ck->c", d, np.linalg.inv(found.course.scatter), d))]
    after = np.arange(len(flights)) >= flights.baseline
    rows = flights.rows()
    moved = replace(rows, z=rows.z + after[:, None] * (flights.J @ best))
    suspects, _ = flights.suspects(settings.sensors)
    return float(e_path(moved, suspects, flights.baseline, looks=1).log_e[-1])


def _visible_change(found: _EngineState) -> str:
    """What the flights themselves say has changed, by the scatter from one to the next; empty where they say nothing:

    T = δ_k / s_k ~ t(n − 1),    the smallest p of q parameters taken q times
    """
    from scipy.special import stdtr

    flights, c = found.flights, found.course
    mean, covariance = c.evaluate(c.state_map(len(flights) - 1))
    q = len(flights.health)
    if not q:
        return ""
    error = np.sqrt(np.diag(covariance))
    k = int(np.argmax(np.abs(mean[:q]) / error[:q]))
    if 2.0 * q * stdtr(len(flights) - 1, -abs(mean[k]) / error[k]) >= MOVES:
        return ""
    p, size = flights.described[c.parameters[k]], _interval_estimate(mean[k], error[k], c.unit[k])
    factor, unit = (1.0, p.shown_unit) if p.shown_unit else (100.0, "%")
    value, low, high = (f"{factor * x:+.2g}" for x in (size.value, size.low, size.high))
    return f"{p.words} {value} {unit} [{low}, {high}]"


def _onset_interval(onset: np.ndarray, flights: EngineFlights) -> tuple[int, int, int]:
    """Number of the first changed flight, from 1: most probable, and the 95 % interval."""
    if not onset.any():
        return 0, 0, 0
    order = np.argsort(-onset, kind="stable")
    total = np.cumsum(onset[order])
    chosen = order[: int(np.searchsorted(total, 0.95 * total[-1])) + 1]
    best, low, high = (int(flights.number[k]) + 1 for k in (order[0], chosen.min(), chosen.max()))
    return best, low, high


def _shift_onset(row: HealthRow, earlier: int) -> HealthRow:
    """The row with its onset counted from the first flight of all."""
    if not row.onset:
        return row
    return replace(
        row, onset=row.onset + earlier, onset_low=row.onset_low + earlier, onset_high=row.onset_high + earlier
    )


def _health_rows(
    found: _EngineState, chance: float, since: tuple[int, int, int], current: EngineHistory
) -> tuple[HealthRow, ...]:
    flights, path, c = found.flights, found.path, found.course
    mean, covariance = c.evaluate(c.state_map(len(flights) - 1))
    error = np.sqrt(np.diag(covariance))
    single = _parameter_weights(path, found.members)
    place = {int(p): k for k, p in enumerate(c.parameters)}
    best, low, high = since
    kind = "deterioration" if path.growing >= 0.5 else "step"
    rows = []
    for i, p in enumerate(flights.described):
        probability = chance * single.get(i, 0.0)
        change, rate = IntervalEstimate(), IntervalEstimate()
        if i in place:
            k = place[i]
            change = _interval_estimate(mean[k], error[k], c.unit[k])
            span = max(len(flights) - best, 1)
            rate = IntervalEstimate(change.value / span, change.low / span, change.high / span)
        named = probability >= SUSPECTED and best > 0
        rows.append(
            HealthRow(
                p.name,
                p.component,
                p.words or p.name,
                p.shown_unit,
                change,
                kind if named else "steady",
                probability,
                *((best, low, high) if named else (0, 0, 0)),
                current.stretches[best - 1].window.flight if named else "",
                rate if named and kind == "deterioration" else IntervalEstimate(),
            )
        )
    return tuple(rows)


def _interval_estimate(mean: float, error: float, unit: float) -> IntervalEstimate:
    half = NORMAL_95 * error
    return IntervalEstimate(float(unit * mean), float(unit * (mean - half)), float(unit * (mean + half)))


def _flight_rows(
    found: _EngineState, used: Consumption, settings: FleetSettings, current: EngineHistory, earlier: int, verdict: str
) -> tuple[FlightRow, ...]:
    highest = np.maximum.accumulate(np.maximum(found.path.log_e, 0.0))
    rows, usual = [], NO_VERDICT if verdict == NO_VERDICT else HEALTHY
    for k, number in enumerate(found.flights.number):
        window, p = current.stretches[number].window, float(np.exp(-highest[k]))
        by_then = "baseline" if k < found.flights.baseline else CHANGED if p <= settings.false_alarm else usual
        rows.append(
            FlightRow(
                int(number) + 1 + earlier,
                window.flight,
                window.records,
                float(found.path.log_e[k] / np.log(10)),
                p,
                by_then,
                float(used.by_flight[k]),
                float(used.error[k]),
            )
        )
    return tuple(rows)


def _final_readings(found: _EngineState) -> FinalReadings:
    """The last flights against the baseline, the conditions of both taken out."""
    flights, c = found.flights, found.course
    last = flights.weight * (np.arange(len(flights)) >= max(len(flights) - LAST, flights.baseline))
    w = last**2 / np.sum(last**2)
    off = w @ (flights.z - c.level - condition_effects(flights, c))
    before = np.sum(flights.weight[: flights.baseline] ** 2)
    share = np.sum(w**2 / flights.weight**2) + 1 / max(before, 1.0)
    names = tuple(p.name for p in flights.described)
    return FinalReadings(names, flights.readings.D, off, share * c.scatter, flights.J.mean(axis=0))


def _event_rows(found: _EngineState, used: Consumption, history: EngineHistory, earlier: int) -> tuple[EventRow, ...]:
    c, flights = found.course, found.flights
    rows: list[EventRow] = []
    for event in history.events:
        number = event_number(event, history)
        if event not in flights.events:
            whole = not event.component and event.kind != "wash"
            reason = (
                "no flight is after it"
                if number >= len(history.stretches)
                else "the engine is another one since"
                if whole and number == earlier
                else "it was before the engine was renewed"
                if number < earlier
                else "no flight is before it"
            )
            rows.append(EventRow(event, number + 1 if number < len(history.stretches) else 0, {}, reason=reason))
            continue
        T = c.event_map(flights.events.index(event))
        mean, covariance = c.evaluate(T)
        touched = np.flatnonzero(np.abs(T).sum(axis=1))
        gains = {
            flights.described[c.parameters[k]].name: _interval_estimate(mean[k], np.sqrt(covariance[k, k]), c.unit[k])
            for k in touched
        }
        recovered = IntervalEstimate()
        if used.margin.column:
            value, variance = float(used.slope @ mean), float(used.slope @ covariance @ used.slope)
            recovered = _interval_estimate(-value, np.sqrt(variance), 1.0)
        rows.append(EventRow(event, number + 1, gains, recovered))
    return tuple(rows)


def changes_at_events(history: EngineHistory, series: Series) -> tuple[HealthChange | None, ...]:
    """What each event did, by one course of health over all flights: those that renewed the whole engine, too, and
    those before, which the judgement of an engine does not include. None where flights are on one side alone."""
    flights = engine_flights(history, series)
    compressors = washable_components(series)
    moved = [movable_parameters(e, flights.described, compressors) for e in flights.events]
    return _event_changes(flights, fit_course(flights, moved), history)


def _event_changes(flights: EngineFlights, c: HealthCourse, history: EngineHistory) -> tuple[HealthChange | None, ...]:
    told: list[HealthChange | None] = []
    for event in history.events:
        if event not in flights.events:
            told.append(None)
            continue
        at = flights.events.index(event)
        mean, covariance = c.evaluate(c.event_map(at))
        before = c.path[int(np.argmax(c.steps[:, at] > 0)) - 1]
        k = np.flatnonzero(np.abs(c.event_map(at)).sum(axis=1))
        names = tuple(flights.described[p].name for p in c.parameters[k])
        unit = c.unit[k]
        told.append(
            HealthChange(names, unit * before[k], unit * mean[k], np.outer(unit, unit) * covariance[np.ix_(k, k)])
        )
    return tuple(told)
