"""Innovations of a filter and their tests, calibrated on an engine whose parameters stay at nominal.

A filter expects its parameters to wander; those of a healthy engine do not. So its innovations are a little too
small and a little correlated, and textbook thresholds would be off. Alongside the filter run the error of its
state on a healthy engine, E = cov(x̂ − ε), A = cov(x̂ − ε, ε), ε ~ N(0, C) the uncertainty of nominal,

    E ← (1 − K H) E (1 − K H)ᵀ + K R Kᵀ,    A ← (1 − K H) A,    cov(ν_k) = S⁰ = R + H E Hᵀ,
    cov(ν_k, ν_{k−l}) = −H D_l,    D_1 = K R − (1 − K H) E Hᵀ,    D_{l+1} = (1 − K H) D_l,

and the tests use what these say. When C = P_0 and Q = 0 they are the textbook tests. Box, G. E. P. (1954) Ann.
Math. Statist. 25, 290–302 (quadratic forms as g χ²_h); Hosking, J. R. M. (1980) JASA 75, 602–608 (portmanteau).
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from enginediag_cli.methods.verdicts import DetectionTest, chi_square_test
from enginediag_cli.residuals.excitation import RANK_TOLERANCE

NO_VARIANCE = 1e-300
"""Least variance that is divided by: of a state that is known for certain, which then counts as unmoved."""


@dataclass(frozen=True)
class Past:
    """An earlier innovation: D (W, p, m) = cov(present state error, it), its whitener (W, m, m), itself whitened
    (W, m), and which sensors were there (W, m)."""

    D: np.ndarray
    whitener: np.ndarray
    tilde: np.ndarray
    present: np.ndarray


@dataclass(frozen=True)
class Healthy:
    """E, A (W, p, p), C (p, p) and the latest innovations, newest first, as many as there are lags."""

    E: np.ndarray
    A: np.ndarray
    C: np.ndarray
    past: tuple[Past, ...]
    lags: int

    @classmethod
    def start(cls, C: np.ndarray, windows: int, lags: int) -> Healthy:
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

    def add(self, k: int, new: Innovation, healthy: Healthy) -> Healthy:
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
        past = (Past(KR - left @ EH, whitener, tilde, present), *older)
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
