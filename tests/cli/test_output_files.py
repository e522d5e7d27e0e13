"""What a command writes: never over its own input, never under a name that promises something else."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest
from click.testing import CliRunner

from enginediag_cli.cli.main import COMMANDS, enginediag
from enginediag_cli.cli.options import FiniteRange, OutputFile
from enginediag_cli.shipped import shipped


@pytest.fixture
def folder(tmp_path, monkeypatch) -> Path:
    """A folder with an engine, a recording, and other names of both."""
    monkeypatch.chdir(tmp_path)
    Path("tf.yaml").write_bytes(shipped("turbofan.yaml").read_bytes())
    Path("in.csv").write_text("flight,time_s,altitude_m\n1,0,0\n")
    Path("nom.yaml").write_text("kind: nominal\n")
    os.symlink("in.csv", "link.csv")
    os.link("in.csv", "hard.csv")
    return tmp_path


@pytest.mark.parametrize(
    "line",
    [
        "simulate tf.yaml -o tf.yaml --format csv",
        "simulate tf.yaml -o ./../{name}/tf.yaml --format csv",
        "simulate tf.yaml --truth in.csv --conditions in.csv",
        "identify tf.yaml in.csv -o tf.yaml",
        "identify tf.yaml in.csv -o in.csv",
        "identify tf.yaml link.csv -o in.csv",
        "detect -n nom.yaml in.csv -o in.csv",
        "detect -n nom.yaml in.csv -o link.csv",
        "detect -n nom.yaml in.csv -o hard.csv",
        "detect -n nom.yaml in.csv -o nom.yaml --format csv",
        "isolate -n nom.yaml in.csv --catalogue . -o tf.yaml --format csv",
        "residual -n nom.yaml in.csv -o in.csv",
        "trend -n nom.yaml in.csv -o in.csv",
        "locate tf.yaml in.csv --picture tf.yaml",
        "check in.csv -o in.csv",
        "explain tf.yaml in.csv --amplitudes in.csv",
        "explain tf.yaml in.csv --curves in.csv",
        "refine tf.yaml in.csv --holdout-last 1 -o tf.yaml",
        "refine tf.yaml in.csv --test hard.csv -o new.yaml --report in.csv",
        "study tf.yaml -o tf.yaml --format csv",
        "study tf.yaml --journal tf.yaml",
        "prove tf.yaml -o tf.yaml --format csv",
        "prove tf.yaml --trials-output tf.yaml",
    ],
)
def test_an_output_that_is_an_input_is_refused_and_the_input_intact(folder, run, line):
    before = {path.name: path.read_bytes() for path in folder.iterdir()}
    ended = run(*line.format(name=folder.name).split())
    assert ended.exit_code == 2
    assert "is also an input" in ended.stderr
    assert {path.name: path.read_bytes() for path in folder.iterdir()} == before


def test_standard_input_that_is_the_output_is_refused(folder):
    with open("in.csv") as stream:
        ended = subprocess.run(
            [sys.executable, "-m", "enginediag_cli", "detect", "-n", "nom.yaml", "-", "-o", "in.csv"],
            stdin=stream,
            capture_output=True,
            text=True,
            env={**os.environ, "PYTHONPATH": str(Path(__file__).parents[2])},
        )
    assert ended.returncode == 2
    assert "is also an input" in ended.stderr


def test_two_outputs_need_two_files(folder, run):
    ended = run("simulate", "tf.yaml", "-o", "out.csv", "--truth", "./out.csv")
    assert ended.exit_code == 2
    assert "is also the file of" in ended.stderr


@pytest.mark.parametrize("name", ["x.html", "x.xlsx", "x.parquet.gz", "x.tsv"])
def test_a_table_under_a_name_that_promises_another_format_is_refused_with_what_is_possible(folder, run, name):
    ended = run("simulate", "tf.yaml", "--records", "2", "-o", name)
    assert ended.exit_code == 2
    assert ".csv, .json, .ndjson" in ended.stderr
    assert not Path(name).exists()
    ended = run("locate", "tf.yaml", "in.csv", "--picture", "map.jpg")
    assert ended.exit_code == 2
    assert "possible are .svg, .png" in ended.stderr


@pytest.mark.parametrize("name", ["x.csv", "x", "x.json", "x.ndjson", "x.jsonl.gz", "x.CSV.gz"])
def test_known_endings_are_written(folder, run, name):
    assert run("simulate", "tf.yaml", "--records", "2", "-o", name).exit_code == 0
    assert Path(name).exists()


WRITTEN = ("output", "picture", "report", "states", "journal", "amplitudes", "curves", "plan", "trials_output")


def test_every_file_option_that_is_written_is_known_as_such():
    """An option that writes must be an `OutputFile`, or nothing keeps it from an input."""
    for name in COMMANDS:
        command = enginediag.get_command(enginediag.make_context("enginediag", [name]), name)
        assert command is not None
        for parameter in command.params:
            if parameter.name in WRITTEN and not getattr(parameter, "is_flag", False):
                assert isinstance(parameter.type, OutputFile), f"{name} {parameter.name}"


NUMBERS = [
    (name, parameter.opts[-1])
    for name in COMMANDS
    for parameter in enginediag.get_command(enginediag.make_context("enginediag", [name]), name).params  # type: ignore[union-attr]
    if isinstance(parameter.type, FiniteRange)
]


@pytest.mark.parametrize("value", ["nan", "inf", "-inf"])
@pytest.mark.parametrize(("command", "option"), NUMBERS)
def test_nan_and_infinity_are_no_numbers_of_any_option(command, option, value):
    ended = CliRunner().invoke(enginediag, [command, option, value])
    assert ended.exit_code == 2


def test_no_option_takes_numbers_without_that_check():
    import click

    for name in COMMANDS:
        command = enginediag.get_command(enginediag.make_context("enginediag", [name]), name)
        assert command is not None
        for parameter in command.params:
            types = parameter.type.types if isinstance(parameter.type, click.Tuple) else [parameter.type]
            for one in types:
                loose = isinstance(one, (click.FloatRange, click.types.FloatParamType))
                assert not loose or isinstance(one, FiniteRange), f"{name} {parameter.name}"


def shell_line(line: str, folder: Path) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        ["bash", "-c", line.replace("enginediag", f"{sys.executable} -m enginediag_cli")],
        capture_output=True,
        text=True,
        cwd=folder,
        timeout=120,
        env={**os.environ, "PYTHONPATH": str(Path(__file__).parents[2])},
    )


@pytest.mark.parametrize(
    "command", ["simulate tf.yaml --records 2", "identify tf.yaml in.csv", "check tf.yaml", "schema", "physics"]
)
def test_a_closed_standard_output_ends_with_2_and_says_so(folder, command):
    ended = shell_line(f"enginediag {command} >&-", folder)
    assert ended.returncode == 2
    assert "standard output is closed" in ended.stderr


def test_a_closed_standard_output_does_not_matter_with_o(folder):
    assert shell_line("enginediag simulate tf.yaml --records 2 -o out.csv >&-", folder).returncode == 0
    assert (folder / "out.csv").read_text().count("\n") > 2


def test_a_closed_standard_error_changes_nothing(folder):
    ended = shell_line("enginediag simulate tf.yaml --records 2 2>&-", folder)
    assert ended.returncode == 0
    assert ended.stdout == shell_line("enginediag simulate tf.yaml --records 2", folder).stdout


def test_a_full_disk_behind_standard_error_or_output_is_no_internal_error(folder):
    assert shell_line("enginediag simulate tf.yaml --records 2 2>/dev/full", folder).returncode == 0
    assert shell_line("enginediag simulate tf.yaml --records 2 >/dev/full", folder).returncode == 2


def test_messages_that_nobody_reads_do_not_stop_the_work(folder):
    """The reader of standard error is gone before the first message; the file is written all the same."""
    line = "{ enginediag simulate tf.yaml --records 2 -o out.csv; echo $? > code; } 2>&1 | true; sleep 3; cat code"
    assert shell_line(line, folder).stdout == "0\n"
    assert (folder / "out.csv").exists()
