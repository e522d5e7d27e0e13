"""Health of one flight from its statistics, and the readings of a series."""

from __future__ import annotations

import numpy as np

from enginediag_cli.detection.series import (
    EpochStatistics,
    build_readings,
    estimate_flight_change,
)
from enginediag_cli.parameters import Parameter
from enginediag_cli.residuals.statistics import LocalStatistics

SENSORS = ("sensor.T3.bias", "sensor.P3.bias", "sensor.T5.bias", "sensor.N2.bias")
HEALTH = ("fan.efficiency", "hpc.efficiency", "hpt.efficiency")
EFFECT = np.array([[1.0, 4.0, 0.5], [3.0, -2.0, 1.0], [-2.0, -3.0, 4.0], [1.0, 1.0, 3.0]])  # of one prior sigma
MEANING = {
    **{
        n: Parameter(n, "health", 1.0, 0.5, 1.5, 0.02, component=n.split(".")[0], quantity="efficiency") for n in HEALTH
    },
    **{n: Parameter(n, "sensor", 0.0, -9, 9, 3.0, component=n[: n.rindex(".")], quantity="bias") for n in SENSORS},
}


def flights(rng, changes, wander=0.0):
    """Statistics of flights in which the parameters have the changes (n, 7), in prior sigmas; readings of noise 1
    wander by so much from flight to flight."""
    changes = np.asarray(changes)
    sigma = np.array([MEANING[name].prior_sigma for name in MEANING])
    J = np.concatenate([EFFECT, 3 * np.eye(4)], axis=1) / sigma
    off = np.cumsum(wander * rng.standard_normal((len(changes), 4)), axis=0)
    e = (changes * sigma) @ J.T + rng.standard_normal((len(changes), 4)) + off
    F = J.T @ J
    fixed = {"theta0": np.zeros(7), "prior_sigma": sigma, "F": F, "V": F, "n": 1, "chi2": 4.0, "dof": 4.0}
    return [LocalStatistics(parameters=tuple(MEANING), s=J.T @ row, **fixed) for row in e]


def test_summed_flights_are_estimated_as_generalised_least_squares_does():
    rng = np.random.default_rng(1)
    one, two = flights(rng, np.zeros((2, 7)))
    prior = np.diag(one.prior_sigma**-2.0)
    expected = np.linalg.solve(one.F + two.F + prior, one.s + two.s)
    found = estimate_flight_change(one + two)
    np.testing.assert_allclose(found.change, expected)
    np.testing.assert_allclose(found.standard_error, np.sqrt(np.diag(np.linalg.inv(one.F + two.F + prior))))


def test_statistics_with_all_sensors_hold_the_readings_themselves():
    rng = np.random.default_rng(2)
    changes = np.zeros((6, 7))
    changes[3:, 4] = 2.0  # of the second sensor
    found = build_readings(flights(rng, changes), list(MEANING.values()))
    again = np.random.default_rng(2)
    again.standard_normal((6, 4))  # what the readings wander by
    noise = again.standard_normal((6, 4))
    expected = noise.copy()
    expected[3:, 1] += 6.0
    np.testing.assert_allclose(found.z, expected, atol=1e-9)
    np.testing.assert_allclose(found.J[0, :, :3], EFFECT, atol=1e-9)


def test_rows_of_the_biases_alone_hold_the_same_readings():
    rng = np.random.default_rng(4)
    whole = flights(rng, rng.standard_normal((6, 7)))
    whole = [a + b for a, b in zip(whole, whole[::-1], strict=True)]
    parts = [EpochStatistics.from_statistics(x, SENSORS) for x in whole]
    assert parts[0].information.shape == (4, 7)
    expected, found = (build_readings(x, list(MEANING.values())) for x in (whole, parts))
    np.testing.assert_array_equal(found.z, expected.z)
    np.testing.assert_array_equal(found.J, expected.J)
    one, two = (EpochStatistics.from_statistics(x, SENSORS) for x in whole[:2])
    np.testing.assert_array_equal((one + two).information, one.information + two.information)
