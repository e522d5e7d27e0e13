"""Drawings as files: SVG as it is, PNG by Pillow, the same bytes each time; without Pillow what to install."""

from __future__ import annotations

import sys
from pathlib import Path

import pytest

from enginediag_cli.__main__ import main
from enginediag_cli.report.pictures.svg import Drawing, write_drawing

SAMPLES = Path(__file__).parents[2] / "sample_data"


@pytest.mark.parametrize("name", ["locate", "law", "refine"])
def test_pictures_of_the_search_for_missing_physics_are_png_where_the_name_says_so(name, tmp_path):
    pytest.importorskip("PIL", reason="no Pillow here: pip install 'enginediag[report]'")
    drawing = (SAMPLES / f"{name}.svg").read_text(encoding="utf-8")
    for path in (tmp_path / "one.png", tmp_path / "two.PNG", tmp_path / "three.svg"):
        write_drawing(drawing, str(path))
    one, two = (tmp_path / "one.png").read_bytes(), (tmp_path / "two.PNG").read_bytes()
    assert one == two and one.startswith(b"\x89PNG")
    assert (tmp_path / "three.svg").read_text(encoding="utf-8") == drawing


def test_a_line_that_is_too_long_for_a_png_is_drawn_smaller(tmp_path):
    image = pytest.importorskip("PIL.Image", reason="no Pillow here: pip install 'enginediag[report]'")
    on = Drawing(300, 40, "long")
    on.words(10, 20, "a title of far more letters than three hundred pixels have room for")
    write_drawing(on.text(), str(tmp_path / "long.png"))
    found = image.open(tmp_path / "long.png").convert("L")
    edge = found.crop((found.width - 8, 0, found.width, found.height))
    assert found.getextrema()[0] < 100 and edge.getextrema()[0] == 255  # ink, and none at the edge


@pytest.mark.parametrize("command", ["locate", "explain", "refine", "detect", "trend"])
def test_without_pillow_a_png_is_refused_before_the_work_with_what_to_install(command, tmp_path, monkeypatch, capsys):
    monkeypatch.setitem(sys.modules, "PIL", None)
    engine = ["turbojet.yaml"] if command in ("locate", "explain", "refine") else ["-n", str(SAMPLES / "README.md")]
    out = ["-o", str(tmp_path / "x.yaml" if command == "refine" else tmp_path / "x.csv")]
    flown = str(SAMPLES / "one_flight.csv")
    assert main([command, *engine, flown, "--picture", str(tmp_path / "x.png"), *out]) == 2
    told = capsys.readouterr().err
    assert "PNG needs Pillow: pip install 'enginediag[report]'; or name a .svg" in told and "Traceback" not in told


def test_a_packed_png_is_refused(tmp_path, capsys):
    flown = str(SAMPLES / "one_flight.csv")
    assert main(["locate", "turbojet.yaml", flown, "--picture", str(tmp_path / "x.png.gz")]) == 2
    assert "packed inside; leave out .gz" in capsys.readouterr().err
