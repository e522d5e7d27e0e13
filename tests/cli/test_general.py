"""What every command does besides its own work: defaults from the environment, what holds and why, files, manual."""

from __future__ import annotations

import json
import os
import subprocess
from shutil import which

import pytest
import yaml

from enginediag_cli.cli.main import COMMANDS
from enginediag_cli.shipped import shipped

SECRET = "SECRET_TOKEN=hunter2"


def simulated(run, *arguments: str) -> str:
    return run("simulate", "turbofan.yaml", "--records", "2", "--no-header", *arguments).stdout


def test_the_environment_gives_defaults_and_the_command_line_goes_before(run, monkeypatch):
    plain, seeded = simulated(run), simulated(run, "--seed", "7")
    assert plain != seeded
    monkeypatch.setenv("ENGINEDIAG_SIMULATE_SEED", "7")
    assert simulated(run) == seeded
    assert simulated(run, "--seed", "0") == plain
    monkeypatch.setenv("ENGINEDIAG_SIMULATE_SEED", "many")
    assert run("simulate", "turbofan.yaml").exit_code == 2


def test_the_variable_is_called_as_the_option(run, monkeypatch):
    monkeypatch.setenv("ENGINEDIAG_DETECT_FALSE_ALARM", "0.2")
    monkeypatch.setenv("ENGINEDIAG_DETECT_MONITOR", "hpc.* sensor.T3.bias")
    told = run("detect", "--print-config", "--power", "0.8").stdout
    assert yaml.safe_load(told)["detect"]["monitor"] == ["hpc.*", "sensor.T3.bias"]
    lines = [line.strip() for line in told.splitlines()]
    assert "false-alarm: 0.2  # environment, ENGINEDIAG_DETECT_FALSE_ALARM" in lines
    assert "power: 0.8  # command line" in lines
    assert "linearise: estimate  # default" in lines
    assert "# nominal:  # not given" in lines


@pytest.mark.parametrize("name", list(COMMANDS))
def test_every_command_says_its_configuration_and_does_nothing_else(run, name, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    ended = run(name, "--print-config")
    assert ended.exit_code == 0
    assert list(yaml.safe_load(ended.stdout)) == ["kind", name]
    assert list(tmp_path.iterdir()) == []


def test_a_wrong_value_is_no_configuration(run):
    assert run("detect", "--print-config", "--false-alarm", "2").exit_code == 2


def test_the_help_tells_of_environment_and_completion(run):
    told = run("--help").stdout
    assert "ENGINEDIAG_DETECT_FALSE_ALARM" in told
    assert "_ENGINEDIAG_COMPLETE=bash_source" in told


@pytest.mark.parametrize(
    ("words", "offered"),
    [
        ("enginediag schema eng", "engine"),
        ("enginediag physics humi", "humidity"),
        ("enginediag explain --without humi", "humidity"),
        ("enginediag man det", "detect"),
    ],
)
def test_completion_knows_kinds_terms_and_commands(shell, words, offered):
    count = str(len(words.split()) - 1)
    environment = {**os.environ, "_ENGINEDIAG_COMPLETE": "bash_complete", "COMP_WORDS": words, "COMP_CWORD": count}
    assert f"plain,{offered}" in shell(env=environment).stdout.splitlines()


def test_verbose_says_what_is_read_and_written_and_how_long_it_took(run, tmp_path):
    out = tmp_path / "out.csv"
    told = run("simulate", "turbofan.yaml", "--records", "2", "-o", out, "-v").stderr
    assert f"read: {shipped('turbofan.yaml')}" in told
    assert f"written: {out}" in told
    assert "records simulated: " in told
    assert "in all " in told


@pytest.mark.parametrize("name", [None, *COMMANDS])
def test_the_manual_page_has_the_sections_and_all_options(run, name):
    ended = run("man", *([name] if name else []))
    assert ended.exit_code == 0
    lines = ended.stdout.splitlines()
    assert lines[0].startswith('.TH "ENGINEDIAG')
    for section in (".SH NAME", ".SH SYNOPSIS", ".SH DESCRIPTION", ".SH OPTIONS"):
        assert section in lines
    assert all(not line.startswith((".", "'")) or line.split()[0] in MACROS for line in lines)
    if name is None:
        assert [line for line in lines if line.startswith(".BR enginediag\\-")] == [
            f".BR enginediag\\-{command} (1)" for command in COMMANDS
        ]
    else:
        assert any("\\-\\-print\\-config" in line for line in lines)


MACROS = (".TH", ".SH", ".PP", ".TP", ".B", ".BR", ".br", ".nf", ".fi")


@pytest.mark.skipif(which("man") is None, reason="no man here")
def test_man_shows_the_page_without_a_warning(run, tmp_path):
    page = tmp_path / "page.1"
    page.write_text(run("man", "detect").stdout, encoding="utf-8")
    done = subprocess.run(["man", "--warnings", "-l", str(page)], capture_output=True, text=True)
    assert done.returncode == 0
    assert "--false-alarm" in done.stdout


def test_ndjson_is_one_object_a_line_by_option_and_by_name(run, tmp_path):
    lines = simulated(run, "-f", "ndjson").splitlines()
    assert [json.loads(line)["flight"] for line in lines] == [1, 1]
    for name in ("a.ndjson", "b.jsonl"):
        simulated(run, "-o", str(tmp_path / name))
        assert (tmp_path / name).read_text().splitlines() == lines


def test_chosen_columns_hold_for_every_format(run):
    assert simulated(run, "--columns", "mach,flight", "-f", "csv").splitlines()[0] == "mach,flight"
    assert list(json.loads(simulated(run, "--columns", "mach", "-f", "json"))[0]) == ["mach"]
    ended = run("simulate", "turbofan.yaml", "--records", "2", "--columns", "mch")
    assert ended.exit_code == 2
    assert "no column 'mch' (did you mean 'mach'?)" in ended.stderr
    rows = json.loads(run("physics", "humidity", "--format", "json", "--columns", "coefficient,unit").stdout)
    assert all(list(row) == ["coefficient", "unit"] for row in rows)


def test_files_outside_are_allowed_for_one_run_only_and_never_quoted(run, tmp_path):
    (tmp_path / "secret").write_text(f"{SECRET}\n")
    (tmp_path / "inside").mkdir()
    path = tmp_path / "inside" / "engine.yaml"
    text = shipped("turbojet.yaml").read_text(encoding="utf-8")
    table = "  - type: compressor\n    table: {file: ../secret, interpolation: linear}\n"
    path.write_text(text.replace("  - type: compressor\n", table, 1), encoding="utf-8")
    for command in ("simulate", "check"):
        assert "outside the folder" in run(command, path).stderr
        ended = run(command, path, "--allow-outside")
        assert ended.exit_code == 2
        assert "map columns missing" in ended.stderr
        assert SECRET not in ended.stderr
        assert "outside the folder" in run(command, path).stderr


def test_a_recordings_control_characters_and_formulas_are_harmless(run, tmp_path):
    recording = tmp_path / "in.csv"
    recording.write_text("flight,altitude_m,mach,dT_isa_K,Wf_kg_s\n=cmd|' /C calc'!A0,0,0,0,0.8\n\x1b[31mred,0,0,0,x\n")
    ended = run("check", recording)
    assert "\x1b" not in ended.stderr + ended.stdout
    text = recording.read_text().replace(",x\n", ",0.8\n")
    recording.write_text(text)
    first = simulated(run, "--conditions", str(recording))
    assert "\n'=cmd" in first.replace('"', "")
    again = tmp_path / "again.csv"
    again.write_text(first)
    assert simulated(run, "--conditions", str(again)) == first


def test_a_spreadsheets_apostrophe_does_not_touch_numbers(run):
    lines = simulated(run, "-f", "csv").splitlines()
    assert not any("'" in line for line in lines)


def test_check_gives_a_row_for_each_good_file_and_each_problem(run, tmp_path):
    bad = tmp_path / "bad.yaml"
    bad.write_text("kind: flight\nmision: {}\n")
    ended = run("check", shipped("turbofan.yaml"), bad, "--format", "ndjson")
    assert ended.exit_code == 2
    rows = [json.loads(line) for line in ended.stdout.splitlines()]
    assert rows[0]["ok"] is True
    assert rows[0]["found"] == "a file of kind engine"
    assert any(row["line"] == 2 and "unknown key 'mision'" in row["problem"] for row in rows[1:])
    assert run("check", shipped("turbofan.yaml"), "--format", "csv").exit_code == 0
