"""The losses and their derivatives."""

from __future__ import annotations

import numpy as np
import pytest

from enginediag_cli.identification.problem import LOSSES, Loss

Z = np.array([-30.0, -3.0, -2.2, -0.4, 1e-9, 0.7, 1.9, 2.7, 100.0])


@pytest.mark.parametrize("name", LOSSES)
def test_the_weight_times_z_is_the_slope_of_the_cost_and_the_curvature_its_slope(name):
    loss, h = Loss(name, 2.5), 1e-5
    slope = (loss.cost(Z + h) - loss.cost(Z - h)) / (2 * h)
    assert loss.weight(Z) * Z == pytest.approx(slope, abs=1e-7)
    bend = (loss.weight(Z + h) * (Z + h) - loss.weight(Z - h) * (Z - h)) / (2 * h)
    assert loss.curvature(Z) == pytest.approx(bend, abs=1e-6)


@pytest.mark.parametrize("name", LOSSES)
def test_small_residuals_cost_half_their_square(name):
    z = np.array([1e-8, 1e-4, 0.01])
    assert Loss(name, 2.5).cost(z) == pytest.approx(0.5 * z**2, rel=1e-4)


@pytest.mark.parametrize("name", ["soft_l1", "huber"])
def test_a_gross_outlier_pulls_no_harder_than_the_scale(name):
    loss = Loss(name, 2.5)
    assert abs(loss.weight(np.array([1e6])) * 1e6) <= 2.5


def test_an_unknown_loss_is_refused():
    with pytest.raises(ValueError, match="soft_l1"):
        Loss("cauchy")
