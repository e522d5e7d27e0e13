"""The margin of engines whose flights are at hand as a series: the judgement of a fleet, of one engine or of some.

Which engine each event of a file of maintenance is of.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from enginediag_cli.config.hints import near
from enginediag_cli.detection.series import Series, Windows, series_of
from enginediag_cli.errors import DataError
from enginediag_cli.fleets.engine_judgement import judged_engine, moved_by
from enginediag_cli.fleets.finding import EngineFinding, EngineHistory, Event, FleetSettings, Moved
from enginediag_cli.fleets.maintenance import conditions_of
from enginediag_cli.fleets.margin import MarginScale, margin_scale, with_forecasts, with_taken_off
from enginediag_cli.fleets.work_scope import Gain, Moments, Reference, Scoping
from enginediag_cli.residuals.monitor import Monitor


def events_by_engine(
    events: Sequence[Event], engines: Collection[str], path: str
) -> tuple[dict[str, tuple[Event, ...]], tuple[str, ...]]:
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


FIRST = 1
"""Flights that are believed healthy where nobody says how many: wear is counted from the first on."""


@dataclass(frozen=True)
class MarginQuestion:
    """limits_K: column → limit at the reference condition; consumed_limit_K: K of margin that engines have lost when
    they are taken off, with its standard deviation, where that and no temperature is known; taken_off: engines whose
    recordings end there, which tell it; events: of a file that is called so; baseline: first flights of an engine, of
    each, that are believed healthy, 0: those within its first `healthy` records; sensors: instruments are suspects."""

    limits_K: Mapping[str, float] = field(default_factory=dict)
    consumed_limit_K: tuple[float, float] | None = None
    taken_off: Sequence[str] = ()
    events: Sequence[Event] = ()
    events_file: str = ""
    baseline: int = 0
    healthy: int = 0
    sensors: bool = True


@dataclass(frozen=True)
class Brought:
    """What an event of maintenance did: changes of the parameters `names` with their standard `deviation`, and by how
    much temperature and fuel fell at equal power, None with the `reason`."""

    names: tuple[str, ...] = ()
    change: tuple[float, ...] = ()
    deviation: tuple[float, ...] = ()
    gain: Gain | None = None
    reason: str = ""


@dataclass(frozen=True)
class Followed:
    """An engine with its margin, forecast and maintenance; brought: of each event of the finding, in its order, told at
    `reference`; unknown: flights of events that are not recorded, and what may be meant."""

    finding: EngineFinding
    brought: Sequence[Brought]
    reference: Reference | None
    unknown: Mapping[str, str]


@dataclass(frozen=True)
class Margins:
    """The engines of a series, by their names; others: engines that events name, and no recording; learnt_K: margin
    that engines had lost when they were taken off, with its standard deviation, where some tell it."""

    engines: Mapping[str, Followed]
    series: Series
    others: Sequence[str]
    learnt_K: tuple[float, float] | None = None


def margins_of(files: Windows, monitor: Monitor, question: MarginQuestion) -> Margins:
    """What a fleet of the engines of these files finds of each, and what maintenance brought.

    files: windows of a series, made by `for_comparison(monitor)`; monitor: says what a change does to the temperature.
    Raises DataError for a limit of what is no temperature of burnt gas, for events of nobody, for engines taken off
    that do not tell a limit, and when flights of an engine have statistics of different parameters.
    """
    series = replace(series_of(files, "none"), monitor=monitor)
    events, others = events_by_engine(question.events, series.stretches, question.events_file)
    settings = FleetSettings(
        sensors=question.sensors,
        limits_K=question.limits_K,
        consumed_limit_K=question.consumed_limit_K,
        thorough=False,
        onsets=False,
    )
    scale = _scale(series, settings)
    histories = []
    for engine, stretches in series.stretches.items():
        baseline = max(question.baseline or series.healthy(engine, question.healthy), FIRST)
        histories.append(EngineHistory(engine, "", stretches, baseline, events.get(engine, ())))
    findings = [_with_reason(judged_engine(history, series, settings, scale)) for history in histories]
    settings = with_taken_off(settings, findings, question.taken_off, "--taken-off")
    findings = with_forecasts(findings, settings)
    learnt = settings.consumed_limit_K if question.taken_off else None
    scoping = Scoping(monitor)
    found = [_followed(f, h, series, scoping) for f, h in zip(findings, histories, strict=True)]
    return Margins({one.finding.serial: one for one in found}, series, others, learnt)


def _scale(series: Series, settings: FleetSettings) -> MarginScale:
    """Of the hottest temperature, or of the hottest that has a limit."""
    assert series.monitor is not None
    limits, scale = settings.limits_K, margin_scale(series)
    for column in limits:
        if column not in series.monitor.sensors:
            known = [scale.column] if scale.column else []
            raise DataError(f"--limit: the engine has no sensor {column!r}; {near(column, known)}")
    if not limits or not scale.column or scale.column in limits:
        return scale
    own = margin_scale(series, limits)
    if not own.column:
        told = ", ".join(limits)
        raise DataError(f"--limit: {told} is no temperature of burnt gas; the hottest that is recorded: {scale.column}")
    return own


def _followed(finding: EngineFinding, history: EngineHistory, series: Series, scoping: Scoping) -> Followed:
    recorded = conditions_of(history.stretches)
    moved = list(finding.moved)
    if any(change is None for change in moved):
        across = moved_by(history, series)
        moved = [mine or other for mine, other in zip(moved, across, strict=True)]
    told = [Brought() if change is None else _brought(change, scoping, recorded) for change in moved]
    return Followed(finding, told, scoping.reference(recorded), _unknown(history))


def _brought(moved: Moved, scoping: Scoping, recorded: Mapping[str, float]) -> Brought:
    """At equal power, by the course of health: what flights on either side wore is no part of it."""
    deviation = np.sqrt(np.diag(moved.covariance))
    change = Moments(moved.names, moved.mean, moved.covariance)
    gain, reason = scoping.brought(moved.before, change, recorded)
    return Brought(moved.names, tuple(moved.mean.tolist()), tuple(deviation.tolist()), gain, reason)


def _with_reason(finding: EngineFinding) -> EngineFinding:
    """An engine that could not be followed has no margin for the same reason."""
    if finding.by_flight or finding.margin.reason:
        return finding
    return replace(finding, margin=replace(finding.margin, reason=finding.reason))


def _unknown(history: EngineHistory) -> dict[str, str]:
    """Flights that events name and nobody recorded, each with a hint."""
    last = len(history.stretches)
    labels = [label for x in history.stretches if (label := x.window.flight)]
    found = {}
    for event in history.events:
        numbered = not labels and event.flight.isdigit() and int(event.flight) <= last
        if event.flight and event.flight not in labels and not numbered:
            found[event.flight] = near(event.flight, labels) if labels else f"its flights are numbered 1 to {last}"
    return found
