"""Scores, residuals and estimates of many windows at once, shared by the methods; parameter estimation as a method.

Whitening: residuals and sensitivities in units of independent noise, also where noise is correlated in time.

AR(1) noise, cov(e_k, e_l) = σ² ρ^|k−l|, becomes white by differencing with the last reading of the same sensor,

    z_k = (e_k − ρ^g e_{k−g}) / (σ √(1 − ρ^2g)),        g = records since that reading,

and the sensitivities likewise (generalised least squares; Bryson, A. E. and Henrikson, L. J. (1968) J.
Spacecraft and Rockets 5, 662–665, for filters).

Sums of a window, for many windows at once: z·z, s = Gᵀz and F = GᵀG.

z ~ N(G Δθ, 1) are whitened residuals. Everything uncertain about θ0 and the sensors, of covariance C = L Lᵀ,
makes their covariance 1 + G C Gᵀ, whose inverse 1 − G L A⁻¹ Lᵀ Gᵀ, A = 1 + Lᵀ F L (Woodbury), needs only sums.

Parameter estimation: re-estimate every monitored parameter, then ask whether it still equals nominal.

    joint    z(θ0)·z(θ0) − z(θ̂)·z(θ̂) ~ χ²(rank F̂)                                    (likelihood ratio)
    single   t_i = Δθ̂_i² / (F̂⁺)_ii ~ χ²(1),   Δθ̂ = F̂⁺ s̃                            (Wald)

at the point of a Gauss–Newton estimate, held only loosely (`width` prior standard deviations) and within the
bounds of the parameters, with the uncertainty of nominal counted as noise. On a linear engine the joint test is
Wald's, Δθ̂ᵀ F̂ Δθ̂; on a curved one only the likelihood ratio keeps its χ² where θ̂ wanders far along combinations
that the window hardly determines. Isolation names the parameters that
Holm's step-down procedure rejects. This is the "blind" re-estimation of all parameters to which the paper
compares (end of section 5): with as many parameters as here, single estimates are poor where the joint one is good.
Wald, A. (1943) Trans. Amer. Math. Soc. 54, 426–482; Holm, S. (1979) Scand. J. Statistics 6, 65–70.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from time import process_time
from typing import ClassVar

import numpy as np

from enginediag_cli.config.fields import Field
from enginediag_cli.methods.base import (
    PARAMETERS,
    Method,
    RecordWindows,
    Verdicts,
    chi_square_test,
)
from enginediag_cli.residuals.instruments import NoiseModel
from enginediag_cli.residuals.monitor import Monitor
from enginediag_cli.residuals.pipeline import LINEARISE
from enginediag_cli.residuals.relinearise import relinearise
from enginediag_cli.residuals.score import Score, fisher_score
from enginediag_cli.residuals.statistics import RANK_TOLERANCE, block_statistics, covariance_root, whiten

SMALL_STEP = 0.02
"""Step of a parameter, in its prior standard deviations, over which the model is as good as linear: for the 2 % of
health parameters the second order is below 1e-6, the noise of a mean of thousands of records above 1e-5."""


@dataclass(frozen=True, eq=False)
class ScoredWindows(RecordWindows):
    """Windows of a monitor, and the scores of its monitored parameters.

    faults (W,): number of changes in each, which only methods that take it may read; None where nobody knows.
    cost: CPU seconds spent on what methods share; used: what the method at work has asked for.
    """

    monitor: Monitor
    faults: np.ndarray | None = None
    cost: dict[str, float] = field(default_factory=dict)
    used: set[str] = field(default_factory=set)
    _shared: _Shared = field(default_factory=lambda: _Shared())

    def scores(self, linearise: str) -> tuple[list[Score], np.ndarray]:
        """Score of each window at its own "estimate" or at "nominal", and which converged (W,)."""
        self.used.update({"predictions", linearise})
        shared = self._shared
        if shared.last is None:
            begun = process_time()
            shared.last = self._predicted(np.tile(self.monitor.theta0, (len(self._window), 1)))
            shared.nominal = shared.last.copy()
            self.cost["predictions"] = process_time() - begun
        if linearise not in shared.scores:
            begun = process_time()
            shared.scores[linearise] = self._linearised(linearise)
            self.cost[linearise] = process_time() - begun
        return shared.scores[linearise]

    @property
    def _window(self) -> np.ndarray:
        return np.repeat(np.arange(self.count), self.length)

    def _linearised(self, linearise: str) -> tuple[list[Score], np.ndarray]:
        monitor, nominal = self.monitor, self._shared.nominal
        assert nominal is not None
        W, n, m = self.y.shape
        y = self.y.reshape(-1, m)
        if linearise == "nominal":
            e, J, ok, converged = y - nominal.y, nominal.J, nominal.ok, np.ones(W, bool)
        else:
            found = relinearise(
                self._predict,
                y,
                monitor.hold,
                monitor.noise,
                window=self._window,
                nominal=(nominal.y, nominal.J, nominal.ok),
            )
            e, J, ok, converged = found.e, found.J, found.ok, found.converged
        lags = np.ones(W * n)
        lags[::n] = np.inf  # windows are unrelated
        blocks = block_statistics(
            np.where(ok[:, None], e, np.nan), J, monitor.noise, np.arange(W) * n, monitor.frame, lags=lags
        )
        C = monitor.uncertainty
        scores = [fisher_score(b.statistics, monitored=monitor.monitored, uncertainty=C) for b in blocks]
        return scores, converged

    def _predict(self, theta: np.ndarray, rows: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Model and sensitivities to what is monitored, evaluated anew where θ has moved by more than SMALL_STEP since
        the last time."""
        last = self._shared.last
        assert last is not None
        step = theta - last.theta[rows]
        far = np.any(np.abs(step) > SMALL_STEP * self.monitor.prior_sigma, axis=1)
        if far.any():
            at = rows[far]
            start = None if last.x is None else last.x[:, at]
            last.put(at, self._predicted(theta[far], at, start, nuisance=False))
        beyond = np.where(far[:, None], 0.0, step)
        y = last.y[rows] + np.einsum("kjp,kp->kj", last.J[rows], beyond)
        return y, last.J[rows, :, : len(self.monitor.monitored)], last.ok[rows]

    def _predicted(
        self,
        theta: np.ndarray,
        rows: np.ndarray | slice = slice(None),
        start: np.ndarray | None = None,
        nuisance: bool = True,
    ) -> _Prediction:
        """One call of the engine for records `rows` at theta (n, p), from the unknowns `start` (nx, n)."""
        inputs = {c: v[rows] for c, v in self.flat_inputs().items()}
        y, J, ok, found = self.monitor.predict(inputs, theta, nuisance=nuisance, start=start)
        x = getattr(found, "x", None)
        return _Prediction(theta, y, J, ok, None if x is None else np.asarray(x))


def scored_windows(monitor: Monitor, windows: RecordWindows) -> ScoredWindows:
    """The windows as evidence for this monitor: themselves, if they are that already."""
    if isinstance(windows, ScoredWindows) and windows.monitor is monitor:
        return windows
    return ScoredWindows(windows.inputs, windows.y, monitor)


@dataclass
class _Shared:
    """What was computed so far."""

    nominal: _Prediction | None = None
    last: _Prediction | None = None
    scores: dict[str, tuple[list[Score], np.ndarray]] = field(default_factory=dict)


@dataclass
class _Prediction:
    """theta (n, p), y (n, m), J (n, m, p), ok (n,), unknowns x (nx, n) of n records, None from a model that shows
    none."""

    theta: np.ndarray
    y: np.ndarray
    J: np.ndarray
    ok: np.ndarray
    x: np.ndarray | None

    def copy(self) -> _Prediction:
        x = None if self.x is None else self.x.copy()
        return _Prediction(self.theta.copy(), self.y.copy(), self.J.copy(), self.ok.copy(), x)

    def put(self, rows: np.ndarray, new: _Prediction) -> None:
        """Replace the records `rows`, with the sensitivities that the new prediction has."""
        self.theta[rows], self.y[rows], self.ok[rows] = new.theta, new.y, new.ok
        self.J[rows, :, : new.J.shape[2]] = new.J
        if self.x is not None and new.x is not None:
            self.x[:, rows] = new.x


LINEARISE_FIELD = Field(
    "linearise",
    "choice",
    "where the model is linearised: at the estimate of each window, or at nominal",
    "estimate",
    choices=LINEARISE,
)


def white_residuals(e: np.ndarray, J: np.ndarray, noise: NoiseModel) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """z (W, n, m), G (W, n, m, p) of unit white noise, zero where missing, and what is present (W, n, m).

    e (W, n, m), NaN where missing; J (W, n, m, p); records of a window are one step apart.
    """
    W, n, m, p = J.shape
    present = np.isfinite(e) & np.all(np.isfinite(J), axis=3)
    if noise.white:
        z, G = whiten(e.reshape(-1, m), J.reshape(-1, m, p), noise)
        return z.reshape(W, n, m), G.reshape(W, n, m, p), present
    z = np.where(present, e, 0.0) / noise.sigma
    G = np.where(present[..., None], J, 0.0) / noise.sigma[:, None]
    if not n:
        return z, G, present
    here = np.where(present, np.arange(n)[:, None], -1)
    last = np.maximum.accumulate(here, axis=1)
    before = np.concatenate([np.full((W, 1, m), -1), last[:, :-1]], axis=1)
    gap = np.arange(n)[:, None] - before
    c = np.where(present & (before >= 0), noise.rho**gap, 0.0)
    source = np.maximum(before, 0)
    scale = 1 / np.sqrt(1 - c**2)
    z = (z - c * np.take_along_axis(z, source, 1)) * scale
    G = (G - c[..., None] * np.take_along_axis(G, source[..., None], 1)) * scale[..., None]
    return z, G, present


BLIND = 1e-6
"""Share of a parameter's direction in what the window does not excite, beyond which the window does not determine it:
well above rounding, well below any share that matters."""


@dataclass(frozen=True)
class ResidualSums:
    """zz (W,), s (W, p), F (W, p, p) and `dof` (W,), the number of independent residuals."""

    zz: np.ndarray
    s: np.ndarray
    F: np.ndarray
    dof: np.ndarray

    def add_uncertainty(self, C: np.ndarray, keep: int) -> ResidualSums:
        """The sums of the first `keep` parameters, with the covariance C (p, p) counted as noise."""
        if np.any(C):
            spread = np.sqrt(np.diag(C))
            L = covariance_root(C, np.where(spread > 0, spread, 1.0))
            A = np.eye(L.shape[1]) + L.T @ self.F @ L
            Ls, LF = self.s @ L, L.T @ self.F
            inner = np.linalg.solve(A, np.concatenate([Ls[:, :, None], LF], axis=2))
            zz = self.zz - np.einsum("wi,wi->w", Ls, inner[:, :, 0])
            s = self.s - np.einsum("wip,wi->wp", LF, inner[:, :, 0])
            F = self.F - np.swapaxes(LF, 1, 2) @ inner[:, :, 1:]
        else:
            zz, s, F = self.zz, self.s, self.F
        return ResidualSums(zz, s[:, :keep], F[:, :keep, :keep], self.dof)


@dataclass(frozen=True)
class WaldStatistics:
    """Estimate Δθ̂ = F⁺s (W, p) with variance diag(F⁺), infinite where the window does not determine it.

    wald (W, p) = Δθ̂²/variance ~ χ²(1), zero where undetermined; joint (W,) = sᵀF⁺s ~ χ²(rank (W,)).
    """

    estimate: np.ndarray
    variance: np.ndarray
    wald: np.ndarray
    joint: np.ndarray
    rank: np.ndarray


def residual_sums(e: np.ndarray, J: np.ndarray, monitor: Monitor) -> ResidualSums:
    """Sums over the records of e (W, n, m), NaN where missing, and J (W, n, m, p)."""
    z, G, present = white_residuals(e, J, monitor.noise)
    W, p = len(z), G.shape[3]
    z, G = z.reshape(W, -1), G.reshape(W, -1, p)
    G_t = np.swapaxes(G, 1, 2)
    return ResidualSums(
        np.sum(z**2, axis=1), (G_t @ z[:, :, None])[:, :, 0], G_t @ G, present.sum(axis=(1, 2)).astype(float)
    )


def nominal_residuals(monitor: Monitor, windows: RecordWindows) -> tuple[np.ndarray, np.ndarray]:
    """e = Y − Φ(U, θ0) (W, n, m), eq. (4), NaN where a reading or the model fails, and J (W, n, m, p)."""
    y, J, ok, _ = monitor.predict(windows.flat_inputs(), monitor.theta0)
    shape = windows.y.shape
    predicted = np.where(ok[:, None], y, np.nan).reshape(shape)
    return windows.y - predicted, J.reshape(*shape, -1)


def wald_statistics(s: np.ndarray, F: np.ndarray, scale: np.ndarray) -> WaldStatistics:
    """Joint and single Wald tests of s (W, p), F (W, p, p), parameters in units of `scale` (p,)."""
    eigenvalues, U = np.linalg.eigh(scale[:, None] * F * scale)
    floor = RANK_TOLERANCE * np.maximum(eigenvalues[:, -1:], 0.0)
    kept = eigenvalues > floor
    inverse = np.where(kept, 1 / np.where(kept, eigenvalues, 1.0), 0.0)
    v = np.einsum("wpi,wp->wi", U, scale * s)
    estimate = np.einsum("wpi,wi->wp", U, inverse * v)
    variance = np.einsum("wpi,wi->wp", U**2, inverse)
    blind = np.einsum("wpi,wi->wp", U**2, (~kept).astype(float)) > BLIND
    variance = np.where(blind, np.inf, variance)
    wald = np.where(blind | (variance == 0), 0.0, estimate**2 / np.where(variance > 0, variance, 1.0))
    return WaldStatistics(estimate * scale, variance * scale**2, wald, np.sum(inverse * v**2, axis=1), kept.sum(axis=1))


def holm(p_values: np.ndarray, false_alarm: float) -> np.ndarray:
    """Rejected by Holm's step-down procedure (W, q) for p values (W, q), W families of q hypotheses."""
    order = np.argsort(p_values, axis=1, kind="stable")
    q = p_values.shape[1]
    steps = np.take_along_axis(p_values, order, 1) * (q - np.arange(q))
    accepted = np.logical_and.accumulate(steps <= false_alarm, axis=1)
    rejected = np.zeros_like(accepted)
    np.put_along_axis(rejected, order, accepted, 1)
    return rejected


@dataclass(frozen=True)
class WindowResiduals:
    """e (W, n, m), NaN where missing, J (W, n, m, p), point of linearisation theta (W, p), converged (W,).

    e0, J0: the same at θ0, with the same readings missing.
    """

    e: np.ndarray
    J: np.ndarray
    e0: np.ndarray
    J0: np.ndarray
    theta: np.ndarray
    converged: np.ndarray


def linearise_windows(
    monitor: Monitor, windows: RecordWindows, linearise: str, precision: np.ndarray
) -> WindowResiduals:
    """Residuals ẽ = y − Φ(û) + Ĵ(θ̂ − θ0) at θ0 ("nominal") or at the estimate held by `precision` (p, p)."""
    if linearise not in LINEARISE:
        raise ValueError(f"`linearise` must be one of {', '.join(LINEARISE)}, not {linearise!r}")
    W, n, m = windows.y.shape
    if linearise == "nominal":
        e, J = nominal_residuals(monitor, windows)
        return WindowResiduals(e, J, e, J, np.tile(monitor.theta0, (W, 1)), np.ones(W, bool))
    inputs = windows.flat_inputs()

    def predict(theta: np.ndarray, rows: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        return monitor.predict({c: v[rows] for c, v in inputs.items()}, theta, nuisance=False)[:3]

    *nominal, prediction = monitor.predict(inputs, monitor.theta0)
    inputs = {**inputs, **getattr(prediction, "frozen", {})}
    found = relinearise(
        predict,
        windows.y.reshape(-1, m),
        replace(monitor.hold, precision=precision),
        monitor.noise,
        window=np.repeat(np.arange(W), n),
        nominal=(nominal[0], nominal[1], nominal[2]),
    )
    shape = windows.y.shape
    e = np.where(found.ok[:, None], found.e, np.nan).reshape(shape)
    e0 = np.where(np.isfinite(e), windows.y - nominal[0].reshape(shape), np.nan)
    J, J0 = found.J.reshape(*shape, -1), nominal[1].reshape(*shape, -1)
    return WindowResiduals(e, J, e0, J0, found.theta, found.converged)


CERTAIN = 1e-10
"""Variance, in prior variances, of what nominal says for certain: small, and still invertible."""


@dataclass(frozen=True)
class EstimationResult(Verdicts):
    """Adds the estimated changes (W, p) and their standard errors (W, p), infinite where undetermined."""

    change: np.ndarray
    standard_error: np.ndarray


def loose_precision(monitor: Monitor, width: float) -> np.ndarray:
    """Inverse prior covariance (p, p): changes of `width` prior standard deviations, plus uncertainty of nominal."""
    change = np.zeros(len(monitor.names))
    a = len(monitor.monitored)
    change[:a] = width * monitor.prior_sigma[:a]
    scale = monitor.prior_sigma
    covariance = (monitor.uncertainty + np.diag(change**2)) / scale / scale[:, None]
    return np.asarray(np.linalg.inv(covariance + CERTAIN * np.eye(len(scale))) / scale / scale[:, None])


@dataclass(frozen=True)
class ParameterEstimation(Method):
    """Re-estimation held by a prior of `width` prior standard deviations; `linearise` as in the pipeline."""

    HELP: ClassVar[str] = "loose re-estimation of all parameters, a likelihood-ratio test and Wald tests of each"
    OPTIONS: ClassVar[tuple[Field, ...]] = (
        Field("width", "number", "how loosely changes are held, in prior standard deviations", 10.0, minimum=1e-3),
        LINEARISE_FIELD,
    )
    width: float = 10.0
    linearise: str = "estimate"

    @property
    def name(self) -> str:
        return "reestimation"

    @property
    def tests(self) -> tuple[str, ...]:
        return ("joint",)

    @property
    def wrong_choice(self) -> str:
        return "" if self.width > 0 else "`width` must be positive"

    def diagnose(self, monitor: Monitor, windows: RecordWindows, false_alarm: float) -> EstimationResult:
        from scipy.stats import chi2

        p = len(monitor.monitored)
        found = linearise_windows(monitor, windows, self.linearise, loose_precision(monitor, self.width))
        C = monitor.uncertainty
        sums = residual_sums(found.e, found.J, monitor).add_uncertainty(C, p)
        wald = wald_statistics(sums.s, sums.F, monitor.prior_sigma[:p])
        moved = found.theta[:, :p] - monitor.theta0[:p]
        bent = (sums.F @ moved[:, :, None])[:, :, 0]
        # one more step of the loosely held estimate: the search weighs time-correlated noise only approximately
        left = (sums.s - bent)[:, :, None]
        loose = np.diag((self.width * monitor.prior_sigma[:p]) ** -2)
        gained = np.sum(left * np.linalg.solve(sums.F + loose, left), axis=(1, 2))
        at_estimate = sums.zz - np.sum(moved * (2 * sums.s - bent), axis=1) - gained
        at_nominal = residual_sums(found.e0, found.J0, monitor).add_uncertainty(C, p).zz
        joint = wald.joint if self.linearise == "nominal" else np.maximum(at_nominal - at_estimate, 0.0)
        test = chi_square_test("joint", joint, wald.rank, false_alarm)
        rejected = holm(chi2.sf(wald.wald, 1), false_alarm)
        return EstimationResult(
            "reestimation",
            (test,),
            PARAMETERS,
            monitor.monitored,
            "Wald statistic, chi-square with 1 degree of freedom",
            wald.wald,
            rejected & (test.alarm & found.converged)[:, None],
            found.converged,
            wald.estimate,
            np.sqrt(wald.variance),
        )
