"""Terms with memory in simulations: the same as on the recording that comes of it, and closed forms."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from enginediag_cli.engine.engine import Engine
from enginediag_cli.engine.recall import MOMENT
from enginediag_cli.engine.transient.moving_engine import MovingEngine
from enginediag_cli.engine.transient.states import TransientInputs
from enginediag_cli.physics.engine_file import load_engine
from enginediag_cli.physics.registry import effect

CONFIGS = Path(__file__).parents[3] / "configs"
TIME, POWER = np.array([0.0, 2.0, 4.0, 12.0, 13.0, 40.0]), np.array([0.3, 0.3, 0.8, 0.8, 0.4, 0.4])
COLUMNS = ("N1_rpm", "P3_Pa", "T5_K", "T3_K")
INERTIA = ("rotor_inertia", "spool", {"inertia": 6.0})
SOAK = (
    ("heat_soak", "turbine", {"exchange": 0.05, "time_constant": 8.0}),
    ("heat_soak", "compressor", {"exchange": 0.03, "time_constant": 20.0}),
)
FUEL_LAG = ("fuel_control_lag", "burner", {"time_constant": 1.5})
FUEL_RATE = ("fuel_rate_limit", "burner", {"rise": 6.0, "fall": 3.0})

plain = load_engine(CONFIGS / "turbojet.yaml")


def carrying(*terms: tuple[str, str, dict[str, float]]) -> Engine:
    return plain.replace_effects([effect(plain, *one) for one in terms])


def inputs_at(engine: Engine, time=TIME, power=POWER) -> dict[str, np.ndarray]:
    still = np.zeros(len(time))
    found = {"altitude_m": still, "mach": still, "dT_isa_K": still}
    return found | {"Wf_kg_s": engine.power_from_fraction(np.asarray(power), found)}


def flown(engine: Engine, records: np.ndarray, columns=COLUMNS, tolerance: float = 1e-6):
    """Columns (N, k) at records of a flight, and what was told there."""
    corners = inputs_at(engine)
    m = MovingEngine(engine, tolerance)
    told = {c: np.interp(records, TIME, v) for c, v in corners.items()}
    p = m.predict(told, {}, m.fly([TransientInputs(TIME, corners, records)])[0], sensors=columns)
    assert p.ok.all(), p.reason(int(np.argmin(p.ok)))
    return p.y, told


def off(engine: Engine, interval: float) -> np.ndarray:
    """By how much the tape of a simulated recording is off, of each column's range (k,)."""
    records = np.arange(0.0, 40.0 + 1e-9, interval)
    y, told = flown(engine, records)
    moment = engine.tapes.add({**told, "N1_rpm": y[:, 0], "time_s": records})
    again = engine.predict({**told, MOMENT: moment}, sensors=COLUMNS).y
    return np.abs(y - again).max(axis=0) / np.ptp(y, axis=0)


@pytest.mark.parametrize(
    ("terms", "error"),
    [
        (SOAK, 2e-4),
        ((("clearance_transient", "turbine", {"loss": 0.03, "time_constant": 10.0}),), 2e-4),
        ((("probe_lag", "T5", {"time_constant": 4.0}),), 4e-3),
        ((("clock_shift", "T5", {"delay": 2.0}),), 1e-9),
        ((FUEL_LAG,), 1e-5),
        ((FUEL_RATE,), 1e-9),
    ],
    ids=lambda x: "+".join(t[0] for t in x) if isinstance(x, tuple) else None,
)
def test_a_recording_at_1_Hz_recalls_what_was_simulated(terms, error):
    assert off(carrying(*terms), 1.0).max() < error


@pytest.mark.parametrize("terms", [SOAK, (*SOAK, INERTIA)], ids=["heat soak", "with an inertia"])
def test_sampled_more_finely_it_recalls_more_exactly(terms):
    coarse, fine = off(carrying(*terms), 0.5), off(carrying(*terms), 0.125)
    # of the second order in the interval; of the first where a measured speed is differenced across a corner
    assert (fine < coarse / (3.0 if INERTIA in terms else 8.0)).all()


def test_filters_of_one_column_follow_each_other_in_the_order_of_the_terms():
    # where the ramp meets what is asked for, between two records, the tape sees the lag a straight line
    assert off(carrying(FUEL_RATE, FUEL_LAG), 0.125).max() < 2e-3


def test_an_absent_term_is_no_state():
    from enginediag_cli.engine.transient.states import remembered, transient_states

    nothing = carrying(("heat_soak", "turbine", {}))
    assert transient_states(nothing) == () and remembered(nothing) == ()
    assert len(transient_states(nothing, ("heat_soak.turbine.exchange",))) == 1


def test_metal_behind_a_step_warms_with_its_own_time_constant():
    # the gas hardly changes by it: T5 approaches its end as exp(-t/tau) where one component holds heat
    engine = carrying(("heat_soak", "turbine", {"exchange": 1e-4, "time_constant": 8.0}))
    records = np.array([16.0, 20.0, 24.0, 28.0])
    y, told = flown(engine, records, ("T5_K",), 1e-9)
    T5 = y[:, 0] - engine.predict(told, sensors=("T5_K",)).y[:, 0]
    assert T5[1:] / T5[:-1] == pytest.approx(np.full(3, np.exp(-4.0 / 8.0)), rel=1e-3)


@pytest.mark.slow
def test_two_time_constants_are_two_exponentials():
    engine = carrying(
        ("heat_soak", "turbine", {"exchange": 1e-4, "time_constant": 2.0}),
        ("heat_soak", "burner", {"exchange": 1e-4, "time_constant": 9.0}),
    )
    records = 14.0 + 3.0 * np.arange(8.0)
    y, told = flown(engine, records, ("T5_K",), 1e-9)
    T5 = y[:, 0] - engine.predict(told, sensors=("T5_K",)).y[:, 0]
    # Prony: T5[k+2] = (a + b) T5[k+1] - a b T5[k] with a, b what is left after 3 s
    total, product = np.linalg.lstsq(np.column_stack([T5[1:-1], -T5[:-2]]), T5[2:], rcond=None)[0]
    left = np.sort(np.roots([1.0, -total, product]))
    assert -3.0 / np.log(left) == pytest.approx([2.0, 9.0], rel=0.02)


def test_fuel_behind_a_lag_follows_a_ramp_as_its_closed_form():
    engine = carrying(FUEL_LAG)
    records = np.linspace(2.0, 4.0, 41)
    y, told = flown(engine, records, ("Wf_kg_s",), 1e-8)
    tau, t, u = 1.5, records - 2.0, told["Wf_kg_s"]
    slope = (u[-1] - u[0]) / 2.0
    assert y[:, 0] == pytest.approx(u - slope * tau * (1.0 - np.exp(-t / tau)), rel=1e-7)


def test_fuel_at_a_rate_limit_runs_straight_until_it_meets_what_is_asked_for():
    engine = carrying(FUEL_RATE)
    records = np.linspace(2.0, 12.0, 401)
    y, told = flown(engine, records, ("Wf_kg_s",))
    fuel, full = y[:, 0], float(np.ravel(plain.network.design_point.outputs["Wf_kg_s"])[0])
    ramp = np.minimum(fuel[0] + full / 6.0 * (records - 2.0), told["Wf_kg_s"])
    assert fuel == pytest.approx(ramp, rel=1e-9) and (fuel < told["Wf_kg_s"] - 1e-3).sum() > 20


def test_the_inertia_of_a_term_is_that_of_the_rotor(tmp_path):
    text = (CONFIGS / "turbojet.yaml").read_text(encoding="utf-8")
    (tmp_path / "e.yaml").write_text(text.replace("16500,", "16500, inertia_kg_m2: 6,"), encoding="utf-8")
    heavy, records = load_engine(tmp_path / "e.yaml"), np.linspace(0.0, 40.0, 81)
    assert np.allclose(flown(heavy, records)[0], flown(carrying(INERTIA), records)[0], rtol=1e-10)
    twice = heavy.replace_effects([effect(heavy, *INERTIA)])
    with pytest.raises(ValueError, match=r"inertia twice.*rotor_inertia\.spool"):
        MovingEngine(twice)


def test_a_flight_that_ends_early_says_when_and_why():
    engine = carrying(INERTIA)
    time, records = np.array([0.0, 1.0, 1.2, 20.0]), np.arange(0.0, 20.0)
    corners = inputs_at(engine, time, (0.9, 0.9, 0.9, 0.9))
    corners["Wf_kg_s"][2:] *= 10.0
    m = MovingEngine(engine)
    told = {c: np.interp(records, time, v) for c, v in corners.items()}
    p = m.predict(told, {}, m.fly([TransientInputs(time, corners, records)])[0], sensors=COLUMNS)
    assert p.ok[:2].all() and not p.ok[-1]
    assert p.reason(19).startswith("there is no way beyond 1.14 s: spool power cannot be met; ask for less")


@pytest.mark.parametrize(
    ("name", "values"),
    [
        ("load_rate_limit", {"rise": 300.0, "fall": 300.0}),
        ("load_second_order_lag", {"time_constant": 20.0, "share": 0.3}),
    ],
)
def test_a_load_that_a_set_point_asks_for_moves_as_the_recording_recalls_it(name, values):
    loaded = load_engine(CONFIGS / "micro_gas_turbine.yaml")
    engine = loaded.replace_effects([effect(loaded, name, "generator", values)])
    m, time, records = MovingEngine(engine), np.array([0.0, 10, 11, 100, 102, 300]), np.arange(300.0)
    corners = {c: np.full(6, engine.declared["design"].get(c, 0.0)) for c in engine.inputs}
    corners["input_voltage_V"] = np.array([5.0, 5, 9, 9, 4, 4])
    told = {c: np.interp(records, time, v) for c, v in corners.items()}
    simulated = m.predict(told, {}, m.fly([TransientInputs(time, corners, records)])[0], sensors=("power_W",)).y
    moment = engine.tapes.add({**told, "time_s": records})
    recalled = engine.predict({**told, MOMENT: moment}, sensors=("power_W",)).y
    assert np.abs(simulated - recalled).max() < 2e-3 * np.ptp(recalled)  # set points ask for a curve, within a second
