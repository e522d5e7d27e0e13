"""Steps of a demonstration: its folder, and command lines that are shown and run."""

from __future__ import annotations

import os
import sys
from collections.abc import Iterable, Iterator
from contextlib import contextmanager

import click

from enginediag_cli.errors import ExitCode, NoVerdictError
from enginediag_cli.report.messages import Messages


@contextmanager
def working_in(folder: str) -> Iterator[None]:
    """Run in another folder, so that the command lines shown are those that run."""
    before = os.getcwd()
    os.chdir(folder)
    try:
        yield
    finally:
        os.chdir(before)


def copy_shipped(names: Iterable[str]) -> None:
    """Copy shipped files into the working folder, under the names that the command lines give."""
    from shutil import copyfile

    from enginediag_cli.shipped import shipped

    for name in names:
        os.makedirs(os.path.dirname(name) or ".", exist_ok=True)
        copyfile(shipped(name), name)


def run(messages: Messages, arguments: list[str], *, quiet: bool = True) -> None:
    """Show a command line and run it, with the messages as they are unless `quiet`; NoVerdictError when it ends
    without its result."""
    from copy import copy
    from shlex import join

    from enginediag_cli.cli.main import enginediag

    click.echo(f"   $ {join(['enginediag', *arguments])}")
    told = copy(messages)
    told.begun = True  # a step has no log and no file of options of its own
    told.quiet = messages.quiet or quiet
    with (
        _called_with(arguments),
        enginediag.make_context("enginediag", list(arguments), obj=told) as context,
    ):
        code = enginediag.invoke(context)
    # detect and isolate end so when they could judge no flight at all; their rows say why, and are told
    if code == ExitCode.NO_VERDICT and arguments[0] not in ("detect", "isolate"):
        raise NoVerdictError(f"without the result of {arguments[0]} the demonstration cannot go on")


@contextmanager
def _called_with(arguments: list[str]) -> Iterator[None]:
    """Results that record the command that made them record this one, not the demonstration."""
    before = sys.argv
    sys.argv = ["enginediag", *arguments]
    try:
        yield
    finally:
        sys.argv = before


def head(number: int, text: str) -> None:
    click.echo(f"{'' if number == 1 else chr(10)}{number}. {text}")


def tell(lines: Iterable[str]) -> None:
    for line in lines:
        click.echo(f"   {line}".rstrip())
