"""The fitted start: what corrected coordinates make equal, and what the polynomial reproduces."""

from __future__ import annotations

import numpy as np
import pytest

from enginediag_cli.engine.start import StartFit, basis, coordinates, correction, total_ratios

KINDS = ("power", "mach", "theta", "delta")


def draw(n, seed=1):
    rng = np.random.default_rng(seed)
    return np.stack(
        [rng.uniform(-0.5, 0.6, n), rng.uniform(0, 0.85, n), rng.uniform(-0.2, 0.1, n), rng.uniform(-1.3, 0, n)]
    )


@pytest.mark.parametrize(
    ("column", "expected"),
    [
        ("Wf_kg_s", 0.5 * 0.9),
        ("N1_rpm", 0.9),
        ("T4_K", 0.81),
        ("T45_K", 0.81),
        ("Fn_N", 0.5),
        ("power_W", 0.5 * 0.9),
        ("gearbox_power_W", 0.5 * 0.9),
        ("gearbox_torque_N_m", 0.5),
        ("EPR", 1.0),
    ],
)
def test_a_power_setting_is_corrected_by_its_own_powers_of_theta_and_delta(column, expected):
    assert correction(column, np.array(0.81), np.array(0.5)) == pytest.approx(expected)


def test_total_ratios_at_sea_level_rest_are_one():
    theta, delta = total_ratios({"altitude_m": 0.0, "mach": 0.0, "dT_isa_K": 0.0})
    assert (theta, delta) == pytest.approx((1.0, 1.0))
    theta, delta = total_ratios({"altitude_m": 0.0, "mach": 1.0, "dT_isa_K": 0.0})
    assert (theta, delta) == pytest.approx((1.2, 1.2**3.5))
    theta, delta = total_ratios({"ambient_temperature_K": 300.0, "ambient_pressure_Pa": 98000.0})
    assert (theta, delta) == pytest.approx((300.0 / 288.15, 98000.0 / 101325.0))


def test_similar_points_have_the_same_power_coordinate():
    low = {"altitude_m": np.array([0.0]), "mach": np.array([0.6]), "dT_isa_K": np.array([0.0])}
    high = {"altitude_m": np.array([9000.0]), "mach": np.array([0.6]), "dT_isa_K": np.array([10.0])}
    for inputs in (low, high):
        theta, delta = total_ratios(inputs)
        inputs["Wf_kg_s"] = 1.3 * delta * theta**0.5
    assert coordinates("Wf_kg_s", low, 1)[1][0] == pytest.approx(coordinates("Wf_kg_s", high, 1)[1][0], rel=1e-12)


def test_the_basis_spends_its_degree_by_weight():
    terms = basis(KINDS, 8.0)
    assert max(t[0] for t in terms) == 8
    assert max(t[1] for t in terms) == 6  # weight 1.3
    assert max(t[2] for t in terms) == 2  # weight 3
    assert max(t[3] for t in terms) == 1  # weight 5
    assert len(set(terms)) == len(terms)


def test_the_fit_reproduces_the_exponential_of_a_low_polynomial():
    z = draw(400)
    x = np.exp(np.stack([0.3 * z[0] - 0.2 * z[1] * z[0] ** 2 + 0.1 * z[2], 0.5 + 0.4 * z[1] ** 2 - 0.05 * z[3]]))
    fit = StartFit.fit(KINDS, z, x)
    other = draw(100, seed=2) * 0.95
    expected = np.exp(
        np.stack(
            [
                0.3 * other[0] - 0.2 * other[1] * other[0] ** 2 + 0.1 * other[2],
                0.5 + 0.4 * other[1] ** 2 - 0.05 * other[3],
            ]
        )
    )
    assert fit is not None
    assert np.allclose(fit.predict(other), expected, rtol=1e-8)


def test_a_coordinate_that_stands_still_takes_no_terms():
    z = draw(300)
    z[2] = -0.1
    fit = StartFit.fit(KINDS, z, np.exp(z[:1]))
    assert fit is not None
    assert fit.kinds == ("power", "mach", "fixed", "delta")
    assert np.allclose(fit.predict(z), np.exp(z[:1]), rtol=1e-9)


def test_too_few_anchors_make_no_fit():
    z = draw(3)
    assert StartFit.fit(KINDS, z, np.exp(z[:1])) is None


def test_a_fit_covers_its_anchors_and_not_what_lies_beyond():
    z = draw(300)
    fit = StartFit.fit(KINDS, z, np.exp(z[:1]))
    assert fit is not None
    assert fit.covers(KINDS, z).all()
    assert not fit.covers(KINDS, z + np.array([[2.0], [0.0], [0.0], [0.0]])).any()
