"""The columns of every row that is about a window of records: which it is, and what became of its records."""

from __future__ import annotations

from enginediag_cli.presentation.outputs.declared import column

WINDOW = (
    column("source", "text", "file that holds the window"),
    column("flight", "text", "flight, as its recording calls it; empty where it does not say"),
    column("engine", "text", "engine, as its recording calls it; empty where it does not say"),
    column("first_line", "integer", "first line of the window in its file, from 1"),
    column("last_line", "integer", "last line of the window"),
    column("start_s", "number", "time of the first record", "s", empty=True),
    column("end_s", "number", "time of the last record", "s", empty=True),
    column("records", "integer", "records in the window"),
    column("outside", "integer", "of these, outside the operating points identified and not judged"),
    column("incomplete", "integer", "of these, without an input or any reading"),
    column("failed", "integer", "of these, not computed by the engine's model"),
    column("sensors", "integer", "sensors that gave a reading"),
    column("sensors_of", "integer", "sensors that there are"),
    column("extrapolated", "integer", "records judged beyond the operating points identified, with limits as wider"),
    column("reason", "text", "why there is no verdict; empty where there is one"),
)
"""The columns of `residuals.flat.window_row`."""

INSTRUMENTS = column("instruments", "texts", "instruments that are stuck or scatter, in words", empty=True)
