"""Nominal θ0 and noise of an engine from recordings believed healthy.

The fit and its noise are found in turn: a fit with the noise as it looks, the noise that this fit leaves, a
fit with that, until the noise no longer changes. The correlation of consecutive records weakens the data
against the priors by κ = (1 + ρ)/(1 − ρ); without it a few hundred correlated records would overrule every
prior.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from enginediag_cli.engine.warm import warm
from enginediag_cli.error_model.error_model import ErrorModel, map_accuracy_of
from enginediag_cli.error_model.modelled import FAMILY, MapErrorModel
from enginediag_cli.identification.bounds import ROUNDS, AtBound, at_bounds, given_back
from enginediag_cli.identification.covariance import Uncertainty, uncertainty
from enginediag_cli.identification.crossvalidation import CrossValidation, cross_validate
from enginediag_cli.identification.envelope import Envelope, learn_envelope
from enginediag_cli.identification.gauss_newton import Fit, solve
from enginediag_cli.identification.map_error import SETTLED as SIZES_SETTLED
from enginediag_cli.identification.map_error import (
    MapErrorSize,
    frozen_at,
    map_error_sizes,
    resized,
    widths_beyond,
    with_map_error,
)
from enginediag_cli.identification.noise import NoiseEstimate, estimate_noise, starting_noise
from enginediag_cli.identification.nominal import Estimate, Nominal, SensorNoise, status_of
from enginediag_cli.identification.normal_equations import normal_equations, predict
from enginediag_cli.identification.offset_start import first_offsets
from enginediag_cli.identification.offsets_between import SETTLED as OFFSETS_SETTLED
from enginediag_cli.identification.offsets_between import resized_offsets, with_offsets
from enginediag_cli.identification.problem import Model, Problem, TrainingRecording, build_problem
from enginediag_cli.identification.quality import SensorQuality, sensor_quality
from enginediag_cli.identification.regimes import assign_regimes
from enginediag_cli.identification.repeated_points import follows_no_clock, lack_of_fit
from enginediag_cli.identification.resolution import quantisation_sigma
from enginediag_cli.identification.settings import IdentificationSettings, settings_from_mapping
from enginediag_cli.identification.unidentified import Combination, unidentified_combinations
from enginediag_cli.identification.unseen import noise_on_unseen
from enginediag_cli.progress import each

NOISE_PASSES = 20
"""Passes of fit and noise at most. Judgement: damped as they are from UNDAMPED_PASSES on, more would change nothing."""
NOISE_SETTLED = 0.03
"""Largest relative change of the effective noise σ√κ from one pass to the next that ends the passes."""

NOISE_KNOWN = 0.15
"""The same after the last pass: a standard deviation from twenty independent readings is no better known."""

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

OUTSIDE_MAPS = "of these outside the maps"
"""Key of the records that were used although the engine had to extrapolate a map."""

MAX_FAILED = 0.5
"""A fit for which more than this share of the records has no prediction is no verdict about the engine."""


@dataclass(frozen=True)
class IdentificationResult:
    """Everything that identification found; look at `converged` first, `reason` says why not."""

    converged: bool
    reason: str
    problem: Problem
    fit: Fit
    noise: NoiseEstimate
    monitoring_noise: NoiseEstimate
    uncertainty: Uncertainty
    estimates: tuple[Estimate, ...]
    unidentified: tuple[Combination, ...]
    in_sample: tuple[SensorQuality, ...]
    cross_validation: CrossValidation
    cross_validated: tuple[SensorQuality, ...]
    held_out: tuple[SensorQuality, ...]
    envelope: Envelope
    records: Mapping[str, int]
    noise_passes: int
    map_errors: tuple[MapErrorSize, ...] = ()

    @property
    def bounds(self) -> tuple[AtBound, ...]:
        """Parameters that the records push against a bound: a sign that the model lacks something."""
        return at_bounds(self.problem, self.fit)

    def nominal(self, engine_path: str, engine_sha256: str, provenance: Mapping[str, str]) -> Nominal:
        """What later stages read, as one value. Raises ValueError for a fit that did not converge."""
        if not self.converged:
            raise ValueError(f"an identification that did not converge has no nominal state: {self.reason}")
        p, fit = self.problem, self.fit
        offsets = {
            label: {f"{o.sensor} {o.kind}": float(o.prior_sigma * fit.z[r, j]) for j, o in enumerate(p.offsets)}
            for r, label in enumerate(p.labels)
        }
        later = self.monitoring_noise
        noise = tuple(
            SensorNoise(
                sensor=s,
                sigma=float(later.sigma[i]),
                rho1=float(later.rho1[i]),
                n=int(later.n[i]),
                n_effective=float(later.n_effective[i]),
                outliers=int(later.outliers[i]),
                sigma_from=later.sigma_from,
                degrees=float(later.degrees[i]),
                rho1_error=float(later.rho1_error[i]),
                rho1_common=float(later.rho1_common[i]),
                kurtosis=float(later.kurtosis[i]),
            )
            for i, s in enumerate(p.sensors)
        )
        covariance = self.uncertainty.covariance * np.outer(p.prior_sigma, p.prior_sigma)
        return Nominal(
            engine_path=engine_path,
            engine_sha256=engine_sha256,
            inputs=p.model.inputs,
            estimates=self.estimates,
            covariance=covariance,
            noise=noise,
            noise_correlation=later.correlation,
            offsets=p.offsets,
            recording_offsets=offsets if p.offsets else {},
            in_sample=self.in_sample,
            cross_validated=self.cross_validated,
            held_out=self.held_out,
            unidentified=self.unidentified,
            envelope=self.envelope,
            records=self.records,
            provenance=provenance,
            error_model=self._error_model(),
        )

    def _error_model(self) -> ErrorModel | None:
        model = self.problem.model
        if not isinstance(model, MapErrorModel):
            return None
        return ErrorModel(self.map_errors[0].stated, model.curves, {m.target: m.found for m in self.map_errors})


def identify(
    engine: Model,
    recordings: Sequence[TrainingRecording],
    *,
    settings: IdentificationSettings | None = None,
    held_out: Sequence[TrainingRecording] = (),
    cross_validation: bool = True,
    map_accuracy: float | None = None,
    offsets: bool = True,
) -> IdentificationResult:
    """Identify `engine` from healthy recordings; `held_out` recordings only judge the result.

    A held-out recording with the label of a training recording takes its sensor offsets, another one none.
    Raises DataError for settings or recordings that make no problem; a fit that does not converge is a
    result. Settings default to the engine file's `identification:` block, where the engine has one; `map_accuracy`: by
    how much its maps may be wrong, a share, to what the engine file states. `offsets`: what instruments differ by from
    one recording to the next is allowed for where enough recordings show how much.
    """
    if settings is None:
        settings = settings_from_mapping(getattr(engine, "declared", {}).get("identification"))
    problem = build_problem(warm(engine), with_regimes(engine, recordings), settings)
    stated = map_accuracy_of(engine) if map_accuracy is None else map_accuracy
    problem = with_map_error(problem, stated)
    problem = with_offsets(problem, recordings) if offsets else problem
    problem, fit, noise, found, passes, settled = _fit_and_noise(problem, settings, stated)
    converged, reason = fit.converged, fit.reason
    if converged and not settled:
        converged, reason = False, f"the noise estimate still changed after {passes} passes"
    failed = float(np.mean(fit.failed))
    if failed > MAX_FAILED:
        converged, reason = False, f"{100 * failed:.0f} % of the records have no prediction at the estimate"
    quality = sensor_quality(
        problem.sensors, fit.equations.residual, fit.equations.predicted, noise.sigma, problem.regimes
    )
    cv = CrossValidation(np.full(problem.measured.shape, np.nan), 0, 0)
    if converged and cross_validation:
        cv = cross_validate(problem, fit, settings.cross_validation_block, settings.max_iterations)
    later = noise
    if settings.monitoring_noise == "cross_validation" and np.isfinite(cv.predicted).any():
        later = noise_on_unseen(problem.measured - cv.predicted, problem.gap, noise.sigma)
    cv_quality = sensor_quality(
        problem.sensors, problem.measured - cv.predicted, cv.predicted, noise.sigma, problem.regimes
    )
    held_quality: tuple[SensorQuality, ...] = ()
    if converged and held_out:
        held_quality = _judge(problem, fit, noise, held_out, replace(settings, sensors=problem.sensors))
    open_combinations = _left_open(problem, found)
    seen = {
        c: v[fit.equations.ok] if fit.equations.ok.any() else v for c, v in problem.inputs.items() if c in engine.inputs
    }
    envelope = learn_envelope(seen)
    status = fit.equations.status
    records = {
        "used": int(np.sum(status <= 1)),
        OUTSIDE_MAPS: int(np.sum(status == 1)),
        **problem.dropped,
        **_failures(problem, fit),
    }
    return IdentificationResult(
        converged,
        reason,
        problem,
        fit,
        noise,
        later,
        found,
        _estimates(problem, fit, found),
        open_combinations,
        quality,
        cv,
        cv_quality,
        held_quality,
        envelope,
        records,
        passes,
        map_error_sizes(problem, stated),
    )


def _left_open(problem: Problem, found: Uncertainty) -> tuple[Combination, ...]:
    """Combinations of parameters that the records leave open; amounts of map error are no parameters of the engine."""
    own = np.array([p.family != FAMILY for p in problem.parameters])
    covariance = found.covariance[np.ix_(own, own)]
    information = found.information[np.ix_(own, own)]
    if not own.all():
        cross = found.information[np.ix_(own, ~own)]
        inner = found.information[np.ix_(~own, ~own)] + np.eye(int((~own).sum()))
        information = information - cross @ np.linalg.solve(inner, cross.T)
    names = [n for n, kept in zip(problem.names, own, strict=True) if kept]
    return unidentified_combinations(information, covariance, problem.prior_sigma[own], names)


def with_regimes(engine: Model, recordings: Sequence[TrainingRecording]) -> list[TrainingRecording]:
    """The recordings with a regime for each record; regimes that are given stay."""
    recordings = [TrainingRecording(*r) for r in recordings]
    found = assign_regimes([r.columns for r in recordings], engine.inputs) if recordings else []
    return [
        r if r.regimes is not None else r._replace(regimes=label) for r, label in zip(recordings, found, strict=True)
    ]


def _fit_and_noise(
    problem: Problem, settings: IdentificationSettings, accuracy: float
) -> tuple[Problem, Fit, NoiseEstimate, Uncertainty, int, bool]:
    """Fit and noise in turn; also the number of passes, and whether the noise had settled."""
    stated, estimated, usual = problem.sigma, settings.noise == "estimate", problem.offsets
    floor = np.maximum(SIGMA_FLOOR * stated, quantisation_sigma(problem.measured))
    zeros = (np.zeros(len(problem.parameters)), np.zeros((len(problem.labels), len(problem.offsets))))
    # as correlated as it looks, too: a first fit that took every record at its word would chase the error of
    # the model far from what is plausible, where the search is slow
    start = (zeros[0], first_offsets(problem, predict(problem, *zeros)[0]))
    predicted, _ = predict(problem, *start)
    residual = problem.measured - predicted
    noise = starting_noise(residual, problem.gap, stated)
    problem = problem.with_noise(noise.sigma if estimated else stated, np.ones(len(stated)))
    problem = problem.with_noise(problem.sigma, *_tempering(problem, noise, predicted, np.zeros(len(stated))))
    rho, frozen = noise.rho1, zeros[0]
    for number in each(range(1, NOISE_PASSES + 1), "identifying, passes of fit and noise"):
        fit = solve(problem, start, max_iterations=settings.max_iterations, tolerance=PASS_TOLERANCE)
        here = problem
        # noise, sizes and fit feed back on each other; ever shorter steps end a swing between two states
        damping = max(1.0 / max(number - UNDAMPED_PASSES + 1, 1), LEAST_SHARE)
        if problem.offsets and number == 1:
            # offsets take the more of noise the longer it remembers: from above that would confirm itself, up to ρ = 1
            plain = estimate_noise(fit.equations.residual, problem.gap, np.zeros(len(rho)), floor)
            rho = np.minimum(rho, plain.rho1)
        found = uncertainty(problem, fit, rho, noise.used)
        noise = estimate_noise(fit.equations.residual, problem.gap, found.lost, floor)
        rho = rho + damping * (noise.rho1 - rho)
        if not fit.converged and not fit.decrement < LOST_PASS:
            return problem, fit, noise, found, number, False
        sigma = noise.sigma if estimated else stated
        inflation, shared = _tempering(problem, noise, fit.equations.predicted, found.sensor_dof)
        change = np.log(sigma**2 * inflation) - np.log(problem.sigma**2 * problem.inflation)
        largest = float(np.max(np.abs(change))) / 2
        # what creeps on when the passes are over is known as well as noise ever is
        settled = largest < (NOISE_SETTLED if number < NOISE_PASSES else NOISE_KNOWN)
        sigma = problem.sigma * (sigma / problem.sigma) ** damping
        inflation = problem.inflation * (inflation / problem.inflation) ** damping
        shared = problem.shared * (shared / problem.shared) ** damping
        frozen = frozen + damping * (fit.x - frozen)
        equations = fit.equations
        if np.any(noise.inflation > here.inflation):
            # the fit may believe correlated readings more than they deserve (MAX_TEMPERING), sizes must not
            cautious = here.with_noise(here.sigma, np.maximum(noise.inflation, here.inflation), here.shared)
            equations = normal_equations(cautious, fit.x, fit.z)
        # sizes that several machines could have wander from pass to pass: what all passes say of them, on average
        share = 1.0 / max(number - UNDAMPED_PASSES + 1, 1)
        problem, x, grown = resized(frozen_at(here, frozen), equations, fit.x, fit.z, accuracy, share)
        problem, z, offsets_grown = resized_offsets(problem, usual, equations, fit.x, fit.z, share)
        problem = problem.with_noise(sigma, inflation, shared)
        start = (x, z)
        settled = settled and grown < SIZES_SETTLED and offsets_grown < OFFSETS_SETTLED
        if settled:
            break
    fit = solve(problem, start, max_iterations=settings.max_iterations, tolerance=FINAL_TOLERANCE)
    found = uncertainty(problem, fit, noise.rho1, noise.used)
    for _ in range(ROUNDS):
        freed = given_back(problem, fit, found)
        if freed is None or not fit.converged:
            break
        problem = freed
        fit = solve(problem, (fit.x, fit.z), max_iterations=settings.max_iterations, tolerance=FINAL_TOLERANCE)
        found = uncertainty(problem, fit, noise.rho1, noise.used)
    widths = widths_beyond(problem, fit.equations, fit.x, fit.z, accuracy)
    if np.any(widths > 1.0):
        wide = replace(problem, prior_sigma=problem.prior_sigma * widths)
        covariance = uncertainty(wide, replace(fit, x=fit.x / widths), noise.rho1, noise.used).covariance
        found = replace(found, covariance=covariance * widths * widths[:, None])
    noise = replace(noise, sigma=problem.sigma, sigma_from="fit" if estimated else "stated")
    return problem, fit, noise, found, number, settled


def _tempering(
    problem: Problem, noise: NoiseEstimate, predicted: np.ndarray, used: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """κ of each sensor as the fit uses it, (m,), and the part of it for an error of the model that records share."""
    timely = np.minimum(noise.inflation, MAX_TEMPERING)
    if not follows_no_clock(problem.gap):
        return timely, np.ones_like(timely)
    misfit = lack_of_fit(predicted, problem.measured - predicted, problem.sigma, noise.inflation, used)
    kappa = np.maximum(timely, misfit)
    return kappa, kappa / timely


def _estimates(problem: Problem, fit: Fit, found: Uncertainty) -> tuple[Estimate, ...]:
    values = problem.physical(fit.x)
    errors = np.sqrt(np.diag(found.covariance)) * problem.prior_sigma
    return tuple(
        Estimate(
            q.name,
            q.family,
            q.unit,
            values[q.name],
            float(errors[i]),
            float(problem.prior_mean[i]),
            float(problem.prior_sigma[i]),
            float(found.from_data[i]),
            status_of(float(found.from_data[i]), bool(fit.at_bound[i])),
        )
        for i, q in enumerate(problem.parameters)
    )


def _judge(
    problem: Problem,
    fit: Fit,
    noise: NoiseEstimate,
    held_out: Sequence[TrainingRecording],
    settings: IdentificationSettings,
) -> tuple[SensorQuality, ...]:
    """Quality on recordings that the fit has not seen."""
    other = build_problem(problem.model, with_regimes(problem.model, held_out), settings)
    other = replace(
        other,
        parameters=problem.parameters,
        prior_mean=problem.prior_mean,
        prior_sigma=problem.prior_sigma,
        lower=problem.lower,
        upper=problem.upper,
    )
    z = np.zeros((len(other.labels), len(other.offsets)))
    known = {(o.sensor, o.kind): j for j, o in enumerate(problem.offsets)}
    for r, label in enumerate(other.labels):
        if label in problem.labels:
            for j, o in enumerate(other.offsets):
                z[r, j] = fit.z[problem.labels.index(label), known[o.sensor, o.kind]]
    predicted, _ = predict(other, fit.x, z)
    sigma = noise.sigma[[problem.sensors.index(s) for s in other.sensors]]
    return sensor_quality(other.sensors, other.measured - predicted, predicted, sigma, other.regimes)


def _failures(problem: Problem, fit: Fit) -> dict[str, int]:
    """Records that took no part at the estimate, counted by the engine's own words."""
    if not fit.failed.any():
        return {}
    left = problem.select(fit.failed)
    p = problem.model.predict(left.inputs, problem.physical(fit.x), sensors=problem.sensors)
    # the engine adds the size of the residual in brackets, which differs from record to record
    return dict(Counter(p.reason(k).partition(" (")[0] for k in range(len(left.recording))))
