"""Flights that are judged as one: `isolate --pool`."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from enginediag_cli.__main__ import main
from enginediag_cli.history.engines import agreement
from enginediag_cli.residuals.statistics import LocalStatistics

CONFIGS = Path(__file__).parents[2] / "configs"
FAULT = """
kind: faults
description: a step of the compressor
source: assumed
faults:
  - {name: worn, assumed: true, changes: {compressor.efficiency: -0.004},
     law: {type: step, clock: flight, onset: ONSET}}
"""


def flight(s, F) -> LocalStatistics:
    p = len(s)
    names = tuple(f"p{i}" for i in range(p))
    return LocalStatistics(names, np.zeros(p), np.ones(p), np.asarray(s, float), F, F, 10, float(p), float(p))


def test_agreeing_flights_spread_as_chi_square_says_and_others_do_not():
    rng = np.random.default_rng(7)
    F = np.array([[40.0, 8.0], [8.0, 30.0]])
    root = np.linalg.cholesky(F)
    p = [
        agreement([flight(F @ [0.3, -0.2] + root @ rng.standard_normal(2), F) for _ in range(12)])[0]
        for _ in range(400)
    ]
    # uniform: each tenth of 400 holds 40 ± 6
    counts = np.histogram(p, bins=10, range=(0, 1))[0]
    assert (np.abs(counts - 40) < 24).all()
    moved = [flight(F @ [1.5 * (t >= 6), 0.0] + root @ rng.standard_normal(2), F) for t in range(12)]
    probability, ratio = agreement(moved)
    assert probability < 1e-6 and ratio > 2
    assert agreement(moved[:1]) == (1.0, 1.0)


def call(*arguments) -> int:
    return int(main([str(a) for a in arguments]) or 0)


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """A turbojet, its nominal file, and eight flights in two files, worn from the first, or from the fifth on."""
    folder = tmp_path_factory.mktemp("pooled")
    engine = CONFIGS / "turbojet.yaml"
    assert call("simulate", engine, "--flights", 4, "--seed", 21, "-o", folder / "healthy.csv", "-q") == 0
    fitted = ["--no-cross-validation", "-o", folder / "nominal.yaml", "-q"]
    assert call("identify", engine, folder / "healthy.csv", *fitted) == 0
    for name, onset in (("worn", 1), ("late", 5)):
        (folder / "fault.yaml").write_text(FAULT.replace("ONSET", str(onset)), encoding="utf-8")
        options = ["--fault", folder / "fault.yaml", "--flights", 8, "--seed", 22, "-q"]
        assert call("simulate", engine, *options, "-o", folder / f"{name}.csv") == 0
    text = (folder / "worn.csv").read_text(encoding="utf-8").splitlines(keepends=True)
    head = [line for line in text if line.startswith(("#", "flight,"))]
    rows = [line for line in text if line not in head]
    for name, part in (("first", {"1", "2", "3", "4", "5"}), ("second", {"6", "7", "8"})):
        kept = [row for row in rows if row.split(",")[0] in part]
        (folder / f"{name}.csv").write_text("".join(head + kept), encoding="utf-8")
    return folder


def isolate(folder, tmp_path, *arguments, ends: int = 0) -> list[dict]:
    out = tmp_path / "isolated.json"
    plain = ["-n", folder / "nominal.yaml", "--no-flips", "--no-work-scope"]
    given = [folder / a if str(a).endswith(".csv") else a for a in arguments]
    assert call("isolate", *plain, *given, "-o", out) == ends
    rows = json.loads(out.read_text(encoding="utf-8"))
    return rows["rows"] if isinstance(rows, dict) else rows


def test_last_flights_across_files_are_one_window_that_knows_more_than_one_flight(folder, tmp_path, capfd):
    rows = isolate(folder, tmp_path, "--pool", 6, "first.csv", "second.csv")
    assert "6 of 8 flights judged as one (3 to 8)" in capfd.readouterr().err
    first, last = rows[0]["source"].split(" to ")
    assert rows[0]["flight"] == "3 to 8" and first.endswith("first.csv") and last.endswith("second.csv")
    pooled = next(row for row in rows if row["parameter"] == "compressor.efficiency")
    assert pooled["lower"] <= -0.004 <= pooled["upper"]
    same = isolate(folder, tmp_path, "--pool", 6, "worn.csv")
    assert same[0]["change"] == pytest.approx(rows[0]["change"], rel=1e-9)
    alone = isolate(folder, tmp_path, "second.csv")
    assert {row["flight"] for row in alone} == {"6", "7", "8"}
    widths = [row["upper"] - row["lower"] for row in alone if row["parameter"] == "compressor.efficiency"]
    assert pooled["upper"] - pooled["lower"] < min(widths)


def test_flights_among_which_much_changed_have_no_answer_in_common(folder, tmp_path, capfd):
    rows = isolate(folder, tmp_path, "--pool", 8, "late.csv", ends=3)
    assert [row["verdict"] for row in rows] == ["no verdict"] and "pool fewer flights" in rows[0]["reason"]
    assert "differ from each other" in capfd.readouterr().err
    rows = isolate(folder, tmp_path, "--pool", 4, "late.csv")
    assert "compressor.efficiency" in {row["parameter"] for row in rows}


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (["--window", "60"], "--pool takes whole flights"),
        (["--reference", "10"], "--pool compares with nominal"),
        (["--monitor", "compressor.*"], "they must be among the suspects"),
        (["--nonlinear", "always"], "--nonlinear always"),
    ],
)
def test_what_makes_no_sense_with_pooled_flights_is_refused(folder, capfd, options, message):
    assert call("isolate", "-n", folder / "nominal.yaml", "--pool", 3, *options, folder / "worn.csv") != 0
    assert message in capfd.readouterr().err
