from __future__ import annotations

import json

import pytest
from parameter_makers import described

from enginediag_cli.physics.engine_file import load_engine
from enginediag_cli.shipped import shipped
from enginediag_cli.validation.demonstration import (
    Case,
    IsolatedChange,
    JudgedFlight,
    TrueChange,
    closing,
    comparison,
    describe_isolation,
    mistakes,
    read_flights,
    read_true_changes,
)

HPC = described("hpc.efficiency")
FOULED = {"hpc.efficiency": TrueChange(HPC, -0.02)}
RIGHT = {"hpc.efficiency": IsolatedChange(HPC, -0.021, -0.023, -0.019, 0.99)}


@pytest.fixture(scope="module")
def engine():
    return load_engine(str(shipped("turbofan.yaml")))


def flight(verdict="fault", put_in=FOULED, found=RIGHT, reason=""):
    return JudgedFlight("4", put_in, {"verdict": verdict}, found, (), reason)


def test_a_fault_found_with_its_size_is_no_mistake():
    assert list(mistakes(flight())) == []
    assert closing([flight()]).startswith("All 1 flights were judged rightly")


@pytest.mark.parametrize(
    ("bad", "told"),
    [
        (flight(put_in={}, found=None), "false alarm"),
        (flight("healthy", found=None), "was not detected"),
        (flight("no verdict", found=None, reason="all outside"), "could not be judged: all outside"),
        (flight(found={}), "HPC isentropic efficiency was not named"),
        (
            flight(
                found=RIGHT | {"fan.efficiency": IsolatedChange(described("fan.efficiency"), -0.01, -0.02, 0.0, 0.6)}
            ),
            "although nothing is wrong",
        ),
        (
            flight(found={"hpc.efficiency": IsolatedChange(HPC, -0.03, -0.031, -0.029, 0.99)}),
            "outside its 95 % interval",
        ),
    ],
)
def test_everything_missed_or_wrong_is_told(bad, told):
    (mistake,) = mistakes(bad)
    assert told in mistake
    assert f"  ! {mistake}" in list(comparison(Case("a", "an engine", 1), [bad]))
    assert "1 thing was missed or wrong" in closing([flight(), bad])


def test_a_flight_that_isolate_could_not_judge_is_no_empty_answer():
    assert "no verdict: too few records" in describe_isolation(flight(found=None, reason="too few records"))


def test_the_truth_is_the_mean_change_over_a_flight_since_the_first_record(tmp_path, engine):
    path = tmp_path / "truth.csv"
    path.write_text("# made\nflight,time_s,hpc.efficiency,sensor.T3_K.bias\n1,0,1,0\n1,1,1,0\n2,2,0.98,5\n2,3,0.96,7\n")
    changes = dict(read_true_changes(engine, path))
    assert changes["1"] == {}
    assert changes["2"]["hpc.efficiency"].change == pytest.approx(-0.03)
    assert changes["2"]["sensor.T3.bias"] == TrueChange(engine.parameters["sensor.T3.bias"], 6.0)


def test_answers_are_read_back_flight_by_flight(tmp_path, engine):
    row = {"flight": "1", "verdict": "healthy", "reason": "", "isolated": [], "parameter": None, "rivals": []}
    found = {"parameter": "sensor.T3.bias", "change": 6.1, "lower": 5.9, "upper": 6.3, "unit": "K", "inclusion": 0.99}
    second = {**row, "flight": "2", "verdict": "fault", "isolated": ["sensor.T3.bias"], **found}
    lost = {**row, "flight": "3", "verdict": "no verdict", "reason": "nothing judged", "isolated": None}
    path, truth = tmp_path / "rows.json", tmp_path / "truth.csv"
    path.write_text(json.dumps([row, second, lost]))
    truth.write_text("flight,sensor.T3_K.bias\n1,0\n2,6\n3,6\n")
    one, two, three = read_flights(engine, truth, path, path)
    assert (one.verdict, one.true_changes, one.isolated) == ("healthy", {}, {})
    assert (
        two.isolated == {"sensor.T3.bias": IsolatedChange(engine.parameters["sensor.T3.bias"], 6.1, 5.9, 6.3, 0.99)}
        and list(mistakes(two)) == []
    )
    assert three.isolated is None and three.reason == "nothing judged"
