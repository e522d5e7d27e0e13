"""The banded and low-rank algebra of hidden amplitudes against the dense formulas, noise correlated in time or not."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from enginediag_cli.mismatch.unrecorded.amplitude import KERNELS, SIGNAL, Solver, likelihood, own_error, taken_for
from enginediag_cli.mismatch.unrecorded.gate import threshold
from enginediag_cli.mismatch.unrecorded.whitened_rows import Basis, direction

N, M = 14, 3
RECORDING = np.repeat([0, 1], 7)
GAP = np.r_[0, np.ones(6), 0, 1, 2, 1, 1, 1, 1].astype(int)


def geometry(rho):
    """A basis of N records of M sensors, one reading missing, a location's direction, and its dense columns C."""
    rng = np.random.default_rng(3)
    keep = np.ones((N, M), bool)
    keep[4, 1] = False
    follows = np.zeros_like(keep)
    follows[1:] = keep[1:] & keep[:-1] & (GAP[1:] == 1)[:, None] & (rho != 0)
    sigma = np.array([0.5, 1.0, 2.0])
    before = np.where(follows, rho, 0.0)
    frame = SimpleNamespace(
        keep=keep,
        sigma=sigma,
        correlation=lambda rows=slice(None): before[rows],
        neighbours=SimpleNamespace(gap=GAP),
        scaled=lambda v, rows=slice(None): np.where(keep[rows][:, :, None], v, 0.0) / sigma[:, None],
    )
    n, q = keep.sum(), 4
    A = np.concatenate([rng.normal(size=(n, q)), np.eye(q)])
    Q = np.linalg.qr(A)[0]
    e = rng.normal(size=n + q)
    rows, residual, left = np.zeros((N, M, q)), np.zeros((N, M)), np.zeros((N, M))
    rows[keep], residual[keep], left[keep] = Q[:n], e[:n], (e - Q @ (Q.T @ e))[:n]
    of = Basis(frame, rows, residual, left, float(e @ e - (Q.T @ e) @ (Q.T @ e)), Q.T @ e, Q[n:], GAP)
    column = rng.normal(size=(N, M))
    C = np.zeros((N, M, N))
    for k in range(N):
        C[k, :, k] = np.where(keep[k], column[k] / sigma, 0.0)
    whitened = C.copy()
    for k in range(1, N):
        f = follows[k][:, None]
        whitened[k] = np.where(f, (C[k] - rho * C[k - 1]) / np.sqrt(1 - rho**2), C[k])
    dense = np.concatenate([whitened[keep], np.zeros((q, N))])
    return of, direction(of, column), dense, Q, e


@pytest.mark.parametrize("rho", [0.0, 0.6])
@pytest.mark.parametrize("kernel", KERNELS, ids=lambda k: k.name)
def test_likelihood_amplitude_and_errors_are_those_of_dense_matrices(rho, kernel):
    of, along, C, Q, e = geometry(rho)
    distance = np.abs(np.subtract.outer(np.cumsum(GAP), np.cumsum(GAP)))
    K = np.exp(-distance / kernel.length) if kernel.length else np.eye(N)
    K *= np.equal.outer(RECORDING, RECORDING)
    PC = C - Q @ (Q.T @ C)
    G, g = C.T @ PC, PC.T @ e
    assert np.allclose(along.gathered(of.left), g)
    for tau in (0.1, 3.0):
        covariance = np.linalg.inv(np.linalg.inv(K) / tau**2 + G)
        solver = Solver(along, along.B, kernel, GAP, tau)
        a, error = solver.amplitude(g)
        assert np.allclose(a, covariance @ g)
        assert np.allclose(error, np.sqrt(np.diag(covariance)))
        assert np.isclose(solver.quadratic(g[:, None])[0], g @ covariance @ g)
        assert np.isclose(solver.log_determinant, np.linalg.slogdet(np.eye(N) + tau**2 * K @ G)[1])


def test_the_likelihood_ratio_is_that_of_two_gaussian_laws_of_the_projected_readings():
    of, along, C, Q, e = geometry(0.6)
    PC, left = C - Q @ (Q.T @ C), e - Q @ (Q.T @ e)
    kernel = KERNELS[0]
    found = likelihood(along, GAP, along.gathered(of.left)[:, None], kernels=(kernel,))
    tau = SIGNAL * own_error(along)
    direct = []
    for t in tau:
        V = np.eye(len(e)) + t**2 * PC @ PC.T
        direct.append(0.5 * (left @ left - left @ np.linalg.solve(V, left) - np.linalg.slogdet(V)[1]))
    assert np.allclose(found.first, direct[: len(found.first)], atol=1e-8)
    assert np.isclose(found.best[0], max(0.0, *direct), atol=1e-8)


@pytest.mark.parametrize("rho", [0.0, 0.6])
def test_without_the_nuisance_a_likelihood_ratio_is_never_above_the_right_one(rho):
    of, along, *_ = geometry(rho)
    alone = replace(along, rows=np.zeros((N, M, 0)))
    g = along.gathered(of.left)[:, None] * np.array([1.0, 3.0, 10.0])
    assert (likelihood(alone, GAP, g).best <= likelihood(along, GAP, g).best + 1e-12).all()


def test_directions_that_a_location_cannot_be_taken_for_are_left_out():
    of, along, *_ = geometry(0.0)
    rows = np.concatenate([of.rows, 1e-3 * np.ones((N, M, 3))], axis=2)
    assert taken_for(replace(along, rows=rows)).shape == (N, of.rows.shape[2])


def test_drawn_noise_has_no_component_along_the_nuisance():
    of, _, _, Q, _ = geometry(0.0)
    draws = of.noise(20_000, np.random.default_rng(0))
    n = int(of.frame.keep.sum())
    covariance = np.cov(draws[of.frame.keep])
    assert np.allclose(covariance, np.eye(n) - Q[:n] @ Q[:n].T, atol=0.05)


@pytest.mark.parametrize("level", [0.05, 0.01])
def test_the_threshold_of_an_exponential_tail_holds_its_level(level):
    rng = np.random.default_rng(5)
    exact = -np.log(level)
    found = [threshold(rng.exponential(size=500), level) for _ in range(100)]
    assert abs(np.mean(found) - exact) < 0.05 * exact
