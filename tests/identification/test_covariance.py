"""The sandwich covariance against sums written out by hand."""

from __future__ import annotations

import numpy as np
import pytest
from identification_toy import ToyEngine, fly

from enginediag_cli.identification.covariance import uncertainty
from enginediag_cli.identification.gauss_newton import solve
from enginediag_cli.identification.normal_equations import blocks
from enginediag_cli.identification.problem import IdentificationSettings, build_problem


def fitted(**settings):
    engine, rng = ToyEngine(), np.random.default_rng(0)
    recordings = [fly(engine, rng, 40, "a"), fly(engine, rng, 30, "b")]
    problem = build_problem(engine, recordings, IdentificationSettings(loss="none", **settings))
    return problem, solve(problem)


def dense(problem, fit):
    """Jacobian of every reading to (x, z), (N·m, p + R·q), in units of sigma."""
    block = next(blocks(problem, fit.x, fit.z))
    N, m, p = block.jacobian.shape
    R, q = fit.z.shape
    D = np.zeros((N, m, p + R * q))
    D[:, :, :p] = block.jacobian
    for j, o in enumerate(problem.offsets):
        s = problem.sensors.index(o.sensor)
        for k in range(N):
            D[k, s, p + problem.recording[k] * q + j] = block.offset_jacobian[k, j]
    return D / problem.sigma[None, :, None]


def test_white_noise_gives_the_inverse_information_with_priors():
    problem, fit = fitted(recording_bias_sigma={"T3_K": 2.0, "T45_K": 4.0}, recording_scale_sigma={"T3_K": 0.01})
    z = fit.equations.residual / problem.sigma
    b = np.mean(z**2, axis=0)
    D = dense(problem, fit)
    full = np.einsum("ksi,ksj->ij", D, D) + np.eye(D.shape[2])
    meat = np.einsum("ksi,s,ksj->ij", D, b, D) + np.eye(D.shape[2])
    inverse = np.linalg.inv(full)
    expected = (inverse @ meat @ inverse)[:5, :5]
    found = uncertainty(problem, fit, np.zeros(4)).covariance
    assert found == pytest.approx(expected, rel=1e-8, abs=1e-14)


def test_correlated_noise_gives_the_double_sum_within_recordings():
    problem, fit = fitted(recording_bias_sigma={"T3_K": 2.0})
    problem = problem.replace_noise(problem.sigma, np.full(4, 1.7))
    rho = np.array([0.8, 0.3, 0.0, 0.6])
    b = np.mean((fit.equations.residual / problem.sigma) ** 2, axis=0)
    D = dense(problem, fit)
    lag = np.abs(np.subtract.outer(np.arange(70), np.arange(70)))
    same = problem.recording[:, None] == problem.recording
    p = D.shape[2]
    meat = np.eye(p)
    for s in range(4):
        meat += b[s] / 1.7**2 * D[:, s].T @ np.where(same, rho[s] ** lag, 0.0) @ D[:, s]
    inverse = np.linalg.inv(np.einsum("ksi,ksj->ij", D, D) / 1.7 + np.eye(p))
    expected = (inverse @ meat @ inverse)[:5, :5]
    assert uncertainty(problem, fit, rho).covariance == pytest.approx(expected, rel=1e-8, abs=1e-14)


def test_the_fit_uses_up_as_many_readings_as_the_data_determine_parameters():
    problem, fit = fitted()
    found = uncertainty(problem, fit, np.zeros(4))
    assert found.sensor_dof.sum() == pytest.approx(
        np.trace(np.linalg.inv(found.information + np.eye(5)) @ found.information)
    )
    assert found.sensor_dof.sum() < 5


def test_no_data_leave_every_parameter_at_its_prior():
    problem, _ = fitted()
    blind = problem.replace_noise(problem.sigma * 1e9, problem.inflation)
    found = uncertainty(blind, solve(blind), np.zeros(4))
    assert found.from_data == pytest.approx(np.zeros(5), abs=1e-9)
    assert found.covariance == pytest.approx(np.eye(5), abs=1e-9)
