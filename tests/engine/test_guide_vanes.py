"""Guide vanes of a compressor: the two laws, their neutral position, stops and derivatives."""

from __future__ import annotations

import numpy as np
import pytest
from engine_makers import GAS, component, evaluation, flow, fourth_order, gradient, seeds, shaft

from enginediag_cli.engine.dual import value
from enginediag_cli.engine.maps import closed_efficiency, closed_flow

A, B = 0.012, 4e-4


def sized(**vanes):
    part = component(
        "compressor",
        to="3",
        shaft="hp",
        pressure_ratio=10.0,
        isentropic_efficiency=0.85,
        **{"from": "2"},
        **({"vanes": {"flow_per_deg": A, "loss_per_deg2": B, **vanes}} if vanes is not None else {}),
    )
    e = evaluation([part])
    e.flows["2"], e.shafts["hp"] = flow(288.15, 101325.0, 20.0), shaft(10000.0)
    part.size(e)
    return part


def run(part, W=20.0, T=288.15, wrt=(), **leaves):
    inlet = flow(T, 101325.0, W)
    e = evaluation([part], size=np.size(inlet.W), wrt=wrt, **leaves)
    e.flows["2"], e.shafts["hp"] = inlet, shaft(np.full(np.size(inlet.W), 10000.0))
    part.evaluate(e)
    return e


def efficiency_of(e):
    inlet, outlet = e.flows["2"], e.flows["3"]
    _, h_s = GAS.temperature_from_entropy(inlet.phi + inlet.R * np.log(value(outlet.P) / value(inlet.P)), inlet.mixture)
    return (h_s - inlet.h) / (value(outlet.h) - inlet.h)


def test_vanes_in_their_neutral_position_are_absent_to_the_last_digit():
    with_vanes, without = sized(), component_without_vanes()
    for W in (19.0, 20.0, 20.7):
        a, b = run(with_vanes, W), run(without, W)
        assert a.flows["3"].P[0] == b.flows["3"].P[0]
        assert a.flows["3"].h[0] == b.flows["3"].h[0]


def component_without_vanes():
    part = component("compressor", to="3", shaft="hp", pressure_ratio=10.0, isentropic_efficiency=0.85, **{"from": "2"})
    e = evaluation([part])
    e.flows["2"], e.shafts["hp"] = flow(288.15, 101325.0, 20.0), shaft(10000.0)
    part.size(e)
    return part


def test_closed_vanes_pass_exp_minus_a_phi_of_the_flow_at_the_same_work():
    part = sized()
    closed = run(part, 20.0 * np.exp(-A * 15.0), compressor__vane_closing_deg=15.0)
    opened = run(part)
    assert closed.flows["3"].h[0] == pytest.approx(opened.flows["3"].h[0], rel=1e-13)


@pytest.mark.parametrize("angle", [-5.0, 10.0, 25.0])
def test_efficiency_falls_with_the_square_of_the_angle_either_way(angle):
    part = sized(open_stop_deg=-10.0)
    e = run(part, 20.0 * np.exp(-A * angle), compressor__vane_closing_deg=angle)
    assert efficiency_of(e)[0] == pytest.approx(0.85 / (1.0 + B * angle**2), rel=1e-9)


def test_the_actuator_stands_between_its_stops_and_is_told_in_words():
    (vanes,) = sized(open_stop_deg=-4.0, closed_stop_deg=35.0).actuators()
    assert (vanes.name, vanes.unit, vanes.neutral) == ("compressor.vane_closing_deg", "deg", 0.0)
    assert (vanes.lower, vanes.upper) == (-4.0, 35.0)
    assert vanes.words == "compressor guide vanes, closing"
    assert component_without_vanes().actuators() == ()


def test_stops_that_leave_out_the_neutral_position_are_refused():
    with pytest.raises(ValueError, match="open_stop_deg"):
        sized(open_stop_deg=3.0)


def test_derivatives_along_angle_and_coefficients_match_differences():
    part = sized()
    names = ("compressor.vane_closing_deg", "compressor.vanes.flow_per_deg", "compressor.vanes.loss_per_deg2")
    at = {"compressor.vane_closing_deg": 12.0, names[1]: A, names[2]: B}
    e = run(part, 18.0, wrt=names, **{n.replace(".", "__"): v for n, v in at.items()})
    for read in (lambda e: e.flows["3"].P, lambda e: e.flows["3"].h):
        exact = gradient(read(e), len(e.directions))
        for name in names:

            def moved(t, name=name, read=read):
                there = {**at, name: at[name] * (1.0 + t)}
                return read(run(part, 18.0, **{n.replace(".", "__"): v for n, v in there.items()}))[0]

            numeric, size = fourth_order(moved, 1e-3), abs(value(read(e))[0])
            assert exact[e.directions[name]][0] * at[name] == pytest.approx(numeric, rel=1e-6, abs=1e-12 * size)


def test_the_laws_have_exact_derivatives():
    angle, a = seeds(12.0, A)
    flowing, eta = closed_flow(1.0, a, angle), closed_efficiency(1.0, B, angle)
    assert flowing.d[:, 0] == pytest.approx([-A * flowing.v[0], -12.0 * flowing.v[0]])
    assert eta.d[0, 0] == pytest.approx(-2.0 * B * 12.0 * eta.v[0] ** 2)


def test_an_answer_about_flow_capacity_names_the_vanes_where_there_are_any():
    (capacity,) = (p for p in sized().parameters() if p.quantity == "flow_capacity")
    assert capacity.words.endswith("flow capacity (or variable vanes off schedule)")
    (capacity,) = (p for p in component_without_vanes().parameters() if p.quantity == "flow_capacity")
    assert capacity.words.endswith("flow capacity")
