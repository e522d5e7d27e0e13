"""`enginediag report`: results of other commands as one page that opens offline."""

from __future__ import annotations

import os
import shlex

import click

from enginediag_cli.commands.options import (
    OutputFile,
    exit_codes,
    message_options,
    pass_messages,
    recordings_argument,
)
from enginediag_cli.errors import ExitCode
from enginediag_cli.presentation.messages import Messages

PAGE_SUFFIXES = ("", ".html", ".htm")


@click.command(short_help="Write results as one page that opens offline.", epilog=exit_codes())
@recordings_argument
@click.option(
    "-o",
    "--output",
    "output_path",
    required=True,
    metavar="FILE.html",
    type=OutputFile(PAGE_SUFFIXES),
    help="Write the page here, completely or not at all; - is standard output.",
)
@click.option("--title", default="", metavar="TEXT", help="Headline of the page.")
@click.option("--static", is_flag=True, help="Pictures that do not move, although bokeh is there: a small file.")
@message_options
@pass_messages
def report(messages: Messages, recordings: tuple[str, ...], output_path: str, title: str, static: bool) -> ExitCode:
    """Write what detect, isolate, trend and others found as one page.

    \b
    enginediag report detected.csv isolated.csv trend.csv flights.csv nominal.yaml -o report.html
    """
    from enginediag_cli.intake.source import Source
    from enginediag_cli.presentation.report.build import page_of
    from enginediag_cli.presentation.report.evidence import evidence_of
    from enginediag_cli.presentation.report.html import html
    from enginediag_cli.presentation.report.results.known import known_of
    from enginediag_cli.presentation.report.results.read import read_result
    from enginediag_cli.recordings.write import output

    source = Source(recordings)
    results = [read_result(path, source.label(path)) for path in recordings]
    evidence = evidence_of(results, known_of(results))
    command = ["enginediag", "report", *(os.path.basename(p) for p in recordings)]
    command += [*(["--title", title] if title else []), *(["--static"] if static else [])]
    page = page_of(evidence, title=title, command=[shlex.join([*command, "-o", os.path.basename(output_path)])])
    text = html(page)
    with output(output_path) as stream:
        stream.write(text)
    return ExitCode.DONE
