"""How alike the errors of two records are: by the time between them and by how far apart they operate.

What a model leaves is not white: it drifts with time and with the operating point. A lag-1 correlation ρ is of records
as they usually follow each other, Δ₀ apart in time (median) and within d₀ in operating point (nine in ten). Of records
further apart less is left,

    ρ_k = ρ^(Δ_k/Δ₀) · exp(−max(0, d_k − d₀)/max(D, d₀))

and below LEAST nothing: the record begins anew, with its own variance. Δ is elapsed time where the recording has a
`time_s`, else the number of records; d is the distance of the engine's inputs in units of the envelope's widths, or of
the recordings' own range where the engine has no envelope.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from enginediag_cli.mismatch.fit.identified import IdentifiedHypothesis

TIME = "time_s"
"""Column with the time of a record, s."""
REACH = 0.1
"""D: share of the envelope over which a model's errors stay alike. Judgement: the map-error floor takes curves of
third degree, which turn over a third of the range; what they leave turns faster."""
USUAL = 0.9
"""Quantile of the distances of consecutive records that is d₀: where the operating point always jumps, a correlation
was estimated over jumps."""
LEAST = 0.05
"""A correlation below it is none."""
SHORTEST = 0.1
"""Usual steps between two records at least: stamps that nearly coincide are of one clock's rounding."""
NEXT = 1.5
"""Records up to so many usual steps apart count as consecutive where a correlation is estimated."""


@dataclass(frozen=True)
class Neighbours:
    """Of each record to the one before it in its recording: `gap` (N,), elapsed time in usual steps, 0 at the first of
    a recording; `apart` (N,), how much further than usual its operating point is, in units of max(D, d₀); `step_s`:
    the usual step, NaN where no recording has a time."""

    gap: np.ndarray
    apart: np.ndarray
    step_s: float

    def correlation(self, rho: np.ndarray) -> np.ndarray:
        """(N, m) with the record before, for lag-1 correlations rho (m,); 0 where the record begins anew."""
        size = np.abs(rho)[None, :] ** self.gap[:, None] * np.exp(-self.apart)[:, None]
        # a negative correlation changes sign from record to record: nothing is known of it over gaps
        told = np.where((rho[None, :] < 0.0) & (self.gap > NEXT)[:, None], 0.0, np.sign(rho)[None, :] * size)
        return np.where((np.abs(told) >= LEAST) & (self.gap > 0.0)[:, None], told, 0.0)

    @property
    def consecutive(self) -> np.ndarray:
        """(N,) whether the record follows the one before as records usually do."""
        return (self.gap > 0.0) & (self.gap <= NEXT) & (self.apart < 1.0)


def neighbours_of(found: IdentifiedHypothesis) -> Neighbours:
    """Of the records of a fit."""
    from enginediag_cli.mismatch.fit.identified import stack_column

    time = stack_column(found.evidence, TIME)[found.number]
    engine = found.evidence.engine
    widths = {c: high - low for c, (low, high) in engine.envelope.items()}
    inputs = {c: found.problem.inputs[c] for c in engine.inputs}
    return neighbours(time, found.number, found.problem.recording, operating(inputs, widths))


def operating(inputs: Mapping[str, np.ndarray], widths: Mapping[str, float]) -> np.ndarray:
    """Operating points (N, k) in units of D: inputs (N,) over their envelope's width, or over the range of most of
    their records where there is no envelope."""
    known = {c: w for c, w in widths.items() if c in inputs and w > 0.0}
    if not known:
        known = {c: float(np.ptp(np.quantile(u, [0.05, 0.95]))) for c, u in inputs.items() if len(u)}
    columns = [inputs[c] / (REACH * w) for c, w in known.items() if w > 0.0]
    N = len(next(iter(inputs.values()), ()))
    return np.column_stack(columns) if columns else np.zeros((N, 0))


def neighbours(time: np.ndarray, number: np.ndarray, recording: np.ndarray, points: np.ndarray) -> Neighbours:
    """Of records at `time` (N,) s, numbered (N,), of recordings (N,), at operating points (N, k); NaN: no time."""
    N = len(number)
    if N < 2:
        return Neighbours(np.zeros(N), np.zeros(N), np.nan)
    same = recording[1:] == recording[:-1]
    elapsed, records = np.diff(time), np.diff(number).astype(float)
    forward = same & np.isfinite(elapsed) & (elapsed > 0.0)
    step = float(np.median((elapsed / records)[forward & (records > 0)])) if forward.any() else np.nan
    gap = np.where(forward, elapsed / step, records) if np.isfinite(step) else records
    distance = np.sqrt((np.diff(points, axis=0) ** 2).sum(axis=1))
    usual = float(np.quantile(distance[same], USUAL)) if same.any() else 0.0
    return Neighbours(
        np.concatenate([[0.0], np.where(same, np.maximum(gap, SHORTEST), 0.0)]),
        np.concatenate([[0.0], np.where(same, np.maximum(distance - usual, 0.0) / max(1.0, usual), 0.0)]),
        step,
    )
