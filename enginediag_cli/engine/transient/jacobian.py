"""Balances of a network and their derivatives by its unknowns, as stages of an integration keep them."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from enginediag_cli.engine import solver
from enginediag_cli.engine.dual import Array, Value
from enginediag_cli.engine.evaluation import Evaluation
from enginediag_cli.engine.network import Network
from enginediag_cli.engine.open_points import SMALL


def matrix(e: Evaluation, rows: Mapping[str, Value], names: tuple[str, ...]) -> Array:
    """Derivatives of `rows` with respect to leaves `names`, shape (N, rows, names)."""
    return np.ascontiguousarray(solver.directed(e, rows, names).transpose(2, 0, 1))


def values_and_jacobian(
    network: Network, inputs: Mapping[str, Value], parameters: Mapping[str, Value], x: Array
) -> tuple[Array, Array]:
    """Balances (nx, n) and their derivatives (n, nx, nx): exact, or for a few points by forward differences
    in one widened batch, which costs one plain pass where the overhead of calls dominates."""
    nx, n = x.shape
    if n <= solver.FEW_POINTS:
        h = solver.DIFFERENCE * np.maximum(np.abs(x), SMALL)
        wide = np.repeat(x[:, None, :], nx + 1, axis=1)
        wide[np.arange(nx), np.arange(1, nx + 1)] += h
        tile, theta = solver.repeated(inputs, nx + 1), solver.repeated(parameters, nx + 1)
        e = solver.evaluate(network, tile, theta, wide.reshape(nx, -1), frozenset())
        R = solver.balances(e).reshape(-1, nx + 1, n)
        with np.errstate(invalid="ignore", over="ignore"):
            return R[:, 0], np.ascontiguousarray(((R[:, 1:] - R[:, :1]) / h).transpose(2, 0, 1))
    names = tuple(u.name for u in network.unknowns())
    e = solver.evaluate(network, inputs, parameters, x, frozenset(names))
    return solver.balances(e), matrix(e, e.balances, names)


def linear_solve(A: Array, B: Array) -> Array:
    """A⁻¹ B for stacks (n, k, k), (n, k, m); a matrix that is exactly singular or not finite gives NaN in its
    own rows only."""
    try:
        return np.linalg.solve(A, B)
    except np.linalg.LinAlgError:
        bad = ~(np.abs(np.linalg.det(A)) > 0.0)
        solved = np.linalg.solve(np.where(bad[:, None, None], np.eye(A.shape[1]), A), B)
        return np.where(bad[:, None, None], np.nan, solved)
