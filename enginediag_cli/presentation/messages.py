"""What a run says on stderr: notes, warnings, errors and progress. Standard output carries data only."""

from __future__ import annotations

import os
import sys
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from typing import TYPE_CHECKING, TextIO, TypeVar

if TYPE_CHECKING:
    from enginediag_cli.errors import Problem

Item = TypeVar("Item")


def wants_color(choice: str, stream: TextIO, environment: Mapping[str, str] = os.environ) -> bool:
    """Whether to colour `stream`: the option, then NO_COLOR, FORCE_COLOR, TERM=dumb, then the terminal.

    `choice` is "auto", "always" or "never". Source: no-color.org, and the order that pytest uses.
    """
    if choice != "auto":
        return choice == "always"
    if environment.get("NO_COLOR"):
        return False
    if environment.get("FORCE_COLOR"):
        return True
    return environment.get("TERM") != "dumb" and stream.isatty()


@dataclass
class Messages:
    """Writes to stderr; `quiet` leaves only errors. One per run, handed to every command."""

    quiet: bool = False
    debug: bool = False
    color: str = "auto"

    def note(self, text: str) -> None:
        """A fact about the run, such as how many records were kept."""
        if not self.quiet:
            self._say(text)

    def warning(self, text: str) -> None:
        """Something that the user should look at, although the run goes on."""
        if not self.quiet:
            self._say(text, "warning: ", "yellow")

    def error(self, text: str) -> None:
        """Why the run ends."""
        self._say(text, "error: ", "red")

    def problems(self, problems: Iterable[Problem]) -> None:
        """All problems of a configuration file, each with its place and its line of source."""
        from enginediag_cli.config.excerpt import render

        for problem in problems:
            self._say(render(problem))

    def progress(self, items: Iterable[Item], label: str, total: int | None = None) -> Iterator[Item]:
        """Pass `items` through and count them on stderr: only on a terminal, and only with a known total."""
        shown = not self.quiet and bool(total) and sys.stderr is not None and sys.stderr.isatty()
        with _counter(label, total or 0, shown) as count:
            for number, item in enumerate(items):
                count(number)
                yield item

    def _say(self, text: str, prefix: str = "", color: str = "") -> None:
        if sys.stderr is None:
            return
        import click

        if prefix and wants_color(self.color, sys.stderr):
            prefix = click.style(prefix, fg=color, bold=True)
        # click would strip colours from a pipe although the user said --color always
        click.echo(prefix + text, err=True, color=True)


@contextmanager
def _counter(label: str, total: int, shown: bool) -> Iterator[Callable[[int], None]]:
    """One line on stderr that is overwritten, and wiped at the end."""
    percent = -1

    def count(number: int) -> None:
        nonlocal percent
        if shown and (now := 100 * number // total) != percent:
            percent = now
            sys.stderr.write(f"\r{label} {percent:3d} %")
            sys.stderr.flush()

    try:
        yield count
    finally:
        if shown:
            sys.stderr.write("\r" + " " * (len(label) + 6) + "\r")
            sys.stderr.flush()
