"""Blocks of records that add to windows exactly, also where noise is correlated across their border."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from enginediag_cli.residuals.noise import NoiseModel
from enginediag_cli.residuals.statistics import LocalStatistics


@dataclass(frozen=True)
class Block:
    """Sums over consecutive records with what the next and the block before need to know of them.

    `sums`: their statistics, with V = F; `parts` (m, p, p): what the noise of each sensor contributes to V, None where
    noise is white and certain, and V is F. `records`: how many follow each other, those without a reading counted.
    `head`, `tail` (m, p) and `decay` (m,) as in `correlated.LaggedSums`.
    """

    sums: LocalStatistics
    noise: NoiseModel
    parts: np.ndarray | None
    records: int
    head: np.ndarray
    tail: np.ndarray
    decay: np.ndarray

    def __add__(self, later: Block) -> Block:
        """This block followed at once by `later`: V_j = V_j1 + V_j2 + cross + crossᵀ, cross = tail_j1 head_j2ᵀ."""
        parts = None
        if self.parts is not None and later.parts is not None:
            tail = self.tail / self.noise.inflation[:, None]  # in variances of one whitened residual
            cross = tail[:, :, None] * later.head[:, None, :]
            parts = self.parts + later.parts + cross + cross.transpose(0, 2, 1)
        return Block(
            self.sums + later.sums,
            self.noise,
            parts,
            self.records + later.records,
            self.head + self.decay[:, None] * later.head,
            later.tail + later.decay[:, None] * self.tail,
            self.decay * later.decay,
        )

    @property
    def statistics(self) -> LocalStatistics:
        """The statistics, with V and how uncertain it is for a window of so many records."""
        if self.parts is None:
            return self.sums
        errors, bias = self.noise.doubt(self.records) or (None, np.zeros(len(self.parts)))
        V = self.sums.F if self.noise.white else np.tensordot(1 / (1 + bias), self.parts, axes=1)
        return replace(self.sums, V=V, by_sensor=None if errors is None else np.tensordot(errors, self.parts, axes=1))
