"""The standard atmosphere against ISO 2533."""

from __future__ import annotations

import numpy as np
import pytest
from engine_makers import fourth_order, gradient, seeds

from enginediag_cli.engine.evaluation import P_TROPOPAUSE, standard_atmosphere

ISO_2533 = {  # geopotential height m: T K, p Pa
    0.0: (288.15, 101325.0),
    1000.0: (281.65, 89874.6),
    5000.0: (255.65, 54019.9),
    10000.0: (223.15, 26436.3),
    11000.0: (216.65, 22632.1),
    15000.0: (216.65, 12044.6),
    20000.0: (216.65, 5474.9),
}


@pytest.mark.parametrize("height", ISO_2533)
def test_the_standard_atmosphere_has_the_published_values(height):
    T, P = standard_atmosphere(np.array([height]))
    assert T[0] == pytest.approx(ISO_2533[height][0], abs=1e-9)
    assert P[0] == pytest.approx(ISO_2533[height][1], rel=1e-5)


def test_temperature_and_pressure_are_continuous_at_the_tropopause():
    T, P = standard_atmosphere(np.array([11000.0 - 1e-6, 11000.0, 11000.0 + 1e-6]))
    assert np.ptp(T) < 1e-8
    assert np.ptp(P) < 1e-5
    assert P[1] == pytest.approx(P_TROPOPAUSE, rel=1e-14)


def test_a_batch_below_the_tropopause_gives_the_same_values_as_one_that_crosses_it():
    below = np.linspace(0.0, 10900.0, 20)
    alone = standard_atmosphere(below)
    mixed = standard_atmosphere(np.concatenate([below, [12000.0]]))
    for a, b in zip(alone, mixed, strict=True):
        assert np.allclose(a, b[:-1], rtol=1e-15)


def test_the_derivatives_with_altitude_match_differences_on_both_sides():
    h = np.array([200.0, 4000.0, 10500.0, 11500.0, 17000.0])
    (altitude,) = seeds(h)
    for k, x in enumerate(standard_atmosphere(altitude)):
        numeric = fourth_order(lambda t, k=k: standard_atmosphere(h + t)[k], 40.0)
        assert np.abs(gradient(x, 1)[0] - numeric).max() < 1e-8 * max(np.abs(numeric).max(), 1.0)


def test_pressure_falls_as_the_weight_of_the_air_above():
    h = np.array([2000.0, 9000.0, 13000.0])
    (altitude,) = seeds(h)
    T, P = standard_atmosphere(altitude)
    density = P.v / (287.05287 * T.v)
    assert np.allclose(gradient(P, 1)[0], -density * 9.80665, rtol=1e-10)  # dp/dh = −ρ g
