"""An error of an input's instrument is a parameter with the signature of a change of operating point."""

from __future__ import annotations

import pickle
from typing import ClassVar

import numpy as np
import pytest

from enginediag_cli.engine.instrument_errors import InputErrors
from enginediag_cli.parameters import Parameter
from enginediag_cli.physics.engine_file import load_engine
from enginediag_cli.shipped import shipped

INPUTS = {
    "altitude_m": np.array([0.0, 8000.0]),
    "mach": np.array([0.2, 0.7]),
    "dT_isa_K": np.array([10.0, -5.0]),
    "Wf_kg_s": np.array([2.0, 1.0]),
}


@pytest.fixture(scope="module")
def turbofan():
    return load_engine(str(shipped("turbofan.yaml")))


@pytest.fixture(scope="module")
def model(turbofan):
    return InputErrors.wrap(turbofan)


def test_instruments_of_engine_and_aircraft_are_suspects(model):
    assert list(model.errors) == [
        *("input.altitude.bias", "input.altitude.scale", "input.mach.bias", "input.mach.scale"),
        *("input.dT_isa.bias", "input.Wf.scale", "input.Wf.bias"),
    ]
    seen = InputErrors.wrap(model.model, readings={"Wf_kg_s": 2.5, "dT_isa_K": 20.0})
    assert seen.parameters["input.Wf.bias"].prior_sigma == pytest.approx(0.025)
    assert "input.dT_isa.scale" not in seen.parameters


def test_bias_and_scale_of_one_input_act_together_and_have_the_derivatives_of_differences(turbofan):
    both = InputErrors.wrap(turbofan, ["Wf_kg_s"], {"Wf_kg_s": 2.5})
    at = {"input.Wf.bias": 0.05, "input.Wf.scale": 1.02}
    true = turbofan.predict({**INPUTS, "Wf_kg_s": (INPUTS["Wf_kg_s"] - 0.05) / 1.02}, {})
    found = both.predict(INPUTS, at, wrt=tuple(at))
    np.testing.assert_allclose(found.y, true.y, rtol=1e-9)
    for k, (name, h) in enumerate((("input.Wf.bias", 1e-4), ("input.Wf.scale", 1e-4))):
        high, low = (both.predict(INPUTS, {**at, name: at[name] + step}).y for step in (h, -h))
        np.testing.assert_allclose(found.jacobian[:, :, k], (high - low) / (2 * h), rtol=1e-3, atol=1e-3)


def test_air_data_are_plausibly_wrong_by_the_same_in_any_unit():
    class Imperial:
        inputs, parameters = ("altitude_ft", "mach"), {}

    errors = InputErrors.wrap(Imperial()).parameters
    assert errors["input.altitude.bias"].prior_sigma == pytest.approx(75.0 / 0.3048)
    assert errors["input.mach.bias"].prior_sigma == 0.01 and errors["input.mach.bias"].nominal == 0.0


def test_a_torque_meter_that_sets_the_power_is_a_suspect():
    errors = InputErrors.wrap(load_engine(str(shipped("turboprop.yaml")))).parameters
    assert errors["input.reduction_gear_torque.scale"].prior_sigma == pytest.approx(0.01)


def test_power_plant_suspects_the_reading_that_sets_its_power():
    plant = InputErrors.wrap(load_engine(str(shipped("power_plant.yaml"))))
    error = plant.parameters["input.T4.bias"]
    assert error.belongs_to_instrument and not error.belongs_to_sensor and error.family == "input"
    assert error.component == "input.T4" and error.part == "T4 reading" and error.unit == "K"
    # 0.75 % of 1177 °C, against 2.5 K of the air
    assert error.prior_sigma == pytest.approx(8.83, abs=0.05)
    assert plant.parameters["input.ambient_temperature.bias"].prior_sigma == 2.5


def test_without_an_error_the_prediction_is_the_engines_own(turbofan, model):
    assert np.array_equal(model.predict(INPUTS).y, turbofan.predict(INPUTS).y)


def test_a_reading_that_is_too_high_predicts_the_lower_true_input(turbofan, model):
    read = model.predict(INPUTS, {"input.Wf.scale": 1.02, "input.dT_isa.bias": 3.0})
    true = {**INPUTS, "Wf_kg_s": INPUTS["Wf_kg_s"] / 1.02, "dT_isa_K": INPUTS["dT_isa_K"] - 3.0}
    assert np.allclose(read.y, turbofan.predict(true).y, rtol=1e-9)


@pytest.mark.parametrize(
    ("name", "step"),
    [("input.Wf.scale", 1e-4), ("input.dT_isa.bias", 1e-2), ("input.altitude.bias", 1.0), ("input.mach.bias", 1e-4)],
)
def test_sensitivities_agree_with_differences_and_keep_their_order(model, name, step):
    wrt = ("hpc.efficiency", name, "Wf_kg_s", "fan.efficiency")
    at = model.parameters[name].nominal + 0.5 * model.parameters[name].prior_sigma
    found = model.predict(INPUTS, {name: at}, wrt=wrt)
    up, down = (model.predict(INPUTS, {name: at + sign * step}).y for sign in (1, -1))
    assert found.wrt == wrt
    assert np.allclose(found.jacobian[:, :, 1], (up - down) / (2 * step), rtol=1e-5)
    plain = model.predict(INPUTS, {name: at}, wrt=("hpc.efficiency", "fan.efficiency"))
    assert np.allclose(found.jacobian[:, :, [0, 3]], plain.jacobian)


def test_every_record_may_have_an_error_of_its_own(model):
    together = model.predict(INPUTS, {"input.Wf.scale": np.array([1.0, 1.02])}).y
    alone = model.predict({c: v[1:] for c, v in INPUTS.items()}, {"input.Wf.scale": 1.02}).y
    assert np.allclose(together[1], alone[0], rtol=1e-9)
    assert np.allclose(together[0], model.predict(INPUTS).y[0], rtol=1e-9)


def test_stated_noise_of_an_input_says_how_far_it_is_plausibly_wrong(turbofan):
    class Stated:
        inputs, parameters, envelope = ("N1_rpm", "T4_K"), {}, {"N1_rpm": (0.0, 4000.0)}
        declared: ClassVar = {"mismatch": {"input_noise": {"T4_K": 2.0}}, "sensors": {"N1_rpm": {"noise_sigma": 8.0}}}

    errors = InputErrors.wrap(Stated()).parameters
    assert errors["input.T4.bias"].prior_sigma == pytest.approx(6.0)
    assert errors["input.N1.scale"].prior_sigma == pytest.approx(3 * 8.0 / 4000.0)


def test_an_engine_without_such_instruments_is_left_as_it_is():
    class Bare:
        inputs, parameters = ("humidity", "guide_vanes_deg"), {}

    bare = Bare()
    assert InputErrors.wrap(bare) is bare


def test_all_else_is_the_engines(turbofan, model):
    assert model.power_setting == turbofan.power_setting and model.envelope is turbofan.envelope
    with pytest.raises(AttributeError):
        _ = model.no_such_thing


def test_it_travels_to_another_process_with_its_engine():
    copied = pickle.loads(pickle.dumps(InputErrors(_Engine(), InputErrors.wrap(_Engine()).errors.values())))
    assert list(copied.errors) == ["input.N1.scale"]


class _Engine:
    inputs, parameters = ("N1_rpm",), {}


def test_its_meaning_travels_with_statistics(model):
    error = model.parameters["input.Wf.scale"]
    again = Parameter.from_mapping(error.as_mapping())
    assert again.belongs_to_instrument and again.words == "Wf reading scale factor"
