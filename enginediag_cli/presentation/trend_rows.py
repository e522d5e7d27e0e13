"""The answer of `trend` as rows and in words: what changed during a series, and since when."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING, Any

from enginediag_cli.intervals import NORMAL_95
from enginediag_cli.isolation.story import CANNOT_TELL, HALF
from enginediag_cli.presentation.messages import Messages
from enginediag_cli.presentation.outputs.trend import EVENTS, FLIGHTS, TREND

if TYPE_CHECKING:
    from enginediag_cli.detection.trend_of_files import Series, Stretch
    from enginediag_cli.isolation.story import Event, Member, Story


def flight_rows(series: Series) -> Iterator[dict[str, Any]]:
    """Changes from nominal, in the parameter's unit, with 95 % intervals."""
    from enginediag_cli.detection.trend import flight_change

    counts: Counter[str] = Counter()
    for engine, stretches in series.stretches.items():
        for stretch in stretches:
            counts[engine] += 1
            found = flight_change(stretch.statistics)
            for a, change, error in zip(found.parameters, found.change, found.standard_error, strict=True):
                told = {
                    "engine": engine,
                    "source": stretch.window.source,
                    "flight": stretch.window.flight,
                    "number": counts[engine],
                    "records": found.records,
                    "parameter": a,
                    "change": change,
                    "low": change - NORMAL_95 * error,
                    "high": change + NORMAL_95 * error,
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
    from enginediag_cli.presentation.sentences import instrument_in_flights

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
    from enginediag_cli.detection.trend_of_files import has_times

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
    from enginediag_cli.presentation.sentences import instrument_in_flights

    for engine, wrong in series.instruments.items():
        for found in wrong:
            name = f"engine {engine}: " if engine else ""
            messages.note(f"{name}{instrument_in_flights(found)}", engine=engine)


def tell_story(messages: Messages, engine: str, story: Story, series: Series) -> None:
    """What happened during a series, in words."""
    from enginediag_cli.presentation.names import listed
    from enginediag_cli.presentation.numbers import probability
    from enginediag_cli.presentation.sentences import change

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
    from enginediag_cli.detection.trend_of_files import has_times

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
