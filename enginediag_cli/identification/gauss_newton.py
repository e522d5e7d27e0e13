"""Regularised Gauss–Newton with a robust loss, bounds, kinks and records that may fail to converge.

Minimises  Q(x, z) = Σ_ks ρ(e_ks/σ_s)/κ_s + ½|x|² + ½|z|²  with x and z in prior standard deviations, by

    S dx = −β g,   |dx| ≤ FARTHEST     on the parameters that are not fixed at a bound,

S being the reweighted normal matrix with priors after elimination of the offsets, g its gradient, combined with those
of the points tried near by where the misfit has kinks (below), β ≤ 1 the boldness, and the step projected on
bounds and longest step (D. P. Bertsekas, "Projected Newton Methods", SIAM J. Control Optim. 20 (1982) 221–246).

A step that loses records is shortened along itself; damping would turn it away from where the misfit is. Where no step
lowers the misfit any more the search is over: it has converged when the optimum is
at most `STALL` standard errors away. The reason states the distance.

Why not `scipy.optimize.least_squares`: it needs residuals that are all finite (a record that does not
converge would have to count as a perfect fit), calls the model for the Jacobian apart from the residuals, and
builds the (N·m, p + R·q) Jacobian that the elimination of the offsets avoids.

**Kinks.** Maps that are read linearly between grid lines have a gradient that jumps. At a kink the gradient on either
side is not small however near the optimum is, and a step along one of them runs into the other. So every point that was
tried near by keeps its gradient, moved to the present point by the common curvature S, with the error e ≥ 0 by which
that extrapolation misses the misfit here. The misfit is then the largest of these pieces, and the best step and the
fall of the misfit that it promises follow from their dual,

    fall = min over λ ≥ 0, Σ λ = 1 of  ½ g_λᵀ S⁻¹ g_λ + λᵀe,   g_λ = Σ λ_i g_i,   step = −S⁻¹ g_λ .

With one gradient that is Newton's step, and √(2·fall) is the Newton decrement: the distance to the optimum in standard
errors, which a kink no longer hides. Source: L. Lukšan and J. Vlček, "A bundle-Newton method for nonsmooth
unconstrained minimization", Math. Programming 83 (1998) 373–391.

**Derivatives.** They cost most of the time. They may be kept from point to point as long as steps bring what they
promise; what is found with kept ones is confirmed with new ones before it counts as converged.

**Curved valleys.** Where many records make a curved
valley steep, a full step ends on its slope, and the steps that do not are shorter the more records there are: it is
then corrected with the same derivatives, which leads back into the valley (R. Fletcher, "Second order corrections for
non-differentiable optimization", Lecture Notes in Mathematics 912 (1982) 85–114).
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from enum import Enum

import numpy as np

from enginediag_cli.identification.normal_equations import (
    Arrow,
    NormalEquations,
    derivative_names,
    eliminate,
    near_equations,
    normal_equations,
    offset_step,
    predict_records,
)
from enginediag_cli.identification.problem import IdentificationProblem
from enginediag_cli.progress import each

PIECES = 24
"""Points that are kept. A kink needs one more point than it has pieces, and far points say little: judgement."""
NEAR = 2.0
"""Standard errors: beyond it a tried point belongs to another region of the maps. Judgement: a few times the jumps of
the gradient that linear maps make."""
PAIR_STEPS, SETTLED = 400, 1e-3
"""Exchanges between two weights λ at most, and the relative fall that ends them: more would change no step visibly.
Any λ gives an upper bound of the distance, so that ending early is on the safe side."""


@dataclass(frozen=True)
class BundlePiece:
    """A point that was tried: parameters (p,), gradient there (p,) and misfit, offsets at their best."""

    x: np.ndarray
    gradient: np.ndarray
    cost: float


class GradientBundle:
    """Gradients of the points tried near where the search stands; the newest last."""

    def __init__(self) -> None:
        self.pieces: list[BundlePiece] = []

    def add(self, piece: BundlePiece) -> None:
        """Add a point that was tried."""
        self.pieces = [*self.pieces[1 - PIECES :], piece]

    def clear(self) -> None:
        """Forget all points, because records were lost or found and misfits no longer compare."""
        self.pieces = []

    def pieces_near(self, here: BundlePiece, S: np.ndarray, free: np.ndarray) -> PiecewiseMisfit:
        """The misfit about `here` as pieces; S (p, p) is the curvature, `free` (p,) not fixed at a bound."""
        moved, errors = [here.gradient], [0.0]
        for piece in self.pieces:
            back = here.x - piece.x
            bend = S @ back
            size = float(back @ bend)
            if size <= NEAR**2:
                moved.append(piece.gradient + bend)
                # a piece that lies above the misfit here, because S is only the common part of the curvature, counts
                # as far away, too
                errors.append(abs(here.cost - (piece.cost + float(piece.gradient @ back) + 0.5 * size)))
        G = np.array(moved)
        inner = np.zeros((len(G), len(G)))
        if free.any():
            inner = G[:, free] @ np.linalg.solve(S[np.ix_(free, free)], G[:, free].T)
        return PiecewiseMisfit(S, G, np.array(errors), inner)


@dataclass(frozen=True)
class PiecewiseMisfit:
    """The misfit near one point as the largest of n quadratics of the same curvature."""

    S: np.ndarray  # (p, p)
    gradients: np.ndarray  # (n, p), the first that of the point itself
    errors: np.ndarray  # (n,) how far each piece lies below the misfit at the point
    inner: np.ndarray  # (n, n) g_i S⁻¹ g_j over the parameters not held

    def combine_gradients(self, boldness: float = 1.0) -> tuple[np.ndarray, float]:
        """g_λ (p,) for a step of `boldness` (0 to 1) times the full one, and twice the fall of a full step."""
        weights = minimise_dual(boldness * self.inner, self.errors)
        return weights @ self.gradients, float(weights @ self.inner @ weights + 2 * weights @ self.errors)

    def fall(self, dx: np.ndarray) -> float:
        """Fall of the misfit that the pieces promise for a step (p,)."""
        return float(-np.max(self.gradients @ dx - self.errors) - 0.5 * dx @ self.S @ dx)


def minimise_dual(M: np.ndarray, e: np.ndarray) -> np.ndarray:
    """Weights λ ≥ 0, Σ λ = 1, (n,), that make ½ λᵀMλ + λᵀe small, by exchanges between the pair that gains most."""
    weights = np.zeros(len(e))
    weights[0] = 1.0
    for _ in range(PAIR_STEPS):
        slope = M @ weights + e
        to = int(np.argmin(slope))
        giver = int(np.argmax(np.where(weights > 0, slope, -np.inf)))
        gap = slope[giver] - slope[to]
        if gap <= SETTLED * (0.5 * weights @ M @ weights + weights @ e):
            break
        bend = M[to, to] + M[giver, giver] - 2 * M[to, giver]
        part = min(weights[giver], gap / bend if bend > 0 else np.inf)
        weights[to] += part
        weights[giver] -= part
    return weights


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


def derivative_modes(problem: IdentificationProblem) -> tuple[Derivatives, Derivatives]:
    """Where a fit of so many records takes its derivatives: one that another one follows, and the last."""
    readings = problem.measured.size
    if readings <= FEW_READINGS or readings * len(derivative_names(problem)) > KEPT_NUMBERS:
        return Derivatives.EACH, Derivatives.EACH
    return Derivatives.LENT, Derivatives.KEPT


@dataclass(frozen=True)
class Step:
    """A step that was tried: what is predicted at its end, by how much the misfit fell, and what was promised."""

    trial: NormalEquations
    change: tuple[np.ndarray, np.ndarray]  # of x and z
    gain: float
    promised: float
    lost_records: bool
    accepted: bool
    is_corrected: bool = False


def try_step(
    problem: IdentificationProblem,
    now: NormalEquations,
    point: tuple[np.ndarray, np.ndarray],
    change: tuple[np.ndarray, np.ndarray],
    here: tuple[PiecewiseMisfit, float],
    each_point: bool,
) -> Step:
    """A step from a point (x, z), with derivatives at its end or those at hand."""
    (x, z), (dx, dz) = point, change
    end = x + dx, z + dz
    trial = normal_equations(problem, *end) if each_point else near_equations(problem, *end, now)
    promised = here[0].fall(dx) + 0.5 * here[1]
    gain = actual_gain(now, trial, x, z, dx, dz)
    floor = NEGLIGIBLE * max(total_cost(now, x, z), 1.0)
    lost = lost_records(now, trial)
    enough = gain > ENOUGH * promised or abs(gain) + promised < floor
    return Step(trial, change, gain, promised, lost, bool(not lost and promised > 0 and enough))


def correct_step(
    problem: IdentificationProblem,
    now: NormalEquations,
    point: tuple[np.ndarray, np.ndarray],
    step: Step,
    box: tuple[np.ndarray, np.ndarray],
) -> Step:
    """The step with what leads from its end back to a low misfit, or as it was where that makes it worth no more."""
    (x, z), (dx, dz), found = point, step.change, step
    for _ in range(CORRECTIONS):
        there = x + dx, z + dz
        arrow = eliminate_offsets(found.trial, *there)
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
        gain = actual_gain(now, trial, x, z, dx, dz)
        if lost_records(now, trial) or gain <= found.gain:
            return step
        found = replace(found, trial=trial, change=(dx, dz), gain=gain, is_corrected=True)
        if step.promised > 0 and gain > ENOUGH * step.promised:
            return replace(found, accepted=True)
    return step


def lost_records(now: NormalEquations, trial: NormalEquations) -> bool:
    """Whether a step loses more records than it may."""
    return int(np.sum(now.ok & ~trial.ok)) > max(1, LOST_FRACTION * now.ok.sum())


def has_exact_gradient(n: NormalEquations) -> bool:
    """Whether the gradient is that of the misfit here."""
    return n.prediction is None or n.prediction.exact


def equations_after_step(
    problem: IdentificationProblem, x: np.ndarray, z: np.ndarray, step: Step, from_exact: bool
) -> NormalEquations:
    """Where a step has led, (x, z): with new derivatives where it brought less than it promised, with the weights that
    readings have now where it brought more. from_exact: whether it began with derivatives of its own point, which a
    short one has then not left."""
    short = from_exact and 2.0 * step.promised < STALL**2
    if step.is_corrected or (step.gain < FAITHFUL * step.promised and not short):
        return fresh_equations(problem, x, z)
    if FAITHFUL * step.gain > step.promised:
        return normal_equations(problem, x, z, step.trial.prediction)
    return step.trial


def fresh_equations(problem: IdentificationProblem, x: np.ndarray, z: np.ndarray) -> NormalEquations:
    """With derivatives that are taken here and kept."""
    return normal_equations(problem, x, z, predict_records(problem, x, z))


def eliminate_offsets(n: NormalEquations, x: np.ndarray, z: np.ndarray) -> Arrow:
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


def total_cost(n: NormalEquations, x: np.ndarray, z: np.ndarray) -> float:
    return float(n.record_cost[n.ok].sum() + 0.5 * x @ x + 0.5 * np.sum(z**2))


def actual_gain(
    now: NormalEquations, trial: NormalEquations, x: np.ndarray, z: np.ndarray, dx: np.ndarray, dz: np.ndarray
) -> float:
    """Actual fall of the cost, on the records that both points have: a record that fails must not pass for one that
    fits."""
    both = now.ok & trial.ok
    prior = x @ dx + 0.5 * dx @ dx + np.sum(z * dz) + 0.5 * np.sum(dz**2)
    return float((now.record_cost[both] - trial.record_cost[both]).sum() - prior)


SHORTENED, SHORTER, BOLDER = 0.25, 0.5, 4.0
"""Factors of the length of the next step after one that lost records, after one that lowered the misfit too little, and
after one that kept its promise. Judgement: back at full length in one or two steps."""
MAX_REJECTED = 24
"""Rejected steps in a row after which nothing is expected of another."""
CREEPING = 1e-3
"""Share of a full step: where one so short still loses records there is a wall, before which a search would creep."""
LOOKED, HOPE = 4, 10.0
"""Iterations before a search may be given up as hopeless, and how many times what the next step promises may still be
gained in all. Judgement: far from the optimum promises are of the right size, in a bent valley several times too
small."""


@dataclass(frozen=True)
class Iteration:
    """One model evaluation: cost on all converged records, distance to the optimum, records lost, boldness of the next
    step, and whether this one was taken."""

    cost: float
    decrement: float
    failed: int
    boldness: float
    accepted: bool


@dataclass(frozen=True)
class Fit:
    """Where the search ended and why; `converged` must be looked at before anything else."""

    x: np.ndarray  # (p,) in prior standard deviations from the prior mean
    z: np.ndarray  # (R, q) offsets in prior standard deviations
    equations: NormalEquations
    at_bound: np.ndarray  # (p,) held at a bound that the data push against, unless both bounds are one
    converged: bool
    reason: str
    iterations: tuple[Iteration, ...]

    @property
    def decrement(self) -> float:
        """√(2 · fall of the misfit that is still to be had) at the end: distance to the optimum in standard errors."""
        return self.iterations[-1].decrement if self.iterations else np.nan

    @property
    def steps(self) -> int:
        """Steps that were tried."""
        return max(len(self.iterations) - 1, 0)

    @property
    def failed(self) -> np.ndarray:
        """Records without a prediction at the end, (N,) bool: they took no part in the estimate."""
        return ~self.equations.ok


@dataclass(frozen=True)
class _SearchState:
    """Where the search is: the misfit around it, what is fixed at bounds, and the distance to the optimum."""

    pieces: PiecewiseMisfit
    gradient: np.ndarray  # (p,) at the point itself
    at_bound: np.ndarray
    offsets: float  # what the offsets alone add to the square of the distance
    decrement: float

    def step(self, boldness: float, x: np.ndarray, low: np.ndarray, high: np.ndarray) -> np.ndarray:
        """The step (p,), as bold as asked (0 to 1)."""
        gradient, _ = self.pieces.combine_gradients(boldness)
        return projected_step(self.pieces.S / boldness, gradient, self.at_bound, x, low, high)


class _Search:
    """A search on its way: the point (x, z), what is known of the misfit around it, and the length of the next step."""

    def __init__(
        self,
        problem: IdentificationProblem,
        start: tuple[np.ndarray, np.ndarray] | None,
        equations: NormalEquations | None,
        derivatives: Derivatives,
        tolerance: float,
    ) -> None:
        self.problem, self.derivatives, self.tolerance = problem, derivatives, tolerance
        self.each_point = derivatives is Derivatives.EACH
        self.low = (problem.lower - problem.prior_mean) / problem.prior_sigma
        self.high = (problem.upper - problem.prior_mean) / problem.prior_sigma
        zeros = np.zeros(len(problem.parameters)), np.zeros((len(problem.labels), len(problem.offsets)))
        x, z = zeros if start is None else (start[0].copy(), start[1].copy())
        self.x, self.z = np.clip(x, self.low, self.high), z
        if equations is None or not np.array_equal(self.x, x):
            equations = normal_equations(problem, self.x, z) if self.each_point else fresh_equations(problem, self.x, z)
        self.now = equations
        self.kinks = GradientBundle()
        self.boldness = 1.0
        self.rejected = 0  # in a row
        self.walls = 0  # steps that lost records
        self.is_walled = False
        self.history: list[Iteration] = []

    @property
    def is_over(self) -> bool:
        """Whether the optimum is near, or nothing is expected of another step."""
        return self.here.decrement < self.tolerance or self.rejected >= MAX_REJECTED or self.is_walled

    def is_hopeless(self, limit: float) -> bool:
        """Whether χ² stays above this limit even if HOPE times what the next step promises is gained."""
        chi2 = 2.0 * total_cost(self.now, self.x, self.z)
        return len(self.history) > LOOKED and chi2 - HOPE * self.here.decrement**2 > limit

    def look(self, evaluated: NormalEquations, accepted: bool) -> None:
        """Update what is known at the point, with derivatives of its own where the search would end and they are
        required. evaluated: the equations that this iteration has computed."""
        self.here = self._state()
        confirms = self.derivatives is Derivatives.KEPT and not has_exact_gradient(self.now)
        if confirms and self.here.decrement < self.tolerance:
            self._renew()
        self._record(evaluated, accepted)

    def advance(self) -> None:
        """Try one step, and go to its end where it lowers the misfit."""
        x, z, here = self.x, self.z, self.here
        dx = here.step(self.boldness, x, np.maximum(self.low, x - FARTHEST), np.minimum(self.high, x + FARTHEST))
        change = dx, offset_step(self.now, z, dx)
        step = try_step(self.problem, self.now, (x, z), change, (here.pieces, here.offsets), self.each_point)
        if not step.accepted and not has_exact_gradient(self.now):
            # no judgement of the step: the derivatives may be what misleads
            self._renew()
            self._record(self.now, False)
            return
        if not step.accepted and not step.lost_records and not self.each_point:
            step = correct_step(self.problem, self.now, (x, z), step, (self.low, self.high))
        trial = self._evaluate_end(step)
        if step.accepted:
            self.x, self.z, self.now = np.clip(x + step.change[0], self.low, self.high), z + step.change[1], trial
            self.rejected = 0
            self.boldness = min(1.0, self.boldness * (BOLDER if step.gain > 0.5 * step.promised else 1.0))
        else:
            self.rejected += 1
            self.walls += step.lost_records
            self.is_walled = step.lost_records and self.boldness < CREEPING
            self.boldness *= SHORTENED if step.lost_records else SHORTER
        self.look(trial, step.accepted)

    def _evaluate_end(self, step: Step) -> NormalEquations:
        """The equations at the end of a step; its gradient there, or here, joins the pieces of the misfit."""
        (dx, dz), trial = step.change, step.trial
        x, z = self.x + dx, self.z + dz
        is_near = self.each_point or dx @ self.here.pieces.S @ dx <= NEAR**2
        is_exact = has_exact_gradient(self.now)
        if not self.each_point and step.accepted:
            trial = equations_after_step(self.problem, np.clip(x, self.low, self.high), z, step, is_exact)
        elif not self.each_point and is_near:
            trial = normal_equations(self.problem, x, z)
        if not np.array_equal(self.now.ok, trial.ok):
            self.kinks.clear()
        elif step.accepted and is_exact:
            self.kinks.add(BundlePiece(self.x, self.here.gradient, total_cost(self.now, self.x, self.z)))
        elif is_near and not step.accepted:
            self.kinks.add(BundlePiece(x, eliminate_offsets(trial, x, z).g, total_cost(trial, x, z)))
        return trial

    def _renew(self) -> None:
        """Take new derivatives at the point."""
        self.now = fresh_equations(self.problem, self.x, self.z)
        self.here = self._state()

    def _state(self) -> _SearchState:
        """What is known at the point."""
        x, z, now = self.x, self.z, self.now
        arrow = eliminate_offsets(now, x, z)
        fixed = ((x <= self.low) & (arrow.g > 0)) | ((x >= self.high) & (arrow.g < 0))
        pieces = self.kinks.pieces_near(BundlePiece(x, arrow.g, total_cost(now, x, z)), arrow.S, ~fixed)
        # z moves with x: the rest of its own gradient is part of the distance to the optimum
        offsets = offset_squared(now, z)
        return _SearchState(pieces, arrow.g, fixed, offsets, float(np.sqrt(pieces.combine_gradients()[1] + offsets)))

    def _record(self, evaluated: NormalEquations, accepted: bool) -> None:
        cost, failed = total_cost(self.now, self.x, self.z), int((~evaluated.ok).sum())
        self.history.append(Iteration(cost, self.here.decrement, failed, self.boldness, accepted))

    def result(self) -> Fit:
        """The fit where the search is, with its verdict."""
        at_bound = self.here.at_bound & (self.low < self.high)
        end = Fit(self.x, self.z, self.now, at_bound, False, "", tuple(self.history))
        in_vain = self.rejected if self.rejected >= MAX_REJECTED or self.is_walled else 0
        return _conclude(end, self.tolerance, in_vain, self.walls)


def solve(
    problem: IdentificationProblem,
    start: tuple[np.ndarray, np.ndarray] | None = None,
    *,
    max_iterations: int = 40,
    tolerance: float = 1e-3,
    derivatives: Derivatives = Derivatives.EACH,
    equations: NormalEquations | None = None,
    hopeless: float = np.inf,
) -> Fit:
    """Find the most probable parameters and offsets.

    A model that does not converge raises nothing: the reason is in the result. Derivatives that are kept take the
    memory of all records.

    Parameters
    ----------
    problem : IdentificationProblem
    start : tuple of ndarray, optional
        x (p,) and z (R, q) in prior standard deviations; the prior mean by default.
    max_iterations : int
        Largest number of steps.
    tolerance : float
        Standard errors. The search has converged where the optimum is nearer, or nearer than ``STALL`` where no step
        lowers the misfit any more.
    derivatives : Derivatives
        Where derivatives are taken.
    equations : NormalEquations, optional
        The equations at `start`, where they are known.
    hopeless : float
        χ² of readings and priors (twice the cost) above which the optimum is of no interest. The search is given up,
        not converged, where ``HOPE`` times what the next step promises does not lead below it.

    Returns
    -------
    Fit
        Where the search ended and why; look at ``converged`` first.
    """
    search = _Search(problem, start, equations, derivatives, tolerance)
    del equations  # the search replaces them: their memory is free from then on
    if not search.now.ok.any():
        no_bound = np.zeros(len(problem.parameters), bool)
        reason = "no record converged at the starting point"
        return Fit(search.x, search.z, search.now, no_bound, False, reason, ())
    search.look(search.now, True)
    for _ in each(range(max_iterations), "iterations of the fit"):
        if search.is_over or search.is_hopeless(hopeless):
            break
        search.advance()
    return search.result()


def resume_equations(
    problem: IdentificationProblem, start: tuple[np.ndarray, np.ndarray], fit: Fit | None, *, taken: bool = False
) -> NormalEquations | None:
    """Equations of a problem at the place where a fit of the same records to other noise and sizes has ended, (x, z) in
    the problem's own units, by derivatives that were kept; None where none were, and where they are not those of that
    very place although they are to be `taken` there."""
    at = None if fit is None else fit.equations.prediction
    if at is None or not at.matches(problem) or (taken and not at.exact):
        return None
    return normal_equations(problem, *start, at)


def _conclude(fit: Fit, tolerance: float, in_vain: int, walls: int) -> Fit:
    """The fit with its verdict: converged or not, and why. `in_vain`: rejected steps in a row after which nothing was
    expected of another; 0 where the search ended otherwise."""
    distance = f"{fit.decrement:.1e} standard errors"
    if fit.decrement < tolerance:
        return replace(fit, converged=True, reason=f"the distance to the optimum is {distance}")
    if in_vain:
        if fit.decrement < STALL:
            reason = f"no step lowers the misfit any more; the distance to the optimum is at most {distance}"
            return replace(fit, converged=True, reason=reason)
        reason = f"{in_vain} steps in a row did not lower the misfit, {distance} from the optimum"
    else:
        reason = f"after {fit.steps} iterations the optimum is {distance} away"
    return replace(fit, reason=reason + _describe_lost_records(walls))


def _describe_lost_records(count: int) -> str:
    """What stood in the way, when steps were refused because records stopped converging."""
    return f"; {count} steps lost too many converged records" if count else ""
