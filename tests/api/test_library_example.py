"""The ten lines of Python in enginediag_cli/README.md give the numbers of the shell."""

from __future__ import annotations

import io
import json
from collections.abc import Mapping
from contextlib import redirect_stdout
from pathlib import Path

from enginediag_cli.__main__ import main

ROOT = Path(__file__).resolve().parents[2]
MARK = "<!-- library example"
FAULT = """\
kind: faults
faults:
  - {name: dirt, description: dirt, assumed: true, changes: {compressor.efficiency: -0.03},
     law: {type: step, onset: 2, clock: flight}}
"""


def example() -> str:
    text = (ROOT / "enginediag_cli" / "README.md").read_text(encoding="utf-8")
    return text.split(MARK, 1)[1].split("```python\n", 1)[1].split("```", 1)[0]


def small(text: str) -> str:
    """The example with a small engine and few records a flight."""
    for old, new in (
        ('"turbofan.yaml"', '"turbojet.yaml"'),
        ('"faults/hpc_fouling.yaml"', '"fault.yaml"'),
        ("flights=", 'flight="flights.yaml", flights='),
    ):
        assert old in text
        text = text.replace(old, new)
    return text


def cells(*words: str) -> list[dict[str, object]]:
    """Rows of a command, as its JSON has them."""
    assert main([*words, "-q", "-f", "json", "-o", "rows.json"]) == 0
    found = json.loads(Path("rows.json").read_text(encoding="utf-8"))
    return [without_files(row) for row in found]


def without_files(row: Mapping[str, object]) -> dict[str, object]:
    """A row without the names of files, which arrays do not have."""
    return {name: value for name, value in row.items() if name not in ("source", "onset_source")}


def test_ten_lines_of_python_give_the_numbers_of_the_shell(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    Path("fault.yaml").write_text(FAULT, encoding="utf-8")
    plan = (ROOT / "configs" / "flights" / "airliner.yaml").read_text(encoding="utf-8")
    Path("flights.yaml").write_text(plan.replace("interval_s: 10", "interval_s: 480"), encoding="utf-8")
    names: dict[str, object] = {}
    printed = io.StringIO()
    with redirect_stdout(printed):
        exec(compile(small(example()), "README.md", "exec"), names)

    flown = ["simulate", "turbojet.yaml", "--flight", "flights.yaml", "-q"]
    assert main([*flown, "--flights", "3", "--seed", "1", "-o", "healthy.csv"]) == 0
    assert main(["identify", "turbojet.yaml", "healthy.csv", "-q", "-o", "nominal.yaml"]) == 0
    assert main([*flown, "--fault", "fault.yaml", "--flights", "6", "--seed", "7", "-o", "series.csv"]) == 0
    for verb, name in (("detect", "detected"), ("isolate", "isolated"), ("trend", "followed")):
        rows = [without_files(row) for row in names[name].to_dict()["rows"]]
        assert rows == cells(verb, "-n", "nominal.yaml", "series.csv"), verb

    assert [row["verdict"] for row in names["detected"]] == ["healthy"] + ["fault"] * 5
    assert "compressor isentropic efficiency fell by" in printed.getvalue()
    assert Path("health.svg").read_text(encoding="utf-8").startswith("<svg")
    assert "compressor" in Path("report.html").read_text(encoding="utf-8")


def test_the_example_has_no_more_than_ten_lines_beside_its_import():
    lines = [line for line in example().splitlines() if line.strip() and not line.startswith("from")]
    assert len(lines) <= 10
