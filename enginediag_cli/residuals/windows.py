"""Windows that follow each other or move, cut along a grid of blocks so that a window is a sum of blocks.

A window never reaches across two flights or engines: each has its own `WindowAssembler`. Records or pieces of
records come in order and in chunks of any size; memory holds one window.
"""

from __future__ import annotations

import re
from collections import deque
from dataclasses import dataclass
from math import gcd, inf
from typing import Generic, TypeVar

import numpy as np

Piece = TypeVar("Piece")

UNITS = {"": None, "s": 1.0, "min": 60.0, "h": 3600.0}
UNITS_TEXT = "a number of records (60) or a time (300s, 10min, 1h)"


@dataclass(frozen=True)
class WindowPlan:
    """Windows of `length`, one every `step`, in records or, if `in_time`, seconds; inf: the whole flight.

    whole_flights: only a recording without flights is cut so, each flight of another is one window."""

    length: float = inf
    step: float = inf
    in_time: bool = False
    whole_flights: bool = False

    def of_flight(self, flight: str) -> WindowPlan:
        """The plan for the records of one flight, "" where the recording tells none."""
        return WindowPlan() if self.whole_flights and flight else self

    @property
    def of_series(self) -> WindowPlan:
        """The plan for a series: where each flight is one window, each record of a recording without flights is."""
        return WindowPlan(1, 1, whole_flights=True) if self.whole else self

    @property
    def whole(self) -> bool:
        """Whether each flight is one window."""
        return self.length == inf

    @property
    def grid(self) -> float:
        """Length of a block: the largest that divides both length and step (1 ms is the finest time)."""
        if self.length == inf:
            return inf
        unit = 1000 if self.in_time else 1
        return gcd(round(self.length * unit), round(self.step * unit)) / unit

    def blocks(self, position: np.ndarray) -> np.ndarray:
        """Number of the block of each record at `position` (N,): its count, or seconds since the first."""
        if self.grid == inf:
            return np.zeros(len(position), int)
        return np.floor(position / self.grid + 1e-9).astype(int)


def plan_windows(length: str | None, step: str | None = None) -> WindowPlan:
    """Plan from texts such as "60" (records) or "10min"; step defaults to length (windows that follow).

    ValueError says what is wrong with the text.
    """
    if length is None:
        if step is not None:
            raise ValueError("a step needs a window length")
        return WindowPlan()
    size, in_time = _amount(length)
    pace, pace_in_time = (size, in_time) if step is None else _amount(step)
    if pace_in_time != in_time:
        raise ValueError("window and step must both be records or both be times")
    if pace > size:
        raise ValueError("a step longer than the window would skip records")
    return WindowPlan(size, pace, in_time)


def _amount(text: str) -> tuple[float, bool]:
    match = re.fullmatch(r"\s*(\d+(?:\.\d+)?)\s*(s|min|h|)\s*", text)
    if not match:
        raise ValueError(f"{text!r} is not {UNITS_TEXT}")
    factor = UNITS[match[2]]
    value = float(match[1]) * (factor or 1.0)
    if value < (0.001 if factor else 1) or (factor is None and value != int(value)):
        raise ValueError(f"{text!r} is not {UNITS_TEXT}")
    return value, factor is not None


class WindowAssembler(Generic[Piece]):
    """Collects pieces by block number; hands back each window, as the list of its pieces, once complete."""

    def __init__(self, plan: WindowPlan):
        whole = plan.grid == inf
        self._span = 1 if whole else round(plan.length / plan.grid)
        self._stride = 1 if whole else round(plan.step / plan.grid)
        self._pieces: deque[tuple[int, Piece]] = deque()
        self._first = 0  # first block of the window being filled
        self._uncovered = False  # a piece has come that no finished window holds

    @property
    def pieces(self) -> list[Piece]:
        """Those of the window being filled."""
        return [piece for _, piece in self._pieces]

    def push(self, block: int, piece: Piece) -> list[list[Piece]]:
        """Add a piece of block number `block` (never descending); returns the windows now complete."""
        finished = []
        while block >= self._first + self._span:
            finished += self.flush()
            behind = block - self._span - self._first
            self._first += self._stride * (1 if self._pieces else max(behind // self._stride, 1))
            while self._pieces and self._pieces[0][0] < self._first:
                self._pieces.popleft()
        self._pieces.append((block, piece))
        self._uncovered = True
        return finished

    def flush(self) -> list[list[Piece]]:
        """The window being filled, complete or not, if it holds something that no window before it held."""
        if not self._uncovered:
            return []
        self._uncovered = False
        return [self.pieces]
