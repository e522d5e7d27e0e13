from __future__ import annotations

import numpy as np
import pytest
from simulation_toy import CONFIGS, ToyEngine

from enginediag_cli.engine.evaluation import P_ISA, standard_atmosphere
from enginediag_cli.errors import DataError
from enginediag_cli.simulation.flights import generate_flights, outside_envelope
from enginediag_cli.simulation.missions import KNOT_M_S, SOUND_SPEED_ISA_M_S, humidity, wander

NAMES = sorted(path.stem for path in (CONFIGS / "flights").glob("*.yaml"))


def cas_from_mach(mach, altitude_m):
    """Calibrated airspeed, m/s: the impact pressure of M at the altitude is that of the airspeed at sea level."""
    impact = standard_atmosphere(altitude_m)[1] * ((1.0 + 0.2 * mach**2) ** 3.5 - 1.0)
    return SOUND_SPEED_ISA_M_S * np.sqrt(5.0 * ((impact / P_ISA + 1.0) ** (1.0 / 3.5) - 1.0))


def fly(values, engine=None, seed=0, **how):
    engine = engine or ToyEngine(optional_inputs=values["constants"])
    return generate_flights(values, engine, np.random.default_rng(seed), **how)


@pytest.mark.parametrize("name", NAMES)
def test_paths_stay_in_the_engines_envelope(name, flight_values, engine):
    conditions = fly(flight_values(name), flights=20)
    assert len(conditions) > 0 and outside_envelope(engine, conditions) == {}
    assert all(np.isfinite(conditions.columns[column]).all() for column in engine.inputs)


@pytest.mark.parametrize("name", NAMES)
def test_same_seed_gives_same_bytes_and_time_runs_forward(name, flight_values):
    a, b = (fly(flight_values(name), flights=3) for _ in range(2))
    assert all(a.columns[c].tobytes() == b.columns[c].tobytes() for c in a.columns)
    assert np.all(np.diff(a.columns["time_s"]) > 0)
    assert np.all(np.diff(a.columns["flight"]) >= 0) and a.columns["flight"][0] == 1


@pytest.mark.parametrize("name", NAMES)
def test_records_ends_the_conditions_after_so_many(name, flight_values):
    assert len(fly(flight_values(name), records=157)) == 157


def test_airliner_goes_through_its_phases_in_order(flight_values):
    phase = fly(flight_values("airliner"), flights=1).columns["phase"]
    first = [str(p) for k, p in enumerate(phase) if k == 0 or p != phase[k - 1]]
    assert first[:4] == ["ground", "take-off", "climb", "cruise"]
    assert first[-4:] == ["cruise", "descent", "approach", "ground"]


def test_airliner_flies_its_airspeed_schedule_and_never_above_it(flight_values):
    c = fly(flight_values("airliner"), flights=10).columns
    cas = cas_from_mach(c["mach"], c["altitude_m"]) / KNOT_M_S
    climbing = c["phase"] == "climb"
    low = climbing & (c["altitude_m"] > 2000) & (c["altitude_m"] < 3000)
    high = climbing & (c["altitude_m"] > 4000) & (c["altitude_m"] < 8000)
    np.testing.assert_allclose(cas[low], 250.0, atol=0.01)
    np.testing.assert_allclose(cas[high], 290.0, atol=0.01)
    assert cas.max() < 290.01 and c["mach"].max() <= 0.82


def test_airliner_climbs_and_descends_at_rates_that_airliners_reach(flight_values):
    c = fly(flight_values("airliner"), flights=5).columns
    rate = np.diff(c["altitude_m"]) / np.diff(c["time_s"])
    assert 5.0 < rate.max() < 15.0 and -11.0 < rate.min() < -5.0


def test_cruise_climbs_in_steps(flight_values):
    values = flight_values("airliner")
    values["mission"]["cruise_duration_min"] = [120.0, 120.0]
    c = fly(values, flights=1).columns
    levels = np.unique(np.round(c["altitude_m"][c["phase"] == "cruise"], 3))
    np.testing.assert_allclose(np.diff(levels), 2000 * 0.3048, atol=0.01)
    assert len(levels) == 4


def test_fuel_flow_scales_with_the_ambient(flight_values, engine):
    c = fly(flight_values("airliner"), engine, flights=1).columns
    theta, delta = engine._theta_delta(c["altitude_m"], c["mach"], c["dT_isa_K"])
    corrected = c["Wf_kg_s"] / (delta * np.sqrt(theta))
    low, high = engine.power_range
    assert corrected.min() >= low - 1e-12 and corrected.max() <= high + 1e-12
    assert c["Wf_kg_s"][c["phase"] == "cruise"].max() < 0.5 * c["Wf_kg_s"][c["phase"] == "take-off"].max()


def test_a_flight_is_the_same_however_many_follow(flight_values):
    one, five = (fly(flight_values("airliner"), flights=n) for n in (1, 5))
    assert all(five.columns[c][: len(one)].tobytes() == one.columns[c].tobytes() for c in one.columns if c != "phase")


def test_flights_differ_from_one_another(flight_values):
    c = fly(flight_values("airliner"), flights=5).columns
    tops = {round(c["altitude_m"][c["flight"] == k].max(), 1) for k in range(1, 6)}
    lengths = {int(np.count_nonzero(c["flight"] == k)) for k in range(1, 6)}
    assert len(tops) > 1 and len(lengths) > 2


def test_snapshots_are_one_take_off_and_one_cruise_record_per_flight(flight_values):
    c = fly(flight_values("snapshots"), flights=50).columns
    assert list(c["phase"]) == ["take-off", "cruise"] * 50
    assert c["altitude_m"][::2].max() <= 900 and c["altitude_m"][1::2].min() > 9000


def test_sweep_fills_the_envelope(flight_values, engine):
    c = fly(flight_values("sweep"), engine, records=4000).columns
    low, high = engine.envelope["altitude_m"]
    counts, _ = np.histogram(c["altitude_m"], np.linspace(low, high, 11))
    # binomial, 4000 points in tenths: mean 400, standard deviation 19; five of them
    assert np.all(np.abs(counts - 400) < 95)


def test_sweep_keeps_to_airspeeds_that_can_be_flown(flight_values, engine):
    c = fly(flight_values("sweep"), engine, records=2000).columns
    cas = cas_from_mach(c["mach"], c["altitude_m"]) / KNOT_M_S
    assert cas.max() <= 380.01
    assert cas[c["altitude_m"] > 1500].min() >= 179.99


def test_power_plant_year_has_the_temperatures_it_was_given(flight_values):
    values = flight_values("power_plant")
    values["mission"]["pressure_swing_m"] = 0.0
    c = fly(values).columns
    ambient = c["dT_isa_K"] + 288.15 - 0.0065 * c["altitude_m"]
    assert len(ambient) == 8760
    # weather of 2.5 K over two days' correlation: standard error of the year's mean 0.19 K
    assert ambient.mean() == pytest.approx(290.9, abs=0.8)
    hour = (c["time_s"] / 3600.0) % 24
    by_hour = np.array([ambient[hour == h].mean() for h in range(24)])
    assert by_hour.argmax() in (14, 15, 16) and np.ptp(by_hour) == pytest.approx(8.0, abs=0.5)


def test_weather_is_stationary_with_unit_variance():
    x = np.array([wander(20, 0.9, np.random.default_rng(seed)) for seed in range(4000)])
    np.testing.assert_allclose(x.var(axis=0), 1.0, atol=5 * 0.0224)


def test_humidity_agrees_with_steam_tables():
    # saturation pressure at 20 °C is 2339 Pa and at 35 °C 5629 Pa: w = 0.62198 e/(p − e)
    w = humidity(np.ones(2), np.array([293.15, 308.15]))
    np.testing.assert_allclose(w, [0.01470, 0.03659], rtol=2e-3)


def test_humidity_is_given_to_engines_that_take_it(flight_values):
    plant = flight_values("power_plant")
    humid = ToyEngine(optional_inputs={**plant["constants"], "humidity_kg_kg": 0.0})
    assert "humidity_kg_kg" in fly(plant, humid, flights=1).columns
    assert "humidity_kg_kg" not in fly(plant, flights=1).columns


def test_an_input_that_no_flight_gives_is_named(flight_values, engine):
    engine.inputs = (*engine.inputs, "offtake_W")
    with pytest.raises(DataError, match=r"offtake_W.*constants"):
        fly(flight_values("airliner"), engine, flights=1)
    values = {**flight_values("airliner"), "constants": {"offtake_W": 5e4}}
    assert set(fly(values, engine, flights=1).columns["offtake_W"]) == {5e4}


def test_a_constant_for_no_input_is_refused(flight_values, engine):
    with pytest.raises(DataError, match="no input for: oftake_W"):
        fly({**flight_values("airliner"), "constants": {"oftake_W": 1.0}}, engine, flights=1)
