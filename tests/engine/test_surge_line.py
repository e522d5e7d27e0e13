"""Surge line: the margin by its definition, in map units and in kg/s, with vanes, and its derivative."""

from __future__ import annotations

import numpy as np
import pytest
from engine_makers import component, evaluation, flow, fourth_order, gradient, shaft

from enginediag_cli.engine.dual import Dual
from enginediag_cli.engine.maps import SurgeLine

LINE = {"corrected_flow": [10.0, 20.0, 24.0], "pressure_ratio": [5.0, 12.0, 14.0]}
MAP = "Nc_map,Rline,Wc_map,PR_map,eff_map\n" + "".join(
    f"{n},{r},{n * (0.8 + 0.1 * r)},{1.0 + n * n * (2.0 - 0.2 * r)},{0.8 + 0.01 * r}\n"
    for n in (0.8, 1.0, 1.2)
    for r in (1.0, 2.0, 3.0)
)


def made(**options):
    part = component(
        "compressor", to="3", shaft="hp", pressure_ratio=10.0, isentropic_efficiency=0.85, **{"from": "2"}, **options
    )
    e = evaluation([part])
    e.flows["2"], e.shafts["hp"] = flow(288.15, 101325.0, 20.0), shaft(10000.0)
    part.size(e)
    return part, e


def run(part, W=20.0, wrt=(), **leaves):
    e = evaluation([part], size=np.size(W), wrt=wrt, **leaves)
    e.flows["2"], e.shafts["hp"] = flow(np.full(np.size(W), 288.15), 101325.0, W), shaft(np.full(np.size(W), 10000.0))
    part.evaluate(e)
    return e


def test_the_margin_is_that_of_pressure_ratio_at_constant_corrected_flow():
    part, _ = made(surge_line=LINE)
    e = run(part, np.array([18.0, 20.0, 21.0]))
    ratio = e.outputs["compressor_pressure_ratio"]
    line = np.interp([18.0, 20.0, 21.0], LINE["corrected_flow"], LINE["pressure_ratio"])
    assert e.outputs["compressor_surge_margin"] == pytest.approx(line / ratio - 1.0, rel=1e-12)
    assert e.outputs["compressor_surge_margin"][1] == pytest.approx(0.2, rel=1e-9)


def test_a_compressor_without_surge_line_has_no_margin():
    part, e = made()
    assert "compressor_surge_margin" not in e.outputs
    assert part.surge_line is None


def test_a_line_of_a_table_is_in_the_units_of_the_table():
    table = {"file": "map.csv", "design_speed": 1.0, "design_rline": 2.0}
    line = {"corrected_flow": [0.5, 1.5], "pressure_ratio": [2.0, 4.0]}
    part = component(
        "compressor",
        to="3",
        shaft="hp",
        pressure_ratio=10.0,
        isentropic_efficiency=0.85,
        table=table,
        table_text=MAP,
        surge_line=line,
        **{"from": "2"},
    )
    e = evaluation([part])
    e.flows["2"], e.shafts["hp"] = flow(288.15, 101325.0, 20.0), shaft(10000.0)
    part.size(e)
    # Wc_map 1 and PR_map 2.6 at the design point; the line has 3 there, 1 + (3 − 1)·9/1.6 of pressure ratio 10
    assert e.outputs["compressor_surge_margin"][0] == pytest.approx((1.0 + 2.0 * 9.0 / 1.6) / 10.0 - 1.0, rel=1e-9)


def test_beyond_its_ends_the_line_goes_on_straight():
    line = SurgeLine(LINE)
    assert line.pressure_ratio(np.array([5.0, 26.0])) == pytest.approx([1.5, 15.0])


def test_closed_vanes_move_the_line_with_the_map():
    part, _ = made(surge_line=LINE, vanes={"flow_per_deg": 0.01, "loss_per_deg2": 0.0})
    a = run(part, 20.0)
    b = run(part, 20.0 * np.exp(-0.1), compressor__vane_closing_deg=10.0)
    assert b.outputs["compressor_surge_margin"][0] == pytest.approx(a.outputs["compressor_surge_margin"][0], rel=1e-12)


def test_its_derivative_matches_differences():
    part, _ = made(surge_line=LINE)
    e = run(part, 18.3, wrt=("compressor.flow_capacity",))

    def moved(t):
        return run(part, 18.3, compressor__flow_capacity=1.0 + t).outputs["compressor_surge_margin"][0]

    margin = e.outputs["compressor_surge_margin"]
    assert isinstance(margin, Dual)
    assert gradient(margin, 1)[0][0] == pytest.approx(fourth_order(moved, 1e-3), rel=1e-6)


@pytest.mark.parametrize("flows", [[20.0, 10.0, 24.0], [10.0, 20.0], [10.0]])
def test_points_that_are_no_line_are_refused(flows):
    with pytest.raises(ValueError, match="surge_line must rise"):
        made(surge_line={"corrected_flow": flows, "pressure_ratio": [5.0, 12.0, 14.0]})
