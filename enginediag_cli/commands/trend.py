"""`enginediag trend`: health over flights, and since when and how fast it changes."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import click

from enginediag_cli.commands.answer_options import Beside, work_scope_option
from enginediag_cli.commands.intake_options import (
    check_length,
    compared_options,
    judging_options,
    source_options,
)
from enginediag_cli.commands.judging import Compared, ending, judged_files, tell_files
from enginediag_cli.commands.margin_options import Asked, margin_options
from enginediag_cli.commands.options import exit_codes, jobs_option, message_options, output_options, pass_messages
from enginediag_cli.commands.picture_option import picture_option
from enginediag_cli.presentation.messages import Messages
from enginediag_cli.presentation.output import Output
from enginediag_cli.presentation.summaries import FLIGHTS, MARGIN, TREND, TREND_COMPONENTS

if TYPE_CHECKING:
    from enginediag_cli.errors import ExitCode
    from enginediag_cli.intake.source import Source
    from enginediag_cli.residuals.files import Judging


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
    source: Source,
    compared: Compared,
    judging: Judging,
    by: str,
    no_sensors: bool,
    what: str,
    asked: Asked,
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
    from dataclasses import replace

    from enginediag_cli.detection.trend_of_files import FEWEST, series_of
    from enginediag_cli.isolation.stories import stories_of
    from enginediag_cli.presentation.maintenance_rows import maintenance_row, tell_maintenance, tell_scope, with_scope
    from enginediag_cli.presentation.margin_rows import margin_rows, tell_margins
    from enginediag_cli.presentation.outputs import trend as outputs
    from enginediag_cli.presentation.trend_rows import (
        component_rows,
        flight_rows,
        tell_story,
        tell_too_few,
        trend_rows,
    )
    from enginediag_cli.recordings.provenance import header_lines
    from enginediag_cli.residuals.series_monitor import for_comparison, of_series
    from enginediag_cli.work_scope.of_series import conditions_of, maintenance_of
    from enginediag_cli.work_scope.scope import Scoping

    if events and (compared.nominal is None or what != "trend"):
        raise click.UsageError(f"--event needs --nominal, and does not go with --what {what}")
    followed = bool(asked) or what == "margin"
    if followed and compared.nominal is None:
        raise click.UsageError("--what margin, its limits and --events need --nominal: the engine says what wear heats")
    if followed and what != "margin" and "-" in source.files:
        raise click.UsageError("standard input is read once, and limits and --events read it again: name a file")
    whole = judging.plan.whole
    notes = {**source.notes, **judging.notes, **asked.notes}
    healthy = judging.reference
    question = asked.question(healthy=healthy, sensors=not no_sensors)
    judging = replace(judging, plan=judging.plan.of_series, reference=0)  # of the series, not of a window
    monitor = compared.open(messages, source, sensors=not compared.patterns, model_error=judging.model_error)
    generic = monitor is None or monitor.slopes is not None
    monitor = None if monitor is None else of_series(monitor)
    margins = None
    if followed and monitor is not None:
        from enginediag_cli.fleet_judgement.of_series import margins_of

        files = judged_files(source, for_comparison(monitor), judging, summed=whole, series=True)
        margins = margins_of(files, monitor, question)
        series = margins.series
        tell_margins(messages, margins)
    if margins is None or what != "margin":
        files = judged_files(source, monitor, judging, summed=whole, series=True)
        series = series_of(files, "covariance" if what == "trend" else "whole")
    if monitor is None and series.stretches and what == "trend":
        messages.note(
            "without --nominal it is not known which inputs are weather and which set the power: what follows the "
            "weather may pass for a change, and no instrument of an input is held against what it read"
        )
    form = Beside(work_scope=work_scope or (True if events else None)).forms(output)["work_scope"]
    scoping = None if monitor is None or work_scope is False else Scoping(monitor)
    rows: list[dict[str, Any]] = []
    if margins is not None and what == "margin":
        rows = list(margin_rows(margins))
    elif what == "flights":
        rows = list(flight_rows(series))
    else:
        as_rows = component_rows if by == "component" else trend_rows
        for engine, stretches in series.stretches.items():
            if len(stretches) < FEWEST:
                tell_too_few(messages, engine, len(stretches))
        stories = stories_of(series, reference=healthy, sensors=not no_sensors, generic=generic, against_nominal=True)
        for engine, story in stories:
            stretches = series.stretches[engine]
            tell_story(messages, engine, story, series)
            scope = None
            if scoping is not None and story.events and (form or not messages.quiet):
                scope = scoping.of_story(story, series.known, conditions_of(stretches))
            tell_scope(messages, engine, scope)
            rows += with_scope(as_rows(engine, story, series), scope, form)
            if scoping is not None:
                for found in maintenance_of(scoping, series, engine, events):
                    tell_maintenance(messages, engine, found, series, scoping)
                    rows.append(maintenance_row(engine, found, series, scoping, form, rows))
    name = "components" if what == "trend" and by == "component" else what
    declared, summary = {
        "trend": (outputs.TREND, TREND),
        "components": (outputs.EVENTS, TREND_COMPONENTS),
        "flights": (outputs.FLIGHTS, FLIGHTS),
        "margin": (outputs.MARGIN, MARGIN),
    }[name]
    head = header_lines(
        "trend",
        configs=[*compared.configs, *source.configs, *asked.configs],
        notes={**declared.notes, **notes},
        inherited=files.intake.provenance,
    )
    output.write_rows(rows, summary=summary, provenance=head)
    tell_files(messages, files)
    if picture_path:
        from enginediag_cli.presentation.charts.pictured import of_margin, of_trend, write_picture

        write_picture(of_margin(rows) if what == "margin" else of_trend(series, rows), picture_path)
    if series.lost:
        messages.warning(f"{series.lost} windows without a verdict were left out")
    return ending(0, len(rows), False, files.intake.unread)
