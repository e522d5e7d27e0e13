"""Options that several commands share, so that they are spelt and behave alike everywhere.

    @click.command(epilog=exit_codes(finding="a change was found and --exit-code given"))
    @source_options
    @nominal_options()
    @seed_option
    @exit_code_option
    @output_options
    @message_options
    @pass_messages
    def detect(messages, source, nominal, seed, exit_code, output): ...

A command returns its `ExitCode`, or nothing for `DONE`.
"""

from __future__ import annotations

import sys
from collections.abc import Callable
from functools import wraps
from typing import Any, TypeVar

import click

from enginediag_cli.cli.parameter_types import TABLE_SUFFIXES, ConfigFile, FiniteRange, OutputFile
from enginediag_cli.report.messages import Messages

__all__ = ["ConfigFile", "FiniteRange", "OutputFile"]

Function = TypeVar("Function", bound=Callable[..., Any])

pass_messages = click.make_pass_decorator(Messages, ensure=True)
"""Gives the command the run's `Messages` (stderr) as its first argument."""

FORMATS = ("auto", "csv", "json", "ndjson", "table")


def exit_codes(finding: str = "") -> str:
    """Epilog of a command's help that lists its exit codes; `finding` says what 1 means, if it can occur."""
    one = f"1 {finding}; " if finding else ""
    first = f"Exit codes: 0 done; {one}2 bad usage, configuration or data;"
    return f"\b\n{first}\n3 no verdict; 70 internal error; 75 --lock is held; 130 interrupted."


def message_options(function: Function) -> Function:
    """`-q`, `--color` and `--debug`: kept in the run's `Messages`, not passed to the command."""
    quiet = click.option(
        "-q",
        "--quiet",
        is_flag=True,
        expose_value=False,
        is_eager=True,
        callback=_set_message_option,
        help="Say nothing on standard error but errors.",
    )
    color = click.option(
        "--color",
        type=click.Choice(["auto", "always", "never"]),
        default=None,
        expose_value=False,
        is_eager=True,
        callback=_set_message_option,
        help="Colours; auto asks the terminal and NO_COLOR.",
    )
    debug = click.option(
        "--debug",
        is_flag=True,
        expose_value=False,
        is_eager=True,
        callback=_set_message_option,
        help="Show the traceback of an error.",
    )
    return quiet(color(debug(function)))


def _set_message_option(context: click.Context, parameter: click.Parameter, value: Any) -> None:
    if value and parameter.name:  # an option of the group stays set when its command leaves it out
        setattr(context.ensure_object(Messages), parameter.name, value)


def output_options(function: Callable[..., Any]) -> Callable[..., Any]:
    """`-o/--output`, `--format`, `--no-header`, `--wide`, `--columns`: given to the command as one `output: Output`."""

    @wraps(function)
    def with_output(
        *args: Any,
        output_path: str,
        output_format: str,
        no_header: bool,
        wide: bool,
        columns: tuple[str, ...],
        **others: Any,
    ) -> Any:
        from enginediag_cli.report.output import Output

        messages = click.get_current_context().ensure_object(Messages)
        output = Output(output_path, output_format, not no_header, messages.color, wide, columns, messages.note)
        return function(*args, output=output, **others)

    options = [
        output_file_option("Write to FILE, completely or not at all; - is standard output.", TABLE_SUFFIXES),
        click.option(
            "-f",
            "--format",
            "output_format",
            type=click.Choice(FORMATS),
            default="auto",
            help="auto: by the name of FILE (.csv, .json, .ndjson, .parquet), else table on a terminal, csv in a pipe; "
            "ndjson: one object a line.",
        ),
        click.option("--no-header", is_flag=True, help="Leave out the # provenance lines."),
        click.option(
            "--wide", is_flag=True, help="All columns on a terminal, too, below each other where they have no room."
        ),
        click.option(
            "--columns",
            metavar="A,B",
            callback=_column_names,
            help="Only these columns, in this order; in every format.",
        ),
    ]
    for option in reversed(options):
        with_output = option(with_output)
    return with_output


def output_file_option(help: str, suffixes: tuple[str, ...] = (), *, required: bool = False) -> Callable[..., Any]:
    """`-o/--output FILE` as `output_path: str`; standard output when not given, unless it is required."""
    absent: dict[str, Any] = {} if required else {"default": "-"}  # to click from 8.3 on, None is a value, too
    return click.option(
        "-o",
        "--output",
        "output_path",
        required=required,
        metavar="FILE",
        type=OutputFile(suffixes),
        help=help,
        **absent,
    )


def _column_names(context: click.Context, parameter: click.Parameter, value: str | None) -> tuple[str, ...]:
    names = tuple(dict.fromkeys(name.strip() for name in (value or "").split(",") if name.strip()))
    if value is not None and not names:
        raise click.BadParameter("name at least one column", context, parameter)
    return names


def recordings_argument(function: Function) -> Function:
    """`FILE...` as `recordings: tuple[str, ...]`; `-` or nothing with piped input means standard input."""
    return click.argument(
        "recordings",
        nargs=-1,
        metavar="[FILE]...",
        callback=_input_files,
        type=click.Path(allow_dash=True),  # what is not there, or no file, is named when it is read: others are judged
    )(function)


def _input_files(context: click.Context, parameter: click.Parameter, value: tuple[str, ...]) -> tuple[str, ...]:
    files = value or ("-",)
    if files.count("-") > 1:
        raise click.UsageError("standard input (-) can be read only once", context)
    if "-" in files and not context.resilient_parsing and _nothing_is_piped():
        raise click.UsageError("no input: name a FILE, or pipe data in", context)
    return files


def _nothing_is_piped() -> bool:
    return sys.stdin is None or sys.stdin.closed or sys.stdin.isatty()


def probability_option(name: str, default: float, help: str) -> Callable[[Function], Function]:
    """An option that is a probability, neither 0 nor 1."""
    inside = FiniteRange(0, 1, min_open=True, max_open=True)
    return click.option(name, metavar="P", type=inside, default=default, show_default=True, help=help)


def false_alarm_option(function: Function) -> Function:
    """`--false-alarm P`, the probability of an alarm in a window without change."""
    return probability_option("--false-alarm", 0.01, "Probability that a test cries wolf.")(function)


def seed_option(function: Function) -> Function:
    """`--seed N` as `seed: int`; the same seed gives the same bytes."""
    return click.option(
        "--seed",
        type=click.IntRange(min=0),
        default=0,
        show_default=True,
        metavar="N",
        help="Seed of everything random.",
    )(function)


def jobs_option(function: Callable[..., Any]) -> Callable[..., Any]:
    """`--jobs N`: the command runs with so many processes that share its work."""

    @wraps(function)
    def with_jobs(*args: Any, jobs: int, **others: Any) -> Any:
        from enginediag_cli.side_by_side import CAN_COPY, working

        if jobs > 1 and not CAN_COPY:
            click.get_current_context().ensure_object(Messages).note(
                "--jobs has no effect on this system, where a process cannot begin as a copy of another"
            )
        with working(jobs):
            return function(*args, **others)

    option = click.option(
        "--jobs",
        metavar="N",
        type=click.IntRange(min=1),
        default=1,
        show_default=True,
        help="Processes that share the work. The result does not depend on it.",
    )
    return option(with_jobs)


def exit_code_option(function: Function) -> Function:
    """`--exit-code` as `exit_code: bool`: end with 1 when there is a finding.

    Opt-in, because a 1 from the middle of a pipe would stop a script under `set -o pipefail`.
    """
    return click.option("--exit-code", is_flag=True, help="End with 1 if there is a finding.")(function)
