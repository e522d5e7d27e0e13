"""Structured noise, and the marginal likelihood of readings under a hypothesis with the noise estimated anew.

In standard deviations that are stated, with Δt between records, d between their operating points:

    K_s = (floor² + w_s²/n) I + c_s² exp(−Δt/τ − d/λ) + o_s² M(d/λ_o)      per sensor s; n records pooled
    B   = b² Σ_l (SMALL scale_l)² g_l g_lᵀ ∘ (½ [same record] + ½ M(d/λ_o))  small errors at every place, many sensors
    C   = blockdiag(K_s) + B + X diag(κ²) Xᵀ                                   X: nuisance and candidates' columns

M is the Matérn correlation of order 3/2 (C. E. Rasmussen and C. K. I. Williams, Gaussian Processes for Machine
Learning (2006), equation 4.17). Without a clock the second term of K is c² [same flight]. The floor is the
instrument's own scatter: without it one sensor's noise may fall to nothing, and every jump is then significant.

With α = C⁻¹y, M = I + X′ᵀK⁻¹X′, X′ = X diag(κ), u = X′ᵀα (same source, equations 5.8 and 5.9),

    ∂ ln L/∂η = ½ (αᵀ ∂K α − tr C⁻¹∂K),      ∂ ln L/∂ ln κ_g = Σ_{j∈g} (u_j² + (M⁻¹)_jj − 1)
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np
from scipy import linalg, optimize

from enginediag_cli.discrepancy.linearised import LinearProblem

FLOOR = 0.5
"""Least white noise of an instrument, in stated standard deviations of a reading."""
SMALL = 0.05
"""Size of errors that every place has, over how far it may vary along a driver; times b."""
REACH_OF_PRIOR = 4.0
"""Standard deviations of their priors within which hyper-parameters are sought."""
NOISE_PRIORS = {
    True: {"w": (0.0, 0.3), "c": (0.0, 0.7), "o": (-0.7, 0.7)},
    False: {"w": (0.0, 0.15), "c": (-1.2, 0.5), "o": (-1.2, 0.5)},
}
"""Mean and standard deviation of ln size, in stated standard deviations: white, in time, over operating points; with
and without a clock."""
SHARED_PRIORS = {"tau": (4.6, 1.0), "lambda": (-0.7, 0.7), "lambda_o": (0.0, 0.6), "b": (1.1, 0.4)}
"""The same of ln time, 100 s; ln distance, 0.5 and 1 standard deviation of the operating points; ln size b."""
MAP_PRIOR, OWN_MAP_PRIOR = (0.0, 1.0), (0.0, 0.5)
"""ln size of all map errors over what is expected of them, and each machine's own deviation from that."""
ITERATIONS = 60
"""Of the search for hyper-parameters from one start."""


class MemberColumns(NamedTuple):
    """Further columns of a hypothesis: values (N, m, k) and the size of their amplitudes, standard normal when
    multiplied with it. `prior`: mean and standard deviation of ln size, None where `size` is fixed."""

    values: np.ndarray
    size: float
    prior: tuple[float, float] | None = None


@dataclass(frozen=True)
class NoisePoint:
    """Hyper-parameters by position, ln; `value`: ln marginal likelihood with their prior."""

    eta: np.ndarray
    value: float
    gradient: np.ndarray


class Whitened(NamedTuple):
    """C⁻¹ of one set of hyper-parameters, by rows (n, n), α (n,) and the sizes κ (p,) of all columns."""

    precision: np.ndarray
    alpha: np.ndarray
    sizes: np.ndarray


class StructuredNoise:
    """ln marginal likelihood of the readings as a function of hyper-parameters η, with its gradient.

    free_maps: groups of map errors whose own size is free, with a flat prior up to thirty times what is stated.
    """

    def __init__(self, problem: LinearProblem, members: Sequence[MemberColumns] = (), free_maps: Sequence[int] = ()):
        self.problem, self.members = problem, tuple(members)
        m = len(problem.sensors)
        # rows by sensor, so that each has one block
        self.sensor, self.record = (v.astype(int) for v in np.nonzero(problem.keep.T))
        self.y = problem.y[self.record, self.sensor]
        extra = [c.values[self.record, self.sensor] for c in self.members]
        self.X = np.concatenate([problem.X[self.record, self.sensor], *extra], axis=1)
        sizes = [len(problem.groups), *(c.shape[1] for c in extra)]
        self.member_of_column = np.repeat(np.arange(-1, len(extra)), sizes)
        self.blocks = [np.flatnonzero(self.sensor == s) for s in range(m)]
        # of the blocks of K
        self.rows = [np.arange(len(self.y))] if problem.coupled else self.blocks
        self.names, self.mean, self.sd = self._layout(free_maps)
        self.index = {n: k for k, n in enumerate(self.names)}

    def _layout(self, free_maps: Sequence[int]) -> tuple[tuple[str, ...], np.ndarray, np.ndarray]:
        problem = self.problem
        own = NOISE_PRIORS[problem.has_clock]
        priors: dict[str, tuple[float, float]] = {}
        for s in problem.sensors:
            priors |= {f"{kind}:{s}": prior for kind, prior in own.items()}
        shared = ["lambda_o"] + (["tau", "lambda"] if problem.has_clock else []) + (["b"] if problem.coupled else [])
        priors |= {n: SHARED_PRIORS[n] for n in shared}
        if problem.machines:
            priors["maps"] = MAP_PRIOR
            wide = (OWN_MAP_PRIOR[0] + 1.7, 1.7)
            priors |= {
                f"maps:{name}": wide if k in free_maps else OWN_MAP_PRIOR
                for k, name in enumerate(problem.machines, start=1)
            }
        priors |= {f"size:{k}": c.prior for k, c in enumerate(self.members) if c.prior is not None}
        mean, sd = np.array(list(priors.values())).T
        return tuple(priors), mean, sd

    @cached_property
    def _gaps(self) -> np.ndarray:
        """Elapsed time between records, s, infinite between flights; without a clock 0 within a flight, (N, N)."""
        p = self.problem
        same = (p.flight[:, None] == p.flight[None, :]) & (p.engine[:, None] == p.engine[None, :])
        time = p.time_s if p.has_clock else np.zeros(len(p))
        return np.where(same, np.abs(time[:, None] - time[None, :]), np.inf)

    @cached_property
    def _distances(self) -> np.ndarray:
        """Between operating points (N, N); infinite between engines."""
        z = self.problem.points
        square = (z**2).sum(axis=1)
        d = np.sqrt(np.maximum(square[:, None] + square[None, :] - 2.0 * z @ z.T, 0.0))
        np.fill_diagonal(d, 0.0)
        other = self.problem.engine[:, None] != self.problem.engine[None, :]
        return np.where(other, np.inf, d)

    @cached_property
    def _small_errors(self) -> np.ndarray:
        """Σ_l (SMALL scale_l)² g_l g_lᵀ (n, n)."""
        scale = SMALL * np.array([p.scale for p in self.problem.places])
        g = self.problem.G[self.record, self.sensor] * scale
        return np.asarray(g @ g.T)

    def _kernels(self, eta: np.ndarray) -> tuple[np.ndarray, np.ndarray, dict[str, np.ndarray]]:
        """Correlations in time (N, N), over operating points (N, N), and their derivatives by name of η."""
        at = self.index
        r = np.sqrt(3.0) * self._distances / np.exp(eta[at["lambda_o"]])
        decay = np.exp(-np.minimum(r, 700.0))
        far = np.isfinite(r)
        field = np.where(far, (1.0 + np.where(far, r, 0.0)) * decay, 0.0)
        slopes = {"lambda_o": np.where(far, np.where(far, r, 0.0) ** 2 * decay, 0.0)}
        if not self.problem.has_clock:
            return (self._gaps == 0.0).astype(float), field, slopes
        a, b = self._gaps / np.exp(eta[at["tau"]]), self._distances / np.exp(eta[at["lambda"]])
        here = np.isfinite(a) & np.isfinite(b)
        a, b = np.where(here, a, 0.0), np.where(here, b, 0.0)
        time = np.where(here, np.exp(-np.minimum(a + b, 700.0)), 0.0)
        slopes |= {"tau": time * a, "lambda": time * b}
        return time, field, slopes

    def column_sizes(self, eta: np.ndarray) -> np.ndarray:
        """κ of every column, (p,)."""
        at, sizes = self.index, np.ones(self.X.shape[1])
        groups = self.problem.groups
        nuisance = self.member_of_column < 0
        own = np.ones(len(groups))
        for k, name in enumerate(self.problem.machines, start=1):
            own[groups == k] = np.exp(eta[at["maps"]] + eta[at[f"maps:{name}"]])
        sizes[nuisance] = own
        for k, c in enumerate(self.members):
            sizes[self.member_of_column == k] = c.size if c.prior is None else np.exp(eta[at[f"size:{k}"]])
        return sizes

    def _covariance(
        self, eta: np.ndarray, kernels: tuple[np.ndarray, np.ndarray], background: np.ndarray | None
    ) -> list[np.ndarray]:
        """Blocks of K: one of each sensor, or a single one of all where they are coupled by the background."""
        at, (time, field) = self.index, kernels
        floor = FLOOR**2
        found = []
        for s, name in enumerate(self.problem.sensors):
            rows = self.record[self.blocks[s]]
            pick = np.ix_(rows, rows)
            K = np.exp(2.0 * eta[at[f"c:{name}"]]) * time[pick] + np.exp(2.0 * eta[at[f"o:{name}"]]) * field[pick]
            K[np.diag_indices(len(K))] += floor + np.exp(2.0 * eta[at[f"w:{name}"]]) / self.problem.count[rows]
            found.append(K)
        if background is None:
            return found
        whole = background.copy()
        for rows, K in zip(self.blocks, found, strict=True):
            whole[np.ix_(rows, rows)] += K
        return [whole]

    def _background(self, eta: np.ndarray, field: np.ndarray) -> np.ndarray | None:
        """Covariance (n, n) of the small errors of all places; None where sensors are not coupled."""
        if not self.problem.coupled:
            return None
        same = self.record[:, None] == self.record[None, :]
        shape = 0.5 * same + 0.5 * field[np.ix_(self.record, self.record)]
        return np.asarray(np.exp(2.0 * eta[self.index["b"]]) * (self._small_errors * shape))

    def evaluate(self, eta: np.ndarray) -> NoisePoint:
        """ln marginal likelihood with the prior of η, and its gradient; −∞ where K is not positive definite."""
        time, field, slopes = self._kernels(eta)
        background = self._background(eta, field)
        blocks = self._covariance(eta, (time, field), background)
        sizes = self.column_sizes(eta)
        X = self.X * sizes
        p = X.shape[1]
        M, lnL, inverses = np.eye(p), 0.0, []
        KX, Ky = np.empty_like(X), np.empty_like(self.y)
        for own, K in zip(self.rows, blocks, strict=True):
            inverse, half_det = _inverted(K)
            if inverse is None:
                return NoisePoint(eta, -np.inf, np.zeros_like(eta))
            inverses.append(inverse)
            KX[own], Ky[own] = inverse @ X[own], inverse @ self.y[own]
            M += X[own].T @ KX[own]
            lnL -= half_det
        z = X.T @ Ky
        L = np.linalg.cholesky(M)
        w = linalg.solve_triangular(L, z, lower=True)
        lnL += 0.5 * float(w @ w) - 0.5 * float(self.y @ Ky) - float(np.log(np.diag(L)).sum())
        V = linalg.solve_triangular(L, KX.T, lower=True).T
        alpha = Ky - V @ w
        gradient = self._gradient(eta, (time, field, slopes), (background, inverses), (V, alpha))
        inverse_M = linalg.solve_triangular(L, np.eye(p), lower=True)
        excess = (X.T @ alpha) ** 2 + (inverse_M**2).sum(axis=0) - 1.0
        self._column_gradient(gradient, excess)
        delta = (eta - self.mean) / self.sd
        value = lnL - 0.5 * float(delta @ delta) - float(np.log(self.sd).sum()) - 0.5 * len(eta) * np.log(2 * np.pi)
        return NoisePoint(eta, value, gradient - delta / self.sd)

    def _column_gradient(self, gradient: np.ndarray, excess: np.ndarray) -> None:
        at, groups = self.index, self.problem.groups
        nuisance = excess[self.member_of_column < 0]
        for k, name in enumerate(self.problem.machines, start=1):
            gradient[at[f"maps:{name}"]] += nuisance[groups == k].sum()
        if self.problem.machines:
            gradient[at["maps"]] += nuisance[groups > 0].sum()
        for k, c in enumerate(self.members):
            if c.prior is not None:
                gradient[at[f"size:{k}"]] += excess[self.member_of_column == k].sum()

    def _gradient(
        self,
        eta: np.ndarray,
        kernels: tuple[np.ndarray, np.ndarray, dict[str, np.ndarray]],
        covariance: tuple[np.ndarray | None, list[np.ndarray]],
        solved: tuple[np.ndarray, np.ndarray],
    ) -> np.ndarray:
        """By the hyper-parameters of K: Σ G ∘ ∂K with G = ½ (ααᵀ − C⁻¹)."""
        (time, field, slopes), (background, inverses), (V, alpha) = kernels, covariance, solved
        at, g = self.index, np.zeros_like(eta)
        for own, inverse in zip(self.rows, inverses, strict=True):
            G = 0.5 * (np.outer(alpha[own], alpha[own]) - inverse + V[own] @ V[own].T)
            if background is not None:
                g[at["b"]] += 2.0 * float(np.sum(G * background))
                slope = slopes["lambda_o"][np.ix_(self.record, self.record)]
                factor = 0.5 * np.exp(2.0 * eta[at["b"]])
                g[at["lambda_o"]] += factor * float(np.sum(G * self._small_errors * slope))
                for s in range(len(self.blocks)):
                    self._sensor_gradient(g, eta, s, G[np.ix_(self.blocks[s], self.blocks[s])], (time, field, slopes))
            else:
                self._sensor_gradient(g, eta, int(self.sensor[own[0]]), G, (time, field, slopes))
        return g

    def _sensor_gradient(
        self,
        g: np.ndarray,
        eta: np.ndarray,
        s: int,
        G: np.ndarray,
        kernels: tuple[np.ndarray, np.ndarray, dict[str, np.ndarray]],
    ) -> None:
        time, field, slopes = kernels
        at, name, rows = self.index, self.problem.sensors[s], self.record[self.blocks[s]]
        pick = np.ix_(rows, rows)
        w2, c2, o2 = (np.exp(2.0 * eta[at[f"{kind}:{name}"]]) for kind in ("w", "c", "o"))
        g[at[f"w:{name}"]] += 2.0 * w2 * float((np.diag(G) / self.problem.count[rows]).sum())
        g[at[f"c:{name}"]] += 2.0 * c2 * float(np.sum(G * time[pick]))
        g[at[f"o:{name}"]] += 2.0 * o2 * float(np.sum(G * field[pick]))
        for n, slope in slopes.items():
            g[at[n]] += (o2 if n == "lambda_o" else c2) * float(np.sum(G * slope[pick]))

    def optimise(self, start: np.ndarray | None = None, iterations: int = ITERATIONS) -> NoisePoint:
        """The likeliest hyper-parameters, from a start (default: prior means) by L-BFGS, within bounds."""
        first = self.mean if start is None else np.clip(start, self.lower, self.upper)
        best = self.evaluate(first)

        def cost(eta: np.ndarray) -> tuple[float, np.ndarray]:
            nonlocal best
            here = self.evaluate(eta)
            if here.value > best.value:
                best = here
            if not np.isfinite(here.value):
                return 1e10, np.zeros_like(eta)
            return -here.value, -here.gradient

        optimize.minimize(
            cost,
            first,
            jac=True,
            method="L-BFGS-B",
            bounds=list(zip(self.lower, self.upper, strict=True)),
            options={"maxiter": iterations, "ftol": 1e-6, "gtol": 0.02},
        )
        return best

    @property
    def lower(self) -> np.ndarray:
        return self.mean - REACH_OF_PRIOR * self.sd

    @property
    def upper(self) -> np.ndarray:
        return self.mean + REACH_OF_PRIOR * self.sd

    def start_from(self, other: StructuredNoise, eta: np.ndarray) -> np.ndarray:
        """Prior means, but what another hypothesis has estimated of the noise."""
        at = other.index
        own = [
            eta[at[n]] if n in at and not n.startswith("size:") else m
            for n, m in zip(self.names, self.mean, strict=True)
        ]
        return np.clip(np.array(own), self.lower, self.upper)

    def whiten(self, eta: np.ndarray) -> Whitened:
        """C⁻¹ and α at η, dense."""
        time, field, _ = self._kernels(eta)
        blocks = self._covariance(eta, (time, field), self._background(eta, field))
        sizes = self.column_sizes(eta)
        X = self.X * sizes
        P = np.zeros((len(self.y), len(self.y)))
        for own, K in zip(self.rows, blocks, strict=True):
            inverse, _ = _inverted(K)
            assert inverse is not None
            P[np.ix_(own, own)] = inverse
        KX = P @ X
        L = np.linalg.cholesky(np.eye(X.shape[1]) + X.T @ KX)
        V = linalg.solve_triangular(L, KX.T, lower=True).T
        P -= V @ V.T
        return Whitened(P, P @ self.y, sizes)

    def amplitudes(self, eta: np.ndarray, member: int) -> tuple[np.ndarray, np.ndarray]:
        """Posterior mean (k,) and covariance (k, k) of one member's coefficients, in its unit."""
        white = self.whiten(eta)
        own = self.member_of_column == member
        X, size = self.X[:, own], white.sizes[own]
        mean = size**2 * (X.T @ white.alpha)
        scaled = X * size**2
        return mean, np.diag(size**2) - scaled.T @ white.precision @ scaled

    def map_size(self, eta: np.ndarray, group: int) -> float:
        """κ of a group of map errors: its size over what is expected of it."""
        at = self.index
        return float(np.exp(eta[at["maps"]] + eta[at[f"maps:{self.problem.machines[group - 1]}"]]))

    def group_signature(self, eta: np.ndarray, group: int) -> np.ndarray:
        """What a group of map errors moves the readings by, posterior mean (N, m), in stated noise."""
        white = self.whiten(eta)
        own = np.zeros(self.X.shape[1], bool)
        own[: len(self.problem.groups)] = self.problem.groups == group
        amounts = white.sizes[own] ** 2 * (self.X[:, own].T @ white.alpha)
        moved = np.zeros(self.problem.y.shape)
        moved[self.record, self.sensor] = self.X[:, own] @ amounts
        return moved

    def scatter(self, eta: np.ndarray) -> dict[str, float]:
        """Noise of a reading over its stated standard deviation, by sensor: white and correlated parts together."""
        at = self.index
        return {
            s: float(np.sqrt(FLOOR**2 + sum(np.exp(2.0 * eta[at[f"{kind}:{s}"]]) for kind in ("w", "c", "o"))))
            for s in self.problem.sensors
        }


def _inverted(K: np.ndarray) -> tuple[np.ndarray | None, float]:
    """K⁻¹ and ½ ln|K| of a symmetric positive definite K; None where it is not."""
    L, info = linalg.lapack.dpotrf(K, lower=1, clean=1)
    if info:
        return None, np.inf
    half = float(np.log(np.diag(L)).sum())
    inverse, _ = linalg.lapack.dpotri(L, lower=1)
    inverse = np.tril(inverse)
    return inverse + np.tril(inverse, -1).T, half
