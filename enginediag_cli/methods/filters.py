"""Kalman filters as methods: observers of the parameters, and tests of their innovations.

Tests, calibrated on an engine whose parameters stay at nominal. A filter expects its parameters to wander; those of a
healthy engine do not. So its innovations are a little too small and a little correlated, and textbook thresholds would
be off. Alongside the filter run the error of its state on a healthy engine, E = cov(x̂ − ε), A = cov(x̂ − ε, ε), ε ~
N(0, C) the uncertainty of nominal,

    E ← (1 − K H) E (1 − K H)ᵀ + K R Kᵀ,    A ← (1 − K H) A,    cov(ν_k) = S⁰ = R + H E Hᵀ,
    cov(ν_k, ν_{k−l}) = −H D_l,    D_1 = K R − (1 − K H) E Hᵀ,    D_{l+1} = (1 − K H) D_l,

and the tests use what these say. When C = P_0 and Q = 0 they are the textbook tests. Box, G. E. P. (1954) Ann.
Math. Statist. 25, 290–302 (quadratic forms as g χ²_h); Hosking, J. R. M. (1980) JASA 75, 602–608 (portmanteau).

Observers: parameters as random-walk states, measured through the engine, filtered record by record.

    x_k = x_{k−1} + w_k,  w ~ N(0, Q)          y_k = Φ(u_k, θ0 + D x_k) + v_k,  v ~ N(0, R)      (D: prior sigmas)

The engine is a static map, so the parameters are the only states (paper, section 4.2). Nuisance parameters are
constant states of the covariance that identification left them. A filter starts at nominal with covariance
P_0 = C + initial²; over a window of n records its parameters may wander `walk` prior standard deviations.

    innovation  ν = y − ŷ,  S = H P Hᵀ + R,  K = P Hᵀ S⁻¹,  x ← x + K ν,  P ← (1 − K H) P (1 − K H)ᵀ + K R Kᵀ

How H P Hᵀ and P Hᵀ are found distinguishes the extended from the unscented filter. All windows advance
together, one record at a time. Tests: see `innovation_tests`.
Jazwinski, A. H. (1970) Stochastic Processes and Filtering Theory; Mehra, R. K. and Peschon, J. (1971)
Automatica 7, 637–640 (innovations for fault detection).

Extended Kalman filter: the engine linearised at the present estimate, H = ∂Φ/∂θ there.

Unscented Kalman filter: the engine computed at 2p + 1 points around the estimate instead of linearised.

Scaled transform, λ = α²(p + κ) − p, points x and x ± columns of √((p + λ) P), weights

    w_0^mean = λ/(p + λ),   w_0^cov = w_0^mean + 1 − α² + β,   w_i = 1/(2(p + λ)).

All points of all windows go to the engine in one call per record. Julier, S. J. and Uhlmann, J. K. (2004) Proc.
IEEE 92, 401–422; Wan, E. A. and van der Merwe, R. (2000) Proc. IEEE AS-SPCC, 153–158.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import ClassVar

import numpy as np

from enginediag_cli.config.fields import Field
from enginediag_cli.methods.base import (
    PARAMETERS,
    DetectionTest,
    Method,
    RecordWindows,
    Verdicts,
    chi_square_test,
)
from enginediag_cli.methods.estimation import holm
from enginediag_cli.residuals.monitor import Monitor
from enginediag_cli.residuals.statistics import RANK_TOLERANCE

NO_VARIANCE = 1e-300
"""Least variance that is divided by: of a state that is known for certain, which then counts as unmoved."""


@dataclass(frozen=True)
class PastInnovation:
    """An earlier innovation: D (W, p, m) = cov(present state error, it), its whitener (W, m, m), itself whitened
    (W, m), and which sensors were there (W, m)."""

    D: np.ndarray
    whitener: np.ndarray
    tilde: np.ndarray
    present: np.ndarray


@dataclass(frozen=True)
class HealthyError:
    """E, A (W, p, p), C (p, p) and the latest innovations, newest first, as many as there are lags."""

    E: np.ndarray
    A: np.ndarray
    C: np.ndarray
    past: tuple[PastInnovation, ...]
    lags: int

    @classmethod
    def start(cls, C: np.ndarray, windows: int, lags: int) -> HealthyError:
        every = np.tile(C, (windows, 1, 1))
        return cls(every, -every, C, (), lags)

    def state_covariance(self) -> np.ndarray:
        """Covariance (W, p, p) of the filter's state when nothing changed: E + A + Aᵀ + C."""
        return np.asarray(self.E + self.A + np.swapaxes(self.A, 1, 2) + self.C)


@dataclass(frozen=True)
class Innovation:
    """Of one record of every window: ν (W, m) of covariance S (W, m, m), sensitivities H (W, m, p), noise R (W, m, m),
    gain K (W, p, m), and which sensors are there (W, m)."""

    nu: np.ndarray
    S: np.ndarray
    H: np.ndarray
    R: np.ndarray
    K: np.ndarray
    present: np.ndarray


@dataclass
class InnovationRecord:
    """Per record: nis (W, n) = νᵀS⁻¹ν with mean and variance on a healthy engine; per lag and sensor the sum of
    products of whitened innovations less their healthy mean `product` (W, L, m), and its variance; per sensor the
    sum of squares `power` (W, m) of whitened innovations and their number `count` (W, m)."""

    nis: np.ndarray
    mean: np.ndarray
    variance: np.ndarray
    product: np.ndarray
    product_variance: np.ndarray
    power: np.ndarray
    count: np.ndarray

    @classmethod
    def empty(cls, W: int, n: int, m: int, lags: int) -> InnovationRecord:
        shapes = [(W, n)] * 3 + [(W, lags, m)] * 2 + [(W, m)] * 2
        return cls(*(np.zeros(shape) for shape in shapes))

    def add(self, k: int, new: Innovation, healthy: HealthyError) -> HealthyError:
        """Take in the innovation of record k and move the healthy error on."""
        nu, S, H, R, K, present = new.nu, new.S, new.H, new.R, new.K, new.present
        EH = healthy.E @ np.swapaxes(H, 1, 2)
        expected = R + H @ EH  # S⁰
        M = np.linalg.solve(S, expected)
        absent = (~present).sum(axis=1)
        self.nis[:, k] = np.sum(nu * np.linalg.solve(S, nu[:, :, None])[:, :, 0], axis=1)
        self.mean[:, k] = np.einsum("wii->w", M) - absent
        self.variance[:, k] = 2 * (np.einsum("wij,wji->w", M, M) - absent)
        whitener = np.linalg.inv(np.linalg.cholesky(expected))
        tilde = np.einsum("wij,wj->wi", whitener, nu)
        self.power += np.where(present, tilde**2, 0.0)
        self.count += present
        for lag, before in enumerate(healthy.past):
            mean = -np.einsum("wij,wij->wi", whitener @ H @ before.D, before.whitener)
            usable = present & before.present
            self.product[:, lag] += np.where(usable, tilde * before.tilde - mean, 0.0)
            self.product_variance[:, lag] += np.where(usable, 1 + mean**2, 0.0)
        left = np.eye(H.shape[2]) - K @ H
        KR = K @ R
        older = tuple(replace(before, D=left @ before.D) for before in healthy.past[: healthy.lags - 1])
        past = (PastInnovation(KR - left @ EH, whitener, tilde, present), *older)
        E = left @ healthy.E @ np.swapaxes(left, 1, 2) + KR @ np.swapaxes(K, 1, 2)
        return replace(healthy, E=E, A=left @ healthy.A, past=past)


def innovation_tests(record: InnovationRecord, lags: int, false_alarm: float) -> tuple[DetectionTest, DetectionTest]:
    """χ² test of the sum of normalised innovations squared, and whiteness test over `lags` lags.

    nis        Σ νᵀS⁻¹ν / g ~ χ²(h),   g = variance/(2 mean),  h = 2 mean²/variance   (healthy moments)
    whiteness  Σ_l Σ_j (Σ_k ν̃_kj ν̃_{k−l,j} − healthy mean)² / variance · n (n + 2)/(Σ_k ν̃_kj²)²
               ~ χ²(lags · sensors),  ν̃ = (S⁰)^-½ ν

    The last factor is the small-sample form of Ljung, G. M. and Box, G. E. P. (1978) Biometrika 65, 297–303.
    """
    mean, variance = record.mean.sum(axis=1), record.variance.sum(axis=1)
    usable = mean > 0
    g = np.where(usable, variance / np.where(usable, 2 * mean, 1.0), 1.0)
    h = np.where(usable, 2 * mean**2 / np.where(usable, variance, 1.0), 0.0)
    nis = chi_square_test("nis", record.nis.sum(axis=1) / g, h, false_alarm)
    heard = record.product_variance > 0
    ratio = np.where(heard, record.product**2 / np.where(heard, record.product_variance, 1.0), 0.0)
    power = np.where(record.power > 0, record.power, 1.0)
    ratio = ratio * (record.count * (record.count + 2) / power**2)[:, None]
    white = chi_square_test("whiteness", ratio.sum(axis=(1, 2)), heard.sum(axis=(1, 2)), false_alarm)
    return nis, white


def final_state_test(x: np.ndarray, covariance: np.ndarray, false_alarm: float) -> DetectionTest:
    """Joint Wald test of the final state x (W, p) against nominal: xᵀ cov⁺ x ~ χ²(rank)."""
    size = np.sqrt(np.maximum(np.einsum("wii->wi", covariance), NO_VARIANCE))
    eigenvalues, U = np.linalg.eigh(covariance / size[:, :, None] / size[:, None, :])
    kept = eigenvalues > RANK_TOLERANCE * np.maximum(eigenvalues[:, -1:], 0.0)
    v = np.einsum("wpi,wp->wi", U, x / size)
    statistic = np.sum(np.where(kept, v**2 / np.where(kept, eigenvalues, 1.0), 0.0), axis=1)
    return chi_square_test("state", statistic, kept.sum(axis=1), false_alarm)


TESTS = ("nis", "whiteness", "state")
OBSERVER_OPTIONS = (
    Field("walk", "number", "how far parameters may wander in a window, in prior deviations", 0.1, minimum=0.0),
    Field("initial", "number", "how far they may be off at its start, in prior deviations", 0.0, minimum=0.0),
    Field("lags", "integer", "lags of the whiteness test", 3, minimum=1),
    Field("tests", "texts", "which tests may raise the alarm: nis, whiteness, state", TESTS),
)


@dataclass(frozen=True)
class Linearisation:
    """A record of every window seen from the filter's state, readings in units of their noise.

    mean (W, m); spread (W, m, m) = H P Hᵀ; cross (W, p, m) = P Hᵀ; H (W, m, p); ok (W,).
    """

    mean: np.ndarray
    covariance: np.ndarray
    cross: np.ndarray
    H: np.ndarray
    ok: np.ndarray


@dataclass(frozen=True)
class PreviousRecord:
    """The record before, about the state x (W, p) of that time: y (W, m), H (W, m, p), weight c = ρ (W, m).

    Noise of lag-1 correlation ρ is whitened by subtracting ρ times the record before, carried linearly to
    the present state; c is zero where either reading is missing.
    """

    x: np.ndarray
    y: np.ndarray
    H: np.ndarray
    c: np.ndarray

    def correlated_part(self, points: np.ndarray) -> np.ndarray:
        """c · (ŷ of the record before) at the states points (W, q, p) -> (W, q, m)."""
        moved = (points - self.x[:, None]) @ np.swapaxes(self.H, 1, 2)
        return np.asarray(self.c[:, None] * (self.y[:, None] + moved))


@dataclass(frozen=True)
class ObserverResult(Verdicts):
    """Adds the trajectories of the monitored parameters (W, n, p) with their standard deviations, in their units,
    and the normalised innovations squared of every record (W, n)."""

    trajectory: np.ndarray
    deviation: np.ndarray
    nis: np.ndarray


@dataclass(frozen=True)
class Observer(Method, ABC):
    """Common to the filters. walk, initial: tuning in prior standard deviations; lags of the whiteness test.

    tests: which of "nis", "whiteness" and "state" may raise the alarm; they share its false-alarm probability.
    """

    OPTIONS: ClassVar[tuple[Field, ...]] = OBSERVER_OPTIONS
    walk: float = 0.1
    initial: float = 0.0
    lags: int = 3
    tests: tuple[str, ...] = TESTS

    @property
    def wrong_choice(self) -> str:
        if not (self.walk >= 0 and self.initial >= 0 and self.walk + self.initial > 0):
            return "`walk` and `initial` must not be negative, and one of them must be positive"
        if not self.tests or set(self.tests) - set(TESTS):
            return f"`tests` must be among {', '.join(TESTS)}"
        return "" if self.lags >= 1 else "`lags` must be at least 1"

    @abstractmethod
    def linearise(
        self, model: ScaledModel, x: np.ndarray, P: np.ndarray, k: int, earlier: PreviousRecord
    ) -> Linearisation:
        """Record k of every window seen from the states x (W, p) of covariance P (W, p, p)."""

    def diagnose(self, monitor: Monitor, windows: RecordWindows, false_alarm: float) -> ObserverResult:
        from scipy.stats import chi2

        a, scale = len(monitor.monitored), monitor.prior_sigma
        record, x, P, healthy, path, spread = self._filter(monitor, windows)
        level = false_alarm / len(self.tests)
        tests = {test.name: test for test in innovation_tests(record, self.lags, level)}
        tests["state"] = final_state_test(x[:, :a], healthy.state_covariance()[:, :a, :a], level)
        wald = x[:, :a] ** 2 / np.maximum(np.einsum("wii->wi", P)[:, :a], NO_VARIANCE)
        chosen = tuple(tests[name] for name in self.tests)
        alarm = np.asarray(np.any([test.alarm for test in chosen], axis=0))
        return ObserverResult(
            self.name,
            chosen,
            PARAMETERS,
            monitor.monitored,
            "Wald statistic of the final state, chi-square with 1 degree of freedom",
            wald,
            holm(chi2.sf(wald, 1), false_alarm) & alarm[:, None],
            np.ones(windows.count, bool),
            monitor.theta0[:a] + scale[:a] * path,
            scale[:a] * spread,
            record.nis,
        )

    def _filter(
        self, monitor: Monitor, windows: RecordWindows
    ) -> tuple[InnovationRecord, np.ndarray, np.ndarray, HealthyError, np.ndarray, np.ndarray]:
        """Innovations of all records, final state (W, p) and covariance, and the path of the monitored states."""
        W, n, m = windows.y.shape
        a, p, scale = len(monitor.monitored), len(monitor.names), monitor.prior_sigma
        C = monitor.uncertainty / scale / scale[:, None]
        own = np.arange(p) < a
        ends = windows.ends
        Q = np.where(own, self.walk**2, 0.0) / np.maximum(ends, 1)[:, None]
        x, P = np.zeros((W, p)), np.tile(C + np.diag(np.where(own, self.initial**2, 0.0)), (W, 1, 1))
        healthy = HealthyError.start(C, W, self.lags)
        model, readings = ScaledModel(monitor, windows.inputs), windows.y / monitor.noise.sigma
        correlation = _sensor_correlation(monitor)
        record = InnovationRecord.empty(W, n, m, self.lags)
        path, spread, diagonal = np.zeros((W, n, a)), np.zeros((W, n, a)), np.arange(p)
        earlier = PreviousRecord(x, np.zeros((W, m)), np.zeros((W, m, p)), np.zeros((W, m)))
        before, earlier_reading = np.zeros((W, m), bool), np.zeros((W, m))
        for k in range(n):
            # what fills a window up is no time in which anything could have wandered
            P[:, diagonal, diagonal] += np.where((k < ends)[:, None], Q, 0.0)
            present = np.isfinite(readings[:, k])
            c = np.where(present & before, monitor.noise.rho, 0.0)
            earlier = PreviousRecord(earlier.x, earlier.y, earlier.H, c)
            seen = self.linearise(model, x, P, k, earlier)
            present = present & seen.ok[:, None]
            reading = np.where(present, readings[:, k], 0.0)
            nu = np.where(present, reading - c * earlier_reading - seen.mean, 0.0)
            both = present[:, :, None] & present[:, None, :]
            H = np.where(present[:, :, None], seen.H, 0.0)
            R = np.where(both, correlation, 0.0) + np.einsum("wi,ij->wij", ~present * 1.0, np.eye(m))
            R = R - np.einsum("wi,ij->wij", c**2 * present, np.eye(m))
            S = np.where(both, seen.covariance, 0.0) + R
            K = np.swapaxes(np.linalg.solve(S, np.swapaxes(np.where(present[:, None], seen.cross, 0.0), 1, 2)), 1, 2)
            healthy = record.add(k, Innovation(nu, S, H, R, K, present), healthy)
            # the record itself, without the share of the one before, is what the next one looks back to
            own_H = seen.H + c[:, :, None] * earlier.H
            own_y = seen.mean + earlier.correlated_part(x[:, None])[:, 0]
            earlier, earlier_reading, before = PreviousRecord(x, own_y, own_H, c), reading, present
            x = x + np.einsum("wpm,wm->wp", K, nu)
            P = P - K @ S @ np.swapaxes(K, 1, 2)
            P = (P + np.swapaxes(P, 1, 2)) / 2
            path[:, k], spread[:, k] = x[:, :a], np.sqrt(np.maximum(np.einsum("wii->wi", P)[:, :a], 0.0))
        return record, x, P, healthy, path, spread


@dataclass(frozen=True)
class ScaledModel:
    """The engine with states in prior standard deviations and readings in units of their noise."""

    monitor: Monitor
    inputs: Mapping[str, np.ndarray]

    def __call__(self, x: np.ndarray, k: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """y (W, m), H (W, m, p), ok (W,) at the states x (W, p) for record k of every window."""
        monitor = self.monitor
        y, J, ok, _ = monitor.predict({c: v[:, k] for c, v in self.inputs.items()}, self._theta(x))
        H = J * (monitor.prior_sigma / monitor.noise.sigma[:, None])
        return np.where(ok[:, None], y / monitor.noise.sigma, 0.0), np.where(ok[:, None, None], H, 0.0), ok

    def outputs(self, x: np.ndarray, k: int) -> tuple[np.ndarray, np.ndarray]:
        """y (W, q, m) at q states per window x (W, q, p), and ok (W,) where all of them can be computed."""
        W, q, p = x.shape
        blind = replace(self.monitor, monitored=())  # no sensitivities: the engine is asked for outputs only
        inputs = {c: np.repeat(v[:, k], q) for c, v in self.inputs.items()}
        y, _, computed, _ = blind.predict(inputs, self._theta(x.reshape(-1, p)), nuisance=False)
        ok = np.asarray(np.all(computed.reshape(W, q), axis=1))
        return np.where(ok[:, None, None], (y / self.monitor.noise.sigma).reshape(W, q, -1), 0.0), ok

    def _theta(self, x: np.ndarray) -> np.ndarray:
        theta = self.monitor.theta0 + self.monitor.prior_sigma * x
        return np.clip(theta, self.monitor.lower, self.monitor.upper)


def _sensor_correlation(monitor: Monitor) -> np.ndarray:
    """Correlation (m, m) between the noises of sensors at the same time, in units of sigma."""
    sigma, covariance = monitor.noise.sigma, monitor.noise.covariance
    return np.eye(len(sigma)) if covariance is None else covariance / sigma / sigma[:, None]


@dataclass(frozen=True)
class ExtendedKalman(Observer):
    """Observer with exact sensitivities of the engine. On a linear engine it is recursive least squares."""

    HELP: ClassVar[str] = "Kalman filter with the parameters as states, linearised by the engine's sensitivities"

    @property
    def name(self) -> str:
        return "extended_kalman"

    def linearise(
        self, model: ScaledModel, x: np.ndarray, P: np.ndarray, k: int, earlier: PreviousRecord
    ) -> Linearisation:
        y, H, ok = model(x, k)
        mean = y - earlier.correlated_part(x[:, None])[:, 0]
        H = H - earlier.c[:, :, None] * earlier.H
        cross = P @ np.swapaxes(H, 1, 2)
        return Linearisation(mean, H @ cross, cross, H, ok)


JITTER = 1e-12
"""Added to the diagonal of P (in prior variances) for its square root, where a constant state is certain."""


@dataclass(frozen=True)
class UnscentedKalman(Observer):
    """Observer by sigma points; `alpha`, `beta`, `kappa` as in the scaled transform.

    A small alpha divides differences of the engine's outputs by a small number; 1 keeps them well above its
    solver's tolerance.
    """

    HELP: ClassVar[str] = "Kalman filter with the parameters as states, by sigma points of the engine"
    OPTIONS: ClassVar[tuple[Field, ...]] = (
        *OBSERVER_OPTIONS,
        Field("alpha", "number", "reach of the sigma points", 1.0, minimum=1e-3),
        Field("beta", "number", "weight of the centre in covariances", 2.0),
        Field("kappa", "number", "further reach of the sigma points", 0.0),
    )
    alpha: float = 1.0
    beta: float = 2.0
    kappa: float = 0.0

    @property
    def name(self) -> str:
        return "unscented_kalman"

    def linearise(
        self, model: ScaledModel, x: np.ndarray, P: np.ndarray, k: int, earlier: PreviousRecord
    ) -> Linearisation:
        p = x.shape[1]
        reach = self.alpha**2 * (p + self.kappa)  # p + λ
        if not reach > 0:
            raise ValueError("`alpha` and p + `kappa` must be positive")
        root = np.linalg.cholesky(P + JITTER * np.eye(p))
        steps = np.sqrt(reach) * np.swapaxes(root, 1, 2)
        points = x[:, None] + np.concatenate([np.zeros_like(steps[:, :1]), steps, -steps], axis=1)
        y, ok = model.outputs(points, k)
        y = y - earlier.correlated_part(points)
        w = np.full(2 * p + 1, 1 / (2 * reach))
        w_mean, w_cov = w.copy(), w
        w_mean[0] = 1 - p / reach
        w_cov[0] = w_mean[0] + 1 - self.alpha**2 + self.beta
        mean = np.einsum("i,wim->wm", w_mean, y)
        deviation = y - mean[:, None]
        spread = np.einsum("i,wim,win->wmn", w_cov, deviation, deviation)
        cross = np.einsum("i,wip,wim->wpm", w_cov, points - x[:, None], deviation)
        # statistical linearisation: the H for which P Hᵀ is this cross-covariance
        H = np.swapaxes(np.linalg.solve(P + JITTER * np.eye(p), cross), 1, 2)
        return Linearisation(mean, spread, cross, H, ok)
