"""What a command has for life in a ground station, beside its own work: a log, and a lock.

Both must be known before the rest of a command line is understood, so that the log holds what was wrong with it:
`prepare` looks at the arguments ahead of click.
"""

from __future__ import annotations

import os
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from typing import Any

import click

from enginediag_cli.commands.parameter_types import FiniteRange, OutputFile
from enginediag_cli.presentation.messages import Messages

LOG, LOCK, LOCK_WAIT = "log_path", "lock_path", "lock_wait"
"""Parameters that a command is given and its function is not."""

FOR_EVERY_COMMAND = (LOG,)
"""Those with a variable without the command's name, too: ENGINEDIAG_LOG."""


def operation_options() -> list[click.Option]:
    return [
        click.Option(
            ["--log", LOG],
            metavar="FILE",
            type=AppendedFile(),
            help="Append to FILE, as JSON lines, all that is said on standard error (with -q, too), and at last exit "
            "code, seconds and the SHA-256 of each file written. Runs may share it.",
        ),
        click.Option(
            ["--lock", LOCK],
            metavar="FILE",
            type=AppendedFile(),
            help="Work only while no other run holds this lock; else end with 75.",
        ),
        click.Option(
            ["--lock-wait", LOCK_WAIT],
            metavar="SECONDS",
            type=FiniteRange(min=0),
            default=0.0,
            show_default=True,
            help="How long to wait for --lock.",
        ),
    ]


class AppendedFile(OutputFile):
    """A file that is not replaced: `-` is none."""

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> Any:
        if value == "-":
            self.fail("standard output is for data; name a file", param, ctx)
        return super().convert(value, param, ctx)


def prepare(command: click.Command, name: str, arguments: Sequence[str], parent: click.Context) -> None:
    """Open the log of a run, once, before its command line is read. Raises DataError, click.BadParameter."""
    messages = parent.ensure_object(Messages)
    if parent.resilient_parsing or messages.begun:  # completion, or a step of a demonstration
        return
    messages.begun = True
    context = click.Context(command, info_name=name, parent=parent, resilient_parsing=True, ignore_unknown_options=True)
    given, _, _ = command.make_parser(context).parse_args(list(arguments))
    asked = command.get_help_option(context)
    if given.get("print_config") or (asked is not None and given.get(str(asked.name))):
        return
    path = _ahead(context, LOG, given)
    if path is None:
        return
    from enginediag_cli.presentation.run_log import RunLog

    messages.log = RunLog(path, name)
    messages.log.begin([name, *arguments])


def _ahead(context: click.Context, name: str, given: Mapping[str, Any]) -> Any:
    """The value of one option, before click has come to it; None when it is not given."""
    parameter = next((p for p in context.command.params if p.name == name), None)
    if parameter is None:
        return None
    value, _ = parameter.consume_value(context, given)
    return parameter.type_cast_value(context, value) if is_given(value) else None


def is_given(value: object) -> bool:
    """Whether there is a value; click has had two ways to say that there is none."""
    return value is not None and type(value).__name__ != "Sentinel"


@contextmanager
def operated(messages: Messages, context: click.Context, values: dict[str, Any]) -> Iterator[None]:
    """Take from a command's values what is not its own, and run it inside: under its lock. Raises LockedError,
    DataError."""
    values.pop(LOG, None)
    lock, wait = values.pop(LOCK, None), values.pop(LOCK_WAIT, 0.0)
    if lock is None:
        yield
        return
    from enginediag_cli.file_lock import locked

    with locked(lock, str(context.info_name), wait):
        messages.record("note", f"holds {lock}", lock=os.path.abspath(lock))
        yield
