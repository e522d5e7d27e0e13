"""The ten lines of Python in enginediag_cli/README.md give the numbers of the shell."""

from __future__ import annotations

import csv
import io
from contextlib import redirect_stdout
from pathlib import Path

import pytest

from enginediag_cli.__main__ import main

ROOT = Path(__file__).resolve().parents[2]
MARK = "<!-- library example"


def example() -> str:
    text = (ROOT / "enginediag_cli" / "README.md").read_text(encoding="utf-8")
    return text.split(MARK, 1)[1].split("```python\n", 1)[1].split("```", 1)[0]


@pytest.fixture
def folder(tmp_path, monkeypatch):
    """A nominal state, and a series of flights in which a reading stands still."""
    monkeypatch.chdir(tmp_path)
    quiet = ["-q"]
    assert main(["simulate", "turbojet.yaml", "--records", "120", "--seed", "1", "-o", "healthy.csv", *quiet]) == 0
    assert (
        main(["identify", "turbojet.yaml", "healthy.csv", "--no-cross-validation", "-o", "nominal.yaml", *quiet]) == 0
    )
    assert main(["simulate", "turbojet.yaml", "--records", "90", "--seed", "2", "-o", "series.csv", *quiet]) == 0
    lines = Path("series.csv").read_text(encoding="utf-8").splitlines()
    head = next(k for k, line in enumerate(lines) if not line.startswith("#"))
    column = lines[head].split(",").index("T3_K")
    held = lines[head + 40].split(",")[column]
    for k in range(head + 41, head + 70):
        cells = lines[k].split(",")
        cells[column] = held
        lines[k] = ",".join(cells)
    Path("series.csv").write_text("\n".join(lines) + "\n", encoding="utf-8")
    return tmp_path


def test_ten_lines_of_python_give_the_numbers_of_the_shell(folder):
    assert main(["detect", "-n", "nominal.yaml", "series.csv", "--no-header", "-q", "-o", "rows.csv"]) == 0
    with open("rows.csv", encoding="utf-8", newline="") as stream:
        rows = list(csv.DictReader(stream))
    told = io.StringIO()
    with redirect_stdout(told):
        exec(compile(example(), "README.md", "exec"), {})
    lines = [line.split() for line in told.getvalue().splitlines()]
    for row, (*_, statistic, verdict) in zip(rows, lines[: len(rows)], strict=True):
        assert verdict == row["verdict"]
        assert float(statistic) == pytest.approx(
            float(row["statistic"]), rel=1e-3
        )  # detect computes what is uncertain from a fit
    assert "'T3_K': {'stuck': 30}" in told.getvalue()  # what was left out is data


def test_the_example_has_no_more_than_ten_lines_beside_its_imports():
    lines = [line for line in example().splitlines() if line.strip() and not line.startswith("from")]
    assert len(lines) <= 10
