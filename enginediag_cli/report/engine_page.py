"""What a report says of one engine: its first screen, and its section of charts and tables.

The first screen is one answer out of all files, the most that any of them shows, and the next step that follows from
it. The section follows the order in which an engineer asks.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

from scipy.stats import binom

from enginediag_cli.history.engines import COMES_AND_GOES, FROM_THE_FIRST, UNLIKELY
from enginediag_cli.history.hypotheses import FROM_START, INTERMITTENT
from enginediag_cli.history.posterior import EVENT
from enginediag_cli.parameters import meanings
from enginediag_cli.report import result_files
from enginediag_cli.report.evidence import EngineEvidence, ReportedChange, ReportEvidence
from enginediag_cli.report.html import Block, EngineState, Folded, Lead, PageSection, Paragraph, TableBlock, next_step
from enginediag_cli.report.plotting import Chart, ChartTable, EventMark, chart_columns, date_words
from enginediag_cli.report.plotting.health import (
    MOST_CURVES,
    flight_order,
    group_by_parameter,
    health_map,
    health_trend,
    maintenance_marks,
    maintenance_table,
    margin_forecast,
    read_maintenance,
    read_margin,
)
from enginediag_cli.report.plotting.models import isolability, operating_line
from enginediag_cli.report.plotting.residuals import (
    MOST_RIVALS,
    alert_words,
    delta_chart,
    delta_courses,
    detection_course,
    level_words,
    residual_course,
    residual_drivers,
    sensors_health,
    snapshots,
    window_fingerprint,
)
from enginediag_cli.report.result_files import (
    ALONE,
    Order,
    Row,
    conditional_rows,
    first_alarm_of_last_run,
    order_windows,
    parse_alternative,
)
from enginediag_cli.report.sentences import (
    capital,
    change,
    count,
    display_scale,
    listed,
    probability,
    rounded,
)
from enginediag_cli.report.tables.answers import MAINTENANCE
from enginediag_cli.report.tables.isolation import CANNOT_TELL
from enginediag_cli.report.tables.trend import COURSE_WORDS
from enginediag_cli.units import is_date, split_column

SETTLED = 0.9
"""Probability that a change must have to be in the headline without a doubt."""
MISFIT = 2.0
"""reduced χ² of a window, after its answer, from which no answer explains what was read. Judgement."""


def engine_lead(engine: EngineEvidence, evidence: ReportEvidence, key: str) -> Lead:
    """The first screen of an engine."""
    found = (
        series_answer(engine, evidence) or _isolation_answer(engine, evidence) or _detection_answer(engine, evidence)
    )
    found = _flag_misfit(engine, found)
    changed = [evidence.parameters[n] for n in found.names if n in evidence.parameters]
    margin = read_margin(engine.rows_of_kind(result_files.MARGIN))
    step = limit = margin.next_step if margin else ""
    judged = found.state is not EngineState.NO_VERDICT or not found.first_step
    if judged and (not limit or found.state is not EngineState.NOTHING_FOUND):
        step = f"{next_step(found.state, changed, _separating_sensors(engine), _advice(engine))} {limit}".strip()
    return Lead(
        found.state,
        found.sentence,
        engine.engine,
        identity=_identity(engine, evidence),
        confidence=_confidence_words(engine),
        onset=_onset_words(engine, found.state, evidence),
        margin=margin.words if margin else "",
        alerts="; ".join(alert_words(engine.rows_of_kind(result_files.DELTAS))),
        power=found.power,
        next_step=f"{found.first_step} {step}".strip(),
        sensitivity=_sensitivity_words(engine, evidence),
        alternatives=_alternatives(engine, evidence),
        key=key,
        badge=found.badge,
    )


def _identity(engine: EngineEvidence, evidence: ReportEvidence) -> str:
    """Which engine, and of when: type, serial number, flights and dates, as far as the files say."""
    rows = _verdicts(engine) or engine.rows_of_kind(result_files.FLIGHTS)
    labels = list(dict.fromkeys(row.text("flight") for row in rows if row.text("flight")))
    trend = engine.rows_of_kind(result_files.TREND)
    flights = max(len(labels), trend[0].count("flights") if trend else 0)
    parts = [evidence.engine_type, f"serial number {engine.engine}" if engine.engine else ""]
    if flights:
        between = f" ({labels[0]} to {labels[-1]})" if len(labels) > 1 else ""
        parts.append(count(flights, "flight") + between)
    times = [t for row in rows for t in (row.number("start_s"), row.number("end_s")) if is_date(t)]
    if times:
        parts.append(" to ".join(dict.fromkeys((date_words(min(times)), date_words(max(times))))))
    return " · ".join(part for part in parts if part)


@dataclass(frozen=True)
class EngineAnswer:
    """What the first screen says of an engine; names: of the parameters of the answer, or of its suspects; first_step:
    what is to be done before anything else, and alone where there is no verdict; badge: the state in other words;
    power: what would have been seen."""

    state: EngineState
    sentence: str
    names: Sequence[str] = ()
    first_step: str = ""
    badge: str = ""
    power: str = ""


def _flag_misfit(engine: EngineEvidence, found: EngineAnswer) -> EngineAnswer:
    """The answer, reported as the likeliest account of something that the model does not explain where that is so."""
    fit = engine.isolated[-1][0].number("fit") if engine.isolated else math.nan
    if found.state not in (EngineState.CHANGED, EngineState.CANNOT_TELL) or not fit > MISFIT:
        return found
    words = f"The readings depart from nominal, and no change explains them (reduced χ² {rounded(fit)}): "
    sentence = f"{words}ask explain what the model lacks. Nearest to it: {found.sentence}"
    return replace(found, state=EngineState.CANNOT_TELL, sentence=sentence)


DETECTABLE = "detectable:"
"""Begin of the columns of `detect` that hold the smallest changes that would have shown."""
REGROWN = 0.9
"""Share of its largest size from which a change that was taken back in part is as large again."""
CHANCE = 0.01
"""Probability below which so many alarms of windows are no chance at their false-alarm rate."""
CHECK_START = (
    "First make sure that the nominal file and these recordings are of this engine: serial number, columns and units "
    "(`enginediag check`)."
)


def series_answer(engine: EngineEvidence, evidence: ReportEvidence) -> EngineAnswer | None:
    """The answer of all flights together; None where they were not followed."""
    rows = engine.rows_of_kind(result_files.TREND)
    if not rows:
        return None
    events, verdict, unlisted = engine.changes, rows[0].text("verdict"), rows[0].number("unlisted")
    reason = rows[0].text("reason")
    names = [row.text("parameter") for event in events for row in event.changed]
    if unlisted >= EVENT:
        words = f"Something changed that is probably none of the suspects (probability {probability(unlisted)})"
        words += f"; {reason}." if reason else "."
        step = "Record more sensors, or ask `explain` what the model lacks; until then do no work on the engine."
        return EngineAnswer(EngineState.CANNOT_TELL, words, names, step)
    if events:
        return _event_answer(events, evidence, names)
    if verdict == FROM_THE_FIRST:
        words = "All flights differ from nominal from the first on, and no listed change explains it."
        return EngineAnswer(EngineState.CANNOT_TELL, words, (), CHECK_START)
    if verdict == CANNOT_TELL:
        alone = _isolation_answer(engine, evidence)
        words = f"{capital(reason)}." if reason else "Flights differ from nominal, and no listed change explains them."
        if alone is None or alone.state is not EngineState.CHANGED:
            return EngineAnswer(EngineState.CANNOT_TELL, words)
        return EngineAnswer(
            EngineState.CANNOT_TELL, f"{words} The last window by itself: {alone.sentence}", alone.names
        )
    return _steady_answer(engine, evidence, rows[0].count("flights"))


def _event_answer(events: Sequence[ReportedChange], evidence: ReportEvidence, names: Sequence[str]) -> EngineAnswer:
    words = "; ".join(event_words(event, evidence) for event in events)
    least = min(event.probability for event in events)
    open_ = [event for event in events if len(event.group) > 1]
    if open_:
        each = [f"{evidence.owner_words(name)} ({probability(p)})" for name, p in open_[0].group]
        settled = [event_words(event, evidence) for event in events if event not in open_]
        besides = f" Besides: {'; '.join(settled)}." if settled else ""
        sentence = f"Something changed, and these flights do not separate the suspects: {listed(each, 'or')}."
        suspects = [n for event in open_ for name, _ in event.group for n in evidence.parameters_of_owner(name)]
        return EngineAnswer(EngineState.CANNOT_TELL, sentence + besides, suspects or names)
    if least < SETTLED:
        sentence = f"Something changed, and what is not settled; the likeliest ({probability(least)}): {words}."
        return EngineAnswer(EngineState.CANNOT_TELL, sentence, names)
    if any(event.kind == FROM_START for event in events):
        words = f"Off nominal from the first flight on: {words}."
        return EngineAnswer(EngineState.CHANGED, words, names, CHECK_START, "differs from nominal from the start")
    if all(event.ended and not event.remaining for event in events):
        return EngineAnswer(EngineState.CHANGED, f"{words}.", names, "It is in the past.", "changed, and taken back")
    return EngineAnswer(EngineState.CHANGED, f"{words}.", names)


def event_words(event: ReportedChange, evidence: ReportEvidence) -> str:
    """One change with its sizes: at the last flight, or the largest of what has ended or comes and goes."""
    gone = event.ended or event.kind in (COMES_AND_GOES, INTERMITTENT)
    name = "largest" if gone and event.rows[0].text("largest") else "change"
    words = listed([_row_change(row, evidence, name) for row in event.changed])
    if event.kind == INTERMITTENT:
        return f"{words}, in some flights and not in others"
    if not gone:
        return words
    left = event.remaining
    if left and all(abs(row.number("change")) >= REGROWN * abs(row.number("largest")) for row in left):
        grown = listed([_row_change(row, evidence) for row in left])
        return f"{grown}, after a part was restored at flight number {event.rows[0].count('end')}"
    still = f"; now {listed([_row_change(row, evidence) for row in left])}" if left else ", and nothing of it is left"
    end = f" until flight number {event.rows[0].count('end')}" if event.ended else " for a time"
    return words + end + still


def _row_change(row: Row, evidence: ReportEvidence, name: str = "change") -> str:
    half = (row.number(f"{name}_high") - row.number(f"{name}_low")) / 2
    return change(evidence.parameters[row.text("parameter")], row.number(name), half)


def _steady_answer(engine: EngineEvidence, evidence: ReportEvidence, flights: int) -> EngineAnswer:
    """No change in the series; alarms of windows are counted against what chance makes of them."""
    judged = [r for r in engine.rows_of_kind(result_files.DETECTED) if r.text("verdict") != "no verdict"]
    alarms = [row for row in judged if row.text("verdict") == "fault"]
    last = judged[-1] if judged else None
    together = f"No change over {count(flights, 'flight')} together"
    if not alarms:
        power = _series_power(engine, evidence) or (_power(last, evidence) if last is not None else "")
        none = ", and in none by itself" if judged else ""
        return EngineAnswer(EngineState.NOTHING_FOUND, f"{together}{none}.", power=power)
    some = f"{len(alarms)} of {count(len(judged), 'window')} {'alarms' if len(alarms) == 1 else 'alarm'}"
    if last in alarms:
        alone = _isolation_answer(engine, evidence)
        nearest = f" By itself it would say: {alone.sentence}" if alone and alone.state is EngineState.CHANGED else ""
        words = f"{together}, but the last window, {alarms[-1].window}, departs from nominal by itself.{nearest}"
        step = "Record the next flight: a change that lasts will show in it."
        return EngineAnswer(EngineState.CANNOT_TELL, words, (), step)
    if binom.sf(len(alarms) - 1, len(judged), evidence.false_alarm) >= CHANCE:
        rate = f"as many as chance makes at a false-alarm rate of {100 * evidence.false_alarm:g} %"
        return EngineAnswer(EngineState.NOTHING_FOUND, f"{together}. {capital(some)}, {rate}.")
    words = f"{together}, yet {some} by themselves, more than chance makes: single flights are off and come back."
    step = f"Look at {listed([row.window for row in alarms[-3:]])} below: readings that fail in flight, or weather."
    return EngineAnswer(EngineState.CANNOT_TELL, words, (), step)


def _isolation_answer(engine: EngineEvidence, evidence: ReportEvidence) -> EngineAnswer | None:
    windows = [rows for rows in engine.isolated if rows[0].text("verdict") != "no verdict"]
    if not windows:
        return None
    last, head = windows[-1], windows[-1][0]
    names = head.list("isolated")
    if head.text("verdict") == CANNOT_TELL:
        words = f"{capital(head.window)}: {head.text('note') or 'what changed is unknown'}."
        return EngineAnswer(EngineState.CANNOT_TELL, words, names)
    if members := head.list("members"):
        each = [
            listed([p.words for p in meanings(evidence.parameters, parse_alternative(m)[0] or (m,)).values()])
            for m in members
        ]
        sentence = (
            f"{capital(head.window)}: one of these changed, and the data do not separate them: {listed(each, 'or')} "
            f"(together {probability(head.number('class'))})."
        )
        return EngineAnswer(EngineState.CANNOT_TELL, sentence, names)
    if names:
        sizes = [size_in_words(row, evidence) for row in last if row.text("parameter")]
        return EngineAnswer(EngineState.CHANGED, f"{listed(sizes) or listed(list(names))}.", names)
    if head.text("verdict") == "fault":
        words = f"{capital(head.window)} departs from nominal, and no single parameter explains it."
        return EngineAnswer(EngineState.CANNOT_TELL, words)
    return _no_alarm_answer(engine, evidence)


def size_in_words(row: Row, evidence: ReportEvidence) -> str:
    """The change of one isolated parameter with half its interval."""
    half = (row.number("upper") - row.number("lower")) / 2
    return change(evidence.parameters[row.text("parameter")], row.number("change"), half)


def _detection_answer(engine: EngineEvidence, evidence: ReportEvidence) -> EngineAnswer:
    rows = [row for row in engine.rows_of_kind(result_files.DETECTED) if row.text("verdict") != "no verdict"]
    if rows and rows[-1].text("verdict") == "fault":
        words = f"The engine departs from nominal in {rows[-1].window}; these results do not say what changed."
        return EngineAnswer(EngineState.CHANGED, words)
    return _no_alarm_answer(engine, evidence)


def _no_alarm_answer(engine: EngineEvidence, evidence: ReportEvidence) -> EngineAnswer:
    """Nothing in the last window, or nothing at all: never more than the tests say, and with their power."""
    judged = [r for r in _verdicts(engine) if r.text("verdict") != "no verdict"]
    deltas = engine.rows_of_kind(result_files.DELTAS)
    if deltas and not _verdicts(engine):
        return _delta_answer(alert_words(deltas))
    if not judged:
        reasons = sorted({r.text("reason") or r.text("note") for r in _verdicts(engine)} - {""})
        why = f": {reasons[0]}" if reasons else ""
        return EngineAnswer(EngineState.NO_VERDICT, f"Nothing could be judged{why}.")
    alarms = [row for row in judged if row.text("verdict") == "fault"]
    if alarms and judged[-1].text("verdict") != "fault":
        words = f"The last window agrees with nominal; {count(len(alarms), 'earlier window')} of {len(judged)} did not."
        return EngineAnswer(EngineState.CANNOT_TELL, words)
    words = f"All {count(len(judged), 'window')} judged agree with the nominal engine."
    return EngineAnswer(EngineState.NOTHING_FOUND, words, power=_power(judged[-1], evidence))


def _delta_answer(alerts: Sequence[str]) -> EngineAnswer:
    """Of raw deltas alone, which say that readings moved and not what moved them."""
    if not alerts:
        step = "Give the recordings with -n NOMINAL: they are judged by detect, isolate and trend then."
        return EngineAnswer(EngineState.NO_VERDICT, "Raw deltas say neither whether nor what changed.", first_step=step)
    words = f"{count(len(alerts), 'raw delta')} beyond alert levels; `isolate` and `trend` say what changed."
    return EngineAnswer(EngineState.CHANGED, words)


def _series_power(engine: EngineEvidence, evidence: ReportEvidence) -> str:
    """What all flights together would have shown: of each component the smallest step of a parameter."""
    rows = engine.rows_of_kind(result_files.TREND)
    sizes = {row.text("parameter"): row.number("detectable") for row in rows if row.text("detectable")}
    smallest = evidence.smallest_words(sizes)
    return smallest and f"a lasting change of {smallest}, by all flights together"


def _power(window: Row, evidence: ReportEvidence) -> str:
    """What the window would have shown: of each component the smallest change of a parameter, where `detect` says."""
    begins = [name for name in window.cells if name.startswith(DETECTABLE)]
    smallest = evidence.smallest_words({name.removeprefix(DETECTABLE): window.number(name) for name in begins})
    return smallest and f"the last window alone, a change of {smallest}"


def _verdicts(engine: EngineEvidence) -> list[Row]:
    """One row for each window that was judged or should have been."""
    return (
        engine.rows_of_kind(result_files.DETECTED)
        or [rows[0] for rows in engine.isolated]
        or engine.rows_of_kind(result_files.COMPONENTS)
    )


def _confidence_words(engine: EngineEvidence) -> str:
    """Of all flights together; of the last window alone only where no series was followed."""
    words = []
    events, trend = engine.changes, engine.rows_of_kind(result_files.TREND)
    if events:
        named = max(events, key=lambda event: event.probability)
        flights = count(named.rows[0].count("flights"), "flight" if named.rows[0].text("onset_flight") else "window")
        words.append(f"probability {probability(named.probability)} that it changed, by {flights} together")
    elif trend and trend[0].text("verdict") == "steady":
        most = max(row.number("probability") for row in trend)
        words.append(
            f"no component or instrument changed with a probability above {rounded(max(most, 0.01), digits=1)}"
        )
    windows = [rows[0] for rows in engine.isolated if not math.isnan(rows[0].number("probability"))]
    if windows and not trend:
        head = windows[-1]
        fit = head.number("fit")
        fits = f", reduced χ² {rounded(fit)} with it" if math.isfinite(fit) else ""
        exact = "this and nothing else that matters" if head.list("isolated") else "nothing that matters"
        words.append(f"{head.window} alone: {exact} with probability {probability(head.number('probability'))}{fits}")
    detected = engine.rows_of_kind(result_files.DETECTED)
    if detected:
        alarms = sum(row.text("verdict") == "fault" for row in detected)
        silent = sum(row.text("verdict") == "no verdict" for row in detected)
        without = f", {silent} without verdict" if silent else ""
        words.append(f"{alarms} of {count(len(detected), 'window')} alarm by themselves{without}")
    return "; ".join(words)


def _onset_words(engine: EngineEvidence, state: EngineState, evidence: ReportEvidence) -> str:
    if state is EngineState.NOTHING_FOUND or state is EngineState.NO_VERDICT:
        return ""
    events = engine.changes
    if events:
        each = [_event_onset(event, engine) for event in events]
        if len(each) == 1:
            return each[0]
        return "; ".join(
            f"{evidence.owner_words(event.suspects[0][0])}: {words}" for event, words in zip(events, each, strict=True)
        )
    run = first_alarm_of_last_run(engine.rows_of_kind(result_files.DETECTED))
    return f"{run.window}, the first of an unbroken run of alarms" if run is not None else ""


def _event_onset(event: ReportedChange, engine: EngineEvidence) -> str:
    row = event.rows[0]
    if event.kind == FROM_START:
        return "before the first flight of these"
    course = COURSE_WORDS.get(event.kind, event.kind)
    name = f"flight {row.text('onset_flight')}" if row.text("onset_flight") else f"stretch {row.count('onset')}"
    low, high = row.count("onset_low"), row.count("onset_high")
    within = "" if low == high else f" (counted from the first, between {low} and {high})"
    date = engine.flight_date(row.count("onset")) or (
        date_words(row.number("onset_s")) if is_date(row.number("onset_s")) else ""
    )
    return f"{name}{within}{f', {date}' if date else ''}, {course}"


def _separating_sensors(engine: EngineEvidence) -> Sequence[str]:
    return engine.isolated[-1][0].list("would_tell") if engine.isolated else ()


def _advice(engine: EngineEvidence) -> Sequence[str]:
    """What `isolate` advised, and what restoring a module would bring by the series, else by the last window."""
    heads = [rows[0] for rows in engine.isolated[-1:]]
    trend = engine.rows_of_kind(result_files.TREND)[:1]
    scope = next((row.cells["work_scope"] for row in (*trend, *heads) if row.cells.get("work_scope")), None)
    sentences = scope.get("told", ()) if isinstance(scope, dict) else [str(s) for s in scope or ()]
    return (*(s for head in heads for s in head.list("advice")), *(f"{capital(str(s))}." for s in sentences))


def _sensitivity_words(engine: EngineEvidence, evidence: ReportEvidence) -> tuple[str, ...]:
    """Sensitivity of the conclusion, as `isolate` writes it of the last window: in one sentence, then each error. Where
    a series was followed, what makes it another component or instrument; how many parameters of it, flights decide."""
    if not engine.isolated:
        return ()
    head = engine.isolated[-1][0]
    flips = head.cells.get("flips")
    words = head.list("flips") or ((head.text("flips_told"),) if head.text("flips_told") else ())
    if not isinstance(flips, list):
        return tuple(f"{capital(sentence)}." for sentence in words)
    each = [(_sensitivity_sentence(f, head, engine), f) for f in flips if isinstance(f, dict)]
    if not engine.rows_of_kind(result_files.TREND):
        return tuple(sentence for sentence, _ in each)
    named = {row.text("component") for event in engine.changes for row in event.changed}
    other = [s for s, f in each if not evidence.owners(str(f.get("becomes", ""))) & named]
    rest = [s for s, _ in each if s not in other]
    if other or not rest:
        return (*other, *rest)
    part = listed([evidence.owner_words(name) for name in named])
    return (f"No single error of a map, a sensor or an input that was tried takes the {part} out of the answer.", *rest)


def _sensitivity_sentence(flip: dict[str, object], head: Row, engine: EngineEvidence) -> str:
    of = f" of {head.window} alone" if engine.rows_of_kind(result_files.TREND) else ""
    return f"{capital(str(flip.get('words', flip)).replace('the answer', f'the answer{of}', 1))}."


def _alternatives(engine: EngineEvidence, evidence: ReportEvidence) -> tuple[str, ...]:
    """What else the data do not exclude: other suspects by the series, else other answers of the last window."""
    if engine.rows_of_kind(result_files.TREND):
        named = [(event, event.suspects[len(event.group) :]) for event in engine.changes]
        others = [(evidence.owner_words(name), p) for _, rest in named for name, p in rest if p >= UNLIKELY]
        return tuple(f"{words} ({probability(p)})" for words, p in others[:MOST_RIVALS])
    if not engine.isolated:
        return ()
    found = map(parse_alternative, engine.isolated[-1][0].list("rivals")[:MOST_RIVALS])
    return tuple(f"{_set_words(names, evidence)} ({probability(chance)})" for names, chance in found)


NOT_FOLLOWED = (
    "The margin of the turbine temperature is unknown: none of these results follows it; "
    "`trend --what margin --limit COLUMN KELVIN` does."
)


def margin_blocks(engine: EngineEvidence, key: str) -> Iterator[Block]:
    """The chart and what maintenance brought; the first screen has the words. Nothing where no result is of flights."""
    rows = engine.rows_of_kind(result_files.MARGIN)
    found = read_margin(rows)
    if found is None:
        if engine.rows_of_kind(result_files.TREND) or engine.rows_of_kind(result_files.FLIGHTS):
            yield Paragraph(NOT_FOLLOWED, quiet=True)
        return
    chart = margin_forecast(f"{key}-margin", found, maintenance_marks(found))
    if chart is not None:
        yield chart
    gains = read_maintenance(rows)
    if gains:
        yield TableBlock(*maintenance_table(gains))


def place_maintenance(engine: EngineEvidence, order: Order) -> list[EventMark]:
    """Maintenance at its place among the flights of another chart."""
    told = {x.event.number: x.event.words for x in read_maintenance(engine.rows_of_kind(result_files.MARGIN))}
    for row in engine.rows_of_kind(result_files.TREND):
        if row.text("kind") == MAINTENANCE:
            told.setdefault(row.count("onset"), MAINTENANCE)
    places = ((order.number_position(number), words) for number, words in sorted(told.items()) if number)
    return [EventMark(x, words) for x, words in places if x is not None]


def engine_section(engine: EngineEvidence, evidence: ReportEvidence, key: str) -> PageSection:
    """All there is of one engine, in the order in which it is asked; what only an expert needs is folded."""
    blocks = [
        *_one_engine(engine),
        *_health(engine, evidence, key),
        *margin_blocks(engine, key),
        *_deltas(engine, key),
        *_fingerprint(engine, evidence, key),
        *_detection(engine, key),
        *_records(engine, evidence, key),
    ]
    answers = list(_answers(engine, evidence))
    if answers:
        blocks.append(Folded("Each window by itself", [Paragraph(BY_ITSELF, quiet=True), *answers]))
    maps = [operating_line(f"{key}-line-{k}", found) for k, found in enumerate(engine.maps, start=1)]
    if maps:
        blocks.append(Folded("Operating lines on the maps of the compressors", maps))
    apart = _isolability(engine, evidence, key)
    if apart is not None:
        blocks.append(Folded("Isolability: which suspects these sensors separate", [apart]))
    if not blocks:
        blocks = [Paragraph("These results hold nothing of this engine that is drawn.", quiet=True)]
    return PageSection(key, f"Engine {engine.engine}" if engine.engine else "The engine", blocks)


BY_ITSELF = (
    "What each window would say if it were the only one. A window knows less than the series, and may name something "
    "else while a change is small; the first screen rests on all of them."
)


def _isolability(engine: EngineEvidence, evidence: ReportEvidence, key: str) -> Chart | None:
    """Of the last window that has statistics."""
    judged = [(window, origin) for window, origin in engine.windows if window.statistics is not None]
    return isolability(f"{key}-isolability", *judged[-1], evidence.parameters) if judged else None


def _one_engine(engine: EngineEvidence) -> Iterator[Block]:
    """That several recordings without an engine's name were taken for one engine."""
    rows = [row for rows in engine.rows.values() for row in rows]
    sources = dict.fromkeys(source for row in rows if (source := row.text("source")))
    if not engine.engine and len(sources) > 1:
        yield Paragraph(
            f"The recordings {listed(list(sources))} name no engine: they are taken for flights of one, in this order. "
            "Are they of several, make a report of each, or give recordings a column `engine`."
        )


NO_CHANGE = (
    "No change was found. What each flight by itself would say of one parameter of each component if nothing else had "
    "changed, with 95 % intervals: scatter about nominal."
)


def _health(engine: EngineEvidence, evidence: ReportEvidence, key: str) -> Iterator[Block]:
    rows = engine.rows_of_kind(result_files.FLIGHTS)
    changed = [row.text("parameter") for row in engine.changed_rows]
    isolated = engine.isolated[-1][0].list("isolated") if engine.isolated else ()
    followed = bool(engine.rows_of_kind(result_files.TREND))
    alone = conditional_rows(engine.flights or engine.windows, changed or (() if followed else isolated))
    if alone:
        names, caption = list(group_by_parameter(alone)), ALONE
    elif followed and engine.flights and not changed:
        names, caption = evidence.one_of_each_component()[:MOST_CURVES], NO_CHANGE
        alone = [row for name in names for row in conditional_rows(engine.flights, [name])]
        names = list(group_by_parameter(alone))
    elif rows:
        alone, caption = rows, ""
        names = [n for n in changed if n in group_by_parameter(rows)] or _farthest_parameters(rows)
    else:
        if followed:
            yield Paragraph("Health flight by flight is drawn where `trend --what flights` is given, too.", quiet=True)
        return
    order = flight_order(alone)
    marks = [*_onsets(engine, evidence, order), *place_maintenance(engine, order)]
    for number, group in enumerate(_group_by_unit(names, evidence)):
        yield health_trend(
            f"{key}-health{number or ''}", alone, group, evidence.parameters, marks, caption=caption, levels=rows
        )
    heat = health_map(f"{key}-map", rows, evidence.parameters) if rows else None
    if heat is not None:
        yield heat


def _farthest_parameters(rows: Sequence[Row]) -> list[str]:
    """Parameters that are farthest from nominal in the last flight, where no change is reported."""
    last = {name: mine[-1] for name, mine in group_by_parameter(rows).items()}

    def far(name: str) -> float:
        half = (last[name].number("high") - last[name].number("low")) / 2
        return -abs(last[name].number("change")) / half if half > 0 else 0.0

    return sorted(last, key=far)[:3]


def _group_by_unit(names: Sequence[str], evidence: ReportEvidence) -> list[list[str]]:
    found: dict[str, list[str]] = {}
    for name in names:
        found.setdefault(display_scale(evidence.parameters[name])[1], []).append(name)
    return list(found.values())


def _onsets(engine: EngineEvidence, evidence: ReportEvidence, order: Order) -> list[EventMark]:
    """Onsets, once each, with the stretch in which they may lie."""
    found: dict[tuple[int, int, int], list[str]] = {}
    for row in engine.changed_rows:
        place = (row.count("onset"), row.count("onset_low"), row.count("onset_high"))
        known = evidence.parameters[row.text("parameter")]
        found.setdefault(place, []).append(known.part or row.text("component"))
    marks = []
    for (_, low, high), parts in found.items():
        x, until = order.number_position(low), order.number_position(high)
        if x is not None:
            marks.append(EventMark(x, f"onset: {listed(list(dict.fromkeys(parts)))}", until))
    return marks


def _deltas(engine: EngineEvidence, key: str) -> Iterator[Block]:
    """What the alert levels say, and the charts of the deltas; those without levels are closed at first, unless nothing
    else is shown."""
    rows = engine.rows_of_kind(result_files.DELTAS)
    words = level_words(rows)
    alone = not words and not _verdicts(engine)
    if words:
        yield Paragraph(words)
    closed: list[Block] = []
    for number, course in enumerate(delta_courses(rows), start=1):
        chart = delta_chart(f"{key}-delta-{number}", course)
        if course.has_levels or alone:
            yield chart
        else:
            closed.append(chart)
    if closed:
        yield Folded(f"Raw deltas of {'other ' if words else ''}readings, flight by flight", closed)


def _fingerprint(engine: EngineEvidence, evidence: ReportEvidence, key: str) -> Iterator[Block]:
    """Of the last window that has statistics; without a series, of the last that is isolated to something."""
    by_window = {(r.text("source"), r.text("flight"), r.count("first_line")): r for r, *_ in engine.isolated}
    judged = [(w, o, by_window.get((w.source, w.flight, w.first_line))) for w, o in engine.windows if w.statistics]
    named = [entry for entry in judged if entry[2] is not None and entry[2].list("isolated")]
    if not judged:
        return
    events = [event for event in engine.changes if event.remaining or not event.ended]
    window, origin, row = judged[-1] if engine.rows_of_kind(result_files.TREND) else (named or judged)[-1]
    answers = _series_sets(events, evidence) + (_answer_sets(row) if row is not None else [])
    found = window_fingerprint(f"{key}-fingerprint", window, origin, answers, evidence.parameters)
    yield found or Paragraph(
        "A fingerprint needs statistics with every sensor's error: `enginediag residual --sensors`.", quiet=True
    )


AnswerSets = list[tuple[tuple[str, ...], float]]
"""Sets of parameters, each with its probability."""


def _series_sets(events: Sequence[ReportedChange], evidence: ReportEvidence) -> AnswerSets:
    """What the series names, and each other suspect of its first change in place of the one named."""
    if not events:
        return []
    first, *more = ([row.text("parameter") for row in event.changed] for event in events)
    rest = [name for names in more for name in names]
    others = [((*evidence.parameters_of_owner(name), *rest), p) for name, p in events[0].suspects[1:] if p >= UNLIKELY]
    return [((*first, *rest), events[0].own), *others]


def _answer_sets(row: Row) -> AnswerSets:
    """The answer of a window and its alternatives, as sets of parameters."""
    first = (row.list("isolated"), row.number("probability"))
    return [first, *map(parse_alternative, row.list("rivals"))] if first[0] else []


def _detection(engine: EngineEvidence, key: str) -> Iterator[Chart]:
    rows = engine.rows_of_kind(result_files.DETECTED)
    if rows and all(row.number("threshold") > 0 or row.text("verdict") == "no verdict" for row in rows):
        order = order_windows(rows)
        first = first_alarm_of_last_run(rows)
        marks = [] if first is None else [EventMark(order.x[rows.index(first)], "alarms without a break from here")]
        yield detection_course(f"{key}-detect", rows, marks)


def _records(engine: EngineEvidence, evidence: ReportEvidence, key: str) -> Iterator[Block]:
    """Snapshots, residuals and the health of the instruments."""
    records = engine.records
    if records is None:
        yield Paragraph(
            "Residuals over time, snapshots and the instruments' health are drawn from `residual --what records`; over "
            "operating conditions, from recordings with -n NOMINAL.",
            quiet=True,
        )
        return
    yield from snapshots(f"{key}-snapshot", records)
    yield sensors_health(f"{key}-sensors", records, _sensor_error_probability(engine, evidence), engine.masked)
    first = first_alarm_of_last_run(engine.rows_of_kind(result_files.DETECTED))
    late = records if first is None else records.from_flight(first.text("source"), first.text("flight"))
    which = f"from {first.window} on, since when it alarms" if first is not None else "given"
    charts = [residual_course(f"{key}-residuals", records), *residual_drivers(f"{key}-over", late, which)]
    yield Folded("Residuals of the records, over time and over operating conditions", charts)


def _sensor_error_probability(engine: EngineEvidence, evidence: ReportEvidence) -> dict[str, float]:
    """Probability that a sensor reads wrong, by its column, as the trend has it."""
    found: dict[str, float] = {}
    sensors = engine.records.sigmas if engine.records is not None else {}
    columns = {split_column(column)[0]: column for column in sensors}
    for row in engine.rows_of_kind(result_files.TREND):
        known = evidence.parameters[row.text("parameter")]
        column = columns.get(known.part.removesuffix(" sensor"), "")
        if known.belongs_to_sensor and column:
            found[column] = max(found.get(column, 0.0), row.number("probability"))
    return found


ANSWERS = chart_columns(
    "flight",
    "verdict",
    "what changed",
    "probability of this and nothing else that matters",
    "not excluded either, or why not",
)


def _answers(engine: EngineEvidence, evidence: ReportEvidence) -> Iterator[Block]:
    """One row for each window, in words."""
    cells, origins = [], []
    for rows in engine.isolated:
        head = rows[0]
        told = [size_in_words(row, evidence) for row in rows if row.text("parameter")]
        rivals = [
            f"{_set_words(names, evidence)} ({probability(p)})"
            for names, p in map(parse_alternative, head.list("rivals"))
        ]
        sensors = [split_column(column)[0] for column in head.list("would_tell")]
        tell = f"; {listed(sensors, 'or')} would separate them" if sensors else ""
        chance = head.number("probability")
        cells.append(
            (
                head.text("flight") or head.window,
                head.text("verdict"),
                "; ".join(told) or ("no significant change" if head.text("verdict") != "no verdict" else ""),
                "" if chance != chance else probability(chance),
                (head.text("note") or "; ".join(rivals[:MOST_RIVALS])) + tell,
            )
        )
        origins.append(head.origin)
    if cells:
        yield TableBlock("What changed, window by window", ChartTable(ANSWERS, cells, origins))


def _set_words(names: Sequence[str], evidence: ReportEvidence) -> str:
    return listed([p.words for p in meanings(evidence.parameters, names).values()]) or "no change"
