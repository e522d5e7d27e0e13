"""Windows of records: what every method judges."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True)
class Windows:
    """W windows of n consecutive records: inputs column -> (W, n), readings y (W, n, m), NaN where missing.

    Windows of unequal length are filled up with records that have no reading (and may have no input).
    """

    inputs: Mapping[str, np.ndarray]
    y: np.ndarray

    def __post_init__(self) -> None:
        if self.y.ndim != 3:
            raise ValueError(f"`y` must have shape (windows, records, sensors), not {self.y.shape}")
        for column, values in self.inputs.items():
            if np.shape(values) != self.y.shape[:2]:
                raise ValueError(f"input {column} must have shape {self.y.shape[:2]}, not {np.shape(values)}")

    @property
    def count(self) -> int:
        """W."""
        return int(self.y.shape[0])

    @property
    def length(self) -> int:
        """n."""
        return int(self.y.shape[1])

    @property
    def ends(self) -> np.ndarray:
        """Records (W,) up to the last one with a reading: how long each window is without what fills it up."""
        read = np.isfinite(self.y).any(axis=2)
        return np.where(read.any(axis=1), self.length - np.argmax(read[:, ::-1], axis=1), 0)

    def flat_inputs(self) -> dict[str, np.ndarray]:
        """Inputs column -> (W n,), window after window."""
        return {column: np.asarray(values, float).ravel() for column, values in self.inputs.items()}


def filled(parts: Sequence[tuple[Mapping[str, np.ndarray], np.ndarray]]) -> Windows:
    """Windows of unequal length, each inputs column -> (n_w,) and readings (n_w, m), filled up to the longest."""
    longest = max(len(y) for _, y in parts)

    def fill(values: np.ndarray) -> np.ndarray:
        width = [(0, longest - len(values)), *[(0, 0)] * (values.ndim - 1)]
        return np.pad(values, width, constant_values=np.nan)

    inputs = {c: np.stack([fill(own[c]) for own, _ in parts]) for c in parts[0][0]}
    return Windows(inputs, np.stack([fill(y) for _, y in parts]))
