"""`detect --follow` and `trend` as commands, on the turbofan."""

from __future__ import annotations

import csv
import io
import json
import sys
from pathlib import Path

import pytest

from enginediag_cli.__main__ import main

ENGINE = str(Path(__file__).parents[2] / "configs" / "turbofan.yaml")
FAULT = """
kind: faults
description: sudden loss
source: assumed
faults:
  - {name: loss, description: loss, reference: assumed, assumed: true, changes: {hpc.efficiency: -0.02},
     law: {type: step, clock: flight, onset: 3}}
"""


def run(*arguments, stdin=None):
    """Exit code and standard output."""
    before = sys.argv, sys.stdin, sys.stdout
    out = io.StringIO()
    sys.argv, sys.stdout = ["enginediag", *arguments], out
    try:
        code = main() or 0
    except SystemExit as end:
        code = end.code or 0
    finally:
        sys.argv, sys.stdin, sys.stdout = before
    return int(code), out.getvalue()


@pytest.fixture(scope="module")
def files(tmp_path_factory):
    folder = tmp_path_factory.mktemp("follow")
    (folder / "fault.yaml").write_text(FAULT, encoding="utf-8")
    paths = {name: str(folder / name) for name in ("healthy.csv", "nominal.yaml", "flown.csv", "statistics.csv")}
    plain = ["simulate", ENGINE, "-q"]
    assert run(*plain, "--flights", "1", "--seed", "3", "-o", paths["healthy.csv"])[0] == 0
    assert (
        run("identify", ENGINE, paths["healthy.csv"], "--no-cross-validation", "-q", "-o", paths["nominal.yaml"])[0]
        == 0
    )
    assert (
        run(*plain, "--flights", "5", "--seed", "4", "--fault", str(folder / "fault.yaml"), "-o", paths["flown.csv"])[0]
        == 0
    )
    return paths


def test_follow_gives_a_row_per_block_and_an_alarm_in_faulty_flights_only(files):
    code, out = run(
        "detect",
        "--follow",
        "--idle",
        "0",
        "--window",
        "50",
        "-q",
        "-n",
        files["nominal.yaml"],
        files["flown.csv"],
        "--no-header",
        "--format",
        "csv",
        "--exit-code",
    )
    rows = list(csv.DictReader(io.StringIO(out)))
    alarms = {row["flight"]: row["alarm"] for row in rows}
    assert code == 1 and alarms == {"1": "false", "2": "false", "3": "true", "4": "true", "5": "true"}
    assert {row["kind"] for row in rows if row["flight"] == "5"} - {""} <= {"present from the start", "cannot tell"}


def test_follow_refuses_what_it_cannot_do(files):
    assert (
        run("detect", "--follow", "--step", "5", "--window", "50", "-n", files["nominal.yaml"], files["flown.csv"])[0]
        == 2
    )
    assert run("detect", "--follow", files["flown.csv"])[0] == 2


def test_trend_is_the_same_from_recordings_and_from_statistics(files):
    assert run("residual", "-q", "-n", files["nominal.yaml"], files["flown.csv"], "-o", files["statistics.csv"])[0] == 0
    direct = json.loads(run("trend", "-q", "-n", files["nominal.yaml"], files["flown.csv"], "--format", "json")[1])
    stored = json.loads(run("trend", "-q", files["statistics.csv"], "--format", "json")[1])
    kinds = {row["parameter"]: row["kind"] for row in direct}
    assert kinds["hpc.efficiency"] == "step" and list(kinds.values()).count("steady") >= 9
    (loss,) = [row for row in direct if row["parameter"] == "hpc.efficiency"]
    assert loss["onset"] == 3 and abs(loss["change"] + 0.02) < 0.004
    for one, two in zip(direct, stored, strict=True):
        assert one["kind"] == two["kind"] and one["probability"] == pytest.approx(two["probability"], rel=1e-6)
