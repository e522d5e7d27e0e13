"""Scores judged by how they repeat: over stretches of the flights, and over operating points.

A score's standard error is the noise model's: so many independent readings, each as uncertain as the next. What a model
leaves is not so. A few records of a transient may be further off than all others, and an operating point that is flown
again shows the error that it showed before. Where noise comes from the recordings, what stands out is therefore judged
by its own spread as well. Of a block with g = C⊥ᵀe and G = C⊥ᵀC⊥, sums g_u and G_u of each of U units left out in turn,

    â_(u) = (G − G_u)⁻¹(g − g_u)      V = (U − 1)/U Σ_u G (â − â_(u))(â − â_(u))ᵀ G      T = gᵀ max(G, V)⁻¹ g

the jackknife of whole units, in which errors may be alike however they like; the maximum is along the axes of V in
units of G. What the block itself explains is no spread. Units are stretches of time, which hold what passes, and
regions of the operating points, flown whenever, which hold what the model does wrong there each time; each leaves its
share of T, one after the other. Of an effect of what changes, which is most of its stretch and of its operating point
at once, the larger spread alone counts. Engines side by side are in the same units.

Source: R. M. Bell and D. F. McCaffrey, "Bias Reduction in Standard Errors for Linear Regression with Multi-Stage
Samples", Survey Methodology 28 (2002) 169–181 (the jackknife of clusters).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import TypeVar

import numpy as np

from enginediag_cli.drivers import RATE
from enginediag_cli.mismatch.fit.by_unit import UnitSums, unit_sums
from enginediag_cli.mismatch.fit.families import Scored, Sums, grid
from enginediag_cli.mismatch.fit.neighbours import operating
from enginediag_cli.mismatch.fit.options import OptionScore
from enginediag_cli.mismatch.fit.projection import Projection, Score
from enginediag_cli.mismatch.fit.remainder import Gates, Remainder
from enginediag_cli.mismatch.fit.scores import surprise
from enginediag_cli.mismatch.unrecorded.aircraft import grid_of
from enginediag_cli.progress import stage

UNITS, LEAST_UNITS = 16, 6
"""Stretches and regions that the records are cut into: with more, what is alike falls into several; fewer than the
second tell no spread. Judgement."""
RIDGE = 1e-9
"""Of a block's information: what is known of it where one unit has all there is."""

Block = TypeVar("Block", bound=Scored)


@stage("weighing how findings repeat")
def repeated(left: Remainder, projection: Projection, gates: Gates) -> Remainder:
    """What is left, with all that is over its gate scored by how it repeats."""
    kinds = left.judged_by(gates)
    over = [b for b, gate in kinds if not b.score.absorbed and b.score.surprise > gate]
    if not over:
        return left
    scores = _scores(over, projection)
    return Remainder(
        tuple(sorted((_with(s, scores) for s in left.scores), key=lambda s: -s.surprise)),
        tuple(sorted((_with(c, scores) for c in left.cells), key=lambda c: -c.surprise)),
    )


def _with(block: Block, scores: dict[int, Score]) -> Block:
    return replace(block, score=scores[id(block)]) if id(block) in scores else block


def _scores(blocks: Sequence[Scored], projection: Projection) -> dict[int, Score]:
    """By the block's identity."""
    units = [u for u in (_stretches(projection), _regions(projection)) if int(u.max(initial=0)) + 1 >= LEAST_UNITS]
    found = {id(b): b.score for b in blocks}
    for family in {id(b.sums): b.sums for b in blocks}.values():
        own = [b for b in blocks if b.sums is family]
        sums, at = _only(family, own)
        for unit in units:
            by_unit = _Joined(sums, unit)
            for b, candidates in zip(own, at, strict=True):
                # a transient is most of its stretch and of its operating point: the one spread is the other
                whole = b.score if _moves(b) else found[id(b)]
                T = whole.statistic * by_unit.share(candidates)
                if T < found[id(b)].statistic:
                    told = float(surprise(min(T, found[id(b)].statistic), b.score.dof))
                    found[id(b)] = replace(b.score, statistic=T, surprise=told)
    return found


def _moves(block: Scored) -> bool:
    """Whether it is an effect of what changes, which is there only while it does."""
    return isinstance(block, OptionScore) and block.option.driver == RATE


def _only(sums: Sums, blocks: Sequence[Scored]) -> tuple[Sums, list[np.ndarray]]:
    """The family of nothing but these blocks, and where their candidates are in it."""
    names = list(dict.fromkeys(int(n) for b in blocks for n in b.candidates[:, 0]))
    curves = list(dict.fromkeys(int(c) for b in blocks for c in b.candidates[:, 1]))
    at = [np.array([[names.index(n), curves.index(c)] for n, c in b.candidates]) for b in blocks]
    along = dict.fromkeys(tuple(dict.fromkeys(a[:, 1].tolist())) for a in at)
    together = {(min(i, j), max(i, j)) for a in at for i in a[:, 0].tolist() for j in a[:, 0].tolist() if i != j}
    family = grid([sums.family.names[n] for n in names], sums.family.curves[:, curves], along, sorted(together))
    return Sums(sums.projection, sums.columns, family), at


class _Joined:
    """Sums of each unit, whose records may be of several recordings."""

    def __init__(self, sums: Sums, unit: np.ndarray):
        recording = sums.projection.found.problem.recording
        self.count = int(unit.max()) + 1
        own, of_record = np.unique(recording.astype(np.int64) * self.count + unit, return_inverse=True)
        self.joined = own % self.count
        self.sums: UnitSums = unit_sums(sums, of_record, len(own))

    def share(self, candidates: np.ndarray) -> float:
        """Of a block's T that is left of it."""
        pulls, grams = self.sums.of(candidates)
        k = pulls.shape[1]
        g, G = np.zeros((self.count, k)), np.zeros((self.count, k, k))
        np.add.at(g, self.joined, pulls[:-1])
        np.add.at(G, self.joined, grams[:-1])
        whole, pull = G.sum(axis=0) + grams[-1], g.sum(axis=0) + pulls[-1]
        whole = (whole + whole.T) / 2 + RIDGE * np.trace(whole) * np.eye(k)
        values, vectors = np.linalg.eigh(whole)
        kept = values > RIDGE * values[-1]
        root = vectors[:, kept] / np.sqrt(values[kept])  # G⁻¹ = root rootᵀ
        z = root.T @ pull
        rest = np.linalg.solve(whole - G + RIDGE * np.trace(whole) * np.eye(k), (pull - g)[:, :, None])[:, :, 0]
        off = (np.linalg.solve(whole, pull) - rest) @ whole @ root  # (U, kept)
        spread, axes = np.linalg.eigh(off.T @ off * (self.count - 1) / self.count)
        told = float(np.sum((axes.T @ z) ** 2 / np.maximum(spread, 1.0)))
        return told / max(float(z @ z), 1e-300)


def _stretches(projection: Projection) -> np.ndarray:
    """(N,) flights, or parts of them as long as each other where there are few."""
    found = projection.found
    side_by_side = grid_of(found)
    if side_by_side is None:
        row, flight = np.arange(len(found.number)), found.problem.recording
    else:
        row, flight = side_by_side.at, (np.cumsum(side_by_side.gap == 0.0) - 1)[side_by_side.at]
    _, flight = np.unique(flight, return_inverse=True)
    parts = -(-UNITS // (int(flight.max()) + 1))
    unit = np.zeros(len(row), int)
    for f in range(int(flight.max()) + 1):
        own = np.flatnonzero(flight == f)
        first, last = row[own].min(), row[own].max()
        unit[own] = f * parts + (row[own] - first) * parts // (last - first + 1)
    return np.asarray(np.unique(unit, return_inverse=True)[1])


def _regions(projection: Projection) -> np.ndarray:
    """(N,) regions of the operating points about centres that are chosen far from each other, one by one."""
    found, engine = projection.found, projection.found.evidence.engine
    widths = {c: high - low for c, (low, high) in engine.envelope.items()}
    points = np.nan_to_num(operating({c: found.problem.inputs[c] for c in engine.inputs}, widths))
    nearest, of = np.full(len(points), np.inf), np.zeros(len(points), int)
    at = 0
    for k in range(UNITS):
        distance = ((points - points[at]) ** 2).sum(axis=1)
        of, nearest = np.where(distance < nearest, k, of), np.minimum(nearest, distance)
        at = int(nearest.argmax())
        if not nearest[at] > 0.0:
            break
    return np.asarray(np.unique(of, return_inverse=True)[1])
