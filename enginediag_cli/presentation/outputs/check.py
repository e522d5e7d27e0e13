"""Rows of `check`: one per file, then one per thing that is known of it."""

from __future__ import annotations

from enginediag_cli.presentation.outputs.declared import Table, column

CHECK = Table(
    "check",
    1,
    "one row per file, then one for each thing that is known of it",
    (
        column("file", "text", "the file"),
        column("engine", "text", "engine of a recording that holds several", empty=True),
        column("ok", "boolean", "false where it keeps the file from being used"),
        column("level", "text", "note, warning or problem", empty=True),
        column("about", "text", "sensors, inputs, units, frozen, time, repeated, read, masked, envelope …", empty=True),
        column("line", "integer", "line of the file, from 1", empty=True),
        column("last_line", "integer", "last line, where it is several", empty=True),
        column("column", "integer", "character of the line, from 1", empty=True),
        column("name", "text", "column of the recording", empty=True),
        column("count", "integer", "records, readings or columns", empty=True),
        column("found", "text", "what is so", empty=True),
        column("problem", "text", "what is wrong", empty=True),
        column("hint", "text", "how to mend it", empty=True),
    ),
)
