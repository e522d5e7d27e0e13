"""Drawings as files: SVG as it is, PNG the same bytes each time; without its package what to install."""

from __future__ import annotations

import sys
from pathlib import Path

import pytest

from enginediag_cli.__main__ import main
from enginediag_cli.errors import DataError
from enginediag_cli.report.plotting import svg
from enginediag_cli.report.plotting.svg import Drawing, png, write_drawing

SAMPLES = Path(__file__).parents[2] / "sample_data"


@pytest.mark.parametrize("name", ["locate", "law", "refine"])
def test_pictures_of_the_search_for_missing_physics_are_png_where_the_name_says_so(name, tmp_path):
    pytest.importorskip("resvg_py", reason="no resvg-py here: pip install 'enginediag[report]'")
    drawing = (SAMPLES / f"{name}.svg").read_text(encoding="utf-8")
    for path in (tmp_path / "one.png", tmp_path / "two.PNG", tmp_path / "three.svg"):
        write_drawing(drawing, str(path))
    one, two = (tmp_path / "one.png").read_bytes(), (tmp_path / "two.PNG").read_bytes()
    assert one == two and one.startswith(b"\x89PNG")
    assert (tmp_path / "three.svg").read_text(encoding="utf-8") == drawing


def test_letters_are_drawn_by_a_font_of_the_machine():
    pytest.importorskip("resvg_py", reason="no resvg-py here: pip install 'enginediag[report]'")
    on = Drawing(300, 40, "words")
    empty = png(on.text(), "x.png")
    on.words(10, 20, "χ² of the fit")
    assert png(on.text(), "x.png") != empty


def test_a_machine_without_fonts_says_so_instead_of_drawing_no_words(monkeypatch):
    pytest.importorskip("resvg_py", reason="no resvg-py here: pip install 'enginediag[report]'")
    monkeypatch.setattr(svg, "FAMILIES", ())  # another font stands in for one that is not there
    with pytest.raises(DataError, match=r"x\.png: no font for a PNG"):
        png(Drawing(300, 40, "words").text(), "x.png")


@pytest.mark.parametrize("command", ["locate", "explain", "refine", "detect", "trend"])
def test_without_its_package_a_png_is_refused_before_the_work(command, tmp_path, monkeypatch, capsys):
    monkeypatch.setitem(sys.modules, "resvg_py", None)
    engine = ["turbojet.yaml"] if command in ("locate", "explain", "refine") else ["-n", str(SAMPLES / "README.md")]
    out = ["-o", str(tmp_path / "x.yaml" if command == "refine" else tmp_path / "x.csv")]
    flown = str(SAMPLES / "one_flight.csv")
    assert main([command, *engine, flown, "--picture", str(tmp_path / "x.png"), *out]) == 2
    told = capsys.readouterr().err
    assert (
        "PNG needs the package resvg-py: pip install 'enginediag[report]'; or name a .svg" in told
        and "Traceback" not in told
    )


def test_a_packed_png_is_refused(tmp_path, capsys):
    flown = str(SAMPLES / "one_flight.csv")
    assert main(["locate", "turbojet.yaml", flown, "--picture", str(tmp_path / "x.png.gz")]) == 2
    assert "compressed already; leave out .gz" in capsys.readouterr().err
