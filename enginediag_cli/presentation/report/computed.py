"""A report straight from recordings: what `detect`, `isolate`, `trend` and `residual` would write, in one run."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from enginediag_cli.fleet_judgement.of_series import MarginQuestion
from enginediag_cli.intake.intake import Intake
from enginediag_cli.intake.source import Source
from enginediag_cli.intake.wanted import columns_of
from enginediag_cli.presentation.charts.model import Origin
from enginediag_cli.presentation.charts.records import Records
from enginediag_cli.presentation.charts.rows import Row
from enginediag_cli.presentation.left_out import elsewhere_lines, left_out_lines, not_judged_lines
from enginediag_cli.presentation.report.evidence import EngineEvidence, Evidence, evidence_of
from enginediag_cli.presentation.report.results import kinds
from enginediag_cli.presentation.report.results.read import Result
from enginediag_cli.progress import each, stage
from enginediag_cli.residuals.files import JudgedFiles, Judging
from enginediag_cli.residuals.monitor import Monitor, agreement_with
from enginediag_cli.residuals.records import record_residuals
from enginediag_cli.residuals.window import WindowStatistics


@dataclass(frozen=True)
class Question:
    """`monitor` watches the engine alone, `suspicious` every instrument, too; false_alarm: level of the tests; margins:
    what is asked of the margin."""

    source: Source
    monitor: Monitor
    suspicious: Monitor
    judging: Judging
    false_alarm: float
    margins: MarginQuestion = field(default_factory=MarginQuestion)


def computed(question: Question, given: Sequence[Result]) -> tuple[Evidence, list[str]]:
    """Evidence of the recordings beside the results `given`, and what was left out of them in words. Raises
    DataError, NoVerdictError."""
    left_out: list[str] = []
    windows: list[WindowStatistics] = []
    rows = {
        kinds.DETECTED: list(_detected(question, left_out)),
        kinds.ISOLATED: list(_isolated(question, windows)),
        **_series(question),
        kinds.MARGIN: _margins(question, left_out),
    }
    evidence = evidence_of(given, question.suspicious.meaning)
    for kind, found in rows.items():
        for row in found:
            evidence.add(kind, row, "what is judged here")
    for window in windows:
        mine = evidence.engines.setdefault(window.engine, EngineEvidence(window.engine))
        mine.windows.append((window, _place(window)))
    _add_records(question, evidence)
    return evidence, left_out


def _detected(question: Question, left_out: list[str]) -> Iterator[Row]:
    from enginediag_cli.detection.verdict import judge
    from enginediag_cli.presentation.detection_rows import detection_row
    from enginediag_cli.residuals.economy import Economy

    files = _files(question, question.monitor)
    # whether anything has changed does not depend on what wrong slopes of maps would make of the change
    files.economy = Economy(replace(question.monitor, slopes=None))
    for window, _ in each(files.windows(), "windows judged"):
        row = detection_row(judge(window, question.false_alarm, monitor=question.monitor), True)
        yield Row(row, _place(window))
    for left in files.intake.left_out:
        left_out += left_out_lines(left)
    left_out += [*not_judged_lines(files.counts), *elsewhere_lines(files.elsewhere)]


def _isolated(question: Question, windows: list[WindowStatistics]) -> Iterator[Row]:
    from enginediag_cli.isolation.diagnosis import DiagnosisOptions
    from enginediag_cli.isolation.methods import IsolationOptions
    from enginediag_cli.isolation.of_windows import Isolating
    from enginediag_cli.presentation.isolation_rows import isolated_rows
    from enginediag_cli.residuals.kept_records import KeptRecords

    judging, kept = question.judging, None
    if not judging.reference and judging.linearise == "estimate":
        kept = KeptRecords(question.suspicious, short_windows=not judging.plan.whole)
    nonlinear = "auto" if judging.linearise == "estimate" else "never"
    options = DiagnosisOptions(isolation=IsolationOptions(false_alarm=question.false_alarm), nonlinear=nonlinear)
    isolating = Isolating(_files(question, question.suspicious), options, question.false_alarm, kept=kept)
    for found in each(isolating.windows(), "windows isolated"):
        windows.append(found.verdict.window)
        for row in isolated_rows(found, False, advice=False):
            yield Row(row, _place(found.verdict.window))


@stage("following the series")
def _series(question: Question) -> dict[kinds.Kind, list[Row]]:
    from enginediag_cli.detection.trend_of_files import series_of
    from enginediag_cli.isolation.stories import stories_of
    from enginediag_cli.presentation.trend_rows import flight_rows, trend_rows
    from enginediag_cli.residuals.series_monitor import of_series

    series = series_of(_series_files(question, of_series(question.suspicious)))
    told: dict[kinds.Kind, list[Row]] = {kinds.FLIGHTS: [], kinds.TREND: []}
    for row in flight_rows(series):
        window = series.stretches[row["engine"]][row["number"] - 1].window
        told[kinds.FLIGHTS].append(Row(row, _place(window)))
    generic = question.suspicious.slopes is not None
    for engine, story in stories_of(series, reference=question.judging.reference, generic=generic):
        last = _place(series.stretches[engine][-1].window)
        told[kinds.TREND] += [Row(row, last) for row in trend_rows(engine, story, series)]
    return told


@stage("following the margin")
def _margins(question: Question, left_out: list[str]) -> list[Row]:
    from enginediag_cli.fleet_judgement.of_series import margins_of
    from enginediag_cli.presentation.margin_rows import margin_rows, odd_events
    from enginediag_cli.residuals.series_monitor import for_comparison, of_series

    monitor = of_series(question.suspicious)
    margins = margins_of(_series_files(question, for_comparison(monitor)), monitor, question.margins)
    left_out += odd_events(margins)
    told = []
    for row in margin_rows(margins):
        stretches = margins.series.stretches[row["engine"]]
        told.append(Row(row, _place(stretches[(row["number"] or len(stretches)) - 1].window)))
    return told


def _add_records(question: Question, evidence: Evidence) -> None:
    """Residuals of every record, with the inputs."""
    monitor = question.suspicious
    inputs = [c for c in monitor.engine.inputs]
    found: dict[str, list[tuple[dict[str, Any], dict[str, float]]]] = {}
    intake = _intake(question, monitor)
    for chunk in each(intake.chunks(), "chunks of residuals"):
        values = {c: chunk.columns[c] for c in inputs if c in chunk.columns}
        for k, row in enumerate(record_residuals(monitor, chunk)):
            found.setdefault(str(row.get("engine", "")), []).append((row, {c: float(v[k]) for c, v in values.items()}))
    for engine, rows in found.items():
        mine = evidence.engines.setdefault(engine, EngineEvidence(engine))
        mine.records = _records(monitor, rows)
        for left in intake.left_out:
            if left.engine in ("", engine):
                for column, reasons in left.columns.items():
                    mine.masked[column] = mine.masked.get(column, 0) + sum(reasons.values())


def _records(monitor: Monitor, rows: Sequence[tuple[dict[str, Any], dict[str, float]]]) -> Records:
    def column(name: str, of: Callable[[tuple[dict[str, Any], dict[str, float]]], Any]) -> np.ndarray:
        return np.array([float(of(entry).get(name, np.nan)) for entry in rows])

    power = getattr(monitor.engine, "power_setting", "")
    return Records(
        [row["source"] for row, _ in rows],
        [row["line"] for row, _ in rows],
        [str(row.get("flight", "")) for row, _ in rows],
        column("time_s", lambda entry: entry[0]),
        {s: column(s + kinds.SIGMAS, lambda entry: entry[0]) for s in monitor.sensors},
        {s: column(s + kinds.RESIDUAL, lambda entry: entry[0]) for s in monitor.sensors},
        {c: column(c, lambda entry: entry[1]) for c in rows[0][1]},
        ALTITUDE if ALTITUDE in rows[0][1] else "",
        power if power in rows[0][1] else "",
    )


ALTITUDE = "altitude_m"
"""The input of every engine that flies."""


def _files(question: Question, monitor: Monitor) -> JudgedFiles:
    return JudgedFiles(_intake(question, monitor), monitor, question.judging)


def _series_files(question: Question, monitor: Monitor) -> JudgedFiles:
    """Windows that are compared with each other; a reference is of the series, not of a window."""
    plan = question.judging.plan
    judging = replace(question.judging, plan=plan.of_series, reference=0)
    return JudgedFiles(_intake(question, monitor), monitor, judging, summed=plan.whole, series=True)


def _intake(question: Question, monitor: Monitor) -> Intake:
    wanted = columns_of(monitor.engine, monitor.sensors)
    return Intake(question.source, wanted, agreement=agreement_with(monitor), keep_going=True)


def _place(window: Any) -> Origin:
    return Origin(window.source, f"{window.first_line}–{window.last_line}")
