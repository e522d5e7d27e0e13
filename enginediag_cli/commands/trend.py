"""`enginediag trend`: health over flights, and since when and how fast it changes."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING, Any

import click

from enginediag_cli.commands.options import (
    exit_codes,
    message_options,
    output_options,
    pass_messages,
    recordings_argument,
)
from enginediag_cli.commands.origin import Origin, origin_options
from enginediag_cli.commands.windows import Intake, ending, load_monitor, model_options, statistics_option
from enginediag_cli.presentation.messages import Messages
from enginediag_cli.presentation.output import Output

if TYPE_CHECKING:
    from enginediag_cli.errors import ExitCode
    from enginediag_cli.parameters import Parameter
    from enginediag_cli.residuals.statistics import LocalStatistics

Flight = tuple[str, str, str]
"""Engine, file, flight."""


@click.command(short_help="Follow health over flights: level, onset and rate of deterioration.", epilog=exit_codes())
@recordings_argument
@statistics_option
@model_options
@origin_options
@click.option(
    "--what",
    type=click.Choice(["trend", "flights"]),
    default="trend",
    show_default=True,
    help="One row per parameter with kind, onset and rate, or one row per flight and parameter.",
)
@output_options
@message_options
@pass_messages
def trend(
    messages: Messages,
    recordings: tuple[str, ...],
    nominal: str | None,
    linearise: str,
    patterns: tuple[str, ...],
    origin: Origin,
    what: str,
    output: Output,
) -> ExitCode:
    """Follow the health of engines over flights, in the order of the files and of the flights in them.

    \b
    enginediag trend -n nominal.yaml flights.csv
    enginediag trend -n nominal.yaml --what flights flights.csv
    enginediag residual -n nominal.yaml flights.csv -o statistics.csv && enginediag trend statistics.csv

    Changes are in the parameter's unit, from nominal (--what flights) or since the onset, with 95 % intervals.
    `kind` is steady, step or deterioration, and `probability` is that the parameter has changed at all. Flights
    are counted from 1. Windows of one flight are added up.
    """
    from enginediag_cli.recordings.provenance import header_lines
    from enginediag_cli.residuals.windows import WindowPlan

    monitor = load_monitor(messages, nominal, patterns) if nominal else None
    intake = Intake(messages, monitor, WindowPlan(), linearise, origin)
    flights, known, lost = _sums(intake, recordings)
    rows = list(_trends(messages, flights, known) if what == "trend" else _flights(flights, known))
    head = header_lines(
        "trend",
        configs=[*([nominal] if nominal else []), *origin.configs],
        notes=origin.notes,
        inherited=intake.provenance,
    )
    output.write_rows(rows, provenance=head)
    intake.report()
    if lost:
        messages.warning(f"{lost} windows without a verdict were left out")
    return ending(0, len(rows), len(flights) + lost, False)


def _sums(intake: Intake, files: tuple[str, ...]) -> tuple[dict[Flight, LocalStatistics], dict[str, Parameter], int]:
    """Statistics of each flight, what the parameters are, and how many windows had none."""
    from enginediag_cli.errors import DataError

    flights: dict[Flight, LocalStatistics] = {}
    known: dict[str, Parameter] = {}
    lost = 0
    for window, its_own in intake.windows(files):
        if window.statistics is None:
            lost += 1
            continue
        known.update(its_own)
        key = (window.engine, window.source, window.flight)
        try:
            flights[key] = flights[key] + window.statistics if key in flights else window.statistics
        except ValueError as error:
            raise DataError(f"{window.source}: flight {window.flight}: {error}") from None
    return flights, known, lost


def _flights(flights: dict[Flight, LocalStatistics], known: dict[str, Parameter]) -> Iterator[dict[str, Any]]:
    from enginediag_cli.detection.trend import Z95, flight_change

    counts: dict[str, int] = {}
    for (engine, source, flight), statistics in flights.items():
        counts[engine] = counts.get(engine, 0) + 1
        found = flight_change(statistics)
        for a, change, error in zip(found.parameters, found.change, found.standard_error, strict=True):
            yield {
                "engine": engine,
                "source": source,
                "flight": flight,
                "number": counts[engine],
                "records": found.records,
                "parameter": a,
                "change": change,
                "low": change - Z95 * error,
                "high": change + Z95 * error,
                "unit": known[a].unit,
            }


def _trends(
    messages: Messages, flights: dict[Flight, LocalStatistics], known: dict[str, Parameter]
) -> Iterator[dict[str, Any]]:
    from enginediag_cli.detection.trend import Z95, fit_trends

    for engine in dict.fromkeys(key[0] for key in flights):
        mine = [statistics for key, statistics in flights.items() if key[0] == engine]
        name = f"engine {engine}: " if engine else ""
        if len(mine) < 3:
            messages.warning(f"{name}{len(mine)} flights are too few for a trend, which needs three")
            continue
        if any(x.parameters != mine[0].parameters for x in mine):
            from enginediag_cli.errors import DataError

            raise DataError(f"{name}flights with statistics of different parameters have no common trend")
        fit = fit_trends(mine)
        if not fit.converged:
            messages.warning(f"{name}the search for onsets did not settle")
        for t in fit.trends:
            changed = t.kind != "steady"
            row: dict[str, Any] = {
                "engine": engine,
                "flights": len(mine),
                "parameter": t.parameter,
                "kind": t.kind,
                "probability": t.probability,
            }
            values: dict[str, float | None] = {
                "onset": t.onset,
                "onset_low": t.onset_low,
                "onset_high": t.onset_high,
                "change": t.change,
                "change_low": t.change - Z95 * t.change_error,
                "change_high": t.change + Z95 * t.change_error,
                "rate_per_flight": t.rate,
                "rate_low": t.rate - Z95 * t.rate_error,
                "rate_high": t.rate + Z95 * t.rate_error,
            }
            if t.kind == "step":
                values.update(rate_per_flight=None, rate_low=None, rate_high=None)
            row.update({k: v if changed else None for k, v in values.items()})
            row["unit"] = known[t.parameter].unit
            yield row
