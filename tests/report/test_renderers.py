"""One chart, two renderers and a table: they show the same numbers."""

from __future__ import annotations

import math
from xml.etree import ElementTree

import pytest

from enginediag_cli.report.plotting import (
    Axis,
    Band,
    Bars,
    Chart,
    ChartColumn,
    ChartTable,
    EventMark,
    HeatCells,
    Intervals,
    Line,
    Points,
    ReferenceLine,
    RowOrigin,
    format_value,
)
from enginediag_cli.report.plotting.interactive import available, plot
from enginediag_cli.report.plotting.svg import picture, png

PLACE = [RowOrigin("a.csv", "7"), RowOrigin("a.csv", "8")]
UPRIGHT = Chart(
    "upright",
    "Upright",
    Axis("flight"),
    Axis("change", "%"),
    [
        Band("band", [1, 2], [-1, -2], [1, 2], 1),
        Line("line", [1, 1.5, 2], [0.5, math.nan, 1.5], 1, dashed=True),
        Intervals("sizes", [1, 2], [0.4, 1.6], [0.1, 1.1], [0.9, 2.1], 0, origins=PLACE),
        Points("many", [1, 2], [0.2, 0.3], 2, small=True, origins=PLACE),
    ],
    ChartTable((ChartColumn("flight"), ChartColumn("change", "%")), [("1", 0.4), ("2", 1.6)], PLACE),
    "What is seen.",
    [EventMark(1.2, "wash", 1.6)],
    [ReferenceLine(1.0, "limit")],
)
LYING = Chart(
    "lying",
    "Lying",
    Axis("size"),
    Axis("", categories=["one", "two", "two"]),
    [Bars("bars", [0, 1, 2], [1.0, -2.0, math.nan], 0, 0.1, 0.3)],
    ChartTable((ChartColumn("row"),), [("one",), ("two",), ("two",)]),
)
HEAT = Chart(
    "heat",
    "Heat",
    Axis("", categories=["a", "b"]),
    Axis("", categories=["x", "y"]),
    [HeatCells("value", [0, 1, 0], [0, 0, 1], [3.0, -1.0, math.nan], 3.0, ["3", "", ""], signed=True)],
    ChartTable((ChartColumn("cell"),), [("x",)]),
)
ALL = pytest.mark.parametrize("chart", [UPRIGHT, LYING, HEAT], ids=lambda chart: chart.key)


@ALL
def test_a_picture_is_valid_svg_with_its_title_and_caption(chart) -> None:
    root = ElementTree.fromstring(picture(chart).text())
    assert root[0].text == f"{chart.title}. {chart.caption}".strip()
    assert "nan" not in picture(chart).text().lower()


@ALL
@pytest.mark.skipif(not available(), reason="no bokeh here: pip install 'enginediag[report]'")
def test_a_plot_is_the_same_json_each_time_without_an_address(chart) -> None:
    import json

    first = json.dumps(plot(chart), allow_nan=False)
    assert first == json.dumps(plot(chart), allow_nan=False)
    assert "http" not in first


@pytest.mark.skipif(not available(), reason="no bokeh here: pip install 'enginediag[report]'")
def test_a_plot_holds_the_numbers_of_the_table_and_the_row_of_each() -> None:
    import json

    text = json.dumps(plot(UPRIGHT))
    assert "[0.4, 1.6]" in text and '["7", "8"]' in text


def test_rows_of_a_lying_chart_stand_in_their_order_from_the_top() -> None:
    texts = [e for e in ElementTree.fromstring(picture(LYING).text()).iter() if e.text in ("one", "two")]
    heights = [float(e.get("y", "0")) for e in texts]
    assert [e.text for e in texts] == ["one", "two", "two"] and heights == sorted(heights)


@ALL
def test_a_picture_becomes_a_png(chart) -> None:
    pytest.importorskip("resvg_py", reason="no resvg-py here: pip install 'enginediag[report]'")
    assert png(picture(chart).text(), "x.png").startswith(b"\x89PNG")


def test_numbers_in_tables_are_rounded_and_have_a_true_minus() -> None:
    assert [format_value(v) for v in (-0.123456, 24.80123, math.nan, None, -3, "a-b")] == [
        "−0.1235",
        "24.8",
        "",
        "",
        "−3",
        "a-b",
    ]


def test_a_table_refuses_rows_that_do_not_fit() -> None:
    with pytest.raises(ValueError, match="as many cells"):
        ChartTable((ChartColumn("a"), ChartColumn("b")), [("1",)])
