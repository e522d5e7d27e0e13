"""The sections of a report about one engine.

The charts of one engine: what its results give, in the order in which an engineer asks.

The margin of one engine: flight by flight, how long it lasts, and what maintenance brought.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence

from enginediag_cli.fleets.finding import Estimate
from enginediag_cli.parameters import meanings
from enginediag_cli.report.charts.health_trend import (
    Brought,
    Course,
    flight_order,
    health_map,
    health_trend,
    maintenance_found,
    maintenance_marks,
    margin,
    margin_found,
    of_parameters,
)
from enginediag_cli.report.charts.model import Chart, Column, Mark, Table, Value, scale_of
from enginediag_cli.report.charts.residual_charts import (
    MOST_RIVALS,
    detection_course,
    residual_course,
    residual_drivers,
    sensors_health,
    snapshots,
    window_fingerprint,
)
from enginediag_cli.report.charts.rows import ALONE, Order, Row, given_rows, order_of, rival
from enginediag_cli.report.page import results as kinds
from enginediag_cli.report.page.evidence import EngineEvidence, Evidence
from enginediag_cli.report.page.page import Block, Section, Tabled, Words
from enginediag_cli.report.page.verdicts import changed_in_trend, first_of_last_run, size_in_words
from enginediag_cli.report.sentences import listed, probability, with_unit
from enginediag_cli.report.trend_rows import margin_words
from enginediag_cli.report.work_scope_rows import MAINTENANCE
from enginediag_cli.units import split_column

NOT_FOLLOWED = (
    "Cannot tell the margin of the turbine temperature, because none of these results follows it: "
    "`trend --what margin --limit COLUMN KELVIN` does."
)


def margin_blocks(engine: EngineEvidence, key: str) -> Iterator[Block]:
    """Nothing where no result is of flights at all."""
    rows = engine.of(kinds.MARGIN)
    found = margin_found(rows)
    if found is None:
        if engine.of(kinds.TREND) or engine.of(kinds.FLIGHTS):
            yield Words(NOT_FOLLOWED, quiet=True)
        return
    told = margin_words(found.margin)
    yield Words(f"{told[0].upper()}{told[1:]}.")
    chart = margin(f"{key}-margin", found, maintenance_marks(found))
    if chart is not None:
        yield chart
    yield from _table(maintenance_found(rows))


def maintenance_in(engine: EngineEvidence, order: Order) -> list[Mark]:
    """Maintenance at its place among the flights of another chart."""
    told = {x.event.number: x.event.words for x in maintenance_found(engine.of(kinds.MARGIN))}
    for row in engine.of(kinds.TREND):
        if row.text("kind") == MAINTENANCE:
            told.setdefault(row.count("onset"), MAINTENANCE)
    places = ((order.at(number), words) for number, words in sorted(told.items()) if number)
    return [Mark(x, words) for x, words in places if x is not None]


COLUMNS = (
    Column("maintenance"),
    Column("before flight"),
    Column("what changed, 95 %"),
    Column("turbine temperature"),
    Column("fuel flow"),
    Column("margin recovered"),
    Column("note"),
)


def _table(events: Sequence[Brought]) -> Iterator[Block]:
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
                _fell(x.temperature_K, "K"),
                _fell(x.fuel_percent, "%"),
                _size(e.recovered_K, "K"),
                e.reason,
            )
        )
    held = next((x.held for x in events if x.held), "")
    title = "What maintenance brought" + (f" ({held})" if held else "")
    yield Tabled(title, Table(COLUMNS, rows, [x.event.origin for x in events]))


def _fell(gain: Estimate, unit: str) -> str:
    """A gain is a fall of temperature or fuel."""
    if not math.isfinite(gain.value):
        return ""
    size = with_unit(abs(gain.value), unit, (gain.high - gain.low) / 2)
    return f"{'fell' if gain.value >= 0 else 'rose'} by {size}"


def _size(x: Estimate, unit: str) -> str:
    if not math.isfinite(x.value):
        return ""
    return with_unit(x.value, unit, (x.high - x.low) / 2).replace("-", "−")


def engine_section(engine: EngineEvidence, evidence: Evidence, key: str) -> Section:
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
        blocks = [Words("These results hold nothing of this engine that is drawn.", quiet=True)]
    return Section(key, f"Engine {engine.engine}" if engine.engine else "The engine", blocks)


def _one_engine(engine: EngineEvidence) -> Iterator[Block]:
    """That several recordings without an engine's name were taken for one engine."""
    rows = [row for rows in engine.rows.values() for row in rows]
    sources = dict.fromkeys(source for row in rows if (source := row.text("source")))
    if not engine.engine and len(sources) > 1:
        yield Words(
            f"The recordings {listed(list(sources))} name no engine: they are taken for flights of one, in this order. "
            "Are they of several, make a report of each, or give recordings a column `engine`."
        )


def _health(engine: EngineEvidence, evidence: Evidence, key: str) -> Iterator[Block]:
    rows = engine.of(kinds.FLIGHTS)
    changed = [row.text("parameter") for row in changed_in_trend(engine)]
    courses = {row.text("parameter"): _course_of(row) for row in changed_in_trend(engine)}
    isolated = engine.isolated[-1][0].list("isolated") if engine.isolated else ()
    alone = given_rows(engine.windows, changed or isolated)
    if alone:
        names, told = list(of_parameters(alone)), ALONE
    elif rows:
        alone, told = rows, ""
        names = [n for n in changed if n in of_parameters(rows)] or _farthest(rows)
    else:
        if engine.of(kinds.TREND):
            yield Words("Health flight by flight is drawn where `trend --what flights` is given, too.", quiet=True)
        return
    order = flight_order(alone)
    marks = [*_onsets(engine, evidence, order), *maintenance_in(engine, order)]
    for number, group in enumerate(_by_unit(names, evidence)):
        yield health_trend(
            f"{key}-health{number or ''}", alone, group, evidence.known, marks, caption=told, courses=courses
        )
    if rows:
        yield health_map(f"{key}-map", rows, evidence.known)


def _course_of(row: Row) -> Course:
    sizes = (row.number("change"), row.number("change_low"), row.number("change_high"))
    return Course(row.count("onset"), row.text("kind") == "step", *sizes)


def _farthest(rows: Sequence[Row]) -> list[str]:
    """Parameters of components that are farthest from nominal in the last flight, where nothing is told to have
    changed."""
    last = {name: mine[-1] for name, mine in of_parameters(rows).items()}

    def far(name: str) -> float:
        half = (last[name].number("high") - last[name].number("low")) / 2
        return -abs(last[name].number("change")) / half if half > 0 else 0.0

    return sorted(last, key=far)[:3]


def _by_unit(names: Sequence[str], evidence: Evidence) -> list[list[str]]:
    found: dict[str, list[str]] = {}
    for name in names:
        found.setdefault(scale_of(evidence.known[name])[1], []).append(name)
    return list(found.values())


def _onsets(engine: EngineEvidence, evidence: Evidence, order: Order) -> list[Mark]:
    """Onsets, once each, with the stretch in which they may lie."""
    found: dict[tuple[int, int, int], list[str]] = {}
    for row in changed_in_trend(engine):
        place = (row.count("onset"), row.count("onset_low"), row.count("onset_high"))
        known = evidence.known[row.text("parameter")]
        found.setdefault(place, []).append(known.part or row.text("component"))
    marks = []
    for (_, low, high), parts in found.items():
        x, until = order.at(low), order.at(high)
        if x is not None:
            marks.append(Mark(x, f"onset: {listed(list(dict.fromkeys(parts)))}", until))
    return marks


def _fingerprint(engine: EngineEvidence, evidence: Evidence, key: str) -> Iterator[Block]:
    """Of the last window that has statistics and is isolated to something; else of the last one."""
    by_window = {_place(rows[0]): rows[0] for rows in engine.isolated}
    told = [(w, o, by_window.get((w.source, w.flight, w.first_line))) for w, o in engine.windows if w.statistics]
    named = [entry for entry in told if entry[2] is not None and entry[2].list("isolated")]
    if not told:
        return
    window, origin, row = (named or told)[-1]
    answers = _sets(row) if row is not None else []
    found = window_fingerprint(f"{key}-fingerprint", window, origin, answers, evidence.known)
    yield found or Words(
        "A fingerprint needs statistics with every sensor's error: `enginediag residual --sensors`.", quiet=True
    )


def _place(row: Row) -> tuple[str, str, int]:
    return row.text("source"), row.text("flight"), row.count("first_line")


def _sets(row: Row) -> list[tuple[tuple[str, ...], float]]:
    """The answer and its leading rivals, as sets of parameters."""
    first = (row.list("isolated"), row.number("probability"))
    return [first, *map(rival, row.list("rivals")[:MOST_RIVALS])] if first[0] else []


def _detection(engine: EngineEvidence, key: str) -> Iterator[Chart]:
    rows = engine.of(kinds.DETECTED)
    if rows and all(row.number("threshold") > 0 or row.text("verdict") == "no verdict" for row in rows):
        order = order_of(rows)
        first = first_of_last_run(rows)
        marks = [] if first is None else [Mark(order.x[rows.index(first)], "alarms without a break from here")]
        yield detection_course(f"{key}-detect", rows, marks)


def _records(engine: EngineEvidence, evidence: Evidence, key: str) -> Iterator[Block]:
    """Snapshots, residuals and the health of the instruments."""
    records = engine.records
    if records is None:
        yield Words(
            "Residuals over time, snapshots and the instruments' health are drawn from `residual --what records`; over "
            "operating conditions, from recordings with -n NOMINAL.",
            quiet=True,
        )
        return
    yield from snapshots(f"{key}-snapshot", records)
    yield residual_course(f"{key}-residuals", records)
    first = first_of_last_run(engine.of(kinds.DETECTED))
    late = records if first is None else records.since(first.text("source"), first.text("flight"))
    which = f"from {first.window} on, since when it alarms" if first is not None else "given"
    yield from residual_drivers(f"{key}-over", late, which)
    yield sensors_health(f"{key}-sensors", records, _wrong(engine, evidence), engine.masked)


def _wrong(engine: EngineEvidence, evidence: Evidence) -> dict[str, float]:
    """Probability that a sensor reads wrong, by its column, as the trend has it."""
    found: dict[str, float] = {}
    sensors = engine.records.sigmas if engine.records is not None else {}
    columns = {split_column(column)[0]: column for column in sensors}
    for row in engine.of(kinds.TREND):
        known = evidence.known[row.text("parameter")]
        column = columns.get(known.part.removesuffix(" sensor"), "")
        if known.of_sensor and column:
            found[column] = max(found.get(column, 0.0), row.number("probability"))
    return found


ANSWERS = (
    Column("flight"),
    Column("verdict"),
    Column("what changed"),
    Column("probability of this and nothing else that matters"),
    Column("not excluded either, or why not"),
)


def _answers(engine: EngineEvidence, evidence: Evidence) -> Iterator[Block]:
    """One row for each window, in words."""
    cells, origins = [], []
    for rows in engine.isolated:
        head = rows[0]
        told = [size_in_words(row, evidence) for row in rows if row.text("parameter")]
        rivals = [f"{_named(names, evidence)} ({probability(p)})" for names, p in map(rival, head.list("rivals"))]
        sensors = [split_column(column)[0] for column in head.list("would_tell")]
        tell = f"; {listed(sensors, 'or')} would tell" if sensors else ""
        chance = head.number("probability")
        cells.append(
            (
                head.text("flight") or head.window,
                head.text("verdict"),
                "; ".join(told) or ("nothing stands out" if head.text("verdict") != "no verdict" else ""),
                "" if chance != chance else probability(chance),
                (head.text("note") or "; ".join(rivals[:MOST_RIVALS])) + tell,
            )
        )
        origins.append(head.origin)
    if cells:
        yield Tabled("What changed, window by window", Table(ANSWERS, cells, origins))


def _named(names: Sequence[str], evidence: Evidence) -> str:
    return listed([p.words for p in meanings(evidence.known, names).values()]) or "no change"
