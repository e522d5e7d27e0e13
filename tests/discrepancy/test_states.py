"""Paths of two states against every path there is."""

from __future__ import annotations

from itertools import product

import numpy as np
import pytest

from enginediag_cli.discrepancy.candidates import StateChain, best_path, path_evidence, screened_path


def system(seed: int, N: int = 9) -> tuple[np.ndarray, np.ndarray, StateChain]:
    rng = np.random.default_rng(seed)
    A = rng.standard_normal((2 * N, N))
    z = (np.arange(N) >= 4).astype(float)
    flight = np.array([0] * 6 + [1] * (N - 6))
    return A.T @ A, A.T @ (A @ z + rng.standard_normal(2 * N)), StateChain.from_times(60.0 * np.arange(N), flight)


@pytest.mark.parametrize("seed", range(8))
@pytest.mark.parametrize("sign", [0, 1])
def test_no_toggled_interval_of_the_path_is_better_and_most_paths_are_the_best_of_all(seed: int, sign: int) -> None:
    Q, h, chain = system(seed)

    def value(z: np.ndarray) -> float:
        return float(path_evidence(z @ h, z @ Q @ z, 1.0, sign)) + chain.value(z)

    best = max(value(np.array(z, float)) for z in product((0, 1), repeat=9))
    starts = [np.zeros(9), np.ones(9)]
    found = max((best_path(Q, h, 1.0, sign, chain, s) for s in starts), key=lambda p: p.evidence)
    assert found.evidence == pytest.approx(value(found.z))
    assert found.evidence == pytest.approx(best, abs=1e-9) or found.evidence > best - 2.0


def test_evidence_is_the_ratio_of_gaussians() -> None:
    # y = z a + noise of unit variance, a ~ N(0, s²): b = zᵀy, q = zᵀz
    y, z, s = np.array([0.4, 1.9, 2.2]), np.array([0.0, 1.0, 1.0]), 1.5
    C = np.eye(3) + s**2 * np.outer(z, z)
    exact = -0.5 * y @ np.linalg.solve(C, y) - 0.5 * np.log(np.linalg.det(C)) + 0.5 * y @ y
    assert float(path_evidence(z @ y, z @ z, s, 0)) == pytest.approx(exact)


def test_chain_is_a_probability() -> None:
    chain = StateChain.from_times(np.array([0.0, 100.0, 150.0, 0.0, 70.0]), np.array([0, 0, 0, 1, 1]))
    total = sum(np.exp(chain.value(np.array(z, float))) for z in product((0, 1), repeat=5))
    # beside ½ for the first state of each of two flights
    assert total == pytest.approx(4.0)


def test_screened_path_finds_what_is_plain_to_see() -> None:
    N = 250
    z = ((np.arange(N) > 60) & (np.arange(N) < 140)).astype(float)
    y = 3.0 * z + 0.5 * np.random.default_rng(0).standard_normal(N)
    chain = StateChain.from_times(20.0 * np.arange(N), np.zeros(N, int))
    found = screened_path(np.eye(N), y, 3.0, 1, chain, [np.zeros(N)])
    assert np.abs(found.z - z).sum() <= 4
    assert found.prior == pytest.approx(chain.value(found.z), abs=1e-9)
