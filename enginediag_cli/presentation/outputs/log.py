"""The lines of `--log`."""

from __future__ import annotations

from enginediag_cli.presentation.outputs.declared import Table, column, part

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
