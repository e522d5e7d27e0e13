"""Bleed valves and nozzles whose area can be varied: neutral positions, what moving them does, derivatives."""

from __future__ import annotations

import numpy as np
import pytest
from engine_makers import GAS, component, evaluation, flow, gradient, operating_points
from mixed_flow import MIXED_FLOW
from standing import standing

from enginediag_cli.engine.evaluation import mix
from enginediag_cli.physics.engine_file import load_engine

COLUMNS = ("N1_rpm", "N2_rpm", "T3_K", "P3_Pa", "T5_K", "P6_Pa", "Fn_N", "W2_kg_s")
VALVED = MIXED_FLOW.replace(
    "{name: valve, fraction: 0.02, work_fraction: 0.4, pressure_fraction: 0.3}",
    "{name: valve, fraction: 0.02, work_fraction: 0.4, pressure_fraction: 0.3, valve: throttle}",
)
HANDLING = MIXED_FLOW.replace(
    "{name: valve, fraction: 0.02, work_fraction: 0.4, pressure_fraction: 0.3}",
    "{name: valve, fraction: 0.08, work_fraction: 0.4, pressure_fraction: 0.3, valve: closed}",
)
VARIABLE = MIXED_FLOW.replace('from: "6"}', 'from: "6", opening_range: [0.8, 1.5]}')


def made(tmp_path, text):
    path = tmp_path / "engine.yaml"
    path.write_text(text, encoding="utf-8")
    return load_engine(path)


def points_of(engine, n=20):
    return operating_points(engine, n, 3, altitude=(0.0, 10000.0), mach=(0.2, 0.8), power=(0.4, 1.0))


def test_a_throttle_in_its_neutral_position_is_a_plain_bleed_to_the_last_digit(tmp_path):
    plain, valved = made(tmp_path, MIXED_FLOW), made(tmp_path, VALVED)
    U = points_of(plain)
    assert np.array_equal(plain.predict(U, sensors=COLUMNS).y, valved.predict(U, sensors=COLUMNS).y)


def test_opening_a_throttle_by_half_is_half_as_much_bleed_again(tmp_path):
    plain, valved = made(tmp_path, MIXED_FLOW), made(tmp_path, VALVED)
    U = points_of(plain)
    more = plain.predict(U, {"hpc.valve.fraction": 0.03}, sensors=COLUMNS).y
    assert np.allclose(standing(valved, hpc__valve__opening=1.5).predict(U, sensors=COLUMNS).y, more, rtol=1e-8)


def test_a_handling_bleed_that_is_closed_is_absent_to_the_last_digit(tmp_path):
    without = MIXED_FLOW.replace(
        "      - {name: valve, fraction: 0.02, work_fraction: 0.4, pressure_fraction: 0.3}\n", ""
    ).replace("receives: [valve]", "receives: []")
    a, b = made(tmp_path, without), made(tmp_path, HANDLING)
    U = points_of(a)
    assert np.array_equal(a.predict(U, sensors=COLUMNS).y, b.predict(U, sensors=COLUMNS).y)


def test_an_open_handling_bleed_takes_its_stated_fraction(tmp_path):
    engine = standing(made(tmp_path, HANDLING), hpc__valve__opening=1.0)
    p = engine.predict(points_of(engine), sensors=("W25_kg_s", "W3_kg_s", "W13_kg_s", "W15_kg_s"))
    assert p.status.max() == 0
    W25, W3, W13, W15 = p.y.T
    assert np.allclose(W3, (1.0 - 0.08 - 0.06) * W25, rtol=1e-12)
    assert np.allclose(W15, W13 + 0.08 * W25, rtol=1e-12)


def test_a_closed_row_of_a_batch_is_what_it_is_alone():
    main = flow([600.0, 650.0], [5e5, 6e5], [10.0, 11.0], far=[0.02, 0.03])
    cold = flow([300.0, 300.0], [5e5, 6e5], [0.0, 0.5])
    mixed = mix(main, cold)
    assert mixed.h[0] == main.h[0]
    assert mixed.mixture.far[0] == 0.02
    assert mixed.T[1] < 650.0 and mixed.mixture.far[1] < 0.03


def test_the_valve_has_a_derivative_where_it_is_closed():
    port = [{"name": "handling", "fraction": 0.1, "valve": "closed"}]
    bleed, duct = (
        component("bleed", to="31", ports=port, **{"from": "3"}),
        component("duct", to="4", pressure_loss=0.0, receives=["handling"], **{"from": "2"}),
    )

    def pass_(opening, wrt=()):
        e = evaluation([bleed, duct], wrt=wrt, bleed__handling__opening=opening)
        e.flows["3"], e.flows["2"] = flow(700.0, 1e6, 10.0), flow(400.0, 1e6, 5.0)
        bleed.evaluate(e)
        duct.evaluate(e)
        return e

    e = pass_(0.0, ("bleed.handling.opening",))
    assert gradient(e.flows["31"].W, 1)[0][0] == pytest.approx(-1.0, rel=1e-12)
    h3, h2 = (GAS.enthalpy(np.array([T]), flow(T, 1e6).mixture)[0] for T in (700.0, 400.0))
    assert gradient(e.flows["4"].h, 1)[0][0] == pytest.approx((h3 - h2) / 5.0, rel=1e-9)


def test_a_compressor_and_a_bleed_declare_their_valves():
    ports = [
        {"name": "a", "fraction": 0.1, "valve": "closed"},
        {"name": "b", "fraction": 0.1, "valve": "throttle"},
        {"name": "c", "fraction": 0.1},
    ]
    part = component("compressor", to="3", shaft="hp", ports=ports, **{"from": "2"})
    found = {a.name: (a.neutral, a.lower) for a in part.actuators()}
    assert found == {"compressor.a.opening": (0.0, 0.0), "compressor.b.opening": (1.0, 0.0)}


def test_a_variable_nozzle_in_its_neutral_position_is_a_fixed_one_to_the_last_digit(tmp_path):
    fixed, variable = made(tmp_path, MIXED_FLOW), made(tmp_path, VARIABLE)
    U = points_of(fixed)
    assert np.array_equal(fixed.predict(U, sensors=COLUMNS).y, variable.predict(U, sensors=COLUMNS).y)


def test_a_nozzle_opened_by_a_tenth_has_a_tenth_more_area(tmp_path):
    fixed, variable = made(tmp_path, MIXED_FLOW), made(tmp_path, VARIABLE)
    U = points_of(fixed)
    wider = fixed.predict(U, {"nozzle.area": 1.1}, sensors=COLUMNS).y
    assert np.allclose(standing(variable, nozzle__opening=1.1).predict(U, sensors=COLUMNS).y, wider, rtol=1e-8)


def test_an_opening_range_without_the_design_area_is_refused():
    with pytest.raises(ValueError, match="opening_range"):
        component("nozzle", opening_range=[1.1, 1.5], **{"from": "7"})


def test_the_nozzle_says_how_far_it_opens():
    part = component("nozzle", opening_range=[0.9, 1.6], **{"from": "7"})
    (a,) = part.actuators()
    assert (a.name, a.neutral, a.lower, a.upper, a.words) == ("nozzle.opening", 1.0, 0.9, 1.6, "nozzle opening")
    assert component("nozzle", **{"from": "7"}).actuators() == ()
