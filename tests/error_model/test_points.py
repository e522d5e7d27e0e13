"""What a model misses at operating points flown again and again."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from enginediag_cli.error_model.maps import MapErrorModel, OperatingPoints, PointErrorModel, resize_point_errors
from enginediag_cli.physics.engine_file import load_engine

CONFIGS = Path(__file__).parents[2] / "configs"
SIZES = {"T3_K": 1.0, "N2_rpm": 5.0}


@pytest.fixture(scope="module")
def engine():
    return load_engine(CONFIGS / "cmapss_turbofan.yaml")


@pytest.fixture(scope="module")
def points(engine):
    low = np.array([[-10.0, 0.0, -1.0, 2300.0], [9900.0, 0.8, -1.0, 2200.0]])
    return OperatingPoints(tuple(engine.inputs), low, low + np.array([200.0, 0.05, 2.0, 120.0]))


@pytest.fixture(scope="module")
def flown():
    """One record at each of two points, and one at neither."""
    return {
        "altitude_m": np.array([0.0, 10000.0, 5000.0]),
        "mach": np.array([0.01, 0.82, 0.5]),
        "dT_isa_K": np.zeros(3),
        "N1_rpm": np.array([2388.0, 2250.0, 2300.0]),
    }


def test_a_record_is_at_the_point_whose_ranges_hold_it_and_else_at_none(points, flown):
    assert points.assign(flown).tolist() == [0, 1, 2]


def test_an_error_moves_its_own_reading_at_its_own_point_alone(engine, points, flown):
    model = PointErrorModel(engine, points, SIZES)
    name = model.groups["N2_rpm"][1]
    plain, moved = engine.predict(flown), model.predict(flown, {name: 3.0})
    expected = np.zeros_like(plain.y)
    expected[1, plain.columns.index("N2_rpm")] = 3.0
    assert np.allclose(moved.y - plain.y, expected)


def test_records_at_no_point_have_one_error_in_common(engine, points, flown):
    model = PointErrorModel(engine, points, SIZES)
    elsewhere = model.groups["T3_K"][-1]
    J = model.predict(flown, {}, wrt=(elsewhere,)).jacobian[:, :, 0]
    assert np.flatnonzero(J).tolist() == [2 * J.shape[1] + model.predict(flown).columns.index("T3_K")]


def test_sensitivities_are_those_of_the_engine_and_differences_of_the_predictions(engine, points, flown):
    model = PointErrorModel(engine, points, SIZES)
    name = model.groups["T3_K"][0]
    p = model.predict(flown, {name: 2.0}, wrt=(name, "hpc.efficiency"))
    assert np.array_equal(p.jacobian[:, :, 1], engine.predict(flown, wrt=("hpc.efficiency",)).jacobian[:, :, 0])
    # points are solved to their tolerance, from starts that may differ
    assert np.allclose(p.jacobian[:, :, 0], model.predict(flown, {name: 3.0}).y - p.y, atol=1e-12 * np.abs(p.y).max())
    assert p.wrt == (name, "hpc.efficiency")


def test_it_stands_below_errors_of_the_maps(engine, points, flown):
    model = MapErrorModel(PointErrorModel(engine, points, SIZES), (), {})
    name = f"{PointErrorModel(engine, points, SIZES).groups['T3_K'][0]}"
    assert name in model.parameters
    assert np.any(model.predict(flown, {name: 1.0}).y != engine.predict(flown).y)


def test_other_sizes_change_what_is_believed_before_and_nothing_else(engine, points, flown):
    model = PointErrorModel(engine, points, SIZES)
    other = resize_point_errors(model, {**SIZES, "T3_K": 4.0})
    assert other.parameters[model.groups["T3_K"][0]].prior_sigma == 4.0
    assert other.parameters.keys() == model.parameters.keys()
