"""The records of one window with the full model: the log likelihood of any change, and its expansion there.

Readings are weighed by their long-run noise as everywhere, and what is uncertain about nominal and the sensors,
x ~ N(0, C), acts linearly with the sensitivities J₀ at nominal, where identification left it. With z the whitened
residuals at the change δ, G and G₀ the whitened sensitivities of the monitored and of all parameters, C = R Rᵀ,

    ℓ(δ) = −½ [zᵀz − sᵀ K⁻¹ s],   s = Rᵀ G₀ᵀ z,   K = 1 + Rᵀ G₀ᵀ G₀ R
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from copy import copy
from dataclasses import dataclass, replace

import numpy as np

from enginediag_cli.residuals.instruments import weighed
from enginediag_cli.residuals.local import whiten
from enginediag_cli.residuals.monitor import Monitor
from enginediag_cli.residuals.root import root_of
from enginediag_cli.residuals.score import Score

MAX_POINTS = 20_000
"""Records times sets computed in one call of the engine."""
TOGETHER = 1_500
"""Records that are held against nominal together: sensitivities to two hundred parameters of each take 100 MB."""


@dataclass(frozen=True)
class Expansion:
    """ℓ relative to no change, its gradient (p,) and information (p, p) at one change of monitored parameters."""

    log_likelihood: float
    gradient: np.ndarray
    information: np.ndarray

    def score_about(self, template: Score, change: np.ndarray) -> tuple[Score, float]:
        """The expansion at `change` (p,) carried back to nominal: a score, and ℓ of it at nominal.

        ℓ(δ) ≈ offset + β·δ − ½ δᵀ I δ.
        """
        b = self.gradient + self.information @ change
        offset = self.log_likelihood - float(b @ change) + 0.5 * float(change @ self.information @ change)
        d = template.prior_sigma
        scaled, rhs = d[:, None] * self.information * d, d * b
        eigenvalues, vectors = np.linalg.eigh(scaled)
        kept = eigenvalues > 1e-9 * max(float(eigenvalues[-1]), 1e-300)
        glr = float(np.sum((rhs @ vectors[:, kept]) ** 2 / eigenvalues[kept]))
        rank = int(np.count_nonzero(kept))
        local = Score(template.parameters, template.theta0, d, b, self.information, glr, rank, meaning=template.meaning)
        return local, offset


class WindowModel:
    """Likelihood of one window's records; inputs: column -> (N,), y (N, m) with NaN where missing; start: unknowns
    (nx, N) of the engine at nominal, where they are known; weights (N, m, m): what multiplies readings and predictions
    where an instrument scatters.

    Records that the engine cannot compute at nominal are left out; a change at which it cannot compute another
    has log likelihood −inf.
    """

    def __init__(
        self,
        monitor: Monitor,
        inputs: Mapping[str, np.ndarray],
        y: np.ndarray,
        start: np.ndarray | None = None,
        weights: np.ndarray | None = None,
    ):
        self.monitor = monitor
        self.p = len(monitor.monitored)
        root = root_of(monitor.uncertainty, monitor.prior_sigma)
        parts = []
        for first in range(0, max(len(y), 1), TOGETHER):
            rows = slice(first, first + TOGETHER)
            here = {column: np.asarray(values)[rows] for column, values in inputs.items()}
            near = None if start is None else start[:, rows]
            predicted, J, ok, found = monitor.predict(here, monitor.theta0, start=near)
            # errors of the maps stay where nominal has the machines, whatever fault is tried
            known = {**here, **getattr(found, "frozen", {})}
            x = getattr(found, "x", None)  # unknowns of the engine, from which the solutions of changes are near
            readings, weight = y[rows][ok], None if weights is None else weights[rows][ok]
            z, G = whiten(weighed(weight, readings - predicted[ok]), weighed(weight, J[ok]), monitor.noise)
            parts.append(
                (
                    {column: np.asarray(values)[ok] for column, values in known.items()},
                    None if x is None else np.asarray(x)[:, ok],
                    readings,
                    z,
                    np.isfinite(readings) & np.all(np.isfinite(J[ok]), axis=2),
                    G.reshape(-1, G.shape[2]) @ root,
                    weight,
                )
            )
        of_inputs, starts, measured, residuals, present, doubt, weight_of = zip(*parts, strict=True)
        self._weights = None if weights is None else np.concatenate(weight_of)
        self.inputs = {column: np.concatenate([part[column] for part in of_inputs]) for column in of_inputs[0]}
        self._start = None if starts[0] is None else np.concatenate(starts, axis=1)
        self.y, z = np.concatenate(measured), np.concatenate(residuals)
        self._present, self._doubt = np.concatenate(present), np.concatenate(doubt)
        self._inner = np.eye(root.shape[1]) + self._doubt.T @ self._doubt
        self._noise = 1.0
        self._at_nominal = 0.0
        self._at_nominal = float(self._log_likelihood(z.reshape(1, -1))[0])

    def with_noise(self, factor: float) -> WindowModel:
        """The same where the variance of the noise is larger by this factor."""
        found = copy(self)
        found._noise = self._noise * factor
        return found

    @property
    def prior_sigma(self) -> np.ndarray:
        return self.monitor.prior_sigma[: self.p]

    @property
    def records(self) -> int:
        return len(self.y)

    def clipped(self, changes: np.ndarray) -> np.ndarray:
        """Changes (w, p) within the bounds of the parameters."""
        theta0 = self.monitor.theta0[: self.p]
        return np.asarray(
            np.clip(changes, self.monitor.lower[: self.p] - theta0, self.monitor.upper[: self.p] - theta0)
        )

    def log_likelihood(self, changes: np.ndarray) -> np.ndarray:
        """ℓ(δ) − ℓ(0) (w,) of changes (w, p); −inf where the engine cannot compute a record."""
        found = []
        values = replace(self.monitor, monitored=())  # whose predictions come without sensitivities
        for predicted, _, ok in self._predictions(values, changes):
            computed = ok.all(axis=1) & ~np.any(self._present & ~np.isfinite(predicted), axis=(1, 2))
            e = np.where(self._present, self.y - predicted, np.nan)
            if self._weights is not None:
                e = np.stack([weighed(self._weights, each) for each in e])
            z, _ = whiten(e.reshape(-1, e.shape[2]), np.zeros((e[..., 0].size, e.shape[2], 0)), self.monitor.noise)
            found.append(np.where(computed, self._log_likelihood(z.reshape(len(e), -1)), -np.inf))
        return np.concatenate(found) if found else np.zeros(0)

    def _log_likelihood(self, z: np.ndarray) -> np.ndarray:
        """ℓ − ℓ(0) (w,) of whitened residuals (w, n)."""
        s = z @ self._doubt
        known = np.sum(s * np.linalg.solve(self._inner, s.T).T, axis=1)
        return np.asarray(-0.5 * (np.sum(z**2, axis=1) - known) - self._at_nominal) / self._noise

    def expand(self, changes: np.ndarray) -> list[Expansion]:
        """Expansion about each of w changes (w, p)."""
        found: list[Expansion] = []
        for predicted, J, ok in self._predictions(self.monitor, changes):
            for k in range(len(predicted)):
                computed = np.isfinite(predicted[k]) & np.all(np.isfinite(J[k]), axis=2)
                if not np.all(ok[k]) or np.any(self._present & ~computed):  # fewer readings would fit better
                    nothing = np.full((self.p, self.p), np.nan)
                    found.append(Expansion(-np.inf, nothing[0], nothing))
                    continue
                e = np.where(self._present, self.y - predicted[k], np.nan)
                z, G = whiten(weighed(self._weights, e), weighed(self._weights, J[k]), self.monitor.noise)
                found.append(self._expansion(z, G))
        return found

    def _predictions(
        self, monitor: Monitor, changes: np.ndarray
    ) -> Iterator[tuple[np.ndarray, np.ndarray, np.ndarray]]:
        """Predictions (w, N, m), sensitivities (w, N, m, q) to the q that `monitor` watches and whether they could be
        computed (w, N) at changes (w, p), as many at a time as one call of the engine takes."""
        N, at_once = self.records, max(1, MAX_POINTS // max(self.records, 1))
        for first in range(0, len(changes), at_once):
            part = changes[first : first + at_once]
            theta = np.tile(self.monitor.theta0, (len(part), 1))
            theta[:, : self.p] += part
            inputs = {c: np.tile(values, len(part)) for c, values in self.inputs.items()}
            start = None if self._start is None else np.tile(self._start, len(part))
            predicted, J, ok, _ = monitor.predict(inputs, np.repeat(theta, N, axis=0), nuisance=False, start=start)
            q = len(monitor.monitored)
            shape = (len(part), N, predicted.shape[1])
            yield predicted.reshape(shape), J[:, :, :q].reshape(*shape, q), ok.reshape(len(part), N)

    def _expansion(self, z: np.ndarray, G: np.ndarray) -> Expansion:
        columns, residual = G.reshape(-1, self.p), z.ravel()
        s = self._doubt.T @ residual
        cross = self._doubt.T @ columns
        solved = np.linalg.solve(self._inner, np.column_stack([s, cross]))
        log_likelihood = -0.5 * float(residual @ residual - s @ solved[:, 0]) - self._at_nominal
        gradient = columns.T @ residual - cross.T @ solved[:, 0]
        information = columns.T @ columns - cross.T @ solved[:, 1:]
        return Expansion(log_likelihood / self._noise, gradient / self._noise, information / self._noise)
