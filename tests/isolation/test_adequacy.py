"""Whether an answer fits: an engine with other maps, changes that no engine shows, and engines that the model knows."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.stats import norm
from turbofan_trials import turbofan_monitor

from enginediag_cli.detection.verdict import lack_of_fit
from enginediag_cli.isolation.diagnosis import DiagnosisOptions, diagnose, isolate_components
from enginediag_cli.isolation.prior import SetPrior
from enginediag_cli.isolation.results import (
    estimate_sizes,
    find_impossible_change,
    noise_level,
    probability_of_unlisted,
    residual_fit,
    temper,
)
from enginediag_cli.recordings.table import Recording
from enginediag_cli.residuals.instruments import KNOWN
from enginediag_cli.residuals.pipeline import window_statistics
from enginediag_cli.residuals.score import fisher_score
from enginediag_cli.residuals.windows import WindowPlan

OTHER_MAPS = (
    {"hpc.map.flow_speed_exponent": 0.7, "fan.map.flow_speed_exponent": 3.0, "lpt.map.efficiency_loading": 4.0},
    {"fan.map.flow_speed_exponent": 3.5, "hpt.map.capacity_speed_slope": 0.4, "lpt.map.capacity_speed_slope": -0.4},
)


def statistics(seed, change, n=100):
    """Statistics of a window of the turbofan with the parameters `change`, name -> value, with Gaussian noise."""
    monitor, rng = turbofan_monitor(sensors=True), np.random.default_rng(seed)
    phase = np.linspace(0, 1, n)
    inputs = {"altitude_m": 9e3 * phase, "mach": 0.3 + 0.4 * phase, "dT_isa_K": np.full(n, 5.0)}
    inputs["Wf_kg_s"] = monitor.engine.power_from_fraction(0.95 - 0.35 * phase, inputs)
    y = monitor.engine.predict(inputs, change).y + monitor.noise.sigma * rng.standard_normal((n, len(monitor.sensors)))
    columns = {**inputs, **dict(zip(monitor.sensors, y.T, strict=True))}
    (window,) = window_statistics(monitor, [Recording(columns)], WindowPlan())
    assert window.statistics is not None, window.reason
    return window.statistics


def answer(found):
    return diagnose(fisher_score(found), DiagnosisOptions(), None, found)


def with_rest(found, ratio):
    """The statistics with a χ² that leaves `ratio` per degree of freedom when all parameters are free."""
    rest = lack_of_fit(found)
    return replace(found, chi2=found.chi2 + (ratio - rest.ratio) * rest.dof)


@pytest.mark.parametrize("maps", OTHER_MAPS)
def test_of_an_engine_with_other_maps_nothing_listed_is_sure(maps):
    found = statistics(1, maps)
    told = answer(found)
    assert not told.adequacy.is_listed and told.result.probability < 0.5
    assert told.adequacy.unlisted + told.result.probability <= 1.0 + 1e-12
    assert not isolate_components(fisher_score(found), None, found).adequacy.is_listed


@pytest.mark.parametrize(("ratio", "most"), [(3.0, 0.9), (4.0, 0.3), (8.0, 0.01)])
def test_the_more_an_answer_leaves_the_less_probable_it_is(ratio, most):
    fits = statistics(1, {"hpc.efficiency": 0.97})
    told, plain = answer(with_rest(fits, ratio)), answer(fits)
    assert told.adequacy.fit == pytest.approx(ratio, rel=0.05)
    assert told.result.probability < most < plain.result.probability and plain.adequacy.unlisted < 0.02
    component = isolate_components(fisher_score(fits), None, with_rest(fits, ratio))
    assert component.probability < most
    assert all(0 <= q <= 1 for q in (*told.result.inclusion.values(), *component.inclusion.values()))


@pytest.mark.parametrize("change", [{}, {"hpc.efficiency": 0.98}, {"hpc.efficiency": 0.97, "hpc.flow_capacity": 0.96}])
def test_where_the_model_fits_the_answer_is_the_same_as_without_the_question(change):
    found = statistics(2, change)
    told, plain = answer(found), diagnose(fisher_score(found), DiagnosisOptions())
    assert told.adequacy.is_listed and told.adequacy.noise < 1.2 and 0.7 < told.adequacy.fit < 1.4
    assert told.result.isolated == plain.result.isolated and set(told.result.isolated) == set(change)
    assert told.result.probability == pytest.approx(plain.result.probability, abs=0.05)


def test_what_is_left_by_the_wrong_answer_is_more_than_what_is_left_by_the_right_one():
    found = statistics(3, {"hpc.efficiency": 0.97})
    score = fisher_score(found)
    right, wrong = (residual_fit(score, found, [name]).fit for name in ("hpc.efficiency", "fan.efficiency"))
    assert wrong > right


def test_intervals_widen_by_the_root_of_the_noise():
    score = fisher_score(statistics(4, {"hpc.efficiency": 0.98}))
    (plain,), (wide,) = (estimate_sizes(s, ["hpc.efficiency"]) for s in (score, temper(score, 4.0)))
    assert wide.change == pytest.approx(plain.change)
    assert wide.standard_error == pytest.approx(2 * plain.standard_error)


def test_the_noise_is_divided_out_less_where_it_is_hardly_known_and_its_law_is_that_of_a_normal_logarithm():
    found = with_rest(statistics(1, {}), 3.0)
    known = fisher_score(found)
    guessed = replace(known, doubt=(0.0, 2.0 * known.rank, 0.0))  # a variance from one reading or so
    sure, doubtful = noise_level(known, found), noise_level(guessed, found)
    assert 1.0 < doubtful.factor < 1.2 and 2.5 < sure.factor <= 3.0
    variance = KNOWN**2 + 2.0 / lack_of_fit(found).dof
    assert sure.log_stated == pytest.approx(norm.logpdf(np.log(3.0), 0.0, np.sqrt(variance)), rel=1e-6)
    unlisted = [probability_of_unlisted(level, 0.0, -np.inf) for level in (sure, doubtful)]
    assert unlisted[1] < 0.05 < unlisted[0]


def test_all_readings_off_at_once_by_amounts_that_no_set_makes_is_something_that_is_not_listed():
    rng, found = np.random.default_rng(3), statistics(7, {})
    sensors = [i for i, p in enumerate(fisher_score(found).described) if p.belongs_to_sensor]
    change = np.zeros(len(found.parameters))
    change[sensors] = 3 * found.prior_sigma[sensors] * rng.choice([-1.0, 1.0], len(sensors))
    e = found.F @ change
    off = replace(found, s=found.s + e, chi2=found.chi2 + float(2 * found.s @ change + change @ e))
    told = answer(off)
    assert told.adequacy.unlisted > 0.9 and not told.adequacy.is_listed and told.result.probability < 0.1


def test_changes_that_no_component_can_do_are_reported_and_named_by_nothing():
    score = fisher_score(statistics(5, {}))

    def as_if(name, change):
        """What would fit best on a score that says that it changed so much."""
        b = score.information[:, score.parameters.index(name)] * change
        return find_impossible_change(replace(score, b=b), SetPrior())

    assert as_if("hpc.efficiency", 0.2) == ("hpc.efficiency", pytest.approx(0.2, rel=1e-3))
    assert as_if("hpc.efficiency", -0.2) is None and as_if("hpt.flow_capacity", 0.2) is None
    assert as_if("hpt.flow_capacity", 0.4) is not None and as_if("sensor.T3.bias", 100.0) is None
    assert as_if("sensor.T3.bias", 300.0) == ("sensor.T3.bias", pytest.approx(300.0, rel=1e-3))


def test_no_size_is_outside_what_a_component_can_do():
    found = statistics(5, {})
    i = found.parameters.index("booster.efficiency")
    s = found.F[:, i] * 0.17
    told = answer(replace(found, s=found.s + s, chi2=found.chi2 + 0.17**2 * found.F[i, i]))
    assert not (told.adequacy.is_listed and "booster.efficiency" in told.result.isolated)
    low, high = SetPrior().bounds(fisher_score(found).described)
    for size in told.result.sizes:
        k = found.parameters.index(size.parameter)
        assert low[k] <= size.change / found.prior_sigma[k] <= high[k]


def test_every_answer_says_what_was_to_be_explained_and_how_much_of_it_is():
    found = statistics(2, {"hpc.efficiency": 0.98})
    told = answer(found).adequacy
    assert told.fit_before > 1.2 > told.fit and told.explained > 0.95
    healthy = answer(statistics(2, {})).adequacy
    assert healthy.fit_before == pytest.approx(healthy.fit, rel=0.1) and np.isnan(healthy.explained)


def test_a_misfit_that_no_change_explains_is_said_to_be_unexplained():
    told = answer(with_rest(statistics(1, {"hpc.efficiency": 0.99}), 8.0)).adequacy
    assert told.fit_before > 7 and told.explained < 0.2
