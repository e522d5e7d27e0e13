"""`physics`: the list of effects, one of them in full, and what an engine carries."""

from __future__ import annotations

import csv
import json
from functools import cache
from pathlib import Path

import pytest

from enginediag_cli.physics import engine_file
from enginediag_cli.physics.engine_file import load_engine
from enginediag_cli.physics.registry import term, term_names

CONFIGS = Path(__file__).parents[2] / "configs"
CARRIED = """
physics:
  - term: reynolds_efficiency
    at: hpc
    coefficients: {exponent: 0.12}
    standard_errors: {exponent: 0.01}
    source: refined on five flights
"""


@pytest.fixture
def carrying(tmp_path):
    """The shipped turbofan with an effect in its model."""
    path = tmp_path / "carrying.yaml"
    path.write_text((CONFIGS / "turbofan.yaml").read_text(encoding="utf-8") + CARRIED, encoding="utf-8")
    return path


def rows_of(text):
    return list(csv.DictReader(line for line in text.splitlines() if not line.startswith("#")))


def test_the_list_holds_every_term_with_what_it_varies_with(run):
    ended = run("physics")
    assert ended.exit_code == 0 and ended.stderr == ""
    rows = rows_of(ended.stdout)
    assert [row["term"] for row in rows] == list(term_names())
    assert len(rows) >= 24
    humid = next(row for row in rows if row["term"] == "inlet_ram_recovery")
    assert humid["varies_with"] == "flight Mach number"
    assert humid["statement"] == term("inlet_ram_recovery").STATEMENT


def test_the_list_for_people_has_one_line_for_each_term(run):
    lines = run("physics", "--format", "table").stdout.splitlines()
    assert len(lines) == 1 + len(term_names())
    assert max(map(len, lines)) <= 140


load_once = cache(load_engine)


@pytest.mark.parametrize("name", term_names())
def test_a_term_is_shown_in_full(run, name, monkeypatch):
    monkeypatch.setattr(engine_file, "load_engine", load_once)
    ended = run("physics", name, "--format", "table")
    assert ended.exit_code == 0 and ended.stderr == ""
    shown = " ".join(ended.stdout.split())
    found = term(name)
    for words in (found.NAME, found.TITLE, found.STATEMENT, found.EQUATION, found.REFERENCE):
        assert " ".join(words.split()) in shown
    for c in found.COEFFICIENTS:
        assert f"{c.name} [{c.unit}]: {c.description}" in shown
        assert f"within {c.lower:g} to {c.upper:g}" in shown
    assert shown.count("range assumed") == sum(not c.cited for c in found.COEFFICIENTS)
    assert "  turbofan: " in ended.stdout and "  power_plant: " in ended.stdout
    assert max(map(len, ended.stdout.splitlines())) <= 105


def test_a_terms_coefficients_are_rows_of_a_csv(run):
    [row] = rows_of(run("physics", "reynolds_efficiency").stdout)
    assert (row["coefficient"], row["absent"], row["lower"], row["upper"]) == ("exponent", "0.0", "0.0", "0.3")
    assert (row["sought"], row["assumed"]) == ("true", "false")


def test_json_holds_the_words_the_coefficients_and_the_places(run):
    found = json.loads(run("physics", "thermocouple_radiation", "--format", "json").stdout)
    assert found["term"] == "thermocouple_radiation"
    assert [c["coefficient"] for c in found["coefficients"]] == ["error_K"]
    assert [s["at"] for s in found["places"]["turbofan"]] == ["T45", "T5"]
    assert found["places"]["turbofan"][0]["acts_on"] == ["reading T45_K"]


def test_a_misspelt_term_gets_a_near_match(run):
    ended = run("physics", "reynold_efficiency")
    assert ended.exit_code == 2
    assert ended.stdout == ""
    assert "no physics term 'reynold_efficiency'; did you mean 'reynolds_efficiency'?" in ended.stderr


def test_an_engine_lists_every_place_where_an_effect_can_act(run):
    rows = rows_of(run("physics", "--engine", "power_plant.yaml").stdout)
    places = {(row["term"], row["at"]) for row in rows}
    assert {("computed_reading", "T4"), ("exhaust_back_pressure", "exhaust")} <= places
    assert "inlet_ram_recovery" not in {row["term"] for row in rows}  # it does not fly
    assert {row["carried"] for row in rows} == {"false"}


def test_an_engine_says_which_effects_it_carries(run, carrying):
    ended = run("physics", "--engine", carrying)
    assert ended.exit_code == 0
    assert ended.stdout.splitlines()[2].startswith("# config: carrying.yaml sha256:")
    carried = [row for row in rows_of(ended.stdout) if row["carried"] == "true"]
    assert [(row["term"], row["at"], row["coefficients"]) for row in carried] == [
        ("reynolds_efficiency", "hpc", "exponent=0.12")
    ]
    assert carried[0]["source"] == "refined on five flights"


def test_a_term_on_an_engine_shows_its_size_with_its_error(run, carrying):
    page = run("physics", "reynolds_efficiency", "--engine", carrying, "--format", "table").stdout
    assert "hpc (hpc.efficiency) carried: exponent 0.120 ± 0.010" in " ".join(page.split())
    rows = rows_of(run("physics", "reynolds_efficiency", "--engine", carrying).stdout)
    assert [(row["at"], row["carried"]) for row in rows] == [("fan", "false"), ("booster", "false"), ("hpc", "true")]


def test_a_term_that_an_engine_has_no_place_for_says_so(run):
    ended = run("physics", "inlet_ram_recovery", "--engine", "power_plant.yaml", "--format", "table")
    assert ended.exit_code == 0
    assert "  power_plant: none" in ended.stdout


def test_the_lines_for_an_engine_file_are_lines_of_an_engine_file(run, tmp_path):
    """What the page says to write can be written."""
    page = run("physics", "customer_bleed", "--engine", "turbofan.yaml", "--format", "table").stdout
    block = "".join(f"{line[2:]}\n" for line in page.split("in an engine file\n")[1].splitlines())
    path = tmp_path / "engine.yaml"
    path.write_text((CONFIGS / "turbofan.yaml").read_text(encoding="utf-8") + block, encoding="utf-8")
    assert run("check", path).exit_code == 0
    rows = rows_of(run("physics", "customer_bleed", "--engine", path).stdout)
    assert rows[0]["carried"] == "true"


def test_an_engine_file_with_an_unknown_term_is_trouble(run, tmp_path):
    path = tmp_path / "engine.yaml"
    wrong = CARRIED.replace("reynolds_efficiency", "reynold_efficiency")
    path.write_text((CONFIGS / "turbofan.yaml").read_text(encoding="utf-8") + wrong, encoding="utf-8")
    ended = run("physics", "--engine", path)
    assert ended.exit_code == 2
    assert "did you mean 'reynolds_efficiency'?" in ended.stderr
