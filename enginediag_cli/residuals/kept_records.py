"""Records held back while they are condensed, for what needs more of a window than its statistics."""

from __future__ import annotations

from collections import deque
from collections.abc import Iterable, Iterator

import numpy as np

from enginediag_cli.recordings.table import Recording, concat
from enginediag_cli.residuals.groups import group_rows
from enginediag_cli.residuals.monitor import Monitor
from enginediag_cli.residuals.windows import WindowStatistics, judged_inputs

MOST = 10_000
"""Records of a window beyond which they are not handed out: the full model holds 10 kB of each. With so many the
statistics at the window's own estimate tell changes apart."""
HELD = 10 * MOST
"""Records held at most: windows wait for each other until they hold some thousands."""


class KeptRecords:
    """Chunks of recordings as they pass; `short_windows`: chunks before a window asked for are let go, so that
    memory holds little more than a window. It never holds more than HELD records."""

    def __init__(self, monitor: Monitor, short_windows: bool):
        self._monitor, self._short = monitor, short_windows
        self._chunks: deque[Recording] = deque()

    def passing(self, chunks: Iterable[Recording]) -> Iterator[Recording]:
        """The chunks, each remembered before it is handed on."""
        for chunk in chunks:
            self._chunks.append(chunk)
            while sum(map(len, self._chunks)) > HELD:
                self._chunks.popleft()
            yield chunk

    def let_go(self, window: WindowStatistics) -> None:
        """Forget what neither this window nor a later one needs."""
        while self._chunks and self._passed(self._chunks[0], window):
            self._chunks.popleft()

    def of(self, window: WindowStatistics) -> tuple[dict[str, np.ndarray], np.ndarray] | None:
        """Inputs, column -> (N,), and readings (N, m) of the records of a window that can be judged; None when
        they are no longer held, are more than MOST, or there is none."""
        self.let_go(window)
        if window.records > MOST:
            return None
        parts = []
        for chunk in self._chunks:
            if chunk.source != window.source or not len(chunk):
                continue
            for key, rows in group_rows(chunk):
                if key == (window.source, window.flight, window.engine):
                    line = np.asarray(chunk.line)[rows]
                    inside = (line >= window.first_line) & (line <= window.last_line)
                    if inside.any():
                        parts.append(chunk.select(np.asarray(rows)[inside]))
        if sum(map(len, parts)) != window.records or not parts:
            return None
        taken = judged_inputs(self._monitor, concat(parts))
        judged = taken.judged
        return ({c: v[judged] for c, v in taken.inputs.items()}, taken.y[judged]) if judged.any() else None

    def _passed(self, chunk: Recording, window: WindowStatistics) -> bool:
        if not len(chunk):
            return True
        if chunk.source != window.source:
            # windows come file by file: what was read before this file's first chunk is done with
            return any(other.source == window.source for other in self._chunks)
        return self._short and int(chunk.line[-1]) < window.first_line
