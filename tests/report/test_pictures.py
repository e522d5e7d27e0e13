"""SVG files that need no plotting library."""

from __future__ import annotations

import math
from xml.dom import minidom

from enginediag_cli.report.plotting import padded
from enginediag_cli.report.plotting.discrepancy import ScatterData, build_heat_map, mismatch_picture
from enginediag_cli.report.plotting.svg import Drawing, Panel, shade, ticks


def test_text_is_escaped():
    on = Drawing(100, 100, 'a < b & "c"')
    on.words(0, 0, "x < y & z")
    on.rectangle(0, 0, 1, 1, "#fff", hint="<tag>")
    document = minidom.parseString(on.text())
    assert document.getElementsByTagName("title")[0].firstChild.data == 'a < b & "c"'
    assert document.getElementsByTagName("text")[0].firstChild.data == "x < y & z"


def test_ticks_are_round_and_within_the_range():
    assert ticks(0.0, 1.0) == [0.0, 0.2, 0.4, 0.6, 0.8, 1.0]
    assert all(-7.3 <= t <= 12.1 for t in ticks(-7.3, 12.1))
    assert ticks(1.0, 1.0) == [] and ticks(math.nan, 1.0) == []


def test_a_panel_puts_the_corners_of_its_data_in_its_corners():
    panel = Panel(10, 20, 100, 50, (0, 2), (-1, 1))
    assert panel.to_pixels(0, -1) == (10, 70) and panel.to_pixels(2, 1) == (110, 20)
    assert panel.to_pixels(99, 0) == (110, 45)  # beyond the edge: on it


def test_a_range_of_equal_values_is_not_empty():
    low, high = padded([3.0, 3.0])
    assert low < 3.0 < high


def test_shades_run_from_light_to_dark():
    assert shade(-1) == shade(0) == "#f7fbff" and shade(1) == shade(2) == "#08306b"


def test_the_map_shows_every_place_and_marks_those_that_are_told():
    places = [
        ("hpc.efficiency", "mach", 66.7, True),
        ("hpc.efficiency", "power", 2.0, False),
        ("sensor.T3", "mach", 9.0, False),
    ]
    heat = build_heat_map(places, ["mach", "power"], 9.5)
    assert heat.rows == ["hpc.efficiency", "sensor.T3"] and heat.near_best == frozenset({(0, 0)})
    assert math.isnan(heat.surprise[1][1])
    beside = ScatterData(
        "Mach", "T3 [K]", "dots", [0.1, 0.2], [1.0, -1.0], [(0.15, 0.0, 0.5)], [(0.1, 0.0), (0.2, 0.1)]
    )
    text = mismatch_picture("title", ["a note"], heat, beside)
    document = minidom.parseString(text)
    words = [t.firstChild.data for t in document.getElementsByTagName("text")]
    assert {"66.7", "9.0", "hpc.efficiency", "sensor.T3", "a note"} <= set(words)
    assert len(document.getElementsByTagName("circle")) == 3
    assert mismatch_picture("title", ["a note"], heat, beside) == text


def test_a_map_without_anything_to_tell_is_a_picture_too():
    document = minidom.parseString(mismatch_picture("title", [], build_heat_map([], [], 9.0), None))
    assert document.documentElement.tagName == "svg"
