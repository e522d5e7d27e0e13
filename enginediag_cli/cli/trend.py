"""`enginediag trend`: health over flights, and since when and how fast it changes."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import click

from enginediag_cli.cli.answer_options import Beside, work_scope_option
from enginediag_cli.cli.intake_options import (
    check_length,
    compared_options,
    judging_options,
    source_options,
)
from enginediag_cli.cli.judging import Compared, ending, write_result
from enginediag_cli.cli.margin_options import margin_options
from enginediag_cli.cli.options import exit_codes, jobs_option, message_options, output_options, pass_messages
from enginediag_cli.cli.picture_option import picture_option
from enginediag_cli.report.messages import Messages
from enginediag_cli.report.output import Output

if TYPE_CHECKING:
    from enginediag_cli.api.inputs import Recordings
    from enginediag_cli.api.over_time import MarginOptions
    from enginediag_cli.errors import ExitCode


@click.command(short_help="Follow health over flights: level, onset and rate of deterioration.", epilog=exit_codes())
@source_options
@compared_options(help="Nominal engine, as written by identify; not needed for what residual has written.")
@judging_options
@click.option(
    "--window",
    metavar="LENGTH",
    callback=check_length,
    help="Cut flights into windows: records (60) or time (300s, 10min, 1h). Without it a flight is one window, and a "
    "recording without a column `flight` is one window a record.",
)
@click.option(
    "--by",
    type=click.Choice(["parameter", "component"]),
    default="parameter",
    show_default=True,
    help="component: one row per event with the component that changed, all its parameters together, for an engine "
    "with generic maps.",
)
@click.option("--no-sensors", is_flag=True, help="No instrument is suspected, of outputs or of inputs.")
@click.option(
    "--what",
    type=click.Choice(["trend", "flights", "margin"]),
    default="trend",
    show_default=True,
    help="One row per parameter with kind, onset and rate; one row per flight and parameter; or the margin of the "
    "turbine temperature: one row per flight, one per event of maintenance, one with what is left and its forecast.",
)
@margin_options
@work_scope_option
@click.option(
    "--event",
    "events",
    metavar="FLIGHT",
    multiple=True,
    help="First flight after maintenance, by its label (FILE:LABEL where several have it) or, where flights have none, "
    "by its number from 1: what it did bring in turbine "
    "temperature and fuel at equal thrust or power. May be given several times; needs --nominal.",
)
@picture_option("the health of the engine that changed over its flights")
@jobs_option
@output_options
@message_options
@pass_messages
def trend(
    messages: Messages,
    source: Recordings,
    compared: Compared,
    windows: dict[str, Any],
    by: str,
    no_sensors: bool,
    what: str,
    margin: MarginOptions,
    work_scope: bool | None,
    events: tuple[str, ...],
    picture_path: str | None,
    output: Output,
) -> ExitCode:
    """Follow the health of engines over flights, in the order of the files and of the flights in them.

    \b
    enginediag trend -n nominal.yaml flights.csv
    enginediag trend -n nominal.yaml --what flights flights.csv
    enginediag trend -n nominal.yaml --by component --reference 20 fleet.csv
    enginediag trend -n nominal.yaml --what margin --limit T45_K 1180 --events washes.csv flights.csv
    enginediag residual -n nominal.yaml --sensors flights.csv -o statistics.csv && enginediag trend statistics.csv

    Components, sensors and the instruments that give the model its inputs may each have changed. Changes are in the
    parameter's unit, from nominal (--what flights) or since the onset, with 95 % intervals. `kind` is steady, step or
    deterioration, and `probability` is that the parameter has changed at all; `rivals` are the other suspects of the
    same change. `work_scope` (json) is by how much turbine temperature and fuel would fall at equal thrust or power if
    a component were again as it was before it changed; --event and --events say what maintenance did bring. Flights, or
    windows of a recording without flights, are counted from 1, per engine. --reference N says that nothing began in the
    first N records of an engine.
    """
    from enginediag_cli.api.over_time import trend as run

    # maintenance that is named by --event is described by what it brought
    beside = Beside(work_scope=work_scope or (True if events else work_scope))
    result = run(
        compared.nominal,
        source,
        what=what,
        by=by,
        sensors=not no_sensors,
        work_scope=beside.arguments(output)["work_scope"],
        events=events,
        margin=margin,
        messages=messages,
        stream=True,
        **windows,
        **compared.arguments,
    )
    write_result(result, output, picture_path)
    return ending(0, result.judged, False, result.unread)
