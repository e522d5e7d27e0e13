"""The engine file that carries an effect: text and comments of the old one, entries added, paths that still lead."""

from __future__ import annotations

from dataclasses import replace

import pytest
from refine_flights import ENGINE, engine, library

from enginediag_cli.errors import DataError
from enginediag_cli.mismatch.refine.file import refined_text, write_refined
from enginediag_cli.physics.engine_file import load_engine

ERRORS = {"reynolds_efficiency.hpc.exponent": 0.00312345}


def thin_air():
    return [replace(library("reynolds_efficiency@hpc")[0], values={"exponent": 0.1})]


def test_the_text_of_the_file_stays_as_it_is_and_the_effect_follows(tmp_path):
    old = ENGINE.read_text(encoding="utf-8")
    text = refined_text(str(ENGINE), thin_air(), ERRORS, "fitted: to flights # 1 to 5", str(tmp_path / "new.yaml"))
    assert text.startswith(old)
    write_refined(text, str(tmp_path / "new.yaml"), engine().replace_effects(thin_air()))
    found = load_engine(tmp_path / "new.yaml")
    assert found.parameters["reynolds_efficiency.hpc.exponent"].nominal == 0.1
    (block,) = found.declared["physics"]
    assert block["standard_errors"] == {"exponent": 0.00312} and block["source"] == "fitted: to flights # 1 to 5"


def test_a_block_that_is_there_is_added_to_with_its_comments_and_what_follows_it(tmp_path):
    body = ENGINE.read_text(encoding="utf-8")
    head, envelope, tail = body.partition("envelope:")
    block = (
        "physics:  # carried\n  # by judgement\n  - {term: humidity, at: ambient, coefficients: {}}\n\n"
        "# largest ranges\n"
    )
    (tmp_path / "old.yaml").write_text(head + block + envelope + tail, encoding="utf-8")
    effects = load_engine(tmp_path / "old.yaml").effects
    text = refined_text(str(tmp_path / "old.yaml"), thin_air(), ERRORS, "here", str(tmp_path / "new.yaml"))
    assert "# by judgement" in text and text.index("reynolds_efficiency") < text.index("# largest ranges")
    write_refined(text, str(tmp_path / "new.yaml"), engine().replace_effects([*effects, *thin_air()]))
    found = load_engine(tmp_path / "new.yaml").effects
    assert [e.label for e in found] == ["humidity@ambient", "reynolds_efficiency@hpc"]


def test_an_empty_block_is_filled(tmp_path):
    (tmp_path / "old.yaml").write_text(ENGINE.read_text(encoding="utf-8") + "physics: []\n", encoding="utf-8")
    text = refined_text(str(tmp_path / "old.yaml"), thin_air(), ERRORS, "here", str(tmp_path / "new.yaml"))
    assert text.count("physics:") == 1


def test_a_map_table_is_found_from_the_new_folder(tmp_path):
    text = ENGINE.read_text(encoding="utf-8").replace(
        "    map: {work_slope: 1.6", "    table: {file: maps/booster.csv}\n    map: {work_slope: 1.6"
    )
    (tmp_path / "a").mkdir()
    (tmp_path / "b").mkdir()
    (tmp_path / "a" / "old.yaml").write_text(text, encoding="utf-8")
    place = str(tmp_path / "b" / "new.yaml")
    moved = refined_text(str(tmp_path / "a" / "old.yaml"), thin_air(), ERRORS, "here", place)
    assert "table: {file: ../a/maps/booster.csv}" in moved


def test_nothing_is_written_when_the_text_gives_another_engine(tmp_path):
    text = ENGINE.read_text(encoding="utf-8")
    with pytest.raises(DataError, match="not written"):
        write_refined(text, str(tmp_path / "new.yaml"), engine().replace_effects(thin_air()))
    assert list(tmp_path.iterdir()) == []
