"""enginediag.yaml: options that a folder gives, after command line and environment, before what is built in."""

from __future__ import annotations

import json
import os
from pathlib import Path

import pytest
import yaml

from enginediag_cli.cli.main import COMMANDS
from enginediag_cli.config.validate import check_file
from enginediag_cli.errors import ConfigError
from enginediag_cli.shipped import shipped

ENGINE = "turbofan.yaml"


@pytest.fixture
def folder(tmp_path, monkeypatch) -> Path:
    monkeypatch.chdir(tmp_path)
    return tmp_path


def defaults(text: str, name: str = "enginediag.yaml") -> Path:
    path = Path(name)
    path.parent.mkdir(exist_ok=True)
    path.write_text("kind: defaults\n" + text)
    return path


def test_the_command_line_goes_before_the_environment_that_before_the_file_and_it_before_what_is_built_in(
    run, folder, monkeypatch
):
    def seed(*arguments: str) -> str:
        told = run("simulate", ENGINE, "--print-config", *arguments).stdout
        return next(line.strip() for line in told.splitlines() if "seed:" in line)

    assert seed() == "seed: 0  # default"
    defaults("all: {seed: 3}\n")
    assert seed() == "seed: 3  # enginediag.yaml:2:13"
    defaults("all: {seed: 3}\nsimulate:\n  seed: 4\n")
    assert seed() == "seed: 4  # enginediag.yaml:4:9"
    assert seed("--config", "") == "seed: 0  # default"
    monkeypatch.setenv("ENGINEDIAG_SIMULATE_SEED", "5")
    assert seed() == "seed: 5  # environment, ENGINEDIAG_SIMULATE_SEED"
    assert seed("--seed", "6") == "seed: 6  # command line"


def test_the_result_is_that_of_the_options_typed_and_its_head_tells_them(run, folder):
    typed = run("simulate", ENGINE, "--records", "3", "--seed", "5", "-o", "typed.csv")
    defaults("simulate: {records: 3, seed: 5, quiet: true}\n")
    given = run("simulate", ENGINE, "-o", "given.csv")
    assert typed.exit_code == given.exit_code == 0
    assert given.stderr == ""
    heads, bodies = [], []
    for name in ("typed.csv", "given.csv"):
        lines = Path(name).read_text().splitlines()
        heads.append([line for line in lines if line.startswith("#")])
        bodies.append([line for line in lines if not line.startswith("#")])
    assert bodies[0] == bodies[1]
    assert [line for line in heads[1] if line not in heads[0]] == [
        "# option records: 3 (enginediag.yaml)",
        "# option seed: 5 (enginediag.yaml)",
    ]


def test_what_a_file_gives_is_told_on_standard_error(run, folder):
    defaults("simulate: {records: 3, no-header: true}\n")
    told = run("simulate", ENGINE).stderr
    assert "options not of the command line: records 3 (enginediag.yaml)\n" in told


def test_paths_are_those_beside_the_file_and_shipped_files_are_found_by_name(run, folder):
    Path("data").mkdir()
    Path("data/mine.yaml").write_bytes(Path(shipped("flights/airliner.yaml")).read_bytes())
    defaults("simulate: {flight: mine.yaml, fault: [faults/hpc_fouling.yaml], output: out.csv}\n", "data/station.yaml")
    told = run("simulate", ENGINE, "--config", "data/station.yaml", "--print-config").stdout
    options = yaml.safe_load(told)["simulate"]
    assert options["flight"] == os.path.join("data", "mine.yaml")
    assert options["fault"] == [str(shipped("faults/hpc_fouling.yaml"))]
    assert options["output"] == os.path.join("data", "out.csv")
    ended = run("simulate", ENGINE, "--config", "data/station.yaml", "--records", "2")
    assert ended.exit_code == 0
    assert Path("data/out.csv").exists()


def test_the_environment_names_the_file_and_a_log_may_stand_in_it(run, folder, monkeypatch):
    defaults("all: {log: runs.jsonl}\n", "elsewhere/station.yaml")
    monkeypatch.setenv("ENGINEDIAG_CONFIG", "elsewhere/station.yaml")
    assert run("schema", "flight").exit_code == 0
    lines = [json.loads(line) for line in Path("elsewhere/runs.jsonl").read_text().splitlines()]
    assert [line["event"] for line in lines] == ["begin", "end"]


@pytest.mark.parametrize(
    ("text", "place", "said"),
    [
        ("detct: {window: 60}\n", "2:1", "unknown key 'detct' (did you mean 'detect'?)"),
        ("simulate: {recods: 3}\n", "2:12", "unknown key 'recods' in simulate (did you mean 'records'?)"),
        ("all: {false_alarm: 0.1}\n", "2:7", "unknown key 'false_alarm' in all (did you mean 'false-alarm'?)"),
        ("simulate: {records: 0}\n", "2:21", "simulate.records must be at least 1, not 0"),
        ("simulate: {records: many}\n", "2:21", "simulate.records must be a number"),
        ("simulate: {flight: none.yaml}\n", "2:20", "flight: there is no file"),
        ("simulate: {columns: ','}\n", "2:21", "columns: name at least one column"),
        ("simulate: {steady: yes}\n", "2:20", "simulate.steady must be true or false"),
        ("simulate: {output: ../x.csv}\n", "2:20", "simulate.output is not allowed in a file that nobody named"),
        ("simulate: {allow-outside: true}\n", "2:27", "is not allowed in a file that nobody named"),
        ("simulate: {config: x}\n", "2:12", "unknown key 'config'"),
    ],
)
def test_what_is_wrong_is_told_with_its_place_and_how_to_mend_it(run, folder, text, place, said):
    path = defaults(text)
    ended = run("simulate", ENGINE, "--records", "1") if "records" not in text else run("simulate", ENGINE)
    assert ended.exit_code == 2
    assert f"enginediag.yaml:{place}: error: " in ended.stderr
    assert said in ended.stderr
    assert os.listdir(folder) == [path.name]


def test_an_open_bound_is_kept_at_its_place_and_what_the_command_line_overrides_is_not_asked_for(run, folder):
    defaults("detect:\n  false-alarm: 1\n  nominal: gone.yaml\n")
    told = run("detect", "x.csv").stderr
    assert "enginediag.yaml:3:16: error: false-alarm: 1.0 is not in the range 0<x<1" in told
    assert "enginediag.yaml:4:12: error: nominal: " in told
    assert run("detect", "--print-config", "--false-alarm", "0.1", "-n", str(shipped(ENGINE))).exit_code == 0


def test_check_looks_at_every_command_and_knows_the_kind(run, folder):
    defaults("all: {window: 60, noise: specified}\nprove: {trials: 7}\n")
    with pytest.raises(ConfigError, match="noise: 'specified' is not one of"):  # simulate has other kinds of noise
        check_file("enginediag.yaml")
    defaults("all: {window: 60, recorder: gone.yaml}\n")
    with pytest.raises(ConfigError, match=r"enginediag.yaml:2:29: error: recorder: there is no file") as caught:
        check_file("enginediag.yaml")
    assert len(caught.value.problems) == 1
    defaults("all: {window: 60}\nisolate: {extra-sensor: [T45_K 5, P25_Pa 200]}\nprove: {kind: [null]}\n")
    assert "prove.kind[0] must be a text" in run("check", "enginediag.yaml").stderr
    defaults("all: {window: 60}\nisolate: {extra-sensor: [T45_K 5, P25_Pa 200]}\nprove: {kind: ['null']}\n")
    assert run("check", "enginediag.yaml").stdout == "enginediag.yaml: ok, a file of kind defaults\n"


def test_options_for_recordings_do_not_keep_a_folders_yaml_files_from_being_checked(run, folder):
    Path("mine.yaml").write_bytes(Path(shipped(ENGINE)).read_bytes())
    defaults("all: {engine-instance: left, engine: mine.yaml}\n")
    assert run("check", "enginediag.yaml", "mine.yaml").exit_code == 0
    assert run("check", "mine.yaml", "--engine", "mine.yaml").exit_code == 2


def test_the_file_is_an_input_and_no_output(run, folder):
    path = defaults("simulate: {records: 2}\n")
    ended = run("simulate", ENGINE, "-o", path, "-f", "csv")
    assert ended.exit_code == 2
    assert "is also an input (options)" in ended.stderr
    assert path.read_text().startswith("kind: defaults")


def test_a_file_of_another_kind_under_this_name_is_told(run, folder):
    Path("enginediag.yaml").write_text("kind: flight\n")
    ended = run("simulate", ENGINE)
    assert ended.exit_code == 2
    assert "this is a file of kind 'flight', and one of kind 'defaults' is wanted here" in ended.stderr
    assert run("simulate", "--help").exit_code == 0


@pytest.mark.parametrize("name", list(COMMANDS))
def test_what_print_config_prints_is_such_a_file_and_gives_the_same(run, folder, name):
    arguments = {"isolate": ["--extra-sensor", "T45_K", "5", "--no-sensors", "--window", "60"], "prove": ["--no-sizes"]}
    first = run(name, "--print-config", *arguments.get(name, [])).stdout
    Path("enginediag.yaml").write_text(first)
    assert check_file("enginediag.yaml").name == "defaults"
    again = run(name, "--print-config").stdout
    assert yaml.safe_load(again) == yaml.safe_load(first)
    assert "# default" not in again
    chosen = ["extra-sensor T45_K 5.0", "sensors False", "window 60"] if name == "isolate" else []
    told = run(name, "--records" if name == "simulate" else "x.csv").stderr
    assert all(word in told for word in chosen if "options not" in told)


def test_the_schema_knows_the_options_of_every_command(run):
    schema = json.loads(run("schema", "defaults").stdout)
    options = schema["properties"]["detect"]["anyOf"][0]["properties"]
    assert options["false-alarm"]["anyOf"][0] == {"type": "number", "minimum": 0, "maximum": 1}
    assert set(COMMANDS) | {"kind", "all"} == set(schema["properties"])
