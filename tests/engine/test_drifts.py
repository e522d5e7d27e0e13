"""A drift of an instrument is a parameter: an error that grows with the hours since the recording began."""

from __future__ import annotations

import numpy as np
import pytest

from enginediag_cli.engine.instrument_errors import ELAPSED, InputErrors, InstrumentDrifts
from enginediag_cli.physics.engine_file import load_engine
from enginediag_cli.recordings.table import Recording
from enginediag_cli.residuals.windows import FlightHours
from enginediag_cli.shipped import shipped

HOURS = np.array([0.0, 0.5, 2.0])
INPUTS = {
    "altitude_m": np.array([0.0, 8000.0, 4000.0]),
    "mach": np.array([0.2, 0.7, 0.5]),
    "dT_isa_K": np.array([10.0, -5.0, 0.0]),
    "Wf_kg_s": np.array([2.0, 1.0, 1.2]),
}
READ = {**INPUTS, ELAPSED: HOURS}
RATES = {"sensor.P3.drift": -5000.0, "input.Wf.drift": 0.02}


@pytest.fixture(scope="module")
def plain():
    return load_engine(str(shipped("turbofan.yaml")))


@pytest.fixture(scope="module")
def model(plain):
    errors = InputErrors.wrap(plain, readings={"Wf_kg_s": 2.5})
    known = {p.component: p for p in errors.parameters.values() if p.quantity == "bias"}
    outputs = {c: known[f"sensor.{s.quantity}"] for c, s in plain.sensors.items()}
    return InstrumentDrifts.from_biases(errors, outputs, {"Wf_kg_s": known["input.Wf"]})


def test_a_drift_adds_its_rate_times_the_hours_to_what_is_read(plain, model):
    true = plain.predict({**INPUTS, "Wf_kg_s": INPUTS["Wf_kg_s"] - 0.02 * HOURS}, {})
    found = model.predict(READ, RATES, wrt=tuple(RATES))
    P3 = list(found.columns).index("P3_Pa")
    np.testing.assert_allclose(found.y[:, P3], true.y[:, P3] - 5000.0 * HOURS, rtol=1e-9)
    others = [j for j in range(found.y.shape[1]) if j != P3]
    np.testing.assert_allclose(found.y[:, others], true.y[:, others], rtol=1e-9)


def test_derivatives_are_those_of_differences_in_any_order_and_beside_other_forms(model):
    wrt = ("hpc.efficiency", "sensor.P3.drift", "input.Wf.bias", "input.Wf.drift", "sensor.P3.bias")
    at = {**RATES, "input.Wf.bias": 0.01}
    J = model.predict(READ, at, wrt=wrt).jacobian
    for k, name in enumerate(wrt):
        nominal, h = model.parameters[name].nominal, 1e-4 * model.parameters[name].prior_sigma
        high, low = (model.predict(READ, {**at, name: at.get(name, nominal) + s * h}).y for s in (1, -1))
        scale = np.abs(J[:, :, k]).max()
        np.testing.assert_allclose(J[:, :, k], (high - low) / (2 * h), atol=1e-4 * scale)
    np.testing.assert_array_equal(model.predict(READ, at, wrt=wrt[::-1]).jacobian, J[:, :, ::-1])


def test_without_time_nothing_drifts(plain, model):
    found = model.predict(INPUTS, RATES, wrt=("sensor.P3.drift", "input.Wf.drift"))
    np.testing.assert_allclose(found.y, plain.predict(INPUTS, {}).y, rtol=1e-12)
    assert not np.any(found.jacobian)


def test_hours_run_from_the_first_record_of_each_flight_whatever_the_chunks():
    flight = ("a",) * 3 + ("b",) * 3
    time = np.array([1e9, np.nan, 1e9 + 3600, 50.0, 1850.0, 3650.0])
    whole = Recording({"time_s": time}, text={"flight": flight}, source="f")
    hours = FlightHours()
    parts = [whole.select(slice(0, 2)), whole.select(slice(2, 5)), whole.select(slice(5, 6))]
    found = np.concatenate([part[ELAPSED] for part in hours.add_hours(parts)])
    np.testing.assert_allclose(found, [0, 0, 1, 0, 0.5, 1])
    (untimed,) = FlightHours().add_hours([Recording({"T": time})])
    assert not np.any(untimed[ELAPSED])
