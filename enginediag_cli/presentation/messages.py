"""What a run says on stderr: notes, warnings, errors and progress. Standard output carries data only."""

from __future__ import annotations

import os
import sys
from collections.abc import Iterable, Iterator, Mapping
from typing import TYPE_CHECKING, TextIO, TypeVar

if TYPE_CHECKING:
    from enginediag_cli.errors import ConfigError
    from enginediag_cli.presentation.progress_line import ProgressLine, Told

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


class Messages:
    """Writes to stderr; `quiet` leaves only errors. One per run, handed to every command."""

    def __init__(self, quiet: bool = False, verbose: bool = False, debug: bool = False, color: str = "auto"):
        self.quiet, self.verbose, self.debug, self.color = quiet, verbose, debug, color

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

    def problems(self, error: ConfigError) -> None:
        """The problems of a configuration file, each with its place and its line of source; the first of very many."""
        from enginediag_cli.config.excerpt import render_all

        self._say(render_all(error))

    def progress(self, items: Iterable[Item], label: str, total: int | None = None) -> Iterator[Item]:
        """Pass `items` through and tell whoever listens (`enginediag_cli.progress`) how many there were."""
        from enginediag_cli.progress import each

        return each(items, label, total)

    def listener(self) -> Told | ProgressLine | None:
        """Who shows how far the work is: on a terminal one line, with `verbose` stages and files, too; else nobody."""
        shown = not self.quiet and sys.stderr is not None and sys.stderr.isatty()
        if not (shown or self.verbose):
            return None
        from enginediag_cli.presentation.progress_line import ProgressLine, Told

        line = ProgressLine(sys.stderr) if shown else None
        return Told(self._say, line) if self.verbose else line

    def _say(self, text: str, prefix: str = "", color: str = "") -> None:
        """Write a line to stderr; control characters that came from a file are written as escapes. When nobody reads
        stderr any more, the line is dropped: the work goes on and its result counts."""
        if sys.stderr is None:
            return
        import click

        from enginediag_cli.progress import wipe
        from enginediag_cli.safe_text import visible

        if prefix and wants_color(self.color, sys.stderr):
            prefix = click.style(prefix, fg=color, bold=True)
        wipe()
        try:
            # click would strip colours from a pipe although the user said --color always
            click.echo(prefix + visible(text), err=True, color=True)
        except OSError:
            silence(sys.stderr)


def silence(stream: TextIO) -> None:
    """Send what is still written to a stream that nobody reads, or that has no room, to nowhere: Python's own flush at
    exit would fail again and end the run with 120."""
    try:
        nowhere = os.open(os.devnull, os.O_WRONLY)
        os.dup2(nowhere, stream.fileno())
        os.close(nowhere)
    except (OSError, ValueError, AttributeError):  # a stream of a test, or closed: nothing is left to flush
        return
