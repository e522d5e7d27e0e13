"""`trend --what margin` and `fleet`: their tables, documents and words.

The EGT margin left, what maintenance restored, and the flights to the limit; the findings of a fleet.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import asdict, replace
from typing import TYPE_CHECKING, Any, NamedTuple

from enginediag_cli.fleets.findings import IntervalEstimate
from enginediag_cli.fleets.margin import NO_LIMIT, interval_estimate
from enginediag_cli.fleets.work_scope import POWER, THRUST
from enginediag_cli.probability import NORMAL_95
from enginediag_cli.report.messages import Messages
from enginediag_cli.report.sentences import (
    change,
    count,
    format_quantity,
    instrument_in_flights,
    listed,
    maintained,
)
from enginediag_cli.report.tables import Column, Columns, Table
from enginediag_cli.report.tables.answers import gain_cells, gain_words
from enginediag_cli.report.tables.recordings import not_judged_lines, outside_envelope_lines
from enginediag_cli.units import split_column

if TYPE_CHECKING:
    from enginediag_cli.detection.series import FlightWindow, Series
    from enginediag_cli.fleets.findings import AcknowledgedChange, EngineFinding, EventRow, Margin, PowerAvailable
    from enginediag_cli.fleets.maintenance import EngineMargin, EventEffect, SeriesMargins
    from enginediag_cli.fleets.models import BuildModel, MergeCounts, StoreStatus
    from enginediag_cli.fleets.run import FleetRun
    from enginediag_cli.fleets.work_scope import Gain, PowerReference
    from enginediag_cli.parameters import Parameter
    from enginediag_cli.report.plotting.health import MarginRecord, PowerRecord
    from enginediag_cli.residuals.instruments import FaultInFlights


part_column: Columns[Any] = Columns()
FLIGHT, MAINTENANCE, WHOLE = "flight", "maintenance", "margin"
"""What a row is about, in its cell `row`."""
AS_MUCH = "until as much is lost as when engines are removed from wing"
"""The limit where no temperature is stated."""
NO_GROWTH_SHOWN = "no growth shown at present"
"""What is said of the flights to a limit where these need not lead to it."""


def interval_columns(name: str) -> tuple[str, str, str]:
    """A column of the margin's table, and those of its interval: used_K, used_low, used_high."""
    stem = name.removesuffix("_K")
    return name, f"{stem}_low", f"{stem}_high"


class FlightPower(NamedTuple):
    """Power or thrust `column` available in one flight, in its unit, nominal that of the healthy engine."""

    column: str
    value: float
    error: float
    nominal: float
    limited_by: str

    def estimate(self, column: str, factor: float = 1.0) -> IntervalEstimate:
        """In the unit of the column divided by `factor`; nothing where another column is what it delivers."""
        found = interval_estimate(self.value, self.error)
        return _scaled(found, 0.0, factor) if self.column == column else IntervalEstimate()

    def change(self, column: str, factor: float = 1.0) -> float:
        """From nominal, in the unit of the column divided by `factor`."""
        return (self.value - self.nominal) / factor if self.column == column else math.nan

    @property
    def change_percent(self) -> IntervalEstimate:
        return _scaled(interval_estimate(self.value, self.error), self.nominal, self.nominal / 100.0)


def _scaled(x: IntervalEstimate, origin: float, unit: float) -> IntervalEstimate:
    return IntervalEstimate(*((end - origin) / unit for end in (x.value, x.low, x.high)))


class MarginRow(NamedTuple):
    """What a row of the margin is about: a flight, an event of maintenance, or the engine as a whole."""

    followed: EngineMargin
    row: str
    number: int
    stretches: Sequence[FlightWindow]
    used: IntervalEstimate = IntervalEstimate()
    remaining: IntervalEstimate = IntervalEstimate()
    event: EventRow | None = None
    effect: EventEffect | None = None
    parameters: Mapping[str, Parameter] = {}
    power: FlightPower | None = None

    @property
    def margin(self) -> Margin:
        return self.followed.finding.margin

    @property
    def whole(self) -> Margin | None:
        """Of the row of the engine alone."""
        return self.margin if self.row == WHOLE else None

    @property
    def window(self) -> Any:
        return self.stretches[self.number - 1].window if self.number else None

    @property
    def gain(self) -> tuple[Gain, PowerReference] | None:
        found, reference = self.effect, self.followed.reference
        return None if found is None or found.gain is None or reference is None else (found.gain, reference)

    @property
    def comparison_point(self) -> str | None:
        if self.gain is None:
            return None
        _, reference = self.gain
        held = "power" if reference.fixed_column == POWER else "thrust"
        return f"{split_column(reference.temperature)[0]} at equal {held}, {reference.words}"

    @property
    def reason(self) -> str | None:
        if self.event is not None and self.effect is not None:
            return self.event.reason or self.effect.reason
        return self.whole.reason if self.whole else None


def _gain_estimate(row: MarginRow, value: str, low: str, high: str) -> IntervalEstimate:
    """Cells of what maintenance gained."""
    cells = gain_cells(*row.gain) if row.gain else {}
    return IntervalEstimate(*(cells.get(name, math.nan) for name in (value, low, high)))


def _finite_or_none(value: float) -> float | None:
    """A cell that holds nothing where a number is not known or has no end."""
    return value if math.isfinite(value) else None


margin_column: Columns[MarginRow] = Columns()
_OF_FLIGHTS = "at that flight, by all flights together"


def _estimate(
    name: str, help: str, get: Callable[[MarginRow], IntervalEstimate | None], unit: str, level: str = "95 %"
) -> tuple[Column, ...]:
    """A column and those of its interval."""
    helps = (help, f"lower end of its {level} interval", f"upper end of its {level} interval")
    ends: tuple[Callable[[IntervalEstimate], float], ...] = (lambda x: x.value, lambda x: x.low, lambda x: x.high)

    def cell(end: Callable[[IntervalEstimate], float]) -> Callable[[MarginRow], float | None]:
        return lambda row: _finite_or_none(end(get(row) or IntervalEstimate()))

    columns = zip(interval_columns(name), helps, ends, strict=True)
    return tuple(margin_column(n, "number?", words, cell(end), unit) for n, words, end in columns)


MARGIN: Table[MarginRow] = Table(
    "trend/margin",
    1,
    "trend --what margin: one row per flight, one per event of maintenance, and one with the margin of each engine",
    (
        margin_column("engine", "text", "engine, as its recording calls it", lambda row: row.followed.finding.serial),
        margin_column("row", "text", "what the row is about: flight, maintenance or margin"),
        margin_column(
            "number",
            "integer?",
            "flight, counted from 1; the first after maintenance; the last",
            lambda row: row.number or None,
        ),
        *margin_column.part(
            lambda row: row.window,
            (
                part_column("flight", "text?", "that flight, as its recording calls it"),
                part_column("source", "text?", "file that holds it"),
            ),
        ),
        *margin_column.part(
            lambda row: row.margin,
            (
                part_column("column", "text?", "the hottest recorded temperature of burnt gas, whose margin it is"),
                part_column("condition", "text?", "reference condition of the margin"),
                part_column(
                    "limit_K",
                    "number?",
                    "limit of the temperature there, as stated",
                    lambda margin: _finite_or_none(margin.limit_K),
                    "K",
                ),
            ),
        ),
        *_estimate("used_K", f"margin used since the baseline, {_OF_FLIGHTS}", lambda row: row.used, "K"),
        *_estimate("margin_K", f"margin to the limit, {_OF_FLIGHTS}", lambda row: row.remaining, "K"),
        *_estimate(
            "power_available_kW",
            "power of the loads at the first limit that binds, with the health of that flight",
            lambda row: row.power.estimate(POWER, 1000.0) if row.power else None,
            "kW",
        ),
        *_estimate(
            "thrust_available_N",
            "net thrust at the first limit that binds, with the health of that flight",
            lambda row: row.power.estimate(THRUST) if row.power else None,
            "N",
        ),
        *_estimate(
            "available_change_percent",
            "that power or thrust from nominal's at the same limits",
            lambda row: row.power.change_percent if row.power else None,
            "%",
        ),
        margin_column(
            "power_change_kW",
            "number?",
            "the same in kilowatts",
            lambda row: _finite_or_none(row.power.change(POWER, 1000.0)) if row.power else None,
            "kW",
        ),
        margin_column(
            "thrust_change_N",
            "number?",
            "the same in newtons",
            lambda row: _finite_or_none(row.power.change(THRUST)) if row.power else None,
            "N",
        ),
        margin_column(
            "limited_by",
            "text?",
            "column of the limit that binds",
            lambda row: (row.power.limited_by or None) if row.power else None,
        ),
        *_estimate(
            "remaining_flights",
            "flights until the limit; empty: no growth is shown, and only the lower end is known",
            lambda row: row.whole.remaining_flights if row.whole else None,
            "",
            "90 %",
        ),
        *_estimate(
            "rate_K",
            "margin used per flight at the present rate",
            lambda row: row.whole.rate_K_per_flight if row.whole else None,
            "K",
        ),
        margin_column(
            "event", "text?", "wash, overhaul or exchange", lambda row: row.event.event.kind if row.event else None
        ),
        margin_column(
            "component",
            "text?",
            "component that it was done to; empty: the engine",
            lambda row: row.event.event.component if row.event else None,
        ),
        margin_column(
            "brought",
            "texts",
            "what each parameter gained, with its 95 % interval",
            lambda row: changes(row.effect, row.parameters) if row.effect else [],
        ),
        *_estimate(
            "recovered_K",
            "kelvins of margin that maintenance gave back",
            lambda row: row.event.recovered_K if row.event else None,
            "K",
        ),
        *_estimate(
            "temperature_gain_K",
            "by how much turbine temperature fell at equal power",
            lambda row: _gain_estimate(row, "temperature_gain", "temperature_low", "temperature_high"),
            "K",
        ),
        *_estimate(
            "fuel_gain_percent",
            "by how much fuel flow fell at equal power",
            lambda row: _gain_estimate(row, "fuel_gain_percent", "fuel_low_percent", "fuel_high_percent"),
            "%",
        ),
        margin_column("held", "text?", "at which power and operating point that is", lambda r: r.comparison_point),
        margin_column("reason", "text?", "why something is unknown"),
    ),
    (
        "engine",
        "row",
        "number",
        "flight",
        "used_K",
        "margin_K",
        "margin_low",
        "margin_high",
        "remaining_flights",
        "remaining_flights_low",
        "remaining_flights_high",
        "power_available_kW",
        "thrust_available_N",
        "available_change_percent",
        "limited_by",
        "event",
        "recovered_K",
        "reason",
    ),
)


def margin_rows(margins: SeriesMargins) -> Iterator[dict[str, Any]]:
    """Rows of all engines: margin left, flight by flight, what maintenance gave back, and how long it lasts."""
    known = margins.series.parameters
    for followed in margins.engines.values():
        finding, stretches = followed.finding, margins.series.stretches[followed.finding.serial]
        whole = finding.margin.now_K.value + finding.margin.consumed_K.value  # at the baseline
        for flight in finding.by_flight:
            if math.isfinite(flight.consumed_K):
                used, half = flight.consumed_K, NORMAL_95 * flight.consumed_error_K
                taken, left = (
                    IntervalEstimate(used, used - half, used + half),
                    IntervalEstimate(whole - used, whole - (used + half), whole - (used - half)),
                )
                power = flight_power(followed, flight.number)
                yield MARGIN.row(MarginRow(followed, FLIGHT, flight.number, stretches, taken, left, power=power))
        for event, brought in zip(finding.events, followed.effects, strict=True):
            row = MarginRow(
                followed, MAINTENANCE, event.number, stretches, event=event, effect=brought, parameters=known
            )
            yield MARGIN.row(row)
        taken, left = finding.margin.consumed_K, finding.margin.now_K
        power = flight_power(followed, len(stretches))
        yield MARGIN.row(MarginRow(followed, WHOLE, len(stretches), stretches, taken, left, power=power))


def flight_power(followed: EngineMargin, number: int) -> FlightPower | None:
    """What the engine delivers at its limits in flight `number`, from 1; None where that is not known."""
    course = followed.power
    k = number - 1 - (followed.finding.flights - len(course.value))
    if not 0 <= k < len(course.value) or not math.isfinite(course.value[k]):
        return None
    return FlightPower(
        course.column, float(course.value[k]), float(course.error[k]), course.nominal, course.limited_by[k]
    )


UNCHANGED_PERCENT = 0.01
"""Change below which the power available is that of the healthy engine: a limit of torque holds it."""


def power_words(followed: EngineMargin) -> str:
    """For instance "power available at the limit of T45: 1,150 kW ± 12 kW, 4.1 % ± 1.0 % below nominal, at rating on a
    standard hot day"; "" where no limit is stated."""
    course = followed.power
    if now := power_available_words(course.now):
        return f"{now}, at {course.condition}"
    known = course.reason and course.reason != NO_LIMIT and course.column
    return f"the power available at the limits is unknown: {course.reason}" if known else ""


def available_words(shaft: bool, size: IntervalEstimate, shift: IntervalEstimate, limited_by: str) -> str:
    """Power in kW of a shaft engine, else thrust in N, available at a limit, and its change from nominal in %."""
    what, unit = ("power", "kW") if shaft else ("thrust", "N")
    amount = format_quantity(size.value, unit, (size.high - size.low) / 2)
    by = f"{format_quantity(abs(shift.value), '%', (shift.high - shift.low) / 2)} below nominal"
    if shift.value > 0:
        by = by.replace("below", "above")
    if max(abs(shift.low), abs(shift.high)) < UNCHANGED_PERCENT:
        by = "as nominal"
    return f"{what} available at the limit of {split_column(limited_by)[0]}: {amount}, {by}"


def power_available_words(now: PowerAvailable | PowerRecord) -> str:
    """As `power_words`, of an engine of a fleet; "" where it is not known."""
    if not math.isfinite(now.value.value):
        return ""
    shaft = now.column == POWER
    size = _scaled(now.value, 0.0, 1000.0 if shaft else 1.0)
    return available_words(shaft, size, _scaled(now.value, now.nominal, now.nominal / 100.0), now.limited_by)


def report_margins(messages: Messages, margins: SeriesMargins) -> None:
    """Margins, what maintenance brought, and what is odd about the events, in words."""
    for engine, one in margins.engines.items():
        name = f"engine {engine}: " if engine else ""
        messages.note(f"{name}{margin_words(one.finding.margin)}")
        if told := power_words(one):
            messages.note(f"{name}{told}")
        for event, brought in zip(one.finding.events, one.effects, strict=True):
            messages.note(f"{name}{_maintenance_words(event, brought, one.reference, margins.series)}")
    if margins.learnt_K is not None:
        messages.note(removal_words(margins.learnt_K))
    for line in odd_events(margins):
        messages.warning(line)


def removal_words(limit_K: tuple[float, float]) -> str:
    """The limit for other engines, from those that were removed from wing."""
    return "engines were removed from wing with {:.0f} K of their margin lost, give or take {:.0f} K".format(*limit_K)


def odd_events(margins: SeriesMargins) -> Iterator[str]:
    """Events of engines or flights that no recording has."""
    if margins.unknown_engines:
        yield f"events name engines of which there is no recording: {', '.join(margins.unknown_engines)}"
    for engine, one in margins.engines.items():
        name = f"engine {engine}: " if engine else ""
        for flight, hint in one.unknown_flights.items():
            yield f"{name}maintenance before flight {flight!r}, which is not recorded; {hint}"


def _maintenance_words(event: EventRow, found: EventEffect, reference: PowerReference | None, series: Series) -> str:
    """For instance "wash before flight 15: compressor isentropic efficiency rose by 1.0 % ± 0.4 %; it lowered T5 by
    8 K ± 3 K and lowered fuel flow by 0.9 % ± 0.3 % at equal thrust (design point)"."""
    what = maintained(event.event.kind, event.event.component)
    when = event.event.flight or f"at {event.event.time_s:g} s"
    head = f"{what} before flight {when}" if event.event.flight else f"{what} {when}"
    parts = changes(found, series.parameters)
    if not parts:
        return f"{head}: its effect is unknown: {event.reason or found.reason or 'nothing changed'}"
    if found.gain is None or reference is None:
        return f"{head}: {listed(parts)}; the gain is unknown: {found.reason}"
    return f"{head}: {listed(parts)}; it {gain_words(found.gain, reference)}"


def changes(found: EventEffect, known: Mapping[str, Parameter]) -> list[str]:
    """What each parameter gained, in words."""
    sizes = zip(found.names, found.change, found.deviation, strict=True)
    return [change(known[name], size, NORMAL_95 * error) for name, size, error in sizes]


def margin_words(m: Margin | MarginRecord, option: str = "--limit {column} KELVIN") -> str:
    """For instance "T5 margin 147 K ± 2 K to the limit of 1150 K at take-off on a standard hot day (sea level, ISA +
    15 K), at equal thrust; 108 flights to it (90 %: 99 to 119)"; option: what states a limit where none is."""
    if not m.column or not math.isfinite(m.consumed_K.value):
        return f"the margin of the turbine temperature is unknown: {m.reason or 'no flight shows it'}"
    quantity = split_column(m.column)[0]
    if not math.isfinite(m.now_K.value):
        used = f"{_size(m.consumed_K)} of the {quantity} margin is used"
        if not m.reason:
            return f"{used}; {remaining_words(m.remaining_flights, AS_MUCH)}"
        mend = f": {option.format(column=m.column)} states it" if m.reason == NO_LIMIT else ""
        return f"{used}; the remaining margin is unknown: {m.reason or NO_LIMIT}{mend}"
    at = f" at {m.condition}" if m.condition else ""
    if m.now_K.value <= 0.0 <= m.now_K.high:
        return f"{quantity} is at its limit of {m.limit_K:g} K{at}: margin {_size(m.now_K)}"
    if m.now_K.value <= 0:
        over = IntervalEstimate(-m.now_K.value, -m.now_K.high, -m.now_K.low)
        return f"{quantity} has passed its limit of {m.limit_K:g} K by {_size(over)}{at}"
    left = f"{quantity} margin {_size(m.now_K)} to the limit of {m.limit_K:g} K{at}"
    if m.reason:
        return f"{left}; the number of flights is unknown: {m.reason}"
    return f"{left}; {remaining_words(m.remaining_flights, 'to it')}"


def remaining_words(left: IntervalEstimate, until: str = "") -> str:
    """Flights to the limit with their 90 % interval, "27 flights to it (90 %: 15 to 35)"; `until`: what the limit is
    called. Where no growth is shown only before how many it is not reached."""
    if math.isfinite(left.high):
        flights = f"{count(round(left.value), 'flight')} {until}".strip()
        return f"{flights} (90 %: {left.low:,.0f} to {left.high:,.0f})"
    begin = f"; not before {count(round(left.low), 'flight')} (95 %)" if math.isfinite(left.low) else ""
    return f"{NO_GROWTH_SHOWN}{begin}"


def _size(x: IntervalEstimate) -> str:
    return format_quantity(x.value, "K", (x.high - x.low) / 2).replace("-", "−")


SCHEMA = "enginediag/fleet/2"
"""Of the document, whose keys stay while this does."""

TERMINAL = (
    "rank",
    "engine",
    "verdict",
    "severity",
    "unit",
    "since",
    "changed",
    "instruments",
    "margin_K",
    "remaining_flights",
    "discovery",
    "flights",
    "reason",
    "build",
)
"""Columns of engines that a narrow terminal shows, most important first."""

SHOWN = 10
"""Recordings that are listed one by one; the document has all."""


def engine_rows(result: FleetRun) -> Iterator[dict[str, Any]]:
    """One row per engine, worst first."""
    for rank, x in enumerate(result.finding.engines, start=1):
        margin = x.margin
        yield {
            "rank": rank,
            "engine": x.serial,
            "build": x.build,
            "verdict": x.verdict,
            "discovery": x.discovery,
            **_fleet_estimate("severity", x.severity),
            "unit": x.severity_unit,
            "since": x.since or None,
            "since_low": x.since_low or None,
            "since_high": x.since_high or None,
            "since_flight": x.since_flight,
            "probability": x.probability,
            "unlisted": x.unlisted,
            "changed": [row.parameter for row in x.changed_rows],
            "acknowledged": None if x.acknowledged is None else x.acknowledged.date,
            "acknowledged_changes": [] if x.acknowledged is None else list(map(_acknowledged, x.acknowledged.changes)),
            "grown": [] if x.acknowledged is None else list(x.acknowledged.grown),
            "instruments": [instrument_in_flights(found) for found in x.instruments],
            "margin_column": margin.column,
            **_fleet_estimate("margin_K", margin.now_K),
            **_fleet_estimate("remaining_flights", margin.remaining_flights),
            **_power_cells(x.power),
            "flights": x.flights,
            "baseline": x.baseline,
            "records": x.records,
            "reason": x.reason,
        }


def _power_cells(now: PowerAvailable) -> dict[str, Any]:
    """Power in kW or thrust in N, its change from the healthy engine, and which limit binds."""
    nothing = IntervalEstimate()
    return {
        **_fleet_estimate("power_available_kW", _scaled(now.value, 0.0, 1000.0) if now.column == POWER else nothing),
        **_fleet_estimate("thrust_available_N", now.value if now.column == THRUST else nothing),
        **_fleet_estimate("available_change_percent", _scaled(now.value, now.nominal, now.nominal / 100.0)),
        "limited_by": now.limited_by,
    }


def health_rows(result: FleetRun) -> Iterator[dict[str, Any]]:
    """One row per engine and parameter."""
    for x in result.finding.engines:
        for row in x.health:
            yield {
                "engine": x.serial,
                "build": x.build,
                "parameter": row.parameter,
                "component": row.component,
                "words": row.words,
                **_fleet_estimate("change", row.change),
                "unit": row.unit,
                "kind": row.kind,
                "probability": row.probability,
                "onset": row.onset or None,
                "onset_low": row.onset_low or None,
                "onset_high": row.onset_high or None,
                "onset_flight": row.onset_flight,
                **_fleet_estimate("rate_per_flight", row.rate_per_flight),
            }


def flight_rows(result: FleetRun) -> Iterator[dict[str, Any]]:
    """One row per engine and flight."""
    for x in result.finding.engines:
        for row in x.by_flight:
            yield {"engine": x.serial, "build": x.build, **asdict(row)}


ROWS = {"engines": engine_rows, "health": health_rows, "flights": flight_rows}
"""What can be asked for."""


def document(result: FleetRun, provenance: Sequence[str]) -> dict[str, Any]:
    """All of it, engines one after the other: together they would take more memory than what was found."""
    finding, fleet = result.finding, result.fleet
    return {
        "schema": SCHEMA,
        "description": fleet.description,
        "engines": ({"rank": k, **_engine(x)} for k, x in enumerate(finding.engines, start=1)),
        "common": [asdict(x) for x in finding.common],
        "discoveries": asdict(finding.flagged),
        "left_out": [
            *({"recording": name, "reason": why} for name, why in result.excluded),
            *({"engine": name, "reason": why} for name, why in finding.excluded),
            *({"event of engine": name, "reason": "no recording is of this engine"} for name in result.unknown_engines),
        ],
        "consumed_limit_K": result.consumed_limit_K,
        "counts": dict(result.counts),
        "outside": [
            {"input": where.column, "judged": where.judged, "records": n}
            for where, n in result.outside_training.items()
        ],
        "sums": [_sum(build, x) for build, x in result.sums.items()],
        "models": [_model(model) for model in result.models.values()],
        "recordings": [
            {
                "recording": r.name,
                "build": r.build,
                "sha256": o.condensed.sha256,
                "records": o.condensed.counts["records"],
            }
            for r, o in result.recordings
            if o.condensed
        ],
        "provenance": list(provenance),
    }


def _engine(x: EngineFinding) -> dict[str, Any]:
    """Without its `state`, which `common` summarises, and without the moments of its `events`."""
    told = asdict(replace(x, course=None, state=None, event_changes=(), instruments=()))
    del told["course"], told["state"], told["event_changes"]
    return {**told, "instruments": [_instrument(found) for found in x.instruments]}


def _instrument(x: FaultInFlights) -> dict[str, Any]:
    fault = x.fault
    return {
        "instrument": fault.instrument,
        "column": fault.column,
        "form": fault.form,
        "words": instrument_in_flights(x),
        "flights": x.flights,
        "of": x.flights_in_all,
        "first": x.first,
        "first_flight": x.first_flight,
        "last": x.last,
        "last_flight": x.last_flight,
    }


def _sum(build: str, x: Any) -> dict[str, Any]:
    """What all statistics of a build come to; s and F in the parameters' units."""
    return {
        "build": build,
        "records": x.n,
        "chi2": x.chi2,
        "degrees_of_freedom": x.dof,
        "parameters": x.parameters,
        "theta0": x.theta0,
        "s": x.s,
        "F": x.F,
    }


def _model(model: BuildModel) -> dict[str, Any]:
    told: dict[str, Any] = {"build": model.build.name, "nominal_sha256": model.settings.fingerprint}
    if model.identified is not None:
        told |= {"identified_from": list(model.identified.engines), "records": model.identified.records}
    return told


def report_models(messages: Messages, result: FleetRun) -> None:
    """The nominal state of each build, on stderr."""
    for name, model in result.models.items():
        found = model.identified
        if found is None:
            continue
        engines = ", ".join(found.engines[:SHOWN]) + (", …" if len(found.engines) > SHOWN else "")
        of = f"{count(found.records, 'record')} of {count(len(found.engines), 'engine')}"
        messages.note(f"build {name}: common model from {of} ({engines})")


def report_fleet(messages: Messages, result: FleetRun) -> None:
    """Excluded data, and what is common, on stderr."""
    for name, why in result.excluded[:SHOWN]:
        messages.warning(f"{name}: excluded: {why}")
    if len(result.excluded) > SHOWN:
        messages.warning(f"{len(result.excluded) - SHOWN} more recordings excluded; --format json lists all")
    if result.unknown_engines:
        messages.warning(
            f"events name engines of which there is no recording: {', '.join(result.unknown_engines[:SHOWN])}"
        )
    for line in (*not_judged_lines(result.counts), *outside_envelope_lines(result.outside_training)):
        messages.note(line)
    counts = result.counts
    judged = len(result.recordings) - len(result.excluded)
    messages.note(
        f"{count(len(result.finding.engines), 'engine')}, {count(judged, 'recording')}, "
        f"{count(counts['records'], 'record')}; {count(counts['fresh'], 'recording')} newly reduced to statistics"
    )
    if result.consumed_limit_K and result.fleet.judge["taken_off"]:
        messages.note(removal_words(result.consumed_limit_K))
    wrong = [(x.serial, found) for x in result.finding.engines for found in x.instruments]
    for serial, found in wrong[:SHOWN]:
        messages.note(f"engine {serial}: {instrument_in_flights(found)}", engine=serial)
    if len(wrong) > SHOWN:
        messages.note(f"{len(wrong) - SHOWN} more instruments are stuck or scatter; the rows name all")
    for common in result.finding.common:
        if common.common:
            messages.note(f"{common.words}: {common.reading}")
    report_acknowledged(messages, result.finding.engines)
    if result.finding.flagged.words:
        messages.note(result.finding.flagged.words)


def status_rows(standing: StoreStatus) -> Iterator[dict[str, Any]]:
    """One row per recording."""
    for recorded, key in standing.recordings:
        state = "condensed" if key else "new"
        yield {"recording": recorded.name, "build": recorded.build, "engine": recorded.serial, "state": state}


def report_standing(messages: Messages, standing: StoreStatus) -> None:
    """How many recordings are there, and what else, on stderr."""
    there = sum(bool(key) for _, key in standing.recordings)
    messages.note(
        f"{there} of {count(len(standing.recordings), 'recording')} reduced to statistics; "
        f"{standing.bytes / 1e6:.1f} MB in all"
    )
    for build, known in standing.models.items():
        if not known:
            messages.note(f"build {build}: no model yet, so that all of its recordings are new")
    if standing.others:
        messages.note(f"{count(len(standing.others), 'recording')} of other fleets or settings; prune removes them")


def report_merged(messages: Messages, other: str, merged: MergeCounts) -> None:
    """What came out of another store, on stderr."""
    came = f"{count(merged.copied, 'recording')} and {count(merged.models, 'model')} copied"
    messages.note(f"{other}: {came}; {count(merged.present, 'recording')} were there")
    if merged.damaged:
        messages.warning(f"{other}: {count(len(merged.damaged), 'damaged file')} ignored")
    if merged.other_models:
        messages.warning(
            f"{other}: {count(len(merged.other_models), 'model')} differ from those here, which stay: what was "
            "reduced by theirs will be reduced anew; stores that are to merge need one nominal file, named in the "
            "fleet file"
        )


def _fleet_estimate(name: str, x: IntervalEstimate) -> dict[str, float]:
    return {name: x.value, f"{name}_low": x.low, f"{name}_high": x.high}


def _acknowledged(x: AcknowledgedChange) -> str:
    """A change as it was, for instance "hpc.efficiency -0.021 (-0.024 to -0.018)", a share where it has no unit."""
    unit = "" if x.unit in ("", "1") else f" {x.unit}"
    return f"{x.parameter} {x.change.value:.3g} ({x.change.low:.3g} to {x.change.high:.3g}){unit}"


def report_acknowledged(messages: Messages, engines: Sequence[EngineFinding]) -> None:
    """What is acknowledged, and what of it has grown."""
    for x in engines:
        before = x.acknowledged
        if before is None:
            continue
        then = f"acknowledged {before.date}, after {count(before.flights, 'flight')}: "
        then += "; ".join(map(_acknowledged, before.changes)) + (f" ({before.note})" if before.note else "")
        if before.grown:
            messages.warning(f"engine {x.serial}: grown since: {', '.join(before.grown)}; {then}", engine=x.serial)
        else:
            messages.note(f"engine {x.serial}: {then}; not raised again unless it grows", engine=x.serial)
