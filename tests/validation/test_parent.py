"""No process outlives the one that started it, even one that is killed and can clean nothing up."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

ROOT = str(Path(__file__).parents[2])
ENVIRONMENT = {**os.environ, "PYTHONPATH": ROOT}

PATIENCE_S = 60.0
"""For processes to start on a machine with much else to do."""

GONE_S = 30.0
"""In which a child must have ended: one that has just been started ends when it has read its modules."""

linux = pytest.mark.skipif(not Path("/proc/self/stat").exists(), reason="looks for processes in /proc")


def descendants(process: int) -> set[int]:
    """Numbers of all processes started by this one, and by them."""
    parents = {}
    for entry in Path("/proc").iterdir():
        if entry.name.isdigit():
            try:
                state, parent = (entry / "stat").read_text().rpartition(")")[2].split()[:2]
            except OSError:
                continue
            if state != "Z":
                parents[int(entry.name)] = int(parent)
    found, more = set(), {process}
    while more:
        more = {child for child, parent in parents.items() if parent in more}
        found |= more
    return found


def alive(process: int) -> bool:
    try:
        return (Path("/proc") / str(process) / "stat").read_text().rpartition(")")[2].split()[0] != "Z"
    except OSError:
        return False


def diagnosing(process: int) -> bool:
    try:
        return b"diagnoser" in (Path("/proc") / str(process) / "cmdline").read_bytes()
    except OSError:
        return False


def killed_with_children(command: list[str], started) -> None:
    """Start a command, wait for `started(children)`, kill it, and see that its children end."""
    process = subprocess.Popen(command, env=ENVIRONMENT, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    children: set[int] = set()
    try:
        end = time.monotonic() + PATIENCE_S
        while not started(children := descendants(process.pid)):
            assert process.poll() is None, "ended before it had children"
            assert time.monotonic() < end, "no children came"
            time.sleep(0.1)
        process.kill()
        process.wait()
        end = time.monotonic() + GONE_S
        while (left := [child for child in children if alive(child)]) and time.monotonic() < end:
            time.sleep(0.1)
        assert left == []
    finally:
        process.kill()
        for child in children:
            if alive(child):
                os.kill(child, signal.SIGKILL)


@linux
def test_a_killed_study_leaves_no_process():
    command = [sys.executable, "-m", "enginediag_cli", "study", "studies/paper.yaml", "--processes", "2"]
    killed_with_children(command, lambda children: len(children) >= 2)


@linux
def test_a_killed_proof_leaves_neither_worker_nor_diagnoser():
    command = [sys.executable, "-m", "enginediag_cli", "prove", "--trials", "2", "--jobs", "1", "--no-sizes"]
    killed_with_children(command, lambda children: any(map(diagnosing, children)))


@linux
@pytest.mark.parametrize("way", ["system", "watch"])
def test_a_child_ends_in_either_way(way, tmp_path):
    no_system = "parent._death_signal_set = lambda: False\n" if way == "watch" else ""
    child = tmp_path / "child.py"
    child.write_text(
        "import sys, time\nfrom enginediag_cli import parallel as parent\n"
        f"{no_system}parent.end_with_parent(int(sys.argv[1]))\nprint('ready', flush=True)\ntime.sleep(60)\n"
    )
    start = (
        "import os, subprocess, sys, time\n"
        f"subprocess.Popen([sys.executable, {str(child)!r}, str(os.getpid())])\ntime.sleep(60)\n"
    )
    process = subprocess.Popen([sys.executable, "-c", start], env=ENVIRONMENT, stdout=subprocess.PIPE, text=True)
    assert process.stdout is not None
    assert process.stdout.readline() == "ready\n"
    [orphan] = descendants(process.pid)
    process.kill()
    process.wait()
    end = time.monotonic() + GONE_S
    while alive(orphan) and time.monotonic() < end:
        time.sleep(0.1)
    assert not alive(orphan)


@linux
def test_a_child_whose_parent_is_gone_already_ends_at_once():
    code = "from enginediag_cli.parallel import end_with_parent\nend_with_parent(1 << 22)\nprint('lives')"
    done = subprocess.run([sys.executable, "-c", code], env=ENVIRONMENT, capture_output=True, text=True)
    assert done.stdout == ""
    assert done.returncode == 1
