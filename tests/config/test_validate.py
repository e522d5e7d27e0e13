from __future__ import annotations

from pathlib import Path

import pytest
from config_declarations import COMPONENT, FILE, GOOD

from enginediag_cli.config.document import parse_document
from enginediag_cli.config.fields import Field, Section, near
from enginediag_cli.config.files import render
from enginediag_cli.config.validate import Checked, validate
from enginediag_cli.errors import ConfigError, Mark


def checked(text: str, section: Section = FILE) -> Checked:
    return validate(parse_document(text, "f.yaml"), section)


def complaints(text: str, section: Section = FILE) -> list[str]:
    with pytest.raises(ConfigError) as raised:
        checked(text, section)
    return [str(problem).removeprefix("f.yaml:") for problem in raised.value.problems]


def one(key: str, text: str) -> list[str]:
    return complaints(f"kind: engine\n{key}: {text}\n")


def test_values_are_plain_and_the_defaults_are_filled_in() -> None:
    assert checked(GOOD).values == {
        "kind": "engine",
        "description": "a test",
        "sources": ["report 1", "report 2"],
        "altitude_m": 1e4,
        "stages": 4,
        "cooled": True,
        "speeds_rpm": [1000.0, 2000.0, 3500.0],
        "envelope_K": [220.0, 320.5],
        "bounds": {"hpc.efficiency": 0.9},
        "columns": {"T3": "EGT"},
        "constants": {"a": 1, "b": "text", "c": True, "d": None},
        "sensors": [{"column": "T3_K", "sigma": 2.0}],
        "shafts": {"lp": {"inertia_kg_m2": None}, "hp": {"inertia_kg_m2": 3.0}},
        "components": [
            {
                "name": "hpc",
                "type": "compressor",
                "pressure_ratio": 12.0,
                "spool": "hp",
                "map": {"beta": 0.5, "table": None},
            },
            {"name": "nozzle", "type": "nozzle", "area_m2": 0.25},
        ],
    }


def test_a_file_with_nothing_but_its_required_keys_gets_every_default() -> None:
    values = checked("kind: engine").values
    assert list(values) == [field.name for field in FILE.fields]
    assert values["envelope_K"] is None
    assert values["components"] == []
    assert isinstance(values["altitude_m"], float)


def test_defaults_are_not_shared_between_files() -> None:
    checked("kind: engine").values["bounds"]["x"] = 1.0
    assert checked("kind: engine").values["bounds"] == {}


def test_a_whole_number_in_float_form_is_an_integer() -> None:
    stages = checked("kind: engine\nstages: 1e1").values["stages"]
    assert stages == 10
    assert isinstance(stages, int)


def test_a_key_whose_default_is_none_may_be_left_empty() -> None:
    assert checked("kind: engine\nenvelope_K:\n").values["envelope_K"] is None


def test_all_problems_of_a_file_are_raised_at_once_in_the_order_of_the_file() -> None:
    assert complaints("""\
kind: engine
altitude_ft: 35000
stages: 2.5
cooled: yes
envelope_K: [320, 220]
kind: engine
speeds_rpm: [1, two, -3]
sensors:
  - colum: T3_K
    sigma: -1
components:
  - name: hpc
    type: compresor
  - name: fan
    type: compressor
    pressure_ratio: 0.3
    spool: 2
    table: x.csv
  - name: fan
    type: nozzle
  - type: nozzle
    area_in2: 14
""") == [
        "2:1: error: unknown key 'altitude_ft' (did you mean 'altitude_m: 10668'? this key wants m)",
        "3:9: error: stages must be a whole number, not 2.5 (a whole number: number of stages)",
        "4:9: error: cooled must be true or false, not the text 'yes' (write true)",
        "5:13: error: envelope_K must rise: 320 is above 220 (write [220, 320])",
        "6:1: error: key 'kind' is given twice (first given at f.yaml:1:1; keep one of them)",
        "7:17: error: speeds_rpm[1] must be a number, not the text 'two' (give a number, in rpm)",
        "7:22: error: speeds_rpm[2] must be at least 0 rpm, not -3 (speed lines)",
        "9:5: error: unknown key 'colum' in sensors[0] (did you mean 'column'?)",
        "10:12: error: sensors[0].sigma must be at least 0, not -1 (standard deviation)",
        "13:11: error: unknown type 'compresor' in components.hpc (did you mean 'compressor'?)",
        "16:21: error: components.fan.pressure_ratio must be at least 1, not 0.3 (design pressure ratio)",
        '17:12: error: components.fan.spool must be a text, not the number 2 (put it in quotes: "2")',
        "18:5: error: unknown key 'table' in components.fan (it belongs under 'map:'; indent it further)",
        "19:5: error: missing key 'area_m2' in components.fan (a number in m²: throat area)",
        "19:11: error: the name 'fan' is used twice in components (first at f.yaml:14:11; names must differ)",
        "21:5: error: missing key 'name' in components[3] "
        "(a text: name by which other parts of the file refer to this one)",
        "22:5: error: unknown key 'area_in2' in components[3] (did you mean 'area_m2'? this key wants m²)",
    ]


@pytest.mark.parametrize(
    ("key", "text", "message"),
    [
        ("altitude_m", "1,5", "must be a number, not the text '1,5' (write a decimal point instead of the comma)"),
        (
            "altitude_m",
            "35000 ft",
            "must be a number, not the text '35000 ft' (write the number alone, in m; the key says the unit)",
        ),
        ("altitude_m", "5 %", "must be a number, not the text '5 %' (write it without '%', in m)"),
        ("altitude_m", "10_000", "must be a number, not the text '10_000' (write the digits without separators)"),
        ("altitude_m", "'1e4'", "must be a number, not the text '1e4' (remove the quotes)"),
        ("altitude_m", "true", "must be a number, not true (a number in m: design altitude)"),
        ("altitude_m", "[1]", "must be a number, not a list of 1 (a number in m: design altitude)"),
        ("altitude_m", ".inf", "must be a finite number, not .inf (a number in m: design altitude)"),
        ("altitude_m", "30e3", "must be between -500 and 20000 m, not 30e3 (design altitude)"),
        ("stages", "0", "must be at least 1, not 0 (number of stages)"),
        ("cooled", "off", "must be true or false, not the text 'off' (write false)"),
        ("cooled", "1", "must be true or false, not the number 1 (write true)"),
        ("description", "14", 'must be a text, not the number 14 (put it in quotes: "14")'),
        ("sources", "a report", "must be a list of texts, not the text 'a report' (write [a report])"),
        ("envelope_K", "[1, 2, 3]", "must be a range of two numbers, not a list of 3 (write [low, high] in K)"),
        ("bounds", "[1]", "must be a mapping of names to numbers, not a list of 1 (bounds by parameter)"),
        ("sensors", "{a: 1}", "must be a list, not a mapping with the keys a (begin each entry with '- ')"),
        ("shafts", "[hp]", "must be a mapping of names, not a list of 1 (shafts by name)"),
    ],
)
def test_a_wrong_value_says_what_was_found_and_how_to_mend_it(key: str, text: str, message: str) -> None:
    assert one(key, text) == [f"2:{len(key) + 3}: error: {key} {message}"]


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("bounds: {a: b}", "2:13: error: bounds.a must be a number, not the text 'b' (give a number)"),
        ("columns: {a: 1}", '2:14: error: columns.a must be a text, not the number 1 (put it in quotes: "1")'),
        ("constants: {a: [1]}", "2:16: error: constants.a must be a single value, not a list of 1 (constants)"),
        ("shafts: {hp: 3}", "2:14: error: shafts.hp must be a mapping of keys, not the number 3 (a shaft)"),
        ("altitude_m:", "2:1: error: altitude_m is empty (a number in m: design altitude)"),
        ("components: [{name: a}]", "2:14: error: missing key 'type' in components.a (one of: compressor, nozzle)"),
        (
            "components: [{name: a, type: [x]}]",
            "2:30: error: type in components.a must be a name, not a list of 1 (one of: compressor, nozzle)",
        ),
        (
            "components: [a]",
            "2:14: error: components[0] must be a mapping of keys, not the text 'a' (a component of the gas path)",
        ),
    ],
)
def test_a_problem_deep_inside_names_its_path(text: str, message: str) -> None:
    assert complaints(f"kind: engine\n{text}\n") == [message]


def test_an_unknown_key_with_no_near_match_gets_the_list_of_valid_keys() -> None:
    section = Section("s", "", (Field("alpha", "number", "", default=1.0), Field("beta", "text", "", "")))
    assert complaints("qqqq: 1", section) == ["1:1: error: unknown key 'qqqq' (one of: alpha, beta)"]


def test_a_file_of_another_kind_is_refused_by_its_kind_key() -> None:
    assert complaints("kind: engin") == ["1:7: error: kind cannot be 'engin' (did you mean 'engine'?)"]
    assert complaints("description: x") == ["1:1: error: missing key 'kind' (write 'kind: engine': what this file is)"]


def test_a_file_that_is_no_mapping_says_what_it_is() -> None:
    assert complaints("- 1\n- 2") == ["1:1: error: the file must be a mapping of keys, not a list of 2 (an engine)"]
    assert complaints("kind:engine") == [
        "1:1: error: the file must be a mapping of keys, not the text 'kind:engine' (a space is missing after ':')"
    ]


def test_a_top_level_may_be_variants() -> None:
    assert validate(parse_document("type: nozzle\narea_m2: 1", "f"), COMPONENT).values == {
        "type": "nozzle",
        "area_m2": 1.0,
    }


def test_marks_lead_back_into_the_file() -> None:
    result = checked(GOOD)
    assert result.file == "f.yaml"
    spool = result.mark(("components", "hpc", "spool"))
    assert spool == result.mark(("components", 0, "spool")) == Mark("f.yaml", 23, 12)
    assert result.key_mark(("components", "hpc", "spool")) == Mark("f.yaml", 23, 5)
    assert result.mark(("components", "hpc", "map", "beta")) == Mark("f.yaml", 20, 5)
    assert result.key_mark(("components", "hpc", "map")) == Mark("f.yaml", 20, 5)
    assert result.mark(("shafts", "hp")) == Mark("f.yaml", 18, 7)
    assert result.mark(("components", 7)) == Mark("f.yaml", 20, 3)
    assert result.mark() == Mark("f.yaml", 1, 1)
    assert result.is_given(("components", "hpc", "spool"))
    assert not result.is_given(("components", "hpc", "map"))


def test_a_semantic_problem_is_written_like_any_other() -> None:
    result = checked(GOOD.replace("spool: hp", "spool: hpp"))
    known = result.values["shafts"]
    problem = result.problem(("components", "hpc", "spool"), "shaft 'hpp' does not exist", near("hpp", known))
    assert str(problem) == "f.yaml:23:12: error: shaft 'hpp' does not exist (did you mean 'hp'?)"


def test_a_problem_is_shown_with_its_line_and_a_caret(tmp_path: Path) -> None:
    file = tmp_path / "x.yaml"
    file.write_text("kind: engine\nshafts:\n  hp: {inertia_kg_m2: 1, spol: 'α β'} # é\n", encoding="utf-8")
    result = parse_document(file.read_text(encoding="utf-8"), str(file))
    with pytest.raises(ConfigError) as raised:
        validate(result, FILE)
    [problem] = raised.value.problems
    assert render(problem) == "\n".join(
        [
            f"{file}:3:26: error: unknown key 'spol' in shafts.hp (the only one is inertia_kg_m2)",
            "    3 |   hp: {inertia_kg_m2: 1, spol: 'α β'} # é",
            "      |                          ^~~~",
        ]
    )
    file.unlink()
    assert render(problem) == str(problem)
