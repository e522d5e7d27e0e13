"""Findings of an engine and of a fleet, the flights of an engine that they rest on, and the course of its health.

The course of health over flights, and the effect of maintenance, are one Gaussian posterior:

    z_i = B x_i + J_i δ(i) + ε_i,    δ(i) = Σ_k a_k φ_k(i) + Σ_e r_e 1(i ≥ t_e),    ε_i ~ N(0, Σ)

with φ_k rising from 0 to 1 over the k-th piece of the flights after the baseline, a_k ~ N(0, D² Δ_k): a walk that by
the end may be as far from nominal as a change plausibly is, straight within pieces; r_e what maintenance may have
moved. B, level and what follows the conditions, is eliminated.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field, replace
from math import nan

import numpy as np

from enginediag_cli.detection.forecast import MarginCourse
from enginediag_cli.detection.series import FlightWindow, Readings, Series
from enginediag_cli.engine.wrapped import WrappedModel
from enginediag_cli.errors import DataError
from enginediag_cli.history.engines import EngineSums
from enginediag_cli.parameters import Parameter
from enginediag_cli.residuals.instruments import FaultInFlights

KINDS = ("wash", "overhaul", "exchange")
"""Of maintenance: a compressor wash; an overhaul of the engine, or of the component that is named; its exchange."""


@dataclass(frozen=True)
class MaintenanceEvent:
    """Maintenance of an engine. kind: one of KINDS. `flight`: the first flight after it, or `time_s`: when it was; one
    of both. component: what it was done to, "" for the whole engine."""

    engine: str
    kind: str
    flight: str = ""
    time_s: float = nan
    component: str = ""


@dataclass(frozen=True)
class EngineHistory:
    """One engine by serial number. stretches: one per flight, in order; sums: of their statistics, with what is
    uncertain about nominal; baseline: how many of the first flights are believed healthy."""

    serial: str
    build: str
    stretches: Sequence[FlightWindow]
    sums: EngineSums
    baseline: int
    events: Sequence[MaintenanceEvent] = ()


HEALTHY, CHANGED, NO_VERDICT = "healthy", "changed", "no verdict"


@dataclass(frozen=True, slots=True)
class IntervalEstimate:
    """A value with its 95 % interval; NaN where it is not known."""

    value: float = nan
    low: float = nan
    high: float = nan


@dataclass(frozen=True, slots=True)
class HealthRow:
    """One parameter of an engine. change: now, from its baseline, of what comes and goes the largest, in `unit`,
    NaN where no event moved it; onset: number
    of the first changed flight, from 1, with its interval, 0 where nothing changed; kind: "steady", or how an event
    came; probability: that it has changed at all; family, quantity, part: as of the `Parameter`."""

    parameter: str
    component: str
    words: str
    unit: str
    change: IntervalEstimate
    kind: str
    probability: float
    onset: int = 0
    onset_low: int = 0
    onset_high: int = 0
    onset_flight: str = ""
    rate_per_flight: IntervalEstimate = IntervalEstimate()
    family: str = ""
    quantity: str = ""
    part: str = ""


@dataclass(frozen=True, slots=True)
class AcknowledgedChange:
    """Change of a parameter when it was acknowledged, in `unit`."""

    parameter: str
    change: IntervalEstimate
    unit: str

    def grew(self, row: HealthRow) -> bool:
        """Whether the change is now beyond the far end of its interval then, or of the other sign."""
        before, now = self.change, row.change
        if before.value < 0:
            return now.value < before.low or now.low > 0
        return now.value > before.high or now.high < 0


@dataclass(frozen=True, slots=True)
class Acknowledgement:
    """That somebody knows what was found in an engine: on which date, after how many flights, the changes as they were
    then, and a note. grown: parameters that have changed since, beyond the interval of then, or that are new."""

    serial: str
    date: str
    flights: int
    changes: tuple[AcknowledgedChange, ...]
    note: str = ""
    grown: tuple[str, ...] = ()


LIKELY = 0.5
"""Probability from which a parameter counts as changed."""


@dataclass(frozen=True, slots=True)
class FlightRow:
    """One flight. verdict: of the baseline, changed from the onset on, or that of the engine; consumed: of the margin,
    in K, at this flight, with one standard error."""

    number: int
    flight: str
    records: int
    verdict: str
    consumed_K: float = nan
    consumed_error_K: float = nan


@dataclass(frozen=True, slots=True)
class EventRow:
    """What a maintenance event brought. number: of the first flight after it, 0 where no flight is after it;
    gains: parameter → change across the event, in its unit; recovered_K: of the margin."""

    event: MaintenanceEvent
    number: int
    gains: Mapping[str, IntervalEstimate]
    recovered_K: IntervalEstimate = IntervalEstimate()
    reason: str = ""


@dataclass(frozen=True, slots=True)
class Margin:
    """Margin of the hottest recorded temperature. column: which ("T5_K"); limit_K: NaN where none is stated;
    consumed_K: by deterioration so far, at the reference condition; now_K: what is left; remaining_flights: until the
    limit is reached, median and 90 % interval, infinite where that may be never; reason: why there is no forecast, or
    ""."""

    column: str = ""
    condition: str = ""
    limit_K: float = nan
    consumed_K: IntervalEstimate = IntervalEstimate()
    now_K: IntervalEstimate = IntervalEstimate()
    remaining_flights: IntervalEstimate = IntervalEstimate()
    rate_K_per_flight: IntervalEstimate = IntervalEstimate()
    reason: str = ""


@dataclass(frozen=True, slots=True)
class PowerAvailable:
    """Power or thrust at the first limit that binds, with the health of the last flight. column: which, "power_W" or
    "Fn_N", in whose unit value and nominal are, that of the healthy engine; limited_by: column of the limit; condition:
    at which; reason: why it is unknown, or ""."""

    column: str = ""
    value: IntervalEstimate = IntervalEstimate()
    nominal: float = nan
    limited_by: str = ""
    condition: str = ""
    reason: str = ""


@dataclass(frozen=True)
class FinalReadings:
    """What the last flights of an engine read beside its baseline, for what is common to a fleet: off (m,), in units of
    the noise, with the covariance (m, m) of its scatter; effect (m, p) of one prior standard deviation `unit` (p,) of
    each parameter."""

    parameters: tuple[str, ...]
    unit: np.ndarray
    deviation: np.ndarray
    covariance: np.ndarray
    effect: np.ndarray


@dataclass(frozen=True)
class HealthChange:
    """What an event of maintenance did to parameters `names`, as one Gaussian of `mean` (k,) and `covariance` (k, k),
    and their change `before` (k,) it, all in their units."""

    names: tuple[str, ...]
    initial: np.ndarray
    mean: np.ndarray
    covariance: np.ndarray


@dataclass(frozen=True)
class EngineFinding:
    """The finding of one engine.

    Attributes
    ----------
    flights, records : int
        How many it has.
    verdict, reason : str
        HEALTHY, CHANGED or NO_VERDICT, and why.
    probability : float
        That it changed after it began to fly; NaN where it was not judged.
    prior : float
        The same before its flights are seen; NaN where it was not judged.
    discovery : bool
        Whether the fleet flags it.
    since, since_low, since_high : int
        Number of the first changed flight, from 1, with its 95 % interval; 0 without a change.
    severity, severity_unit : IntervalEstimate, str
        Distance gone towards the limit, in "K" of the margin, or in "sigma", prior standard deviations.
    unlisted : float
        Probability that what happened is none of the suspects'; NaN where it was not judged.
    health : sequence of HealthRow
        Parameters.
    by_flight : sequence of FlightRow
        Flights.
    events : sequence of EventRow
        Maintenance.
    margin : Margin
        EGT margin.
    power : PowerAvailable
        Power or thrust available now, where a limit is stated.
    baseline : int
        First flights, believed healthy.
    course : MarginCourse or None
        What a law of growth is fitted to for the forecast.
    state : FinalReadings or None
        Last flights against the baseline.
    event_changes : sequence of HealthChange or None
        Effect of each event; None where it is not known.
    instruments : sequence of FaultInFlights
        Instruments that are stuck or scatter in some of its flights.
    acknowledged : Acknowledgement or None
        What is known of it already.
    """

    serial: str
    build: str
    flights: int
    records: int
    verdict: str
    reason: str
    probability: float = nan
    prior: float = nan
    discovery: bool = False
    since: int = 0
    since_low: int = 0
    since_high: int = 0
    since_flight: str = ""
    severity: IntervalEstimate = IntervalEstimate()
    severity_unit: str = ""
    unlisted: float = nan
    health: Sequence[HealthRow] = ()
    by_flight: Sequence[FlightRow] = ()
    events: Sequence[EventRow] = ()
    margin: Margin = Margin()
    power: PowerAvailable = PowerAvailable()
    baseline: int = 0
    course: MarginCourse | None = field(default=None, repr=False, compare=False)
    state: FinalReadings | None = field(default=None, repr=False, compare=False)
    event_changes: Sequence[HealthChange | None] = field(default=(), repr=False, compare=False)
    instruments: Sequence[FaultInFlights] = ()
    acknowledged: Acknowledgement | None = None

    @property
    def changed_rows(self) -> list[HealthRow]:
        """Parameters that have changed, most probable first."""
        return sorted((r for r in self.health if r.probability >= LIKELY and r.onset), key=lambda r: -r.probability)

    @property
    def is_settled(self) -> bool:
        """Whether all that has changed is acknowledged, and none of it has grown."""
        return self.acknowledged is not None and not self.acknowledged.grown

    def compare_acknowledged(self, before: Acknowledgement) -> EngineFinding:
        """The finding beside what was acknowledged."""
        known = {x.parameter: x for x in before.changes}
        grown = (r.parameter for r in self.changed_rows if r.parameter not in known or known[r.parameter].grew(r))
        found = replace(self, acknowledged=replace(before, grown=tuple(grown)))
        return replace(found, discovery=found.discovery and not found.is_settled)


@dataclass(frozen=True)
class CommonChange:
    """Change of a parameter over the fleet.

    Attributes
    ----------
    mean : IntervalEstimate
        Mean of the changes, with its 95 % interval.
    spread : float
        Standard deviation between engines.
    engines : int
        Engines that it is of.
    alike : float
        Share of engines whose change has the sign of the mean.
    probability : float
        That this component, or instrument, is what the engines have in common.
    common : bool
        Whether it is one of those that hold 95 % of the probability, where most engines have changed in the same way.
    reading : str
        What it may be, in words.
    """

    parameter: str
    component: str
    words: str
    unit: str
    mean: IntervalEstimate
    spread: float
    engines: int
    alike: float
    probability: float
    common: bool
    reading: str = ""


@dataclass(frozen=True)
class FlaggedEngines:
    """Engines flagged.

    Attributes
    ----------
    engines : sequence of str
        Serial numbers, most probable change first.
    level : float
        False discovery rate that was required.
    expected : float
        Share of healthy engines among them, by their probabilities.
    words : str
        The same in a sentence.
    """

    engines: Sequence[str]
    level: float
    expected: float
    words: str


@dataclass(frozen=True)
class FleetFinding:
    """The finding of a fleet.

    Attributes
    ----------
    engines : sequence of EngineFinding
        By severity, worst first.
    flagged : FlaggedEngines
        Engines flagged at the false discovery rate.
    common : sequence of CommonChange
        Changes that engines have in common.
    excluded : sequence of (str, str)
        Serial number, and why it has no verdict.
    """

    engines: Sequence[EngineFinding]
    flagged: FlaggedEngines
    common: Sequence[CommonChange]
    excluded: Sequence[tuple[str, str]]


def apply_acknowledgements(found: FleetFinding, known: Mapping[str, Acknowledgement]) -> FleetFinding:
    """The findings without raising again what is acknowledged, as long as it does not grow."""
    engines = tuple(x.compare_acknowledged(known[x.serial]) if x.serial in known else x for x in found.engines)
    settled = {x.serial for x in engines if x.is_settled}
    raised = tuple(serial for serial in found.flagged.engines if serial not in settled)
    count, words = len(found.flagged.engines) - len(raised), found.flagged.words
    if count:
        words += f"; {count} of them acknowledged and not raised again"
    return replace(found, engines=engines, flagged=replace(found.flagged, engines=raised, words=words))


def acknowledge_finding(
    found: EngineFinding, date: str, note: str = "", parameters: Collection[str] = ()
) -> Acknowledgement:
    """What is acknowledged of an engine: all that has changed, or these parameters. Raises DataError."""
    rows = [r for r in found.changed_rows if not parameters or r.parameter in parameters]
    missing = [name for name in parameters if name not in {r.parameter for r in rows}]
    if missing or not rows:
        has = ", ".join(r.parameter for r in found.changed_rows) or f"none (verdict: {found.verdict})"
        what = f"{', '.join(missing)} has not changed" if missing else "there is no change to acknowledge"
        raise DataError(f"engine {found.serial}: {what}; changed: {has}")
    changes = tuple(AcknowledgedChange(r.parameter, r.change, r.unit) for r in rows)
    return Acknowledgement(found.serial, date, found.flights, changes, note)


@dataclass(frozen=True)
class FleetSettings:
    """How a fleet is judged.

    Attributes
    ----------
    false_discovery : float
        Share of healthy engines among those flagged, on average.
    sensors : bool
        Whether instruments are suspects.
    limits_K : mapping of str to float
        Temperature column → its limit at the reference condition, K.
    consumed_limit_K : tuple of float or None
        Margin used at which an engine is removed from wing, with its standard deviation, K; where no limit of a
        temperature is known, as from engines that were removed.
    """

    false_discovery: float = 0.05
    sensors: bool = True
    limits_K: Mapping[str, float] = field(default_factory=dict)
    consumed_limit_K: tuple[float, float] | None = None


@dataclass(frozen=True)
class EngineFlights:
    """The readings of the m output sensors alone, z (n, m), with the effects J (n, m, p) of all p parameters; steps
    (n, e): 1 from the first flight after each of the `events` on; number (n,): of each flight, from 0."""

    readings: Readings
    z: np.ndarray
    J: np.ndarray
    noise: np.ndarray
    described: tuple[Parameter, ...]
    steps: np.ndarray
    events: tuple[MaintenanceEvent, ...]
    number: np.ndarray
    weight: np.ndarray
    baseline: int

    def __len__(self) -> int:
        return len(self.z)

    def scatter(self) -> np.ndarray:
        """Covariance (m, m) of what readings differ by from one flight to the next, with that of their noise as a prior
        that counts for m + 3 flights."""
        m = self.z.shape[1]
        kept = np.abs(np.diff(self.steps, axis=0)).sum(axis=1) == 0 if self.steps.size else np.ones(len(self) - 1, bool)
        d = (np.diff(self.z, axis=0) * self.weight[1:, None] / np.sqrt(2))[kept]
        size = np.einsum("nm,mk,nk->n", d, np.linalg.inv(self.noise * _noise_share(d, self.noise)), d) / m
        d = d * np.minimum(1.0, LARGE / np.sqrt(np.maximum(size, 1e-12)))[:, None]  # a jump is no scatter
        return np.asarray((2 * self.noise + d.T @ d) / (2 + len(d)))


LARGE = 3.0
"""Standard deviations beyond which a difference of two flights is drawn in: no more than one of a hundred."""


def _noise_share(d: np.ndarray, noise: np.ndarray) -> float:
    """What differences (n, m) usually are of their noise."""
    if not len(d):
        return 1.0
    square = np.einsum("nm,mk,nk->n", d, np.linalg.inv(noise), d) / len(noise)
    return float(max(np.median(square), 0.25))


def engine_flights(history: EngineHistory, series: Series) -> EngineFlights:
    """The flights of a history. Raises DataError when they have statistics of different parameters."""
    mine = replace(series, stretches={history.serial: history.stretches})
    readings = mine.readings(history.serial)
    described = tuple(series.parameters[name] for name in readings.parameters)
    events, steps = _event_steps(history, readings)
    return EngineFlights(
        readings,
        readings.z,
        readings.J,
        readings.noise,
        described,
        steps,
        events,
        readings.number,
        _flight_weights(history, readings),
        int(np.searchsorted(readings.number, history.baseline)),
    )


def _flight_weights(history: EngineHistory, readings: Readings) -> np.ndarray:
    """Square root of the information of each flight relative to a usual one, 1 at most: by its records."""
    records = np.array([max(history.stretches[k].stored.n, 1) for k in readings.number], float)
    return np.asarray(np.minimum(1.0, np.sqrt(records / np.median(records))))


def event_number(event: MaintenanceEvent, history: EngineHistory) -> int:
    """Number of the first flight after an event, from 0; the number of flights where none is after it. By the label of
    the flight, by its count where flights have no labels, else by the time."""
    windows = [x.window for x in history.stretches]
    if event.flight:
        labels = [w.flight for w in windows]
        if event.flight in labels:
            return labels.index(event.flight)
        if not any(labels) and event.flight.isdigit():
            return min(max(int(event.flight) - 1, 0), len(windows))
        return len(windows)
    after = [k for k, w in enumerate(windows) if w.start_s >= event.time_s]
    return after[0] if after else len(windows)


def _event_steps(history: EngineHistory, readings: Readings) -> tuple[tuple[MaintenanceEvent, ...], np.ndarray]:
    told, columns = [], []
    for event in history.events:
        column = (readings.number >= event_number(event, history)).astype(float)
        if column.any() and not column.all():
            told.append(event)
            columns.append(column)
    return tuple(told), np.array(columns).T.reshape(len(readings), len(columns))


def movable_parameters(
    event: MaintenanceEvent, described: Sequence[Parameter], compressors: Collection[str]
) -> Mapping[int, float]:
    """Positions of the parameters that an event may have moved, with the standard deviation of that beforehand, in
    prior standard deviations. A wash moves what fouling moves, an overhaul or an exchange all of its component."""
    found = {}
    for i, p in enumerate(described):
        if p.belongs_to_instrument:
            continue
        if event.kind == "wash":
            if p.component in compressors or not compressors:
                found[i] = WASHED
        elif not event.component or p.component == event.component:
            found[i] = EXCHANGED
    return found


WASHED = 0.5
"""What a wash brings, in prior standard deviations: half of what fouling plausibly takes."""
EXCHANGED = 1.5
"""What an exchange may bring: the wear of the old component and the difference of the new one."""


def washable_components(series: Series) -> frozenset[str]:
    """Components that a wash cleans; none where the engine is not at hand."""
    engine = None if series.monitor is None else series.monitor.engine
    while isinstance(engine, WrappedModel):
        engine = engine.model
    declared = getattr(engine, "declared", None)
    return (
        frozenset(c["name"] for c in declared["components"] if c["type"] == "compressor") if declared else frozenset()
    )
