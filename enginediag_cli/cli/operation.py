"""What a command has for life in a ground station, beside its own work: a log, a lock, and options from a file.

Log and file must be known before the rest of a command line is understood, so that the log holds what was wrong with
it: `prepare` looks at the arguments ahead of click.
"""

from __future__ import annotations

import os
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any

import click

from enginediag_cli.cli.parameter_types import FiniteRange, OutputFile
from enginediag_cli.report.messages import Messages

if TYPE_CHECKING:
    from enginediag_cli.cli.defaults_file import Given

LOG, LOCK, LOCK_WAIT, CONFIG = "log_path", "lock_path", "lock_wait", "config_path"
"""Parameters that a command is given and its function is not."""

FOR_EVERY_COMMAND = (LOG, CONFIG)
"""Those with a variable without the command's name, too: ENGINEDIAG_LOG."""

APART = ("help", "print_config")
"""Options that are no settings."""

NOT_IN_FILES = (*APART, CONFIG)
"""Options that a file of options cannot give."""

DEFAULTS = "enginediag.yaml"
"""The file of options in the working folder."""

WHERE = "enginediag.defaults"
"""Key of a context's `meta`: marks of the options that a file gives, by parameter."""

FILE = "enginediag.defaults.file"
"""Key of a context's `meta`: the file that gives them."""

WITHOUT_EFFECT = {LOG, LOCK, LOCK_WAIT, CONFIG} | {
    *("quiet", "color", "debug", "verbose", "allow_outside", "exit_code", "idle"),
    *("output_format", "no_header", "wide", "columns", "show"),
    *("processes", "jobs", "resume"),
}
"""Options on which no result depends: where and how it is shown, and how the work is done."""


def operation_options() -> list[click.Option]:
    return [
        click.Option(
            ["--config", CONFIG],
            metavar="FILE",
            type=click.Path(dir_okay=False),
            help=f"YAML file of options, instead of {DEFAULTS} in the working folder; '' is none. Command line and "
            "environment go before it.",
        ),
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


def word_of(parameter: click.Parameter) -> str:
    """The long name of an option without its dashes."""
    return max(parameter.opts, key=len).lstrip("-")


def prepare(command: click.Command, name: str, arguments: Sequence[str], parent: click.Context) -> None:
    """Open the log of a run and read the file of options, once, before its command line is read. Raises DataError,
    ConfigError, click.BadParameter."""
    messages = parent.ensure_object(Messages)
    if parent.resilient_parsing or messages.begun:  # completion, or a step of a demonstration
        return
    messages.begun = True
    context = click.Context(command, info_name=name, parent=parent, resilient_parsing=True, ignore_unknown_options=True)
    typed, _, _ = command.make_parser(context).parse_args(list(arguments))
    asked = command.get_help_option(context)
    if asked is not None and typed.get(str(asked.name)):
        return
    only_shown = bool(typed.get("print_config"))
    line = [name, *arguments]
    if not only_shown:
        _open_log(messages, context, typed, line)
    given = _read_config(context, typed)
    if given is not None:
        from enginediag_cli.cli.defaults_file import check_effective

        parent.default_map = {name: given.values}
        context.default_map = given.values
        context.meta[WHERE] = given.marks
        check_effective(given, click.Context(command, info_name=name, parent=parent), typed)
        if messages.log is None and not only_shown:
            _open_log(messages, context, typed, line)


def _open_log(messages: Messages, context: click.Context, typed: Mapping[str, Any], line: list[str]) -> None:
    path = _ahead(context, LOG, typed)
    if path is not None:
        from enginediag_cli.report.run_log import RunLog

        messages.log = RunLog(path, line[0])
        messages.log.begin(line)


def _read_config(context: click.Context, typed: Mapping[str, Any]) -> Given | None:
    path = _ahead(context, CONFIG, typed)
    found = path is None
    if path == "" or (found and not os.path.lexists(DEFAULTS)):
        return None
    from enginediag_cli.cli.defaults_file import read_defaults

    context.meta[FILE] = DEFAULTS if found else path
    return read_defaults(context.meta[FILE], str(context.info_name), context.command, found=found)


def _ahead(context: click.Context, name: str, typed: Mapping[str, Any]) -> Any:
    """The value of one option, before click has come to it; None when it is not given."""
    parameter = next((p for p in context.command.params if p.name == name), None)
    if parameter is None:
        return None
    value, _ = parameter.consume_value(context, typed)
    return parameter.type_cast_value(context, value) if is_given(value) else None


def is_given(value: object) -> bool:
    """Whether there is a value; click has had two ways to say that there is none."""
    return value is not None and type(value).__name__ != "Sentinel"


@contextmanager
def operated(messages: Messages, context: click.Context, values: dict[str, Any]) -> Iterator[None]:
    """Take from a command's values what is not its own, and run it inside: under its lock, with what a file or the
    environment gives told in what it writes. Raises LockedError, DataError."""
    from enginediag_cli.api import provenance_notes

    for name in (LOG, CONFIG):
        values.pop(name, None)
    lock, wait = values.pop(LOCK, None), values.pop(LOCK_WAIT, 0.0)
    besides = chosen_besides(context)
    if WHERE in context.meta and besides:
        messages.note(f"options not of the command line: {', '.join(f'{k} {v}' for k, v in besides.items())}")
    with provenance_notes({f"option {word}": told for word, told in besides.items()}):
        if lock is None:
            yield
            return
        from enginediag_cli.file_lock import locked

        with locked(lock, str(context.info_name), wait):
            messages.record("note", f"holds {lock}", lock=os.path.abspath(lock))
            yield


def chosen_besides(context: click.Context) -> dict[str, str]:
    """Options on which the result depends and that a file or the environment gives: value and source, by name."""
    from click.core import ParameterSource

    sources = {ParameterSource.ENVIRONMENT: "environment", ParameterSource.DEFAULT_MAP: "file"}
    told = {}
    for parameter in context.command.params:
        name = str(parameter.name)
        source = sources.get(context.get_parameter_source(name) or ParameterSource.DEFAULT)
        if source is None or name in WITHOUT_EFFECT or isinstance(parameter.type, OutputFile):
            continue
        value = context.params.get(name)
        if is_default(context, parameter, value):
            continue
        if source == "file" and WHERE in context.meta:
            source = os.path.basename(context.meta[WHERE][name].file)
        each = value if isinstance(value, (list, tuple)) else [value]
        if isinstance(parameter.type, click.Path):
            each = [os.path.basename(str(item)) for item in each]
        words = (" ".join(map(str, item)) if isinstance(item, tuple) else str(item) for item in each)
        told[word_of(parameter)] = f"{' '.join(words)} ({source})"
    return told


def is_default(context: click.Context, parameter: click.Parameter, value: object) -> bool:
    """Whether a value is the one that is built in."""
    if not is_given(parameter.default):
        a_choice = value is False and bool(parameter.secondary_opts)
        return not a_choice and value in (None, False, ())
    return bool(parameter.type_cast_value(context, parameter.default) == value)


def is_chosen(context: click.Context, name: str) -> bool:
    """Whether the user chose an option's value, wherever: in a file, the built-in value is no choice."""
    from click.core import ParameterSource

    source = context.get_parameter_source(name)
    if source is not ParameterSource.DEFAULT_MAP:
        return source is not None and source is not ParameterSource.DEFAULT
    parameter = next(p for p in context.command.params if p.name == name)
    return not is_default(context, parameter, context.params.get(name))
