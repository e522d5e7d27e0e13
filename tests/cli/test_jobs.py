"""Whatever --jobs says, the bytes are the same."""

from __future__ import annotations

import numpy as np
import pytest
from known_engine import climb, recorded, write_known

from enginediag_cli.__main__ import main
from enginediag_cli.physics.engine_file import load_engine
from enginediag_cli.recordings.table import Recording
from enginediag_cli.recordings.write import write_csv
from enginediag_cli.shipped import shipped

RECORDS = 720
"""More than two processes need to be worth their beginning."""


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    path = tmp_path_factory.mktemp("jobs")
    engine_file = shipped("turbofan.yaml")
    engine = load_engine(engine_file)
    inputs = climb(engine, RECORDS)
    rng = np.random.default_rng(3)
    for name, health in (("healthy", {}), ("faulty", {"hpc.efficiency": 0.98})):
        flight = np.repeat([f"{k}" for k in range(1, 5)], RECORDS // 4).tolist()
        write_csv(path / f"{name}.csv", [Recording(recorded(engine, inputs, health, rng), {"flight": flight})])
    write_known(engine, engine_file, inputs, path / "nominal.yaml")
    return path


@pytest.mark.parametrize(
    "command",
    [
        ["residual", "-n", "nominal.yaml", "--sensors", "faulty.csv", "--window", "40"],
        ["detect", "-n", "nominal.yaml", "faulty.csv", "--window", "40"],
        ["isolate", "-n", "nominal.yaml", "faulty.csv", "-f", "json"],
        ["trend", "-n", "nominal.yaml", "healthy.csv", "faulty.csv"],
        ["identify", str(shipped("turbojet.yaml")), "turbojet.csv"],
    ],
    ids=lambda command: command[0],
)
def test_the_bytes_are_the_same(folder, command, monkeypatch):
    monkeypatch.chdir(folder)
    if command[0] == "identify":
        simulate = ["simulate", command[1], "--records", f"{RECORDS}", "--seed", "4", "-q", "-o", command[2]]
        assert main(simulate) == 0
    suffix = "yaml" if command[0] == "identify" else "json" if "json" in command else "csv"
    told = []
    for jobs in ("1", "2", "3"):
        assert main([*command, "-q", "-o", f"{jobs}.{suffix}", "--jobs", jobs]) == 0
        told.append((folder / f"{jobs}.{suffix}").read_bytes())
    assert told[0] == told[1] == told[2] and len(told[0]) > 500


@pytest.mark.slow
@pytest.mark.parametrize("command", ["locate", "explain"])
def test_so_are_those_of_what_looks_for_missing_physics(folder, command, monkeypatch):
    monkeypatch.chdir(folder)
    told = []
    for jobs in ("1", "2"):
        asked = [command, str(shipped("turbofan.yaml")), "faulty.csv", "-q", "-f", "json"]
        assert main([*asked, "-o", f"{jobs}.json", "--jobs", jobs]) in (0, 3)
        told.append((folder / f"{jobs}.json").read_bytes())
    assert told[0] == told[1] and len(told[0]) > 200
