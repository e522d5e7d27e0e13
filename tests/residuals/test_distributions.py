"""Tails of χ² and F against scipy.special."""

from __future__ import annotations

import numpy as np
import pytest
from scipy import special, stats

from enginediag_cli import probability as distributions

DOF = (1, 2, 3.4, 9, 11, 37.5, 120, 555.0, 2000, 30_000)


@pytest.mark.parametrize("dof", DOF)
def test_the_chi_square_tail_is_that_of_scipy(dof):
    for x in (*dof * np.array([0.0, 1e-3, 0.3, 0.9, 1.0, 1.001, 1.3, 2.0, 5.0]), dof + 40.0, 1e6):
        assert distributions.chdtrc(dof, x) == pytest.approx(special.chdtrc(dof, x), rel=3e-12, abs=1e-300)


@pytest.mark.parametrize("dof", DOF)
@pytest.mark.parametrize("probability", [1e-12, 1e-6, 1e-3, 0.01, 0.05, 0.5, 0.95, 0.99999])
def test_the_chi_square_quantile_is_that_of_scipy(dof, probability):
    assert distributions.chdtri(dof, probability) == pytest.approx(special.chdtri(dof, probability), rel=3e-12)


@pytest.mark.parametrize("dof1", DOF)
@pytest.mark.parametrize("dof2", (4.0, 5.5, 60.0, 900.0, 1e6))
def test_the_tail_and_the_quantile_of_f_are_those_of_scipy(dof1, dof2):
    for x in (0.0, 0.2, 0.9, 1.0, 1.4, 3.0, 20.0):
        assert distributions.fdtrc(dof1, dof2, x) == pytest.approx(special.fdtrc(dof1, dof2, x), rel=1e-11, abs=1e-300)
    for p in (0.5, 0.95, 0.99, 0.9999):
        assert distributions.fdtri(dof1, dof2, p) == pytest.approx(special.fdtri(dof1, dof2, p), rel=1e-11)


@pytest.mark.parametrize("dof", (1, 2.5, 11, 120, 480.0))
def test_the_noncentral_tail_is_that_of_scipy_and_its_noncentrality_the_inverse(dof):
    for noncentrality in (1e-4, 0.7, 9.0, 60.0, 300.0):
        for x in (0.3 * dof, dof, dof + 15.0, 2.0 * dof + 60.0):
            found = distributions.noncentral_chdtrc(dof, noncentrality, x)
            assert found == pytest.approx(stats.ncx2.sf(x, dof, noncentrality), rel=1e-9, abs=1e-13)
    limit = distributions.chdtri(dof, 0.01)
    for probability in (0.5, 0.9, 0.999):
        needed = distributions.noncentrality_for_power(dof, limit, probability)
        assert stats.ncx2.sf(limit, dof, needed) == pytest.approx(probability, rel=1e-9)
    assert distributions.noncentrality_for_power(dof, 0.1 * dof, 0.2) == 0.0


def test_noncentralities_of_many_degrees_of_freedom_are_found_too():
    needed = distributions.noncentrality_for_power(3000.0, 3200.0, 0.9)
    assert stats.ncx2.sf(3200.0, 3000.0, needed) == pytest.approx(0.9, rel=1e-6)


def test_what_is_not_a_number_stays_so():
    assert np.isnan(distributions.chdtrc(5, float("nan"))) and np.isnan(distributions.fdtrc(2, 3, float("nan")))
    assert distributions.chdtrc(5, float("inf")) == 0.0
