"""What is kept of a point of a fit: derivatives that serve near by, and sums made of them."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from identification_toy import ToyEngine, fly

from enginediag_cli.engine.wrapped import warm_start
from enginediag_cli.identification.gauss_newton import Fit
from enginediag_cli.identification.identify import _equations_without
from enginediag_cli.identification.map_error import add_map_errors, restrict_map_range
from enginediag_cli.identification.normal_equations import near_equations, normal_equations, predict_records
from enginediag_cli.identification.problem import IdentificationSettings, TrainingRecording, build_problem
from enginediag_cli.physics.engine_file import load_engine
from enginediag_cli.shipped import shipped

SUMS = ("H_xx", "H_xz", "H_zz", "g_x", "g_z", "record_cost")
SHARED_SEVEN_DIGITS = 1e-6


@pytest.fixture(scope="module")
def problem():
    engine, rng = ToyEngine(), np.random.default_rng(5)
    settings = IdentificationSettings(recording_bias_sigma={"T3_K": 2.0}, recording_scale_sigma={"P3_Pa": 0.01})
    return build_problem(engine, [fly(engine, rng, 40, "a"), fly(engine, rng, 30, "b")], settings)


@pytest.fixture(scope="module")
def point(problem):
    rng = np.random.default_rng(6)
    return 0.2 * rng.standard_normal(len(problem.parameters)), 0.3 * rng.standard_normal((2, len(problem.offsets)))


def same(a, b, fields=SUMS):
    for name in fields:
        expected = getattr(b, name)
        size = float(np.abs(expected).max(initial=1e-300))
        assert getattr(a, name) == pytest.approx(expected, rel=SHARED_SEVEN_DIGITS, abs=SHARED_SEVEN_DIGITS * size)


def test_sums_of_what_was_kept_are_those_of_asking_again(problem, point):
    same(normal_equations(problem, *point, predict_records(problem, *point)), normal_equations(problem, *point))


def test_other_noise_needs_no_new_derivatives(problem, point):
    other = problem.replace_noise(1.7 * problem.sigma, np.full(4, 2.0))
    same(normal_equations(other, *point, predict_records(problem, *point)), normal_equations(other, *point))


def test_the_gradient_with_kept_derivatives_is_exact_where_they_were_taken(problem, point):
    here = normal_equations(problem, *point, predict_records(problem, *point))
    found = near_equations(problem, *point, here)
    same(found, here, ("g_x", "g_z", "record_cost"))
    assert here.prediction.exact
    assert not found.prediction.exact


def test_the_cost_near_by_is_exact_and_the_gradient_nearly(problem, point):
    here = normal_equations(problem, *point, predict_records(problem, *point))
    x, z = point[0] + 1e-3, point[1] + 1e-3
    found, expected = near_equations(problem, x, z, here), normal_equations(problem, x, z)
    assert found.record_cost == pytest.approx(expected.record_cost, rel=1e-12)
    assert found.g_x == pytest.approx(expected.g_x, rel=0.02, abs=1e-3 * np.abs(expected.g_x).max())


def test_readings_left_out_count_as_missing(problem, point):
    kept = predict_records(problem, *point)
    out = np.arange(len(problem.recording)) % 3 == 0
    without = replace(problem, measured=np.where(out[:, None], np.nan, problem.measured))
    whole, part = (
        normal_equations(p, *point, k) for p, k in ((problem, kept), (problem.select(out), kept.select(out)))
    )
    rest = normal_equations(without, *point, kept)
    for name in SUMS[:-1]:
        assert getattr(whole, name) - getattr(part, name) == pytest.approx(getattr(rest, name), rel=1e-6, abs=1e-6)


def test_a_record_that_fails_has_neither_prediction_nor_weight(point):
    engine = ToyEngine(fails=lambda u, p: u["N1_pct"] > 96)
    problem = build_problem(engine, [fly(ToyEngine(), np.random.default_rng(5))], IdentificationSettings())
    x, z = point[0], np.zeros((1, 0))
    kept = predict_records(problem, x, z)
    assert 0 < np.sum(kept.status > 1) < len(kept.status)
    assert np.isnan(kept.y[kept.status > 1]).all()
    same(normal_equations(problem, x, z, kept), normal_equations(problem, x, z))


@pytest.fixture(scope="module")
def turbojet():
    """Records of a turbojet, climbing, and the same with errors of its maps among what is sought."""
    engine, rng, n = load_engine(str(shipped("turbojet.yaml"))), np.random.default_rng(1), 40
    h = np.sort(rng.uniform(0, 10_000, n))
    columns = {"altitude_m": h, "mach": 0.3 + 0.5 * h / 11_000, "dT_isa_K": np.full(n, 3.0)}
    columns[engine.power_setting] = engine.power_from_fraction(np.linspace(0.3, 1, n), columns)
    readings = engine.predict(columns, {}, sensors=list(engine.sensors)).y
    columns |= dict(zip(engine.sensors, readings.T, strict=True))
    plain = build_problem(warm_start(engine), [TrainingRecording("flight", columns)], IdentificationSettings())
    return plain, add_map_errors(plain, 0.01)


def test_amounts_of_map_error_follow_from_columns_of_the_records(turbojet):
    """Asked as directions of the model, and as products of what each record brings along."""
    plain, extended = turbojet
    rng = np.random.default_rng(1)
    x, z = 0.1 * rng.standard_normal(len(extended.parameters)), np.zeros((1, 0))
    kept = predict_records(extended, x, z)
    assert kept.tangent.amounts == len(extended.parameters) - len(plain.parameters) > 0
    assert kept.matches(extended)
    assert not kept.matches(plain)
    same(normal_equations(extended, x, z, kept), normal_equations(extended, x, z))


def test_maps_know_no_other_range_than_that_of_the_records_that_are_left(turbojet):
    plain, extended = turbojet
    early = np.arange(len(plain.recording)) < 25
    left = restrict_map_range(extended, early)
    alone = add_map_errors(plain.select(early), 0.01)
    for curves, expected, whole in zip(left.model.curves, alone.model.curves, extended.model.curves, strict=True):
        assert curves.centre == pytest.approx(expected.centre)
        assert curves.reach == pytest.approx(expected.reach)
        assert curves.centre != whole.centre
    assert restrict_map_range(plain, early) is plain


def test_what_was_kept_needs_no_new_derivatives_where_errors_of_maps_have_another_range(turbojet):
    plain, extended = turbojet
    x, z = 0.1 * np.random.default_rng(1).standard_normal(len(extended.parameters)), np.zeros((1, 0))
    kept, left = predict_records(extended, x, z), restrict_map_range(extended, np.arange(len(plain.recording)) < 25)
    same(normal_equations(left, x, z, kept.replace_curves(left, x)), normal_equations(left, x, z))
    of_none = predict_records(plain, x[: len(plain.parameters)], z)
    assert of_none.replace_curves(plain, x[: len(plain.parameters)]) is of_none


@pytest.mark.parametrize("maps", [False, True])
def test_a_fit_without_a_block_begins_at_the_equations_of_all_other_records(turbojet, maps):
    """Made of those of the whole, with the errors of maps that a fit without the block has."""
    problem = turbojet[maps]
    x, z = 0.1 * np.random.default_rng(1).standard_normal(len(problem.parameters)), np.zeros((1, 0))
    whole = normal_equations(problem, x, z, predict_records(problem, x, z))
    out = np.arange(len(problem.recording)) >= 25
    rest = restrict_map_range(problem, ~out)
    found = _equations_without(rest, Fit(x, z, whole, np.zeros(len(x), bool), True, "", ()), out)
    expected = normal_equations(replace(rest, measured=np.where(out[:, None], np.nan, rest.measured)), x, z)
    same(found, expected)
    assert np.isnan(found.residual[out]).all()
    assert found.residual[~out] == pytest.approx(expected.residual[~out], rel=1e-6, abs=1e-6)
