"""A foreign recording mapped while it is being written: of every new piece, what has become final.

The gate, averages and heat soak look back in time, so the last records are kept and mapped again together with the
new ones. Nothing is handed over twice, and nothing before it is final: an average when its window has ended, a record
whose neighbours count when the next one is there. With `search`, for a file that is complete, masks are those of the
whole file and records wait for what they are compared with; without, for one that is still being written, only what
needs no look ahead is masked.

Lines of a file that is still being written, as they come.
"""

from __future__ import annotations

import os
import stat
import time
from collections import Counter
from collections.abc import Callable, Collection, Iterator
from dataclasses import dataclass, field
from typing import TextIO

import numpy as np

from enginediag_cli.errors import DataError, NoVerdictError
from enginediag_cli.recordings.conversion import Conversion
from enginediag_cli.recordings.formats.table_file import ReadingCounts
from enginediag_cli.recordings.masking import LiveMasker, MaskCounts, Masker
from enginediag_cli.recordings.recorder import Recorder
from enginediag_cli.recordings.source import LONGEST_LINE, Source
from enginediag_cli.recordings.steady import GateReport, average, failures, first_reasons
from enginediag_cli.recordings.table import Recording, concat

SOAK_MEMORY = 12.0
"""Time constants after which a low-pass has forgotten where it began: e⁻¹² is 6e-6."""


@dataclass
class LiveRecorder:
    """`recorder` for one `engine` of the file ("" where it has only one); `add` takes the records as they come.

    records, kept: records read and handed over (averages, where the recorder averages, out of so many `windows`);
    reasons: why the others went; masked: readings that were not used, by column.
    """

    recorder: Recorder
    engine: str = ""
    search: bool = False
    inputs: Collection[str] = ()
    records: int = 0
    kept: int = 0
    windows: int = 0
    reasons: Counter[str] = field(default_factory=Counter)
    _held: Recording | None = None
    _done: int = 0

    def __post_init__(self) -> None:
        judged = self.recorder.judged(self.inputs)
        self._masker = Masker(judged) if self.search else LiveMasker(judged)
        self._conversion = Conversion(self.recorder, self.engine)

    @property
    def counts(self) -> MaskCounts:
        """What was masked, as data."""
        return self._masker.counts

    @property
    def masked(self) -> Counter[str]:
        """Readings that were not used, by column."""
        return Counter({column: sum(reasons.values()) for column, reasons in self.counts.columns.items()})

    @property
    def gate(self) -> GateReport:
        """What the gate, or the averaging, kept."""
        if self.recorder.average_s > 0.0:
            return GateReport(self.kept, self.windows, dict(self.reasons), f"windows of {self.recorder.average_s:g} s")
        return GateReport(self.kept, self.records, dict(self.reasons))

    def add(self, raw: Recording, *, end: bool = False) -> Recording:
        """What has become final by these records of the file; `end`: no more will come. Raises DataError."""
        self.records += len(raw)
        pieces = self._masker.add(self._conversion.add(raw, end=end))
        if end:
            pieces += self._masker.end()
        found = [self._map(piece) for piece in pieces]
        if end or not found:
            # what waited for the next record, or an empty recording with the right columns
            rest = pieces[-1] if pieces else self._conversion.add(raw.select(slice(0, 0)))
            found.append(self._map(rest.select(slice(0, 0)), end=end))
        return concat(found)

    def _map(self, clean: Recording, *, end: bool = False) -> Recording:
        """What of masked records and of those held has become final."""
        every = concat([self._held, clean]) if self._held is not None else clean
        full = self.recorder.derive(every)
        if len(clean):
            self.recorder.check(full)
        final = np.ones(len(full), bool) if end else self._final(full)
        new = final & (full.line > self._done)
        settled = self._settled(full, new)
        self.kept += len(settled)
        self._done = int(full.line[new][-1]) if new.any() else self._done
        self._held = every.select(np.arange(len(full)) >= self._first_needed(full))
        return settled

    def report_lines(self, name: str) -> list[str]:
        """What was masked and left out, for stderr."""
        start = name + (f", engine {self.engine}" if self.engine else "")
        lines = [f"{start}: {line}" for line in self.counts.report_lines()]
        if self.recorder.steady or self.recorder.average_s > 0.0:
            lines.append(f"{start}: {self.gate.report_line()}")
        return lines

    def _final(self, full: Recording) -> np.ndarray:
        """Records (N,) about which later ones will not change anything."""
        rows = np.arange(len(full))
        steady, length = self.recorder.steady, self.recorder.average_s
        if length > 0.0 and len(full):
            number = np.floor(full["time_s"] / length)
            ended = np.flatnonzero(number != number[-1])
            return np.asarray(rows <= (ended[-1] if ended.size else -1))
        return np.asarray(rows < len(full) - 1) if steady and steady.neighbours else np.ones(len(full), bool)

    def _settled(self, full: Recording, new: np.ndarray) -> Recording:
        steady, length = self.recorder.steady, self.recorder.average_s
        failed = failures(full, steady) if steady else {}
        if length > 0.0:
            averages, report = average(full, length, failed, new)
            self.reasons.update(report.reasons)
            self.windows += report.total
            return averages.recording
        keep, reasons = first_reasons(failed, new)
        self.reasons.update(reasons)
        return full.select(keep)

    def _first_needed(self, full: Recording) -> int:
        """The first record that later ones look back to."""
        waiting = np.flatnonzero(full.line > self._done)
        first = int(waiting[0]) if waiting.size else len(full)
        reach = self._reach()
        if reach == 0.0 or "time_s" not in full or not len(full):
            return max(first - 1, 0)
        steps = np.diff(full["time_s"], prepend=full["time_s"][0])
        elapsed = np.cumsum(np.where(steps > 0, steps, 0.0))
        return int(np.searchsorted(elapsed, elapsed[min(first, len(full) - 1)] - reach))

    def _reach(self) -> float:
        """Seconds that gate, averages and heat soak look back."""
        steady, values = self.recorder.steady, self.recorder.values
        soak = [SOAK_MEMORY * s["time_constant_s"] for s in values["derived"] if s["rule"] == "soak"]
        gate = [2 * steady.window_s, 2 * steady.dwell_s] if steady else []
        return float(max([0.0, 2 * self.recorder.average_s, *gate, *soak]))


class RecorderStream:
    """A foreign file mapped in bounded memory; iterate once for (engine, records), every piece with some records.

    engines: engine → its LiveRecorder, whose counts and report lines are complete at the end, as are `counts`, what of
    the file was no record or no reading. Rows are those of
    `Recorder.read`, but that heat soak has forgotten its beginning after 12 time constants, where `read` has not.
    `watch`: sees the records as they stand in the file, before they are mapped.
    """

    watch: Callable[[Recording], None] | None = None

    def __init__(
        self,
        recorder: Recorder,
        source: Source,
        chunk_records: int,
        inputs: Collection[str] = (),
        engines: Collection[str] | None = None,
    ):
        chosen = [name for name in recorder.engines if engines is None or name in engines]
        self._recorder, self._source, self._chunk, self.counts = recorder, source, chunk_records, ReadingCounts()
        self.engines = {name: LiveRecorder(recorder, name, search=True, inputs=inputs) for name in chosen}

    def __iter__(self) -> Iterator[tuple[str, Recording]]:
        """Raises DataError as `Recorder.read` does, and NoVerdictError at the end of an engine without any record."""
        last: Recording | None = None
        for chunk in self._recorder.chunks(self._source, self._chunk, counts=self.counts):
            if last is not None:
                yield from self._add(last, end=False)
            last = chunk
        assert last is not None  # a file without records yields one empty recording
        yield from self._add(last, end=True)
        for live in self.engines.values():
            if not live.kept and (self._recorder.steady or self._recorder.average_s > 0.0):
                raise NoVerdictError(f"no steady record is left: {live.report_lines(str(self._source))[-1]}")

    def _add(self, chunk: Recording, end: bool) -> Iterator[tuple[str, Recording]]:
        if self.watch is not None:
            self.watch(chunk)
        for name, live in self.engines.items():
            found = live.add(chunk, end=end)
            if len(found):
                yield name, found


POLL_S = 0.2
"""Between looks at a file that grows: a row appears at once to an eye, and waiting costs nothing."""
UNREADABLE = "\ufffd"
"""What Python puts in place of bytes that are no text."""


class GrowingFile:
    """Complete lines of a text file; waits at its end for more, and ends when none has come for `idle_s` seconds.

    A last line without an end of line is handed over only when the wait is over. `idle_s` inf waits for ever. The name
    is followed: where another file has taken it, or the file was cut to begin anew, lines go on with that one, whose
    head (`#` lines and the header that was there before) is not handed over again. Bytes that are no text, and a line
    behind the header that is too long for a table, are handed over as U+FFFD: no number, so that a reader passes over
    such a line and counts it, and whoever waits for the next flight is not sent away.
    """

    def __init__(self, path: str, idle_s: float, wait: Callable[[float], None] = time.sleep, codec: str = "utf-8-sig"):
        self.name, self._codec = path, codec
        self._idle_s, self._wait = idle_s, wait
        self._lines = self._read()

    def __iter__(self) -> Iterator[str]:
        return self

    def __next__(self) -> str:
        """The next line. Raises DataError when the file cannot be opened."""
        return next(self._lines)

    def _read(self) -> Iterator[str]:
        header = ""
        again = False
        while True:
            in_head = True
            for line in self._of_one():
                if in_head and not line.startswith("#"):
                    in_head = False
                    if not header and UNREADABLE in line:
                        hint = "a recorder can state another, as in `file: {encoding: latin-1}`"
                        codec = self._codec.removesuffix("-sig").upper()
                        what = f"no {codec} text ({hint}), or longer than {LONGEST_LINE} characters"
                        raise DataError(f"{self.name}: the header is {what}")
                    header, repeated = header or line, again and line == header
                    if repeated:
                        continue
                if not (in_head and again):
                    yield line
            if not self._replaced:
                return
            again = True

    def _of_one(self) -> Iterator[str]:
        """Lines until none has come for long enough, or there is another file to go on with."""
        self._replaced = False
        try:
            stream = open(self.name, encoding=self._codec, errors="replace", newline="")
        except OSError as error:
            raise DataError(f"{self.name}: {error.strerror or error}") from error
        with stream:
            held, idle = "", 0.0
            while True:
                line = stream.readline(LONGEST_LINE + 1)
                if line:
                    held, idle = held + line, 0.0
                    if len(held) > LONGEST_LINE:  # what came of it is dropped, its end awaited
                        held = UNREADABLE + "\n" * held.endswith("\n")
                    if held.endswith("\n"):
                        yield held
                        held = ""
                    continue
                if self._renewed(stream):
                    self._replaced = True
                    break
                if idle >= self._idle_s:
                    break
                self._wait(POLL_S)
                idle += POLL_S
            if held:
                yield held

    def _renewed(self, stream: TextIO) -> bool:
        """Whether the name stands for another file, or the file is shorter than what was read of it."""
        mine = os.fstat(stream.fileno())
        try:
            there = os.stat(self.name)
        except OSError:  # between two files, or the last one was removed
            return False
        if not stat.S_ISREG(mine.st_mode):
            return False
        return not os.path.samestat(mine, there) or mine.st_size < stream.buffer.tell()
