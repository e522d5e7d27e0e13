"""Fit, noise and sizes of map errors in turn, until none of them changes the others any more.

The correlation of consecutive records weakens the data against the priors by κ = (1 + ρ)/(1 − ρ); without it a few
hundred correlated records would overrule every prior.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from enginediag_cli.identification.bounds import ROUNDS, given_back
from enginediag_cli.identification.covariance import Uncertainty, uncertainty
from enginediag_cli.identification.gauss_newton import Fit, resumed, solve
from enginediag_cli.identification.map_error import SETTLED as SIZES_SETTLED
from enginediag_cli.identification.map_error import resized, widths_beyond
from enginediag_cli.identification.noise import NoiseEstimate, estimate_noise, gross_readings, starting_noise
from enginediag_cli.identification.normal_equations import normal_equations, predict
from enginediag_cli.identification.offset_start import first_offsets
from enginediag_cli.identification.offsets_between import SETTLED as OFFSETS_SETTLED
from enginediag_cli.identification.offsets_between import resized_offsets, with_spreads
from enginediag_cli.identification.problem import Problem
from enginediag_cli.identification.repeated_points import follows_no_clock, lack_of_fit
from enginediag_cli.identification.resolution import quantisation_sigma
from enginediag_cli.identification.settings import IdentificationSettings
from enginediag_cli.identification.steps import exact, ways
from enginediag_cli.progress import each

NOISE_PASSES = 20
"""Passes of fit and noise at most. Judgement: damped as they are from UNDAMPED_PASSES on, more would change nothing."""
NOISE_SETTLED = 0.03
"""Largest relative change of the effective noise σ√κ from one pass to the next that ends the passes."""

NOISE_KNOWN = 0.15
"""The same after the last pass: a standard deviation from twenty independent readings is no better known."""

GROSS_PASSES = 2
"""Passes after which gross errors are sought among all readings: the first fit is bent by them, the second is not."""
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

    problem: Problem
    fit: Fit
    noise: NoiseEstimate
    found: Uncertainty
    number: int
    settled: bool
    steps: int = 0

    @property
    def reason(self) -> str:
        """Why it did not converge, else how near the optimum is."""
        if self.fit.converged and not self.settled:
            return f"the noise estimate still changed after {self.number} passes and {self.steps} steps of the search"
        return self.fit.reason

    @property
    def converged(self) -> bool:
        """Whether fit and noise have come to rest."""
        return self.fit.converged and self.settled


def fit_and_noise(problem: Problem, settings: IdentificationSettings, accuracy: float) -> Passes:
    """Fit and noise in turn; `accuracy`: of the maps as stated, a share. All passes together take no more steps than
    the settings allow."""
    stated, estimated, usual = problem.sigma, settings.noise == "estimate", problem.offsets
    floor = np.maximum(SIGMA_FLOOR * stated, quantisation_sigma(problem.measured))
    zeros = (np.zeros(len(problem.parameters)), np.zeros((len(problem.labels), len(problem.offsets))))
    # as correlated as it looks, too: a first fit that took every record at its word would chase the error of
    # the model far from what is plausible, where the search is slow
    described = predict(problem, *zeros)[0]
    start = (zeros[0], first_offsets(problem, described))
    predicted, _ = predict(problem, *start)
    residual = problem.measured - predicted
    noise = starting_noise(residual, problem.gap, stated)
    problem = problem.with_noise(noise.sigma if estimated else stated, np.ones(len(stated)))
    problem = problem.with_noise(
        problem.sigma, *_tempering(problem, noise, described, predicted, np.zeros(len(stated)))
    )
    rho = noise.rho1
    lent, kept = ways(problem)
    fit: Fit | None = None
    as_read, gross = problem.measured, np.zeros(problem.measured.shape, bool)
    steps, settled = 0, False
    for number in each(range(1, NOISE_PASSES + 1), "identifying, passes of fit and noise"):
        fit = solve(
            problem,
            start,
            max_iterations=settings.max_iterations - steps,
            tolerance=PASS_TOLERANCE,
            derivatives=lent if number == 1 else kept,
            begin=resumed(problem, start, fit),
        )
        here = problem
        steps += fit.steps
        # noise, sizes and fit feed back on each other; ever shorter steps end a swing between two states
        damping = max(1.0 / max(number - UNDAMPED_PASSES + 1, 1), LEAST_SHARE)
        if number <= GROSS_PASSES and problem.loss.robust:
            gross = gross_readings((as_read - fit.equations.predicted) / problem.sigma, problem.recording)
            problem = replace(problem, measured=np.where(gross, np.nan, as_read))
            here = problem
            fit = replace(fit, equations=normal_equations(problem, fit.x, fit.z, fit.equations.at))
        if problem.offsets and number == 1:
            # offsets take the more of noise the longer it remembers: from above that would confirm itself, up to ρ = 1
            plain = estimate_noise(fit.equations.residual, problem.gap, np.zeros(len(rho)), floor)
            rho = np.minimum(rho, plain.rho1)
        found = uncertainty(problem, fit, rho, noise.used, sampled=True)
        noise = estimate_noise(fit.equations.residual, problem.gap, found.lost, floor)
        rho = rho + damping * (noise.rho1 - rho)
        if not fit.converged and not fit.decrement < LOST_PASS:
            return Passes(problem, fit, noise, found, number, False, steps)
        sigma = noise.sigma if estimated else stated
        inflation, shared = _tempering(problem, noise, described, fit.equations.predicted, found.sensor_dof)
        change = np.log(sigma**2 * inflation) - np.log(problem.sigma**2 * problem.inflation)
        largest = float(np.max(np.abs(change))) / 2
        # what creeps on when the passes are over is known as well as noise ever is
        settled = largest < (NOISE_SETTLED if number < NOISE_PASSES else NOISE_KNOWN)
        sigma = problem.sigma * (sigma / problem.sigma) ** damping
        inflation = problem.inflation * (inflation / problem.inflation) ** damping
        shared = problem.shared * (shared / problem.shared) ** damping
        equations = fit.equations
        if np.any(noise.inflation > here.inflation) or not exact(equations):
            # the fit may believe correlated readings more than they deserve (MAX_TEMPERING), sizes must not
            cautious = here.with_noise(here.sigma, np.maximum(noise.inflation, here.inflation), here.shared)
            equations = normal_equations(cautious, fit.x, fit.z, equations.at)
        # sizes that several machines could have wander from pass to pass: what all passes say of them, on average
        share = 1.0 / max(number - UNDAMPED_PASSES + 1, 1)
        problem, x, grown = resized(here, equations, fit.x, fit.z, accuracy, share)
        problem, z, offsets_grown = resized_offsets(problem, usual, equations, fit.x, fit.z, share)
        problem = problem.with_noise(sigma, inflation, shared)
        start = (x, z)
        settled = settled and grown < SIZES_SETTLED and offsets_grown < OFFSETS_SETTLED
        if settled or steps >= settings.max_iterations:
            break
    ended = partial(solve, tolerance=FINAL_TOLERANCE, derivatives=kept)
    left = settings.max_iterations - steps
    fit = ended(problem, start, max_iterations=left, begin=resumed(problem, start, fit, taken=True))
    steps += fit.steps
    found = uncertainty(problem, fit, noise.rho1, noise.used)
    for _ in range(ROUNDS):
        freed = given_back(problem, fit, found)
        if freed is None or not fit.converged:
            break
        problem = freed
        left, begin = settings.max_iterations - steps, resumed(problem, (fit.x, fit.z), fit)
        fit = ended(problem, (fit.x, fit.z), max_iterations=left, begin=begin)
        steps += fit.steps
        found = uncertainty(problem, fit, noise.rho1, noise.used)
    widths = widths_beyond(problem, fit.equations, fit.x, fit.z, accuracy)
    if np.any(widths > 1.0):
        wide = replace(problem, prior_sigma=problem.prior_sigma * widths)
        other = uncertainty(wide, replace(fit, x=fit.x / widths), noise.rho1, noise.used)
        covariance = other.covariance * widths * widths[:, None]
        found = replace(found, covariance=covariance, from_data=other.from_data, widths=widths)
    problem = with_spreads(problem, fit.equations, fit.x, fit.z)
    outliers = noise.outliers + gross.sum(axis=0)
    noise = replace(noise, outliers=outliers, sigma=problem.sigma, sigma_from="fit" if estimated else "stated")
    return Passes(problem, fit, noise, found, number, settled, steps)


def _tempering(
    problem: Problem, noise: NoiseEstimate, described: np.ndarray, predicted: np.ndarray, used: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """κ of each sensor as the fit uses it, (m,), and the part of it for an error of the model that records share.

    described (N, m): readings of the engine as its file has it, by which operating points are told apart. Predictions
    of the fit have the offsets of recordings in them: engines of a fleet would pass for operating points.
    """
    timely = np.minimum(noise.inflation, MAX_TEMPERING)
    if not follows_no_clock(problem.gap):
        return timely, np.ones_like(timely)
    at = np.where(np.isfinite(described), described, predicted)
    misfit = lack_of_fit(at, problem.measured - predicted, problem.sigma, noise.inflation, used)
    kappa = np.maximum(timely, misfit)
    return kappa, kappa / timely
