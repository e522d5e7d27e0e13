"""Fit, noise and sizes of map errors in turn, until none of them changes the others any more.

The correlation of consecutive records weakens the data against the priors by κ = (1 + ρ)/(1 − ρ); without it a few
hundred correlated records would overrule every prior.

**Simplifications.** An identification gives up one thing after the other rather than end without an answer. Shapes of
maps and amounts of map error describe the same thing: how a map runs between the operating points that were flown. At
no more points than an error has curves the amounts can do whatever shapes would, and where the maps are generic the
shapes are then left as the engine file states them. Else both are sought, and where that does not converge or drives a
shape to a bound the shapes go first, then the amounts. Amounts that are not sought stay at 0 with the uncertainty that
they have, and the parameters get the uncertainty that comes of it (`consider_map_errors`).
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from enum import Enum
from functools import partial

import numpy as np

from enginediag_cli.error_model.maps import FREEDOMS, turbomachines
from enginediag_cli.error_model.sizes import GENERIC
from enginediag_cli.identification.covariance import (
    ROUNDS,
    Uncertainty,
    active_bounds,
    fix_weak_parameters,
    uncertainty,
)
from enginediag_cli.identification.gauss_newton import (
    Fit,
    derivative_modes,
    has_exact_gradient,
    resume_equations,
    solve,
)
from enginediag_cli.identification.gross_errors import (
    BLOCK,
    HALO,
    LEAST,
    GrossErrors,
    ResidualStretch,
    find_gross_errors,
    may_have_gross_errors,
)
from enginediag_cli.identification.instruments import SETTLED as OFFSETS_SETTLED
from enginediag_cli.identification.instruments import add_size_uncertainties, initial_offsets, resize_offsets
from enginediag_cli.identification.map_error import SETTLED as SIZES_SETTLED
from enginediag_cli.identification.map_error import (
    add_map_errors,
    add_point_errors,
    assign_cells,
    edge_widths,
    is_without_clock,
    misfit_inflation,
    resize_errors,
    restrict_map_range,
)
from enginediag_cli.identification.noise import (
    NoiseEstimate,
    estimate_noise,
    initial_noise,
    quantisation_sigma,
)
from enginediag_cli.identification.normal_equations import blocks, normal_equations, predict
from enginediag_cli.identification.problem import IdentificationProblem, IdentificationSettings, OffsetPrior
from enginediag_cli.progress import each

NOISE_PASSES = 20
"""Passes of fit and noise at most. Judgement: damped as they are from UNDAMPED_PASSES on, more would change nothing."""
NOISE_SETTLED = 0.03
"""Largest relative change of the effective noise σ√κ from one pass to the next that ends the passes."""

NOISE_KNOWN = 0.15
"""The same after the last pass: a standard deviation from twenty independent readings is no better known."""

GROSS_PASSES = 2
"""Passes after which gross errors are sought among all readings: the first fit is bent by those of sensors, the second
is not."""
SIGMA_FLOOR = 0.2
"""Estimated noise is never below this share of what the sensor states."""

UNDAMPED_PASSES = 3
"""Passes before the changes of the noise are damped: first it may move freely, then it must not swing."""
LEAST_SHARE = 1 / 3
"""Share of the way that a pass goes at least, once damped: shorter ones would not forget where the swing began."""
MAX_TEMPERING = 4.0
"""Largest κ by which the fit weakens the data (ρ = 0.6). Correlation beyond it is mostly error of the model
that follows the operating point, and the cure for that is a better fit: on recorded flights of two engines
left-out blocks were predicted better from 10 down to 4, and at 2 parameters began to run to their bounds.
The standard errors know all of ρ."""

PASS_TOLERANCE, FINAL_TOLERANCE = 0.05, 0.01
"""Standard errors. A pass need not be exact, since the next one starts where it ends; the last must be."""

LOST_PASS = 1.0
"""A pass that ends this many standard errors from its optimum has failed, and there is no use in another."""


@dataclass(frozen=True)
class Passes:
    """Where the passes ended: the problem with the noise and sizes found, its fit, and how many passes that took.
    settled: whether noise and sizes had stopped changing; steps: that the search took in all passes."""

    problem: IdentificationProblem
    fit: Fit
    noise: NoiseEstimate
    uncertainty: Uncertainty
    number: int
    noise_converged: bool
    steps: int = 0

    @property
    def reason(self) -> str:
        """Why it did not converge, else how near the optimum is."""
        if self.fit.converged and not self.noise_converged:
            return f"the noise estimate still changed after {self.number} passes and {self.steps} steps of the search"
        return self.fit.reason

    @property
    def converged(self) -> bool:
        """Whether fit and noise have come to rest."""
        return self.fit.converged and self.noise_converged


def fit_and_noise(problem: IdentificationProblem, settings: IdentificationSettings, accuracy: float) -> Passes:
    """Fit and noise in turn; `accuracy`: of the maps as stated, a share. All passes together take no more steps than
    the settings allow."""
    stated, estimated, usual = problem.sigma, settings.noise == "estimate", problem.offsets
    floor = np.maximum(SIGMA_FLOOR * stated, quantisation_sigma(problem.measured))
    described = predict(problem, *_zeros(problem))[0]
    start = (np.zeros(len(problem.parameters)), initial_offsets(problem, described))
    problem, noise = _add_initial_noise(problem, described, start, estimated)
    rho = noise.rho1
    as_read, gross = problem.measured, np.zeros(problem.measured.shape, bool)
    if problem.loss.robust:
        problem = _exclude_wrong_inputs(problem, start)
    lent, kept = derivative_modes(problem)
    fit: Fit | None = None
    steps, settled = 0, False
    for number in each(range(1, NOISE_PASSES + 1), "identifying, passes of fit and noise"):
        fit = solve(
            problem,
            start,
            max_iterations=settings.max_iterations - steps,
            tolerance=PASS_TOLERANCE,
            derivatives=lent if number == 1 else kept,
            equations=resume_equations(problem, start, fit),
        )
        steps += fit.steps
        # noise, sizes and fit feed back on each other; ever shorter steps end a swing between two states
        damping = max(1.0 / max(number - UNDAMPED_PASSES + 1, 1), LEAST_SHARE)
        if number <= GROSS_PASSES and problem.loss.robust:
            problem, fit, gross = _exclude_gross_errors(problem, fit, as_read, floor)
        if problem.offsets and number == 1:
            # offsets take the more of noise the longer it remembers: from above that would confirm itself, up to ρ = 1
            plain = estimate_noise(fit.equations.residual, problem.gap, np.zeros(len(rho)), floor)
            rho = np.minimum(rho, plain.rho1)
        found = uncertainty(problem, fit, rho, noise.used, sampled=True)
        noise = estimate_noise(fit.equations.residual, problem.gap, found.absorbed, floor)
        rho = rho + damping * (noise.rho1 - rho)
        if not fit.converged and not fit.decrement < LOST_PASS:
            return Passes(problem, fit, noise, found, number, False, steps)
        sigma = noise.sigma if estimated else stated
        tempered = _tempering(problem, noise, described, fit.equations.predicted, found.sensor_dof)
        largest = _noise_change(problem, sigma, tempered[0])
        # what creeps on when the passes are over is known as well as noise ever is
        settled = largest < (NOISE_SETTLED if number < NOISE_PASSES else NOISE_KNOWN)
        share = 1.0 / max(number - UNDAMPED_PASSES + 1, 1)
        next_problem, start, sizes_settled = _resize(problem, fit, noise, usual, accuracy, share)
        problem = _damp_noise(next_problem, problem, (sigma, *tempered), damping)
        settled = settled and sizes_settled
        if settled or steps >= settings.max_iterations:
            break
    assert fit is not None
    problem, fit, found, more = _final_fit(problem, start, fit, noise, settings.reduce_iterations(steps))
    found = _widen_at_edges(problem, fit, found, noise, accuracy)
    problem = add_size_uncertainties(problem, fit.equations, fit.x, fit.z)
    outliers = noise.outliers + gross.sum(axis=0)
    noise = replace(noise, outliers=outliers, sigma=problem.sigma, sigma_from="fit" if estimated else "stated")
    return Passes(problem, fit, noise, found, number, settled, steps + more)


def _zeros(problem: IdentificationProblem) -> tuple[np.ndarray, np.ndarray]:
    """The engine as its file describes it: x (p,) and z (R, q)."""
    return np.zeros(len(problem.parameters)), np.zeros((len(problem.labels), len(problem.offsets)))


def _add_initial_noise(
    problem: IdentificationProblem, described: np.ndarray, start: tuple[np.ndarray, np.ndarray], estimated: bool
) -> tuple[IdentificationProblem, NoiseEstimate]:
    """The problem with the noise of the readings about the engine as described, and that noise.

    The noise is as correlated as it looks, too: a first fit that took every record at its word would chase the error
    of the model far from what is plausible, where the search is slow.
    """
    stated = problem.sigma
    predicted, _ = predict(problem, *start)
    noise = initial_noise(problem.measured - predicted, problem.gap, stated)
    problem = problem.replace_noise(noise.sigma if estimated else stated, np.ones(len(stated)))
    tempering = _tempering(problem, noise, described, predicted, np.zeros(len(stated)))
    return problem.replace_noise(problem.sigma, *tempering), noise


@dataclass(frozen=True)
class _Judged:
    """What readings are judged by: the place (x, z) of the engine, what is `predicted` there (N, m), readings as they
    were read (N, m), and noise, sigma and rho (m,). fitted: whether the place is that of a fit; before one, a recording
    may be of any engine that its priors allow."""

    problem: IdentificationProblem
    place: tuple[np.ndarray, np.ndarray]
    predicted: np.ndarray
    as_read: np.ndarray
    sigma: np.ndarray
    rho: np.ndarray
    fitted: bool

    def gross_errors(self) -> Iterator[tuple[np.ndarray, GrossErrors]]:
        """Rows (n,) of consecutive records, and the gross errors among them, where there may be any."""
        z, level = (np.asarray(y / self.sigma) for y in (self.as_read - self.predicted, self.predicted))
        waiting: list[tuple[np.ndarray, np.ndarray]] = []
        for rows, own in _stretches(self.problem.recording, np.isfinite(z).any(axis=1)):
            if may_have_gross_errors(z[rows], np.nan_to_num(level[rows]), self.rho):
                waiting.append((rows, own))
            if sum(len(rows) for rows, _ in waiting) >= BLOCK:
                yield from self._judge(waiting, z, level)
                waiting = []
        yield from self._judge(waiting, z, level)

    def _judge(
        self, stretches: Sequence[tuple[np.ndarray, np.ndarray]], z: np.ndarray, level: np.ndarray
    ) -> Iterator[tuple[np.ndarray, GrossErrors]]:
        problem, m = self.problem, len(self.sigma)
        taken = np.isin(np.arange(len(z)), np.concatenate([rows for rows, _ in stretches] or [np.zeros(0, int)]))
        J = np.zeros((int(taken.sum()), m, 0))
        if not self.fitted and taken.any():
            J = np.concatenate([b.jacobian for b in blocks(problem.select(taken), *self.place)])
        place = np.cumsum(taken) - 1
        for rows, own in stretches:
            lags = np.maximum(np.round(np.diff(problem.position[rows], prepend=-np.inf)), 1.0)
            stretch = ResidualStretch(
                z[rows],
                J[place[rows]] / self.sigma[:, None],
                np.nan_to_num(level[rows]),
                lags,
                problem.time[rows],
                np.eye(J.shape[2]),
                self.rho,
                partial(self._input_effects, rows),
            )
            found = find_gross_errors(stretch, events=True)
            yield rows[own], found.select(own)

    def _input_effects(self, rows: np.ndarray, some: np.ndarray) -> np.ndarray:
        """What an error of each input does to the readings of some records, over their noise: (n, m, q)."""
        problem = self.problem
        here = {c: v[rows[some]] for c, v in problem.inputs.items()}
        theta = problem.to_physical(self.place[0])
        found = problem.model.predict(here, theta, sensors=problem.sensors, wrt=problem.model.inputs)
        return np.asarray(found.jacobian) / self.sigma[:, None]


def _stretches(recording: np.ndarray, judged: np.ndarray) -> Iterator[tuple[np.ndarray, np.ndarray]]:
    """Rows (n,) of consecutive records of one recording (N,) that are `judged` (N,), and which of them (n,) are to be
    judged, the others being context. Of a recording of fewer than `LEAST` nobody can say which reading is wrong."""
    for r in np.unique(recording):
        mine = np.flatnonzero((recording == r) & judged)
        for first in range(0, len(mine) if len(mine) >= LEAST else 0, BLOCK):
            rows = mine[max(0, first - HALO) : first + BLOCK + HALO]
            yield rows, np.isin(rows, mine[first : first + BLOCK])


def _exclude_wrong_inputs(
    problem: IdentificationProblem, start: tuple[np.ndarray, np.ndarray]
) -> IdentificationProblem:
    """The problem without the readings of records an input of which is wrong, judged before a fit: where the engine is
    far from where it was flown, neither predictions nor derivatives mean anything, and no weight keeps them from
    bending it. Maps are then known to be wrong over the range of the other records."""
    predicted, nothing = predict(problem, *start)[0], np.zeros(len(problem.sigma))
    judged = _Judged(problem, start, predicted, problem.measured, problem.sigma, nothing, False)
    wrong = np.zeros(len(problem.recording), bool)
    for rows, found in judged.gross_errors():
        wrong[rows] = found.records
    if not wrong.any():
        return problem
    measured = np.where(wrong[:, None], np.nan, problem.measured)
    return restrict_map_range(replace(problem, measured=measured), ~wrong)


def _exclude_gross_errors(
    problem: IdentificationProblem, fit: Fit, as_read: np.ndarray, floor: np.ndarray
) -> tuple[IdentificationProblem, Fit, np.ndarray]:
    """Problem and fit without gross errors among all readings (N, m), and which readings are such, (N, m)."""
    gross, predicted = np.zeros(as_read.shape, bool), fit.equations.predicted
    noise = estimate_noise(as_read - predicted, problem.gap, np.zeros(len(floor)), floor)
    judged = _Judged(problem, (fit.x, fit.z), predicted, as_read, noise.sigma, noise.rho1, True)
    for rows, found in judged.gross_errors():
        gross[rows] = found.readings & ~found.dead | found.records[:, None]
    gross &= np.isfinite(as_read)
    problem = replace(problem, measured=np.where(gross, np.nan, as_read))
    equations = normal_equations(problem, fit.x, fit.z, fit.equations.prediction)
    return problem, replace(fit, equations=equations), gross


def _widen_at_edges(
    problem: IdentificationProblem, fit: Fit, found: Uncertainty, noise: NoiseEstimate, accuracy: float
) -> Uncertainty:
    """The uncertainty with map errors as wide as they may be at the edges of what was flown."""
    widths = edge_widths(problem, fit.equations, fit.x, fit.z, accuracy)
    if not np.any(widths > 1.0):
        return found
    wide = replace(problem, prior_sigma=problem.prior_sigma * widths)
    other = uncertainty(wide, replace(fit, x=fit.x / widths), noise.rho1, noise.used)
    covariance = other.covariance * widths * widths[:, None]
    return replace(found, covariance=covariance, from_data=other.from_data, widths=widths)


def _noise_change(problem: IdentificationProblem, sigma: np.ndarray, inflation: np.ndarray) -> float:
    """Largest relative change of the effective noise σ√κ from that of the problem."""
    change = np.log(sigma**2 * inflation) - np.log(problem.sigma**2 * problem.inflation)
    return float(np.max(np.abs(change))) / 2


def _damp_noise(
    problem: IdentificationProblem,
    before: IdentificationProblem,
    noise: tuple[np.ndarray, np.ndarray, np.ndarray],
    damping: float,
) -> IdentificationProblem:
    """The problem with σ, κ and its shared part moved from those of `before` by a share of the way to `noise`."""
    assert before.shared is not None
    old = (before.sigma, before.inflation, before.shared)
    return problem.replace_noise(*(a * (b / a) ** damping for a, b in zip(old, noise, strict=True)))


def _resize(
    problem: IdentificationProblem,
    fit: Fit,
    noise: NoiseEstimate,
    usual: tuple[OffsetPrior, ...],
    accuracy: float,
    share: float,
) -> tuple[IdentificationProblem, tuple[np.ndarray, np.ndarray], bool]:
    """The problem with other sizes of map errors and offsets, the place of the fit in their units, and whether the
    sizes have stopped changing.

    share: of the way to the likeliest sizes. Sizes that several machines could have wander from pass to pass: what
    counts is the average of what all passes say of them.
    """
    equations = fit.equations
    if np.any(noise.inflation > problem.inflation) or not has_exact_gradient(equations):
        # the fit may believe correlated readings more than they deserve (MAX_TEMPERING), sizes must not
        inflation = np.maximum(noise.inflation, problem.inflation)
        cautious = problem.replace_noise(problem.sigma, inflation, problem.shared)
        equations = normal_equations(cautious, fit.x, fit.z, equations.prediction)
    problem, x, grown = resize_errors(problem, equations, fit.x, fit.z, accuracy, share)
    problem, z, offsets_grown = resize_offsets(problem, usual, equations, fit.x, fit.z, share)
    return problem, (x, z), grown < SIZES_SETTLED and offsets_grown < OFFSETS_SETTLED


def _final_fit(
    problem: IdentificationProblem,
    start: tuple[np.ndarray, np.ndarray],
    last: Fit,
    noise: NoiseEstimate,
    settings: IdentificationSettings,
) -> tuple[IdentificationProblem, Fit, Uncertainty, int]:
    """The fit from where the last one has ended, with parameters that it leaves at a bound but hardly determines held
    at what was assumed; its covariance, and how many steps that took."""
    search = partial(solve, tolerance=FINAL_TOLERANCE, derivatives=derivative_modes(problem)[1])
    equations, steps = resume_equations(problem, start, last, taken=True), 0
    for turn in range(ROUNDS + 1):
        left = settings.reduce_iterations(steps).max_iterations
        fit = search(problem, start, max_iterations=left, equations=equations)
        steps += fit.steps
        found = uncertainty(problem, fit, noise.rho1, noise.used)
        freed = fix_weak_parameters(problem, fit, found)
        if freed is None or not fit.converged or turn == ROUNDS:
            break
        problem, start = freed, (fit.x, fit.z)
        equations = resume_equations(problem, start, fit)
    return problem, fit, found, steps


def _tempering(
    problem: IdentificationProblem, noise: NoiseEstimate, described: np.ndarray, predicted: np.ndarray, used: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """κ of each sensor as the fit uses it, (m,), and the part of it for an error of the model that records share.

    described (N, m): readings of the engine as its file has it, by which operating points are distinguished.
    Predictions of the fit have the offsets of recordings in them: engines of a fleet would pass for operating points.
    """
    timely = np.minimum(noise.inflation, MAX_TEMPERING)
    if not is_without_clock(problem.gap):
        return timely, np.ones_like(timely)
    at = np.where(np.isfinite(described), described, predicted)
    misfit = misfit_inflation(at, problem.measured - predicted, problem.sigma, noise.inflation, used)
    kappa = np.maximum(timely, misfit)
    return kappa, kappa / timely


class Simplification(Enum):
    """What was not estimated, and why."""

    SHAPES_AT_FEW_POINTS = "shapes of maps, at so few operating points"
    SHAPES = "shapes of maps, because the fit did not converge with them"
    SHAPES_AT_BOUND = "shapes of maps, because the fit drove one of them to a bound"
    SIZES = "errors of maps, because the fit did not converge with them"


@dataclass(frozen=True)
class Attempt:
    """A fit with its noise, and what was given up for it."""

    passes: Passes
    simplifications: tuple[Simplification, ...] = ()

    @property
    def has_shape_at_bound(self) -> bool:
        """Whether the shape of a map is at a bound, where no machine is."""
        problem = self.passes.problem
        return any(b.name in map_shape_names(problem) for b in active_bounds(problem, self.passes.fit))


def best_attempt(problem: IdentificationProblem, settings: IdentificationSettings, accuracy: float) -> Attempt:
    """The first attempt that converges with no shape at a bound, else the first that converges, else the first of all.
    accuracy: of the maps as stated, a share. All attempts together take no more steps than the settings allow: a file
    of another engine would keep each of them busy to its end."""
    tried: list[Attempt] = []
    for attempt in _attempts(problem, settings, accuracy):
        if attempt.passes.converged and not attempt.has_shape_at_bound:
            return attempt
        tried.append(attempt)
    return next((attempt for attempt in tried if attempt.passes.converged), tried[0])


def _attempts(problem: IdentificationProblem, settings: IdentificationSettings, accuracy: float) -> Iterator[Attempt]:
    pointed = add_point_errors(problem, accuracy)
    whole = add_map_errors(pointed, accuracy)
    if whole is problem:
        yield Attempt(fit_and_noise(problem, settings, accuracy))
        return
    plain = drop_map_shapes(pointed)
    shaped = plain is not pointed
    if shaped and accuracy >= GENERIC and operating_points(problem) <= FREEDOMS:
        attempt = Attempt(
            fit_and_noise(add_map_errors(plain, accuracy), settings, accuracy), (Simplification.SHAPES_AT_FEW_POINTS,)
        )
        yield attempt
    else:
        attempt = Attempt(fit_and_noise(whole, settings, accuracy))
        yield attempt
        settings = settings.reduce_iterations(attempt.passes.steps)
        if shaped and settings.max_iterations > 0:
            why = Simplification.SHAPES_AT_BOUND if attempt.passes.converged else Simplification.SHAPES
            attempt = Attempt(fit_and_noise(add_map_errors(plain, accuracy), settings, accuracy), (why,))
            yield attempt
    settings = settings.reduce_iterations(attempt.passes.steps)
    trusted = fit_and_noise(problem, settings, 0.0) if settings.max_iterations > 0 else None
    if trusted is not None and trusted.converged:
        yield Attempt(consider_map_errors(trusted, accuracy), (Simplification.SIZES,))


def operating_points(problem: IdentificationProblem) -> int:
    """How many operating points the records are at, as far as the readings distinguish them."""
    predicted, status = predict(problem, *_zeros(problem))
    there = status <= 1
    return len(np.unique(assign_cells(predicted[there]))) if there.any() else 0


def map_shape_names(problem: IdentificationProblem) -> set[str]:
    """Names of the parameters that say of which shape a map of the engine is."""
    return {name for m in turbomachines(problem.model) for name in m.shapes}


def drop_map_shapes(problem: IdentificationProblem) -> IdentificationProblem:
    """The problem with map shapes as the engine file states them; those with a mean of their own remain."""
    shapes = map_shape_names(problem)
    own = np.array([p.nominal for p in problem.parameters]) != problem.prior_mean
    kept = np.array([p.name not in shapes for p in problem.parameters]) | own
    if kept.all() or not kept.any():
        return problem
    return replace(
        problem,
        parameters=tuple(p for p, k in zip(problem.parameters, kept, strict=True) if k),
        prior_mean=problem.prior_mean[kept],
        prior_sigma=problem.prior_sigma[kept],
        lower=problem.lower[kept],
        upper=problem.upper[kept],
    )


def consider_map_errors(passes: Passes, accuracy: float) -> Passes:
    """The same fit with amounts of map error a ~ N(0, 1) beside the parameters x, none of which were sought.

    An estimator that leaves a at 0 is off by G a + e, with G = S⁻¹ H_xa the part that the parameters take over:

        cov(x̂ − x, â − a) = [[P + G Gᵀ, −G], [−Gᵀ, 1]]

    Source: S. F. Schmidt, Advances in Control Systems 3 (1966) 293–340, "considered" parameters.
    """
    problem = add_map_errors(passes.problem, accuracy)
    p, k = len(passes.problem.parameters), len(problem.parameters) - len(passes.problem.parameters)
    x = np.append(passes.fit.x, np.zeros(k))
    fit = replace(
        passes.fit,
        x=x,
        equations=normal_equations(problem, x, passes.fit.z),
        at_bound=np.append(passes.fit.at_bound, np.zeros(k, bool)),
    )
    found = uncertainty(problem, fit, passes.noise.rho1, passes.noise.used)
    S = found.information[:p, :p] + np.eye(p)
    taken = np.linalg.solve(S, found.information[:p, p:])
    own = passes.uncertainty.covariance + taken @ taken.T
    covariance = np.block([[own, -taken], [-taken.T, np.eye(k)]])
    from_data = np.clip(1 - np.diag(covariance), 0, 1)
    found = replace(found, covariance=covariance, from_data=from_data)
    return replace(passes, problem=problem, fit=fit, uncertainty=found)
