"""Runs beside each other, and runs that end before their time: locks, whole outputs, a bare environment."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from enginediag_cli.parallel import lock_file
from enginediag_cli.recordings.write import LEFT_BEHIND_S, open_output

ROOT = Path(__file__).parents[2]
BARE = {"PATH": os.environ["PATH"], "LANG": "C", "PYTHONPATH": str(ROOT), "PYTHONDONTWRITEBYTECODE": "1"}
"""What cron gives: no HOME, no TERM, no UTF-8 locale."""


@pytest.fixture
def folder(tmp_path, monkeypatch) -> Path:
    monkeypatch.chdir(tmp_path)
    return tmp_path


def start(*arguments: str, **options) -> subprocess.Popen:
    pipe = subprocess.PIPE
    command = [sys.executable, "-m", "enginediag_cli", *map(str, arguments)]
    return subprocess.Popen(
        command, **{"stdin": subprocess.DEVNULL, "stdout": pipe, "stderr": pipe, "env": BARE, "text": True, **options}
    )


def holding(lock: Path) -> subprocess.Popen:
    """A run that holds the lock until its standard input ends."""
    process = start("check", "-", "--lock", lock, stdin=subprocess.PIPE)
    until = time.monotonic() + 30
    while not (lock.exists() and lock.read_text()) and time.monotonic() < until:
        time.sleep(0.02)
    return process


def test_a_second_run_ends_with_75_and_says_who_holds_the_lock_and_a_killed_one_holds_it_no_longer(run, folder):
    lock = folder / "nightly.lock"
    first = holding(lock)
    ended = run("simulate", "turbofan.yaml", "--records", "2", "-o", "a.csv", "--lock", lock, "--log", "log.jsonl")
    assert ended.exit_code == 75
    assert f"process {first.pid}, enginediag check, since 2" in ended.stderr
    assert "nothing was done, try again later" in ended.stderr
    assert not Path("a.csv").exists()
    assert '"exit_code": 75' in Path("log.jsonl").read_text().splitlines()[-1]
    first.send_signal(signal.SIGKILL)
    first.communicate(timeout=60)
    assert run("simulate", "turbofan.yaml", "--records", "2", "-o", "a.csv", "--lock", lock).exit_code == 0


def test_a_run_waits_for_the_lock_as_long_as_it_is_told(folder):
    lock = folder / "nightly.lock"
    first = holding(lock)
    second = start("schema", "flight", "--lock", lock, "--lock-wait", "60")
    time.sleep(1.0)
    assert second.poll() is None
    first.communicate("flight,mach\n1,0.5\n", timeout=60)
    second.communicate(timeout=60)
    assert second.returncode == 0


def test_a_file_that_is_something_else_is_not_taken_for_a_lock(run, folder):
    Path("data.csv").write_text("flight,mach\n1,0.5\n")
    ended = run("schema", "flight", "--lock", "data.csv")
    assert (ended.exit_code, Path("data.csv").read_text()) == (2, "flight,mach\n1,0.5\n")
    assert "the file exists and is no lock file" in ended.stderr
    assert run("check", "data.csv", "--lock", "data.csv").exit_code == 2
    with lock_file("own.lock", "test"):
        assert run("schema", "flight", "--lock", "own.lock").exit_code == 75


def test_of_two_runs_that_write_one_file_one_wins_whole(run, folder):
    arguments = ["simulate", "turbofan.yaml", "--flights", "1", "--records", "400", "--no-header"]
    texts = [run(*arguments, "--seed", seed).stdout for seed in "12"]
    both = [start(*arguments, "--seed", seed, "-o", "out.csv") for seed in "12"]
    for process in both:
        process.communicate(timeout=120)
        assert process.returncode == 0
    assert Path("out.csv").read_text() in texts
    assert os.listdir(folder) == ["out.csv"]


@pytest.mark.parametrize("name", ["out.csv", "out.csv.gz"])
def test_a_disk_without_room_leaves_the_old_file_and_nothing_else(folder, name):
    Path(name).write_bytes(b"old")
    line = f"ulimit -f 1; exec {sys.executable} -m enginediag_cli simulate turbofan.yaml --records 800 -o {name}"
    done = subprocess.run(["bash", "-c", line], env=BARE, capture_output=True, text=True, timeout=60)
    assert done.returncode == 2
    assert "error: " in done.stderr and "Traceback" not in done.stderr
    assert Path(name).read_bytes() == b"old"
    assert os.listdir(folder) == [name]


def test_what_a_killed_run_left_is_cleared_away_and_what_another_has_at_work_is_not(folder):
    old = time.time() - 2 * LEFT_BEHIND_S
    left, fresh, other = (folder / name for name in (".out.csv.a.part", ".out.csv.b.part", ".other.csv.c.part"))
    for path in (left, fresh, other):
        path.write_text("half")
    for path in (left, other):
        os.utime(path, (old, old))
    with open_output("out.csv") as stream:
        stream.write("first\n")
        stream.flush()
        at_work = next(p for p in folder.glob(".out.csv.*.part") if p not in (left, fresh))
        os.utime(at_work, (old, old))
        with open_output("out.csv") as second:
            second.write("second\n")
        assert at_work.exists()
    assert Path("out.csv").read_text() == "first\n"
    assert sorted(os.listdir(folder)) == [".other.csv.c.part", ".out.csv.b.part", "out.csv"]


def test_without_home_terminal_or_locale_and_in_a_folder_that_cannot_be_written_it_works_the_same(run, folder):
    arguments = ["simulate", "turbofan.yaml", "--records", "3", "-o"]
    process = start(*arguments, folder / "bare.csv", "--log", folder / "log.jsonl", cwd="/proc")
    _, said = process.communicate(timeout=60)
    assert (process.returncode, said) == (0, "3 records simulated\n")
    assert run(*arguments, "full.csv").exit_code == 0
    assert Path("bare.csv").read_bytes() == Path("full.csv").read_bytes()
    told = start("schema", "output/detect", cwd="/proc", encoding="utf-8")
    assert "χ²" in told.communicate(timeout=60)[0]
