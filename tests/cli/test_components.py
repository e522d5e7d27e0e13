"""`components`: the list of component types, and one of them in full, made from the declarations."""

from __future__ import annotations

import csv
import json

import pytest

from enginediag_cli.engine.components import COMPONENTS
from enginediag_cli.engine.overview import ENGINES, component_example
from enginediag_cli.physics.engine_file import load_engine


def rows_of(text):
    return list(csv.DictReader(line for line in text.splitlines() if not line.startswith("#")))


def test_the_list_holds_every_type_with_what_it_is(run):
    ended = run("components")
    assert ended.exit_code == 0 and ended.stderr == ""
    rows = rows_of(ended.stdout)
    assert [row["component"] for row in rows] == list(COMPONENTS)
    assert all(row["title"] and row["description"] for row in rows)


def test_the_list_for_people_has_one_line_for_each_type_in_80_columns(run):
    lines = run("components", "--format", "table").stdout.splitlines()
    assert len(lines) == 1 + len(COMPONENTS)
    assert max(map(len, lines)) <= 80


@pytest.mark.parametrize("name", COMPONENTS)
def test_a_type_is_shown_in_full(run, name):
    ended = run("components", name, "--format", "table")
    assert ended.exit_code == 0 and ended.stderr == ""
    words = " ".join(ended.stdout.split())
    for field in COMPONENTS[name].SECTION.fields:
        assert " ".join(field.help.split()) in words
    found = component_example(name)
    for text in (*found.balances, *found.outputs, *(p.name for p in found.component.parameters())):
        assert text in words
    assert found.text in ended.stdout
    assert max(map(len, ended.stdout.splitlines())) <= 120


@pytest.mark.parametrize(
    "text", ENGINES, ids=["mixed flow", "single shaft", "afterburning", "recuperated", "turboprop"]
)
def test_the_examples_are_engines_that_pass(tmp_path, text):
    path = tmp_path / "engine.yaml"
    path.write_text(text, encoding="utf-8")
    assert load_engine(path).sensors


def test_csv_has_a_row_for_each_key_with_its_bounds(run):
    rows = {row["key"]: row for row in rows_of(run("components", "compressor").stdout)}
    assert rows["pressure_ratio"]["required"] == "true"
    assert (rows["pressure_ratio"]["minimum"], rows["pressure_ratio"]["maximum"]) == ("1.001", "60.0")
    assert rows["map.work_slope"]["default"] == "1.2"
    assert rows["table.flow_kg_s"]["unit"] == "kg/s"


def test_json_holds_keys_parameters_and_the_example(run):
    found = json.loads(run("components", "nozzle", "--format", "json").stdout)
    assert found["balances"] == ["nozzle flow"]
    assert [p["parameter"] for p in found["parameters"]] == ["nozzle.area", "nozzle.velocity_coefficient"]
    assert "type: nozzle" in found["example"]


def test_a_misspelt_type_is_met_with_the_nearest_one(run):
    ended = run("components", "trubine")
    assert ended.exit_code == 2
    assert "no component 'trubine'; did you mean 'turbine'?" in ended.stderr
