"""Steps at kinks: the smallest combination of gradients, and a fit whose optimum lies on one."""

from __future__ import annotations

import numpy as np
import pytest

from enginediag_cli.identification.gauss_newton import BundlePiece, GradientBundle, minimise_dual


def test_gradients_on_both_sides_of_a_kink_balance():
    """|x| at x = 0.001, after a step to −0.001: the gradients are +1 and −1, the optimum lies between."""
    kinks = GradientBundle()
    kinks.add(BundlePiece(np.array([-0.001]), np.array([-1.0]), 0.001))
    S = np.array([[1e-6]])
    pieces = kinks.pieces_near(BundlePiece(np.array([0.001]), np.array([1.0]), 0.001), S, np.array([True]))
    gradient, fall2 = pieces.combine_gradients()
    assert gradient == pytest.approx([0.0], abs=2e-3)
    assert fall2 / 2 == pytest.approx(0.001, rel=0.01)  # what can still be had, where one gradient promises 500,000


def test_alone_a_gradient_is_newtons_step():
    S, g = np.diag([4.0, 1.0]), np.array([2.0, -3.0])
    pieces = GradientBundle().pieces_near(BundlePiece(np.zeros(2), g, 7.0), S, np.ones(2, bool))
    gradient, fall2 = pieces.combine_gradients()
    assert gradient == pytest.approx(g)
    assert fall2 == pytest.approx(g @ np.linalg.solve(S, g))
    assert pieces.fall(-np.linalg.solve(S, g)) == pytest.approx(fall2 / 2)


def test_the_weights_are_those_of_the_quadratic_programme():
    from scipy.optimize import minimize

    rng = np.random.default_rng(0)
    for _ in range(20):
        G, e = rng.standard_normal((5, 3)), rng.uniform(0, 1, 5)
        M = G @ G.T
        best = minimize(
            lambda w, M=M, e=e: 0.5 * w @ M @ w + e @ w,
            np.full(5, 0.2),
            bounds=[(0, 1)] * 5,
            constraints={"type": "eq", "fun": lambda w: w.sum() - 1},
        )
        w = minimise_dual(M, e)
        assert w.sum() == pytest.approx(1.0)
        assert (w >= 0).all()
        assert 0.5 * w @ M @ w + e @ w <= best.fun * 1.02 + 1e-6
