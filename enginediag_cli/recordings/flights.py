"""Which flight and engine each record of a file belongs to: records of different ones are different recordings."""

from __future__ import annotations

from dataclasses import dataclass, field
from itertools import groupby

import numpy as np

from enginediag_cli.recordings.table import Recording

KEYS = ("flight", "engine")
"""Columns that tell recordings of one file apart, where the file has them."""


@dataclass
class FlightNumbers:
    """Numbers the (flight, engine) pairs of a file in order of first appearance, over all its chunks."""

    known: dict[tuple[str, ...], int] = field(default_factory=dict)

    def of(self, recording: Recording) -> np.ndarray:
        """(N,) int64: the number of each record's flight and engine."""
        labels = []
        for column in KEYS:
            if column in recording.text:
                labels.append(list(recording.text[column]))
            elif column in recording.columns:
                labels.append([f"{value:g}" for value in recording.columns[column]])
        n = len(recording)
        if not n or all(cells.count(cells[0]) == n for cells in labels):
            key = tuple(cells[0] for cells in labels) if n else ()
            number = self.known.setdefault(key, len(self.known)) if n else 0
            return np.full(n, number, dtype=np.int64)
        known, numbers, lengths = self.known, [], []
        for key, same in groupby(zip(*labels, strict=True)):  # records of a flight mostly follow each other
            numbers.append(known.setdefault(key, len(known)))
            lengths.append(len(list(same)))
        return np.repeat(np.array(numbers, dtype=np.int64), lengths)
