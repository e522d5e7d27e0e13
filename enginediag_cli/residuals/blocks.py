"""Blocks of records that add to windows exactly, also where noise is correlated across their border."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from enginediag_cli.residuals.statistics import LocalStatistics


@dataclass(frozen=True)
class Block:
    """Statistics of consecutive records with what the next and the block before need to know of them.

    `head`, `tail` (m, p) and `decay` (m,) as in `correlated.LaggedSums`; `share` (m,) is the variance of one
    whitened residual.
    """

    statistics: LocalStatistics
    head: np.ndarray
    tail: np.ndarray
    decay: np.ndarray
    share: np.ndarray

    def __add__(self, later: Block) -> Block:
        """This block followed at once by `later`: V = V₁ + V₂ + cross + crossᵀ, cross = Σ_j tail₁ head₂ᵀ."""
        cross = (self.tail * self.share[:, None]).T @ later.head
        both = self.statistics + later.statistics
        return Block(
            replace(both, V=both.V + cross + cross.T),
            self.head + self.decay[:, None] * later.head,
            later.tail + later.decay[:, None] * self.tail,
            self.decay * later.decay,
            self.share,
        )
