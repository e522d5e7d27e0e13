"""Fixtures that run the program: as a child process, as users do, or inside the test process, faster."""

from __future__ import annotations

import subprocess
import sys
import tempfile
from dataclasses import dataclass

import pytest

from enginediag_cli.__main__ import main


@dataclass(frozen=True)
class Ended:
    """How a run ended."""

    exit_code: int
    stdout: str
    stderr: str


@pytest.fixture
def shell():
    """`shell(*arguments, stdin="", env=None)`: run `python -m enginediag_cli` as a child process."""

    def run(*arguments: str, stdin: str = "", **options) -> Ended:
        done = subprocess.run(
            [sys.executable, "-m", "enginediag_cli", *map(str, arguments)],
            input=stdin,
            capture_output=True,
            text=True,
            encoding="utf-8",
            timeout=120,
            **options,
        )
        return Ended(done.returncode, done.stdout, done.stderr)

    return run


@pytest.fixture
def run(monkeypatch, capsys):
    """`run(*arguments, stdin="")`: the same `main`, in this process."""

    def call(*arguments: str, stdin: str = "") -> Ended:
        capsys.readouterr()
        with tempfile.TemporaryFile("w+", encoding="utf-8") as piped:  # a real file: it must have a fileno
            piped.write(stdin)
            piped.seek(0)
            monkeypatch.setattr(sys, "stdin", piped)
            exit_code = main([str(argument) for argument in arguments])
        captured = capsys.readouterr()
        return Ended(int(exit_code), captured.out, captured.err)

    return call


@pytest.fixture
def here(folder, tmp_path, monkeypatch):
    """A folder of its own with copies of what is in the module's `folder`, in which the test runs."""
    for file in folder.iterdir():
        (tmp_path / file.name).write_bytes(file.read_bytes())
    monkeypatch.chdir(tmp_path)
    return tmp_path
