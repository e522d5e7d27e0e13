from __future__ import annotations

import numpy as np
import pytest
from simulation_toy import CONFIGS, SENSORS, ToyEngine

from enginediag_cli.errors import ConfigError, DataError
from enginediag_cli.faults.catalogue import STEP, ComponentFault, FaultSet, SensorFault, load_faults
from enginediag_cli.simulation.flights import KINDS, FlightConditions, column_noise, generate_flights
from enginediag_cli.simulation.simulate import simulate, simulate_in_chunks

HEALTHY = FaultSet()


@pytest.fixture
def conditions(engine, flight_values):
    return generate_flights(flight_values("sweep"), engine, np.random.default_rng(3), records=1000)


def run(engine, conditions, faults=HEALTHY, noise="gaussian", seed=1, **how):
    return simulate(engine, conditions, faults, column_noise(KINDS[noise], engine), np.random.default_rng(seed), **how)


def test_without_noise_and_faults_the_recording_is_the_engines_output(engine, conditions):
    record = run(engine, conditions, noise="none")
    y = engine.predict({c: conditions.columns[c] for c in engine.inputs}).y
    for j, column in enumerate(SENSORS):
        np.testing.assert_array_equal(record.columns[column], y[:, j])
    assert record.truth.keys() <= {"flight", "time_s", "phase"}


def test_same_seed_gives_same_bytes_whatever_the_chunks(engine, conditions):
    actuators = ("hpc_bleed_stuck_open", "hpc_vanes_off_schedule")  # which this engine has not
    files = sorted(f for f in (CONFIGS / "faults").glob("*.yaml") if f.stem not in actuators)
    faults = load_faults(*files)
    one, other = (run(engine, conditions, faults, "correlated", chunk=chunk) for chunk in (1000, 137))
    assert all(one.columns[c].tobytes() == other.columns[c].tobytes() for c in one.columns if c != "status")
    assert all(one.truth[c].tobytes() == other.truth[c].tobytes() for c in one.truth)
    assert list(one.columns["status"]) == list(other.columns["status"])


def test_adding_a_sensor_leaves_the_recordings_of_the_others(engine, conditions):
    few = run(ToyEngine(SENSORS[:4]), conditions)
    many = run(engine, conditions)
    for column in SENSORS[:4]:
        np.testing.assert_array_equal(few.columns[column], many.columns[column])


def test_a_fault_changes_the_readings_as_the_engine_says(engine, conditions):
    fault = ComponentFault("f", {"hpc.efficiency": -0.02}, law={**STEP, "onset": 501.0})
    record = run(engine, conditions, FaultSet((fault,)), "none")
    healthy = run(engine, conditions, noise="none")
    ratio = record.columns["T3_K"] / healthy.columns["T3_K"]
    wanted = np.where(np.arange(1000) < 500, 1.0, 0.98 ** engine.exponents["T3_K"]["hpc.efficiency"])
    np.testing.assert_allclose(ratio, wanted, rtol=1e-12)
    np.testing.assert_allclose(record.truth["hpc.efficiency"], np.where(np.arange(1000) < 500, 1.0, 0.98))


def test_the_truth_is_not_in_the_recording(engine, conditions):
    faults = load_faults(CONFIGS / "faults" / "hpc_and_T3.yaml")
    record = run(engine, conditions, faults)
    assert set(record.columns) == {*conditions.columns, *SENSORS, "status"}
    assert {"hpc.efficiency", "hpc.flow_capacity", "sensor.T3_K.bias"} <= set(record.truth)


def test_points_that_do_not_converge_keep_their_row_with_a_reason(engine):
    n = 50
    columns = {
        "altitude_m": np.linspace(0.0, 13500.0, n),
        "mach": np.full(n, 0.5),
        "dT_isa_K": np.zeros(n),
        "Wf_kg_s": np.full(n, 0.8),
    }
    record = run(engine, FlightConditions(columns))
    failed = columns["altitude_m"] > 13000.0
    assert failed.any() and len(record) == n
    np.testing.assert_array_equal(record.columns["status"], np.where(failed, "not-converged", "ok"))
    assert all(np.isnan(record.columns[c][failed]).all() for c in SENSORS)
    assert record.reasons == {"did not converge: hpt flow": int(failed.sum())}


def test_a_stuck_sensor_holds_its_noise_too(engine, conditions):
    fault = SensorFault("f", "T45_K", {"type": "stuck", "value": None}, {**STEP, "onset": 301.0})
    record = run(engine, conditions, FaultSet((), (fault,)), chunk=128)
    assert len(set(record.columns["T45_K"][299:])) == 1


def test_a_wrong_fuel_flow_meter_changes_the_record_and_not_the_engine(engine, conditions):
    fault = SensorFault("f", "Wf_kg_s", {"type": "scale", "change": 0.01})
    record, healthy = run(engine, conditions, FaultSet((), (fault,))), run(engine, conditions)
    np.testing.assert_allclose(record.columns["Wf_kg_s"], 1.01 * healthy.columns["Wf_kg_s"])
    np.testing.assert_array_equal(record.columns["T3_K"], healthy.columns["T3_K"])


def test_columns_that_the_engine_does_not_know_are_carried_through(engine, conditions):
    carried = FlightConditions({**conditions.columns, "tail": np.full(len(conditions), "PH-XYZ")})
    assert set(run(engine, carried).columns["tail"]) == {"PH-XYZ"}


def test_a_missing_input_is_named_with_the_near_column(engine, conditions):
    columns = {("Mach" if c == "mach" else c): v for c, v in conditions.columns.items()}
    with pytest.raises(DataError, match=r"'mach'.*did you mean 'Mach'"):
        run(engine, FlightConditions(columns))


def test_what_is_wrong_with_the_faults_is_said_before_the_first_record(engine, conditions):
    with pytest.raises(ConfigError, match=r"did you mean 'fan\.efficiency'"):
        simulate_in_chunks(
            engine, conditions, FaultSet((ComponentFault("f", {"fan.efficency": -0.01}),)), {}, np.random.default_rng(0)
        )


def test_no_conditions_give_an_empty_recording(engine, conditions):
    record = run(engine, conditions.slice(0, 0))
    assert len(record) == 0 and set(SENSORS) <= set(record.columns)
