"""What may set the power of an engine: every such column, taken from an answer and given back, makes the same point."""

from __future__ import annotations

from functools import cache
from math import pi

import numpy as np
import pytest
from engine_makers import CONFIGS

from enginediag_cli.engine.controls import SetPointControl
from enginediag_cli.engine.load import power_settings
from enginediag_cli.errors import ConfigError
from enginediag_cli.physics.engine_file import load_engine

ENGINES = ("turbofan", "turbojet", "turboshaft", "power_plant", "naval_gas_generator", "citation_jt15d", "amt_olympus")
N = 600


@cache
def engine_of(name, power_setting=None):
    return load_engine(CONFIGS / f"{name}.yaml", power_setting=power_setting)


def whole_envelope(engine, n, seed=5):
    """Inputs (n,) uniform over the envelope of the engine file, power from idle to rating."""
    rng = np.random.default_rng(seed)
    U = {c: rng.uniform(*engine.envelope[c], n) for c in engine.inputs if c != engine.power_setting}
    U[engine.power_setting] = engine.power_from_fraction(rng.uniform(0.0, 1.0, n), U)
    return U


def round_trip(name, setting, points, answers, columns):
    """Answers where the power is set by this column's own value, and how it rises with the file's own setting."""
    other = engine_of(name, setting)
    given = {c: points[c] for c in other.inputs if c in points}
    return other.predict({**given, setting: answers.y[:, columns.index(setting)]}, sensors=columns)


@pytest.mark.parametrize("name", ENGINES)
def test_every_power_setting_given_back_makes_the_same_point_over_the_whole_envelope(name):
    comes_back(name, N, 0.998)


@pytest.mark.slow
@pytest.mark.parametrize("name", sorted(path.stem for path in CONFIGS.glob("*.yaml")))
def test_of_many_points_of_every_shipped_engine_all_but_a_few_near_idle_come_back(name):
    comes_back(name, 15_000, 0.998)


def comes_back(name, n, share):
    engine = engine_of(name)
    points = whole_envelope(engine, n)
    held = {c.aim.column for c in engine.network.controls if isinstance(c, SetPointControl)}
    turning = {s for c in held & set(engine.network.speed_columns) for s in turning_with(engine, c)}
    settings = [s for s in power_settings(engine.declared) if s not in {engine.power_setting, *held, *turning}]
    jet = any(c.TYPE in ("nozzle", "condi_nozzle") for c in engine.network.components)
    assert {"T4_K", "T5_K", *(["EPR"] if jet else [])} <= {*settings, engine.power_setting}
    columns = list(dict.fromkeys(["P3_Pa", "W2_kg_s", *settings, engine.network.power_setting]))
    columns = [c for c in columns if c in engine.model_columns]
    answers = engine.predict(points, sensors=columns, wrt=[engine.power_setting])
    assert answers.ok.all()
    for setting in settings:
        k = columns.index(setting)
        # a column that falls with power belongs to two points, and one that is not positive is no power setting
        told = (answers.jacobian[:, k, 0] > 0.0) & (answers.y[:, k] > 0.0)
        assert told.mean() > 0.85, setting
        back = round_trip(name, setting, points, answers, columns)
        assert back.ok[told].mean() >= share, setting
        same = np.abs(back.y / answers.y - 1.0).max(axis=1) < 1e-6
        assert same[told & back.ok].mean() >= share, setting
        other = told & back.ok & ~same
        if other.any():
            assert_other_points_lie_beyond_idle(
                engine, {c: x[other] for c, x in points.items()}, back.y[other], columns, k
            )


def assert_other_points_lie_beyond_idle(engine, points, y, columns, k):
    """Column k has the same value once more below the idle of these points, where it falls with power: an answer, but
    of another point."""
    power, demand = engine.power_setting, engine.network.demand
    reached = y[:, columns.index(engine.network.power_setting)]
    reached = reached if demand is None else demand.set_point(reached)
    near_idle = engine.power_from_fraction(0.1, points)
    assert (points[power] < near_idle).all()
    assert (reached < points[power]).all()
    below = engine.predict({**points, power: reached}, sensors=[columns[k]], wrt=[power])
    assert below.y[:, 0] == pytest.approx(y[:, k], rel=1e-6)
    assert (below.jacobian[:, 0, 0] < 0.0).all()


def turning_with(engine, column):
    """Speed columns of the shafts that turn with the one of this column."""
    shafts = engine.network.shafts
    found = engine.network.coupling.coupled_shafts(engine.network.speed_columns[column])
    return {f"{shafts[s]['speed_label']}_rpm" for s in found}


def test_of_two_points_with_one_exhaust_temperature_the_one_is_found_at_which_it_rises_with_power():
    """A small turbojet's exhaust is hottest at rating, but hot at idle as well."""
    engine = engine_of("amt_olympus")
    points = whole_envelope(engine, 3000)
    answers = engine.predict(points, sensors=["T5_K"], wrt=[engine.power_setting])
    falling = answers.jacobian[:, 0, 0] < 0.0
    assert 0.02 < falling.mean() < 0.2
    other = engine_of("amt_olympus", "T5_K")
    given = {c: points[c][falling] for c in other.inputs if c in points}
    found = other.predict({**given, "T5_K": answers.y[falling, 0]}, sensors=["Wf_kg_s", engine.power_setting])
    assert found.ok.mean() > 0.98
    assert (found.y[found.ok, 1] > points[engine.power_setting][falling][found.ok]).all()


@pytest.mark.parametrize(("name", "behind", "inlet"), [("turbofan", "5", "2"), ("turboshaft", "5", "2")])
def test_EPR_is_total_pressure_behind_the_last_turbine_over_that_at_the_inlet(name, behind, inlet):
    engine = engine_of(name)
    y = engine.predict(whole_envelope(engine, 20), sensors=["EPR", f"P{behind}_Pa", f"P{inlet}_Pa"]).y
    assert y[:, 0] == pytest.approx(y[:, 1] / y[:, 2], rel=1e-14)


def test_torque_times_angular_speed_is_the_power_that_the_load_takes_from_its_shaft():
    engine = engine_of("turboshaft")
    points = whole_envelope(engine, 20)
    torque, power = engine.predict(points, sensors=["gearbox_torque_N_m", "gearbox_power_W"]).y.T
    assert torque * (points["N2_rpm"] * pi / 30.0) * 0.98 == pytest.approx(power, rel=1e-12)


def test_derivatives_hold_whatever_sets_the_power():
    engine = engine_of("turboshaft", "gearbox_torque_N_m")
    points = {c: np.full(50, np.mean(r)) for c, r in engine.envelope.items() if c in engine.inputs}
    points["gearbox_torque_N_m"] = np.linspace(250.0, 500.0, 50)
    wrt = ("compressor.efficiency", "gearbox_torque_N_m")
    p = engine.predict(points, sensors=["Wf_kg_s", "T45_K", "N1_rpm"], wrt=wrt)
    assert p.ok.all()
    for k, name in enumerate(wrt):
        h = 1e-3 if name in engine.parameters else 0.1

        def moved(t, name=name):
            if name in engine.parameters:
                return engine.predict(points, {name: 1.0 + t}, sensors=p.columns, start=p.x).y
            return engine.predict({**points, name: points[name] + t}, sensors=p.columns, start=p.x).y

        numeric = (moved(-2 * h) - 8 * moved(-h) + 8 * moved(h) - moved(2 * h)) / (12 * h)
        assert p.jacobian[:, :, k] == pytest.approx(numeric, rel=2e-6, abs=1e-7 * np.abs(numeric).max())


def test_EPR_sets_no_power_where_a_turbine_discharges_through_a_stack():
    """There it is nearly one whatever the power, and may belong to gas of 2,600 K as well as of 900 K."""
    for name in ("turboshaft", "power_plant", "naval_gas_generator", "recuperated_micro_gas_turbine"):
        engine = engine_of(name)
        assert "EPR" in engine.model_columns and "EPR" not in power_settings(engine.declared)


@pytest.mark.parametrize("setting", ["T3_K", "T25_K", "P3_Pa", "compressor_power_W", "N9_rpm"])
def test_what_cannot_set_the_power_is_refused_with_what_can(setting, tmp_path):
    text = (CONFIGS / "turbofan.yaml").read_text(encoding="utf-8")
    path = tmp_path / "engine.yaml"
    path.write_text(text.replace("power_setting: Wf_kg_s", f"power_setting: {setting}"), encoding="utf-8")
    with pytest.raises(ConfigError) as caught:
        load_engine(path)
    [problem] = caught.value.problems
    assert f"'{setting}' cannot be the power setting" in problem.message
    assert problem.hint
