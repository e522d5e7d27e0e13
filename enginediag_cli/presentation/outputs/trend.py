"""Rows of `trend`: one per parameter, per event, or per flight and parameter."""

from __future__ import annotations

from enginediag_cli.config.fields import Field
from enginediag_cli.presentation.outputs.beside import ASKED_SCOPE, SCOPE
from enginediag_cli.presentation.outputs.declared import Table, column
from enginediag_cli.presentation.outputs.windows import INSTRUMENTS

_SERIES = (
    column("engine", "text", "engine, as its recording calls it"),
    column("flights", "integer", "flights, or windows, of the series"),
)
_FIT = (
    column(
        "verdict",
        "text",
        "of the engine: changed, steady, differs from nominal from the first flight on, or cannot tell",
    ),
    column("fit_before", "number", "χ² per degree of freedom without any change", empty=True),
    column("fit", "number", "χ² per degree of freedom with what is told here", empty=True),
    column("unlisted", "number", "probability that it is something that is not among the suspects", empty=True),
    INSTRUMENTS,
)
_ONSET = (
    column("onset", "integer", "flight from which on, counted from 1 in the series", empty=True),
    column("onset_low", "integer", "lower end of its 95 % interval", empty=True),
    column("onset_high", "integer", "upper end of its 95 % interval", empty=True),
    column("onset_flight", "text", "that flight, as its recording calls it", empty=True),
    column("onset_source", "text", "file that holds it", empty=True),
    column("onset_line", "integer", "its first line there", empty=True),
    column("onset_s", "number", "its time, where the recording has one", "s", empty=True),
)
_PARAMETER = "of the parameter"

TREND = Table(
    "trend",
    1,
    "one row per parameter: what changed over flights, and since when",
    (
        *_SERIES,
        column("parameter", "text", "the parameter"),
        *_FIT,
        column("component", "text", "component or instrument that it belongs to"),
        column(
            "kind",
            "text",
            "steady, step, deterioration, or cannot tell where the series is not steady and nothing is told of it",
        ),
        column("probability", "number", "probability that it changed at all"),
        *_ONSET,
        column("change", "number", "change from before the onset to the last flight", _PARAMETER, empty=True),
        column("change_low", "number", "lower end of its 95 % interval", _PARAMETER, empty=True),
        column("change_high", "number", "upper end of its 95 % interval", _PARAMETER, empty=True),
        column("rate_per_flight", "number", "mean rate since the onset", _PARAMETER, empty=True),
        column("rate_low", "number", "lower end of its 95 % interval", _PARAMETER, empty=True),
        column("rate_high", "number", "upper end of its 95 % interval", _PARAMETER, empty=True),
        column("unit", "text", "unit of change and rate; 1 is a share of nominal"),
        column("rivals", "texts", "other suspects of the same change, with their probabilities"),
        *SCOPE,
    ),
    asked=ASKED_SCOPE,
)

EVENTS = Table(
    "trend/components",
    1,
    "trend --by component: one row per event, one alone where there is none",
    (
        *_SERIES,
        *_FIT,
        column("components", "texts", "the component that changed, or those that cannot be told apart"),
        column("probability", "number", "probability of the change; without an event, that nothing changed"),
        column("kind", "text", "step or deterioration", empty=True),
        *_ONSET,
        column("rivals", "texts", "all suspects, with their probabilities"),
        *SCOPE,
    ),
    asked=ASKED_SCOPE,
)

FLIGHTS = Table(
    "trend/flights",
    1,
    "trend --what flights: one row per flight and parameter",
    (
        column("engine", "text", "engine, as its recording calls it"),
        column("source", "text", "file that holds the flight"),
        column("flight", "text", "flight, as its recording calls it"),
        column("number", "integer", "its number in the series, from 1"),
        column("records", "integer", "records judged"),
        column("parameter", "text", "the parameter"),
        column("change", "number", "its change from nominal", _PARAMETER),
        column("low", "number", "lower end of the 95 % interval", _PARAMETER),
        column("high", "number", "upper end of the 95 % interval", _PARAMETER),
        column("unit", "text", "unit of the change; 1 is a share of nominal"),
    ),
)

_ESTIMATE = "of all flights together; in a row of a flight, by that flight alone"


def with_ends(name: str) -> tuple[str, str, str]:
    """A column of the margin's table, and those of its interval: used_K, used_low, used_high."""
    stem = name.removesuffix("_K")
    return name, f"{stem}_low", f"{stem}_high"


def _estimated(name: str, help: str, unit: str, level: str = "95 %") -> tuple[Field, ...]:
    told = (help, f"lower end of its {level} interval", f"upper end of its {level} interval")
    return tuple(column(n, "number", what, unit, empty=True) for n, what in zip(with_ends(name), told, strict=True))


MARGIN = Table(
    "trend/margin",
    1,
    "trend --what margin: one row per flight, one per event of maintenance, and one with the margin of each engine",
    (
        column("engine", "text", "engine, as its recording calls it"),
        column("row", "text", "what the row tells: flight, maintenance or margin"),
        column("number", "integer", "flight, counted from 1; the first after maintenance; the last", empty=True),
        column("flight", "text", "that flight, as its recording calls it", empty=True),
        column("source", "text", "file that holds it", empty=True),
        column("column", "text", "the hottest recorded temperature of burnt gas, whose margin it is", empty=True),
        column("condition", "text", "reference condition of the margin", empty=True),
        column("limit_K", "number", "limit of the temperature there, as stated", "K", empty=True),
        *_estimated("used_K", f"kelvins that wear has taken since the baseline, {_ESTIMATE}", "K"),
        *_estimated("margin_K", f"kelvins to the limit, {_ESTIMATE}", "K"),
        *_estimated("remaining_flights", "flights until the limit; empty: no end in sight", "", "90 %"),
        *_estimated("rate_K", "kelvins that wear takes in a flight now", "K"),
        column("event", "text", "wash, overhaul or exchange", empty=True),
        column("component", "text", "component that it was done to; empty: the engine", empty=True),
        column("brought", "texts", "what each parameter gained, with its 95 % interval"),
        *_estimated("recovered_K", "kelvins of margin that maintenance gave back", "K"),
        *_estimated("temperature_gain_K", "by how much turbine temperature fell at equal power", "K"),
        *_estimated("fuel_gain_percent", "by how much fuel flow fell at equal power", "%"),
        column("held", "text", "at which power and operating point that is", empty=True),
        column("reason", "text", "why something cannot be told", empty=True),
    ),
)
