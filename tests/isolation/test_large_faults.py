"""Large changes, judged by the full nonlinear model."""

from __future__ import annotations

import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from turbofan_trials import faulty_window, turbofan_monitor, window_score

from enginediag_cli.isolation import nonlinear as window_model
from enginediag_cli.isolation.diagnosis import DiagnosisOptions, diagnose
from enginediag_cli.isolation.nonlinear import (
    COMPUTED,
    NATS,
    WindowModel,
    fit_sets,
    nonlinear_posterior,
    quadratic_error,
    restricted_changes,
    spread_records,
)
from enginediag_cli.isolation.posterior import set_posterior
from enginediag_cli.residuals.score import fisher_score

sys.path.insert(0, str(Path(__file__).parents[1] / "residuals"))
from toy_engine import toy_monitor, toy_recording

from enginediag_cli.residuals.pipeline import window_statistics
from enginediag_cli.residuals.windows import WindowPlan

BOUNDS = np.full(4, -0.2), np.full(4, 0.2)


def toy_window(seed, change, n=200, **monitor):
    """Monitor, model and score of a window of the toy engine."""
    watched = toy_monitor(**monitor)
    recording = toy_recording(np.random.default_rng(seed), n, change=change)
    inputs = {c: recording.columns[c] for c in watched.engine.inputs}
    y = np.column_stack([recording.columns[c] for c in watched.sensors])
    (window,) = window_statistics(watched, [recording], WindowPlan())
    return WindowModel(watched, inputs, y), fisher_score(window.statistics)


def test_the_expansion_has_the_gradient_of_the_log_likelihood_with_nuisance_taken_out():
    model, _ = toy_window(1, {"hpc.efficiency": -0.02}, offset=3.0, uncertain=2.0)
    change = np.array([0.001, -0.018, 0.002, 0.0])
    (here,) = model.expand(change[None])
    step = 1e-6 * np.eye(4)
    ahead, behind = model.log_likelihood(change + step), model.log_likelihood(change - step)
    np.testing.assert_allclose(here.gradient, (ahead - behind) / 2e-6, rtol=1e-4, atol=1e-2)


def test_a_log_likelihood_alone_is_that_of_the_expansion_wherever_the_engine_begins():
    monitor, rng = turbofan_monitor(), np.random.default_rng(4)
    inputs, y = faulty_window(rng, monitor, {"hpc.efficiency": -0.02}, 12)
    y[3, 2] = np.nan
    x = monitor.predict(inputs, monitor.theta0)[3].x
    changes = np.zeros((3, len(monitor.monitored)))
    changes[1, 2], changes[2, :3] = -0.01, 0.005
    cold, known = WindowModel(monitor, inputs, y), WindowModel(monitor, inputs, y, x)
    expected = [e.log_likelihood for e in cold.expand(changes)]
    np.testing.assert_allclose(cold.log_likelihood(changes), expected, rtol=1e-6, atol=1e-6)
    np.testing.assert_allclose(known.log_likelihood(changes), expected, rtol=1e-6, atol=1e-6)


def test_what_is_no_suspect_leaves_the_likelihood_of_other_changes_as_it_is():
    """The uncertainties of two parameters may make up for each other, also where one of them cannot have changed."""
    watched, rng = toy_monitor(offset=3.0, uncertain=2.0), np.random.default_rng(8)
    doubt = watched.uncertainty.copy()
    doubt[:2, :2] += 0.02**2 * np.array([[1.0, -0.9], [-0.9, 1.0]])
    watched = replace(watched, uncertainty=doubt)
    recording = toy_recording(rng, 60, change={"hpc.efficiency": -0.01})
    inputs = {c: recording.columns[c] for c in watched.engine.inputs}
    y = np.column_stack([recording.columns[c] for c in watched.sensors])
    fewer = watched.drop_parameters([watched.monitored[1]])
    assert fewer.monitored == (watched.monitored[0], *watched.monitored[2:])
    changes = 0.01 * rng.standard_normal((5, 4))
    changes[:, 1] = 0.0
    expected = WindowModel(watched, inputs, y).log_likelihood(changes)
    found = WindowModel(fewer, inputs, y).log_likelihood(np.delete(changes, 1, axis=1))
    np.testing.assert_allclose(found, expected, rtol=1e-6, atol=1e-6)


def test_what_is_uncertain_about_nominal_counts_alike_in_the_full_model_and_in_the_statistics():
    """A reading may be off by 5000 K, an efficiency by 10⁻⁴: neither may be lost in rounding."""
    watched = toy_monitor(offset=5e3, uncertain=2.0)
    doubt = watched.uncertainty.copy()
    doubt[range(4), range(4)] = np.square([3e-4, 4e-4, 2e-4, 3e-4])
    watched = replace(watched, uncertainty=doubt)
    recording = toy_recording(np.random.default_rng(11), 60)
    inputs = {c: recording.columns[c] for c in watched.engine.inputs}
    y = np.column_stack([recording.columns[c] for c in watched.sensors])
    (window,) = window_statistics(watched, [recording], WindowPlan(), linearise="nominal")
    score = fisher_score(window.statistics)
    (here,) = WindowModel(watched, inputs, y).expand(np.zeros((1, 4)))
    np.testing.assert_allclose(here.gradient, score.b, rtol=1e-5, atol=1e-3 * np.abs(score.b).max())
    np.testing.assert_allclose(here.information, score.information, rtol=1e-4, atol=1e-6 * score.information.max())


def test_of_a_small_change_the_full_model_says_what_the_quadratic_says():
    model, score = toy_window(2, {"hpc.efficiency": -0.002}, offset=3.0)
    plain = set_posterior(score)
    assert quadratic_error(model, score, plain.masks[:5]) < 0.1
    found = nonlinear_posterior(model, score)
    assert found.converged and found.posterior.names(0) == plain.names(0)
    np.testing.assert_allclose(found.posterior.inclusion, plain.inclusion, atol=0.1)


def test_the_fit_of_the_true_set_recovers_a_large_change_within_its_error():
    model, score = toy_window(3, {"fan.efficiency": -0.08, "hpt.efficiency": -0.1})
    mask = np.array([[True, False, False, True]])
    (fit,) = fit_sets(model, mask, restricted_changes(score, mask), BOUNDS)
    assert fit.converged and fit.change[1] == fit.change[2] == 0
    error = np.sqrt(np.diag(np.linalg.inv(fit.expansion.information[np.ix_([0, 3], [0, 3])])))
    assert np.all(np.abs(fit.change[[0, 3]] - [-0.08, -0.1]) < 4 * error)


def test_what_is_interpolated_between_operating_points_is_exact_where_it_is_linear():
    rng = np.random.default_rng(12)
    inputs = {"altitude_m": rng.uniform(0, 1e4, 500), "mach": rng.uniform(0, 0.8, 500), "dT_isa_K": np.zeros(500)}
    chosen, weights = spread_records(inputs, 500)
    straight = 3.0 - 1e-3 * inputs["altitude_m"] + 5.0 * inputs["mach"]
    np.testing.assert_allclose(weights @ straight[chosen], straight, rtol=1e-9, atol=1e-9)
    np.testing.assert_allclose(weights[chosen], np.eye(len(chosen)), atol=1e-8)
    assert len(chosen) == COMPUTED and np.array_equal(spread_records(inputs, COMPUTED)[1], np.eye(COMPUTED))


def test_a_window_computed_at_some_of_its_records_has_the_likelihood_of_all_of_them(monkeypatch):
    """Log likelihood ratios between changes of 5 and 10 % along a climb, to a nat in ten thousand."""
    monitor = turbofan_monitor()
    x = np.linspace(0, 1, 160)
    inputs = {"altitude_m": 1e4 * x, "mach": 0.3 + 0.5 * x**2, "dT_isa_K": 5 - 10 * x}
    inputs["Wf_kg_s"] = monitor.engine.power_from_fraction(0.95 - 0.3 * x, inputs)
    theta = monitor.theta0 + 0.0
    theta[monitor.names.index("hpc.efficiency")] -= 0.1
    y = monitor.predict(inputs, theta)[0]
    changes = np.zeros((3, len(monitor.monitored)))
    changes[0, monitor.names.index("hpc.efficiency")] = -0.1
    changes[1, monitor.names.index("lpt.flow_capacity")] = changes[2, monitor.names.index("fan.efficiency")] = -0.05
    some = WindowModel(monitor, inputs, y)
    monkeypatch.setattr(window_model, "COMPUTED", 1000)
    every = WindowModel(monitor, inputs, y)
    expected = every.log_likelihood(changes)
    np.testing.assert_allclose(some.log_likelihood(changes), expected, atol=1e-4 * np.ptp(expected))
    for one, whole in zip(some.expand(changes), every.expand(changes), strict=True):
        np.testing.assert_allclose(one.information, whole.information, rtol=0.01, atol=1e-3 * whole.information.max())


def test_a_parameter_at_its_bound_stays_there_and_the_others_settle_without_it():
    model, score = toy_window(13, {"fan.efficiency": -0.08, "hpt.efficiency": -0.1})
    mask = np.array([[True, False, False, True]])
    (fit,) = fit_sets(model, mask, restricted_changes(score, mask), (np.full(4, -0.05), np.full(4, 0.05)))
    assert fit.converged and fit.change[3] == -0.05
    free = abs(fit.change[0]) < 0.05
    assert not free or abs(fit.expansion.gradient[0]) < 0.1 * np.sqrt(fit.expansion.information[0, 0])


def test_a_start_that_the_model_cannot_compute_is_replaced_by_no_change():
    model, _ = toy_window(4, {"hpc.efficiency": -0.05})
    mask = np.array([[False, True, False, False]])
    with np.errstate(invalid="ignore"):
        (fit,) = fit_sets(model, mask, np.full((1, 4), np.nan), BOUNDS)
    assert fit.converged and fit.change[1] == pytest.approx(-0.05, abs=0.005)


def test_readings_that_are_missing_are_left_out_of_the_likelihood():
    watched = toy_monitor()
    recording = toy_recording(np.random.default_rng(5), 50, change={"hpc.efficiency": -0.05})
    inputs = {c: recording.columns[c] for c in watched.engine.inputs}
    y = np.column_stack([recording.columns[c] for c in watched.sensors])
    y[::3, 1] = np.nan
    blank = WindowModel(watched, inputs, y).log_likelihood(np.array([[0, -0.05, 0, 0]]))
    full = WindowModel(watched, inputs, np.nan_to_num(y)).log_likelihood(np.array([[0, -0.05, 0, 0]]))
    assert np.isfinite(blank[0]) and blank[0] > 0 and blank[0] != full[0]


@pytest.mark.parametrize(
    "change",
    [{"lpt.flow_capacity": -0.1}, {"hpt.flow_capacity": -0.1, "lpt.flow_capacity": -0.1}, {"fan.efficiency": -0.05}],
)
def test_changes_of_5_and_10_percent_of_the_turbofan_are_isolated_exactly(change):
    monitor = turbofan_monitor()
    inputs, y = faulty_window(np.random.default_rng(6), monitor, change)
    score = window_score(monitor, inputs, y)
    found = diagnose(score, DiagnosisOptions(), lambda: WindowModel(monitor, inputs, y))
    assert set(found.result.isolated) == set(change) and found.result.probability > 0.8
    for size in found.result.sizes:
        assert abs(size.change - change[size.parameter]) < 4 * size.standard_error


def test_the_quadratic_isolates_too_much_after_10_percent_and_knows_that_it_fails():
    monitor = turbofan_monitor()
    rng = np.random.default_rng(7)
    wrong = 0
    for _ in range(4):
        inputs, y = faulty_window(rng, monitor, {"lpt.flow_capacity": -0.1})
        score = window_score(monitor, inputs, y)
        plain = diagnose(score, DiagnosisOptions(nonlinear="never"))
        model = WindowModel(monitor, inputs, y)
        wrong += plain.result.isolated != ("lpt.flow_capacity",)
        assert quadratic_error(model, score, set_posterior(score).masks[:5]) > NATS
        found = diagnose(score, DiagnosisOptions(), lambda model=model: model)
        assert found.nonlinear and found.result.isolated == ("lpt.flow_capacity",)
    assert wrong >= 2


def test_never_means_never_and_always_means_always():
    model, score = toy_window(8, {"hpc.efficiency": -0.002})
    for choice, expected in (("never", False), ("auto", False), ("always", True)):
        assert diagnose(score, DiagnosisOptions(nonlinear=choice), lambda: model).nonlinear is expected


def test_records_no_longer_at_hand_are_told_in_the_note():
    _, score = toy_window(9, {"hpc.efficiency": -0.02})
    found = diagnose(score, DiagnosisOptions(), lambda: None)
    assert "no longer at hand" in found.result.note and not found.result.complete
