from __future__ import annotations

import os
import shlex
from pathlib import Path

import pytest

from enginediag_cli.__main__ import main
from enginediag_cli.validation import demonstration as script

pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def played(tmp_path_factory):
    """(the demonstration's standard output, the folder of its files)."""
    from contextlib import redirect_stdout
    from io import StringIO

    folder, before = tmp_path_factory.mktemp("demo") / "kept", os.getcwd()
    with redirect_stdout(StringIO()) as out:
        assert main(["demo", "--seed", "1", "--keep", str(folder), "-q"]) == 0
    assert os.getcwd() == before
    return out.getvalue(), folder


def shown(text: str) -> list[list[str]]:
    """The command lines of the demonstration, without the program's name."""
    lines = [line.strip() for line in text.splitlines()]
    return [shlex.split(line.removeprefix("$ enginediag ")) for line in lines if line.startswith("$ enginediag ")]


def test_fouling_and_a_wrong_thermocouple_are_found_and_told_apart(played):
    summary = played[0][played[0].index("Truth and findings") :]
    assert "flights 4, 5 and 6, something wrong: 3 of 3 detected, 3 isolated to exactly what was put in" in summary
    assert "found:  HPC flow capacity fell by" in summary
    assert "flights 3 and 4, something wrong: 2 of 2 detected, 2 isolated to exactly what was put in" in summary
    assert "found:  T3 sensor reads" in summary


def test_healthy_flights_are_judged_healthy(played):
    healthy = [line for line in played[0].splitlines() if "nothing wrong:" in line]
    assert [line.partition(": ")[2] for line in healthy] == [f"{n} of {n} judged healthy" for n in (2, 3, 2)]


def test_the_commands_shown_make_the_same_files_again(played, monkeypatch):
    text, folder = played
    monkeypatch.chdir(folder)
    again = [words for words in shown(text) if "fresh.csv" in words]
    assert [words[0] for words in again] == ["simulate", "detect"]
    for words in again:
        kept = {path: path.read_bytes() for path in Path().iterdir() if path.is_file()}
        assert main([*words, "-q"]) == 0
        assert kept == {path: path.read_bytes() for path in Path().iterdir() if path.is_file()}


def test_the_kept_folder_holds_the_engine_and_faults_that_the_commands_name(played):
    assert all((played[1] / name).is_file() for name in script.INGREDIENTS)


def test_a_folder_with_files_in_it_is_left_alone(run, tmp_path):
    (tmp_path / "mine.csv").write_text("keep me")
    ended = run("demo", "--keep", tmp_path)
    assert ended.exit_code == 2 and "is not an empty folder" in ended.stderr and ended.stdout == ""
    assert [path.name for path in tmp_path.iterdir()] == ["mine.csv"]
