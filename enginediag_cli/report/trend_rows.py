"""The answer of `trend` as rows and in words: what changed during a series, and since when.

The margin of an engine as rows and in words: flight by flight, what maintenance brought, and how long it lasts.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from typing import TYPE_CHECKING, Any

from enginediag_cli.fleets.findings import Estimate
from enginediag_cli.fleets.work_scope import POWER
from enginediag_cli.intervals import NORMAL_95
from enginediag_cli.isolation.events import CANNOT_TELL, HALF
from enginediag_cli.report.messages import Messages
from enginediag_cli.report.outputs.judgements import EVENTS, FLIGHTS, MARGIN, TREND, with_ends
from enginediag_cli.report.sentences import change, count, listed, maintained, rounded, with_unit
from enginediag_cli.report.work_scope_rows import gain_cells, gain_words
from enginediag_cli.units import split_column

if TYPE_CHECKING:
    from enginediag_cli.detection.series import Series, Stretch
    from enginediag_cli.fleets.findings import EventRow, Margin
    from enginediag_cli.fleets.maintenance import Brought, Followed, Margins
    from enginediag_cli.fleets.work_scope import Gain, Reference
    from enginediag_cli.isolation.events import Event, Member, Story
    from enginediag_cli.parameters import Parameter
    from enginediag_cli.report.plotting.fleet import MarginFound


def flight_rows(series: Series) -> Iterator[dict[str, Any]]:
    """Changes from nominal, in the parameter's unit, with 95 % intervals."""
    from enginediag_cli.detection.series import flight_change

    counts: Counter[str] = Counter()
    for engine, stretches in series.stretches.items():
        for stretch in stretches:
            counts[engine] += 1
            found = flight_change(stretch.statistics)
            for a, size, error in zip(found.parameters, found.change, found.standard_error, strict=True):
                told = {
                    "engine": engine,
                    "source": stretch.window.source,
                    "flight": stretch.window.flight,
                    "number": counts[engine],
                    "records": found.records,
                    "parameter": a,
                    "change": size,
                    "low": size - NORMAL_95 * error,
                    "high": size + NORMAL_95 * error,
                    "unit": series.known[a].unit,
                }
                yield FLIGHTS.row(told)


def trend_rows(engine: str, story: Story, series: Series) -> Iterator[dict[str, Any]]:
    """One row per parameter: those of the suspects of each event, then the steady ones."""
    unit = {name: p.unit for name, p in series.known.items()}
    changed = set()
    for event in story.events:
        for member in event.members:
            for q, name in enumerate(member.parameters):
                chance = event.probability * member.probability * member.inclusion[q]
                if chance < 0.01:
                    continue
                changed.add(name)
                told = {
                    **_head(engine, story, series),
                    "parameter": name,
                    "component": member.component,
                    "kind": event.kind,
                    "probability": chance,
                    **_onset(event, series.stretches[engine]),
                    **_change(event, story, member.change[q], member.deviation[q]),
                    "unit": unit[name],
                    "rivals": _rivals(event, member),
                }
                yield TREND.row(told)
    wrong = {series.known[name].component for name in changed if series.known[name].of_instrument}
    for name, parameter in series.known.items():
        if name not in changed and parameter.component not in wrong:  # the other form of an instrument's error
            told = {
                **_head(engine, story, series),
                "parameter": name,
                "component": parameter.component,
                "kind": CANNOT_TELL if story.from_the_first or story.verdict == CANNOT_TELL else "steady",
                "probability": story.inclusion.get(parameter.component, 0.0),
                "unit": parameter.unit,
                "rivals": [],
            }
            yield TREND.row(told)


def _head(engine: str, story: Story, series: Series) -> dict[str, Any]:
    from enginediag_cli.report.sentences import instrument_in_flights

    return {
        "engine": engine,
        "flights": story.flights,
        "instruments": [instrument_in_flights(found) for found in series.instruments.get(engine, ())],
        "verdict": story.verdict,
        "fit_before": story.fit.before,
        "fit": story.fit.after,
        "unlisted": story.unlisted,
    }


def component_rows(engine: str, story: Story, series: Series) -> Iterator[dict[str, Any]]:
    """One row per event, with the component or the class of components; one alone where nothing changed or it cannot be
    told whether anything did, with the suspects as rivals."""
    head = _head(engine, story, series)
    for event in story.events:
        told = {
            **head,
            "components": [m.component for m in event.named],
            "probability": event.probability * sum(m.probability for m in event.named),
            "kind": event.kind,
            **_onset(event, series.stretches[engine]),
            "rivals": [f"{m.component} ({event.probability * m.probability:.2g})" for m in event.members],
        }
        yield EVENTS.row(told)
    if not story.events:
        # flights that differ for certain leave nothing to that
        steady = max(1 - story.unlisted - max(story.inclusion.values(), default=0.0), 0.0) * (not story.departures)
        rivals = [f"{m.component} ({m.probability:.2g})" for m in story.undecided.members] if story.undecided else []
        yield EVENTS.row({**head, "components": [], "probability": steady, "rivals": rivals})


def _rivals(event: Event, member: Member) -> list[str]:
    others = [m for m in event.members if m.component != member.component]
    return [f"{m.component} ({event.probability * m.probability:.2g})" for m in others]


def _onset(event: Event, stretches: Sequence[Stretch]) -> dict[str, Any]:
    from enginediag_cli.detection.series import has_times

    window = stretches[event.onset - 1].window
    return {
        "onset": event.onset,
        "onset_low": event.low,
        "onset_high": event.high,
        "onset_flight": window.flight,
        "onset_source": window.source,
        "onset_line": window.first_line,
        "onset_s": window.start_s if has_times(window) else None,
    }


def _change(event: Event, story: Story, change: float, deviation: float) -> dict[str, Any]:
    """Change up to the last flight and, where it grows, its mean rate since the onset."""
    half = NORMAL_95 * deviation
    told: dict[str, Any] = {"change": change, "change_low": change - half, "change_high": change + half}
    if event.kind == "step":
        return {**told, "rate_per_flight": None, "rate_low": None, "rate_high": None}
    span = max(story.flights - event.onset, 1)
    return {
        **told,
        "rate_per_flight": change / span,
        "rate_low": (change - half) / span,
        "rate_high": (change + half) / span,
    }


def tell_instruments_in_flights(messages: Messages, series: Series) -> None:
    """Instruments that are stuck or scatter in some flights of the engines of a series, in words."""
    from enginediag_cli.report.sentences import instrument_in_flights

    for engine, wrong in series.instruments.items():
        for found in wrong:
            name = f"engine {engine}: " if engine else ""
            messages.note(f"{name}{instrument_in_flights(found)}", engine=engine)


def tell_story(messages: Messages, engine: str, story: Story, series: Series) -> None:
    """What happened during a series, in words."""
    from enginediag_cli.report.sentences import change, listed, probability

    name = f"engine {engine}: " if engine else ""
    if not story.converged:
        messages.warning(f"{name}the search for onsets did not settle", engine=engine)
    if story.events:
        messages.note(
            f"{name}chi2 per degree of freedom, by the scatter of the series: {story.fit.before:.3g} before what "
            f"follows, {story.fit.after:.3g} after",
            engine=engine,
        )
    if story.from_the_first:
        messages.warning(
            f"{name}differs from nominal from the first flight on ({len(story.departures)} of {story.flights} flights):"
            " another engine, a column or unit read wrong, or a change before that; check and isolate say more",
            engine=engine,
        )
    elif story.departures and not story.events:
        first = series.stretches[engine][story.departures[0] - 1].window
        since = f"flight {first.flight}" if first.flight else f"line {first.first_line} of {first.source}"
        messages.warning(
            f"{name}cannot tell: {len(story.departures)} of {story.flights} flights differ from nominal for certain,"
            f" the first of them {since}, and no change that is listed explains the series; isolate says more",
            engine=engine,
        )
    if story.unlisted >= HALF:
        messages.warning(
            f"{name}cannot tell: something that is not among the suspects (probability {probability(story.unlisted)}); "
            f"the best listed change leaves chi2 per degree of freedom {story.fit.after:.3g}",
            engine=engine,
        )
    if story.undecided:
        suspects = listed([m.component for m in story.undecided.named])
        messages.note(
            f"{name}cannot tell: if the readings scatter from each flight to the next alone, {suspects} changed; if "
            "they wander by themselves, as instruments and unrecorded operation do, nothing did",
            engine=engine,
        )
    for event in story.events:
        since = _since(event, series.stretches[engine])
        members = event.named
        parts = []
        for member in members:
            shown = [
                change(series.known[p], member.change[q], NORMAL_95 * member.deviation[q])
                for q, p in enumerate(member.parameters)
                if member.inclusion[q] >= 0.5
            ]
            if shown or not member.parameters:
                shown = shown or [f"{member.component} changed"]
                parts.append((listed(shown), event.probability * member.probability))
        if len(members) == 1:
            text, chance = parts[0]
            messages.note(f"{name}{since}: {text} (probability {probability(chance)})", engine=engine)
        else:
            each = "; or ".join(f"{text} ({probability(chance)})" for text, chance in parts)
            messages.note(f"{name}{since}: cannot tell: {each}", engine=engine)


def _since(event: Event, stretches: Sequence[Stretch]) -> str:
    """When it began: flights by their labels, else seconds, else lines, with the interval."""
    from enginediag_cli.detection.series import has_times

    at, low, high = (stretches[k - 1].window for k in (event.onset, event.low, event.high))
    word = "at once, from" if event.kind == "step" else "growing, from"
    if at.flight:
        text, interval = f"flight {at.flight}", f"{low.flight} to {high.flight}"
    elif has_times(at):
        text, interval = f"{at.start_s:.10g} s", f"{low.start_s:.10g} to {high.start_s:.10g}"
    else:
        text, interval = f"line {at.first_line} of {at.source}", f"{low.first_line} to {high.first_line}"
    return f"{word} {text} on ({interval})" if low is not high else f"{word} {text} on"


def tell_too_few(messages: Messages, engine: str, count: int) -> None:
    """Why an engine has no trend."""
    name = f"engine {engine}: " if engine else ""
    told = f"{name}{count} flights are too few for a trend, which needs three; --window cuts long flights"
    messages.warning(told, engine=engine, flights=count)


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
