"""Polynomials of a variable: orthonormal over the records, and nothing where these are nearest to the design point."""

from __future__ import annotations

import numpy as np
import pytest

from enginediag_cli.drivers import MACH
from enginediag_cli.mismatch.laws.polynomials import from_design, orthonormal, variances
from enginediag_cli.mismatch.laws.scan import KnownVariable
from enginediag_cli.physics.law import Variable

X = np.linspace(0.2, 0.8, 50) ** 2


def test_they_are_orthonormal_over_the_records_and_of_their_degree() -> None:
    q = orthonormal(X, 5)
    assert q.T @ q / len(X) == pytest.approx(np.eye(5))
    assert q.mean(axis=0) == pytest.approx(np.zeros(5), abs=1e-12)
    for degree, column in enumerate(q.T, start=1):
        left = column - np.polynomial.Polynomial.fit(X, column, degree)(X)
        assert np.std(left) < 1e-9


@pytest.mark.parametrize("reference", [float(X[17]), -3.0, 7.0])
def test_they_are_nothing_at_the_record_that_is_nearest_to_the_design_point(reference: float) -> None:
    variable = Variable("mach", "Mach number", MACH, ("mach",), lambda x: x, design=reference, recorded=True)
    q = from_design(KnownVariable(variable, X, 0), 4)
    at = int(np.argmin(np.abs(X - reference)))
    assert not q[at].any() and np.diff(q - orthonormal(X, 4), axis=0) == pytest.approx(np.zeros((49, 4)))


def test_variances_of_a_part_add_up_to_its_size() -> None:
    W = variances((0, 0, 0, 1, 1), (1, 2, 3, 1, 2))
    assert len(W) == 27
    sizes = {round(float(np.sqrt(x)), 9) for w in W for x in (w[:3].sum(), w[3:].sum())}
    assert sizes == {0.1, 0.4, 1.6}
