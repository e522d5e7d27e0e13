"""A foreign recording mapped while it is being written: of every new piece, what has become final.

The gate, averages and heat soak look back in time, so the last records are kept and mapped again together with the
new ones. Nothing is handed over twice, and nothing before it is final: an average when its window has ended, a record
whose neighbours count when the next one is there. Stuck sensors and spikes, which only a longer stretch shows, are not
searched for.
"""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass, field

import numpy as np

from enginediag_cli.recordings.average import average
from enginediag_cli.recordings.recorder import MappedRecording, Recorder
from enginediag_cli.recordings.steady import failures, first_reasons
from enginediag_cli.recordings.table import Recording, concat

SOAK_MEMORY = 12.0
"""Time constants after which a low-pass has forgotten where it began: e⁻¹² is 6e-6."""


@dataclass
class LiveRecorder:
    """`recorder` for one `engine` of the file ("" where it has only one); `add` takes the records as they come.

    records, kept: records read and handed over (averages, where the recorder averages); reasons: why the others
    went, for recorders that do not average; masked: readings that were not used, by column.
    """

    recorder: Recorder
    engine: str = ""
    records: int = 0
    kept: int = 0
    reasons: Counter[str] = field(default_factory=Counter)
    masked: Counter[str] = field(default_factory=Counter)
    _held: Recording | None = None
    _done: int = 0

    def add(self, raw: Recording, *, end: bool = False) -> Recording:
        """What has become final by these records of the file; `end`: no more will come. Raises DataError."""
        every = concat([self._held, raw]) if self._held is not None else raw
        mapped = next(m for m in self.recorder.map(every, steady=False, search=False) if m.engine == self.engine)
        full = mapped.recording
        self.records += len(raw)
        final = np.ones(len(full), bool) if end else self._final(full)
        new = final & (full.line > self._done)
        settled = self._settled(mapped, new)
        self.kept += len(settled)
        for column, mask in mapped.masks.masks.items():
            self.masked[column] += int(np.sum(mask & new))
        self._done = int(full.line[new][-1]) if new.any() else self._done
        self._held = every.select(np.arange(len(full)) >= self._first_needed(full))
        return settled

    def report_lines(self, name: str) -> list[str]:
        """What was masked and left out, for stderr."""
        start = name + (f", engine {self.engine}" if self.engine else "")
        what = f"windows of {self.recorder.average_s:g} s out of" if self.recorder.average_s > 0.0 else "of"
        why = ", ".join(f"{reason} {n}" for reason, n in self.reasons.items() if n)
        lines = [f"{start}: {column}: {n} values missing or out of limits" for column, n in self.masked.items() if n]
        if self.recorder.steady or self.recorder.average_s > 0.0:
            kept = f"{start}: kept {self.kept} {what} {self.records} records"
            lines.append(kept + (f" (left out: {why})" if why else ""))
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

    def _settled(self, mapped: MappedRecording, new: np.ndarray) -> Recording:
        full, steady, length = mapped.recording, self.recorder.steady, self.recorder.average_s
        failed = failures(full, steady) if steady else {}
        if length > 0.0:
            averages = average(full, length, failed)[0].recording
            return averages.select(np.isin(averages.line, full.line[new]))
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
