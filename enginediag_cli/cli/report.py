"""`enginediag report`: results of other commands, or recordings, as one page that opens offline."""

from __future__ import annotations

import os
import shlex
from typing import TYPE_CHECKING, Any

import click

from enginediag_cli.cli.config import command
from enginediag_cli.cli.options import (
    OUTPUT,
    false_alarm_option,
    jobs_option,
    long_name,
    margin_options,
    nominal_options,
    option,
    output_file_option,
    recordings_options,
    window_options,
)
from enginediag_cli.errors import ExitCode
from enginediag_cli.report.messages import Messages

if TYPE_CHECKING:
    from enginediag_cli.api.inputs import Recordings

PAGE_SUFFIXES = ("", ".html", ".htm")


@command()
@recordings_options
@nominal_options("Nominal file of the engine, from identify: FILEs that are recordings are judged with it.")
@window_options
@false_alarm_option
@margin_options
@option(OUTPUT, "--title", default="", metavar="TEXT", help="Headline of the page.")
@option(OUTPUT, "--static", is_flag=True, help="Draw static pictures even if bokeh is installed, for a small file.")
@output_file_option(
    "Write the page here, completely or not at all; - is standard output.",
    PAGE_SUFFIXES,
    required=True,
    metavar="FILE.html",
)
@jobs_option
def report(messages: Messages, source: Recordings, output: str, **choices: Any) -> ExitCode:
    """Write results as one page: the verdict first, then charts with their tables, then the provenance.

    \b
    enginediag report detected.csv isolated.csv trend.csv nominal.yaml -o report.html
    enginediag report -n nominal.yaml flights.csv -o report.html
    enginediag report -n nominal.yaml flights.csv --limit T45_K 1180 --events washes.csv -o report.html
    enginediag report explained.json refined.json -o missing_physics.html
    enginediag report fleet.json -o fleet.html

    FILEs are outputs of detect, isolate, trend, residual, locate, explain, refine --report, fleet and identify, as CSV
    or JSON with all columns, in any order. With -n, the other files are recordings: they are judged here by detect,
    isolate and trend. Their EGT margin is counted to --limit, or one of its substitutes; --events lists maintenance.
    The page needs no network. Plots are interactive where bokeh is installed (pip install 'enginediag[report]'). The
    same files give the same bytes.
    """
    from enginediag_cli.api.reporting import make_report

    page = make_report(source, command=[_command_line()], messages=messages, **choices)
    page.save(output)
    return ExitCode.NO_VERDICT if page.no_verdict else ExitCode.DONE


def _command_line() -> str:
    """The command as it was given, files without their folders."""
    context = click.get_current_context()
    words = ["enginediag", "report"]
    for parameter in context.command.params:
        value = context.params.get(parameter.name or "")
        if isinstance(parameter, click.Argument) or value in (None, False, "", (), parameter.default):
            continue
        path = isinstance(parameter.type, click.Path) and isinstance(value, str)
        for each in value if isinstance(value, tuple) else (os.path.basename(value) if path else value,):
            items = each if isinstance(each, tuple) else (each,)
            words += [f"--{long_name(parameter)}", *(str(item) for item in items if item is not True)]
    files = context.params.get("recordings") or ()
    return shlex.join([*words, *(os.path.basename(path) for path in files)])
