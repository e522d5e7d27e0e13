"""A fleet: ranking, heat map, discoveries, what all engines have in common, and the worst engines one by one."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from typing import Any

from enginediag_cli.fleet_judgement.finding import Estimate
from enginediag_cli.presentation.charts.evidence_course import evidence_course
from enginediag_cli.presentation.charts.fleet_found import EngineFound, HealthFound
from enginediag_cli.presentation.charts.fleet_map import fleet_map
from enginediag_cli.presentation.charts.fleet_ranking import fleet_ranking
from enginediag_cli.presentation.charts.margin import maintenance_marks, margin
from enginediag_cli.presentation.charts.model import Column, Table, Value
from enginediag_cli.presentation.names import listed
from enginediag_cli.presentation.numbers import probability, rounded, with_unit
from enginediag_cli.presentation.report.next_steps import next_step
from enginediag_cli.presentation.report.page import Block, Bullets, Lead, Section, State, Tabled, Words
from enginediag_cli.presentation.report.results.read import Result
from enginediag_cli.presentation.sentences import change, count

STATES = {"changed": State.CHANGED, "healthy": State.NOTHING_FOUND, "no verdict": State.NO_VERDICT}
IN_FULL = 12
"""Engines with charts of their own, the worst: a page of more would not open at once."""
LIKELY = 0.5
"""Probability from which a parameter is told as changed."""


def fleet_lead(document: Mapping[str, Any], engines: Sequence[EngineFound], key: str) -> Lead:
    """The first screen of a fleet: how many, the bound, and where to begin."""
    numbers = [sum(e.verdict == verdict for e in engines) for verdict in ("changed", "healthy", "no verdict")]
    told = f"{numbers[0]} of {count(len(engines), 'engine')} changed"
    state = State.CHANGED if numbers[0] else State.NOTHING_FOUND if numbers[1] else State.NO_VERDICT
    rest = [f"{numbers[1]} show no change"] if numbers[1] else []
    rest += [f"{numbers[2]} could not be judged"] if numbers[2] else []
    listed_ = [e for e in engines if e.discovery]
    sentence = f"{told}; {listed(rest)}." if rest else f"{told}."
    surely = str((document.get("discoveries") or {}).get("words") or "")
    if listed_:
        surely = f"{count(len(listed_), 'engine')} on the list of discoveries: {surely}"
    worst = [e for e in engines if e.verdict == "changed"][:1]
    step = [f"Begin with {e.serial}: {_step(e)}" for e in worst]
    return Lead(state, sentence, surely=surely, next=" ".join(step), key=key, badge="fleet")


GLANCE = (
    Column("engine"),
    Column("what"),
    Column("since"),
    Column("how surely"),
    Column("flights left"),
)


def _glance(engines: Sequence[EngineFound]) -> Iterator[Block]:
    """Every engine that changed, could not be judged or has an instrument that is stuck or scatters, worst first."""
    told = [e for e in engines if e.verdict != "healthy" or e.instruments]
    rows = [(e.serial, _what(e), _since(e), _surely(e), _left(e.margin.remaining_flights)) for e in told]
    if rows:
        yield Tabled("Engines that need a look", Table(GLANCE, rows, [e.origin for e in told]))


def _what(e: EngineFound) -> str:
    if e.verdict == "no verdict":
        told = [f"not judged: {e.reason}"]
    elif e.verdict == "healthy":
        told = ["healthy"]
    else:
        told = [_size(h) for h in _changed(e)] or ["changed; no single parameter stands out"]
    return "; ".join([*told, *e.instruments])


def _changed(e: EngineFound) -> list[HealthFound]:
    return [h for h in e.health if h.probability >= LIKELY]


def _surely(e: EngineFound) -> str:
    changed = _changed(e)
    told = [f"probability {probability(max(h.probability for h in changed))}"] if changed else []
    if math.isfinite(e.log10_e):
        told.append(f"evidence 10^{e.log10_e:.0f} over {count(e.flights, 'flight')}")
    return "; ".join([*told, *(["listed"] if e.discovery else [])])


def _step(e: EngineFound) -> str:
    return next_step(STATES.get(e.verdict, State.CANNOT_TELL), [h.parameter for h in _changed(e)], (), ())


def _left(left: Estimate) -> str:
    """Flights to the limit with their 90 % interval."""
    if not math.isfinite(left.value):
        return ""
    end = rounded(left.high, digits=2) if math.isfinite(left.high) else "no end in sight"
    return f"{rounded(left.value, digits=2)} (90 %: {rounded(left.low, digits=2)} to {end})"


def _size(h: HealthFound) -> str:
    return change(h.parameter, h.change.value, (h.change.high - h.change.low) / 2)


def _since(e: EngineFound) -> str:
    best, low, high = e.since
    if not best:
        return ""
    name = f"flight {e.since_flight}" if e.since_flight else f"flight number {best}"
    return name if low == high else f"{name}; counted from the first, between {low} and {high}"


def fleet_section(result: Result, engines: Sequence[EngineFound], key: str) -> Section:
    """Everything of one fleet document."""
    document = result.document
    blocks: list[Block] = []
    blocks += _glance(engines)
    if any(math.isfinite(e.severity.value) for e in engines):
        blocks.append(fleet_ranking(f"{key}-ranking", engines))
    heat = fleet_map(f"{key}-map", engines)
    blocks += [heat] if heat is not None else []
    blocks += _common(document.get("common") or ())
    blocks += _left_out(document.get("left_out") or ())
    inner = [_engine(e, f"{key}-{k}") for k, e in enumerate(engines[:IN_FULL])]
    if len(engines) > IN_FULL:
        blocks.append(Words(f"The {IN_FULL} worst engines follow one by one; the tables have the others."))
    return Section(key, str(document.get("description") or "The fleet"), blocks, inner)


def _engine(e: EngineFound, key: str) -> Section:
    marks = maintenance_marks(e)
    charts = [margin(f"{key}-margin", e, marks), evidence_course(f"{key}-evidence", e, marks)]
    blocks: list[Block] = [Words(e.reason)] if e.reason else []
    blocks += [Bullets(e.instruments)] if e.instruments else []
    blocks += [chart for chart in charts if chart is not None]
    blocks += [*_health(e), *_events(e)]
    return Section(key, f"Engine {e.serial}", blocks)


def _health(e: EngineFound) -> Iterator[Block]:
    if not e.health:
        return
    columns = (Column("parameter"), Column("change, 95 %"), Column("kind"), Column("probability"), Column("since"))
    rows: list[tuple[Value, ...]] = []
    for h in sorted(e.health, key=lambda h: -h.probability):
        half = h.scale * (h.change.high - h.change.low) / 2
        size = with_unit(h.scale * h.change.value, h.shown_unit, half) if math.isfinite(h.change.value) else ""
        since = h.onset_flight or (str(h.onset) if h.onset else "")
        rows.append((h.words, size.replace("-", "−"), h.kind, probability(h.probability), since))
    origins = [h.origin for h in sorted(e.health, key=lambda h: -h.probability)]
    yield Tabled(f"Health of {e.serial} now", Table(columns, rows, origins), closed=True)


def _events(e: EngineFound) -> Iterator[Block]:
    if not e.events:
        return
    columns = (Column("event"), Column("on"), Column("first flight after"), Column("margin recovered"), Column("note"))
    rows = []
    for x in e.events:
        r = x.recovered_K
        size = with_unit(r.value, "K", (r.high - r.low) / 2) if math.isfinite(r.value) else ""
        rows.append((x.kind, x.component or "engine", x.number or None, size, x.reason))
    yield Tabled(f"What maintenance of {e.serial} brought", Table(columns, rows, [x.origin for x in e.events]))


def _common(common: Sequence[Any]) -> Iterator[Block]:
    told = [c for c in common if isinstance(c, dict)]
    shared = [f"{c.get('words') or c.get('parameter')}: {c.get('reading')}" for c in told if c.get("common")]
    if shared:
        yield Words("Common to most engines, so physics that the model lacks or an error of the recorder:")
        yield Bullets(shared)
    elif told:
        yield Words("No parameter moved alike in most engines: what was found is each engine's own.")


def _left_out(left: Sequence[Any]) -> Iterator[Block]:
    rows: list[tuple[Value, ...]] = []
    for entry in left:
        if isinstance(entry, dict):
            what = [str(v) for k, v in entry.items() if k != "reason"]
            rows.append((", ".join(what), str(entry.get("reason") or "")))
        elif isinstance(entry, list | tuple) and len(entry) == 2:
            rows.append((str(entry[0]), str(entry[1])))
    if rows:
        yield Tabled(f"Left out ({len(rows)})", Table((Column("what"), Column("why")), rows), closed=True)
