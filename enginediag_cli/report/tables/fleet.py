"""What `fleet` found, as rows, as one document, and in words."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import asdict, replace
from typing import TYPE_CHECKING, Any

from enginediag_cli.report.messages import Messages
from enginediag_cli.report.sentences import count, instrument_in_flights
from enginediag_cli.report.tables.margin import removal_words
from enginediag_cli.report.tables.recordings import not_judged_lines, outside_envelope_lines

if TYPE_CHECKING:
    from enginediag_cli.fleets.findings import EngineFinding, IntervalEstimate
    from enginediag_cli.fleets.models import BuildModel, MergeCounts, StoreStatus
    from enginediag_cli.fleets.run import FleetRun
    from enginediag_cli.residuals.instruments import FaultInFlights


SCHEMA = "enginediag/fleet/1"
"""Of the document, whose keys stay while this does."""

TERMINAL = (
    "rank",
    "engine",
    "verdict",
    "severity",
    "unit",
    "since",
    "changed",
    "instruments",
    "margin_K",
    "remaining_flights",
    "discovery",
    "flights",
    "reason",
    "build",
)
"""Columns of engines that a narrow terminal shows, most important first."""

SHOWN = 10
"""Recordings that are told one by one; the document has all."""

LIKELY = 0.5
"""Probability from which a parameter is told as changed."""


def engine_rows(result: FleetRun) -> Iterator[dict[str, Any]]:
    """One row per engine, worst first."""
    for rank, x in enumerate(result.finding.engines, start=1):
        margin = x.margin
        yield {
            "rank": rank,
            "engine": x.serial,
            "build": x.build,
            "verdict": x.verdict,
            "discovery": x.discovery,
            **_estimate("severity", x.severity),
            "unit": x.severity_unit,
            "since": x.since or None,
            "since_low": x.since_low or None,
            "since_high": x.since_high or None,
            "since_flight": x.since_flight,
            "log10_e": x.log10_e,
            "unlisted": x.unlisted,
            "changed": [row.parameter for row in _changed(x)],
            "instruments": [instrument_in_flights(found) for found in x.instruments],
            "margin_column": margin.column,
            **_estimate("margin_K", margin.now_K),
            **_estimate("remaining_flights", margin.remaining_flights),
            "flights": x.flights,
            "baseline": x.baseline,
            "records": x.records,
            "reason": x.reason,
        }


def health_rows(result: FleetRun) -> Iterator[dict[str, Any]]:
    """One row per engine and parameter."""
    for x in result.finding.engines:
        for row in x.health:
            yield {
                "engine": x.serial,
                "build": x.build,
                "parameter": row.parameter,
                "component": row.component,
                "words": row.words,
                **_estimate("change", row.change),
                "unit": row.unit,
                "kind": row.kind,
                "probability": row.probability,
                "onset": row.onset or None,
                "onset_low": row.onset_low or None,
                "onset_high": row.onset_high or None,
                "onset_flight": row.onset_flight,
                **_estimate("rate_per_flight", row.rate_per_flight),
            }


def flight_rows(result: FleetRun) -> Iterator[dict[str, Any]]:
    """One row per engine and flight."""
    for x in result.finding.engines:
        for row in x.by_flight:
            yield {"engine": x.serial, "build": x.build, **asdict(row)}


ROWS = {"engines": engine_rows, "health": health_rows, "flights": flight_rows}
"""What can be asked for."""


def document(result: FleetRun, provenance: Sequence[str]) -> dict[str, Any]:
    """All of it, engines one after the other: together they would take more memory than what was found."""
    finding, fleet = result.finding, result.fleet
    return {
        "schema": SCHEMA,
        "description": fleet.description,
        "engines": ({"rank": k, **_engine(x)} for k, x in enumerate(finding.engines, start=1)),
        "common": [asdict(x) for x in finding.common],
        "discoveries": asdict(finding.discoveries),
        "left_out": [
            *({"recording": name, "reason": why} for name, why in result.left_out),
            *({"engine": name, "reason": why} for name, why in finding.left_out),
            *({"event of engine": name, "reason": "no recording is of this engine"} for name in result.unknown_engines),
        ],
        "consumed_limit_K": result.consumed_limit_K,
        "counts": dict(result.counts),
        "outside": [
            {"input": where.column, "judged": where.judged, "records": n}
            for where, n in result.outside_training.items()
        ],
        "sums": [_sum(build, x) for build, x in result.sums.items()],
        "models": [_model(model) for model in result.models.values()],
        "recordings": [
            {
                "recording": r.name,
                "build": r.build,
                "sha256": o.condensed.sha256,
                "records": o.condensed.counts["records"],
            }
            for r, o in result.recordings
            if o.condensed
        ],
        "provenance": list(provenance),
    }


def _engine(x: EngineFinding) -> dict[str, Any]:
    """Without its `state`, of which `common` tells what it comes to, and without the moments of its `events`."""
    told = asdict(replace(x, state=None, event_changes=(), instruments=()))
    del told["state"], told["event_changes"]
    return {**told, "instruments": [_instrument(found) for found in x.instruments]}


def _instrument(x: FaultInFlights) -> dict[str, Any]:
    fault = x.fault
    names = ("flights", "of", "first", "first_flight", "last", "last_flight")
    return {
        "instrument": fault.instrument,
        "column": fault.column,
        "form": fault.form,
        "words": instrument_in_flights(x),
        **{name: getattr(x, name) for name in names},
    }


def _sum(build: str, x: Any) -> dict[str, Any]:
    """What all statistics of a build come to; s and F in the parameters' units."""
    return {
        "build": build,
        "records": x.n,
        "chi2": x.chi2,
        "degrees_of_freedom": x.dof,
        "parameters": x.parameters,
        "theta0": x.theta0,
        "s": x.s,
        "F": x.F,
    }


def _model(model: BuildModel) -> dict[str, Any]:
    told: dict[str, Any] = {"build": model.build.name, "nominal_sha256": model.settings.fingerprint}
    if model.identified is not None:
        told |= {"identified_from": list(model.identified.engines), "records": model.identified.records}
    return told


def report_models(messages: Messages, result: FleetRun) -> None:
    """What each build is held against, on stderr."""
    for name, model in result.models.items():
        found = model.identified
        if found is None:
            continue
        engines = ", ".join(found.engines[:SHOWN]) + (", …" if len(found.engines) > SHOWN else "")
        of = f"{count(found.records, 'record')} of {count(len(found.engines), 'engine')}"
        messages.note(f"build {name}: common model from {of} ({engines})")


def report_fleet(messages: Messages, result: FleetRun) -> None:
    """What was left out, and what is common, on stderr."""
    for name, why in result.left_out[:SHOWN]:
        messages.warning(f"{name}: excluded: {why}")
    if len(result.left_out) > SHOWN:
        messages.warning(f"{len(result.left_out) - SHOWN} more recordings excluded; --format json lists all")
    if result.unknown_engines:
        messages.warning(
            f"events name engines of which there is no recording: {', '.join(result.unknown_engines[:SHOWN])}"
        )
    for line in (*not_judged_lines(result.counts), *outside_envelope_lines(result.outside_training)):
        messages.note(line)
    counts = result.counts
    judged = len(result.recordings) - len(result.left_out)
    messages.note(
        f"{count(len(result.finding.engines), 'engine')}, {count(judged, 'recording')}, "
        f"{count(counts['records'], 'record')}; {count(counts['fresh'], 'recording')} newly reduced to statistics"
    )
    if result.consumed_limit_K and result.fleet.judge["taken_off"]:
        messages.note(removal_words(result.consumed_limit_K))
    wrong = [(x.serial, found) for x in result.finding.engines for found in x.instruments]
    for serial, found in wrong[:SHOWN]:
        messages.note(f"engine {serial}: {instrument_in_flights(found)}", engine=serial)
    if len(wrong) > SHOWN:
        messages.note(f"{len(wrong) - SHOWN} more instruments are stuck or scatter; the rows name all")
    for common in result.finding.common:
        if common.common:
            messages.note(f"{common.words}: {common.reading}")
    if result.finding.discoveries.words:
        messages.note(result.finding.discoveries.words)


def status_rows(standing: StoreStatus) -> Iterator[dict[str, Any]]:
    """One row per recording."""
    for recorded, key in standing.recordings:
        state = "condensed" if key else "new"
        yield {"recording": recorded.name, "build": recorded.build, "engine": recorded.serial, "state": state}


def report_standing(messages: Messages, standing: StoreStatus) -> None:
    """How many recordings are there, and what else, on stderr."""
    there = sum(bool(key) for _, key in standing.recordings)
    messages.note(
        f"{there} of {count(len(standing.recordings), 'recording')} reduced to statistics; "
        f"{standing.bytes / 1e6:.1f} MB in all"
    )
    for build, known in standing.models.items():
        if not known:
            messages.note(f"build {build}: no model yet, so that all of its recordings are new")
    if standing.others:
        messages.note(f"{count(len(standing.others), 'recording')} of other fleets or settings; prune removes them")


def report_merged(messages: Messages, other: str, merged: MergeCounts) -> None:
    """What came out of another store, on stderr."""
    came = f"{count(merged.copied, 'recording')} and {count(merged.models, 'model')} copied"
    messages.note(f"{other}: {came}; {count(merged.present, 'recording')} were there")
    if merged.damaged:
        messages.warning(f"{other}: {count(len(merged.damaged), 'damaged file')} ignored")
    if merged.other_models:
        messages.warning(
            f"{other}: {count(len(merged.other_models), 'model')} differ from those here, which stay: what was "
            "reduced by theirs will be reduced anew; stores that are to merge need one nominal file, named in the "
            "fleet file"
        )


def _estimate(name: str, x: IntervalEstimate) -> dict[str, float]:
    return {name: x.value, f"{name}_low": x.low, f"{name}_high": x.high}


def _changed(x: EngineFinding) -> list[Any]:
    return sorted((r for r in x.health if r.probability >= LIKELY and r.onset), key=lambda r: -r.probability)
