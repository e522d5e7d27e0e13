"""Which form of a monitor is the cheapest for a recording: few records ask the engine, many pay for a fit."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field
from itertools import chain

from enginediag_cli.recordings.table import Recording
from enginediag_cli.residuals.lagging import with_lagging
from enginediag_cli.residuals.monitor import Monitor
from enginediag_cli.residuals.reduced import reduced

MANY = 2_000
"""Records, of all files so far, from which a fit saves about what it costs: 0.2 s of CPU against 0.05 to 0.1 ms per
record. Less than a chunk holds, so that no record waits for the next chunk."""


@dataclass
class Economy:
    """Forms of `monitor` that give the same statistics but for what `compact` neglects; `of` chooses one per file.
    Where no fit stands for what is uncertain, that is the monitor itself, for few records and for many.

    A file is judged by one form from its first record to its last: its rows do not depend on how it came in chunks.
    """

    monitor: Monitor
    _records: int = 0
    _few: Monitor | None = field(default=None, repr=False)
    _many: Monitor | None = field(default=None, repr=False)

    def of(self, recordings: Iterable[Recording]) -> tuple[Monitor, Iterator[Recording]]:
        """The form for the recordings of one file, and all of these recordings."""
        waiting, held = iter(recordings), []
        while self._records < MANY and (recording := next(waiting, None)) is not None:
            held.append(recording)
            self._records += len(recording)
        return self._form(), chain(held, waiting)

    def _form(self) -> Monitor:
        if self.monitor.smooth is False or (self.monitor.smooth and self._records < MANY):
            if self._few is None:
                self._few = with_lagging(reduced(self.monitor))
            return self._few
        if self._many is None:
            from enginediag_cli.residuals.compact import compact

            self._many = with_lagging(compact(self.monitor, None if self.monitor.lagging else self._few))
        return self._many
