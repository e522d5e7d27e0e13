"""What a run says on stderr and in its log: notes, warnings, errors, progress. Standard output carries data only.

Progress is one line at the foot of a terminal, and with --verbose the stages and files of a run. The log holds JSON
lines: what a run said, with what it is about, how it ended and what it wrote. Lines are appended, each by one call of
the system, so that several runs may share a file: a line is never torn by another (POSIX: with O_APPEND nothing comes
between finding the end of a file and writing there). `run` identifies the run of a line. The first line of a run has
`event` "begin", the last "end"; one without its end was killed or is at work.
"""

from __future__ import annotations

import os
import sys
import time
from collections.abc import Callable, Iterable, Iterator, Mapping
from time import monotonic, process_time
from typing import TYPE_CHECKING, Any, TextIO, TypeVar

from enginediag_cli import __version__
from enginediag_cli.errors import DataError, ExitCode

if TYPE_CHECKING:
    from enginediag_cli.errors import ConfigError
    from enginediag_cli.progress import Listener, Stage

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
    """Notes, warnings and errors of a run, written to stderr and to its log.

    Parameters
    ----------
    quiet : bool
        Write errors alone; the log receives all messages with their fields, such as file, flight and counts.
    verbose : bool
        Also write stages, files and times.
    debug : bool
        Show the traceback of an error.
    color : {"auto", "always", "never"}
        Whether prefixes are coloured.
    """

    def __init__(self, quiet: bool = False, verbose: bool = False, debug: bool = False, color: str = "auto"):
        self.quiet, self.verbose, self.debug, self.color = quiet, verbose, debug, color
        self.log: RunLog | None = None
        self.begun = False

    def note(self, text: str, **fields: Any) -> None:
        """A fact about the run, such as how many records were kept."""
        self.record("note", text, **fields)
        if not self.quiet:
            self._write(text)

    def warning(self, text: str, **fields: Any) -> None:
        """Something that the user should look at, although the run goes on."""
        self.record("warning", text, **fields)
        if not self.quiet:
            self._write(text, "warning: ", "yellow")

    def error(self, text: str, **fields: Any) -> None:
        """Why the run ends."""
        self.record("error", text, **fields)
        self._write(text, "error: ", "red")

    def problems(self, error: ConfigError) -> None:
        """The problems of a configuration file, each with its place and its line of source; the first of very many."""
        from enginediag_cli.config.files import render_all

        for mark, text, hint in error.shown_problems:
            self.record("error", text, file=mark.file, line=mark.line or None, column=mark.column or None, hint=hint)
        self._write(render_all(error))

    def record(self, level: str, text: str, **fields: Any) -> None:
        """A line of the log alone, where there is one."""
        if self.log is not None:
            self.log.write(level, text, **fields)

    def finish(self, code: int) -> None:
        """The run is over: the last line of the log."""
        if self.log is not None:
            self.log.end(code)

    def progress(self, items: Iterable[Item], label: str, total: int | None = None) -> Iterator[Item]:
        """Pass `items` through and report their number to the listener (`enginediag_cli.progress`)."""
        from enginediag_cli.progress import each

        return each(items, label, total)

    def listener(self) -> VerboseListener | ProgressLine | None:
        """Who shows how far the work is: on a terminal one line, with `verbose` stages and files, too; else nobody."""
        shown = not self.quiet and sys.stderr is not None and sys.stderr.isatty()
        if not (shown or self.verbose):
            return None
        line = ProgressLine(sys.stderr) if shown else None
        return VerboseListener(self._write, line) if self.verbose else line

    def _write(self, text: str, prefix: str = "", color: str = "") -> None:
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


REFRESH_S = 0.1
"""A line that changes more often cannot be read, and costs time."""

EVIDENCE_S = 3.0
"""Time that a stage must have run before its remaining time is estimated."""

EVIDENCE_SHARE = 0.05
"""Share of the steps that must be done before the remaining time is estimated."""

EVIDENCE_STEPS = 2
"""Steps that must be done: one may be of any length."""

MINUTE_S, HOUR_S = 60.0, 3600.0
"""In seconds."""


class ProgressLine:
    """Shows the stage at work, and the outermost around it, on one line of `stream`, a terminal; wiped at the end. The
    time left is said only once there is evidence for it, and supposes that the steps to come take as long as those
    done."""

    def __init__(self, stream: TextIO, clock: Callable[[], float] = monotonic):
        self._stream, self._clock = stream, clock
        self._open: list[tuple[Stage, float]] = []
        self._shown = 0
        self._last = float("-inf")

    def on_start(self, stage: Stage) -> None:
        self._open.append((stage, self._clock()))
        self._show(stage)

    def on_step(self, stage: Stage) -> None:
        self._show(stage)

    def on_end(self, stage: Stage) -> None:
        self._open = [entry for entry in self._open if entry[0] is not stage]
        self.wipe()

    def on_file(self, action: str, path: str) -> None:
        """Files are for --verbose."""

    def wipe(self) -> None:
        if self._shown:
            self._write("\r" + " " * self._shown + "\r")
            self._shown = 0

    def total(self, since: float) -> None:
        """All time is for --verbose."""
        self.wipe()

    def _show(self, stage: Stage) -> None:
        from enginediag_cli.report.output import terminal_width
        from enginediag_cli.safe_text import visible

        now = self._clock()
        if now - self._last < REFRESH_S:
            return
        self._last = now
        around = [entry for entry in self._open if entry[0] is not stage][:1]
        mine = [entry for entry in self._open if entry[0] is stage]
        text = "; ".join(stage_words(one, now - begun) for one, begun in (*around, *mine))
        text = visible(text, breaks=True)[: terminal_width() - 1]
        self._write("\r" + text.ljust(self._shown))
        self._shown = len(text)

    def _write(self, text: str) -> None:
        try:
            self._stream.write(text)
            self._stream.flush()
        except (OSError, ValueError):  # the terminal is gone; the work is not
            self._shown = 0


class Relay:
    """Hears of progress and files, and passes everything on to whoever shows it."""

    def __init__(self, shown: Listener | None = None):
        self._shown = shown

    def on_start(self, stage: Stage) -> None:
        if self._shown:
            self._shown.on_start(stage)

    def on_step(self, stage: Stage) -> None:
        if self._shown:
            self._shown.on_step(stage)

    def on_end(self, stage: Stage) -> None:
        if self._shown:
            self._shown.on_end(stage)

    def on_file(self, action: str, path: str) -> None:
        if self._shown:
            self._shown.on_file(action, path)

    def wipe(self) -> None:
        if self._shown:
            self._shown.wipe()


class VerboseListener(Relay):
    """For --verbose: each stage with its time when it ends, each file when it is read or written, at last all time.
    Passes on to `line`, when there is one."""

    def __init__(self, say: Callable[[str], None], line: ProgressLine | None = None):
        super().__init__(line)
        self._say = say
        self._start: dict[int, float] = {}

    def on_start(self, stage: Stage) -> None:
        self._start[id(stage)] = monotonic()
        super().on_start(stage)

    def on_end(self, stage: Stage) -> None:
        super().on_end(stage)
        seconds = monotonic() - self._start.pop(id(stage), monotonic())
        steps = f", {stage.done} done" if stage.done else ""
        self._say(f"{stage.what}: {seconds:.2f} s{steps}")

    def on_file(self, action: str, path: str) -> None:
        self._say(f"{action} {path}")

    def total(self, since: float) -> None:
        """The time of the run, begun at `since` of `monotonic`."""
        self._say(f"in all {monotonic() - since:.2f} s, {process_time():.2f} s of this processor")


def stage_words(stage: Stage, elapsed: float) -> str:
    """A stage in words: "refits  12 of 40, about 30 s left"; of unknown length, "records  3000, 810 a second"."""
    if not stage.done:
        return f"{stage.what} …"
    if stage.total is None:
        rate = f", {stage.done / elapsed:.0f} a second" if elapsed >= EVIDENCE_S else ""
        return f"{stage.what}  {stage.done}{rate}"
    known = elapsed >= EVIDENCE_S and stage.done >= max(EVIDENCE_STEPS, EVIDENCE_SHARE * stage.total)
    left = f", about {_duration(elapsed / stage.done * (stage.total - stage.done))} left" if known else ""
    return f"{stage.what}  {stage.done} of {stage.total}{left}"


def _duration(seconds: float) -> str:
    if seconds < 1.5 * MINUTE_S:
        return f"{seconds:.0f} s"
    return f"{seconds / MINUTE_S:.0f} min" if seconds < 1.5 * HOUR_S else f"{seconds / HOUR_S:.1f} h"


OPENING = b'{"time": "'
"""How every line begins; a file that begins otherwise is no log, and nothing is added to it."""

LEVELS = {ExitCode.DONE: "note", ExitCode.FINDING: "note", ExitCode.NO_VERDICT: "warning", ExitCode.LOCKED: "warning"}
"""Of the last line, by exit code; any other is an error."""

ENDINGS = {
    ExitCode.DONE: "done",
    ExitCode.FINDING: "done, with a finding",
    ExitCode.TROUBLE: "bad usage, configuration or data",
    ExitCode.NO_VERDICT: "no verdict",
    ExitCode.INTERNAL: "internal error",
    ExitCode.LOCKED: "another run holds the lock",
    ExitCode.INTERRUPTED: "interrupted",
    ExitCode.BROKEN_PIPE: "the reader closed the output",
}
"""What the last line says; 128 and more is the number of a signal."""

MILLION = 1_000_000
"""Nanoseconds of a millisecond."""


class RunLog:
    """The lines of one run. Raises DataError when the file cannot be opened or is no log."""

    def __init__(self, path: str, command: str):
        self.path, self.heard = path, False
        self._fixed = {"version": __version__, "command": command, "run": os.urandom(6).hex()}
        self._since = time.monotonic()
        self._outputs: dict[str, dict[str, Any]] = {}
        self._handle: int | None = _open_log(path)

    def begin(self, arguments: list[str]) -> None:
        """The first line: the command line, where it was given, and by which process."""
        self.write("note", "begins", event="begin", arguments=arguments, folder=os.getcwd(), process=os.getpid())

    def write(self, level: str, message: str, **fields: Any) -> None:
        """One line; `level` is note, warning or error. A log that has no room any more does not end the run."""
        if self._handle is None:
            return
        from enginediag_cli.report.output import finite, json_text, plain

        line = {"time": _now(), **self._fixed, "level": level, "message": message, **fields}
        text = json_text(finite(plain(line))) + "\n"
        try:
            # a name that is no UTF-8 has lone surrogates, whose escape is JSON, too
            os.write(self._handle, text.encode("utf-8", "backslashreplace"))
        except OSError as error:
            self._close()
            Messages().warning(f"{self.path}: the log ends here: {error.strerror or error}")

    def add_output(self, path: str) -> None:
        """A file now stands complete under its name."""
        from enginediag_cli.recordings.source import file_sha256

        name = os.path.abspath(path)
        try:
            self._outputs[name] = {"file": name, "sha256": file_sha256(name), "bytes": os.path.getsize(name)}
        except OSError as error:  # taken away as soon as it was there
            self._outputs[name] = {"file": name, "sha256": None, "bytes": None, "lost": error.strerror}

    def end(self, code: int) -> None:
        """The last line: exit code, seconds, and every file written with its SHA-256."""
        ending = ENDINGS.get(ExitCode(code)) if code in ENDINGS else None
        self.write(
            LEVELS.get(ExitCode(code), "error") if code in LEVELS else "error",
            ending or (f"ended by signal {code - 128}" if code > 128 else f"ended with {code}"),
            event="end",
            exit_code=int(code),
            seconds=round(time.monotonic() - self._since, 3),
            outputs=list(self._outputs.values()),
        )
        self._close()

    def _close(self) -> None:
        handle, self._handle = self._handle, None
        if handle is not None:
            os.close(handle)


class LogListener(Relay):
    """Hears of files for a log."""

    def __init__(self, log: RunLog, shown: Listener | None = None):
        super().__init__(shown)
        self._log = log

    def on_file(self, action: str, path: str) -> None:
        if action == "written:":
            self._log.add_output(path)
        super().on_file(action, path)


def _open_log(path: str) -> int:
    try:
        # a pipe without a reader is refused and not waited for
        handle = os.open(path, os.O_RDWR | os.O_APPEND | os.O_CREAT | os.O_CLOEXEC | os.O_NONBLOCK, 0o666)
    except OSError as error:
        raise DataError(f"--log {path}: cannot be written to: {error.strerror}") from None
    head = b"" if not os.path.isfile(path) else os.pread(handle, len(OPENING), 0)
    if head and head != OPENING:
        os.close(handle)
        raise DataError(f"--log {path}: exists and is not an enginediag log; nothing is added to it: name another file")
    return handle


def _now() -> str:
    """UTC, ISO 8601, to the millisecond."""
    since = time.time_ns()
    return time.strftime("%Y-%m-%dT%H:%M:%S", time.gmtime(since // (1000 * MILLION))) + (
        f".{since // MILLION % 1000:03d}Z"
    )
