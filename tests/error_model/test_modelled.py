"""An engine whose maps may be wrong: the engine itself without amounts, exact derivatives with them."""

from __future__ import annotations

import copy
import pickle

import numpy as np
import pytest
from engine_makers import fourth_order, operating_points, turbofan

from enginediag_cli.error_model.maps import CURVES, FAMILY, QUANTITIES, MapErrorModel, learn_curves, turbomachines

AMOUNTS = {
    "map_error.hpc.efficiency.1": 0.01,
    "map_error.hpc.efficiency.4": -0.008,
    "map_error.fan.flow_capacity.2": 0.012,
    "map_error.lpt.flow_capacity.5": 0.006,
}
SENSORS = ("T3_K", "P3_Pa", "N2_rpm", "T5_K")


@pytest.fixture(scope="module")
def inputs():
    return operating_points(turbofan(), 12, 2, power=(0.2, 1.0))


@pytest.fixture(scope="module")
def model(inputs):
    engine = turbofan()
    machines = turbomachines(engine)
    columns = tuple(dict.fromkeys(c for m in machines for c in m.columns))
    values = dict(zip(columns, engine.predict(inputs, sensors=columns).y.T, strict=True))
    curves = [learn_curves(m.name, m.coordinates(values)) for m in machines]
    return MapErrorModel(engine, curves, {m.parameter(q): 0.003 for m in machines for q in QUANTITIES})


def test_with_no_amounts_it_is_the_engine_itself(model, inputs):
    theta = {"hpc.efficiency": 0.98}
    mine = model.predict(inputs, theta | dict.fromkeys(AMOUNTS, 0.0), sensors=SENSORS, wrt=("hpc.efficiency",))
    plain = turbofan().predict(inputs, theta, sensors=SENSORS, wrt=("hpc.efficiency",))
    np.testing.assert_array_equal(mine.y, plain.y)
    np.testing.assert_array_equal(mine.jacobian, plain.jacobian)
    assert model.inputs == turbofan().inputs and model.monitored == turbofan().monitored


def test_every_map_quantity_has_amounts_with_the_stated_standard_deviation(model):
    own = [p for p in model.parameters.values() if p.family == FAMILY]
    assert len(own) == CURVES * len(model.targets) == CURVES * 2 * len(turbomachines(turbofan()))
    for p in own:
        assert p.nominal == 0.0 and p.prior_sigma == 0.003 and np.isinf([p.lower, p.upper]).all()
        assert p.component == p.name.split(".")[1]
    assert not set(model.monitored) & {p.name for p in own}


def test_an_amount_acts_as_the_health_parameter_that_multiplies_what_the_map_gives(model, inputs):
    name = "map_error.hpc.efficiency.1"
    found = model.predict(inputs, {}, sensors=SENSORS, wrt=(name, "hpc.efficiency"))
    m = next(m for m in turbomachines(turbofan()) if m.name == "hpc")
    values = dict(zip(m.columns, turbofan().predict(inputs, sensors=m.columns).y.T, strict=True))
    phi = next(c for c in model.curves if c.machine == "hpc").evaluate(m.coordinates(values))[:, 0]
    np.testing.assert_allclose(found.jacobian[:, :, 0], found.jacobian[:, :, 1] * phi[:, None], rtol=1e-9)


@pytest.mark.parametrize("given", [True, False])
def test_derivatives_are_exact_whether_the_frozen_columns_are_given_or_not(model, inputs, given):
    theta = {**AMOUNTS, "hpc.efficiency": 0.99}
    frozen = model.frozen(inputs, SENSORS) if given else {}
    wrt = ("map_error.hpc.efficiency.1", "hpc.efficiency", "map_error.fan.flow_capacity.2", "fan.flow_capacity")
    found = model.predict({**inputs, **frozen}, theta, sensors=SENSORS, wrt=wrt)
    for k, name in enumerate(wrt):
        at = theta.get(name, model.parameters[name].nominal)
        direct = fourth_order(
            lambda h, name=name, at=at: model.predict({**inputs, **frozen}, {**theta, name: at + h}, sensors=SENSORS).y,
            1e-3,
        )
        scale = np.abs(found.jacobian[:, :, k]).max(axis=0)
        np.testing.assert_array_less(np.abs(found.jacobian[:, :, k] - direct).max(axis=0), 1e-6 * scale + 1e-9)


def test_the_frozen_columns_that_a_prediction_hands_over_reproduce_it(model, inputs):
    first = model.predict(inputs, AMOUNTS, sensors=SENSORS, wrt=tuple(AMOUNTS))
    again = model.predict({**inputs, **first.frozen}, AMOUNTS, sensors=SENSORS, wrt=tuple(AMOUNTS))
    np.testing.assert_allclose(again.y, first.y, rtol=1e-12)
    np.testing.assert_allclose(again.jacobian, first.jacobian, rtol=1e-9, atol=1e-12)
    assert first.wrt == tuple(AMOUNTS)


def test_the_error_stays_where_a_fault_moves_the_machine(model, inputs):
    errors = []
    for theta in ({}, {"hpc.efficiency": 0.95}):
        plain = turbofan().predict(inputs, theta, sensors=SENSORS).y
        errors.append(model.predict(inputs, {**theta, **AMOUNTS}, sensors=SENSORS).y - plain)
    np.testing.assert_allclose(errors[1], errors[0], rtol=1e-6, atol=1e-9)


def test_the_error_is_linear_in_the_amounts(model, inputs):
    plain = model.predict(inputs, {}, sensors=SENSORS).y
    one, two = (
        model.predict(inputs, {n: f * v for n, v in AMOUNTS.items()}, sensors=SENSORS).y - plain for f in (1.0, 2.0)
    )
    np.testing.assert_allclose(two, 2 * one, rtol=1e-9, atol=1e-9)
    assert np.all(np.abs(one / plain).max(axis=0) > 1e-4)


def test_a_record_without_a_prediction_is_frozen_at_no_error(model, inputs):
    broken = {c: np.array(v, float) for c, v in inputs.items()}
    broken[turbofan().power_setting][3] *= 50.0
    columns = model.frozen(broken, SENSORS)
    assert all(np.isfinite(v).all() for v in columns.values())
    ok = turbofan().predict(broken).ok
    assert not ok[3] and all(v[3] == 0 for v in columns.values())


def test_a_copy_and_a_pickled_model_predict_the_same(model, inputs):
    y = model.predict(inputs, AMOUNTS, sensors=SENSORS).y
    np.testing.assert_array_equal(copy.copy(model).predict(inputs, AMOUNTS, sensors=SENSORS).y, y)
    assert pickle.loads(pickle.dumps(model.curves)) == model.curves


def test_some_of_the_amounts_of_a_map_may_be_asked_for_without_the_others(model, inputs):
    names = model.groups["hpc.efficiency"]
    every = model.predict(inputs, {}, sensors=SENSORS, wrt=names).jacobian
    for chosen in ([1], [4, 0]):
        some = model.predict(inputs, {}, sensors=SENSORS, wrt=tuple(names[j] for j in chosen)).jacobian
        np.testing.assert_array_equal(some, every[:, :, chosen])


def test_quantities_that_are_not_said_to_be_wrong_have_no_amounts(model):
    few = MapErrorModel(turbofan(), model.curves, {"hpc.efficiency": 0.01, "no.such": 1.0})
    assert few.targets == ("hpc.efficiency",) and len(few.groups["hpc.efficiency"]) == CURVES
