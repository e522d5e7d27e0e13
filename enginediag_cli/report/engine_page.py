"""What a report says of one engine: its first screen, and its section of charts and tables.

The first screen is one answer out of all files, the most that any of them shows, and the next step that follows from
it. The section follows the order in which an engineer asks.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence

from enginediag_cli.detection.verdict import format_size
from enginediag_cli.fleets.findings import IntervalEstimate
from enginediag_cli.parameters import Parameter, meanings
from enginediag_cli.report import result_files
from enginediag_cli.report.evidence import EngineEvidence, ReportEvidence
from enginediag_cli.report.html import Block, EngineState, Lead, PageSection, Paragraph, TableBlock, next_step
from enginediag_cli.report.plotting import Chart, ChartTable, EventMark, Value, chart_columns
from enginediag_cli.report.plotting.health import (
    MaintenanceGain,
    TrendCourse,
    flight_order,
    group_by_parameter,
    health_map,
    health_trend,
    maintenance_marks,
    margin_forecast,
    read_maintenance,
    read_margin,
)
from enginediag_cli.report.plotting.models import LASTING
from enginediag_cli.report.plotting.residuals import (
    MOST_RIVALS,
    detection_course,
    residual_course,
    residual_drivers,
    sensors_health,
    snapshots,
    window_fingerprint,
)
from enginediag_cli.report.result_files import ALONE, Order, Row, conditional_rows, order_windows, parse_alternative
from enginediag_cli.report.sentences import change, count, display_scale, format_quantity, listed, probability, rounded
from enginediag_cli.report.tables.answers import MAINTENANCE
from enginediag_cli.report.tables.fleet import margin_words
from enginediag_cli.report.tables.isolation import CANNOT_TELL
from enginediag_cli.report.tables.trend import COURSE_WORDS
from enginediag_cli.units import split_column

LIKELY, SETTLED = 0.5, 0.9
"""Probability from which a parameter is reported as changed, and which the likeliest must have for the answer to
be in the headline without a doubt."""
MISFIT = 2.0
"""reduced χ² of a window, after its answer, from which no answer explains what was read. Judgement."""


def engine_lead(engine: EngineEvidence, evidence: ReportEvidence, key: str) -> Lead:
    """The first screen of an engine."""
    found = (
        _trend_answer(engine, evidence) or _isolation_answer(engine, evidence) or _detection_answer(engine, evidence)
    )
    state, sentence, names = _flag_misfit(engine, found)
    return Lead(
        state,
        sentence,
        engine.engine,
        confidence=_confidence_words(engine),
        onset=_onset_words(engine, state),
        margin=_margin(engine),
        next_step=next_step(
            state,
            [evidence.parameters[n] for n in names if n in evidence.parameters],
            _separating_sensors(engine),
            _advice(engine),
        ),
        sensitivity=_sensitivity_words(engine),
        alternatives=_alternatives(engine, evidence),
        key=key,
    )


_Found = tuple[EngineState, str, Sequence[str]]


def _flag_misfit(engine: EngineEvidence, found: _Found) -> _Found:
    """The answer, reported as the likeliest account of something that the model does not explain where that is so."""
    state, sentence, names = found
    fit = engine.isolated[-1][0].number("fit") if engine.isolated else math.nan
    if state not in (EngineState.CHANGED, EngineState.CANNOT_TELL) or not fit > MISFIT:
        return found
    told = f"The readings depart from nominal, and no change explains them (reduced χ² {rounded(fit)}): "
    return EngineState.CANNOT_TELL, f"{told}ask explain what the model lacks. Nearest to it: {sentence}", names


DETECTABLE = "detectable:"
"""Begin of the columns of `detect` that hold the smallest changes that would have shown."""
UNCHANGED = ("", "steady", "cannot tell", MAINTENANCE)
"""Kinds of rows of `trend` that report no change."""


def changed_in_trend(engine: EngineEvidence) -> list[Row]:
    """Rows of `trend` of parameters that have probably changed."""
    rows = [row for row in engine.rows_of_kind(result_files.TREND) if row.text("kind") not in UNCHANGED]
    return [row for row in rows if row.number("probability") >= LIKELY]


def _trend_answer(engine: EngineEvidence, evidence: ReportEvidence) -> _Found | None:
    rows = engine.rows_of_kind(result_files.TREND)
    changed = changed_in_trend(engine)
    if changed:
        told, names = (
            listed([_trend_change(row, evidence) for row in changed]),
            [row.text("parameter") for row in changed],
        )
        most = max(row.number("probability") for row in changed)
        if most < SETTLED:
            doubt = f"Something changed, and what is not settled; the likeliest ({probability(most)}): {told}."
            return EngineState.CANNOT_TELL, doubt, names
        return EngineState.CHANGED, f"{told}.", names
    suspects = [row for row in rows if row.text("kind") not in UNCHANGED]
    if suspects and rows[0].text("verdict") == "changed":
        parts = {row.text("component"): row for row in suspects}
        each = [f"{_part(row, evidence)} ({probability(row.number('probability'))})" for row in parts.values()]
        return (
            EngineState.CANNOT_TELL,
            f"Something changed, and these flights do not separate the suspects: {listed(each, 'or')}.",
            [row.text("parameter") for row in suspects],
        )
    if rows and rows[0].text("verdict") == CANNOT_TELL:
        alone = _isolation_answer(engine, evidence)
        scatter = "A change over these flights is indistinguishable from their scatter."
        if alone is None or alone[0] is not EngineState.CHANGED:
            return EngineState.CANNOT_TELL, scatter, []
        return EngineState.CANNOT_TELL, f"{scatter} The last window by itself: {alone[1]}", alone[2]
    return None


def _trend_change(row: Row, evidence: ReportEvidence) -> str:
    half = (row.number("change_high") - row.number("change_low")) / 2
    return change(evidence.parameters[row.text("parameter")], row.number("change"), half)


def _part(row: Row, evidence: ReportEvidence) -> str:
    known = evidence.parameters[row.text("parameter")]
    return known.part or row.text("component")


def _isolation_answer(engine: EngineEvidence, evidence: ReportEvidence) -> _Found | None:
    windows = [rows for rows in engine.isolated if rows[0].text("verdict") != "no verdict"]
    if not windows:
        return None
    last, head = windows[-1], windows[-1][0]
    names = head.list("isolated")
    if head.text("verdict") == CANNOT_TELL:
        return (
            EngineState.CANNOT_TELL,
            f"{_capital(head.window)}: {head.text('note') or 'what changed is unknown'}.",
            names,
        )
    if members := head.list("members"):
        words = [
            listed([p.words for p in meanings(evidence.parameters, parse_alternative(m)[0] or (m,)).values()])
            for m in members
        ]
        return (
            EngineState.CANNOT_TELL,
            f"{_capital(head.window)}: one of these changed, and the data do not separate them: {listed(words, 'or')} "
            f"(together {probability(head.number('class'))}).",
            names,
        )
    if names:
        told = [size_in_words(row, evidence) for row in last if row.text("parameter")]
        return EngineState.CHANGED, f"{listed(told) or listed(list(names))}.", names
    if head.text("verdict") == "fault":
        return (
            EngineState.CANNOT_TELL,
            f"{_capital(head.window)} departs from nominal, and no single parameter explains it.",
            (),
        )
    return _no_alarm_answer(engine, evidence)


def size_in_words(row: Row, evidence: ReportEvidence) -> str:
    """The change of one isolated parameter with half its interval."""
    half = (row.number("upper") - row.number("lower")) / 2
    return change(evidence.parameters[row.text("parameter")], row.number("change"), half)


def _detection_answer(engine: EngineEvidence, evidence: ReportEvidence) -> _Found:
    rows = [row for row in engine.rows_of_kind(result_files.DETECTED) if row.text("verdict") != "no verdict"]
    if rows and rows[-1].text("verdict") == "fault":
        told = f"The engine departs from nominal in {rows[-1].window}; what changed has not been asked."
        return EngineState.CHANGED, told, ()
    return _no_alarm_answer(engine, evidence)


def _no_alarm_answer(engine: EngineEvidence, evidence: ReportEvidence) -> _Found:
    """Nothing in the last window, or nothing at all: never more than the tests say, and with their power."""
    judged = [r for r in _verdicts(engine) if r.text("verdict") != "no verdict"]
    if not judged:
        reasons = sorted({r.text("reason") or r.text("note") for r in _verdicts(engine)} - {""})
        why = f": {reasons[0]}" if reasons else ""
        return EngineState.NO_VERDICT, f"Nothing could be judged{why}.", ()
    alarms = [row for row in judged if row.text("verdict") == "fault"]
    if alarms and judged[-1].text("verdict") != "fault":
        told = f"The last window agrees with nominal; {count(len(alarms), 'earlier window')} of {len(judged)} did not."
        return EngineState.CANNOT_TELL, told, ()
    power = _power(judged[-1], evidence)
    return (
        EngineState.NOTHING_FOUND,
        f"All {count(len(judged), 'window')} judged agree with the nominal engine.{power}",
        (),
    )


def _power(window: Row, evidence: ReportEvidence) -> str:
    """What the window would have shown: of each component the smallest change of a parameter, where `detect` says."""
    smallest: dict[str, tuple[float, Parameter]] = {}
    for name in window.cells:
        parameter = evidence.parameters.get(name.removeprefix(DETECTABLE)) if name.startswith(DETECTABLE) else None
        if parameter is None or parameter.belongs_to_instrument or not math.isfinite(window.number(name)):
            continue
        known = smallest.get(parameter.component)
        if known is None or window.number(name) < known[0]:
            smallest[parameter.component] = (window.number(name), parameter)
    if not smallest:
        return ""
    told = [f"{p.words or p.name} by {format_size(p, size)}" for size, p in smallest.values()]
    return f" The last would have shown a change of {listed(told, 'or')}."


def _verdicts(engine: EngineEvidence) -> list[Row]:
    """One row for each window that was judged or should have been."""
    return (
        engine.rows_of_kind(result_files.DETECTED)
        or [rows[0] for rows in engine.isolated]
        or engine.rows_of_kind(result_files.COMPONENTS)
    )


def _confidence_words(engine: EngineEvidence) -> str:
    told = []
    changed = changed_in_trend(engine)
    if changed:
        row = max(changed, key=lambda r: r.number("probability"))
        flights = count(row.count("flights"), "flight" if row.text("onset_flight") else "window")
        told.append(f"probability {probability(row.number('probability'))} by the trend over {flights}")
    elif (trend := engine.rows_of_kind(result_files.TREND)) and trend[0].text("verdict") == "steady":
        told.append(f"the trend over {count(trend[0].count('flights'), 'flight')} shows no change")
    windows = [rows[0] for rows in engine.isolated if not math.isnan(rows[0].number("probability"))]
    if windows:
        head = windows[-1]
        fit = head.number("fit")
        fits = f", reduced χ² {rounded(fit)} with it" if math.isfinite(fit) else ""
        exact = "this and nothing else that matters" if head.list("isolated") else "nothing that matters"
        told.append(f"{head.window} alone: {exact} with probability {probability(head.number('probability'))}{fits}")
    detected = engine.rows_of_kind(result_files.DETECTED)
    if detected:
        alarms = sum(row.text("verdict") == "fault" for row in detected)
        silent = sum(row.text("verdict") == "no verdict" for row in detected)
        without = f", {silent} without verdict" if silent else ""
        quiet = " but not the last" if changed and detected[-1].text("verdict") == "healthy" else ""
        told.append(f"{alarms} of {count(len(detected), 'window')} alarm{quiet}{without}")
    return "; ".join(told)


def _onset_words(engine: EngineEvidence, state: EngineState) -> str:
    if state is EngineState.NOTHING_FOUND or state is EngineState.NO_VERDICT:
        return ""
    changed = changed_in_trend(engine)
    if changed:
        row = min(changed, key=lambda r: r.number("onset"))
        word = COURSE_WORDS.get(row.text("kind"), row.text("kind"))
        flight = row.text("onset_flight") or f"stretch {row.count('onset')}"
        low, high = row.count("onset_low"), row.count("onset_high")
        within = "" if low == high else f"; counted from the first, between {low} and {high}"
        named = f"flight {flight}" if row.text("onset_flight") else flight
        return f"{named}, {word}{within}"
    run = first_alarm_of_last_run(engine.rows_of_kind(result_files.DETECTED))
    return f"{run.window}, the first of an unbroken run of alarms" if run is not None else ""


def _margin(engine: EngineEvidence) -> str:
    """How far the turbine temperature is from its limit, where a result follows it."""
    found = read_margin(engine.rows_of_kind(result_files.MARGIN))
    return f"{_capital(margin_words(found.margin))}." if found is not None else ""


def first_alarm_of_last_run(rows: Sequence[Row]) -> Row | None:
    """The window from which on every judged window alarms; None where the last does not."""
    first = None
    for row in reversed([r for r in rows if r.text("verdict") != "no verdict"]):
        if row.text("verdict") != "fault":
            break
        first = row
    return first


def _separating_sensors(engine: EngineEvidence) -> Sequence[str]:
    return engine.isolated[-1][0].list("would_tell") if engine.isolated else ()


def _advice(engine: EngineEvidence) -> Sequence[str]:
    """What `isolate` advised, and what restoring a module would bring."""
    if not engine.isolated:
        return ()
    head = engine.isolated[-1][0]
    scope = head.cells.get("work_scope")
    told = scope.get("told", ()) if isinstance(scope, dict) else head.list("work_scope")
    return (*head.list("advice"), *(f"{_capital(str(sentence))}." for sentence in told))


def _sensitivity_words(engine: EngineEvidence) -> tuple[str, ...]:
    """Sensitivity of the conclusion, as `isolate` writes it."""
    flips = engine.isolated[-1][0].cells.get("flips") if engine.isolated else None
    if isinstance(flips, list):
        return tuple(str(f.get("words", f)) if isinstance(f, dict) else str(f) for f in flips)
    return engine.isolated[-1][0].list("flips") if flips else ()


def _alternatives(engine: EngineEvidence, evidence: ReportEvidence) -> tuple[str, ...]:
    """What else the data do not exclude."""
    if not engine.isolated:
        return ()
    head, told = engine.isolated[-1][0], []
    for names, chance in map(parse_alternative, head.list("rivals")[:2]):
        words = listed([p.words for p in meanings(evidence.parameters, names).values()]) or "no change"
        told.append(f"{words} ({probability(chance)})")
    return tuple(told)


def _capital(text: str) -> str:
    return text[:1].upper() + text[1:]


NOT_FOLLOWED = (
    "The margin of the turbine temperature is unknown: none of these results follows it; "
    "`trend --what margin --limit COLUMN KELVIN` does."
)


def margin_blocks(engine: EngineEvidence, key: str) -> Iterator[Block]:
    """Nothing where no result is of flights at all."""
    rows = engine.rows_of_kind(result_files.MARGIN)
    found = read_margin(rows)
    if found is None:
        if engine.rows_of_kind(result_files.TREND) or engine.rows_of_kind(result_files.FLIGHTS):
            yield Paragraph(NOT_FOLLOWED, quiet=True)
        return
    told = margin_words(found.margin)
    yield Paragraph(f"{told[0].upper()}{told[1:]}.")
    chart = margin_forecast(f"{key}-margin", found, maintenance_marks(found))
    if chart is not None:
        yield chart
    yield from _maintenance_table(read_maintenance(rows))


def place_maintenance(engine: EngineEvidence, order: Order) -> list[EventMark]:
    """Maintenance at its place among the flights of another chart."""
    told = {x.event.number: x.event.words for x in read_maintenance(engine.rows_of_kind(result_files.MARGIN))}
    for row in engine.rows_of_kind(result_files.TREND):
        if row.text("kind") == MAINTENANCE:
            told.setdefault(row.count("onset"), MAINTENANCE)
    places = ((order.number_position(number), words) for number, words in sorted(told.items()) if number)
    return [EventMark(x, words) for x, words in places if x is not None]


COLUMNS = chart_columns(
    "maintenance", "before flight", "what changed, 95 %", "turbine temperature", "fuel flow", "margin recovered", "note"
)


def _maintenance_table(events: Sequence[MaintenanceGain]) -> Iterator[Block]:
    if not events:
        return
    rows: list[tuple[Value, ...]] = []
    for x in events:
        e = x.event
        rows.append(
            (
                e.words,
                x.flight or e.number or "none recorded",
                listed(list(x.gains)),
                _fall_words(x.temperature_K, "K"),
                _fall_words(x.fuel_percent, "%"),
                _size(e.recovered_K, "K"),
                e.reason,
            )
        )
    held = next((x.at_equal for x in events if x.at_equal), "")
    title = "What maintenance brought" + (f" ({held})" if held else "")
    yield TableBlock(title, ChartTable(COLUMNS, rows, [x.event.origin for x in events]))


def _fall_words(gain: IntervalEstimate, unit: str) -> str:
    """A gain is a fall of temperature or fuel."""
    if not math.isfinite(gain.value):
        return ""
    size = format_quantity(abs(gain.value), unit, (gain.high - gain.low) / 2)
    return f"{'fell' if gain.value >= 0 else 'rose'} by {size}"


def _size(x: IntervalEstimate, unit: str) -> str:
    if not math.isfinite(x.value):
        return ""
    return format_quantity(x.value, unit, (x.high - x.low) / 2).replace("-", "−")


def engine_section(engine: EngineEvidence, evidence: ReportEvidence, key: str) -> PageSection:
    """All there is of one engine."""
    blocks = [
        *_one_engine(engine),
        *_health(engine, evidence, key),
        *margin_blocks(engine, key),
        *_fingerprint(engine, evidence, key),
        *_detection(engine, key),
    ]
    blocks += [*_answers(engine, evidence), *_records(engine, evidence, key)]
    if not blocks:
        blocks = [Paragraph("These results hold nothing of this engine that is drawn.", quiet=True)]
    return PageSection(key, f"Engine {engine.engine}" if engine.engine else "The engine", blocks)


def _one_engine(engine: EngineEvidence) -> Iterator[Block]:
    """That several recordings without an engine's name were taken for one engine."""
    rows = [row for rows in engine.rows.values() for row in rows]
    sources = dict.fromkeys(source for row in rows if (source := row.text("source")))
    if not engine.engine and len(sources) > 1:
        yield Paragraph(
            f"The recordings {listed(list(sources))} name no engine: they are taken for flights of one, in this order. "
            "Are they of several, make a report of each, or give recordings a column `engine`."
        )


def _health(engine: EngineEvidence, evidence: ReportEvidence, key: str) -> Iterator[Block]:
    rows = engine.rows_of_kind(result_files.FLIGHTS)
    changed = [row.text("parameter") for row in changed_in_trend(engine)]
    courses = {
        row.text("parameter"): _read_course(row)
        for row in changed_in_trend(engine)
        if row.text("kind") in LASTING and not row.text("end")
    }
    isolated = engine.isolated[-1][0].list("isolated") if engine.isolated else ()
    alone = conditional_rows(engine.windows, changed or isolated)
    if alone:
        names, told = list(group_by_parameter(alone)), ALONE
    elif rows:
        alone, told = rows, ""
        names = [n for n in changed if n in group_by_parameter(rows)] or _farthest_parameters(rows)
    else:
        if engine.rows_of_kind(result_files.TREND):
            yield Paragraph("Health flight by flight is drawn where `trend --what flights` is given, too.", quiet=True)
        return
    order = flight_order(alone)
    marks = [*_onsets(engine, evidence, order), *place_maintenance(engine, order)]
    for number, group in enumerate(_group_by_unit(names, evidence)):
        yield health_trend(
            f"{key}-health{number or ''}", alone, group, evidence.parameters, marks, caption=told, courses=courses
        )
    if rows:
        yield health_map(f"{key}-map", rows, evidence.parameters)


def _read_course(row: Row) -> TrendCourse:
    sizes = (row.number("change"), row.number("change_low"), row.number("change_high"))
    return TrendCourse(row.count("onset"), row.text("kind") == "step", *sizes)


def _farthest_parameters(rows: Sequence[Row]) -> list[str]:
    """Parameters of components that are farthest from nominal in the last flight, where no change is
    reported."""
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
    for row in changed_in_trend(engine):
        place = (row.count("onset"), row.count("onset_low"), row.count("onset_high"))
        known = evidence.parameters[row.text("parameter")]
        found.setdefault(place, []).append(known.part or row.text("component"))
    marks = []
    for (_, low, high), parts in found.items():
        x, until = order.number_position(low), order.number_position(high)
        if x is not None:
            marks.append(EventMark(x, f"onset: {listed(list(dict.fromkeys(parts)))}", until))
    return marks


def _fingerprint(engine: EngineEvidence, evidence: ReportEvidence, key: str) -> Iterator[Block]:
    """Of the last window that has statistics and is isolated to something; else of the last one."""
    by_window = {(r.text("source"), r.text("flight"), r.count("first_line")): r for r, *_ in engine.isolated}
    told = [(w, o, by_window.get((w.source, w.flight, w.first_line))) for w, o in engine.windows if w.statistics]
    named = [entry for entry in told if entry[2] is not None and entry[2].list("isolated")]
    if not told:
        return
    window, origin, row = (named or told)[-1]
    answers = _answer_sets(row) if row is not None else []
    found = window_fingerprint(f"{key}-fingerprint", window, origin, answers, evidence.parameters)
    yield found or Paragraph(
        "A fingerprint needs statistics with every sensor's error: `enginediag residual --sensors`.", quiet=True
    )


def _answer_sets(row: Row) -> list[tuple[tuple[str, ...], float]]:
    """The answer and its leading alternatives, as sets of parameters."""
    first = (row.list("isolated"), row.number("probability"))
    return [first, *map(parse_alternative, row.list("rivals")[:MOST_RIVALS])] if first[0] else []


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
    yield residual_course(f"{key}-residuals", records)
    first = first_alarm_of_last_run(engine.rows_of_kind(result_files.DETECTED))
    late = records if first is None else records.from_flight(first.text("source"), first.text("flight"))
    which = f"from {first.window} on, since when it alarms" if first is not None else "given"
    yield from residual_drivers(f"{key}-over", late, which)
    yield sensors_health(f"{key}-sensors", records, _sensor_error_probability(engine, evidence), engine.masked)


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
