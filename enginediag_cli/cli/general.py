"""What every command does besides its own work, in one place: `LazyGroup` equips each command that it hands out.

`--verbose`, `--config`, `--log`, `--lock`, `--print-config` and, where YAML is read, `--allow-outside`; defaults from
the environment; no output that is also an input; progress on a terminal.
"""

from __future__ import annotations

import os
import sys
from collections.abc import Callable, Iterator, Sequence
from functools import wraps
from typing import TYPE_CHECKING, Any

import click

from enginediag_cli.cli.operation import FILE, FOR_EVERY_COMMAND, operated, operation_options, word_of
from enginediag_cli.cli.parameter_types import ConfigFile, OutputFile
from enginediag_cli.report.messages import Messages

if TYPE_CHECKING:
    from enginediag_cli.progress import Listener

PREFIX = "ENGINEDIAG"
"""Of the environment variables that hold defaults: ENGINEDIAG_DETECT_FALSE_ALARM."""

READS_YAML = ("nominal", "catalogue", "files")
"""Parameters that name YAML files, besides those of type `ConfigFile`."""


def equip(command: click.Command, name: str) -> click.Command:
    """Give a command its general options and its surroundings, once."""
    if any(parameter.name == "print_config" for parameter in command.params):
        return command
    if any(isinstance(p.type, ConfigFile) or p.name in READS_YAML for p in command.params):
        command.params.append(
            click.Option(
                ["--allow-outside"],
                is_flag=True,
                expose_value=False,
                callback=_allow_outside,
                help="Let a YAML file name files that lie neither in its own folder nor among those of the program.",
            )
        )
    command.params.append(
        click.Option(
            ["-v", "--verbose"],
            is_flag=True,
            expose_value=False,
            is_eager=True,
            callback=_verbose,
            help="Say on standard error what is read and written, and how long each stage took.",
        )
    )
    command.params += operation_options()
    command.params.append(
        click.Option(
            ["--print-config"],
            is_flag=True,
            expose_value=False,
            help="Print the value of every option and where it comes from, as a file for --config, and end.",
        )
    )
    for parameter in command.params:
        if isinstance(parameter, click.Option) and not parameter.envvar and parameter.name != "print_config":
            own = variable(name, parameter)
            parameter.envvar = [own, variable("", parameter)] if parameter.name in FOR_EVERY_COMMAND else own
    if command.callback is not None:
        command.callback = _surrounded(command.callback)
    return command


def variable(command: str, option: click.Option) -> str:
    """The environment variable that holds an option's default: ENGINEDIAG_<COMMAND>_<OPTION>; without a command, that
    of every command."""
    return "_".join(filter(None, (PREFIX, command, word_of(option)))).upper().replace("-", "_")


def asks_for_config(arguments: Sequence[str]) -> bool:
    """Whether `--print-config` is among a command's arguments."""
    before = arguments[: arguments.index("--")] if "--" in arguments else arguments
    return "--print-config" in before


def print_config(command: click.Command, name: str, arguments: Sequence[str], parent: click.Context) -> None:
    """Write every option of a command line with its value and its source, as a file of options that gives the same.
    What must be given and is not, is a comment; raises click.UsageError for a value that is wrong."""
    from enginediag_cli.cli.defaults_file import printed

    context = click.Context(command, info_name=name, parent=parent)
    given, _, _ = command.make_parser(context).parse_args(list(arguments))
    click.echo(printed(command, name, context, given), nl=False)


def _allow_outside(context: click.Context, parameter: click.Parameter, value: bool) -> None:
    from enginediag_cli.config.reading import READING

    before, READING.allow_outside = READING.allow_outside, bool(value)
    context.call_on_close(lambda: setattr(READING, "allow_outside", before))


def _verbose(context: click.Context, parameter: click.Parameter, value: bool) -> None:
    if value:
        context.ensure_object(Messages).verbose = True


def _surrounded(callback: Callable[..., Any]) -> Callable[..., Any]:
    """The command's function, once its inputs and outputs are known to differ, with its progress shown."""

    @wraps(callback)
    def run(*args: Any, **values: Any) -> Any:
        from time import monotonic

        from enginediag_cli.progress import listening

        context = click.get_current_context()
        messages = context.ensure_object(Messages)
        check_outputs(context)
        shown, since = messages.listener(), monotonic()
        listener: Listener | None = shown
        if messages.log is not None and not messages.log.heard:
            from enginediag_cli.report.run_log import Logged

            messages.log.heard = True
            listener = Logged(messages.log, shown)
        with operated(messages, context, values):
            if listener is None:
                return callback(*args, **values)
            try:
                with listening(listener):
                    return callback(*args, **values)
            finally:
                if shown is not None:
                    shown.total(since)

    return run


def check_outputs(context: click.Context) -> None:
    """Refuse an output that is an input of the same command, by whatever path, or that is named twice, and one whose
    ending promises what is not written. Raises click.BadParameter."""
    inputs = list(_inputs(context))
    written: list[tuple[str, str]] = []
    for parameter in context.command.params:
        value = context.params.get(parameter.name or "")
        if not isinstance(parameter.type, OutputFile) or not isinstance(value, str):
            continue
        word = max(parameter.opts, key=len)
        for what, path in inputs:
            if _same(value, path, parameter):
                raise click.BadParameter(f"{value} is also an input ({what}); it would be lost", context, parameter)
        for what, path in written:
            if value != "-" and os.path.realpath(value) == os.path.realpath(path):
                raise click.BadParameter(f"{value} is also the file of {what}", context, parameter)
        written.append((word, value))
        if context.params.get("output_format", "auto") == "auto" or parameter.name != "output_path":
            parameter.type.check_suffix(value, parameter, context)


def _inputs(context: click.Context) -> Iterator[tuple[str, str]]:
    """(how it was given, path) of each file that the command line names to be read; "-" is standard input."""
    if FILE in context.meta:
        yield "options", context.meta[FILE]
    for parameter in context.command.params:
        if not isinstance(parameter.type, click.Path) or isinstance(parameter.type, OutputFile):
            continue
        value = context.params.get(parameter.name or "")
        what = max(parameter.opts, key=len) if isinstance(parameter, click.Option) else parameter.human_readable_name
        for path in value if isinstance(value, (list, tuple)) else [value]:
            if not isinstance(path, str):
                continue
            yield what, path
            if os.path.isdir(path):  # a folder of fault files
                yield from ((what, entry.path) for entry in os.scandir(path) if entry.is_file())


def _same(output: str, file: str, parameter: click.Parameter) -> bool:
    """Whether an output is an input: the same regular file, as path, link, or redirected standard stream."""
    import stat

    try:
        out = os.fstat(sys.stdout.fileno()) if output == "-" else os.stat(output)
        read = os.fstat(sys.stdin.fileno()) if file == "-" else os.stat(file)
    except (OSError, ValueError, AttributeError):  # not there yet, closed, or no real stream
        return False
    return stat.S_ISREG(out.st_mode) and os.path.samestat(out, read)
