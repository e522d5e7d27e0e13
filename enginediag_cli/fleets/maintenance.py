"""What maintenance restored: the difference of the levels before and after it, as a change of its own.

With score and information of the flights on either side, b₁, I₁ before and b₂, I₂ after, the difference of the levels
is known with

    I = I₁ (I₁ + I₂)⁺ I₂,     b = I₁ (I₁ + I₂)⁺ b₂ − I₂ (I₁ + I₂)⁺ b₁,     b ~ N(I (δ₂ − δ₁), I),

the parallel sum of W. N. Anderson and R. J. Duffin (1969) J. Math. Anal. Appl. 26, 576–594, since all that both sides
have in common cancels. Instruments differ by their spread from flight to flight. Repair may move a parameter
either way: wear says nothing of it.

A level is that at the event itself, estimated from the flights nearest to it: what they wore on the way there or since
is no part of it. With δ_k = δ + d_k s at the distance d_k of flight k and a wear s ~ N(0, (WEAR D)²) of each side,

    b = Σ b_k − M Σ d_k b_k,     I = Σ I_k − M Σ d_k I_k,     M = Σ d_k I_k (Σ d_k² I_k + S⁻¹)⁻¹,

as many flights as have such a course: with χ² of the course, and what it has of degrees of freedom,

    ĉ = (Σ b_kᵀ I_k⁺ b_k − χ²) / (Σ rank I_k − rank)

is 1 where they do, and above it by what the model does not know of flights; evidence is divided by it.

`maintenance_effects` estimates the events of one series; `assess_margins` the margin of engines whose flights are a
series, by the judgement of a fleet.
"""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from enginediag_cli.config.fields import near
from enginediag_cli.detection.series import FlightWindow, Series
from enginediag_cli.errors import DataError
from enginediag_cli.fleets.engine_judgement import changes_at_events, judge_with_account
from enginediag_cli.fleets.findings import EngineFinding, EngineHistory, FleetSettings, HealthChange, MaintenanceEvent
from enginediag_cli.fleets.margin import (
    NO_LIMIT,
    MarginScale,
    PowerCourse,
    add_forecasts,
    available_power,
    learn_removal_limit,
    margin_scale,
)
from enginediag_cli.fleets.work_scope import ChangeMoments, Gain, PowerReference, WorkScopeEstimator
from enginediag_cli.history.engines import HistoryWindows
from enginediag_cli.isolation.methods import keep_first_forms
from enginediag_cli.isolation.posterior import SetInference, set_posterior
from enginediag_cli.isolation.prior import SetPrior
from enginediag_cli.isolation.results import temper
from enginediag_cli.isolation.sensitivity_analysis import SPREAD, stated_errors
from enginediag_cli.residuals.monitor import Monitor
from enginediag_cli.residuals.score import Score, fisher_score
from enginediag_cli.residuals.statistics import LocalStatistics, range_space

NEAR = 10
"""Flights on each side of an event that are compared: over more of them wear is no straight line."""
WEAR = 0.05
"""Standard deviation of what a part wears from flight to flight, in prior standard deviations of a change: half of one
in ten flights. Judgement: fast wear is that of a hundredth in as many. Instruments do not wear."""
DIFFERENT = 4.0
"""ĉ from which flights have no common level: they differ by twice what their noise and instruments explain."""
LARGEST = 5
"""Parameters that change together at most, as where a window is isolated."""


@dataclass(frozen=True)
class MaintenanceEffect:
    """The effect of maintenance before one flight.

    Attributes
    ----------
    flight : int
        Number of the first flight after it, from 1.
    flights_before, flights_after : int
        Flights that the estimate rests on.
    dispersion : float
        Factor ĉ by which the evidence was divided, since flights of one side differ.
    names : tuple of str
        Parameters that changed.
    probability : float
        That exactly these changed.
    change, deviation : tuple of float
        Mean changes and standard deviations, in the parameters' units.
    gain : Gain or None
        Fall of temperature and fuel flow at equal power.
    reason : str
        Why there is no gain.
    """

    flight: int
    flights_before: int
    flights_after: int
    dispersion: float
    names: tuple[str, ...]
    probability: float
    change: tuple[float, ...]
    deviation: tuple[float, ...]
    gain: Gain | None
    reason: str = ""


def estimate_maintenance(
    scoping: WorkScopeEstimator,
    statistics: Sequence[LocalStatistics],
    flight: int,
    others: Sequence[int] = (),
    spread: Mapping[str, float] | None = None,
    recorded: Mapping[str, float] | None = None,
) -> MaintenanceEffect:
    """What the maintenance before flight number `flight` (from 1) of a series did.

    statistics: of each flight in order; others: flights before which there was maintenance, too, beyond which levels
    are not compared; spread: standard deviation of an instrument's error from flight to flight, by parameter.
    ValueError where there is no flight on one side.
    """
    first = max([f for f in others if f < flight], default=1)
    last = min([f for f in others if f > flight], default=len(statistics) + 1)
    sides = statistics[first - 1 : flight - 1][::-1], statistics[flight - 1 : last - 1]
    if not all(sides):
        raise ValueError(f"no flight lies {'after' if sides[0] else 'before'} the maintenance at flight {flight}")
    before, after = (_flight_level(side[:NEAR], spread or {}) for side in sides)
    dispersion = max(before.dispersion, after.dispersion)  # of a side of one flight nothing is known
    one, other = (temper(level.score, dispersion) for level in (before, after))
    prior = SetPrior(p_recovery=0.5)
    score = level_difference(one, other)
    belief = SetInference(score, set_posterior(score, prior, largest=LARGEST), prior)
    names = belief.posterior.names(0)
    mean, covariance = belief.moments()
    at = score.indices(names)
    engine = [i for i, p in enumerate(score.described) if not p.belongs_to_instrument]
    told = ChangeMoments(tuple(score.parameters[i] for i in engine), mean[engine], covariance[np.ix_(engine, engine)])
    # the level before, as far as flights tell it beyond what is plausible
    gain, reason = scoping.maintenance_gain(_prior_held_change(one)[engine], told, recorded or {})
    return MaintenanceEffect(
        flight,
        before.flights,
        after.flights,
        dispersion,
        names,
        float(belief.posterior.probabilities[0]),
        tuple(mean[at].tolist()),
        tuple(np.sqrt(np.diag(covariance)[at]).tolist()),
        gain,
        reason,
    )


def level_difference(before: Score, after: Score) -> Score:
    """The score of the difference of two levels, what both have in common cancelling."""
    (b1, I1), (b2, I2) = before.scaled(), after.scaled()
    space = range_space(I1 + I2, np.ones(len(b1)))
    inverse = (space.basis / space.eigenvalues) @ space.basis.T
    I = I1 @ inverse @ I2
    b = I1 @ inverse @ b2 - I2 @ inverse @ b1
    D = before.prior_sigma
    inner = range_space((I + I.T) / 2, np.ones(len(b)))
    glr = float(np.sum((b @ inner.basis) ** 2 / inner.eigenvalues))
    return replace(before, b=b / D, information=(I + I.T) / 2 / D / D[:, None], glr=glr, rank=inner.rank)


@dataclass(frozen=True)
class FlightLevel:
    """Score of the nearest flights of one side together, how many they are, and ĉ, at least 1, among them."""

    score: Score
    flights: int
    dispersion: float


def _flight_level(side: Sequence[LocalStatistics], spread: Mapping[str, float]) -> FlightLevel:
    """The flights of a side, the nearest first, as long as they have a course in common: two at least, where there are;
    instruments' errors are each flight's own."""
    found: FlightLevel | None = None
    of: _LevelAndWear | None = None
    for k, x in enumerate(side, start=1):
        variance = np.square([spread.get(name, 0.0) for name in x.parameters])
        own = keep_first_forms(fisher_score(x, uncertainty=np.diag(variance)))
        of = (of or _LevelAndWear.empty(len(own.parameters))).add_flight(own, k - 0.5)
        dispersion = of.dispersion(own)
        if found is not None and k > 2 and dispersion > DIFFERENT:
            break
        found = FlightLevel(of.level_score(own), k, dispersion)
    assert found is not None
    return found


@dataclass(frozen=True)
class _LevelAndWear:
    """Sums over flights of a side, in prior standard deviations: score and information of level and wear, (2p,) and
    (2p, 2p); χ² and rank of the flights one by one."""

    b: np.ndarray
    information: np.ndarray
    separate: float
    ranks: int

    @staticmethod
    def empty(p: int) -> _LevelAndWear:
        return _LevelAndWear(np.zeros(2 * p), np.zeros((2 * p, 2 * p)), 0.0, 0)

    def add_flight(self, own: Score, distance: float) -> _LevelAndWear:
        b, information = own.scaled()
        d = np.array([1.0, distance])
        return _LevelAndWear(
            self.b + np.kron(d, b),
            self.information + np.kron(np.outer(d, d), information),
            self.separate + own.glr,
            self.ranks + own.rank,
        )

    def _split_parameters(self, like: Score) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Positions of the levels, and of the wear of what can wear, with its precision."""
        p = len(like.parameters)
        wears = np.array([not q.belongs_to_instrument for q in like.described])
        return np.arange(p), p + np.flatnonzero(wears), np.full(int(wears.sum()), WEAR**-2)

    def level_score(self, like: Score) -> Score:
        """The score of the level there, wear being whatever it was."""
        level, wear, precision = self._split_parameters(like)
        cross = self.information[np.ix_(level, wear)]
        M = np.linalg.solve(self.information[np.ix_(wear, wear)] + np.diag(precision), cross.T).T
        b = self.b[level] - M @ self.b[wear]
        I = self.information[np.ix_(level, level)] - M @ cross.T
        I = (I + I.T) / 2
        inner = range_space(I, np.ones(len(b)))
        glr = float(np.sum((b @ inner.basis) ** 2 / inner.eigenvalues))
        D = like.prior_sigma
        return replace(like, b=b / D, information=I / D / D[:, None], glr=glr, rank=inner.rank)

    def dispersion(self, like: Score) -> float:
        """ĉ, at least 1; 1 without degrees of freedom to estimate it."""
        level, wear, precision = self._split_parameters(like)
        there = self.level_score(like)
        own = self.information[np.ix_(wear, wear)]
        held = np.linalg.solve(own + np.diag(precision), self.b[wear])
        chi2 = there.glr + float(self.b[wear] @ held)
        cross = self.information[np.ix_(level, wear)]
        beside = own - cross.T @ np.linalg.pinv(self.information[np.ix_(level, level)], hermitian=True) @ cross
        told = float(np.trace(np.linalg.solve(beside + np.diag(precision), beside)))
        freedom = self.ranks - there.rank - told
        return max((self.separate - chi2) / freedom, 1.0) if freedom > 0.5 else 1.0


def _prior_held_change(level: Score) -> np.ndarray:
    """Likely change (p,) from nominal, each parameter held by its prior."""
    b, information = level.scaled()
    return np.asarray(level.prior_sigma * np.linalg.solve(information + np.eye(len(b)), b))


def maintenance_effects(
    scoping: WorkScopeEstimator, series: Series, engine: str, events: Sequence[str]
) -> Iterator[MaintenanceEffect]:
    """Estimate what maintenance restored on one engine.

    Parameters
    ----------
    scoping : WorkScopeEstimator
        Of the monitored engine.
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

    References
    ----------
    W. N. Anderson and R. J. Duffin (1969) J. Math. Anal. Appl. 26, 576–594.
    """
    stretches = series.stretches[engine]
    flights = maintenance_flights(series, engine, events)
    monitor, conditions = series.monitor, mean_conditions(stretches)
    spread = {}
    if monitor is not None and flights:
        readings = {**conditions, **stretches[0].window.readings}
        stated = stated_errors(monitor, readings, {})
        spread = {name: s.sigma for name, s in stated.items() if s.origin == SPREAD}
    statistics = [x.statistics for x in stretches]
    for flight in sorted(set(flights)):
        try:
            yield estimate_maintenance(scoping, statistics, flight, flights, spread, conditions)
        except ValueError as error:
            raise DataError(f"--event: {error}") from None


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
        if account is not None and finding.margin.reason in ("", NO_LIMIT):
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
