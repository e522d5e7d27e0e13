"""Steps of the search for the most probable parameters: how one is tried, corrected and followed.

Derivatives cost most of the time. They may be kept from point to point as long as steps bring what they promise; what
is found with kept ones is confirmed with new ones before it counts as converged. Where many records make a curved
valley steep, a full step ends on its slope, and the steps that do not are shorter the more records there are: it is
then corrected with the same derivatives, which leads back into the valley (R. Fletcher, "Second order corrections for
non-differentiable optimization", Lecture Notes in Mathematics 912 (1982) 85–114).
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from enum import Enum

import numpy as np

from enginediag_cli.identification.kinks import Pieces
from enginediag_cli.identification.normal_equations import (
    Arrow,
    NormalEquations,
    eliminate,
    near_equations,
    normal_equations,
    offset_step,
    predicted_at,
)
from enginediag_cli.identification.predicted import directions
from enginediag_cli.identification.problem import Problem

LOST_FRACTION = 0.02
"""A step may lose this share of the converged records; one that loses more is rejected as too long."""

FARTHEST = 2.0
"""Prior standard deviations by which a parameter may change in one step: half of what is believable at all. A first
step of a badly scaled model would otherwise go where no record has a prediction."""
ENOUGH = 0.05
"""Share of the promised fall that makes a step worth taking; with less its point serves as a piece of the misfit."""

FAITHFUL = 0.8
"""Share of the promised fall that a step must bring for its derivatives to be kept. Judgement: the next one, a few
times shorter, then misses its promise by a few per cent."""
CORRECTIONS = 5
"""Corrections of one step at most: each is several times smaller than the one before, or the valley is left."""
STALL = 0.3
"""Standard errors. An optimum that near is statistically the same answer: its misfit is lower by 0.045, where 0.5 is
one standard error, and an interval about the place reached would have to be wider by 4 % at most to be as good."""
NEGLIGIBLE = 1e-9  # relative change of cost that is the solver's own rounding


class Derivatives(Enum):
    """Where derivatives are taken."""

    EACH = "at every point that is tried"
    KEPT = "where those at hand do not serve any more, and at the end"
    LENT = "where those at hand do not serve any more"


KEPT_NUMBERS = 25_000_000
"""Numbers of derivatives that are kept, 200 MB; of more they are taken at each point, a bounded number of records at a
time."""
FEW_READINGS = 10_000
"""Readings up to which derivatives cost little more than the readings themselves, and are taken at each point."""


def ways(problem: Problem) -> tuple[Derivatives, Derivatives]:
    """Where a fit of so many records takes its derivatives: one that another one follows, and the last."""
    readings = problem.measured.size
    if readings <= FEW_READINGS or readings * len(directions(problem)) > KEPT_NUMBERS:
        return Derivatives.EACH, Derivatives.EACH
    return Derivatives.LENT, Derivatives.KEPT


@dataclass(frozen=True)
class Step:
    """A step that was tried: what is predicted at its end, by how much the misfit fell, and what was promised."""

    trial: NormalEquations
    change: tuple[np.ndarray, np.ndarray]  # of x and z
    gain: float
    promised: float
    lost: bool
    accepted: bool
    corrected: bool = False


def tried(
    problem: Problem,
    now: NormalEquations,
    point: tuple[np.ndarray, np.ndarray],
    change: tuple[np.ndarray, np.ndarray],
    here: tuple[Pieces, float],
    each_point: bool,
) -> Step:
    """A step from a point (x, z), with derivatives at its end or those at hand."""
    (x, z), (dx, dz) = point, change
    end = x + dx, z + dz
    trial = normal_equations(problem, *end) if each_point else near_equations(problem, *end, now)
    promised = here[0].fall(dx) + 0.5 * here[1]
    gain = gain_of(now, trial, x, z, dx, dz)
    floor = NEGLIGIBLE * max(total(now, x, z), 1.0)
    lost = lost_records(now, trial)
    enough = gain > ENOUGH * promised or abs(gain) + promised < floor
    return Step(trial, change, gain, promised, lost, bool(not lost and promised > 0 and enough))


def corrected(
    problem: Problem,
    now: NormalEquations,
    point: tuple[np.ndarray, np.ndarray],
    step: Step,
    box: tuple[np.ndarray, np.ndarray],
) -> Step:
    """The step with what leads from its end back to a low misfit, or as it was where that makes it worth no more."""
    (x, z), (dx, dz), found = point, step.change, step
    for _ in range(CORRECTIONS):
        there = x + dx, z + dz
        arrow = reduced(found.trial, *there)
        held = ((there[0] <= box[0]) & (arrow.g > 0)) | ((there[0] >= box[1]) & (arrow.g < 0))
        low, high = np.maximum(box[0], there[0] - FARTHEST), np.minimum(box[1], there[0] + FARTHEST)
        more = projected_step(arrow.S, arrow.g, held, there[0], low, high)
        fall = 0.5 * offset_squared(found.trial, there[1]) - float(arrow.g @ more + 0.5 * more @ arrow.S @ more)
        # the reweighted matrix overstates the curvature of a robust loss, and so understates what a correction brings
        if found.gain + fall / FAITHFUL <= ENOUGH * step.promised:
            return step
        dz = dz + offset_step(found.trial, there[1], more)
        dx = dx + more
        trial = near_equations(problem, x + dx, z + dz, now)
        gain = gain_of(now, trial, x, z, dx, dz)
        if lost_records(now, trial) or gain <= found.gain:
            return step
        found = replace(found, trial=trial, change=(dx, dz), gain=gain, corrected=True)
        if step.promised > 0 and gain > ENOUGH * step.promised:
            return replace(found, accepted=True)
    return step


def lost_records(now: NormalEquations, trial: NormalEquations) -> bool:
    """Whether a step loses more records than it may."""
    return int(np.sum(now.ok & ~trial.ok)) > max(1, LOST_FRACTION * now.ok.sum())


def exact(n: NormalEquations) -> bool:
    """Whether the gradient is that of the misfit here."""
    return n.at is None or n.at.taken


def served(problem: Problem, x: np.ndarray, z: np.ndarray, step: Step, from_exact: bool) -> NormalEquations:
    """Where a step has led, (x, z): with new derivatives where it brought less than it promised, with the weights that
    readings have now where it brought more. from_exact: whether it began with derivatives of its own point, which a
    short one has then not left."""
    short = from_exact and 2.0 * step.promised < STALL**2
    if step.corrected or (step.gain < FAITHFUL * step.promised and not short):
        return taken_at(problem, x, z)
    if FAITHFUL * step.gain > step.promised:
        return normal_equations(problem, x, z, step.trial.at)
    return step.trial


def taken_at(problem: Problem, x: np.ndarray, z: np.ndarray) -> NormalEquations:
    """With derivatives that are taken here and kept."""
    return normal_equations(problem, x, z, predicted_at(problem, x, z))


def reduced(n: NormalEquations, x: np.ndarray, z: np.ndarray) -> Arrow:
    return eliminate(n.H_xx, n.H_xz, n.H_zz, n.g_x, n.g_z, x, z)


def projected_step(
    S: np.ndarray, g: np.ndarray, held: np.ndarray, x: np.ndarray, low: np.ndarray, high: np.ndarray
) -> np.ndarray:
    """Newton step of the free parameters; one that would cross its bound stops there, the rest re-solve."""
    fixed, dx = held.copy(), np.zeros_like(x)
    while not fixed.all():
        free = ~fixed
        dx[free] = np.linalg.solve(S[np.ix_(free, free)], -(g[free] + S[np.ix_(free, fixed)] @ dx[fixed]))
        target = np.clip(x + dx, low, high) - x
        crossed = free & (target != dx) & (np.abs(target - dx) > 1e-12 * (1 + np.abs(dx)))
        dx = np.where(crossed, target, dx)
        if not crossed.any():
            break
        fixed |= crossed
    return np.clip(x + dx, low, high) - x


def offset_squared(n: NormalEquations, z: np.ndarray) -> float:
    """The offsets' share of the decrement at fixed x, Σ_r (g_z + z)ᵀ(H_zz + 1)⁻¹(g_z + z)."""
    g = n.g_z + z
    return float(np.sum(g * np.linalg.solve(n.H_zz + np.eye(z.shape[1]), g[:, :, None])[:, :, 0]))


def total(n: NormalEquations, x: np.ndarray, z: np.ndarray) -> float:
    return float(n.record_cost[n.ok].sum() + 0.5 * x @ x + 0.5 * np.sum(z**2))


def gain_of(
    now: NormalEquations, trial: NormalEquations, x: np.ndarray, z: np.ndarray, dx: np.ndarray, dz: np.ndarray
) -> float:
    """Actual fall of the cost, on the records that both points have: a record that fails must not pass for one that
    fits."""
    both = now.ok & trial.ok
    prior = x @ dx + 0.5 * dx @ dx + np.sum(z * dz) + 0.5 * np.sum(dz**2)
    return float((now.record_cost[both] - trial.record_cost[both]).sum() - prior)
