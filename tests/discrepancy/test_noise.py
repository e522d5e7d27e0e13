"""The marginal likelihood against a dense Gaussian, its gradient against differences, what permutations leave alone."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.stats import multivariate_normal
from simulated import problem

from enginediag_cli.discrepancy import linearised
from enginediag_cli.discrepancy.noise import FLOOR, MemberColumns, StructuredNoise


def without_prior(noise: StructuredNoise, eta: np.ndarray) -> float:
    delta = (eta - noise.mean) / noise.sd
    prior = -0.5 * delta @ delta - np.log(noise.sd).sum() - 0.5 * len(eta) * np.log(2 * np.pi)
    return noise.evaluate(eta).value - float(prior)


@pytest.mark.parametrize("coupled", [False, True])
def test_likelihood_is_that_of_a_dense_gaussian(coupled: bool, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(linearised, "COUPLED_FROM", 1 if coupled else 9)
    p = problem(records=12)
    noise = StructuredNoise(p)
    eta = noise.mean + 0.1
    at = {n: float(np.exp(v)) for n, v in zip(noise.names, eta, strict=True)}
    d = np.linalg.norm(p.points[:, None] - p.points[None], axis=2)
    gap = np.abs(p.time_s[:, None] - p.time_s[None])
    r = np.sqrt(3) * d / at["lambda_o"]
    matern = (1 + r) * np.exp(-r)
    C = np.zeros((24, 24))
    for s, name in enumerate(p.sensors):
        own = slice(12 * s, 12 * s + 12)
        C[own, own] = at[f"c:{name}"] ** 2 * np.exp(-gap / at["tau"] - d / at["lambda"]) + at[f"o:{name}"] ** 2 * matern
        C[own, own] += (FLOOR**2 + at[f"w:{name}"] ** 2) * np.eye(12)
    X = np.concatenate([p.X[:, 0], p.X[:, 1]]) * [1, 1, at["maps"] * at["maps:b"]]
    C += X @ X.T
    if coupled:
        G = np.concatenate([p.G[:, 0], p.G[:, 1]])
        shared = np.tile(0.5 * np.eye(12) + 0.5 * matern, (2, 2))
        C += (0.05 * at["b"]) ** 2 * (G @ G.T) * shared
    y = np.concatenate([p.y[:, 0], p.y[:, 1]])
    dense = multivariate_normal(np.zeros(24), C).logpdf(y) + 12 * np.log(2 * np.pi)
    assert without_prior(noise, eta) == pytest.approx(dense, abs=1e-8)


@pytest.mark.parametrize("clock", [True, False])
@pytest.mark.parametrize("coupled", [False, True])
def test_gradient_is_that_of_differences(coupled: bool, clock: bool, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(linearised, "COUPLED_FROM", 1 if coupled else 9)
    p = problem(records=15)
    if not clock:
        p = replace(p, time_s=np.full(15, np.nan))
    noise = StructuredNoise(p, [MemberColumns(p.G[:, :, :1], 0.7, (-0.4, 1.0))])
    eta = noise.mean + 0.3 * np.random.default_rng(1).standard_normal(len(noise.mean))
    gradient = noise.evaluate(eta).gradient
    for k, step in enumerate(1e-5 * np.eye(len(eta))):
        slope = (noise.evaluate(eta + step).value - noise.evaluate(eta - step).value) / 2e-5
        assert gradient[k] == pytest.approx(slope, rel=1e-4, abs=1e-5), noise.names[k]


def test_order_of_records_does_not_matter() -> None:
    p = problem(records=20)
    order = np.random.default_rng(3).permutation(20)
    other = replace(
        p, y=p.y[order], X=p.X[order], G=p.G[order], time_s=p.time_s[order], points=p.points[order], keep=p.keep[order]
    )
    one, two = StructuredNoise(p), StructuredNoise(other)
    assert one.evaluate(one.mean).value == pytest.approx(two.evaluate(two.mean).value, abs=1e-9)


def test_compressed_columns_have_the_same_covariance() -> None:
    X = np.random.default_rng(0).standard_normal((10, 2, 6))
    X[:, :, 5] = X[:, :, 4]
    new, groups = linearised.compress_columns(X, np.array([0, 0, 0, 1, 1, 1]))
    assert new.shape[2] == 5
    assert list(groups) == [0, 0, 0, 1, 1]
    flat, less = X.reshape(20, 6), new.reshape(20, 5)
    assert np.allclose(flat @ flat.T, less @ less.T)


def test_amplitude_is_the_posterior_mean_of_a_linear_model() -> None:
    p = problem(records=15)
    noise = StructuredNoise(p, [MemberColumns(p.G[:, :, :1], 2.0)])
    bare = StructuredNoise(p)
    g = np.concatenate([p.G[:, 0, 0], p.G[:, 1, 0]])
    white = bare.whiten(bare.mean)
    precision = g @ white.precision @ g + 1 / 4.0
    mean, covariance = noise.amplitudes(noise.mean, 0)
    assert covariance[0, 0] == pytest.approx(1 / precision)
    assert mean[0] == pytest.approx(g @ white.alpha / precision)
