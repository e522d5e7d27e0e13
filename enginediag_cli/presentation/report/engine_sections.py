"""The charts of one engine: what its results give, in the order in which an engineer asks."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from enginediag_cli.isolation.fingerprint import fingerprint
from enginediag_cli.parameters import meanings
from enginediag_cli.presentation.charts.detection_course import detection_course
from enginediag_cli.presentation.charts.fingerprint import Answer, Deviations
from enginediag_cli.presentation.charts.fingerprint import fingerprint as fingerprint_chart
from enginediag_cli.presentation.charts.health_trend import flight_order, health_map, health_trend, of_parameters
from enginediag_cli.presentation.charts.model import Chart, Column, Mark, Table
from enginediag_cli.presentation.charts.order import Order, order_of
from enginediag_cli.presentation.charts.rows import Row, rival
from enginediag_cli.presentation.charts.sizes import scale_of
from enginediag_cli.presentation.names import listed
from enginediag_cli.presentation.numbers import probability
from enginediag_cli.presentation.report.evidence import EngineEvidence, Evidence
from enginediag_cli.presentation.report.page import Block, Section, Tabled, Words
from enginediag_cli.presentation.report.results import kinds
from enginediag_cli.presentation.report.verdicts import changed_in_trend, first_of_last_run
from enginediag_cli.units import split_column

MOST_RIVALS = 2
"""Answers beside the first in a fingerprint: more bars are not told apart."""


def engine_section(engine: EngineEvidence, evidence: Evidence, key: str) -> Section:
    """All there is of one engine."""
    blocks = [*_health(engine, evidence, key), *_fingerprint(engine, evidence, key), *_detection(engine, key)]
    blocks += [*_answers(engine, evidence)]
    if not blocks:
        blocks = [Words("These results hold nothing of this engine that is drawn.", quiet=True)]
    return Section(key, f"Engine {engine.engine}" if engine.engine else "The engine", blocks)


def _health(engine: EngineEvidence, evidence: Evidence, key: str) -> Iterator[Block]:
    rows = engine.of(kinds.FLIGHTS)
    if not rows:
        if engine.of(kinds.TREND):
            yield Words("Health flight by flight is drawn where `trend --what flights` is given, too.", quiet=True)
        return
    order = flight_order(rows)
    names = list(of_parameters(rows))
    changed = [row.text("parameter") for row in changed_in_trend(engine)]
    changed = [name for name in changed if name in names] or _farthest(rows)
    for number, group in enumerate(_by_unit(changed, evidence)):
        yield health_trend(f"{key}-health{number or ''}", rows, group, evidence.known, _events(engine, order))
    yield health_map(f"{key}-map", rows, evidence.known)


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


def _events(engine: EngineEvidence, order: Order) -> list[Mark]:
    """Onsets, once each, with the stretch in which they may lie."""
    found: dict[tuple[int, int, int], list[str]] = {}
    for row in changed_in_trend(engine):
        place = (row.count("onset"), row.count("onset_low"), row.count("onset_high"))
        found.setdefault(place, []).append(row.text("component"))
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
    assert window.statistics is not None
    answers = _sets(row) if row is not None else []
    found = fingerprint(window.statistics, [names for names, _ in answers])
    if found is None:
        yield Words(
            "A fingerprint needs statistics with every sensor's error: `enginediag residual --sensors`.", quiet=True
        )
        return
    known = window.statistics.meaning
    words = [known[name].part.removesuffix(" sensor") for name in found.biases]
    units = [known[name].shown_unit for name in found.biases]
    name = (
        f"flight {window.flight}"
        if window.flight
        else f"{window.source}, lines {window.first_line} to {window.last_line}"
    )
    foretold = [
        Answer(listed([p.words for p in meanings(evidence.known, names).values()]) or "no change", chance, list(values))
        for (names, chance), values in zip(answers, found.foretold.tolist(), strict=True)
    ]
    yield fingerprint_chart(
        f"{key}-fingerprint",
        Deviations(name, words, units, found.deviation.tolist(), found.error.tolist(), origin),
        foretold,
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


ANSWERS = (
    Column("flight"),
    Column("verdict"),
    Column("what changed"),
    Column("change"),
    Column("95 % from"),
    Column("to"),
    Column("unit"),
    Column("probability"),
    Column("exactly this set"),
    Column("not excluded either, or why not"),
)


def _answers(engine: EngineEvidence, evidence: Evidence) -> Iterator[Block]:
    rows = engine.of(kinds.ISOLATED)
    if not rows:
        return
    cells = []
    for row in rows:
        name = row.text("parameter")
        words, factor, unit = "", 1.0, ""
        if name:
            words, (factor, unit) = evidence.known[name].words, scale_of(evidence.known[name])
        rivals = [
            f"{' & '.join(names) or 'no change'} ({probability(p)})" for names, p in map(rival, row.list("rivals"))
        ]
        sensors = [split_column(column)[0] for column in row.list("would_tell")]
        tell = f"; {listed(sensors, 'or')} would tell" if sensors else ""
        cells.append(
            (
                row.text("flight") or row.window,
                row.text("verdict"),
                words,
                factor * row.number("change"),
                factor * row.number("lower"),
                factor * row.number("upper"),
                unit,
                row.number("inclusion"),
                row.number("probability"),
                (row.text("note") or "; ".join(rivals[:MOST_RIVALS])) + tell,
            )
        )
    table = Table(ANSWERS, cells, [row.origin for row in rows])
    yield Tabled("What changed, window by window", table)
