"""Methods that test residuals: parity equations, plain and structured, and principal component analysis.

Parity equations, eqs. (3) and (4): r = H(Y, U) = Y − Φ(U, θ0), the prediction error, as it is.

Under "nothing changed" the whitened r is N(0, 1 + G C Gᵀ), C the uncertainty of θ0. Two χ² tests:

    mean      z̄ᵀ (1 + Ḡ C Ḡᵀ)⁻¹ z̄ ~ χ²(m)     z̄_j = Σ_k z_kj/√n_j,  Ḡ_j = Σ_k G_kj/√n_j
    records   zᵀ (1 + G C Gᵀ)⁻¹ z ~ χ²(n m)

The mean sees small lasting changes, all records see any misfit. They do not isolate: the
prediction error alone does not show the parameter (paper, section 4.1).

Filtered parity equations: residuals made blind to chosen parameters by orthogonal projection.

    r_S = (1 − G_S G_S⁺) z          |r_S|² = z·z − s_Sᵀ F_SS⁺ s_S ~ χ²(N − |S|) whatever S did, if the rest is nominal

The fault signature of S is then: r_S silent while the residuals blind to fewer parameters still ring. Isolation
goes through sets of growing size and stops at the first size that has a silent residual, naming the most silent
set. Gertler, J. and Singer, D. (1990) Automatica 26, 381–388 (structured residuals); Chow, E. Y. and Willsky,
A. S. (1984) IEEE Trans. Automatic Control 29, 603–614 (orthogonal projection).

On window means N is the number of sensors, so that sets larger than N − 1 leave nothing to hear.

Principal component analysis: a linear model of healthy data, learned, and two distances from it.

Records x (inputs and outputs, or residuals of the model), centred and scaled, split by the loadings P_A of the A
largest components of their correlation matrix (principal component subspace, PCS) and the rest (residual subspace, RS):

    x̂ = C x,  C = P_A P_Aᵀ (paper, section 4.3)      T² = n t̄ᵀ Λ⁻¹ t̄,  t̄ = P_Aᵀ x̄      SPE = n |(1 − C) x̄|²

of the mean x̄ of a window of n records (n = 1: of a record). Λ and the covariance of √n (1 − C) x̄ are those of the
means of the healthy windows, which counts whatever correlation in time the data have; when there are too few of
them, of pieces of them, which counts only what is shorter than a piece. Thresholds, w healthy windows:

    T²   A (w² − 1)/(w (w − A)) F(A, w − A)                                    (Hotelling, for a new observation)
    SPE  θ_1 [c √(2 θ_2 h²)/θ_1 + 1 + θ_2 h (h − 1)/θ_1²]^(1/h)                 (Jackson and Mudholkar)
      or g χ²_h, g = θ_2/θ_1, h = θ_1²/θ_2                                      (Box)

θ_i = Σ λ^i over the RS, h = 1 − 2 θ_1 θ_3/(3 θ_2²). Jackson, J. E. and Mudholkar, G. S. (1979) Technometrics 21,
341–349; Box, G. E. P. (1954) Ann. Math. Statist. 25, 290–302; Kourti, T. and MacGregor, J. F. (1996) J. Quality
Technology 28, 409–428 (contributions). The isolated one is the largest contribution to the statistic that exceeds
its limit the most: it names a column of the data, a *sensor* or input, never a parameter of the engine.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations
from typing import ClassVar

import numpy as np

from enginediag_cli.config.fields import Field
from enginediag_cli.errors import DataError
from enginediag_cli.methods.base import (
    NOTHING,
    PARAMETERS,
    SENSORS,
    DetectionTest,
    FittedMethod,
    Method,
    RecordWindows,
    Verdicts,
    chi_square_test,
)
from enginediag_cli.methods.estimation import ResidualSums, nominal_residuals, residual_sums, white_residuals
from enginediag_cli.residuals.monitor import Monitor
from enginediag_cli.residuals.statistics import RANK_TOLERANCE

REDUCTIONS = ("mean", "records")


def reduced_sums(monitor: Monitor, windows: RecordWindows, reduction: str) -> ResidualSums:
    """Sums of the monitored parameters, over the window's mean residual per sensor or over all records."""
    if reduction not in REDUCTIONS:
        raise ValueError(f"`reduction` must be one of {', '.join(REDUCTIONS)}, not {reduction!r}")
    e, J = nominal_residuals(monitor, windows)
    if reduction == "records":
        sums = residual_sums(e, J, monitor)
    else:
        z, G, present = white_residuals(e, J, monitor.noise)
        count = present.sum(axis=1)
        weight = 1 / np.sqrt(np.maximum(count, 1))
        mean, sensitivity = z.sum(axis=1) * weight, G.sum(axis=1) * weight[..., None]
        turned = np.swapaxes(sensitivity, 1, 2)
        sums = ResidualSums(
            np.sum(mean**2, axis=1),
            (turned @ mean[:, :, None])[:, :, 0],
            turned @ sensitivity,
            (count > 0).sum(axis=1).astype(float),
        )
    return sums.add_uncertainty(monitor.uncertainty, len(monitor.monitored))


@dataclass(frozen=True)
class PredictionError(Method):
    """The prediction error as residual; `reduction`: test its mean over the window, or all records."""

    HELP: ClassVar[str] = "the prediction error at nominal, as parity equations: its mean, or all records"
    reduction: str = "mean"

    @property
    def name(self) -> str:
        return "parity" if self.reduction == "mean" else f"parity_{self.reduction}"

    @property
    def tests(self) -> tuple[str, ...]:
        return (self.reduction,)

    def diagnose(self, monitor: Monitor, windows: RecordWindows, false_alarm: float) -> Verdicts:
        sums = reduced_sums(monitor, windows, self.reduction)
        test = chi_square_test(self.reduction, sums.zz, sums.dof, false_alarm)
        return Verdicts(
            self.name,
            (test,),
            NOTHING,
            (),
            "",
            np.zeros((windows.count, 0)),
            None,
            np.ones(windows.count, bool),
        )


@dataclass(frozen=True)
class StructuredParity(Method):
    """Structured residuals; `largest`: how many parameters a set may hold; `reduction` as in `PredictionError`."""

    HELP: ClassVar[str] = "filtered parity equations: residuals made blind to some parameters name them"
    OPTIONS: ClassVar[tuple[Field, ...]] = (
        Field("reduction", "choice", "test the mean of each sensor, or all records", "mean", choices=REDUCTIONS),
        Field("largest", "integer", "largest number of parameters that it names", 4, minimum=1),
    )
    reduction: str = "mean"
    largest: int = 4

    @property
    def name(self) -> str:
        return "parity_filtered"

    @property
    def tests(self) -> tuple[str, ...]:
        return (self.reduction,)

    def diagnose(self, monitor: Monitor, windows: RecordWindows, false_alarm: float) -> Verdicts:
        sums = reduced_sums(monitor, windows, self.reduction)
        p = len(monitor.monitored)
        scale = monitor.prior_sigma[:p]
        test = chi_square_test(self.reduction, sums.zz, sums.dof, false_alarm)
        evidence = np.full((windows.count, p), np.nan)
        isolated = np.zeros((windows.count, p), bool)
        open_windows = test.alarm
        for size in range(1, min(self.largest, p) + 1):
            rows = np.arange(windows.count) if size == 1 else np.flatnonzero(open_windows)
            sets = list(combinations(range(p), size))
            silence = _silence(_rows(sums, rows), sets, scale)
            if size == 1:
                evidence = silence
            best = np.argmax(silence, axis=1)
            found = (silence[np.arange(len(rows)), best] > false_alarm) & open_windows[rows]
            for w in np.flatnonzero(found):
                isolated[rows[w], list(sets[best[w]])] = True
            open_windows[rows[found]] = False
            if not open_windows.any():
                break
        return Verdicts(
            "parity_filtered",
            (test,),
            PARAMETERS,
            monitor.monitored,
            "p value of the residual that is blind to this parameter: large where it alone explains all",
            evidence,
            isolated,
            np.ones(windows.count, bool),
        )


def decoupled(sums: ResidualSums, chosen: Sequence[int], scale: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """|r_S|² (W,) of the residual blind to the parameters `chosen`, and its degrees of freedom (W,)."""
    i = list(chosen)
    d = scale[i]
    eigenvalues, U = np.linalg.eigh(d[:, None] * sums.F[:, i][:, :, i] * d)
    largest = np.max(np.einsum("wii->wi", sums.F) * scale**2, axis=1, initial=0.0)
    kept = eigenvalues > RANK_TOLERANCE * largest[:, None]
    v = np.einsum("wpi,wp->wi", U, d * sums.s[:, i])
    explained = np.sum(np.where(kept, v**2 / np.where(kept, eigenvalues, 1.0), 0.0), axis=1)
    return np.maximum(sums.zz - explained, 0.0), sums.dof - kept.sum(axis=1)


def _rows(sums: ResidualSums, rows: np.ndarray) -> ResidualSums:
    return ResidualSums(sums.zz[rows], sums.s[rows], sums.F[rows], sums.dof[rows])


def _silence(sums: ResidualSums, sets: Sequence[tuple[int, ...]], scale: np.ndarray) -> np.ndarray:
    """p value (W, sets) of each decoupled residual; 0 where nothing is left to hear."""
    from scipy.stats import chi2

    silence = np.empty((len(sums.zz), len(sets)))
    for k, chosen in enumerate(sets):
        statistic, dof = decoupled(sums, chosen, scale)
        silence[:, k] = np.where(dof > 0, chi2.sf(statistic, np.maximum(dof, 1.0)), 0.0)
    return silence


DATA = ("raw", "corrected")
LIMITS = ("jackson_mudholkar", "box")
PIECES = 4
"""Means wanted per column to estimate their covariance; fewer healthy windows than that are cut into pieces."""
SHORTEST = 10
"""Records that a piece holds at least."""
STILL = 1e-12
"""Scatter of a column, relative to its mean, that is rounding: the column never changes."""
NULL_VARIANCE = 1e-9
"""Variance of a component, relative to the largest, that is rounding: the data do not vary in that direction."""


@dataclass(frozen=True)
class PrincipalComponents(Method):
    """data: "raw" inputs and outputs, or "corrected" for the operating condition by the model (residuals).

    explained: share of variance that the principal components hold, unless `components` says how many;
    spe_limit: "jackson_mudholkar" or "box".
    """

    HELP: ClassVar[str] = "principal components of healthy data, T² and SPE: raw, or corrected by the model"
    OPTIONS: ClassVar[tuple[Field, ...]] = (
        Field("explained", "number", "share of variance in the components", 0.9, minimum=1e-3, maximum=0.999),
        Field("components", "integer", "number of components, instead of a share", None, minimum=1),
        Field("spe_limit", "choice", "limit of SPE", "jackson_mudholkar", choices=LIMITS),
    )
    learns: ClassVar[bool] = True
    data: str = "raw"
    explained: float = 0.9
    components: int | None = None
    spe_limit: str = "jackson_mudholkar"

    @property
    def name(self) -> str:
        return f"pca_{self.data}"

    @property
    def tests(self) -> tuple[str, ...]:
        return ("T2", "SPE")

    def diagnose(self, monitor: Monitor, windows: RecordWindows, false_alarm: float) -> Verdicts:
        raise DataError("PCA learns from healthy windows, and none were given")

    def train(self, monitor: Monitor, healthy: RecordWindows | None = None) -> FittedPca:
        """Learn from healthy windows; DataError when there are too few of them, or records without a reading."""
        if self.data not in DATA or self.spe_limit not in LIMITS:
            raise ValueError(f"`data` must be one of {', '.join(DATA)}, `spe_limit` of {', '.join(LIMITS)}")
        if not 0 < self.explained < 1:
            raise ValueError("`explained` must lie between 0 and 1")
        if healthy is None:
            raise DataError("PCA learns from healthy windows, and none were given")
        columns, x = data_matrix(monitor, healthy, self.data)
        complete = np.all(np.isfinite(x), axis=2)
        rows = x[complete]
        d = len(columns)
        if len(rows) <= 2 * d:
            raise DataError(f"PCA of {d} columns needs more than {2 * d} complete healthy records, not {len(rows)}")
        centre, scale = rows.mean(axis=0), rows.std(axis=0, ddof=1)
        # a column that never changes has nothing to say: infinite scale makes it silent
        scale = np.where(scale > STILL * np.abs(centre), scale, np.inf)
        _, singular, P_t = np.linalg.svd((rows - centre) / scale, full_matrices=False)
        variance = singular**2 / (len(rows) - 1)
        share, rank = np.cumsum(variance) / variance.sum(), int(np.sum(variance > NULL_VARIANCE * variance[0]))
        A = self.components or min(int(np.searchsorted(share, self.explained)) + 1, rank - 1)
        if not 0 < A < rank:
            unfit = ValueError if self.components else DataError
            raise unfit(f"`components` must lie between 1 and {rank - 1}, not {A}: the data vary in {rank} directions")
        loadings = P_t[:A].T
        means, count = _means(_pieces(x, PIECES * d), centre, scale)
        used = count > 0
        v = (means * np.sqrt(count)[:, None])[used]
        w = len(v)
        if w <= d:
            raise DataError(f"PCA of {d} columns needs more than {d} healthy windows, not {w}")
        inner, outer = v @ loadings, v - v @ loadings @ loadings.T
        # 1 + 1/w: a new mean differs from the centre, which is a mean of w
        spectrum = np.linalg.eigvalsh(np.cov(outer, rowvar=False)) * (1 + 1 / w)
        return FittedPca(
            monitor,
            self,
            columns,
            centre,
            scale,
            loadings,
            variance,
            np.linalg.inv(np.atleast_2d(np.cov(inner, rowvar=False))),
            np.maximum(spectrum, 0.0),
            w,
        )


@dataclass(frozen=True)
class FittedPca(FittedMethod):
    """The principal component model: columns (d,), centre and scale (d,), loadings P_A (d, A), `variance` of all
    components (d,), inverse covariance (A, A) of √n t̄, eigenvalues of the RS part of √n x̄, healthy windows w."""

    method: PrincipalComponents
    columns: tuple[str, ...]
    centre: np.ndarray
    scale: np.ndarray
    loadings: np.ndarray
    variance: np.ndarray
    score_precision: np.ndarray
    residual_spectrum: np.ndarray
    windows: int

    def diagnose(self, windows: RecordWindows, false_alarm: float = 0.01) -> Verdicts:
        _, x = data_matrix(self.monitor, windows, self.method.data)
        means, count = _means(x, self.centre, self.scale)
        v = np.where(count[:, None] > 0, means * np.sqrt(count)[:, None], np.nan)
        tests = self.tests(v, false_alarm / 2)
        t_share, spe_share = self.contributions(v)
        worst = np.argmax([test.statistic / test.threshold for test in tests], axis=0)
        evidence = np.where(worst[:, None] == 0, t_share, spe_share)
        alarm = np.any([test.alarm for test in tests], axis=0)
        isolated = np.zeros(v.shape, bool)
        isolated[alarm, np.argmax(evidence[alarm], axis=1)] = True
        meaning = "contribution to the statistic that exceeds its limit most"
        every = np.ones(windows.count, bool)
        return Verdicts(self.method.name, tests, SENSORS, self.columns, meaning, evidence, isolated, every)

    def tests(self, v: np.ndarray, false_alarm: float) -> tuple[DetectionTest, DetectionTest]:
        """T² and SPE of scaled √n-fold means v (W, d), each at probability `false_alarm`."""
        t_squared, spe = self.distances(v)
        A, w = self.loadings.shape[1], self.windows
        f_scale = A * (w**2 - 1) / (w * (w - A))
        return (
            _f_test(t_squared, A, w - A, f_scale, false_alarm),
            _spe_test(spe, self.residual_spectrum, self.method.spe_limit, false_alarm),
        )

    def distances(self, v: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """T² (W,) in the PCS and SPE (W,) in the RS of v (W, d)."""
        t = v @ self.loadings
        rest = v - t @ self.loadings.T
        return np.einsum("wa,ab,wb->w", t, self.score_precision, t), np.sum(rest**2, axis=1)

    def contributions(self, v: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Parts of T² and of SPE (W, d) that each column brings; they sum to the statistics."""
        t = v @ self.loadings
        return v * (t @ self.score_precision @ self.loadings.T), (v - t @ self.loadings.T) ** 2


def data_matrix(monitor: Monitor, windows: RecordWindows, data: str) -> tuple[tuple[str, ...], np.ndarray]:
    """Columns (d,) and x (W, n, d): the inputs and the readings, or the residuals in units of their noise."""
    if data == "raw":
        columns = tuple(windows.inputs)
        x = np.stack([np.asarray(windows.inputs[c], float) for c in columns], axis=2)
        return (*columns, *monitor.sensors), np.concatenate([x, windows.y], axis=2)
    e, _ = nominal_residuals(monitor, windows)
    return monitor.sensors, e / monitor.noise.sigma


def _pieces(x: np.ndarray, wanted: int) -> np.ndarray:
    """x (W, n, d) as it is, or cut into equal pieces (W k, n // k, d) when there are fewer windows than `wanted`."""
    W, n, d = x.shape
    k = min(-(-wanted // max(W, 1)), n // SHORTEST)
    if k <= 1:
        return x
    return x[:, : k * (n // k)].reshape(W * k, n // k, d)


def _means(x: np.ndarray, centre: np.ndarray, scale: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Scaled means (W, d) of the complete records of x (W, n, d), and their number (W,)."""
    complete = np.all(np.isfinite(x), axis=2)
    count = complete.sum(axis=1)
    total = np.where(complete[:, :, None], (x - centre) / scale, 0.0).sum(axis=1)
    return total / np.maximum(count, 1)[:, None], count


def _f_test(t_squared: np.ndarray, A: int, left: int, scale: float, false_alarm: float) -> DetectionTest:
    from scipy.stats import f

    limit = scale * f.isf(false_alarm, A, left)
    p_value = f.sf(t_squared / scale, A, left)
    return _test("T2", t_squared, A, limit, p_value, false_alarm, "F, scaled")


def _spe_test(spe: np.ndarray, spectrum: np.ndarray, kind: str, false_alarm: float) -> DetectionTest:
    """SPE against Σ λ χ²_1 of the eigenvalues λ `spectrum`, by one of two approximations."""
    from scipy.stats import chi2, norm

    one, two, three = (float(np.sum(spectrum**i)) for i in (1, 2, 3))
    if kind == "box":
        g, h = two / one, one**2 / two
        return _test("SPE", spe, h, g * chi2.isf(false_alarm, h), chi2.sf(spe / g, h), false_alarm, "g chi-square(h)")
    h = 1 - 2 * one * three / (3 * two**2)
    mean, deviation = 1 + two * h * (h - 1) / one**2, np.sqrt(2 * two * h**2) / one
    if h <= 0:
        raise DataError("the Jackson and Mudholkar limit does not exist for this residual subspace; use Box's")
    limit = one * max(norm.isf(false_alarm) * deviation + mean, 0.0) ** (1 / h)
    p_value = norm.sf(((spe / one) ** h - mean) / deviation)
    return _test("SPE", spe, one**2 / two, limit, p_value, false_alarm, "Jackson-Mudholkar, normal power")


def _test(
    name: str, statistic: np.ndarray, dof: float, limit: float, p_value: np.ndarray, level: float, reference: str
) -> DetectionTest:
    every = np.ones_like(statistic)
    return DetectionTest(name, statistic, dof * every, limit * every, p_value, level, reference)
