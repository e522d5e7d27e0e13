"""A point that cannot be answered is a flagged row with a reason; the other rows are as without it."""

from __future__ import annotations

import warnings

import numpy as np
import pytest
from engine_makers import TURBOFAN, operating_points, take, turbofan

from enginediag_cli.physics.engine_file import load_engine

N = 60
OK, OUTSIDE, NOT_CONVERGED, INVALID = range(4)


@pytest.fixture(scope="module")
def engine():
    return turbofan()


@pytest.fixture(scope="module")
def points(engine):
    return operating_points(engine, N, 31)


def with_row(points, k, **values):
    changed = {c: v.copy() for c, v in points.items()}
    for column, v in values.items():
        changed[column][k] = v
    return changed


BAD = {
    "no fuel flow": ({"Wf_kg_s": np.nan}, INVALID),
    "no altitude": ({"altitude_m": np.nan}, INVALID),
    "infinite Mach": ({"mach": np.inf}, INVALID),
    "negative fuel": ({"Wf_kg_s": -1.0}, INVALID),
    "zero fuel": ({"Wf_kg_s": 0.0}, INVALID),
    "a hundred times the fuel": ({"Wf_kg_s": 200.0}, NOT_CONVERGED),
    "almost no fuel": ({"Wf_kg_s": 1e-6}, NOT_CONVERGED),
    "outer space": ({"altitude_m": 1e6}, NOT_CONVERGED),
    "colder than nothing": ({"dT_isa_K": -400.0}, NOT_CONVERGED),
}


@pytest.fixture(scope="module", params=BAD)
def answered(request, engine, points):
    """The answer to a batch with one bad row, the status that the row should have, and the warnings raised."""
    change, status = BAD[request.param]
    with warnings.catch_warnings(record=True) as raised:
        warnings.simplefilter("always")
        p = engine.predict(with_row(points, 7, **change), wrt=engine.monitored)
    return p, status, [str(w.message) for w in raised]


def test_a_bad_row_is_flagged_with_a_reason_and_has_no_value(answered):
    p, status, _ = answered
    assert p.status[7] == status
    assert not p.ok[7]
    assert p.reason(7)
    assert np.isnan(p.y[7]).all()
    assert np.isnan(p.jacobian[7]).all()


def test_a_bad_row_raises_no_warnings(answered):
    assert answered[2] == []


def test_a_bad_row_does_not_change_the_others(engine, points, answered):
    clean, p = engine.predict(points, wrt=engine.monitored), answered[0]
    others = np.arange(N) != 7
    assert p.ok[others].all()
    assert np.allclose(p.y[others], clean.y[others], rtol=1e-9)
    scale = np.abs(clean.jacobian).max(axis=0)
    assert (np.abs(p.jacobian - clean.jacobian)[others] <= 1e-6 * scale).all()
    assert all(p.reason(k) == "" for k in np.flatnonzero(others))


def test_many_bad_rows_of_every_kind_leave_the_good_ones(engine, points):
    bad = points
    for k, (change, _) in enumerate(BAD.values()):
        bad = with_row(bad, 5 * k, **change)
    p = engine.predict(bad)
    good = np.setdiff1d(np.arange(N), 5 * np.arange(len(BAD)))
    assert p.ok.sum() == N - len(BAD)
    assert np.allclose(p.y[good], engine.predict(points).y[good], rtol=1e-9)


def test_bad_rows_in_a_large_batch_do_not_spoil_the_fitted_start():
    U = operating_points(turbofan(), 1500, 33)
    bad = {c: v.copy() for c, v in U.items()}
    bad["Wf_kg_s"][::10] = np.nan
    bad["Wf_kg_s"][1::300] = 1e4
    bad["altitude_m"][2::300] = 1e6
    good = np.isfinite(bad["Wf_kg_s"]) & (bad["Wf_kg_s"] < 100.0) & (bad["altitude_m"] < 2e4)
    p, clean = load_engine(TURBOFAN).predict(bad), load_engine(TURBOFAN).predict(U)
    assert p.ok[good].all()
    assert not p.ok[~good].any()
    assert np.allclose(p.y[good], clean.y[good], rtol=1e-9)


def test_a_batch_of_bad_rows_only_is_an_answer_too(engine, points):
    p = engine.predict({**points, "Wf_kg_s": np.full(N, np.nan)}, wrt=engine.monitored)
    assert (p.status == INVALID).all()
    assert np.isnan(p.y).all()
    p = engine.predict({**points, "Wf_kg_s": np.full(N, 500.0)})
    assert not p.ok.any()


def test_the_reason_for_not_converging_names_a_component_and_its_balance(engine, points):
    p = engine.predict(with_row(points, 3, Wf_kg_s=200.0))
    component = p.reason(3).split()[0]
    names = {c.name for c in engine.network.components} | set(engine.network.shafts)
    assert component in names
    assert "not met" in p.reason(3)
    assert "residual" in p.reason(3)


def test_an_invalid_input_is_named_in_the_reason(engine, points):
    p = engine.predict(with_row(points, 3, mach=np.nan))
    assert "mach" in p.reason(3)


def test_a_parameter_that_is_not_a_number_flags_its_row_only(engine, points):
    efficiency = np.ones(N)
    efficiency[4] = np.nan
    p = engine.predict(points, {"fan.efficiency": efficiency})
    assert list(np.flatnonzero(~p.ok)) == [4]
    assert np.allclose(np.delete(p.y, 4, axis=0), np.delete(engine.predict(points).y, 4, axis=0), rtol=1e-9)


def test_a_gas_hotter_than_its_data_is_flagged_but_valued(engine):
    sea_level = {
        "altitude_m": np.zeros(40),
        "mach": np.zeros(40),
        "dT_isa_K": np.zeros(40),
        "Wf_kg_s": np.linspace(2.0, 8.0, 40),
    }
    p = engine.predict(sea_level, sensors=("T4_K", "T3_K"))
    hot = p.ok & (p.y[:, 0] > 2500.0)
    if hot.any():
        assert (p.status[hot] == OUTSIDE).all()
        assert all("gas data" in p.reason(k) for k in np.flatnonzero(hot))
    assert (p.status[p.ok & (p.y[:, 0] < 2500.0)] == OK).all()


def test_parameters_too_far_from_healthy_flag_the_row_and_name_a_balance(engine, points):
    p = engine.predict(points, {"hpt.efficiency": np.where(np.arange(N) == 5, 0.3, 1.0)})
    assert list(np.flatnonzero(~p.ok)) in ([5], [])
    assert p.ok[5] or "not met" in p.reason(5)


# misuse is an exception with a name in it


def test_a_missing_input_column_is_named(engine, points):
    with pytest.raises(KeyError, match="mach"):
        engine.predict({c: v for c, v in points.items() if c != "mach"})


@pytest.mark.parametrize(
    "question", [{"parameters": {"hpc.eficiency": 1.0}}, {"wrt": ("hpc.eficiency",)}], ids=["parameters", "wrt"]
)
def test_an_unknown_parameter_is_named(engine, points, question):
    with pytest.raises(KeyError, match=r"hpc\.eficiency"):
        engine.predict(points, **question)


def test_an_unknown_output_column_is_named(engine, points):
    with pytest.raises(KeyError, match="T99_K"):
        engine.predict(points, sensors=("T99_K",))


def test_columns_of_different_length_are_named(engine, points):
    with pytest.raises(ValueError, match="mach"):
        engine.predict({**points, "mach": points["mach"][:7]})


def test_a_start_of_the_wrong_shape_is_refused(engine, points):
    with pytest.raises(ValueError, match="start"):
        engine.predict(points, start=np.ones((2, N)))
    with pytest.raises(ValueError, match="start"):
        engine.predict(points, start=np.ones((len(engine.unknowns), N - 1)))


def test_inputs_are_left_as_they_were(engine, points):
    given = {c: v.copy() for c, v in points.items()}
    theta = {"fan.efficiency": np.full(N, 0.99)}
    engine.predict(given, theta, wrt=engine.monitored)
    assert all(np.array_equal(given[c], points[c]) for c in points)
    assert (theta["fan.efficiency"] == 0.99).all()


def test_a_repeated_direction_has_the_same_column_twice(engine, points):
    p = engine.predict(take(points, slice(0, 5)), wrt=("fan.efficiency", "fan.efficiency"))
    assert np.allclose(p.jacobian[:, :, 0], p.jacobian[:, :, 1])
    assert np.abs(p.jacobian[:, :, 0]).max() > 0.0
