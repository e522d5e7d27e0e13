"""On a terminal: progress on standard error, tables of its width. In a pipe: neither."""

from __future__ import annotations

import fcntl
import os
import struct
import subprocess
import sys
import termios
from pathlib import Path
from select import select

import pytest

from enginediag_cli.shipped import shipped

pty = pytest.importorskip("pty")

ENVIRONMENT = {
    **{key: value for key, value in os.environ.items() if key not in ("COLUMNS", "FORCE_COLOR")},
    "PYTHONPATH": str(Path(__file__).parents[2]),
    "TERM": "dumb",
}

COLUMNS = 80


def on_terminal(folder: Path, *arguments: str, streams: tuple[str, ...]) -> tuple[int, bytes, bytes]:
    """Run with the named streams on one terminal of 80 columns; (code, what it shows, the other stream)."""
    master, slave = pty.openpty()
    fcntl.ioctl(slave, termios.TIOCSWINSZ, struct.pack("HHHH", 24, COLUMNS, 0, 0))
    process = subprocess.Popen(
        [sys.executable, "-m", "enginediag_cli", *arguments],
        cwd=folder,
        env=ENVIRONMENT,
        stdin=slave,  # where the width is asked for
        stdout=slave if "stdout" in streams else subprocess.PIPE,
        stderr=slave if "stderr" in streams else subprocess.PIPE,
    )
    os.close(slave)
    pipe = process.stdout or process.stderr
    shown, piped = b"", b""
    waiting = [master, *([pipe.fileno()] if pipe else [])]
    while waiting:
        for ready in select(waiting, [], [], 120)[0]:
            try:
                some = os.read(ready, 65536)
            except OSError:  # the terminal has no writer left
                some = b""
            if not some:
                waiting.remove(ready)
            elif ready == master:
                shown += some
            else:
                piped += some
    os.close(master)
    if pipe:
        pipe.close()
    return process.wait(), shown, piped


@pytest.fixture(scope="module")
def folder(tmp_path_factory) -> Path:
    """An engine, a short recording, and its nominal, made in a pipe."""
    folder = tmp_path_factory.mktemp("terminal")
    (folder / "tj.yaml").write_bytes(shipped("turbojet.yaml").read_bytes())
    for line in ("simulate tj.yaml --records 300 --seed 1 -o in.csv", "identify tj.yaml in.csv -o n.yaml"):
        done = subprocess.run(
            [sys.executable, "-m", "enginediag_cli", *line.split()], cwd=folder, env=ENVIRONMENT, capture_output=True
        )
        assert done.returncode == 0
        assert b"\r" not in done.stderr
    return folder


def test_identification_shows_its_progress_on_a_terminal_and_wipes_it(folder):
    code, shown, _ = on_terminal(folder, "identify", "tj.yaml", "in.csv", "-o", "again.yaml", streams=("stderr",))
    assert code == 0
    assert b"\r" in shown.replace(b"\r\n", b"")
    assert b"identifying" in shown or b"fit" in shown
    assert (folder / "again.yaml").read_bytes() == (folder / "n.yaml").read_bytes()
    # whatever was shown on the line is blank before a message begins on it
    lines = [line.rpartition(b"\r")[2] for line in shown.split(b"\r\n")]
    assert any(line.startswith(b"300 records") for line in lines)


def test_quiet_shows_no_progress(folder):
    code, shown, _ = on_terminal(folder, "isolate", "-n", "n.yaml", "in.csv", "-o", "q.csv", "-q", streams=("stderr",))
    assert (code, shown) == (0, b"")


@pytest.mark.parametrize(
    ("command", "stage"),
    [("detect", b"records judged"), ("isolate", b"windows isolated"), ("residual", b"records judged")],
)
def test_windows_show_progress_on_a_terminal_and_the_data_are_those_of_a_pipe(folder, command, stage):
    arguments = (command, "-n", "n.yaml", "in.csv", "--window", "60")
    code, shown, piped = on_terminal(folder, *arguments, streams=("stderr",))
    assert code == 0
    assert stage in shown
    done = subprocess.run(
        [sys.executable, "-m", "enginediag_cli", *arguments], cwd=folder, env=ENVIRONMENT, capture_output=True
    )
    assert piped == done.stdout
    assert b"\r" not in done.stderr


def test_a_table_fits_the_terminal_and_says_what_it_left_out(folder):
    arguments = ("detect", "-n", "n.yaml", "in.csv", "--window", "60")
    code, shown, said = on_terminal(folder, *arguments, streams=("stdout",))
    lines = shown.decode().splitlines()
    assert code == 0
    assert max(map(len, lines)) <= COLUMNS
    assert len(lines) == 1 + 5
    assert "verdict" in lines[0].split()
    assert b"columns are hidden to fit the terminal; --wide shows all of them" in said


def test_wide_shows_every_column_below_each_other(folder):
    arguments = ("detect", "-n", "n.yaml", "in.csv", "--wide")
    _, shown, said = on_terminal(folder, *arguments, streams=("stdout",))
    assert b"threshold" in shown
    assert b"are hidden" not in said


def test_chosen_columns_are_those_of_the_table(folder):
    arguments = ("detect", "-n", "n.yaml", "in.csv", "--columns", "threshold,verdict")
    _, shown, said = on_terminal(folder, *arguments, streams=("stdout",))
    assert shown.decode().splitlines()[0].split() == ["threshold", "verdict"]
    assert b"are hidden" not in said


def test_a_file_cannot_speak_to_the_terminal(folder):
    text = (folder / "in.csv").read_text().splitlines()
    head = next(k for k, line in enumerate(text) if not line.startswith("#"))
    red = [f"\x1b[31m{line}" for line in text[head + 1 : head + 61]]
    (folder / "red.csv").write_text("\n".join([text[head], *red]) + "\n")
    for form in ("table", "csv", "json", "ndjson"):
        _, shown, _ = on_terminal(folder, "detect", "-n", "n.yaml", "red.csv", "-f", form, streams=("stdout", "stderr"))
        assert b"\x1b" not in shown
        assert b"\\x1b[31m" in shown or b"\\u001b[31m" in shown
