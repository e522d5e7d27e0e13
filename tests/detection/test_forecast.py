"""When a margin is used up."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.special import ndtri

from enginediag_cli.detection.forecast import (
    KAPPA,
    TAU,
    MarginCourse,
    Population,
    first_passage,
    fit_laws,
    forecast,
    growth,
    learn_population,
    unknown_population,
)


def course(t, y, sigma, steps=None, now=None):
    steps = np.zeros((len(t), 0)) if steps is None else steps
    t, y, noise = np.asarray(t, float), np.asarray(y, float), sigma**2 * np.eye(len(t))
    return MarginCourse(t, y, noise, now or float(t[-1]), steps, 1e-3, 10.0, np.zeros(steps.shape[1]))


def straight(mean, spread):
    return Population(mean, spread, np.where(KAPPA == 0.0, 1.0, 1e-300), 1e-300)


def test_growth_and_passage_are_inverse():
    x = np.array([0.1, 0.5, 1.0, 1.3])[:, None]
    np.testing.assert_allclose(
        first_passage(growth(x, KAPPA), np.ones_like(KAPPA), KAPPA), np.broadcast_to(x, (4, len(KAPPA)))
    )
    np.testing.assert_allclose(growth(np.ones(len(KAPPA)), KAPPA), 1.0)


def test_a_straight_line_with_a_gaussian_rate_passes_when_the_closed_form_says():
    """y = r t; r | y ~ N(m, s²) with many readings, so that P(T ≤ t) = P(r ≥ L/t): t_q = L/(m + s Φ⁻¹(1 − q))."""
    rng = np.random.default_rng(1)
    t, sigma, limit = np.arange(1.0, 101.0), 4.0, 40.0
    y = 0.1 * t + sigma * rng.standard_normal(100)
    m, s = t @ y / (t @ t), sigma / np.sqrt(t @ t)
    found = forecast(fit_laws(course(t, y, sigma), limit), straight(0.0, np.inf), limit)
    for q in (0.05, 0.25, 0.5, 0.75, 0.95):
        expected = limit / (m + s * ndtri(1 - q)) - 100.0
        assert found.quantile(q) == pytest.approx(expected, abs=0.03 * (expected + 100))
    assert found.level == pytest.approx(100 * m, rel=0.03) and found.rate == pytest.approx(m, rel=0.03)


@pytest.mark.parametrize("kappa", [0.0, 4.0])
def test_nine_of_ten_intervals_hold_where_the_fleet_is_as_the_engine(kappa):
    rng = np.random.default_rng(2)
    weights = np.where(KAPPA == kappa, 1.0, 1e-300)
    population, limit, held, told = Population(np.log(200.0), 0.3, weights, 1e-300), 15.0, 0, 0
    for _ in range(300):
        tau, t = 200.0 * np.exp(0.3 * rng.standard_normal()), np.arange(1.0, 101.0, 4)
        if tau <= 100:
            continue
        y = limit * growth(t / tau, np.array(kappa)) + 1.5 * rng.standard_normal(len(t))
        found = forecast(fit_laws(course(t, y, 1.5, now=100.0), limit), population, limit)
        told += 1
        held += found.quantile(0.05) <= tau - 100 <= found.quantile(0.95)
    assert told > 200 and abs(held / told - 0.9) < 3 * np.sqrt(0.09 / told)


def test_how_a_fleet_wears_is_learnt_from_its_engines():
    rng = np.random.default_rng(3)
    taus = 300.0 * np.exp(0.2 * rng.standard_normal(40))
    t = np.arange(1.0, 151.0, 3)
    fits = [
        fit_laws(course(t, 10 * growth(t / tau, np.array(3.0)) + 0.5 * rng.standard_normal(len(t)), 0.5), 10.0)
        for tau in taus
    ]
    found = learn_population(fits)
    assert found.mean == pytest.approx(np.log(300.0), abs=0.15) and 0.1 <= found.log_spread < 0.4
    assert found.weights[(KAPPA >= 2) & (KAPPA <= 4)].sum() > 0.7 and found.none < 0.05
    assert learn_population(fits[:2]).log_spread == np.inf  # too few to say


def test_what_a_wash_brought_is_no_slower_wear():
    rng = np.random.default_rng(4)
    t = np.arange(1.0, 201.0)
    y = 0.05 * t - 4.0 * (t >= 120) + rng.standard_normal(200)
    steps = (t >= 120).astype(float)[:, None]
    with_it = forecast(fit_laws(course(t, y, 1.0, steps), 20.0), unknown_population(), 20.0)
    assert with_it.rate == pytest.approx(0.05, rel=0.25)
    assert abs(with_it.quantile(0.5) - (24.0 / 0.05 - 200.0)) < 80.0


def test_an_engine_that_does_not_wear_may_last_for_ever():
    rng = np.random.default_rng(5)
    t = np.arange(1.0, 301.0, 5)
    found = forecast(fit_laws(course(t, 0.2 * rng.standard_normal(len(t)), 0.2), 30.0), unknown_population(), 30.0)
    assert found.quantile(0.95) == np.inf and found.quantile(0.05) > 1000
    assert TAU[-1] >= 50_000


@pytest.mark.parametrize("flights", [5, 20, 60])
def test_flights_in_which_nothing_grows_give_no_upper_end(flights):
    """At most one engine in twenty is given an end although it does not wear: 200 engines, three standard errors."""
    t, rng = np.arange(1.0, flights + 1.0), np.random.default_rng(flights)
    fits = (fit_laws(course(t, rng.standard_normal(flights), 1.0), 30.0) for _ in range(200))
    found = [forecast(fit, unknown_population(), 30.0) for fit in fits]
    assert np.mean([x.shows_growth for x in found]) <= 0.05 + 3 * np.sqrt(0.05 * 0.95 / 200)


def test_growth_of_many_standard_errors_is_shown():
    """0.3 K a flight over 20 flights is known to 0.04 K a flight: 8 standard errors."""
    t, rng = np.arange(1.0, 21.0), np.random.default_rng(8)
    fits = (fit_laws(course(t, 0.3 * t + rng.standard_normal(20), 1.0), 30.0) for _ in range(100))
    assert all(forecast(fit, unknown_population(), 30.0).shows_growth for fit in fits)


def test_a_limit_that_has_been_passed_leaves_no_flights():
    t = np.arange(1.0, 101.0, 5)
    found = forecast(fit_laws(course(t, 0.5 * t, 0.1), 10.0), straight(np.log(20.0), 0.5), 10.0)
    assert found.quantile(0.95) == 0.0


@pytest.mark.filterwarnings("error")
def test_thousands_of_flights_are_forecast_with_an_interval_although_steep_laws_leave_all_numbers():
    t = np.linspace(1.0, 20_000.0, 60)
    found = forecast(fit_laws(course(t, 1e-3 * t, 1.0), 40.0), unknown_population(), 40.0)
    assert found.rate == pytest.approx(1e-3, rel=0.1) and 0 < found.rate_error < 1e-3
    assert 0 < found.level_error < 2.0
