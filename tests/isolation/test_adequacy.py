"""Whether an answer fits: an engine with other maps, changes that no engine shows, and engines that the model knows."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from turbofan_trials import turbofan_monitor

from enginediag_cli.isolation.adequacy import LIMIT, Adequacy, fit_after, judged, tempered
from enginediag_cli.isolation.components import isolate_components
from enginediag_cli.isolation.diagnosis import DiagnosisOptions, diagnose
from enginediag_cli.isolation.sizes import estimate_sizes
from enginediag_cli.recordings.table import Recording
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


@pytest.mark.parametrize("maps", OTHER_MAPS)
def test_of_an_engine_with_other_maps_isolate_cannot_tell_where_it_was_sure_of_changes_that_cannot_be(maps):
    found = statistics(1, maps)
    told = answer(found)
    assert told.result.probability > 0.8 and not told.adequacy.stands
    assert told.adequacy.beyond is not None
    assert not isolate_components(fisher_score(found), None, found).adequacy.stands


def test_where_nothing_explains_the_records_the_answer_does_not_stand_and_its_probability_falls():
    fits = statistics(1, {"hpc.efficiency": 0.99, "lpt.efficiency": 0.995})
    found = replace(fits, chi2=8 * fits.chi2)
    told, plain = answer(found), answer(fits)
    assert told.adequacy.misfit and told.adequacy.fit > LIMIT and told.adequacy.dispersion > LIMIT
    assert told.result.probability < plain.result.probability
    component = isolate_components(fisher_score(found), None, found)
    assert component.adequacy.misfit or not component.components


@pytest.mark.parametrize("change", [{}, {"hpc.efficiency": 0.98}, {"hpc.efficiency": 0.97, "hpc.flow_capacity": 0.96}])
def test_where_the_model_fits_the_answer_is_the_same_as_without_the_question(change):
    found = statistics(2, change)
    told, plain = answer(found), diagnose(fisher_score(found), DiagnosisOptions())
    assert told.adequacy.stands and told.adequacy.dispersion == 1 and 0.7 < told.adequacy.fit < 1.4
    assert told.result == plain.result and set(told.result.isolated) == set(change)


def test_what_is_left_by_the_wrong_answer_is_more_than_what_is_left_by_the_right_one():
    found = statistics(3, {"hpc.efficiency": 0.97})
    score = fisher_score(found)
    right, wrong = (fit_after(score, found, [name]) for name in ("hpc.efficiency", "fan.efficiency"))
    assert right.p_value > 0.001 and wrong.p_value < 1e-6 and wrong.fit > right.fit


def test_intervals_widen_by_the_root_of_the_dispersion():
    score = fisher_score(statistics(4, {"hpc.efficiency": 0.98}))
    (plain,), (wide,) = (estimate_sizes(s, ["hpc.efficiency"]) for s in (score, tempered(score, 4.0)))
    assert wide.change == pytest.approx(plain.change)
    assert wide.standard_error == pytest.approx(2 * plain.standard_error)


def test_noise_that_is_hardly_known_makes_no_lack_of_fit_certain():
    found = statistics(1, OTHER_MAPS[0])
    known = fisher_score(found)
    guessed = replace(known, doubt=(0.0, 2.0 * known.rank, 0.0))  # a variance from one reading or so
    assert fit_after(known, found, ()).gross and not fit_after(guessed, found, ()).gross


def test_an_efficiency_that_rises_by_a_fifth_is_not_believed_and_a_fall_or_a_broken_sensor_is():
    score = fisher_score(statistics(5, {}))

    def as_if(name, change):
        """The answer `name` on a score that says that it changed so much."""
        b = score.information[:, score.parameters.index(name)] * change
        return judged(Adequacy(1.0, 0.5), replace(score, b=b), [name], 0.99)

    assert as_if("hpc.efficiency", 0.2).beyond == ("hpc.efficiency", pytest.approx(0.2))
    assert as_if("hpc.efficiency", -0.2).stands and as_if("hpt.flow_capacity", 0.2).stands
    assert not as_if("hpc.flow_capacity", 0.4).stands
    assert as_if("sensor.T3.bias", 300.0).stands


def test_no_change_is_an_answer_that_always_stands():
    score = fisher_score(statistics(6, {}))
    assert judged(Adequacy(20.0, 0.0), score, [], 0.3).stands


def test_every_answer_says_what_was_to_be_explained_and_how_much_of_it_is():
    found = statistics(2, {"hpc.efficiency": 0.98})
    told = answer(found).adequacy
    assert told.before > 1.2 > told.fit and told.explained > 0.95
    healthy = answer(statistics(2, {})).adequacy
    assert healthy.before == pytest.approx(healthy.fit, rel=0.1) and np.isnan(healthy.explained)


def test_a_misfit_that_no_change_explains_is_said_to_be_unexplained():
    fits = statistics(1, {"hpc.efficiency": 0.99})
    told = answer(replace(fits, chi2=8 * fits.chi2)).adequacy
    assert told.before > 7 and told.explained < 0.2
