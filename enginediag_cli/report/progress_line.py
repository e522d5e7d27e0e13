"""Progress for people: one line at the foot of a terminal, and with --verbose the stages and files of a run."""

from __future__ import annotations

from collections.abc import Callable
from time import monotonic, process_time
from typing import TextIO

from enginediag_cli.progress import Stage
from enginediag_cli.safe_text import visible

REFRESH_S = 0.1
"""A line that changes more often cannot be read, and costs time."""

EVIDENCE_S = 3.0
"""Time that a stage must have run before what is left of it is estimated."""

EVIDENCE_SHARE = 0.05
"""Share of the steps that must be done before what is left is estimated."""

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

    def begun(self, stage: Stage) -> None:
        self._open.append((stage, self._clock()))
        self._show(stage)

    def stepped(self, stage: Stage) -> None:
        self._show(stage)

    def ended(self, stage: Stage) -> None:
        self._open = [entry for entry in self._open if entry[0] is not stage]
        self.wipe()

    def touched(self, action: str, path: str) -> None:
        """Files are for --verbose."""

    def wipe(self) -> None:
        if self._shown:
            self._write("\r" + " " * self._shown + "\r")
            self._shown = 0

    def total(self, since: float) -> None:
        """All time is for --verbose."""
        self.wipe()

    def _show(self, stage: Stage) -> None:
        now = self._clock()
        if now - self._last < REFRESH_S:
            return
        self._last = now
        around = [entry for entry in self._open if entry[0] is not stage][:1]
        mine = [entry for entry in self._open if entry[0] is stage]
        text = "; ".join(told(one, now - begun) for one, begun in (*around, *mine))
        text = visible(text, breaks=True)[: _width() - 1]
        self._write("\r" + text.ljust(self._shown))
        self._shown = len(text)

    def _write(self, text: str) -> None:
        try:
            self._stream.write(text)
            self._stream.flush()
        except (OSError, ValueError):  # the terminal is gone; the work is not
            self._shown = 0


class Told:
    """For --verbose: each stage with its time when it ends, each file when it is read or written, at last all time.
    Passes on to `line`, when there is one."""

    def __init__(self, say: Callable[[str], None], line: ProgressLine | None = None):
        self._say, self._line = say, line
        self._begun: dict[int, float] = {}

    def begun(self, stage: Stage) -> None:
        self._begun[id(stage)] = monotonic()
        if self._line:
            self._line.begun(stage)

    def stepped(self, stage: Stage) -> None:
        if self._line:
            self._line.stepped(stage)

    def ended(self, stage: Stage) -> None:
        if self._line:
            self._line.ended(stage)
        seconds = monotonic() - self._begun.pop(id(stage), monotonic())
        steps = f", {stage.done} done" if stage.done else ""
        self._say(f"{stage.what}: {seconds:.2f} s{steps}")

    def touched(self, action: str, path: str) -> None:
        self._say(f"{action} {path}")

    def wipe(self) -> None:
        if self._line:
            self._line.wipe()

    def total(self, since: float) -> None:
        """The time of the run, begun at `since` of `monotonic`."""
        self._say(f"in all {monotonic() - since:.2f} s, {process_time():.2f} s of this processor")


def told(stage: Stage, elapsed: float) -> str:
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


def _width() -> int:
    from enginediag_cli.report.tables import terminal_width

    return terminal_width()
