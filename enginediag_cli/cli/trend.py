"""`enginediag trend`: health over flights, since when and how fast it changes, and the EGT margin."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import click

from enginediag_cli.cli.config import choose_exit_code, command, write_result
from enginediag_cli.cli.options import (
    INPUT,
    MODEL,
    OUTPUT,
    comparison_options,
    extra_form,
    jobs_option,
    margin_options,
    nominal_options,
    option,
    output_options,
    picture_option,
    recordings_options,
    window_option,
    work_scope_option,
)
from enginediag_cli.report.messages import Messages
from enginediag_cli.report.output import Output

if TYPE_CHECKING:
    from enginediag_cli.api.inputs import Recordings
    from enginediag_cli.errors import ExitCode


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
    type=click.Choice(["trend", "flights", "margin"]),
    default="trend",
    show_default=True,
    help="trend: one row per change, with kind, onset and rate; flights: one row per flight and parameter; margin: EGT "
    "margin, one row per flight and maintenance event, and one with the forecast.",
)
@option(
    OUTPUT,
    "--by",
    type=click.Choice(["parameter", "component"]),
    default="parameter",
    show_default=True,
    help="component: one row per event with all parameters of the component, for an engine with generic maps.",
)
@work_scope_option
@picture_option("the health of the engine that changed over its flights")
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
    enginediag trend -n nominal.yaml --what margin --limit T45_K 1180 --events washes.csv flights.csv
    enginediag residual -n nominal.yaml --sensors flights.csv -o statistics.csv && enginediag trend statistics.csv

    Components, sensors and the instruments of model inputs may each have changed. Changes are in the parameter's unit,
    from nominal (--what flights) or since the onset, with 95 % intervals. `kind` is steady, step or deterioration.
    `probability` is that the parameter has changed at all; `rivals` are alternative causes of the same change.
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
