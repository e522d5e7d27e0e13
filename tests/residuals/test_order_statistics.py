from __future__ import annotations

import numpy as np
import pytest

from enginediag_cli.residuals.distributions import median, quantile


@pytest.mark.parametrize("n", [1, 2, 3, 10, 101])
def test_median_and_quantile_are_numpys_to_the_last_digit(n):
    x = np.random.default_rng(n).normal(size=(4, n))
    assert median(x[0]) == np.median(x[0])
    for share in (0.0, 0.05, 0.3, 0.5, 0.9, 1.0):
        assert np.array_equal(quantile(x, share), np.quantile(x, share, axis=1))
