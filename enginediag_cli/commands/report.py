"""`enginediag report`: results of other commands, or recordings, as one page that opens offline."""

from __future__ import annotations

import os
import shlex
from dataclasses import dataclass
from typing import TYPE_CHECKING

import click

from enginediag_cli.commands.intake_options import compared_options, judging_options, source_options, window_options
from enginediag_cli.commands.judging import Compared
from enginediag_cli.commands.margin_options import Asked, margin_options
from enginediag_cli.commands.options import (
    OutputFile,
    exit_codes,
    false_alarm_option,
    jobs_option,
    message_options,
    pass_messages,
)
from enginediag_cli.errors import DataError, ExitCode
from enginediag_cli.presentation.messages import Messages

if TYPE_CHECKING:
    from enginediag_cli.intake.source import Source
    from enginediag_cli.presentation.report.evidence import Evidence
    from enginediag_cli.presentation.report.results.read import Result
    from enginediag_cli.residuals.files import Judging

PAGE_SUFFIXES = ("", ".html", ".htm")


@click.command(short_help="Write results as one page that opens offline.", epilog=exit_codes())
@source_options
@compared_options(help="Nominal engine, as written by identify: the FILEs that are recordings are judged by it.")
@judging_options
@window_options
@false_alarm_option
@margin_options
@click.option("--title", default="", metavar="TEXT", help="Headline of the page.")
@click.option("--static", is_flag=True, help="Pictures that do not move, although bokeh is installed: a small file.")
@click.option(
    "-o",
    "--output",
    "output_path",
    required=True,
    metavar="FILE.html",
    type=OutputFile(PAGE_SUFFIXES),
    help="Write the page here, completely or not at all; - is standard output.",
)
@jobs_option
@message_options
@pass_messages
def report(
    messages: Messages,
    source: Source,
    compared: Compared,
    judging: Judging,
    false_alarm: float,
    asked: Asked,
    title: str,
    static: bool,
    output_path: str,
) -> ExitCode:
    """Write what was found as one page: the verdict first, then charts, each with its table, then how it was made.

    \b
    enginediag report detected.csv isolated.csv trend.csv nominal.yaml -o report.html
    enginediag report -n nominal.yaml flights.csv -o report.html
    enginediag report -n nominal.yaml flights.csv --limit T45_K 1180 --events washes.csv -o report.html
    enginediag report explained.json refined.json -o missing_physics.html
    enginediag report fleet.json -o fleet.html

    FILEs are what detect, isolate, trend, residual, locate, explain, refine --report, fleet and identify wrote, as CSV
    or JSON with all columns, in any order; what each is, its content says. With -n the others are recordings, which are
    detected, isolated and followed here; the margin of their turbine temperature is counted to --limit, or to what
    stands in its place, and --events tells of maintenance. The page asks nothing of any network. Plots move where bokeh
    is installed (pip install 'enginediag[report]'); the same files give the same bytes.
    """
    from enginediag_cli.presentation.charts.interactive import WITHOUT
    from enginediag_cli.presentation.report.build import page_of
    from enginediag_cli.presentation.report.page import State
    from enginediag_cli.presentation.report.rendered import moves, rendered, versions
    from enginediag_cli.recordings.write import output

    judges = compared.nominal is not None
    if asked and not judges:
        raise click.UsageError("limits and --events need -n NOMINAL; of results, give what trend --what margin wrote")
    results, unreadable = _results(messages, source, recordings=judges)
    evidence, left_out = _evidence(messages, source, compared, judging, _Told(false_alarm, asked), results)
    if not static and not moves():
        messages.note(WITHOUT)
    page = page_of(
        evidence, title=title, command=[_shown()], left_out=[*unreadable, *left_out], versions=versions(static)
    )
    text = rendered(page, static)
    with output(output_path) as stream:
        stream.write(text)
    judged = [lead for lead in page.leads if lead.state is not State.NO_VERDICT]
    return ExitCode.DONE if judged or not page.leads else ExitCode.NO_VERDICT


def _results(messages: Messages, source: Source, *, recordings: bool) -> tuple[list[Result], list[str]]:
    """What can be read of the files, and why others cannot, which ends nothing as long as one can. Raises DataError."""
    from enginediag_cli.presentation.report.results.read import read_result

    results, unreadable = [], []
    for path in source.files:
        try:
            results.append(read_result(path, source.label(path), recordings=recordings))
        except DataError as error:
            if len(source.files) == 1:
                raise
            unreadable.append(f"{error}: left out")
    if not results:
        raise DataError("; ".join(unreadable))
    for sentence in unreadable:
        messages.warning(sentence)
    return results, unreadable


@dataclass(frozen=True)
class _Told:
    """What recordings are judged with."""

    false_alarm: float
    asked: Asked


def _evidence(
    messages: Messages,
    source: Source,
    compared: Compared,
    judging: Judging,
    told: _Told,
    results: list[Result],
) -> tuple[Evidence, list[str]]:
    """What the results say, with what recordings say that are judged here."""
    from dataclasses import replace

    from enginediag_cli.presentation.report.computed import Question, computed
    from enginediag_cli.presentation.report.evidence import evidence_of
    from enginediag_cli.presentation.report.results import kinds
    from enginediag_cli.presentation.report.results.known import known_of, nominal_result

    recordings = tuple(result.path for result in results if result.kind is kinds.RECORDING)
    if not recordings:
        if compared.nominal is not None:
            raise DataError(f"--nominal {compared.nominal}: none of the files is a recording that it could judge")
        return evidence_of(results, known_of(results)), []
    if "-" in recordings:
        raise DataError("standard input can be read once, and recordings are read several times: name a file")
    source = replace(source, files=recordings)
    assert compared.nominal is not None
    monitor = compared.open(messages, source, model_error=judging.model_error)
    suspicious = compared.open(Messages(quiet=True), source, sensors=True, model_error=judging.model_error)
    assert monitor is not None and suspicious is not None
    margins = told.asked.question(healthy=judging.reference)
    question = Question(source, monitor, suspicious, judging, told.false_alarm, margins)
    return computed(question, [*results, nominal_result(compared.nominal)])


def _shown() -> str:
    """The command as it was given, files without their folders."""
    context = click.get_current_context()
    words = ["enginediag", "report"]
    for parameter in context.command.params:
        value = context.params.get(parameter.name or "")
        if isinstance(parameter, click.Argument) or value in (None, False, "", (), parameter.default):
            continue
        option = max(parameter.opts, key=len)
        path = isinstance(parameter.type, click.Path) and isinstance(value, str)
        for each in value if isinstance(value, tuple) else (os.path.basename(value) if path else value,):
            items = each if isinstance(each, tuple) else (each,)
            words += [option, *(str(item) for item in items if item is not True)]
    files = context.params.get("recordings") or ()
    return shlex.join([*words, *(os.path.basename(path) for path in files)])
