"""The margin of an engine as rows and in words: flight by flight, what maintenance brought, and how long it lasts."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from typing import TYPE_CHECKING, Any

from enginediag_cli.fleet_judgement.finding import Estimate
from enginediag_cli.intervals import NORMAL_95
from enginediag_cli.presentation.messages import Messages
from enginediag_cli.presentation.names import listed, maintained
from enginediag_cli.presentation.numbers import rounded, with_unit
from enginediag_cli.presentation.outputs.trend import MARGIN, with_ends
from enginediag_cli.presentation.sentences import change, count
from enginediag_cli.presentation.work_scope_rows import gain_cells, gain_words
from enginediag_cli.units import split_column
from enginediag_cli.work_scope.reference import POWER

if TYPE_CHECKING:
    from enginediag_cli.detection.trend_of_files import Series, Stretch
    from enginediag_cli.fleet_judgement.finding import EventRow, Margin
    from enginediag_cli.fleet_judgement.of_series import Brought, Followed, Margins
    from enginediag_cli.parameters import Parameter
    from enginediag_cli.presentation.charts.fleet_found import MarginFound
    from enginediag_cli.work_scope.gain import Gain
    from enginediag_cli.work_scope.reference import Reference

FLIGHT, MAINTENANCE, WHOLE = "flight", "maintenance", "margin"
"""What a row tells, in its cell `row`."""
NO_LIMIT = "no limit is stated"
"""The reason that can be mended by an option."""
AS_MUCH = "until as much is lost as when engines are taken off"
"""The limit where no temperature is stated."""


def margin_rows(margins: Margins) -> Iterator[dict[str, Any]]:
    """Rows of all engines."""
    for followed in margins.engines.values():
        yield from _rows(followed, margins.series)


def _rows(followed: Followed, series: Series) -> Iterator[dict[str, Any]]:
    finding, stretches = followed.finding, series.stretches[followed.finding.serial]
    m = finding.margin
    whole = m.now_K.value + m.consumed_K.value  # at the baseline
    head = {"engine": finding.serial, "column": m.column, "condition": m.condition, "limit_K": _known(m.limit_K)}
    for flight in finding.by_flight:
        if not math.isfinite(flight.consumed_K):
            continue
        half = NORMAL_95 * flight.consumed_error_K
        used = (flight.consumed_K, flight.consumed_K - half, flight.consumed_K + half)
        left = (whole - used[0], whole - used[2], whole - used[1])
        told = {**head, "row": FLIGHT, **_flight(flight.number, stretches), "brought": []}
        yield MARGIN.row({**told, **_cells("used_K", used), **_cells("margin_K", left)})
    for event, brought in zip(finding.events, followed.brought, strict=True):
        told = {**head, "row": MAINTENANCE, **_flight(event.number, stretches)}
        yield MARGIN.row({**told, **_event(event, brought, followed.reference, series.known)})
    yield MARGIN.row(
        {
            **head,
            "row": WHOLE,
            **_flight(len(stretches), stretches),
            **_estimate("used_K", m.consumed_K),
            **_estimate("margin_K", m.now_K),
            **_estimate("remaining_flights", m.remaining_flights),
            **_estimate("rate_K", m.rate_K_per_flight),
            "brought": [],
            "reason": m.reason,
        }
    )


def _event(
    event: EventRow, found: Brought, reference: Reference | None, known: Mapping[str, Parameter]
) -> dict[str, Any]:
    return {
        "event": event.event.kind,
        "component": event.event.component,
        "brought": changes(found, known),
        **_estimate("recovered_K", event.recovered_K),
        **(_gain(found.gain, reference) if found.gain is not None and reference is not None else {}),
        "reason": event.reason or found.reason,
    }


def _gain(gain: Gain, reference: Reference) -> dict[str, Any]:
    cells = gain_cells(gain, reference)
    held = "power" if reference.held == POWER else "thrust"
    return {
        "temperature_gain_K": cells["temperature_gain"],
        "temperature_gain_low": cells["temperature_low"],
        "temperature_gain_high": cells["temperature_high"],
        "fuel_gain_percent": cells["fuel_gain_percent"],
        "fuel_gain_percent_low": cells["fuel_low_percent"],
        "fuel_gain_percent_high": cells["fuel_high_percent"],
        "held": f"{split_column(reference.temperature)[0]} at equal {held}, {reference.words}",
    }


def _flight(number: int, stretches: Sequence[Stretch]) -> dict[str, Any]:
    if not number:
        return {}
    window = stretches[number - 1].window
    return {"number": number, "flight": window.flight, "source": window.source}


def _estimate(name: str, x: Estimate) -> dict[str, float | None]:
    return _cells(name, (x.value, x.low, x.high))


def _cells(name: str, values: Sequence[float]) -> dict[str, float | None]:
    """Cells that hold nothing where a number is not known or has no end."""
    return dict(zip(with_ends(name), map(_known, values), strict=True))


def _known(value: float) -> float | None:
    return value if math.isfinite(value) else None


def tell_margins(messages: Messages, margins: Margins) -> None:
    """Margins, what maintenance brought, and what is odd about the events, in words."""
    for engine, one in margins.engines.items():
        name = f"engine {engine}: " if engine else ""
        messages.note(f"{name}{margin_words(one.finding.margin)}")
        for event, brought in zip(one.finding.events, one.brought, strict=True):
            messages.note(f"{name}{_maintenance_words(event, brought, one.reference, margins.series)}")
    if margins.learnt_K is not None:
        messages.note(taken_off_words(margins.learnt_K))
    for line in odd_events(margins):
        messages.warning(line)


def taken_off_words(limit_K: tuple[float, float]) -> str:
    """What engines that were taken off tell of how far the others may go."""
    return "engines were taken off with {:.0f} K of their margin lost, give or take {:.0f} K".format(*limit_K)


def odd_events(margins: Margins) -> Iterator[str]:
    """Events of engines or flights that no recording has."""
    if margins.others:
        yield f"events name engines of which there is no recording: {', '.join(margins.others)}"
    for engine, one in margins.engines.items():
        name = f"engine {engine}: " if engine else ""
        for flight, hint in one.unknown.items():
            yield f"{name}maintenance before flight {flight!r}, which is not recorded; {hint}"


def _maintenance_words(event: EventRow, found: Brought, reference: Reference | None, series: Series) -> str:
    """For instance "wash before flight 15: compressor isentropic efficiency rose by 1.0 % ± 0.4 %; it lowered T5 by
    8 K ± 3 K and lowered fuel flow by 0.9 % ± 0.3 % at equal thrust (design point)"."""
    what = maintained(event.event.kind, event.event.component)
    when = event.event.flight or f"at {event.event.time_s:g} s"
    head = f"{what} before flight {when}" if event.event.flight else f"{what} {when}"
    parts = changes(found, series.known)
    if not parts:
        return f"{head}: cannot tell what it brought, because {event.reason or found.reason or 'nothing changed'}"
    if found.gain is None or reference is None:
        return f"{head}: {listed(parts)}; what that brought cannot be told: {found.reason}"
    return f"{head}: {listed(parts)}; it {gain_words(found.gain, reference)}"


def changes(found: Brought, known: Mapping[str, Parameter]) -> list[str]:
    """What each parameter gained, in words."""
    sizes = zip(found.names, found.change, found.deviation, strict=True)
    return [change(known[name], size, NORMAL_95 * error) for name, size, error in sizes]


def margin_words(m: Margin | MarginFound) -> str:
    """For instance "T5 margin 147 K ± 2 K of the limit 1150 K; 108 flights to it (90 %: 99 to 119)"."""
    if not m.column or not math.isfinite(m.consumed_K.value):
        return f"cannot tell the margin of the turbine temperature, because {m.reason or 'no flight tells of it'}"
    quantity = split_column(m.column)[0]
    if not math.isfinite(m.now_K.value):
        used = f"wear has taken {_size(m.consumed_K)} of the {quantity} margin"
        if not m.reason and not math.isnan(m.remaining_flights.value):
            return f"{used}; {remaining_words(m.remaining_flights, AS_MUCH)}"
        mend = f": --limit {m.column} KELVIN states it" if m.reason == NO_LIMIT else ""
        return f"{used}; cannot tell how much is left, because {m.reason or NO_LIMIT}{mend}"
    if m.now_K.value <= 0:
        over = Estimate(-m.now_K.value, -m.now_K.high, -m.now_K.low)
        return f"{quantity} has passed its limit of {m.limit_K:g} K by {_size(over)} at the reference condition"
    told = f"{quantity} margin {_size(m.now_K)} to the limit of {m.limit_K:g} K"
    if m.reason:
        return f"{told}; cannot tell how many flights that is, because {m.reason}"
    return f"{told}; {remaining_words(m.remaining_flights)}"


def remaining_words(left: Estimate, until: str = "to it") -> str:
    """Flights to the limit with their 90 % interval; `until`: what the limit is called."""
    if not math.isfinite(left.value):
        begin = f", 90 %: not before {rounded(left.low)} flights" if math.isfinite(left.low) else ""
        return f"no end in sight: what these flights show does not reach the limit{begin}"
    end = f"{left.high:,.0f}" if math.isfinite(left.high) else "no end in sight"
    return f"{count(round(left.value), 'flight')} {until} (90 %: {left.low:,.0f} to {end})"


def _size(x: Estimate) -> str:
    return with_unit(x.value, "K", (x.high - x.low) / 2)
