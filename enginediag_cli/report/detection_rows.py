"""The answer of `detect` as rows: one per window, or per block of a flight that is followed.

What a rival method says of windows, as rows: its tests, its alarm, and what it names.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from enginediag_cli.report.outputs.judgements import DETECT, FOLLOW
from enginediag_cli.residuals.flat import window_row

if TYPE_CHECKING:
    from enginediag_cli.detection.follow import BlockReport
    from enginediag_cli.detection.verdict import Verdict
    from enginediag_cli.methods.base import Method, WindowVerdict
    from enginediag_cli.report.messages import Messages


def detection_row(verdict: Verdict, detectable: bool) -> dict[str, Any]:
    """Row of one window; detectable: with the smallest changes that it would have shown, in the parameter's unit, and
    what it does not excite."""
    from enginediag_cli.report.sentences import instrument_fault
    from enginediag_cli.residuals.flat import window_row

    test, fit, statistics = verdict.test, verdict.fit, verdict.window.statistics
    row = window_row(verdict.window)
    row.update(
        judged=statistics.n if statistics else 0,
        statistic=test.statistic if test else None,
        dof=test.dof if test else None,
        threshold=test.threshold if test else None,
        p_value=test.p_value if test else None,
        alarm=test.alarm if test else None,
        fit=fit.ratio if fit else None,
        verdict=verdict.verdict,
        reason=verdict.reason,
        instruments=[instrument_fault(fault) for fault in verdict.window.instruments],
        gross_readings=verdict.window.gross.rejected if verdict.window.gross.judged else None,
    )
    if detectable:
        row["not_excited"] = None
        if verdict.score is not None and verdict.detectable is not None and statistics is not None:
            row["not_excited"] = [str(combination) for combination in statistics.unexcited()]
            sizes = zip(verdict.score.parameters, verdict.detectable, strict=True)
            row.update({f"detectable:{a}": x for a, x in sizes})
    return DETECT.row(row)


def tell_window(messages: Messages, verdict: Verdict, *, in_words: bool) -> None:
    """Instruments that are stuck or scatter, where they are told in words; a window that is not healthy, for the log
    alone: its rows say more."""
    if in_words and verdict.window.instruments:
        from enginediag_cli.report.isolation_rows import tell_instruments

        tell_instruments(messages, verdict)
    if verdict.verdict == "healthy" or messages.log is None:
        return
    from enginediag_cli.report.isolation_rows import about, where

    told = f"{where(verdict)}: {verdict.verdict}" + (f", {verdict.reason}" if verdict.reason else "")
    p_value = verdict.test.p_value if verdict.test else None
    messages.record("note", told, verdict=verdict.verdict, p_value=p_value, **about(verdict))


def tell_new_instruments(messages: Messages, report: BlockReport, known: set[str]) -> None:
    """Instruments of a flight that are found stuck or scattering for the first time, beside those that are `known`."""
    from enginediag_cli.report.sentences import instrument_fault

    source, flight, engine = report.key
    place = ", ".join(filter(None, [engine and f"engine {engine}", flight and f"flight {flight}"])) or source
    for fault in report.instruments:
        if fault.name not in known:
            known.add(fault.name)
            messages.note(f"{place}: {instrument_fault(fault)}", engine=engine, flight=flight)


def block_row(report: BlockReport) -> dict[str, Any]:
    """A block as a row; what is said of the change is empty without an alarm."""
    from enginediag_cli.report.sentences import instrument_fault

    change = report.change
    row: dict[str, Any] = dict(zip(("source", "flight", "engine"), report.key, strict=True))
    for name in (
        "block",
        "first_line",
        "last_line",
        "start_s",
        "end_s",
        "records",
        "outside",
        "incomplete",
        "failed",
        "repeated",
        "judged",
        "sensors",
        "sensors_of",
        "log10_e",
        "alarm",
    ):
        row[name] = getattr(report, name)
    row.update(
        kind=change.kind if change else None,
        leading=change.leading if change else None,
        probability=change.probability if change else None,
        likely=change.parameter if change else None,
        onset_s=change.onset_s if change else None,
        onset_low_s=change.low_s if change else None,
        onset_high_s=change.high_s if change else None,
        reason=report.reason,
        instruments=[instrument_fault(fault) for fault in report.instruments],
        gross_readings=report.gross.rejected,
    )
    return FOLLOW.row(row)


TEST_COLUMNS = ("statistic", "threshold", "p_value")


def method_row(found: WindowVerdict, method: Method) -> dict[str, Any]:
    """One row: the window, `<test>:statistic`, `:threshold` and `:p_value` of each test, `alarm`, `isolated` with the
    kind of name that it is, the probability that the method states, verdict and reason. A window without a verdict
    has empty cells where its tests would stand.
    """
    row = window_row(found.window.place)
    row.update(judged=found.window.judged, method=method.name)
    verdicts, w = found.verdicts, found.number
    values = {test.name: test for test in verdicts.tests} if verdicts is not None and not found.reason else {}
    for name in method.tests:
        for column in TEST_COLUMNS:
            row[f"{name}:{column}"] = getattr(values[name], column)[w] if name in values else None
    told = verdicts is not None and not found.reason
    named = verdicts.isolated_names(w) if verdicts is not None and told else None
    row.update(
        alarm=bool(verdicts.alarm[w]) if verdicts is not None and told else None,
        isolated=list(named or ()),
        isolated_kind=verdicts.kind if verdicts is not None and named else None,
        probability=_probability(found) if named else None,
        verdict=found.verdict,
        reason=found.reason,
    )
    return row


def _probability(found: WindowVerdict) -> float | None:
    verdicts = found.verdicts
    return None if verdicts is None or verdicts.probability is None else float(verdicts.probability[found.number])
