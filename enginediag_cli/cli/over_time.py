"""Commands that follow engines over time: `trend`, `fleet` and `report`.

`trend` follows health over flights: onset, rate, and EGT margin. `fleet` ranks many engines from their recordings;
`status`, `acknowledge`, `prune` and `merge` maintain its store. `report` puts results, or recordings, on one page that
opens offline.
"""

from __future__ import annotations

import os
import shlex
from typing import TYPE_CHECKING, Any

import click

from enginediag_cli.cli.config import Command, choose_exit_code, command, write_result
from enginediag_cli.cli.options import (
    EXISTING,
    INPUT,
    JUDGEMENT,
    MODEL,
    OPERATION,
    OUTPUT,
    ConfigFile,
    Decorator,
    accept_mismatch_option,
    all_cores_option,
    by_option,
    comparison_options,
    exit_code_option,
    extra_form,
    false_alarm_option,
    jobs_option,
    long_name,
    margin_options,
    nominal_options,
    option,
    options,
    output_file_option,
    output_options,
    picture_option,
    recordings_options,
    window_option,
    window_options,
    work_scope_option,
)
from enginediag_cli.errors import ExitCode
from enginediag_cli.report.messages import Messages
from enginediag_cli.report.output import Output

if TYPE_CHECKING:
    from enginediag_cli.api.inputs import Recordings


def alerts_option(whose: str) -> Decorator:
    """File of alert levels; whose: what they are levels of."""
    help = f"Alert levels {whose} (YAML, kind alerts): caution, warning, and how long they must last."
    return option(JUDGEMENT, "--alerts", metavar="FILE", type=ConfigFile(), help=help)


@command()
@recordings_options
@option(
    INPUT,
    "--event",
    metavar="FLIGHT",
    multiple=True,
    help="First flight after maintenance, by its label (FILE:LABEL if several files have it) or its number from 1: "
    "report what the maintenance restored. Repeatable; needs --nominal.",
)
@nominal_options("Nominal file of the engine, from identify; not needed for statistics from residual.")
@comparison_options
@window_option
@option(MODEL, "--no-sensors", is_flag=True, help="Assume that all instruments are right.")
@margin_options
@option(
    OUTPUT,
    "--what",
    type=click.Choice(["trend", "flights", "margin", "deltas"]),
    default="trend",
    show_default=True,
    help="trend: one row per change, with kind, onset and rate; flights: one row per flight and parameter; margin: EGT "
    "margin, one row per flight and maintenance event, and one with the forecast; deltas: raw deltas at equal power "
    "setting, smoothed, one row per flight and reading.",
)
@alerts_option("of --what deltas")
@option(
    JUDGEMENT,
    "--setting",
    metavar="COLUMN",
    default="",
    help="Power setting at which --what deltas compares, a reading such as N1_rpm. Default: that of --alerts, else the "
    "engine's own.",
)
@by_option("component: one row per event with all parameters of the component, for an engine with generic maps.")
@work_scope_option
@picture_option("the health of the engine that changed over its flights, its margin, or a delta with its levels")
@jobs_option
@output_options
def trend(
    messages: Messages,
    nominal: str | None,
    source: Recordings,
    event: tuple[str, ...],
    no_sensors: bool,
    work_scope: bool | None,
    picture: str | None,
    output: Output,
    **choices: Any,
) -> ExitCode:
    """Follow the health of engines over flights, in the order of the files and of the flights in them.

    \b
    enginediag trend -n nominal.yaml flights.csv
    enginediag trend -n nominal.yaml --what flights flights.csv
    enginediag trend -n nominal.yaml --by component --reference 20 fleet.csv
    enginediag trend -n nominal.yaml --what deltas --setting N1_rpm --alerts alerts/turbofan.yaml flights.csv
    enginediag trend -n nominal.yaml --what margin --limit T45_K 1180 --events washes.csv flights.csv
    enginediag residual -n nominal.yaml --sensors flights.csv -o statistics.csv && enginediag trend statistics.csv

    Components, sensors and the instruments of model inputs may each have changed. Changes are in the parameter's unit,
    from nominal (--what flights) or since the onset, with 95 % intervals. `kind` is steady, step, deterioration, comes
    and goes, intermittent, from the start (off nominal from the first flight on) or irregular; `shapes` has the courses
    with their probabilities, `onset` the first affected flight, `end` the first without the change again. `probability`
    is that the parameter has changed at all; `rivals` are alternative causes of the same change; `detectable` is the
    smallest step that these flights would have shown, and kind is `cannot tell` where that is more than is plausible.
    --event also says where a change may have been taken back.
    `work_scope` (JSON) is the reduction of turbine temperature and fuel flow at equal thrust or power if a component
    were restored to its state before the change. Flights are counted from 1 for each engine. Without a
    column `flight`, the windows of a recording count as flights (without --window, its records). --reference N says
    that nothing began in the first N records.
    """
    from enginediag_cli.api.trends import trend as run

    result = run(
        nominal,
        source,
        sensors=not no_sensors,
        # an event is described by what the maintenance restored
        work_scope=extra_form(work_scope or (True if event else work_scope), output),
        events=event,
        messages=messages,
        stream=True,
        **choices,
    )
    write_result(result, output, picture)
    return choose_exit_code(0, result.judged, False, result.unread)


FOLDER = click.Path(exists=True, file_okay=False)

fleet_arguments = options(
    click.argument("fleet_file", metavar="FLEET.yaml", type=ConfigFile()),
    click.argument("recordings", nargs=-1, metavar="[RECORDING]...", type=EXISTING),
)
store_option = option(INPUT, "--store", metavar="FOLDER", required=True, type=FOLDER, help="Folder of the store.")


@command("List what the store holds of a fleet.")
@fleet_arguments
@store_option
@output_options
def status(messages: Messages, fleet_file: str, recordings: tuple[str, ...], store: str, output: Output) -> None:
    """List which recordings of a fleet are reduced in the store, and which are new.

    \b
    enginediag fleet status fleet.yaml --store kept
    """
    from enginediag_cli.api.fleets import fleet_status

    write_result(fleet_status(fleet_file, store, recordings, messages=messages), output)


@command("Remove from the store what a fleet does not need.")
@fleet_arguments
@store_option
@option(OPERATION, "-n", "--dry-run", is_flag=True, help="Only report what would be removed.")
def prune(messages: Messages, fleet_file: str, recordings: tuple[str, ...], store: str, dry_run: bool) -> None:
    """Remove from the store recordings that the fleet no longer has, or that were reduced with another nominal file or
    other settings, and incomplete files of interrupted runs.

    \b
    enginediag fleet prune fleet.yaml --store kept --dry-run
    """
    from enginediag_cli.api.fleets import prune_store

    prune_store(fleet_file, store, recordings, dry_run=dry_run, messages=messages)


@command("Merge the content of other stores into one.")
@click.argument("into", metavar="STORE", type=click.Path(file_okay=False))
@click.argument("others", metavar="OTHER...", nargs=-1, required=True, type=FOLDER)
def merge(messages: Messages, into: str, others: tuple[str, ...]) -> None:
    """Copy into STORE what only the OTHER stores hold; they remain unchanged.

    \b
    enginediag fleet merge kept from_the_other_machine
    """
    from enginediag_cli.api.fleets import merge_stores

    merge_stores(into, *others, messages=messages)


@command("Acknowledge what is found in an engine of a fleet.")
@fleet_arguments
@store_option
@option(INPUT, "--engine", metavar="NAME", required=True, help="Serial number of the engine.")
@option(
    INPUT,
    "--parameter",
    metavar="NAME",
    multiple=True,
    help="Acknowledge only the change of this parameter. Repeatable. Default: all changes of the engine.",
)
@option(OPERATION, "--note", metavar="TEXT", default="", help="Why, for whoever looks next.")
@option(OPERATION, "--withdraw", is_flag=True, help="Withdraw what was acknowledged: it is raised again.")
@all_cores_option
def acknowledge(
    messages: Messages, fleet_file: str, recordings: tuple[str, ...], parameter: tuple[str, ...], **choices: Any
) -> None:
    """Acknowledge what is found in an engine: fleet shows it with date and size, and does not flag it again unless it
    grows beyond its 95 % interval, or something else changes.

    \b
    enginediag fleet acknowledge fleet.yaml --store kept --engine 5 --note "wash planned for March"
    enginediag fleet acknowledge fleet.yaml --store kept --engine 5 --withdraw
    """
    from enginediag_cli.api.fleets import acknowledge as run

    run(fleet_file, recordings=recordings, parameters=parameter, messages=messages, **choices)


PARTS: dict[str, click.Command] = {
    "acknowledge": acknowledge,
    "status": status,
    "prune": prune,
    "merge": merge,
}


class FleetCommand(Command):
    """A command whose first argument may be the name of one of `PARTS`, which then runs instead."""

    def make_context(
        self, info_name: str | None, args: list[str], parent: click.Context | None = None, **extra: Any
    ) -> click.Context:
        """Pass on to a part."""
        if args and args[0] in PARTS:
            return PARTS[args[0]].make_context(f"{info_name} {args[0]}", args[1:], parent, **extra)
        return super().make_context(info_name, args, parent, **extra)


@command(cls=FleetCommand, finding="an engine is flagged, or an instrument stuck or noisy, and --exit-code given")
@fleet_arguments
@accept_mismatch_option
@option(
    OUTPUT,
    "--what",
    type=click.Choice(["engines", "health", "flights"]),
    default="engines",
    show_default=True,
    help="Rows of a table or CSV: engines, worst first; health, one row per engine and parameter; or flights. JSON has "
    "all three.",
)
@option(
    OPERATION,
    "--store",
    metavar="FOLDER",
    type=click.Path(file_okay=False),
    help="Keep reduced recordings in FOLDER. The next run processes only new ones, also after an interruption.",
)
@all_cores_option
@option(
    OPERATION,
    "--scheduler",
    metavar="ADDRESS",
    default="",
    help="Dask scheduler, such as tcp://host:8786, whose workers see recordings and --store under the same paths. "
    "Needs the extra enginediag[fleet].",
)
@exit_code_option
@output_options
def fleet(
    messages: Messages, fleet_file: str, recordings: tuple[str, ...], exit_code: bool, output: Output, **choices: Any
) -> ExitCode:
    """Judge all engines of a fleet, rank them by severity, and find what is common to them.

    \b
    enginediag fleet fleet.yaml --store kept -o fleet.json
    enginediag fleet fleet.yaml flights/*.csv --what health -o health.csv
    enginediag fleet acknowledge fleet.yaml --store kept --engine 5
    enginediag fleet status fleet.yaml --store kept
    enginediag fleet prune fleet.yaml --store kept
    enginediag fleet merge kept from_the_other_machine

    The fleet file names the recordings (those on the command line replace its patterns), the engines, their healthy
    early life, the maintenance and what to judge; `enginediag schema fleet` has its keys. A common model is identified
    from the early life of some engines, unless a nominal file is named. Each engine is judged relative to its own early
    life.
    """
    from enginediag_cli.api.fleets import fleet as run

    result = run(fleet_file, recordings, messages=messages, **choices)
    result.write(output)
    return choose_exit_code(result.findings, result.judged, exit_code)


PAGE_SUFFIXES = ("", ".html", ".htm")


@command()
@recordings_options
@nominal_options("Nominal file of the engine, from identify: FILEs that are recordings are judged with it.")
@window_options
@false_alarm_option
@margin_options
@alerts_option("of raw deltas")
@option(OUTPUT, "--title", default="", metavar="TEXT", help="Headline of the page.")
@picture_option("the first screen, with its first chart,")
@option(OUTPUT, "--static", is_flag=True, help="Draw static pictures even if bokeh is installed, for a small file.")
@output_file_option(
    "Write the page here, completely or not at all; - is standard output.",
    PAGE_SUFFIXES,
    required=True,
    metavar="FILE.html",
)
@jobs_option
def report(messages: Messages, source: Recordings, output: str, picture: str | None, **choices: Any) -> ExitCode:
    """Write results as one page: the verdict first, then charts with their tables, then the provenance.

    \b
    enginediag report detected.csv isolated.csv trend.csv nominal.yaml -o report.html
    enginediag report -n nominal.yaml flights.csv -o report.html
    enginediag report -n nominal.yaml flights.csv --limit T45_K 1280 --events washes.csv -o report.html
    enginediag report -n nominal.yaml flights.csv --alerts alerts/turbofan.yaml -o report.html
    enginediag report explained.json refined.json -o missing_physics.html
    enginediag report fleet.json -o fleet.html

    FILEs are outputs of detect, isolate, trend, residual, locate, explain, refine --report, fleet and identify, as CSV
    or JSON with all columns, in any order. With -n, the other files are recordings: they are judged here by detect,
    isolate and trend. Their EGT margin is counted to --limit, or one of its substitutes; --events lists maintenance;
    --alerts has the caution and warning levels of raw deltas.
    The page needs no network. Plots are interactive where bokeh is installed (pip install 'enginediag[report]'). The
    same files give the same bytes.
    """
    from enginediag_cli.api.trends import make_report

    page = make_report(source, command=[_command_line()], messages=messages, **choices)
    page.save(output)
    if picture:
        page.plot().save(picture)
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
