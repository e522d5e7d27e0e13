"""Records of one flight and engine, kept apart from those of others and put in relation to time."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field
from itertools import groupby, pairwise

import numpy as np

from enginediag_cli.engine.instrument_errors import ELAPSED
from enginediag_cli.recordings.table import Recording
from enginediag_cli.residuals.distributions import median

KEYS = ("flight", "engine")
HOUR_S = 3600.0
"""Seconds of an hour."""
Key = tuple[str, str, str]


def group_rows(recording: Recording) -> list[tuple[Key, np.ndarray]]:
    """Row numbers (n,) of each (file, flight, engine) of a chunk, in order of first appearance.

    The key holds an empty text where the recording has no such column.
    """
    labels = []
    for column in KEYS:
        if column in recording.text:
            labels.append(list(recording.text[column]))
        elif column in recording.columns:
            labels.append([f"{value:g}" for value in recording.columns[column]])
        else:
            labels.append([""] * len(recording))
    rows: dict[Key, list[np.ndarray]] = {}
    first = 0
    for (flight, engine), same in groupby(zip(*labels, strict=True)):  # records of a flight mostly follow each other
        stop = first + len(list(same))
        rows.setdefault((recording.source, flight, engine), []).append(np.arange(first, stop))
        first = stop
    return [(key, np.concatenate(stretches)) for key, stretches in rows.items()]


@dataclass
class Timeline:
    """Position of the records of one group across chunks (count, or seconds since the first), and lags."""

    count: int = 0
    first_time: float = float("nan")
    last_time: float = float("nan")
    interval: float = float("nan")
    breaks: int = field(default=0)

    def advance(self, n: int, time: np.ndarray | None, in_time: bool) -> tuple[np.ndarray, np.ndarray]:
        """Positions (n,) for the window grid and lags (n,), steps since the record before.

        Without times every record is one step. A step of time is the median interval of the first chunk; time
        that runs backwards starts a new stretch, unrelated to the one before.
        """
        start = self.count
        self.count += n
        lags = np.ones(n)
        if time is None or not np.all(np.isfinite(time)):
            if start == 0 and n:
                lags[0] = np.inf
            return np.arange(start, self.count, dtype=float), lags
        if start == 0 and n:
            self.first_time = float(time[0])
        steps = np.diff(np.concatenate([[self.last_time], time]))
        if not np.isfinite(self.interval):
            forward = steps[np.isfinite(steps) & (steps > 0)]
            self.interval = median(forward) if forward.size else float("nan")
        if np.isfinite(self.interval):
            lags = np.maximum(np.round(steps / self.interval), 1.0)
        lags = np.where(np.isnan(steps) | (steps < 0), np.inf, lags)
        self.breaks += int(np.sum(steps < 0))
        self.last_time = float(time[-1])
        position = time - self.first_time if in_time else np.arange(start, self.count, dtype=float)
        return position, lags


@dataclass
class FlightHours:
    """Writes into recordings how many hours lie between each record and the first of its flight; 0 without times."""

    _first: dict[Key, float] = field(default_factory=dict)

    def written(self, recordings: Iterable[Recording]) -> Iterator[Recording]:
        """Chunks of files in turn with the column `ELAPSED`."""
        for chunk in recordings:
            hours = np.zeros(len(chunk))
            time = chunk.columns.get("time_s")
            if time is not None:
                for key, rows in group_rows(chunk):
                    known = rows[np.isfinite(time[rows])]
                    if known.size:
                        first = self._first.setdefault(key, float(time[known[0]]))
                        hours[known] = (time[known] - first) / HOUR_S
            yield chunk.with_columns({ELAPSED: hours})


def runs(labels: np.ndarray) -> list[tuple[int, int]]:
    """(start, stop) of stretches of equal neighbours in labels (n,)."""
    edges = [0, *(np.flatnonzero(np.diff(labels)) + 1).tolist(), len(labels)]
    return [(i, k) for i, k in pairwise(edges) if k > i]
