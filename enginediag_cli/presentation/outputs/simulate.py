"""The records of `simulate`: one column per quantity of the engine, whose unit stands in its name."""

from __future__ import annotations

from enginediag_cli.presentation.outputs.declared import Table, column

SIMULATE = Table(
    "simulate",
    1,
    "one row per record: what the engine's sensors record",
    (
        column("flight", "integer", "number of the flight, from 1"),
        column("time_s", "number", "time since the flight began", "s"),
        column("phase", "text", "phase of the flight"),
        column("status", "text", "ok, or what is doubtful about the record"),
    ),
    families=(
        column("<quantity>_<unit>", "number", "input or reading of the engine", "as its name says", empty=True),
        column("mach", "number", "flight Mach number"),
    ),
    asked=dict.fromkeys(("flight", "time_s", "phase"), "flights, or --conditions that have the column"),
)
