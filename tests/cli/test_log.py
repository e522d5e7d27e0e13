"""`--log`: one run after the other, and at the same time, as JSON lines in one file, however a run ends."""

from __future__ import annotations

import hashlib
import json
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from enginediag_cli import __version__
from enginediag_cli.__main__ import _stop_request
from enginediag_cli.cli.main import COMMANDS

LEVELS = {"note", "warning", "error"}
ENGINE = "turbofan.yaml"


def lines_of(path: Path) -> list[dict]:
    return [json.loads(line) for line in path.read_text(encoding="utf-8").splitlines()]


@pytest.fixture
def log(tmp_path, monkeypatch) -> Path:
    monkeypatch.chdir(tmp_path)
    return tmp_path / "run.jsonl"


def start(*arguments: str, **options) -> subprocess.Popen:
    """The program as a child that can be stopped."""
    pipe = subprocess.PIPE
    environment = {**os.environ, "PYTHONPATH": str(Path(__file__).parents[2])}
    return subprocess.Popen(
        [sys.executable, "-m", "enginediag_cli", *arguments],
        **{"stdin": pipe, "stdout": pipe, "stderr": pipe, "env": environment, "text": True, **options},
    )


def test_a_run_says_when_who_and_what_and_at_last_its_code_time_and_outputs_with_their_hashes(run, log):
    ended = run("simulate", ENGINE, "--records", "2", "-q", "-o", "a.csv", "--truth", "t.csv", "--log", log)
    assert (ended.exit_code, ended.stderr) == (0, "")
    lines = lines_of(log)
    assert [line.get("event") for line in lines] == ["begin", None, "end"]
    assert len({line["run"] for line in lines}) == 1
    for line in lines:
        assert time.strptime(line["time"][:19], "%Y-%m-%dT%H:%M:%S")
        assert line["time"].endswith("Z")
        assert (line["version"], line["command"]) == (__version__, "simulate")
        assert line["level"] in LEVELS
    assert lines[0]["arguments"][:2] == ["simulate", ENGINE]
    assert (lines[1]["message"], lines[1]["counts"]) == ("2 records simulated", {"records": 2})
    end = lines[-1]
    assert end["exit_code"] == 0
    assert 0 <= end["seconds"] < 60
    written = {output["file"]: output["sha256"] for output in end["outputs"]}
    files = [Path("a.csv").resolve(), Path("t.csv").resolve()]
    assert written == {str(file): hashlib.sha256(file.read_bytes()).hexdigest() for file in files}


def test_the_log_is_chosen_by_the_environment_of_all_commands_or_of_one(run, log, monkeypatch):
    monkeypatch.setenv("ENGINEDIAG_LOG", str(log))
    assert run("schema", "flight").exit_code == 0
    monkeypatch.setenv("ENGINEDIAG_SCHEMA_LOG", "own.jsonl")
    assert run("schema", "flight").exit_code == 0
    assert len(lines_of(log)) == len(lines_of(Path("own.jsonl"))) == 2
    assert "ENGINEDIAG_LOG" in run("man", "schema").stdout


@pytest.mark.parametrize(
    ("arguments", "field", "said"),
    [
        (["simulate", "--recrds", "2"], "message", "No such option"),
        (["simulate", "turbofun.yaml"], "message", "turbofun.yaml"),
        (["check", "bad.yaml"], "line", 2),
        (["check", "absent.csv"], "message", "absent.csv"),
    ],
)
def test_what_was_wrong_is_in_the_log_even_of_a_command_line_that_could_not_be_read(run, log, arguments, field, said):
    Path("bad.yaml").write_text("kind: flight\nmision: {}\n")
    assert run(*arguments, "--log", log).exit_code == 2
    lines = lines_of(log)
    errors = [line for line in lines if line["level"] == "error" and "event" not in line]
    assert any(said in line[field] if isinstance(said, str) else line[field] == said for line in errors)
    assert (lines[-1]["event"], lines[-1]["exit_code"], lines[-1]["level"]) == ("end", 2, "error")


def test_an_internal_error_leaves_its_traceback_in_the_log_and_not_on_the_terminal(run, log, monkeypatch):
    from enginediag_cli.cli import files as reference

    monkeypatch.setattr(reference.schema, "callback", lambda *_, **__: 1 // 0)
    ended = run("schema", "--log", log)
    assert ended.exit_code == 70
    assert "Traceback" not in ended.stderr
    assert "ZeroDivisionError" in next(line for line in lines_of(log) if line["level"] == "error")["traceback"]


def ended_line(path: Path) -> dict:
    return lines_of(path)[-1]


@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGHUP])
def test_a_run_that_is_terminated_says_so_at_last(log, number):
    # what was begun by nohup inherits SIGHUP ignored
    listen = {"preexec_fn": lambda: signal.signal(number, signal.SIG_DFL)}
    process = start("check", "-", "--log", str(log), **listen)
    until = time.monotonic() + 30
    while not (log.exists() and log.read_text()) and time.monotonic() < until:
        time.sleep(0.02)
    process.send_signal(number)
    process.communicate(timeout=60)
    assert process.returncode == 128 + number
    assert (ended_line(log)["event"], ended_line(log)["exit_code"]) == ("end", 128 + number)


def test_a_run_whose_reader_goes_away_says_so_at_last(log):
    reading, writing = os.pipe()
    os.close(reading)
    process = start("schema", "engine", "--log", str(log), stdout=writing)
    os.close(writing)
    assert process.communicate(timeout=60)[1] == ""
    assert ended_line(log)["exit_code"] == process.returncode == 141


def test_lines_of_runs_that_share_a_log_are_whole(run, log):
    processes = [start("components", "--log", str(log)) for _ in range(3)]
    for process in processes:
        process.communicate(timeout=120)
    lines = lines_of(log)
    for name in {line["run"] for line in lines}:
        assert [line.get("event") for line in lines if line["run"] == name] == ["begin", "end"]
    assert len(lines) == 6


def test_nothing_is_added_to_a_file_that_is_no_log(run, log):
    for name, text in (("data.csv", "flight,mach\n1,0.8\n"), ("rows.ndjson", '{"flight": 1}\n')):
        Path(name).write_text(text)
        ended = run("schema", "flight", "--log", name)
        assert ended.exit_code == 2
        assert f"{name}: exists and is not an enginediag log" in ended.stderr
        assert Path(name).read_text() == text
    assert run("schema", "--log", "-").exit_code == 2
    assert run("schema", "--log", "no/folder.jsonl").exit_code == 2
    assert run("simulate", ENGINE, "--records", "2", "-o", log, "--log", log).exit_code == 2


@pytest.mark.skipif(not os.path.exists("/dev/full"), reason="needs /dev/full")
def test_a_log_without_room_is_told_and_does_not_stop_the_work(run, log):
    ended = run("simulate", ENGINE, "--records", "2", "-o", "a.csv", "--log", "/dev/full")
    assert ended.exit_code == 0
    assert ended.stderr.count("/dev/full: the log ends here: No space left on device") == 1
    assert Path("a.csv").exists()


@pytest.mark.parametrize("name", list(COMMANDS))
def test_every_command_takes_a_log_and_help_and_configuration_leave_none(run, log, name):
    assert run(name, "--log", log, "--help").exit_code == 0
    assert run(name, "--log", log, "--print-config").exit_code == 0
    assert not log.exists()


def test_a_request_to_stop_is_recognised_behind_the_error_that_python_makes_of_it():
    stop, wrapped = SystemExit(129), RuntimeError("Error calling __set_name__")
    wrapped.__cause__ = stop
    assert _stop_request(wrapped) is stop
    assert _stop_request(ValueError("another")) is None
