"""What is found of an engine and of a fleet: plain values, for tables, files and reports.

What is known of an engine by serial number: its flights in order, and what maintenance did to it.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from math import nan

import numpy as np

from enginediag_cli.detection.series import FlightWindow
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
    """One engine by serial number. stretches: one per flight, in order; baseline: how many of the first of them are
    believed healthy."""

    serial: str
    build: str
    stretches: Sequence[FlightWindow]
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
    """One parameter of an engine. change: now, from its baseline, in `unit`; onset: number of the first changed flight,
    from 1, with its interval, 0 where nothing changed; kind: "steady", "step" or "deterioration"; probability: that it
    has changed at all."""

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


@dataclass(frozen=True, slots=True)
class FlightRow:
    """One flight. log10_e: of all flights up to this one; p_value: of an alarm at any flight up to this one, 1/max E;
    verdict: as far as the flights up to this one say; consumed: of the margin, in K, by this flight alone, with one
    standard error."""

    number: int
    flight: str
    records: int
    log10_e: float
    p_value: float
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
    before: np.ndarray
    mean: np.ndarray
    covariance: np.ndarray


@dataclass(frozen=True)
class EngineFinding:
    """What the history of one engine says. flights, records: how many; verdict: HEALTHY, CHANGED or NO_VERDICT, and its
    `reason`; log10_e: of the sequential test at the end of its data; discovery: whether the fleet's list holds it;
    since: number of the first changed flight, from 1, with its 95 % interval, 0 where nothing is found; severity: how
    far it has gone towards its limit, in `severity_unit` ("K" of the margin, or "sigma", prior standard deviations);
    unlisted: probability that what changed is something that is not among the suspects, NaN where it was not asked;
    event_changes: what each of the events did, None where that is not known; instruments: those that are stuck or
    scatter in some of its flights."""

    serial: str
    build: str
    flights: int
    records: int
    verdict: str
    reason: str
    log10_e: float = nan
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
    baseline: int = 0
    state: FinalReadings | None = field(default=None, repr=False, compare=False)
    event_changes: Sequence[HealthChange | None] = field(default=(), repr=False, compare=False)
    instruments: Sequence[FaultInFlights] = ()


@dataclass(frozen=True)
class CommonChange:
    """A parameter over the fleet, as if its component, or instrument, were what engines have in common. mean: of the
    changes, with its 95 % interval; spread: standard deviation between engines; alike: share of engines whose change
    goes the way of the mean; probability: that it is this component; common: whether it is one of those that hold 95 %
    of it, where most engines have moved alike; reading: what that may be, in words."""

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
class Discoveries:
    """engines: serial numbers, largest e-value first; level: the bound; words: what it says."""

    engines: Sequence[str]
    level: float
    words: str


@dataclass(frozen=True)
class FleetFinding:
    """engines: ranked by severity, worst first; left_out: serial number and why it has no verdict."""

    engines: Sequence[EngineFinding]
    discoveries: Discoveries
    common: Sequence[CommonChange]
    left_out: Sequence[tuple[str, str]]


@dataclass(frozen=True)
class FleetSettings:
    """How a fleet is judged. false_alarm: of the verdict on one engine, over its whole life; false_discovery: share of
    healthy engines among those listed, on average; sensors: instruments are suspects; generic: the maps are not the
    engine's own; limits_K: column → limit of its temperature at the reference condition; consumed_limit_K: K of margin
    at which an engine is taken off, with its standard deviation, where that and no temperature is known, as from
    engines that were; thorough: engines that stand out are judged as `trend` does, at a second each; onsets: since
    when they have changed is asked, which takes longest of very many flights."""

    false_alarm: float = 0.01
    false_discovery: float = 0.05
    sensors: bool = True
    generic: bool = True
    limits_K: Mapping[str, float] = field(default_factory=dict)
    consumed_limit_K: tuple[float, float] | None = None
    thorough: bool = True
    onsets: bool = True
