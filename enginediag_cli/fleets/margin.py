"""EGT margin: how much deterioration has used, and how many flights remain.

The margin is that of the hottest recorded temperature of burnt gas, at given thrust: at the rating on a standard hot
day, or at a condition that is stated.

With T the temperature, F the thrust (or the power that is delivered) and u the power setting, at a reference condition

    dT/dθ at given F = T_θ − T_u F_θ / F_u

so that the losses of components add up as they do in the engine: kelvins of margin. Flights to the limit are forecast
with what the rest of the fleet shows of how engines wear.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from enginediag_cli.config.fields import near
from enginediag_cli.detection.forecast import FittedLaws, MarginCourse, Population, fit_laws, forecast, learn_population
from enginediag_cli.detection.series import Series
from enginediag_cli.engine.engine import Engine
from enginediag_cli.engine.load import hot_columns
from enginediag_cli.engine.wrapped import WrappedModel
from enginediag_cli.errors import DataError
from enginediag_cli.fleets.findings import (
    EngineFinding,
    FleetSettings,
    IntervalEstimate,
    Margin,
    PowerAvailable,
)
from enginediag_cli.fleets.work_scope import (
    PowerNotHeldError,
    WorkScopeEstimator,
    design_condition,
    design_unknowns,
    solve_at_limits,
)
from enginediag_cli.history.engines import EngineTrend
from enginediag_cli.history.hypotheses import FROM_START, RAMP_HOLD, SATURATING, STEP
from enginediag_cli.history.posterior import EVENT, ChangeEvent, HealthPath
from enginediag_cli.parameters import Parameter
from enginediag_cli.probability import NORMAL_95
from enginediag_cli.residuals.monitor import Monitor
from enginediag_cli.units import convert, split_column

NO_LIMIT = "no limit is stated"
"""The reason that an option can remove."""
PASSED = "the limit is reached from the first flight on"
"""Why nothing is left to forecast."""
POINTS = 200
"""Operating points of identification among which the hottest is taken, where take-off cannot be computed."""
DELIVERED = ("Fn_N", "power_W")
"""What an engine delivers, in order of preference: thrust, else power of the loads."""
HOT_DAY = {
    "altitude_m": 0.0,
    "mach": 0.0,
    "dT_isa_K": 15.0,
    "ambient_temperature_K": 303.15,
    "ambient_pressure_Pa": 101325.0,
}
"""A standard hot day at sea level, at rest: ISA + 15 K, to which engines are flat rated."""
TAKE_OFF, RATING = "take-off on a standard hot day", "rating on a standard hot day"
STATED, HOTTEST = "stated condition", "hottest point of identification"
"""What a reference condition is; at take-off where it has an altitude."""
HELD = {"Fn_N": "equal thrust", "power_W": "equal power"}
"""What is delivered, in words."""


def condition_words(inputs: Mapping[str, float]) -> str:
    """Inputs as they are said, for instance "35,000 ft, Mach 0.8, ISA + 0 K, Wf 0.62 kg/s"."""
    return ", ".join(_input_words(column, value) for column, value in inputs.items())


def _input_words(column: str, value: float) -> str:
    quantity, unit = split_column(column)
    words = quantity.replace("_", " ")
    if column == "altitude_m":
        feet = convert(value, "m", "ft")
        return f"{feet:,.0f} ft" if abs(feet) >= 1.0 else "sea level"
    if column == "dT_isa_K":
        return f"ISA {'−' if value < 0 else '+'} {abs(value):g} K"
    if column == "mach":
        return f"Mach {value:.3g}" if value else "at rest"
    if unit == "Pa":
        return f"{words} {convert(value, unit, 'hPa'):,.5g} hPa"
    if quantity.endswith("temperature") and unit == "K":
        return f"{words} {convert(value, unit, 'degC'):.3g} °C"
    return f"{words} {value:,.4g} {unit.replace('_', '/')}".strip()


@dataclass(frozen=True)
class MarginScale:
    """column: of the hottest recorded temperature, "" where none is recorded; sensor: name of its bias; slope:
    parameter → K per unit of the parameter; nominal_K: of a healthy engine at the reference; reference: the reference
    condition, column → value, power setting included, and `words` for which it is; fixed_column: what was kept,
    "Fn_N", "power_W" or the power setting; reason: why there is none.
    """

    column: str = ""
    sensor: str = ""
    slope: dict[str, float] = field(default_factory=dict)
    nominal_K: float = float("nan")
    reference: dict[str, float] = field(default_factory=dict)
    words: str = ""
    fixed_column: str = ""
    reason: str = ""

    @property
    def place(self) -> str:
        """The reference condition in words, for instance "take-off on a standard hot day (sea level, ISA + 15 K)"."""
        if self.words in (TAKE_OFF, RATING):
            stated = {c: v for c, v in self.reference.items() if c in HOT_DAY and v}
            shown = condition_words({"altitude_m": 0.0, **stated} if "altitude_m" in self.reference else stated)
            return f"{self.words} ({shown})" if shown else self.words
        shown = condition_words(self.reference)
        return f"{self.words} ({shown})" if self.words == HOTTEST else shown

    @property
    def condition(self) -> str:
        """The same with what is held, for instance "…, at equal thrust"."""
        held = self.fixed_column and f"at {HELD.get(self.fixed_column, f'given {self.fixed_column}')}"
        return ", ".join(filter(None, [self.place, held]))


def margin_scale(series: Series, among: Collection[str] = (), at: Mapping[str, float] | None = None) -> MarginScale:
    """The scale of the engine that a series is of, for its rating on a standard hot day; among: columns one of which it
    is, where that is wished; at: inputs that are stated otherwise. Raises DataError for inputs that the engine does not
    have, and where it cannot be computed at a stated condition."""
    monitor = series.monitor
    if monitor is None or monitor.envelope is None:
        return MarginScale(reason="statistics without their engine do not say what a change means for temperatures")
    engine: Any = monitor.engine
    while isinstance(engine, WrappedModel):
        engine = engine.model
    declared = getattr(engine, "declared", None)
    hot = set(hot_columns(declared["components"])) if declared else set()
    columns = [c for c in monitor.sensors if c in engine.sensors and _reads_only(engine.sensors[c], hot)]
    columns = [c for c in columns if not among or c in among]
    if not columns:
        return MarginScale(reason="no temperature of burnt gas is recorded")
    try:
        return _compute_scale(monitor, engine, columns, _reference(monitor, engine, columns, at or {}))
    except KeyError as error:
        return MarginScale(reason=f"the reference condition cannot be computed: {error.args[0]}")


@dataclass(frozen=True)
class ReferencePoint:
    """An operating point of the healthy engine: words for which it is, inputs, its hottest column, and the unknowns
    (nx, 1) that solve it, none where the engine is to find them."""

    words: str
    inputs: dict[str, float]
    column: str
    start: np.ndarray | None = None


def _reference(monitor: Monitor, engine: Any, columns: list[str], at: Mapping[str, float]) -> ReferencePoint | None:
    """Rating on a hot day, inputs as stated `at`; the hottest point of identification where that cannot be computed."""
    known = {*engine.inputs, *engine.optional_inputs}
    for column in at:
        if column not in known:
            raise DataError(f"--at: the engine has no input {column!r}; {near(column, sorted(known))}")
    base = _healthy(monitor, engine)
    inputs = rated_inputs(engine, at) if isinstance(engine, Engine) else None
    why = "its file gives no rating for a power setting"
    if inputs is not None:
        found = engine.predict(inputs, base, sensors=columns, start=design_unknowns(engine))
        if found.ok[0]:
            rating = TAKE_OFF if "altitude_m" in inputs else RATING
            return ReferencePoint(STATED if at else rating, inputs, columns[int(np.argmax(found.y[0]))], found.x)
        why = found.reason(0)
    if at:
        raise DataError(
            f"--at: the engine cannot be computed at {', '.join(f'{c}={v:g}' for c, v in at.items())}: {why}"
        )
    return _hottest_point(monitor, engine, columns, base)


def rated_inputs(engine: Engine, at: Mapping[str, float]) -> dict[str, float] | None:
    """Inputs of an engine at its rating on a hot day, those of `at` as stated; None where the engine file gives neither
    a range of power nor a condition for all of its inputs."""
    condition = design_condition(engine, {**{c: v for c, v in HOT_DAY.items() if c in engine.inputs}, **at})
    if condition is None:
        return None
    inputs = {**condition, **at}
    if engine.power_setting not in at:
        if engine.power_range is None:
            return None
        rating = engine.power_from_fraction(1.0, {**engine.optional_inputs, **inputs})
        inputs[engine.power_setting] = float(np.ravel(rating)[0])
    return inputs


def _healthy(monitor: Monitor, engine: Any) -> dict[str, float]:
    return {name: float(v) for name, v in monitor.base.items() if name in engine.parameters}


def _hottest_point(
    monitor: Monitor, engine: Any, columns: list[str], base: Mapping[str, float]
) -> ReferencePoint | None:
    assert monitor.envelope is not None
    points = np.asarray(monitor.envelope.points)
    some = np.unique(np.linspace(0, len(points) - 1, POINTS).round().astype(int))
    inputs = {c: points[some, i] for i, c in enumerate(monitor.envelope.inputs)}
    found = engine.predict(inputs, base, sensors=columns)
    y = np.where(found.ok[:, None], found.y, -np.inf)
    row, best = np.unravel_index(int(np.argmax(y)), y.shape)
    if not np.isfinite(y[row, best]):
        return None
    return ReferencePoint(HOTTEST, {c: float(v[row]) for c, v in inputs.items()}, columns[best])


def _reads_only(sensor: Any, hot: set[str]) -> bool:
    return sensor.denominator is None and set(sensor.reads) <= hot


def _compute_scale(monitor: Monitor, engine: Any, columns: list[str], point: ReferencePoint | None) -> MarginScale:
    if point is None:
        return MarginScale(reason="the engine computes none of the operating points of its identification")
    base, column, setting = _healthy(monitor, engine), point.column, engine.power_setting
    delivers = [c for c in DELIVERED if c in engine.model_columns and c != setting]
    names = [n for n in monitor.monitored if n in engine.parameters and not monitor.meaning[n].belongs_to_instrument]
    asked = (column, *delivers[:1])
    inputs = {c: np.array([v]) for c, v in point.inputs.items()}
    here = engine.predict(inputs, base, sensors=asked, wrt=(*names, setting), start=point.start)
    J = np.asarray(here.jacobian[0])
    slope, held = J[0, :-1], setting
    if delivers and J[1, -1]:
        slope, held = slope - J[0, -1] * J[1, :-1] / J[1, -1], delivers[0]
    if not np.all(np.isfinite(slope)):
        return MarginScale(reason="the engine has no derivatives at the reference condition")
    sensor = next((p.name for p in engine.sensors[column].parameters() if p.quantity == "bias"), "")
    slopes = dict(zip(names, slope.tolist(), strict=True))
    return MarginScale(column, sensor, slopes, float(here.y[0, 0]), point.inputs, point.words, held)


@dataclass(frozen=True)
class EngineConsumption:
    """Margin that one engine has used, by the account of its history.

    used, used_error (n,): K since nominal, or since the engine's own first flights where these are the reference, at
    each flight, with one standard error; total, total_error (n,): from nominal in any case, which is what is left of a
    limit; margin: as of the last flight, without a forecast; course: for the forecast, None where there is none;
    recovered: number, from 1, of the first flight after maintenance → kelvins that it gave back.
    """

    used: np.ndarray
    used_error: np.ndarray
    total: np.ndarray
    total_error: np.ndarray
    margin: Margin
    course: MarginCourse | None = None
    recovered: Mapping[int, IntervalEstimate] = field(default_factory=dict)

    def withhold(self, reason: str) -> EngineConsumption:
        """Without its figures, where what changed is not known."""
        unknown, nothing = np.full(len(self.used), np.nan), IntervalEstimate()
        margin = replace(self.margin, consumed_K=nothing, now_K=nothing, remaining_flights=nothing, reason=reason)
        return EngineConsumption(unknown, unknown, unknown, unknown, margin)


CANNOT_TELL_WHAT = "cannot tell what changed: something that is not among the suspects"
"""Why no health is read from a history whose change has no suspect."""


def engine_consumption(
    found: EngineTrend, scale: MarginScale, limits_K: Mapping[str, float], baseline: int = 0
) -> EngineConsumption:
    """The margin that an engine has used, from the path of its health, which `judge_history(health=True)` computes.

    Errors of instruments use no margin. limits_K: temperature column → limit at the reference; baseline: first flights
    in which nothing had begun.
    """
    health, epochs = found.posterior.health, found.epochs
    unknown = np.full(found.flights, np.nan)
    reason = scale.reason
    if scale.column and health is None:
        reason = "the path of its health was not computed"
    elif scale.column and found.posterior.unlisted >= EVENT:
        reason = CANNOT_TELL_WHAT
    if reason or health is None:
        none = Margin(scale.column, scale.condition, reason=reason)
        return EngineConsumption(unknown, unknown, unknown, unknown, none)
    own = np.array([scale.slope.get(name, 0.0) for name in health.parameters])
    slope = health.reading_slope(own, scale.sensor)
    (used, error), (total, total_error) = health.project_level(slope), health.project_level(slope, total=True)
    limit = limits_K.get(scale.column, float("nan"))
    gone, left = interval_estimate(used[-1], error[-1]), interval_estimate(total[-1], total_error[-1])
    left = IntervalEstimate(*(limit - scale.nominal_K - x for x in (left.value, left.high, left.low)))
    recovered = {}
    for step in health.steps:
        deviation = float(np.sqrt(max(slope @ step.covariance @ slope, 0.0)))
        recovered[found.flight_number(step.epoch)] = interval_estimate(-float(step.change @ slope), deviation)
    return EngineConsumption(
        used[epochs],
        error[epochs],
        total[epochs],
        total_error[epochs],
        Margin(scale.column, scale.condition, limit, gone, left),
        _margin_course(found, health, own, baseline),
        recovered,
    )


@dataclass(frozen=True)
class PowerCourse:
    """Power or thrust available at the first limit that binds, in the unit of `column`.

    value, error (n,): in each flight, with one standard error, NaN where it is not known; nominal: of the healthy
    engine; limited_by (n,): column of the limit; condition: at which it is; reason: why it is not known.
    """

    column: str = ""
    value: np.ndarray = field(default_factory=lambda: np.zeros(0))
    error: np.ndarray = field(default_factory=lambda: np.zeros(0))
    nominal: float = float("nan")
    limited_by: tuple[str, ...] = ()
    condition: str = ""
    reason: str = ""

    @property
    def now(self) -> PowerAvailable:
        """Of the last flight."""
        if not len(self.value):
            return PowerAvailable(reason=self.reason)
        estimate = interval_estimate(self.value[-1], self.error[-1])
        return PowerAvailable(self.column, estimate, self.nominal, self.limited_by[-1], self.condition, self.reason)


def check_limits(engine: Any, limits: Mapping[str, float], where: str) -> None:
    """Raise DataError, about what states them, for limits of columns that the engine does not have."""
    known = {*engine.model_columns, *engine.sensors, engine.power_setting}
    for column in limits:
        if column not in known:
            raise DataError(f"{where}: the engine has no column {column!r}; {near(column, sorted(known))}")


def available_power(
    found: EngineTrend,
    scoping: WorkScopeEstimator,
    scale: MarginScale,
    limits: Mapping[str, float],
    *,
    last: bool = False,
) -> PowerCourse:
    """What an engine delivers at its limits in each of its flights, with the health that it had there: solutions of the
    engine model, at the reference condition of the scale. limits: column of the model → limit in its unit; last: of the
    last flight alone. Raises DataError for a column that the engine does not have."""
    engine, health = scoping.engine, found.posterior.health
    if engine is None or health is None or not scale.reference or not limits:
        return PowerCourse(reason=scale.reason or NO_LIMIT)
    check_limits(engine, limits, "--limit")
    every = (*health.parameters, *health.readings)
    at = [i for i, name in enumerate(every) if name in engine.parameters]
    names = [every[i] for i in at]
    shown = slice(-1, None) if last else slice(None)
    states = np.concatenate([np.zeros((1, len(at))), health.total[shown, at]])
    try:
        solved = solve_at_limits(engine, scale.reference, scoping.base, names, states, limits)
    except PowerNotHeldError as error:
        return PowerCourse(reason=str(error))
    slopes, C = solved.slopes[1:], health.total_covariance[shown][:, at][:, :, at]
    deviation = np.sqrt(np.maximum(np.einsum("ti,tij,tj->t", slopes, C, slopes), 0.0))
    epochs = np.zeros(1, int) if last else found.epochs
    return PowerCourse(
        solved.column,
        solved.value[1:][epochs],
        deviation[epochs],
        float(solved.value[0]),
        tuple(solved.limited_by[1 + k] for k in epochs),
        scale.place,
        solved.reason,
    )


def interval_estimate(value: float, deviation: float) -> IntervalEstimate:
    """A normal law's mean with its 95 % interval."""
    half = NORMAL_95 * float(deviation)
    return IntervalEstimate(float(value), float(value) - half, float(value) + half)


def _margin_course(found: EngineTrend, health: HealthPath, slope: np.ndarray, baseline: int) -> MarginCourse | None:
    """What a law of growth is fitted to: each stretch of flights by itself, since the `baseline` first flights."""
    if len(health.knots) < 3:
        return None
    y, noise = health.project_stretches(slope)
    first = np.array([found.flight_number(k) for k in health.knots], float)
    last = np.append(first[1:] - 1, found.flights)
    t = 0.5 * (first + last) - baseline
    changes = [event for event in found.events if not event.instrument]
    abrupt = [event for event in changes if found.family(event) == STEP]
    started = any(found.family(event) == FROM_START for event in changes)
    numbers = {found.flight_number(k) for k in (*(step.epoch for step in health.steps), *(e.onset for e in abrupt))}
    events = [number - baseline for number in sorted(numbers)]
    settling = [event for event in changes if event.kind in (SATURATING, RAMP_HOLD)]
    levelled = [_levelled_course(found, event, health, slope) for event in settling]
    courses = [(course[health.knots], ahead) for course, ahead in filter(None, levelled)]
    steps = (t[:, None] >= np.array(events, float)).astype(float).reshape(len(t), len(events))
    steps = np.column_stack([steps, *(course for course, _ in courses)])
    # what is common to all stretches, such as the engine's own level, is in their errors, but for what it began with;
    # what came at once, or came and levelled out, is no growth
    offset, step = ABRUPT_K if started else 0.0, ABRUPT_K if abrupt or courses else RECOVERED_K
    ahead = np.array([0.0] * len(events) + [share for _, share in courses])
    return MarginCourse(t, y, noise, float(found.flights - baseline), steps, offset, step, ahead)


def _levelled_course(
    found: EngineTrend, event: ChangeEvent, health: HealthPath, slope: np.ndarray
) -> tuple[np.ndarray, float] | None:
    """Consumption (T,) by an event that levels out, 1 now, and how much of that is still to come; None where it is
    over, or uses no margin. The approach is exponential: 1 − exp(−t/τ) since the onset, τ by least squares."""
    posterior = found.posterior
    moved = {part.name for part in event.changes}
    weight = np.zeros(len(posterior.parameters))
    for i, name in enumerate(health.parameters):
        weight[posterior.parameters.index(name)] = slope[i] * (name in moved)
    course = posterior.level @ weight
    if event.end >= 0 or not course[-1]:
        return None
    course = course / course[-1]
    if event.kind == RAMP_HOLD:
        return course, 0.0
    since = np.maximum(np.arange(len(course)) - event.onset + 1.0, 0.0)
    approach = -np.expm1(-since / np.geomspace(1.0, len(course), APPROACHES)[:, None])
    shapes = approach / approach[:, -1:]
    best = int(np.argmin(np.sum((shapes - course) ** 2, axis=1)))
    return course, float(1.0 / approach[best, -1] - 1.0)


APPROACHES = 60
"""Time constants of an approach that are tried, from one epoch to all: each a tenth larger than the one before."""


def engine_severity(found: EngineTrend, used: EngineConsumption, known: Sequence[Parameter]) -> IntervalEstimate:
    """How far an engine has gone: of its margin, or without a temperature, the length of the change of its health
    in prior standard deviations; known: what its parameters are."""
    if used.margin.column:
        return used.margin.consumed_K
    health = found.posterior.health
    if health is None:
        return IntervalEstimate()
    unit = {p.name: p.prior_sigma for p in known}
    D = np.array([unit[name] for name in health.parameters])
    q = len(D)
    level, C = health.level[-1, :q] / D, health.covariance[-1, :q, :q] / D / D[:, None]
    length = float(np.linalg.norm(level))
    error = float(np.sqrt(level @ C @ level) / max(length, 1e-12))
    return IntervalEstimate(length, max(length - NORMAL_95 * error, 0.0), length + NORMAL_95 * error)


LEARNT_FROM = 300
"""Engines from which it is learnt how the fleet wears, evenly chosen where there are more: it is known well by then."""
LIVES = 3
"""Whole lives from which a limit is learnt at least: with two the spread between engines is not known."""
NEVER_K = 1e9
"""A limit that is not reached, where only the consumption so far is required."""
ABRUPT_K = 30.0
"""Standard deviation of what an abrupt change costs of a margin, in K: 2 % of a turbine's efficiency cost 20."""
RECOVERED_K = 10.0
"""Standard deviation of what maintenance may bring of a margin, in K: washes bring up to as much."""


def margin_limit(finding: EngineFinding, settings: FleetSettings) -> tuple[float, float] | None:
    """Consumption, in K, at which the limit is reached, with its standard deviation; None where there is no limit."""
    margin = finding.margin
    if not margin.column:
        return None
    if np.isfinite(margin.limit_K):
        return margin.now_K.value + margin.consumed_K.value, 0.0
    return settings.consumed_limit_K


def learnt_limit(failed: Sequence[EngineFinding]) -> tuple[float, float]:
    """Consumption, in K, at which engines were removed from wing, and its standard deviation between them, from the
    findings of their whole lives: what `FleetSettings.consumed_limit_K` asks for. ValueError for fewer than three."""
    courses = [f.course for f in failed if f.course is not None]
    if len(courses) < LIVES:
        raise ValueError(f"a limit is learnt from {LIVES} lives at least, and {len(courses)} can be followed")
    reference = float(np.nanmedian([f.severity.value for f in failed]))
    fits = [fit_laws(c, reference) for c in courses]
    return removal_limit(*final_consumption(fits, learn_population(fits)))


def learn_removal_limit(
    settings: FleetSettings, findings: Sequence[EngineFinding], named: Sequence[str], where: str
) -> FleetSettings:
    """The settings with the limit that engines had reached when they were removed from wing, where some are `named`;
    where: what names them. Raises DataError for one that is not among the findings, and where they do not determine a
    limit."""
    if not named:
        return settings
    known = {finding.serial: finding for finding in findings}
    for serial in named:
        if serial not in known:
            hint = near(serial, known) if any(known) else "the recordings name no engines, as a column `engine` does"
            raise DataError(f"{where} names engine {serial}, which is not judged; {hint}")
    try:
        limit = learnt_limit([known[serial] for serial in dict.fromkeys(named)])
    except ValueError as error:
        raise DataError(f"{where}: {error}") from None
    return replace(settings, consumed_limit_K=limit)


def final_consumption(fits: Sequence[FittedLaws], population: Population) -> tuple[np.ndarray, np.ndarray]:
    """Consumption (n,) at the end of each course, with its standard error (n,)."""
    ends = [forecast(fit, population, NEVER_K) for fit in fits]
    return np.array([e.level for e in ends]), np.array([e.level_error for e in ends])


def removal_limit(level: np.ndarray, error: np.ndarray) -> tuple[float, float]:
    """Mean of the ends of lives and their standard deviation, what they are known to taken out."""
    spread = float(np.sqrt(max(level.var(ddof=1) - float(np.mean(error**2)), 0.0)))
    return float(level.mean()), spread


def add_forecasts(findings: Sequence[EngineFinding], settings: FleetSettings) -> list[EngineFinding]:
    """The findings with the flights that remain to the limit, or the reason why that is not known."""
    limits = [margin_limit(f, settings) for f in findings]
    stated = [x[0] for x in limits if x is not None and x[0] > 0]
    if not stated:
        reasons = [NO_LIMIT if x is None or np.isnan(x[0]) else PASSED for x in limits]
        return [_no_forecast(f, reason) for f, reason in zip(findings, reasons, strict=True)]
    reference = float(np.median(stated))
    at = [k for k, x in enumerate(limits) if x is not None]
    some = np.unique(np.linspace(0, len(at) - 1, LEARNT_FROM).round().astype(int))
    courses = [findings[at[k]].course for k in some.tolist()]
    population = learn_population([fit_laws(c, reference) for c in courses if c is not None])
    return [_add_forecast(f, x, reference, population) for f, x in zip(findings, limits, strict=True)]


def _add_forecast(
    finding: EngineFinding, limit: tuple[float, float] | None, reference: float, population: Population
) -> EngineFinding:
    if limit is None:
        return _no_forecast(finding, NO_LIMIT)
    course = finding.course
    if course is None or not np.isfinite(finding.margin.consumed_K.value):
        return _no_forecast(finding, "too few flights show the margin")
    found = forecast(fit_laws(course, reference), population, *limit)
    half = NORMAL_95 * found.rate_error
    median = found.quantile(0.5) if found.shows_growth else float("inf")  # else how soon is not shown, only how late
    margin = replace(
        finding.margin,
        remaining_flights=IntervalEstimate(median, found.quantile(0.05), found.quantile(0.95)),
        rate_K_per_flight=IntervalEstimate(found.rate, found.rate - half, found.rate + half),
    )
    return replace(finding, margin=margin)


def _no_forecast(finding: EngineFinding, reason: str) -> EngineFinding:
    return replace(finding, margin=replace(finding.margin, reason=finding.margin.reason or reason))
