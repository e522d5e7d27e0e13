"""Flights of engines with states: manoeuvres, corners between records, what stays steady."""

from __future__ import annotations

import csv

import numpy as np
import pytest
from simulation_toy import CONFIGS

from enginediag_cli.__main__ import main
from enginediag_cli.errors import DataError
from enginediag_cli.faults.catalogue import FaultSet
from enginediag_cli.physics.engine_file import load_engine
from enginediag_cli.simulation.flights import FlightConditions, generate_flights
from enginediag_cli.simulation.simulate import simulate


@pytest.fixture(scope="module")
def engine(tmp_path_factory):
    text = (CONFIGS / "turbojet.yaml").read_text(encoding="utf-8")
    place = tmp_path_factory.mktemp("engine") / "turbojet.yaml"
    place.write_text(text.replace("design_speed_rpm: 16500,", "design_speed_rpm: 16500, inertia_kg_m2: 6,"))
    return load_engine(place)


def plan(interval: float, *points: tuple[float, float], kind: str = "manoeuvres", **more):
    set_points = [
        {"time_s": t, "power": p, "phase": "", "altitude_m": None, "mach": None, "dT_isa_K": None} for t, p in points
    ]
    mission = {"type": kind, "set_points": set_points, "record_interval_s": interval, "flight_interval_s": 3600.0}
    return {"flights": 1, "mission": {**mission, **more}, "constants": {}}


def flown(engine, values, steady=False, **how):
    conditions = generate_flights(values, engine, np.random.default_rng(0), **how)
    none = FaultSet((), ())
    return simulate(engine, conditions, none, {}, np.random.default_rng(1)) if not steady else conditions


def test_a_manoeuvre_between_two_records_is_flown_all_the_same(engine):
    blip = ((0, 0.3), (3.2, 0.3), (3.3, 0.9), (3.7, 0.9), (3.8, 0.3), (8, 0.3))
    coarse, fine = (flown(engine, plan(interval, *blip)).columns for interval in (2.0, 0.1))
    at = np.searchsorted(fine["time_s"], coarse["time_s"] - 1e-9)
    assert len(coarse["time_s"]) == 5
    assert np.ptp(coarse["Wf_kg_s"]) < 1e-12 and coarse["N1_rpm"][2] > coarse["N1_rpm"][0] + 100.0
    assert np.allclose(coarse["N1_rpm"], fine["N1_rpm"][at], rtol=1e-9)


def test_a_flight_begins_steady_and_lags_behind_what_is_asked_for(engine):
    found = flown(engine, plan(1.0, (0, 0.2), (5, 0.2), (6, 0.8), (60, 0.8)))
    conditions = {c: v for c, v in found.columns.items() if c in engine.inputs}
    steady = engine.predict(conditions, sensors=("N1_rpm",)).y[:, 0]
    N1 = found.columns["N1_rpm"]
    assert np.allclose(N1[:6], steady[:6], rtol=1e-9) and N1[-1] == pytest.approx(steady[-1], rel=1e-6)
    assert N1[6] < 0.9 * steady[6] and set(found.columns["status"].tolist()) == {"ok"}


def test_a_run_that_cannot_be_made_exact_is_told_by_its_records(engine, monkeypatch):
    slam = plan(1.0, (0, 0.3), (2, 0.3), (2.5, 0.8), (20, 0.8))
    exact = flown(engine, slam)
    monkeypatch.setattr("enginediag_cli.engine.transient.moving_engine.SWEEPS", 0)
    stepped = flown(engine, slam)
    assert exact.loose == 0 and stepped.loose == len(stepped)
    assert np.allclose(exact.columns["N1_rpm"], stepped.columns["N1_rpm"], rtol=1e-4)


def test_flights_of_a_recording_begin_anew_and_are_alike(engine):
    found = flown(engine, plan(1.0, (0, 0.2), (1, 0.8), (5, 0.8)), flights=3)
    N1 = found.columns["N1_rpm"].reshape(3, -1)
    assert np.allclose(N1, N1[0], rtol=1e-9)


def test_set_points_whose_times_do_not_rise_are_refused(engine):
    with pytest.raises(DataError, match="rise from 0 s"):
        flown(engine, plan(1.0, (0, 0.2), (4, 0.8), (4, 0.2)))


def test_a_time_that_stands_still_is_told_with_the_way_out(engine):
    n = 4
    columns = {"time_s": np.array([0.0, 1.0, 1.0, 2.0]), **{c: np.zeros(n) for c in engine.inputs}}
    columns["Wf_kg_s"] = np.full(n, 0.2)
    none = FaultSet((), ())
    with pytest.raises(DataError, match=r"behind its record 2.*--steady"):
        simulate(engine, FlightConditions(columns), none, {}, np.random.default_rng(0))
    drawn = simulate(engine, FlightConditions(columns, series=False), none, {}, np.random.default_rng(0))
    assert np.ptp(drawn.columns["N1_rpm"]) < 1e-6


def test_what_terms_remember_moves_without_any_inertia_too(tmp_path, capsys):
    text = (CONFIGS / "turbojet.yaml").read_text(encoding="utf-8")
    terms = """
physics:
  - {term: heat_soak, at: turbine, coefficients: {exchange: 0.05, time_constant: 20}}
  - {term: probe_lag, at: T5, coefficients: {time_constant: 4}}
"""
    (tmp_path / "engine.yaml").write_text(text + terms, encoding="utf-8")
    asked = ["simulate", str(tmp_path / "engine.yaml"), "--flight", str(CONFIGS / "flights" / "run_up.yaml")]
    asked += ["--noise", "none", "-o", str(tmp_path / "moving.csv")]
    assert main(asked) == 0
    said = capsys.readouterr().err
    assert "heat soak turbine memory" in said and "probe lag T5 memory" in said
    T5 = np.array([float(row["T5_K"]) for row in rows(tmp_path / "moving.csv")])
    assert main([*asked[:-1], str(tmp_path / "steady.csv"), "--steady"]) == 0
    steady = np.array([float(row["T5_K"]) for row in rows(tmp_path / "steady.csv")])
    assert T5[:30] == pytest.approx(steady[:30], rel=1e-9) and np.abs(T5 - steady).max() > 50.0
    assert abs(T5[30:] - steady[30:]).min() < 1.0


def rows(path):
    with open(path, encoding="utf-8") as stream:
        return list(csv.DictReader(line for line in stream if not line.startswith("#")))


def test_the_governed_turbofan_flies_a_bodie_manoeuvre_by_one_command(tmp_path, capsys):
    engine, flight = str(CONFIGS / "turbofan_governed.yaml"), str(CONFIGS / "flights" / "bodie.yaml")
    asked = ["simulate", engine, "--flight", flight, "--noise", "none", "--records", "200"]
    assert main([*asked, "-o", str(tmp_path / "moving.csv")]) == 0
    assert "integrated along time" in capsys.readouterr().err
    assert main([*asked, "--steady", "-o", str(tmp_path / "steady.csv")]) == 0
    assert "integrated" not in capsys.readouterr().err
    moving, steady = rows(tmp_path / "moving.csv"), rows(tmp_path / "steady.csv")
    assert list(moving[0]) == list(steady[0]) and moving[0] == steady[0]
    limits = {row["active_limit"] for row in moving}
    assert {"fuel_control.lean", "fuel_control.hot", "fuel_control.rate"} <= limits
    at_idle = next(k for k, row in enumerate(moving) if row["phase"] == "idle")
    assert float(moving[at_idle]["N1_rpm"]) > float(steady[at_idle]["N1_rpm"]) + 500.0
