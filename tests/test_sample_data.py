"""The sample recordings and pictures are what the commands in their README make."""

from __future__ import annotations

import csv
import math
import shlex
from pathlib import Path
from xml.dom import minidom

import pytest

from enginediag_cli.__main__ import main

FOLDER = Path(__file__).parents[1] / "sample_data"
COMMANDS = {
    Path(words[-1]).name: words[1:]
    for line in (FOLDER / "README.md").read_text(encoding="utf-8").splitlines()
    if (words := shlex.split(line.strip() if line.startswith("    ") else ""))[:2] == ["enginediag", "simulate"]
}
RELATIVE = 1e-8
"""The solver converges to 1e-10; other versions of the numerical libraries differ below that."""


PICTURES = [
    Path(word).name
    for line in (FOLDER / "README.md").read_text(encoding="utf-8").splitlines()
    if line.startswith(
        ("    enginediag demo ", "    enginediag explain ", "    enginediag report ", "    enginediag detect ")
    )
    for word in shlex.split(line)
    if word.endswith(".svg")
]


def cells(path: Path) -> list[list[str]]:
    with open(path, encoding="utf-8", newline="") as stream:
        return list(csv.reader(line for line in stream if not line.startswith("#")))


def same(a: str, b: str) -> bool:
    try:
        return math.isclose(float(a), float(b), rel_tol=RELATIVE)
    except ValueError:
        return a == b


def test_every_sample_has_its_command():
    assert set(COMMANDS) == {path.name for path in FOLDER.glob("*.csv")}
    assert sorted(PICTURES) == sorted(path.name for path in FOLDER.glob("*.svg"))


@pytest.mark.parametrize("name", PICTURES)
def test_a_picture_is_small_and_can_be_drawn(name):
    """That its command gives it again is part of the tests of the demonstration, since it takes long."""
    document = minidom.parse(str(FOLDER / name))
    assert document.documentElement.tagName == "svg" and len(document.getElementsByTagName("text")) > 12
    assert (FOLDER / name).stat().st_size < 60_000


@pytest.mark.slow
def test_the_law_of_the_readme_is_found_and_drawn_as_the_sample_has_it(tmp_path, monkeypatch):
    configs = FOLDER.parent / "configs"
    monkeypatch.chdir(tmp_path)
    law = (configs / "laws" / "modulated_cooling.yaml").read_text(encoding="utf-8")
    Path("truth.yaml").write_text((configs / "turbofan.yaml").read_text(encoding="utf-8") + law, encoding="utf-8")
    flights = (configs / "flights" / "airliner.yaml").read_text(encoding="utf-8")
    Path("flights.yaml").write_text(flights.replace("interval_s: 10", "interval_s: 60"), encoding="utf-8")
    fly = ["simulate", "truth.yaml", "--flight", "flights.yaml", "--flights", "5", "--seed", "11", "-q"]
    assert main([*fly, "-o", "recorded.csv"]) == 0
    given = ["explain", str(configs / "turbofan.yaml"), "recorded.csv", "--no-advice", "-q", "-o", "answer.json"]
    assert main([*given, "--picture", "law.svg"]) == 0
    drawn, sample = (minidom.parse(str(f)).getElementsByTagName("title")[0] for f in ("law.svg", FOLDER / "law.svg"))
    assert drawn.toxml() == sample.toxml()


@pytest.mark.parametrize("name", ["fouling_snapshots.csv", "T3_bias_snapshots.csv"])
def test_its_command_gives_the_same_recording_again(name, tmp_path, monkeypatch):
    monkeypatch.chdir(FOLDER.parent)
    assert main([*COMMANDS[name][:-1], str(tmp_path / name), "-q"]) == 0
    made, kept = cells(tmp_path / name), cells(FOLDER / name)
    assert [row[0] for row in made] == [row[0] for row in kept]
    assert all(same(a, b) for mine, theirs in zip(made, kept, strict=True) for a, b in zip(mine, theirs, strict=True))


def test_all_samples_together_stay_small():
    assert sum(path.stat().st_size for path in FOLDER.iterdir()) < 300_000
