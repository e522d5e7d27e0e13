"""The HTML report of results: its sections in order.

A fleet: ranking, heat map, flagged engines, what all engines have in common, and the worst engines one by one.

What the model lacks: answers of `locate`, `explain` and `refine` as a first screen and sections.

The end of a report: excluded data, and everything that is needed to make the page again.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from typing import Any

from enginediag_cli import __version__
from enginediag_cli.mismatch.explain.answer import FORMULA, IDENTIFIED, NO_DISCREPANCY, NOT_CONVERGED
from enginediag_cli.probability import NORMAL_95
from enginediag_cli.report import result_files
from enginediag_cli.report.engine_page import engine_lead, engine_section
from enginediag_cli.report.evidence import EngineEvidence, ReportEvidence
from enginediag_cli.report.html import (
    MOST_CARDS,
    Block,
    Bullets,
    EngineState,
    Lead,
    Page,
    PageSection,
    Paragraph,
    Preformatted,
    TableBlock,
    next_step,
)
from enginediag_cli.report.plotting import ChartColumn, ChartTable, RowOrigin, Value, chart_columns
from enginediag_cli.report.plotting.health import (
    FLEET_DARKEST,
    FleetEngine,
    ParameterHealth,
    fleet_map,
    fleet_ranking,
    maintenance_marks,
    margin_forecast,
    read_engines,
    standard_score,
)
from enginediag_cli.report.plotting.models import flight_gains, law_curve, mismatch_places, refinement_fit
from enginediag_cli.report.result_files import ResultFile, Row
from enginediag_cli.report.sentences import capital, change, count, format_quantity, listed, probability, rounded
from enginediag_cli.report.tables.fleet import margin_words, power_available_words, remaining_words

STATES = {"changed": EngineState.CHANGED, "healthy": EngineState.NOTHING_FOUND, "no verdict": EngineState.NO_VERDICT}
IN_FULL = 12
"""Engines with charts of their own, the worst: a page of more would not open at once."""
LIKELY = 0.5
"""Probability from which a parameter is reported as changed."""


def fleet_lead(document: Mapping[str, Any], engines: Sequence[FleetEngine], key: str) -> Lead:
    """The first screen of a fleet: how many, the bound, and where to begin."""
    numbers = [sum(e.verdict == verdict for e in engines) for verdict in ("changed", "healthy", "no verdict")]
    settled = sum(e.verdict == "changed" and e.is_settled for e in engines)
    told = f"{numbers[0]} of {count(len(engines), 'engine')} changed"
    told += f", {settled} of them acknowledged and not grown since" if settled else ""
    state = EngineState.CHANGED if numbers[0] else EngineState.NOTHING_FOUND if numbers[1] else EngineState.NO_VERDICT
    doubtful = sum(e.verdict == "healthy" and bool(_unexplained(e)) for e in engines)
    rest = [f"{numbers[1] - doubtful} show no change"] if numbers[1] > doubtful else []
    rest += [f"{doubtful} cannot be judged, a parameter being far off"] if doubtful else []
    rest += [f"{numbers[2]} could not be judged"] if numbers[2] else []
    sentence = f"{told}; {listed(rest)}." if rest else f"{told}."
    surely = str((document.get("discoveries") or {}).get("words") or "")
    worst = [e for e in by_urgency(engines) if e.verdict == "changed" and not e.is_settled][:1]
    step = [f"Begin with {e.serial}: {_step(e)}" for e in worst]
    flights = count(sum(e.flights for e in engines), "flight")
    identity = " · ".join((str(document.get("description") or "fleet"), count(len(engines), "engine"), flights))
    return Lead(state, sentence, identity=identity, confidence=surely, next_step=" ".join(step), key=key, badge="fleet")


WORKLIST = chart_columns("engine", "module", "what", "since", "how surely", "margin", "action")


def by_urgency(engines: Sequence[FleetEngine]) -> list[FleetEngine]:
    """What needs somebody first: changed engines, those first that may reach their limit soonest, then as they are
    ranked; engines that contradict themselves; instruments; what was not judged; what is acknowledged."""

    def urgency(e: FleetEngine) -> tuple[int, float]:
        soonest = e.margin.remaining_flights.low
        if e.verdict == "changed":
            return (4 if e.is_settled else 0), soonest if math.isfinite(soonest) else math.inf
        return (1 if _unexplained(e) else 2 if e.instruments else 3), math.inf

    return sorted((e for e in engines if e.verdict != "healthy" or e.instruments or _unexplained(e)), key=urgency)


def _unexplained(e: FleetEngine) -> list[ParameterHealth]:
    """Parameters that the map of the fleet shows as far off as it can, although nothing is reported of them."""
    return [h for h in e.health if abs(standard_score(h)) >= FLEET_DARKEST and h.probability < LIKELY]


def _worklist(engines: Sequence[FleetEngine]) -> Iterator[Block]:
    """Every engine that needs somebody, the most urgent first."""
    shown = by_urgency(engines)
    rows = [
        (
            e.serial,
            ", ".join(dict.fromkeys(h.parameter.part or h.component for h in _changed_parameters(e))),
            _engine_findings(e),
            _onset_words(e),
            _confidence_words(e),
            _margin_words(e),
            _step(e),
        )
        for e in shown
    ]
    if rows:
        yield TableBlock("Worklist", ChartTable(WORKLIST, rows), stacked=True)


def _margin_words(e: FleetEngine) -> str:
    """What is left of the margin, else what is used, and for how many flights it lasts."""
    m = e.margin
    size, of = (m.now_K, "") if math.isfinite(m.now_K.value) else (m.consumed_K, " used")
    if not math.isfinite(size.value):
        return ""
    words = format_quantity(size.value, "K", (size.high - size.low) / 2).replace("-", "−") + of
    return words if m.reason else f"{words}; {remaining_words(m.remaining_flights)}"


def _engine_findings(e: FleetEngine) -> str:
    if e.verdict == "no verdict":
        told = [f"not judged: {e.reason}"]
    elif e.verdict == "healthy":
        far = [f"{_size(h)} ({standard_score(h):.0f} σ)".replace("-", "−") for h in _unexplained(e)]
        told = [f"the test over flights shows no change, but {listed(far)}: cannot tell"] if far else []
    else:
        told = [_size(h) for h in _changed_parameters(e)] or [e.reason or "changed; no single parameter explains it"]
    return "; ".join([*told, *e.instruments])


def _changed_parameters(e: FleetEngine) -> list[ParameterHealth]:
    return [h for h in e.health if h.probability >= LIKELY]


def _confidence_words(e: FleetEngine) -> str:
    told = []
    if math.isfinite(e.probability):
        told.append(f"probability {probability(e.probability)} over {count(e.flights, 'flight')}")
    known = [e.acknowledged.words] if e.acknowledged else []
    return "; ".join([*told, *(["flagged"] if e.discovery else []), *known])


def _step(e: FleetEngine) -> str:
    if e.is_settled:
        return "Nothing new: it is known, and has not grown."
    if e.verdict == "healthy" and _unexplained(e):
        return "Judge it by itself: `trend` and `report -n NOMINAL` with its recordings."
    if e.verdict == "healthy" and e.instruments:
        return "Check the instrument, its wiring and recorder channel."
    changed = [h.parameter for h in _changed_parameters(e)]
    return next_step(STATES.get(e.verdict, EngineState.CANNOT_TELL), changed, (), ())


def _size(h: ParameterHealth) -> str:
    return change(h.parameter, h.change.value, (h.change.high - h.change.low) / 2)


def _onset_words(e: FleetEngine) -> str:
    best, low, high = e.since
    if not best:
        return ""
    name = f"flight {e.since_flight}" if e.since_flight else f"flight number {best}"
    return name if low == high else f"{name}; counted from the first, between {low} and {high}"


def fleet_section(result: ResultFile, engines: Sequence[FleetEngine], key: str) -> PageSection:
    """Everything of one fleet document."""
    document = result.document
    blocks: list[Block] = []
    blocks += _worklist(engines)
    if any(math.isfinite(e.severity.value) for e in engines):
        blocks.append(fleet_ranking(f"{key}-ranking", engines))
    heat = fleet_map(f"{key}-map", engines)
    blocks += [heat] if heat is not None else []
    blocks += _common_findings(document.get("common") or ())
    blocks += _excluded_table(document.get("left_out") or ())
    inner = [_engine(e, f"{key}-{k}") for k, e in enumerate(engines[:IN_FULL])]
    if len(engines) > IN_FULL:
        blocks.append(Paragraph(f"The {IN_FULL} worst engines follow one by one; the tables have the others."))
    return PageSection(key, "The fleet", blocks, inner)


def _engine(e: FleetEngine, key: str) -> PageSection:
    marks = maintenance_marks(e)
    chart = margin_forecast(f"{key}-margin", e, marks)
    blocks: list[Block] = [Paragraph(e.reason)] if e.reason else []
    blocks += [Paragraph(f"{capital(e.acknowledged.words)}.")] if e.acknowledged else []
    blocks += [Bullets(e.instruments)] if e.instruments else []
    if chart is not None:
        sentences = filter(None, (margin_words(e.margin, "limits_K of the fleet file"), power_available_words(e.power)))
        blocks += [Paragraph(" ".join(f"{capital(words)}." for words in sentences)), chart]
    blocks += [*_health(e), *_events(e)]
    return PageSection(key, f"Engine {e.serial}", blocks)


def _health(e: FleetEngine) -> Iterator[Block]:
    if not e.health:
        return
    columns = chart_columns("parameter", "change, 95 %", "kind", "probability", "since")
    rows: list[tuple[Value, ...]] = []
    for h in sorted(e.health, key=lambda h: -h.probability):
        half = h.scale * (h.change.high - h.change.low) / 2
        size = format_quantity(h.scale * h.change.value, h.shown_unit, half) if math.isfinite(h.change.value) else ""
        since = h.onset_flight or (str(h.onset) if h.onset else "")
        rows.append((h.words, size.replace("-", "−"), h.kind, probability(h.probability), since))
    origins = [h.origin for h in sorted(e.health, key=lambda h: -h.probability)]
    yield TableBlock(f"Health of {e.serial} now", ChartTable(columns, rows, origins), closed=True)


def _events(e: FleetEngine) -> Iterator[Block]:
    if not e.events:
        return
    columns = chart_columns("event", "on", "first flight after", "margin recovered", "note")
    rows = []
    for x in e.events:
        r = x.recovered_K
        size = format_quantity(r.value, "K", (r.high - r.low) / 2) if math.isfinite(r.value) else ""
        rows.append((x.kind, x.component or "engine", x.number or None, size, x.reason))
    yield TableBlock(f"What maintenance of {e.serial} brought", ChartTable(columns, rows, [x.origin for x in e.events]))


def _common_findings(common: Sequence[Any]) -> Iterator[Block]:
    told = [c for c in common if isinstance(c, dict)]
    shared = [f"{c.get('words') or c.get('parameter')}: {c.get('reading')}" for c in told if c.get("common")]
    if shared:
        yield Paragraph("Common to most engines, so physics that the model lacks or an error of the recorder:")
        yield Bullets(shared)
    elif told:
        yield Paragraph("No parameter moved alike in most engines: what was found is each engine's own.")


def _excluded_table(left: Sequence[Any]) -> Iterator[Block]:
    rows: list[tuple[Value, ...]] = []
    for entry in left:
        if isinstance(entry, dict):
            what = [str(v) for k, v in entry.items() if k != "reason"]
            rows.append((", ".join(what), str(entry.get("reason") or "")))
        elif isinstance(entry, list | tuple) and len(entry) == 2:
            rows.append((str(entry[0]), str(entry[1])))
    if rows:
        yield TableBlock(f"Excluded ({len(rows)})", ChartTable(chart_columns("what", "why"), rows), closed=True)


BADGES = {IDENTIFIED: "missing physics, named", NO_DISCREPANCY: "nothing missing", FORMULA: "missing physics, a law"}
"""What stands above the sentence of an answer of `explain`; its status where none is listed."""

COEFFICIENTS = chart_columns("explanation", "probability", "coefficients with 95 % intervals", "gain of evidence")


def physics_leads(evidence: ReportEvidence) -> Iterator[Lead]:
    """One for each answer of `explain`, else of `locate`, and of `refine`."""
    explained = evidence.documents(result_files.EXPLAINED)
    for number, result in enumerate(evidence.documents(result_files.LOCATED) if not explained else (), start=1):
        yield _location_lead(result, f"locate-{number}")
    for number, result in enumerate(explained, start=1):
        yield _explanation_lead(result.document, f"explain-{number}")
    for number, result in enumerate(evidence.documents(result_files.REFINED), start=1):
        yield _refinement_lead(result.document, f"refine-{number}")


def _location_lead(result: ResultFile, key: str) -> Lead:
    """Where model and recordings differ, as long as nothing says by what."""
    places = [row for row in result.rows if row.text("location")]
    verdict = result.rows[0].text("verdict") if result.rows else "no place was found"
    if not places:
        return Lead(EngineState.CANNOT_TELL, f"{verdict[:1].upper()}{verdict[1:]}.", key=key, badge="where it differs")
    best = places[0]
    along = f" along {best.text('driver')}" if best.text("driver") else ""
    others = [f"{row.text('location')} along {row.text('driver')}" for row in places[1:3]]
    return Lead(
        EngineState.CHANGED,
        f"{verdict[:1].upper()}{verdict[1:]}; best place: {best.text('location')}{along}.",
        next_step="Ask `explain` with the same recordings what the model lacks there.",
        alternatives=others,
        key=key,
        badge="where it differs",
    )


def _explanation_lead(answer: Mapping[str, Any], key: str) -> Lead:
    status, told = str(answer["status"]), [str(s).strip() for s in answer["sentences"]]
    state = {
        NO_DISCREPANCY: EngineState.NOTHING_FOUND,
        NOT_CONVERGED: EngineState.NO_VERDICT,
        IDENTIFIED: EngineState.CHANGED,
        FORMULA: EngineState.CHANGED,
    }.get(status, EngineState.CANNOT_TELL)
    advice = answer.get("advice") or {}
    next_ = [str(s["in_words"]) for s in (advice.get("suggestions") or [])[:1]]
    if status == IDENTIFIED and not next_:
        next_ = ["Give it to `refine` with flights that were not used here; they decide whether it enters the model."]
    surely = [
        f"{x['in_words']}: probability {probability(float(x['probability']))}"
        for x in answer["explanations"][:1]
        if x.get("probability") is not None
    ]
    others = [
        f"{x['in_words']} ({probability(float(x['probability']))})"
        for x in answer["explanations"][1:]
        if x.get("probability") is not None
    ]
    law = answer.get("law") or {}
    if not answer["explanations"]:  # of a curve, the other places at which it may be
        others = [
            f"{x['location']} ({probability(float(x['probability']))})"
            for x in (law.get("places") or ())[1:]
            if x.get("probability") is not None
        ]
    flips = [str(f.get("words", f)) if isinstance(f, Mapping) else str(f) for f in answer.get("flips") or ()]
    flips = [f"{sentence[:1].upper()}{sentence[1:]}." for sentence in flips]
    return Lead(
        state,
        _headline(told) or str(answer.get("reason") or status),
        confidence="; ".join(surely),
        next_step=f"Next recording: {next_[0]}." if advice.get("suggestions") else " ".join(next_),
        sensitivity=flips,
        alternatives=others,
        key=key,
        badge=BADGES.get(status, status),
    )


def _headline(told: Sequence[str]) -> str:
    """The first sentence, with the next where it only announces it."""
    return " ".join(told[:2]) if told and told[0].endswith(":") else "".join(told[:1])


def _refinement_lead(answer: Mapping[str, Any], key: str) -> Lead:
    accepted = answer["verdict"] == "accepted"
    state = EngineState.CHANGED if accepted else EngineState.CANNOT_TELL
    chi2 = answer.get("chi2_per_reading") or {}
    effects = listed([f"{e['term'].replace('_', ' ')} at {e['at']}" for e in answer["effects"]]) or "nothing"
    sentence = f"With {effects} in the model, unseen flights are predicted better."
    if not accepted:
        sentence = f"{effects} is not put into the model: {answer.get('refused') or answer['verdict']}."
    surely = ""
    if chi2:
        surely = f"χ² per reading {float(chi2['before']):.3f} before, {float(chi2['after']):.3f} after"
        surely += f", over {int(chi2['of']):,} readings"
    more = str(answer.get("still_missing") or "")
    next_ = "Use the refined engine file with every other command." if accepted else ""
    return Lead(
        state,
        sentence,
        confidence=surely,
        next_step=f"{next_} {more}".strip(),
        key=key,
        badge=f"refinement {answer['verdict']}",
    )


def physics_sections(evidence: ReportEvidence) -> Iterator[PageSection]:
    """Places first, then names, then what unseen flights say."""
    for number, result in enumerate(evidence.documents(result_files.LOCATED), start=1):
        yield PageSection(
            f"locate-{number}", "Where it differs", list(_location_blocks(result, f"locate-{number}-map"))
        )
    mapped = bool(evidence.documents(result_files.LOCATED))
    for number, result in enumerate(evidence.documents(result_files.EXPLAINED), start=1):
        yield PageSection(
            f"explain-{number}", "What the model lacks", list(_explanation_blocks(result, f"explain-{number}", mapped))
        )
    for number, result in enumerate(evidence.documents(result_files.REFINED), start=1):
        yield PageSection(
            f"refine-{number}", "With it in the model", list(_refinement_blocks(result, f"refine-{number}"))
        )


def _location_blocks(result: ResultFile, key: str) -> Iterator[Block]:
    rows = [row for row in result.rows if row.text("location") and row.text("driver")]
    if rows:
        verdict = rows[0].text("verdict")
        yield Paragraph(f"Verdict: {verdict}. Best place: {rows[0].text('location')} along {rows[0].text('along')}.")
        yield mismatch_places(key, rows)
    else:
        told = result.rows[0].text("verdict") if result.rows else "nothing"
        yield Paragraph(f"No place was found: {told}.")


def _explanation_blocks(result: ResultFile, key: str, mapped: bool) -> Iterator[Block]:
    answer, name = result.document, result.name
    yield Bullets([str(sentence).strip() for sentence in answer["sentences"]])
    places = [Row(place, RowOrigin(name, f"places[{k}]")) for k, place in enumerate(answer["places"])]
    if places and not mapped:
        gates = answer.get("gates")
        gate = float(gates[0]) if isinstance(gates, list) and gates else math.nan
        yield mismatch_places(f"{key}-map", places, gate)
    law = answer.get("law") or {}
    if law.get("band"):
        place = str((law.get("places") or [{}])[0].get("location", "the place found"))
        yield law_curve(f"{key}-law", law["band"], place, RowOrigin(name, "law.band.values"))
    rows, origins = [], []
    for k, x in enumerate(answer["explanations"]):
        sizes = "; ".join(_coefficient(c) for c in x.get("coefficients") or ())
        rows.append((x["in_words"], probability(float(x["probability"])), sizes, x.get("gain")))
        origins.append(RowOrigin(name, f"explanations[{k}]"))
    if rows:
        title = "Explanation, its alternatives and their coefficients"
        yield TableBlock(title, ChartTable(COEFFICIENTS, rows, origins))


def _coefficient(c: Mapping[str, Any]) -> str:
    value, error = float(c["value"]), c.get("standard_error")
    within = f" ± {rounded(NORMAL_95 * error, error)}" if error else ""
    return f"{c['name']} = {rounded(value, error)}{within}{'' if c['unit'] == '1' else ' ' + str(c['unit'])}"


def _refinement_blocks(result: ResultFile, key: str) -> Iterator[Block]:
    answer, name = result.document, result.name
    yield Bullets([str(sentence).strip() for sentence in answer["sentences"]])
    rows = [Row(row, RowOrigin(name, f"rows[{k}]")) for k, row in enumerate(answer.get("rows") or ())]
    if any(row.text("what") == "chi2 per reading" for row in rows):
        yield refinement_fit(f"{key}-readings", rows)
    flights = [
        (str(f["flight"]), float(f["gain"]), RowOrigin(name, f"flights[{k}]"))
        for k, f in enumerate(answer.get("flights") or ())
    ]
    if flights:
        yield flight_gains(f"{key}-gains", flights)


COUNTS = (("outside", "outside what identification covered"), ("incomplete", "incomplete"), ("failed", "not computed"))


def excluded_section(evidence: ReportEvidence, told: Sequence[str]) -> PageSection:
    """Windows without verdict and records that were not judged, of all engines; `told`: what only a run knows."""
    cells: list[tuple[str | int, ...]] = []
    origins: list[RowOrigin] = []
    for engine in evidence.engines.values():
        for row in _windows(engine):
            lost = {name: row.count(name) for name, _ in COUNTS}
            silent = row.count("sensors_of") - row.count("sensors")
            if not any(lost.values()) and not silent and not row.text("reason"):
                continue
            cells.append((row.window, engine.engine, row.count("records"), *lost.values(), silent, row.text("reason")))
            origins.append(row.origin)
    blocks: list[Block] = [Bullets(told)] if told else []
    columns = (
        ChartColumn("window"),
        ChartColumn("engine"),
        ChartColumn("records"),
        *(ChartColumn(words) for _, words in COUNTS),
        ChartColumn("sensors silent"),
        ChartColumn("why no verdict"),
    )
    if cells:
        blocks.append(TableBlock("Records and windows not judged", ChartTable(columns, cells, origins)))
    elif any(_windows(engine) for engine in evidence.engines.values()):
        blocks.append(Paragraph("Every record of every window was judged, by all sensors of the engine."))
    else:
        blocks.append(Paragraph("These results do not say how many records they rest on."))
    if not told:
        blocks.append(
            Paragraph(
                "Masked readings are reported on standard error by the command that read the recording; a report "
                "made from recordings (-n NOMINAL) lists them here.",
                quiet=True,
            )
        )
    return PageSection("left-out", "Excluded data", blocks)


def _windows(engine: EngineEvidence) -> list[Row]:
    return (
        engine.rows_of_kind(result_files.DETECTED)
        or [rows[0] for rows in engine.isolated]
        or engine.rows_of_kind(result_files.COMPONENTS)
    )


def made_section(evidence: ReportEvidence, command: Sequence[str], versions: Sequence[str]) -> PageSection:
    """The command, what it read, and what that was made by."""
    files = ChartTable(
        chart_columns("file", "is", "written by", "rows", "SHA-256"),
        [
            (r.name, r.kind.name, f"enginediag {r.kind.command}", r.row_count, r.sha256 or "of standard input")
            for r in evidence.results
        ],
    )
    blocks: list[Block] = [
        Paragraph("The same files and the same command give this page byte for byte:"),
        Preformatted(command),
        Preformatted(versions),
        TableBlock("Files", files),
    ]
    for result in evidence.results:
        if result.provenance:
            blocks.append(Preformatted(result.provenance, f"What {result.name} says of its making"))
    silent = [result.name for result in evidence.results if not result.provenance]
    if silent:
        do, it = ("does", "it was") if len(silent) == 1 else ("do", "they were")
        blocks.append(Paragraph(f"{listed(silent)} {do} not say how {it} made.", quiet=True))
    return PageSection("made", "How this page was made", blocks)


NO_FINDING = "These files hold nothing from which a verdict follows."
GIVE = "Give what detect, isolate, trend, fleet, explain or refine --report wrote, or recordings with -n NOMINAL."
TITLE, FLEET_TITLE, MODEL_TITLE = "Engine report", "Fleet report", "What the engine model lacks"
WORST_FIRST = tuple(EngineState)


def _title(evidence: ReportEvidence) -> str:
    """What the page is: of engines, of a fleet, or of physics that the model lacks."""
    if evidence.engines:
        return TITLE
    if evidence.documents(result_files.FLEET):
        return FLEET_TITLE
    model = (result_files.LOCATED, result_files.EXPLAINED, result_files.REFINED)
    return MODEL_TITLE if any(map(evidence.documents, model)) else TITLE


def _lead_blocks(lead: Lead) -> Iterator[Block]:
    """What the first screen would say, of an engine that has no room there."""
    yield Paragraph(lead.sentence)
    yield Bullets([f"{name}: {text}" for name, text in lead.facts])


def build_page(
    evidence: ReportEvidence,
    *,
    title: str = "",
    command: Sequence[str] = (),
    left_out: Sequence[str] = (),
    versions: Sequence[str] = (),
) -> Page:
    """All that the results say. command: what makes the page again; left_out: what only the recordings themselves
    show."""
    leads: list[Lead] = []
    sections: list[PageSection] = []
    ordered = []
    for number, engine in enumerate(evidence.engines.values(), start=1):
        key = f"engine-{number}"
        ordered.append((engine_lead(engine, evidence, key), engine, key))
    ordered.sort(key=lambda entry: WORST_FIRST.index(entry[0].state))
    for number, (lead, engine, key) in enumerate(ordered):
        leads.append(lead)
        section = engine_section(engine, evidence, key)
        without_card = [*_lead_blocks(lead)] if number >= MOST_CARDS else []
        sections.append(replace(section, blocks=[*without_card, *section.blocks]))
    leads += physics_leads(evidence)
    for number, result in enumerate(evidence.documents(result_files.FLEET), start=1):
        engines = read_engines(result.document, result.name)
        leads.append(fleet_lead(result.document, engines, f"fleet-{number}"))
        sections.append(fleet_section(result, engines, f"fleet-{number}"))
    leads = leads or [Lead(EngineState.NO_VERDICT, NO_FINDING, next_step=GIVE)]
    sections += physics_sections(evidence)
    sections += [
        excluded_section(evidence, left_out),
        made_section(evidence, command, [f"enginediag {__version__}", *versions]),
    ]
    return Page(title or _title(evidence), leads, sections)
