"""What a run says on stderr and in its log: notes, warnings, errors, progress. Standard output carries data only."""

from __future__ import annotations

import os
import sys
from collections.abc import Iterable, Iterator, Mapping
from typing import TYPE_CHECKING, Any, TextIO, TypeVar

if TYPE_CHECKING:
    from enginediag_cli.errors import ConfigError
    from enginediag_cli.report.run_log import ProgressLine, RunLog, Told

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
    """Writes to stderr; `quiet` leaves only errors. One per run, handed to every command.

    `log` is told all of it, quiet or not, with what a message is about: `fields` such as file, flight, counts.
    """

    def __init__(self, quiet: bool = False, verbose: bool = False, debug: bool = False, color: str = "auto"):
        self.quiet, self.verbose, self.debug, self.color = quiet, verbose, debug, color
        self.log: RunLog | None = None
        self.begun = False

    def note(self, text: str, **fields: Any) -> None:
        """A fact about the run, such as how many records were kept."""
        self.record("note", text, **fields)
        if not self.quiet:
            self._say(text)

    def warning(self, text: str, **fields: Any) -> None:
        """Something that the user should look at, although the run goes on."""
        self.record("warning", text, **fields)
        if not self.quiet:
            self._say(text, "warning: ", "yellow")

    def error(self, text: str, **fields: Any) -> None:
        """Why the run ends."""
        self.record("error", text, **fields)
        self._say(text, "error: ", "red")

    def problems(self, error: ConfigError) -> None:
        """The problems of a configuration file, each with its place and its line of source; the first of very many."""
        from enginediag_cli.config.hints import render_all

        for mark, text, hint in error.told:
            self.record("error", text, file=mark.file, line=mark.line or None, column=mark.column or None, hint=hint)
        self._say(render_all(error))

    def record(self, level: str, text: str, **fields: Any) -> None:
        """A line of the log alone, where there is one."""
        if self.log is not None:
            self.log.write(level, text, **fields)

    def ended(self, code: int) -> None:
        """The run is over: the last line of the log."""
        if self.log is not None:
            self.log.end(code)

    def progress(self, items: Iterable[Item], label: str, total: int | None = None) -> Iterator[Item]:
        """Pass `items` through and tell whoever listens (`enginediag_cli.progress`) how many there were."""
        from enginediag_cli.progress import each

        return each(items, label, total)

    def listener(self) -> Told | ProgressLine | None:
        """Who shows how far the work is: on a terminal one line, with `verbose` stages and files, too; else nobody."""
        shown = not self.quiet and sys.stderr is not None and sys.stderr.isatty()
        if not (shown or self.verbose):
            return None
        from enginediag_cli.report.run_log import ProgressLine, Told

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
