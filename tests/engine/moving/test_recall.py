"""What an engine remembers of a recording: any record finds its own past, whoever is asked for beside it."""

from __future__ import annotations

from functools import cache
from pathlib import Path

import numpy as np
import pytest

from enginediag_cli.engine import solver
from enginediag_cli.engine.recall import MOMENT
from enginediag_cli.physics.engine_file import load_engine
from enginediag_cli.physics.registry import effect

CONFIGS = Path(__file__).resolve().parents[3] / "configs"


@pytest.fixture(autouse=True)
def tightly_solved(monkeypatch):
    """Solves go to rounding, so that differences of them are not differences of their tolerance."""
    monkeypatch.setattr(solver, "TOLERANCE", 3e-13)


@cache
def engine_of(name):
    return load_engine(CONFIGS / f"{name}.yaml")


def moving(name, **effects):
    """An engine that carries effects `term__site` with their values."""
    engine = engine_of(name)
    return engine.replace_effects([effect(engine, *label.split("__"), values) for label, values in effects.items()])


def flight(engine, n=80, seed=0):
    """Inputs of a recording with steps and ramps of power, unevenly sampled, and its time."""
    rng = np.random.default_rng(seed)
    time = np.cumsum(rng.uniform(0.5, 1.5, n))
    fraction = np.interp(time, [0, 15, 16, 35, 50, 51, 200], [0.5, 0.5, 0.85, 0.85, 0.6, 0.75, 0.75])
    low = {c: 0.5 * sum(engine.envelope[c]) for c in engine.inputs if c in engine.envelope}
    columns = {c: np.full(n, low[c]) for c in engine.inputs if c in low}
    if "altitude_m" in columns:
        columns |= {"altitude_m": np.full(n, 1000.0), "mach": np.full(n, 0.3), "dT_isa_K": np.zeros(n)}
    columns[engine.power_setting] = engine.power_from_fraction(fraction, columns)
    return {"time_s": time, **columns}


def on_tape(engine, columns):
    return {c: v for c, v in columns.items() if c in engine.inputs} | {MOMENT: engine.tapes.add(columns)}


MOVING = {
    "load_rate_limit": ("micro_gas_turbine", {"load_rate_limit__generator": {"rise": 30.0, "fall": 20.0}}),
    "load_control_lag": ("micro_gas_turbine", {"load_control_lag__generator": {"time_constant": 7.0}}),
    "load_second_order_lag": (
        "micro_gas_turbine",
        {"load_second_order_lag__generator": {"time_constant": 10.0, "second_share": 0.3}},
    ),
    "load_control_delay": ("micro_gas_turbine", {"load_control_delay__generator": {"delay": 3.3}}),
    "fuel_control_lag": ("turbojet", {"fuel_control_lag__burner": {"time_constant": 3.0}}),
    "fuel_rate_limit": ("turbojet", {"fuel_rate_limit__burner": {"rise": 30.0, "fall": 20.0}}),
    "probe_lag": ("citation_jt15d", {"probe_lag__ITT": {"time_constant": 4.0}}),
    "heat_soak": ("citation_jt15d", {"heat_soak__hpt": {"exchange": 0.03, "time_constant": 20.0}}),
    "clearance_transient": ("citation_jt15d", {"clearance_transient__hpt": {"loss": 0.03, "time_constant": 20.0}}),
    "clock_shift": ("citation_jt15d", {"clock_shift__Wf": {"delay": 0.7}}),
    "rotor_inertia": ("citation_jt15d", {"rotor_inertia__lp": {"inertia": 0.3}}),
}


def coefficients(engine):
    return [n for e in engine.effects for n in e.amplitudes]


@pytest.mark.parametrize("name", MOVING)
def test_derivatives_are_those_of_differences(name):
    engine = moving(MOVING[name][0], **MOVING[name][1])
    inputs = on_tape(engine, flight(engine))
    health = next(n for n, p in engine.parameters.items() if p.family == "health")
    asked = [n for n in engine.parameters if n.startswith("power_demand")][4:6]
    wrt = [*coefficients(engine), health, *asked]
    sensors = [*engine.sensors, "T4_K"]
    at = engine.predict(inputs, sensors=sensors, wrt=wrt)
    assert at.ok.all()
    moves = 0
    for j, parameter in enumerate(wrt):
        value = engine.parameters[parameter].nominal
        # of small steps the last digits of the solutions are left, which processors round in their own ways
        for step in (1e-5, 1e-4):
            h = step * max(abs(value), 1e-3)
            y = [engine.predict(inputs, {parameter: value + side * h}, sensors=sensors).y for side in (2, 1, -1, -2)]
            difference = (8.0 * (y[1] - y[2]) - (y[0] - y[3])) / (12.0 * h)
            scale = np.abs(difference).max(axis=0)
            scale[scale < 1e-6 * np.abs(at.y).max(axis=0)] = 0.0  # what the solver's tolerance leaves
            error = np.abs(at.jacobian[:, :, j] - difference) / np.where(scale > 0.0, scale, np.inf)
            # where a delay meets a record there is a kink
            near = np.quantile(error, 0.99)
            if near < 1e-6:
                break
        moves += bool(scale.any())
        assert near < 1e-6, parameter
    assert moves >= len(coefficients(engine))


@pytest.mark.parametrize("name", MOVING)
def test_the_answer_does_not_depend_on_what_is_asked_beside_it(name):
    engine = moving(MOVING[name][0], **MOVING[name][1])
    inputs = on_tape(engine, flight(engine))
    wrt = coefficients(engine)
    whole = engine.predict(inputs, wrt=wrt)
    order = np.random.default_rng(1).permutation(80)
    for rows in (slice(40, None), order, order[:7], np.array([79])):
        part = engine.predict({c: v[rows] for c, v in inputs.items()}, wrt=wrt)
        assert part.y == pytest.approx(whole.y[rows], rel=1e-9)
        assert part.jacobian == pytest.approx(whole.jacobian[rows], rel=1e-6, abs=1e-6 * np.abs(whole.jacobian).max())


@pytest.mark.parametrize("name", MOVING)
def test_a_record_without_a_past_is_steady_and_an_absent_effect_changes_no_digit(name):
    plain = engine_of(MOVING[name][0])
    engine = moving(MOVING[name][0], **MOVING[name][1])
    absent = moving(MOVING[name][0], **{label: {} for label in MOVING[name][1]})
    columns = flight(engine)
    inputs = {c: v for c, v in columns.items() if c in plain.inputs}
    steady = plain.predict(inputs)
    assert np.array_equal(engine.predict(inputs).y, steady.y)
    assert np.array_equal(absent.predict(on_tape(absent, columns)).y, steady.y)
    moved = engine.predict(on_tape(engine, columns))
    assert np.abs(moved.y - steady.y).max() > 0.0


@pytest.mark.parametrize("name", ["load_rate_limit", "probe_lag", "heat_soak"])
def test_a_recording_that_comes_in_pieces_is_the_same_as_whole(name):
    engine = moving(MOVING[name][0], **MOVING[name][1])
    columns = flight(engine)
    whole = engine.predict(on_tape(engine, columns)).y
    for a, b in ((0, 30), (30, 31), (31, 80)):
        piece = {c: v[a:b] for c, v in columns.items()}
        moment = engine.tapes.extend("pieces of " + name, piece)
        found = engine.predict({c: v for c, v in piece.items() if c in engine.inputs} | {MOMENT: moment})
        assert found.y == pytest.approx(whole[a:b], rel=1e-9)


def test_a_gap_or_time_that_goes_back_begins_anew_and_a_recording_written_backwards_is_turned_round():
    engine = moving("micro_gas_turbine", load_control_lag__generator={"time_constant": 10.0})
    columns = flight(engine)
    alone = engine.predict(on_tape(engine, columns)).y
    later = {**columns, "time_s": columns["time_s"] + 5000.0}
    earlier = {**columns, "time_s": columns["time_s"] - 500.0}
    for second in (later, earlier):
        both = {c: np.concatenate([columns[c], second[c]]) for c in columns}
        assert engine.predict(on_tape(engine, both)).y == pytest.approx(np.concatenate([alone, alone]), rel=1e-9)
    turned = {c: v[::-1] for c, v in columns.items()}
    assert engine.predict(on_tape(engine, turned)).y[::-1] == pytest.approx(alone, rel=1e-9)


@pytest.mark.parametrize("name", ["load_control_lag", "load_second_order_lag", "load_rate_limit"])
def test_where_every_record_is_a_stretch_of_its_own_a_memory_is_not_told_by_the_readings_that_it_is_to_explain(name):
    """Hourly records, read wrong: the filter's output is shown by the reading, and would be that of each record."""
    engine = moving(MOVING[name][0], **MOVING[name][1])
    columns = flight(engine) | {"time_s": 3600.0 * np.arange(80.0)}
    inputs = on_tape(engine, columns | {"el_power_W": np.random.default_rng(1).uniform(2e4, 1e5, 80)})
    steady = engine.predict({c: v for c, v in inputs.items() if c != MOMENT}).y
    assert engine.predict(inputs).y == pytest.approx(steady, rel=1e-12)


def test_parameters_given_for_a_record_hold_at_that_record():
    engine = moving("citation_jt15d", probe_lag__ITT={"time_constant": 4.0})
    inputs = on_tape(engine, flight(engine))
    whole = engine.predict(inputs, {"hpc.efficiency": 0.98}).y
    assert engine.predict(inputs, {"hpc.efficiency": np.full(80, 0.98)}).y == pytest.approx(whole, rel=1e-9)


def test_an_accelerating_rotor_takes_its_power_from_the_shaft():
    engine = moving("citation_jt15d", rotor_inertia__lp={"inertia": 0.3})
    columns = flight(engine)
    time = columns["time_s"]
    columns["N1_rpm"] = 9000.0 + 20.0 * time
    moving_power = 0.3 * (np.pi / 30.0) ** 2 * columns["N1_rpm"] * 20.0
    inputs = on_tape(engine, columns)
    steady = {c: v for c, v in inputs.items() if c != MOMENT}
    expected = engine_of("citation_jt15d").predict(steady, {"lp.power_offtake_W": moving_power})
    middle = slice(1, -1)
    assert engine.predict(inputs).y[middle] == pytest.approx(expected.y[middle], rel=1e-8)


def test_metal_that_warms_takes_heat_from_the_gas_and_gives_it_back_in_the_end():
    engine = moving("citation_jt15d", heat_soak__hpt={"exchange": 0.03, "time_constant": 8.0})
    columns = flight(engine)
    columns["time_s"] = np.arange(80.0)
    columns["N1_rpm"] = np.where(columns["time_s"] < 10.0, 9000.0, 12000.0)
    inputs = on_tape(engine, columns)
    y = engine.predict(inputs, sensors=["Wf_kg_s"]).y[:, 0]
    steady = engine.predict({c: v for c, v in inputs.items() if c != MOMENT}, sensors=["Wf_kg_s"]).y[:, 0]
    more = y / steady - 1.0
    assert more[:10] == pytest.approx(0.0, abs=1e-9)
    assert more[11] > 0.002  # fuel also heats the metal
    assert np.all(np.diff(more[11:]) < 0.0)
    assert abs(more[-1]) < 1e-4


def test_a_reading_keeps_its_soak_term_beside_what_an_engine_remembers():
    plain = engine_of("citation_jt15d")
    engine = moving("citation_jt15d", rotor_inertia__hp={"inertia": 0.1})
    columns = flight(plain, 20) | {"N1_soak_rpm": np.linspace(-300.0, 500.0, 20)}
    inputs = on_tape(engine, columns) | {"N1_soak_rpm": columns["N1_soak_rpm"]}
    with_soak, without = (
        engine.predict(inputs, {"sensor.ITT.soak": c}, sensors=["ITT_K"], wrt=["sensor.ITT.soak"]) for c in (-0.02, 0.0)
    )
    np.testing.assert_allclose((with_soak.y - without.y)[:, 0], -0.02 * columns["N1_soak_rpm"], atol=1e-9)
    np.testing.assert_allclose(with_soak.jacobian[:, 0, 0], columns["N1_soak_rpm"], atol=1e-9)


def test_heat_soak_that_takes_a_quarter_of_the_heat_settles():
    engine = moving("citation_jt15d", heat_soak__lpt={"exchange": 0.25, "time_constant": 27.0})
    assert engine.predict(on_tape(engine, flight(engine, 40)), sensors=["ITT_K"]).ok.all()
