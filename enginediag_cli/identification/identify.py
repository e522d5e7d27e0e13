"""Identification as a whole: nominal θ0 and noise of an engine from recordings believed healthy.

`identify` lets `passes.py` find fit, noise and map errors in turn, removes sensor lags and repeats the fit, and
collects the result with its quality on records that the fit has seen and on those that it has not.

**Cross-validation.** The fit is repeated without one block of consecutive records, which it then predicts. Consecutive
records share their model error, so that leaving single records out would flatter the fit; whole blocks do not
(P. Burman, E. Chow and D. Nolan, Biometrika 81 (1994) 351–358).
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from enginediag_cli.engine.wrapped import preserve_memory, warm_start
from enginediag_cli.error_model.maps import (
    FAMILY,
    POINT_FAMILY,
    ErrorModel,
    MapErrorModel,
    PointErrorModel,
    stated_map_accuracy,
)
from enginediag_cli.identification.covariance import (
    ActiveBound,
    Combination,
    Uncertainty,
    active_bounds,
    unidentified_combinations,
)
from enginediag_cli.identification.gauss_newton import Fit, derivative_modes, solve
from enginediag_cli.identification.instruments import SensorLag, add_offsets, find_sensor_lags, lag_error, sum_lags
from enginediag_cli.identification.map_error import MapErrorSize, map_error_sizes, restrict_map_range
from enginediag_cli.identification.noise import NoiseEstimate, cross_validated_noise
from enginediag_cli.identification.nominal import (
    Envelope,
    Estimate,
    Nominal,
    SensorNoise,
    SensorQuality,
    add_regimes,
    estimate_status,
    learn_envelope,
    predict_held_out,
    sensor_quality,
)
from enginediag_cli.identification.normal_equations import NormalEquations, normal_equations
from enginediag_cli.identification.passes import Attempt, Simplification, best_attempt
from enginediag_cli.identification.problem import (
    IdentificationProblem,
    IdentificationSettings,
    Model,
    TrainingRecording,
    build_problem,
    settings_from_mapping,
)
from enginediag_cli.parallel import parallel_imap
from enginediag_cli.progress import each

FOLDS = 8
"""Each fold is one more fit; with eight a fit has seen seven eighths of the records and is nearly the one that is
judged."""
MAX_ITERATIONS = 40
"""A fold begins at the full fit and needs a few; one that needs so many has failed."""
TOLERANCE = 0.2
"""Standard errors; a fold starts at the full fit and need not be found more exactly than it is known."""


@dataclass(frozen=True)
class CrossValidation:
    """Prediction of every record by a fit that had not seen its block."""

    predicted: np.ndarray  # (N, m), NaN where the model gave none or the fold did not converge
    folds: int
    failed_folds: int


def block_folds(recording: np.ndarray, block: int) -> np.ndarray:
    """Fold of each record, (N,) int.

    Blocks of `block` consecutive records of one recording are dealt in turn to at most FOLDS folds;
    `block` = 0 cuts all records into FOLDS runs of equal length.
    """
    N = len(recording)
    if block <= 0:
        return np.arange(N) * FOLDS // max(N, 1)
    starts = np.r_[True, np.diff(recording) != 0]
    position = np.arange(N) - np.maximum.accumulate(np.where(starts, np.arange(N), 0))
    number = np.cumsum(starts | (position % block == 0)) - 1
    return number % min(FOLDS, int(number[-1]) + 1)


def cross_validate(
    problem: IdentificationProblem, fit: Fit, block: int, max_iterations: int = MAX_ITERATIONS
) -> CrossValidation:
    """Refit without each fold, starting from the full fit, and predict the fold.

    Offsets of a recording come from its remaining records, or stay at zero when none remain. Errors of the maps begin
    anew where the remaining records end, as in the fit of a user who has no others: curves that know where the fold
    lies would be bent there by what lies elsewhere.
    """
    fold_of = block_folds(problem.recording, block)
    predicted = np.full(problem.measured.shape, np.nan)
    folds = np.unique(fold_of)
    failed = 0
    if len(folds) < 2:
        return CrossValidation(predicted, 0, 0)

    def predict_fold(k: int) -> np.ndarray | None:
        """What is predicted (n, m) of the records of a fold, None where the fit to the others did not converge."""
        out = fold_of == folds[k]
        # left out are the readings, not the records: their derivatives are those of the full fit, where these were kept
        rest = restrict_map_range(problem, ~out & fit.equations.ok)
        without = replace(rest, measured=np.where(out[:, None], np.nan, problem.measured))
        with preserve_memory(problem.model):  # folds know nothing of each other, whoever fits them
            part = solve(
                without,
                (fit.x, fit.z),
                max_iterations=max_iterations,
                tolerance=TOLERANCE,
                derivatives=derivative_modes(problem)[0],
                equations=_equations_without(rest, fit, out),
            )
        return part.equations.predicted[out] if part.converged else None

    refits = parallel_imap(predict_fold, len(folds))
    for fold, found in each(zip(folds, refits, strict=True), "cross-validation, refits", len(folds)):
        if found is None:
            failed += 1
        else:
            predicted[fold_of == fold] = found
    return CrossValidation(predicted, len(folds), failed)


def _equations_without(problem: IdentificationProblem, fit: Fit, out: np.ndarray) -> NormalEquations | None:
    """Equations at the fit of all records but those `out` (N,), where the fit has kept its derivatives. `problem`: with
    the readings of these, too, and with the errors of maps that a fit without them has."""
    whole = fit.equations
    if whole.prediction is None:
        return None
    at = whole.prediction.replace_curves(problem, fit.x)
    if at is not whole.prediction:  # of other curves all sums are others
        whole = normal_equations(problem, fit.x, fit.z, at)
    part = normal_equations(problem.select(out), fit.x, fit.z, at.select(out))
    sums = {f: getattr(whole, f) - getattr(part, f) for f in ("H_xx", "H_xz", "H_zz", "g_x", "g_z")}
    return replace(
        whole,
        residual=np.where(out[:, None], np.nan, whole.residual),
        record_cost=np.where(out, 0.0, whole.record_cost),
        **sums,
    )


OUTSIDE_MAPS = "of these outside the maps"
"""Key of the records that were used although the engine had to extrapolate a map."""

MAX_FAILED = 0.5
"""A fit for which more than this share of the records has no prediction is no verdict about the engine."""


FAR_OFF = 5.0
"""Standard deviations of a prior beyond which an estimate is not that of an engine of the kind: 1 in 2,000,000."""
UNEXPLAINED = 5.0
"""Noise that a fit leaves over noise as stated, from which the model does not explain a sensor: noise is stated to a
factor of two."""
FREED = 2
"""Times that readings are freed of what they lag by, each with a fit after it: the first fit has bent to it."""


@dataclass(frozen=True)
class Identification:
    """Everything that identification found; look at `converged` first, `reason` says why not."""

    converged: bool
    reason: str
    problem: IdentificationProblem
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
    simplifications: tuple[Simplification, ...] = ()
    sensor_lags: tuple[SensorLag, ...] = ()

    @property
    def implausible_estimates(self) -> tuple[Estimate, ...]:
        """Estimates so many standard deviations of their priors from what was expected that no engine of the kind is
        there; amounts of map error, whose sizes are estimated with them, aside."""
        own = (e for e in self.estimates if e.family not in (FAMILY, POINT_FAMILY))
        return tuple(e for e in own if abs(e.value - e.prior_mean) >= FAR_OFF * e.prior_sigma)

    @property
    def unexplained_sensors(self) -> tuple[tuple[str, float], ...]:
        """Sensors that the fit misses by far more than their noise as stated, with the ratio."""
        found = []
        for sensor, sigma in zip(self.problem.sensors, self.noise.sigma, strict=True):
            stated = float(self.problem.model.sensors[sensor].noise_sigma or 0.0)
            if stated > 0.0 and sigma >= UNEXPLAINED * stated:
                found.append((sensor, float(sigma / stated)))
        return tuple(found)

    @property
    def bounds(self) -> tuple[ActiveBound, ...]:
        """Parameters that the records push against a bound: a sign that the model lacks something."""
        return active_bounds(self.problem, self.fit)

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
        columns = ("sigma", "rho1", "n", "n_effective", "outliers", "degrees", "rho1_error", "rho1_common", "kurtosis")
        values = zip(*(getattr(later, name).tolist() for name in columns), strict=True)
        noise = tuple(
            SensorNoise(sensor, sigma_from=later.sigma_from, **dict(zip(columns, row, strict=True)))
            for sensor, row in zip(p.sensors, values, strict=True)
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
            sensor_lags=self.sensor_lags,
        )

    def _error_model(self) -> ErrorModel | None:
        model = self.problem.model
        if not isinstance(model, MapErrorModel):
            return None
        sizes, inner = {m.target: m.estimated for m in self.map_errors}, model.model
        if not isinstance(inner, PointErrorModel):
            return ErrorModel(self.map_errors[0].stated, model.curves, sizes)
        return ErrorModel(self.map_errors[0].stated, model.curves, sizes, inner.points, inner.sizes)


def identify(
    engine: Model,
    recordings: Sequence[TrainingRecording],
    *,
    settings: IdentificationSettings | None = None,
    held_out: Sequence[TrainingRecording] = (),
    cross_validation: bool = True,
    map_accuracy: float | None = None,
    offsets: bool = True,
) -> Identification:
    """Identify the nominal state and the noise of an engine from healthy recordings.

    A fit that does not converge is a result as well: ``converged`` and ``reason`` say so.

    Parameters
    ----------
    engine : Model
    recordings : sequence of TrainingRecording
        Recordings that are believed healthy.
    settings : IdentificationSettings, optional
        By default the ``identification:`` block of the engine file, where the engine has one.
    held_out : sequence of TrainingRecording
        Recordings that only judge the result. One with the label of a training recording takes its sensor offsets.
    cross_validation : bool
        Whether blocks of records are predicted by fits without them.
    map_accuracy : float, optional
        By how much the maps may be wrong, a share; by default what the engine file states.
    offsets : bool
        Whether instruments may differ from one recording to the next, where enough recordings show by how much.

    Returns
    -------
    Identification
        Estimates, noise, envelope and quality; ``nominal()`` is what later stages use.

    Raises
    ------
    DataError
        For settings or recordings that make no problem.
    """
    if settings is None:
        settings = settings_from_mapping(getattr(engine, "declared", {}).get("identification"))
    problem = build_problem(warm_start(engine), add_regimes(engine, recordings), settings)
    stated = stated_map_accuracy(engine) if map_accuracy is None else map_accuracy
    problem = add_offsets(problem, recordings) if offsets else problem
    attempt, behind = _fit_without_lags(problem, settings, stated)
    passes = attempt.passes
    problem, fit, noise, found = passes.problem, passes.fit, passes.noise, passes.uncertainty
    converged, reason = passes.converged, passes.reason
    failed = float(np.mean(fit.failed))
    if failed > MAX_FAILED:
        converged, reason = False, f"{100 * failed:.0f} % of the records have no prediction at the estimate"
    cv = CrossValidation(np.full(problem.measured.shape, np.nan), 0, 0)
    if converged and cross_validation:
        cv = cross_validate(problem, fit, settings.cross_validation_block, settings.max_iterations)
    later = noise
    if settings.monitoring_noise == "cross_validation" and np.isfinite(cv.predicted).any():
        later = cross_validated_noise(problem.measured - cv.predicted, problem.gap, noise.sigma)
    in_sample, cross_validated = (
        sensor_quality(problem.sensors, problem.measured - predicted, predicted, noise.sigma, problem.regimes)
        for predicted in (fit.equations.predicted, cv.predicted)
    )
    held_quality: tuple[SensorQuality, ...] = ()
    if converged and held_out:
        other, predicted = predict_held_out(problem, fit, held_out, replace(settings, sensors=problem.sensors))
        sigma = noise.sigma[[problem.sensors.index(s) for s in other.sensors]]
        held_quality = sensor_quality(other.sensors, other.measured - predicted, predicted, sigma, other.regimes)
    flown = fit.equations.ok & np.isfinite(problem.measured).any(axis=1)  # a wrong input is no place it was flown at
    ok = flown if flown.any() else slice(None)
    return Identification(
        converged,
        reason,
        problem,
        fit,
        noise,
        later,
        found,
        _estimates(problem, fit, found),
        _open_combinations(problem, found),
        in_sample,
        cv,
        cross_validated,
        held_quality,
        learn_envelope({c: v[ok] for c, v in problem.inputs.items() if c in engine.inputs}),
        _record_counts(problem, fit),
        passes.number,
        map_error_sizes(problem, stated),
        attempt.simplifications,
        behind,
    )


def _fit_without_lags(
    problem: IdentificationProblem, settings: IdentificationSettings, accuracy: float
) -> tuple[Attempt, tuple[SensorLag, ...]]:
    """The best fit of readings from which is subtracted what they lag by, and what that is."""
    attempt, behind = best_attempt(problem, settings, accuracy), tuple[SensorLag, ...]()
    for _ in range(FREED):
        passes = attempt.passes
        more = find_sensor_lags(passes.problem, passes.fit) if passes.converged else ()
        if not more:
            break
        behind = sum_lags(behind, more)
        freed = replace(problem, measured=problem.measured - lag_error(passes.problem, passes.fit, behind))
        attempt = best_attempt(freed, settings, accuracy)
    return attempt, behind


def _open_combinations(problem: IdentificationProblem, found: Uncertainty) -> tuple[Combination, ...]:
    """Combinations of parameters that the records leave open; amounts of map error are no parameters of the engine."""
    own = np.array([p.family not in (FAMILY, POINT_FAMILY) for p in problem.parameters])
    covariance = found.covariance[np.ix_(own, own)]
    information = found.information[np.ix_(own, own)]
    if not own.all():
        cross = found.information[np.ix_(own, ~own)]
        inner = found.information[np.ix_(~own, ~own)] + np.eye(int((~own).sum()))
        information = information - cross @ np.linalg.solve(inner, cross.T)
    names = [n for n, kept in zip(problem.names, own, strict=True) if kept]
    return unidentified_combinations(information, covariance, problem.prior_sigma[own], names)


def _estimates(problem: IdentificationProblem, fit: Fit, found: Uncertainty) -> tuple[Estimate, ...]:
    values = problem.to_physical(fit.x)
    errors = np.sqrt(np.diag(found.covariance)) * problem.prior_sigma
    prior_sigma = problem.prior_sigma * (1.0 if found.widths is None else found.widths)
    return tuple(
        Estimate(
            q.name,
            q.family,
            q.unit,
            values[q.name],
            float(errors[i]),
            float(problem.prior_mean[i]),
            float(prior_sigma[i]),
            float(found.from_data[i]),
            estimate_status(float(found.from_data[i]), bool(fit.at_bound[i])),
        )
        for i, q in enumerate(problem.parameters)
    )


def _record_counts(problem: IdentificationProblem, fit: Fit) -> dict[str, int]:
    """Records that were used, and those that were not, by the reason; of failures the engine's own words."""
    status = fit.equations.status
    counts = {"used": int(np.sum(status <= 1)), OUTSIDE_MAPS: int(np.sum(status == 1)), **problem.dropped}
    if not fit.failed.any():
        return counts
    left = problem.select(fit.failed)
    p = problem.model.predict(left.inputs, problem.to_physical(fit.x), sensors=problem.sensors)
    # the engine adds the size of the residual in brackets, which differs from record to record
    return {**counts, **Counter(p.reason(k).partition(" (")[0] for k in range(len(left.recording)))}
