"""What the model lacks: answers of `locate`, `explain` and `refine` as a first screen and sections."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from typing import Any

from enginediag_cli.intervals import NORMAL_95
from enginediag_cli.mismatch.explain.answer import FAILED, LAW, NAMED, NOTHING
from enginediag_cli.presentation.charts.before_after import before_after, flight_gains
from enginediag_cli.presentation.charts.law_curve import law_curve
from enginediag_cli.presentation.charts.mismatch_places import mismatch_places
from enginediag_cli.presentation.charts.model import Column, Origin, Table
from enginediag_cli.presentation.charts.rows import Row
from enginediag_cli.presentation.names import listed
from enginediag_cli.presentation.numbers import probability, rounded
from enginediag_cli.presentation.report.evidence import Evidence
from enginediag_cli.presentation.report.page import Block, Bullets, Lead, Section, State, Tabled, Words
from enginediag_cli.presentation.report.results import kinds
from enginediag_cli.presentation.report.results.read import Result

BADGES = {NAMED: "missing physics, named", NOTHING: "nothing missing", LAW: "missing physics, a law"}
"""What stands above the sentence of an answer of `explain`; its status where none is listed."""

COEFFICIENTS = (
    Column("explanation"),
    Column("probability"),
    Column("coefficients with 95 % intervals"),
    Column("gain of evidence"),
)


def physics_leads(evidence: Evidence) -> Iterator[Lead]:
    """One for each answer of `explain`, and of `refine`."""
    for number, result in enumerate(evidence.documents(kinds.EXPLAINED), start=1):
        yield _explained(result.document, f"explain-{number}")
    for number, result in enumerate(evidence.documents(kinds.REFINED), start=1):
        yield _refined(result.document, f"refine-{number}")


def _explained(answer: Mapping[str, Any], key: str) -> Lead:
    status, told = str(answer["status"]), [str(s).strip() for s in answer["sentences"]]
    state = {NOTHING: State.NOTHING_FOUND, FAILED: State.NO_VERDICT, NAMED: State.CHANGED, LAW: State.CHANGED}.get(
        status, State.CANNOT_TELL
    )
    advice = answer.get("advice") or {}
    next_ = [str(s["in_words"]) for s in (advice.get("suggestions") or [])[:1]]
    if status == NAMED and not next_:
        next_ = ["Give it to `refine` with flights that were not used here; they decide whether it enters the model."]
    surely = [
        f"{x['in_words']}: probability {probability(float(x['probability']))}"
        for x in answer["explanations"][:1]
        if x.get("probability") is not None
    ]
    rivals = [
        f"{x['in_words']} ({probability(float(x['probability']))})"
        for x in answer["explanations"][1:]
        if x.get("probability") is not None
    ]
    flips = [str(f.get("words", f)) if isinstance(f, Mapping) else str(f) for f in answer.get("flips") or ()]
    return Lead(
        state,
        _headline(told) or str(answer.get("reason") or status),
        surely="; ".join(surely),
        next=f"Next recording: {next_[0]}." if advice.get("suggestions") else " ".join(next_),
        flips=flips,
        rivals=rivals,
        key=key,
        badge=BADGES.get(status, status),
    )


def _headline(told: Sequence[str]) -> str:
    """The first sentence, with the next where it only announces it."""
    return " ".join(told[:2]) if told and told[0].endswith(":") else "".join(told[:1])


def _refined(answer: Mapping[str, Any], key: str) -> Lead:
    accepted = answer["verdict"] == "accepted"
    state = State.CHANGED if accepted else State.CANNOT_TELL
    chi2 = answer.get("chi2_per_reading") or {}
    effects = listed([f"{e['term']} at {e['at']}" for e in answer["effects"]]) or "nothing"
    sentence = f"Put into the model, {effects} predicts flights that were not fitted better."
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
        surely=surely,
        next=f"{next_} {more}".strip(),
        key=key,
        badge=f"refinement {answer['verdict']}",
    )


def physics_sections(evidence: Evidence) -> Iterator[Section]:
    """Places first, then names, then what unseen flights say."""
    for number, result in enumerate(evidence.documents(kinds.LOCATED), start=1):
        yield Section(f"locate-{number}", "Where it differs", list(_located(result, f"locate-{number}-map")))
    mapped = bool(evidence.documents(kinds.LOCATED))
    for number, result in enumerate(evidence.documents(kinds.EXPLAINED), start=1):
        yield Section(
            f"explain-{number}", "What the model lacks", list(_explanation(result, f"explain-{number}", mapped))
        )
    for number, result in enumerate(evidence.documents(kinds.REFINED), start=1):
        yield Section(f"refine-{number}", "With it in the model", list(_refinement(result, f"refine-{number}")))


def _located(result: Result, key: str) -> Iterator[Block]:
    rows = [row for row in result.rows if row.text("location") and row.text("driver")]
    if rows:
        verdict = rows[0].text("verdict")
        yield Words(f"Verdict: {verdict}. Best place: {rows[0].text('location')} along {rows[0].text('along')}.")
        yield mismatch_places(key, rows)
    else:
        told = result.rows[0].text("verdict") if result.rows else "nothing"
        yield Words(f"No place is told: {told}.")


def _explanation(result: Result, key: str, mapped: bool) -> Iterator[Block]:
    answer, name = result.document, result.name
    yield Bullets([str(sentence).strip() for sentence in answer["sentences"]])
    places = [Row(place, Origin(name, f"places[{k}]")) for k, place in enumerate(answer["places"])]
    if places and not mapped:
        gates = answer.get("gates")
        gate = float(gates[0]) if isinstance(gates, list) and gates else math.nan
        yield mismatch_places(f"{key}-map", places, gate)
    law = answer.get("law") or {}
    if law.get("band"):
        place = str((law.get("places") or [{}])[0].get("location", "the place found"))
        yield law_curve(f"{key}-law", law["band"], place, Origin(name, "law.band.values"))
    rows, origins = [], []
    for k, x in enumerate(answer["explanations"]):
        sizes = "; ".join(_coefficient(c) for c in x.get("coefficients") or ())
        rows.append((x["in_words"], probability(float(x["probability"])), sizes, x.get("gain")))
        origins.append(Origin(name, f"explanations[{k}]"))
    if rows:
        yield Tabled("Explanations and their coefficients", Table(COEFFICIENTS, rows, origins))


def _coefficient(c: Mapping[str, Any]) -> str:
    value, error = float(c["value"]), c.get("standard_error")
    within = f" ± {rounded(NORMAL_95 * error, error)}" if error else ""
    return f"{c['name']} = {rounded(value, error)}{within}{'' if c['unit'] == '1' else ' ' + str(c['unit'])}"


def _refinement(result: Result, key: str) -> Iterator[Block]:
    answer, name = result.document, result.name
    yield Bullets([str(sentence).strip() for sentence in answer["sentences"]])
    rows = [Row(row, Origin(name, f"rows[{k}]")) for k, row in enumerate(answer.get("rows") or ())]
    if any(row.text("what") == "chi2 per reading" for row in rows):
        yield before_after(f"{key}-readings", rows)
    flights = [
        (str(f["flight"]), float(f["gain"]), Origin(name, f"flights[{k}]"))
        for k, f in enumerate(answer.get("flights") or ())
    ]
    if flights:
        yield flight_gains(f"{key}-gains", flights)
