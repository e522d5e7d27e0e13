"""`enginediag report`: results of other commands, or recordings, as one page that opens offline."""

from __future__ import annotations

import os
import shlex
from typing import TYPE_CHECKING, Any

import click

from enginediag_cli.cli.intake_options import compared_options, judging_options, source_options, window_options
from enginediag_cli.cli.judging import Compared
from enginediag_cli.cli.margin_options import margin_options
from enginediag_cli.cli.options import (
    OutputFile,
    exit_codes,
    false_alarm_option,
    jobs_option,
    message_options,
    pass_messages,
)
from enginediag_cli.errors import ExitCode
from enginediag_cli.report.messages import Messages

if TYPE_CHECKING:
    from enginediag_cli.api.inputs import Recordings
    from enginediag_cli.api.over_time import MarginOptions

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
    source: Recordings,
    compared: Compared,
    windows: dict[str, Any],
    false_alarm: float,
    margin: MarginOptions,
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
    from enginediag_cli.api.reporting import make_report as run

    page = run(
        source,
        nominal=compared.nominal,
        false_alarm=false_alarm,
        margin=margin,
        title=title,
        static=static,
        command=[_shown()],
        messages=messages,
        **windows,
        **compared.arguments,
    )
    page.save(output_path)
    return ExitCode.NO_VERDICT if page.no_verdict else ExitCode.DONE


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
