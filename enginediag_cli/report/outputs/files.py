"""Declared columns of `check`, `simulate` and the log.

Rows of `check`: one per file, then one per thing that is known of it.

The lines of `--log`.

The records of `simulate`: one column per quantity of the engine, whose unit stands in its name.
"""

from __future__ import annotations

from enginediag_cli.report.outputs.declared import Table, column, part

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


_ABOUT = "a message that is about it"
_BEGIN, _END = "event: begin", "event: end"

LOG = Table(
    "log",
    1,
    "--log: one JSON object a line; the first of a run has event begin, the last event end",
    (
        column("time", "text", "UTC, ISO 8601 to the millisecond"),
        column("version", "text", "version of the program"),
        column("command", "text", "the command"),
        column("run", "text", "whose line it is, where runs share a log"),
        column("level", "text", "note, warning or error"),
        column("message", "text", "what was said"),
        column("event", "text", "begin or end"),
        column("arguments", "texts", "the command line"),
        column("folder", "text", "where it was given"),
        column("process", "integer", "its process"),
        column("exit_code", "integer", "how the run ended"),
        column("seconds", "number", "how long it took", "s"),
        part("outputs", "every file written: file, sha256, bytes", many=True),
        column("file", "text", "file that a message is about"),
        column("flight", "text", "flight that a message is about"),
        column("engine", "text", "engine that a message is about"),
        column("lines", "numbers", "its first and last line in the file"),
        column("flights", "integer", "flights that a message is about"),
        part("counts", "what was counted"),
        column("line", "integer", "line of the file", empty=True),
        column("column", "integer", "character of the line", empty=True),
        column("hint", "text", "how to mend it"),
        column("verdict", "text", "fault or no verdict, of a window of detect"),
        column("p_value", "number", "of that window", empty=True),
        column("lock", "text", "file whose lock the run holds"),
        column("traceback", "text", "of an internal error"),
    ),
    asked={
        "event": "the first and the last line",
        **dict.fromkeys(("arguments", "folder", "process"), _BEGIN),
        **dict.fromkeys(("exit_code", "seconds", "outputs"), _END),
        **dict.fromkeys(("file", "flight", "engine", "lines", "flights", "counts", "line", "column", "hint"), _ABOUT),
        **dict.fromkeys(("verdict", "p_value"), "detect"),
        "lock": "--lock",
        "traceback": "exit code 70",
    },
)


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
