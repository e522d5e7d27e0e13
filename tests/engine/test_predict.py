"""Φ of the turbofan: solutions, invariances, power settings, and what a batch may not change."""

from __future__ import annotations

import numpy as np
import pytest
from engine_makers import TURBOFAN, operating_points, take, turbofan

from enginediag_cli.engine.evaluation import P_ISA, standard_atmosphere
from enginediag_cli.physics.engine_file import load_engine

N = 120
STATIONS = (
    "T25_K",
    "P25_Pa",
    "T3_K",
    "P3_Pa",
    "T4_K",
    "T45_K",
    "P45_Pa",
    "T5_K",
    "W2_kg_s",
    "BPR",
    "N1_rpm",
    "N2_rpm",
    "Fn_N",
)


@pytest.fixture(scope="module")
def engine():
    return turbofan()


@pytest.fixture(scope="module")
def points(engine):
    return operating_points(engine, N, 11)


@pytest.fixture(scope="module")
def solved(engine, points):
    return engine.predict(points, wrt=engine.monitored)


def test_points_over_the_whole_envelope_converge(engine):
    p = engine.predict(operating_points(engine, 3000, 2))
    assert p.status.max() == 0, [p.reason(k) for k in np.flatnonzero(p.status)][:5]
    assert p.residual.max() <= 1e-10
    assert np.isfinite(p.y).all()


def test_the_design_point_has_the_design_values(engine):
    p = engine.predict({"altitude_m": 0.0, "mach": 0.0, "dT_isa_K": 0.0, "Wf_kg_s": 1.0}, sensors=("T4_K",))
    at_design = load_engine(TURBOFAN, "T4_K").predict(
        {"altitude_m": 0.0, "mach": 0.0, "dT_isa_K": 0.0, "T4_K": 1500.0},
        sensors=("N1_rpm", "N2_rpm", "BPR", "OPR", "T4_K"),
    )
    assert p.y.shape == (1, 1)
    assert np.allclose(at_design.y[0], [3650.0, 7900.0, 5.1, 1.60 * 2.25 * 5.9 * 0.9975**2, 1500.0], rtol=1e-8)


def test_shapes_and_names_follow_what_was_asked(engine, points, solved):
    assert solved.y.shape == (N, 9)
    assert solved.jacobian.shape == (N, 9, 11)
    assert solved.columns == tuple(engine.sensors)
    assert solved.wrt == engine.monitored
    p = engine.predict(points, sensors=("Fn_N", "T3_K"))
    assert p.y.shape == (N, 2)
    assert p.jacobian.shape == (N, 2, 0)
    assert np.allclose(p.y[:, 1], solved.y[:, solved.columns.index("T3_K")], rtol=1e-9)


def test_temperatures_and_pressures_follow_the_gas_path(engine, points):
    P2, P25, P3, P4, P45, P5 = engine.predict(
        points, sensors=("P2_Pa", "P25_Pa", "P3_Pa", "P4_Pa", "P45_Pa", "P5_Pa")
    ).y.T
    T2, T25, T3, T4, T45, T5 = engine.predict(points, sensors=("T2_K", "T25_K", "T3_K", "T4_K", "T45_K", "T5_K")).y.T
    assert (P25 > P2).all() and (P3 > P25).all() and (P4 < P3).all() and (P45 < P4).all() and (P5 < P45).all()
    assert (T25 > T2).all() and (T3 > T25).all() and (T4 > T3).all() and (T45 < T4).all() and (T5 < T45).all()


def test_mass_is_conserved_and_the_shafts_balance(engine, points):
    columns = (
        "W2_kg_s",
        "W22_kg_s",
        "W13_kg_s",
        "W4_kg_s",
        "W5_kg_s",
        "fan_power_W",
        "booster_power_W",
        "lpt_power_W",
        "hpc_power_W",
        "hpt_power_W",
    )
    W2, W22, W13, W4, W5, fan, booster, lpt, hpc, hpt = engine.predict(points, sensors=columns).y.T
    fuel = points["Wf_kg_s"]
    assert np.allclose(W22 + W13, W2, rtol=1e-12)
    assert np.allclose(W4, 0.91 * W22 + fuel, rtol=1e-12)
    assert np.allclose(W5, W22 + fuel, rtol=1e-12)
    assert np.allclose(fan + booster, lpt, rtol=1e-9)
    assert np.allclose(hpc, hpt, rtol=1e-9)


def test_half_the_pressure_at_equal_temperature_and_mach_halves_flows_and_thrust(engine):
    low = {
        "altitude_m": np.array([2000.0]),
        "mach": np.array([0.6]),
        "dT_isa_K": np.array([0.0]),
        "Wf_kg_s": np.array([1.4]),
    }
    T, P = standard_atmosphere(low["altitude_m"])
    high_altitude = 288.15 / 0.0065 * (1.0 - (0.5 * P[0] / P_ISA) ** (0.0065 * 287.05287 / 9.80665))
    T_high, P_high = standard_atmosphere(np.array([high_altitude]))
    share = P_high[0] / P[0]
    assert share == pytest.approx(0.5, rel=1e-4)
    high = {
        "altitude_m": np.array([high_altitude]),
        "mach": low["mach"],
        "dT_isa_K": T - T_high,
        "Wf_kg_s": low["Wf_kg_s"] * share,
    }
    same = ("N1_rpm", "N2_rpm", "T3_K", "T45_K", "T5_K", "BPR", "OPR", "T4_K")
    scaled = ("P3_Pa", "P5_Pa", "W2_kg_s", "Fn_N", "W5_kg_s", "hpc_power_W")
    a, b = (engine.predict(U, sensors=(*same, *scaled)).y[0] for U in (low, high))
    assert np.allclose(b[: len(same)], a[: len(same)], rtol=1e-8)
    assert np.allclose(b[len(same) :], share * a[len(same) :], rtol=1e-8)


def test_more_fuel_raises_speeds_temperatures_and_thrust(engine):
    fuel = np.linspace(0.7, 2.4, 40)
    y = engine.predict(
        {"altitude_m": 0.0, "mach": 0.2, "dT_isa_K": 0.0, "Wf_kg_s": fuel},
        sensors=("N1_rpm", "N2_rpm", "T3_K", "T45_K", "P3_Pa", "Fn_N"),
    ).y
    assert (np.diff(y, axis=0) > 0.0).all()


def test_a_less_efficient_compressor_runs_hotter_at_equal_fuel(engine, points, solved):
    worn = engine.predict(points, {"hpc.efficiency": 0.97})
    hotter = worn.y - solved.y
    assert (hotter[:, worn.columns.index("T45_K")] > 0.0).all()
    assert (hotter[:, worn.columns.index("T5_K")] > 0.0).all()


def test_humidity_changes_every_reading_by_less_than_two_percent_per_hundredth(engine, points, solved):
    humid = engine.predict({**points, "humidity_kg_kg": np.full(N, 0.01)})
    change = np.abs(humid.y / solved.y - 1.0)
    assert 1e-5 < change.max() < 0.02


def test_zero_humidity_given_or_left_out_is_the_same(engine, points, solved):
    given = engine.predict({**points, "humidity_kg_kg": np.zeros(N)})
    assert np.allclose(given.y, solved.y, rtol=1e-9)


# power settings


@pytest.mark.parametrize("power_setting", ["N1_rpm", "N2_rpm", "T4_K", "Fn_N"])
def test_every_power_setting_finds_the_same_operating_point(engine, points, power_setting):
    columns = (*STATIONS, "Wf_kg_s")
    given_fuel = engine.predict(points, sensors=columns)
    other = load_engine(TURBOFAN, power_setting)
    U = {c: points[c] for c in ("altitude_m", "mach", "dT_isa_K")}
    U[power_setting] = given_fuel.y[:, columns.index(power_setting)]
    found = other.predict(U, sensors=columns)
    assert found.status.max() == 0, [found.reason(k) for k in np.flatnonzero(found.status)][:5]
    # N1 and T4 set the point to 1e-10 of themselves; fuel answers up to ten times more strongly
    assert np.abs(found.y / given_fuel.y - 1.0).max() < 2e-8


# batches


def test_a_batch_of_one_equals_the_batch_of_many(engine, points, solved):
    for k in range(0, N, 17):
        one = engine.predict(take(points, slice(k, k + 1)), wrt=engine.monitored)
        assert np.allclose(one.y[0], solved.y[k], rtol=1e-9)
        assert np.allclose(
            one.jacobian[0], solved.jacobian[k], rtol=1e-6, atol=1e-8 * np.abs(solved.jacobian).max(axis=0)
        )


def test_plain_numbers_are_a_batch_of_one(engine, points, solved):
    p = engine.predict({c: float(v[3]) for c, v in points.items()})
    assert p.y.shape == (1, 9)
    assert np.allclose(p.y[0], solved.y[3], rtol=1e-9)


def test_an_empty_batch_is_an_empty_answer(engine, points):
    p = engine.predict(take(points, slice(0, 0)), wrt=engine.monitored)
    assert p.y.shape == (0, 9)
    assert p.jacobian.shape == (0, 9, 11)
    assert p.ok.shape == (0,)


def test_the_order_of_rows_does_not_matter(engine, points, solved):
    order = np.random.default_rng(5).permutation(N)
    mixed = engine.predict(take(points, order), wrt=engine.monitored)
    assert np.allclose(mixed.y, solved.y[order], rtol=1e-9)
    assert np.allclose(
        mixed.jacobian, solved.jacobian[order], rtol=1e-6, atol=1e-8 * np.abs(solved.jacobian).max(axis=0)
    )


def test_a_large_batch_with_a_fitted_start_equals_small_ones_without():
    engine = load_engine(TURBOFAN)
    U = operating_points(engine, 4200, 6)  # more than one chunk
    large = engine.predict(U)
    fresh = load_engine(TURBOFAN)
    for k in (0, 2000, 4150):
        small = fresh.predict(take(U, slice(k, k + 50)))
        assert np.allclose(small.y, large.y[k : k + 50], rtol=1e-9)


def test_an_earlier_question_does_not_change_a_later_answer(points, solved):
    engine = load_engine(TURBOFAN)
    engine.predict(operating_points(engine, 800, 8, power=(0.5, 1.0)))
    assert np.allclose(engine.predict(points).y, solved.y, rtol=1e-9)


def test_the_same_question_twice_has_the_same_answer(points):
    engine = load_engine(TURBOFAN)
    first, second = engine.predict(points), engine.predict(points)
    assert np.array_equal(first.y, second.y)


def test_a_start_from_the_solution_is_confirmed_in_at_most_two_passes(engine, points, solved):
    again = engine.predict(points, start=solved.x)
    assert again.passes.max() <= 2
    assert np.allclose(again.y, solved.y, rtol=1e-9)


def test_a_bad_start_still_converges(engine, points, solved):
    for start in (np.full_like(solved.x, np.nan), np.full_like(solved.x, 0.3), np.full_like(solved.x, 1.9)):
        p = engine.predict(points, start=start)
        assert p.ok.all()
        assert np.allclose(p.y, solved.y, rtol=1e-9)


def test_parameters_may_differ_from_point_to_point(engine, points):
    rng = np.random.default_rng(9)
    theta = {name: rng.uniform(0.97, 1.02, N) for name in engine.monitored}
    theta |= {
        "hpc.map.work_slope": rng.uniform(1.2, 1.6, N),
        "fan.map.work_speed_exponent": rng.uniform(1.9, 2.1, N),
        "lpt.map.capacity_speed_slope": rng.uniform(0.0, 0.1, N),
        "sensor.T3.bias": rng.normal(0, 2, N),
        "sensor.P3.scale": rng.uniform(0.99, 1.01, N),
        "lp.power_offtake_W": rng.uniform(0, 2e5, N),
    }
    together = engine.predict(points, theta)
    assert together.ok.all()
    for k in range(0, N, 29):
        alone = engine.predict(take(points, slice(k, k + 1)), {name: float(v[k]) for name, v in theta.items()})
        assert np.allclose(alone.y[0], together.y[k], rtol=1e-9)


def test_a_parameter_array_of_one_serves_every_point(engine, points):
    a = engine.predict(points, {"fan.efficiency": np.array([0.98])})
    b = engine.predict(points, {"fan.efficiency": 0.98})
    assert np.allclose(a.y, b.y, rtol=1e-12)


def test_sensor_parameters_act_on_their_own_reading_only(engine, points, solved):
    p = engine.predict(points, {"sensor.T3.bias": 5.0, "sensor.P3.scale": 1.02})
    expected = solved.y.copy()
    expected[:, solved.columns.index("T3_K")] += 5.0
    expected[:, solved.columns.index("P3_Pa")] *= 1.02
    assert np.allclose(p.y, expected, rtol=1e-9)


def test_what_is_asked_for_beside_readings_is_what_is_there(engine, points, solved):
    wrong = {"sensor.P3.scale": 1.02, "sensor.N1.scale": 0.99}
    p = engine.predict(points, wrong, sensors=("P3_Pa", "N1_rpm"), also=("P3_Pa", "N1_rpm", "T4_K"))
    true = engine.predict(points, sensors=("P3_Pa", "N1_rpm", "T4_K"))
    assert np.allclose(p.y, true.y[:, :2] * [1.02, 0.99], rtol=1e-12)
    assert np.array_equal(p.also, true.y)


def test_power_from_fraction_spans_the_corrected_range(engine, points):
    at_rest = {"altitude_m": 0.0, "mach": 0.0, "dT_isa_K": 0.0}
    assert engine.power_from_fraction(np.array([0.0, 1.0]), at_rest) == pytest.approx(np.array(engine.power_range))
    fuel, half = (engine.power_from_fraction(f, points) for f in (np.ones(N), np.full(N, 0.5)))
    assert np.allclose(half / fuel, np.mean(engine.power_range) / engine.power_range[1], rtol=1e-12)
