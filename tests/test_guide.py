"""The guide `configs/README.md`: its files are written and its commands run as they stand, and print what it says."""

from __future__ import annotations

import re
import shlex
import shutil
from pathlib import Path

import pytest

from enginediag_cli.__main__ import main

TOP = Path(__file__).parents[1]
GUIDE = (TOP / "configs" / "README.md").read_text(encoding="utf-8")
BLOCK = re.compile(r"```(\w+)\n(.*?)```", re.DOTALL)
PROMPT = "$ enginediag "
EXPECTED_TO_FAIL = ("check draft.yaml", "check draft2.yaml")


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """A folder with the shipped configs and the files that the guide shows."""
    made = tmp_path_factory.mktemp("guide")
    shutil.copytree(TOP / "configs", made / "configs")
    for language, text in BLOCK.findall(GUIDE):
        if language == "yaml":
            name = re.match(r"# (\w+\.yaml): ", text)
            assert name, "a YAML block of the guide opens with its file's name"
            (made / name[1]).write_text(text, encoding="utf-8")
        elif language == "csv":
            (made / "hums.csv").write_text(text, encoding="utf-8")
    return made


def runs():
    """(command, lines that the guide shows of its output), in order."""
    found: list[tuple[str, list[str]]] = []
    for language, text in BLOCK.findall(GUIDE):
        if language == "console":
            for line in text.splitlines():
                if line.startswith(PROMPT):
                    found.append((line.removeprefix(PROMPT), []))
                else:
                    found[-1][1].append(line)
    return found


def test_the_guides_commands_run_and_print_what_it_shows(folder, monkeypatch, capsys):
    monkeypatch.chdir(folder)
    monkeypatch.setenv("COLUMNS", "100")
    assert len(runs()) >= 10
    for command, shown in runs():
        exit_code = main(shlex.split(command))
        assert exit_code == (2 if command in EXPECTED_TO_FAIL else 0), command
        captured = capsys.readouterr()
        printed = iter([line.rstrip() for line in (captured.out + captured.err).splitlines()])
        for line in shown:
            if line != "…":
                start = line.removesuffix("…")
                assert any(p == line or (start != line and p.startswith(start)) for p in printed), (command, line)


def test_the_guide_names_files_that_are_there():
    for target in re.findall(r"\]\(([^)]+)\)", GUIDE):
        assert (TOP / "configs" / target).exists(), target
