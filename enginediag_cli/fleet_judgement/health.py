"""The course of an engine's health over its flights, and what maintenance brought: one Gaussian posterior.

    z_i = B x_i + J_i δ(i) + ε_i,    δ(i) = Σ_k a_k φ_k(i) + Σ_e r_e 1(i ≥ t_e),    ε_i ~ N(0, Σ)

with φ_k rising from 0 to 1 over the k-th piece of the flights after the baseline, a_k ~ N(0, D² Δ_k): a walk that by
the end may be as far from nominal as a change plausibly is, straight within pieces; r_e what maintenance may have
moved. B, level and what follows the conditions, is eliminated.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from enginediag_cli.fleet_judgement.rows import Flights

PIECES, FLIGHTS_PER_PIECE = 8, 6
"""Pieces of the course at most, and flights that each has at least."""
AT_A_TIME = 512
"""Flights of which all columns are held at once: a few megabytes."""
FAILED = 10.0
"""Standard deviation of a suspected instrument's error, in prior standard deviations."""


@dataclass(frozen=True)
class Course:
    """parameters (q,): positions among those of the flights; unit (q,): their prior standard deviations. phi (n, K);
    mean (r,) and covariance (r, r) of the coefficients in these units: K pieces by q, then one for each `jumps`, pairs
    of event and position among q. steps (n, e); level (m,): of the readings in the baseline; scatter (m, m)."""

    parameters: np.ndarray
    unit: np.ndarray
    phi: np.ndarray
    mean: np.ndarray
    covariance: np.ndarray
    jumps: tuple[tuple[int, int], ...]
    steps: np.ndarray
    level: np.ndarray
    scatter: np.ndarray

    def at(self, flight: int) -> np.ndarray:
        """Map (q, r) from coefficients to the state at a flight."""
        q = len(self.parameters)
        T = np.zeros((q, len(self.mean)))
        for k, value in enumerate(self.phi[flight]):
            T[:, k * q : (k + 1) * q] = value * np.eye(q)
        for j, (event, position) in enumerate(self.jumps):
            T[position, self.phi.shape[1] * q + j] = self.steps[flight, event]
        return T

    @property
    def path(self) -> np.ndarray:
        """Mean of the state (n, q) at each flight."""
        q, K = len(self.parameters), self.phi.shape[1]
        found = self.phi @ self.mean[: K * q].reshape(K, q)
        for j, (event, position) in enumerate(self.jumps):
            found[:, position] += self.steps[:, event] * self.mean[K * q + j]
        return np.asarray(found)

    def of_event(self, event: int) -> np.ndarray:
        """Map (q, r) from coefficients to what an event brought."""
        q = len(self.parameters)
        T = np.zeros((q, len(self.mean)))
        for j, (e, position) in enumerate(self.jumps):
            if e == event:
                T[position, self.phi.shape[1] * q + j] = 1.0
        return T

    def told(self, T: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Mean (q,) and covariance (q, q) of linear functions T (q, r), in prior standard deviations."""
        return T @ self.mean, T @ self.covariance @ T.T


def course(flights: Flights, moved: Sequence[Mapping[int, float]], failed: Sequence[int] = ()) -> Course:
    """moved: of each event of the flights, positions of the parameters that it may have moved with the standard
    deviation of that; failed: positions of instruments that are suspected, whose errors are then states like health."""
    n, m = flights.z.shape
    own = np.array([*flights.health, *failed], int)
    size = np.concatenate([np.ones(len(flights.health)), np.full(len(failed), FAILED)])
    after = n - flights.baseline
    pieces = int(np.clip(after // FLIGHTS_PER_PIECE, 1, PIECES))
    edges = np.unique(np.linspace(0, after, pieces + 1).round())
    since = np.arange(n)[:, None] - (flights.baseline - 1)
    phi = np.clip((since - edges[:-1]) / np.maximum(np.diff(edges), 1), 0.0, 1.0)
    place = {int(p): k for k, p in enumerate(own)}
    jumps = tuple((e, place[p]) for e, one in enumerate(moved) for p in one)
    spread = [one[p] for one in moved for p in one]
    scatter = flights.scatter()
    root = np.linalg.inv(np.linalg.cholesky(scatter))
    z = flights.weight[:, None] * (flights.z @ root.T)
    U = flights.weight[:, None] * np.concatenate([np.ones((n, 1)), flights.readings.weather], axis=1)
    inner = U.T @ U + np.diag([1e-9, *np.ones(U.shape[1] - 1)])
    variance = np.concatenate([np.outer(np.diff(edges) / max(after, 1), size**2).ravel(), np.square(spread)])
    r = len(variance)
    XX, Xz, UX = np.zeros((r, r)), np.zeros(r), np.zeros((U.shape[1], m, r))
    for first in range(0, n, AT_A_TIME):
        rows = slice(first, first + AT_A_TIME)
        J = flights.weight[rows, None, None] * (root @ flights.J[rows][:, :, own])
        columns = [phi[rows, k, None, None] * J for k in range(phi.shape[1])]
        columns += [flights.steps[rows, e, None, None] * J[:, :, [k]] for e, k in jumps]
        X = np.concatenate(columns, axis=2)  # (·, m, r)
        UX += np.tensordot(U[rows].T, X, 1)
        X = X.reshape(-1, r)
        XX += X.T @ X
        Xz += X.T @ z[rows].ravel()
    of_X = np.linalg.solve(inner, UX.reshape(U.shape[1], -1)).reshape(UX.shape)
    H = XX - np.tensordot(UX, of_X, ((0, 1), (0, 1))) + np.diag(1 / variance)
    covariance = np.linalg.inv((H + H.T) / 2)
    mean = covariance @ (Xz - np.tensordot(of_X, U.T @ z, ((0, 1), (0, 1))))
    B = np.linalg.solve(inner, U.T @ z) - of_X @ mean
    level = np.linalg.solve(root, B[0])
    unit = flights.readings.D[own]
    return Course(own, unit, phi, mean, covariance, jumps, flights.steps, level, scatter)
