"""`make_report`: results, or recordings, as one page that opens offline."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from enginediag_cli.api.inputs import Comparison, NominalLike, RecordingsLike, compare
from enginediag_cli.api.results import MessageLog
from enginediag_cli.api.trends import MarginOptions
from enginediag_cli.errors import DataError, UsageError
from enginediag_cli.report.messages import Messages

if TYPE_CHECKING:
    from enginediag_cli.intake.selection import RecordingSource
    from enginediag_cli.report.evidence import ReportEvidence
    from enginediag_cli.report.result_files import ResultFile

__all__ = ["ReportPage", "make_report"]


class ReportPage:
    """A page; notebooks show it.

    Attributes
    ----------
    html : str
        The page, complete in itself.
    no_verdict : bool
        Whether the page has findings, and none of them is a verdict.
    """

    def __init__(self, html: str, no_verdict: bool):
        self.html, self.no_verdict = html, no_verdict

    def save(self, path: str | Path) -> None:
        """Write the page, completely or not at all; ``-`` is standard output. Raises OSError."""
        from enginediag_cli.recordings.write import open_output

        with open_output(str(path)) as stream:
            stream.write(self.html)

    def _repr_html_(self) -> str:
        return self.html


def make_report(
    files: RecordingsLike,
    *,
    nominal: NominalLike = None,
    false_alarm: float = 0.01,
    margin: MarginOptions | None = None,
    title: str = "",
    static: bool = False,
    command: Sequence[str] = (),
    messages: Messages | None = None,
    **windows: Any,
) -> ReportPage:
    """Make one page of results: the verdict first, then charts with their tables, then the provenance.

    Parameters
    ----------
    files
        Results of other verbs or commands; with `nominal`, recordings among them are judged here.
    nominal : str, Path, Baseline or IdentificationResult, optional
        Nominal engine of the recordings.
    false_alarm : float
        Probability of a false alarm [1].
    margin : MarginOptions, optional
        From and to what the EGT margin is counted.
    title : str
        Headline.
    static : bool
        Static pictures even if bokeh is installed.
    command : sequence of str
        Commands that the page shows as its origin.
    messages : Messages, optional
        Receives notes and warnings; by default they are collected in the result.
    **windows
        Attributes of `WindowOptions`.

    Returns
    -------
    ReportPage

    Raises
    ------
    UsageError, ConfigError, DataError, NoVerdictError
    """
    from enginediag_cli.report.html import EngineState, plots_can_move, rendered, versions
    from enginediag_cli.report.page import build_page
    from enginediag_cli.report.plotting.interactive import WITHOUT

    comparison = compare(nominal, files, windows, messages if messages is not None else MessageLog())
    if margin and comparison.given is None:
        raise UsageError("limits and --events need -n NOMINAL; of results, give what trend --what margin wrote")
    results, unreadable = _results(comparison)
    evidence, left_out = _evidence(comparison, results, false_alarm, margin or MarginOptions())
    if not static and not plots_can_move():
        comparison.messages.note(WITHOUT)
    page = build_page(
        evidence, title=title, command=list(command), left_out=[*unreadable, *left_out], versions=versions(static)
    )
    judged = [lead for lead in page.leads if lead.state is not EngineState.NO_VERDICT]
    return ReportPage(rendered(page, static), bool(page.leads) and not judged)


def _results(comparison: Comparison) -> tuple[list[ResultFile], list[str]]:
    """Read the results, with reasons for unreadable files. Raises DataError if none can be read."""
    from enginediag_cli.report.result_files import read_result

    source: RecordingSource = comparison.source
    results, unreadable = [], []
    for path in source.files:
        try:
            results.append(read_result(path, source.label(path), recordings=comparison.given is not None))
        except DataError as error:
            if len(source.files) == 1:
                raise
            unreadable.append(f"{error}: excluded")
    if not results:
        raise DataError("; ".join(unreadable))
    for sentence in unreadable:
        comparison.messages.warning(sentence)
    return results, unreadable


def _evidence(
    comparison: Comparison, results: list[ResultFile], false_alarm: float, margin: MarginOptions
) -> tuple[ReportEvidence, list[str]]:
    """Collect the findings of the results and of recordings that are judged here."""
    from enginediag_cli.report import result_files
    from enginediag_cli.report.evidence import RecordingsQuestion, collect_evidence, judge_recordings
    from enginediag_cli.report.result_files import known_parameters, nominal_result

    recordings = tuple(result.path for result in results if result.kind is result_files.RECORDING)
    if not recordings:
        if comparison.given is not None:
            raise DataError(f"--nominal {comparison.nominal}: none of the files is a recording that it could judge")
        return collect_evidence(results, known_parameters(results)), []
    if "-" in recordings:
        raise DataError("standard input can be read once, and recordings are read several times: name a file")
    source = replace(comparison.source, files=recordings)
    comparison = replace(comparison, source=source)
    monitor = comparison.monitor()
    suspicious = replace(comparison, messages=Messages(quiet=True)).monitor(sensors=True)
    assert monitor is not None and suspicious is not None
    margins = margin.question(healthy=comparison.judging.reference)
    question = RecordingsQuestion(source, monitor, suspicious, comparison.judging, false_alarm, margins)
    return judge_recordings(question, [*results, nominal_result(comparison.nominal)])
