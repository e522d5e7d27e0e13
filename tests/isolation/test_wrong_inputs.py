"""Errors of the instruments that give the model its inputs are named, whatever else is suspected."""

from __future__ import annotations

from pathlib import Path

from enginediag_cli import isolate
from enginediag_cli.__main__ import main


def test_a_wrong_altitude_beside_drifts_that_are_no_suspects_is_named(tmp_path):
    """What wrong slopes of the maps do is spread over all suspects at once: of some of them alone it would be so much
    that even this error, at p < 10⁻¹⁰, drowned in it."""
    nominal, healthy, flown = (str(tmp_path / name) for name in ("nominal.yaml", "healthy.csv", "flown.csv"))
    fly = ["simulate", "turboshaft.yaml", "--flight", "flights/helicopter.yaml", "-q"]
    assert main([*fly, "--flights", "3", "--seed", "5", "-o", healthy]) == 0
    assert main(["identify", "turboshaft.yaml", healthy, "--no-cross-validation", "-q", "-o", nominal]) == 0
    assert main([*fly, "--flights", "1", "--records", "40", "--seed", "9", "-o", flown]) == 0
    lines = Path(flown).read_text(encoding="utf-8").splitlines()
    head = next(k for k, line in enumerate(lines) if not line.startswith("#"))
    column = lines[head].split(",").index("altitude_m")
    for k in range(head + 1, len(lines)):
        cells = lines[k].split(",")
        cells[column] = str(float(cells[column]) - 250.0)
        lines[k] = ",".join(cells)
    Path(flown).write_text("\n".join(lines) + "\n", encoding="utf-8")
    found = isolate(nominal, flown, flips="", work_scope="")
    assert [row["parameter"] for row in found] == ["input.altitude.bias"]
    assert found[0]["probability"] > 0.9
