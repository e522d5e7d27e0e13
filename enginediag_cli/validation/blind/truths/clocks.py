"""Clocks that do not agree: every column of a recording is sampled up to a second early or late.

A bus that collects readings of several computers stamps them when they arrive. The reading of record k is then that of
the time t_k − τ, with a delay τ for each column, the same in all flights of an engine; between records linear.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

LARGEST_S = 1.0
"""Delay, early or late, drawn uniformly."""


@dataclass(frozen=True)
class Clocks:
    """Column → delay [s]."""

    delays: Mapping[str, float]

    def sample(self, time_s: np.ndarray, columns: Mapping[str, np.ndarray]) -> dict[str, np.ndarray]:
        """Columns (N,) of one flight as they are stamped; a record that would lie outside keeps its own reading."""
        return {c: np.interp(time_s - self.delays[c], time_s, v) if c in self.delays else v for c, v in columns.items()}


def draw_clocks(columns: Sequence[str], rng: np.random.Generator) -> Clocks:
    """Delays of these columns."""
    return Clocks({c: float(rng.uniform(-LARGEST_S, LARGEST_S)) for c in columns})
