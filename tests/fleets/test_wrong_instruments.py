"""Instruments that are stuck or scatter stand beside their engine in the list of a fleet, and in its trend."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
import small_fleet
from click.testing import CliRunner

from enginediag_cli.cli.main import enginediag
from enginediag_cli.recordings.read import read_all
from enginediag_cli.recordings.write import write_csv

SINCE = 6
"""Flight from which on an instrument is wrong."""


def printed(*words: object) -> list[dict]:
    return json.loads(CliRunner().invoke(enginediag, [*map(str, words), "-q", "-f", "json"]).stdout)


@pytest.fixture(scope="module")
def folder(tmp_path_factory) -> Path:
    folder = tmp_path_factory.mktemp("wrong")
    small_fleet.make(folder)
    rng = np.random.default_rng(5)
    for number, column, value in (
        (1, "T5_K", lambda x: np.full_like(x, x[0])),
        (3, "P3_Pa", lambda x: x * (1 + 0.03 * rng.standard_normal(len(x)))),
        (4, "Wf_kg_s", lambda x: np.full_like(x, np.median(x))),
    ):
        path = folder / f"engine_{number}.csv"
        table = read_all(str(path))
        wrong = np.array([int(flight) >= SINCE for flight in table.text["flight"]])
        values = table[column].copy()
        values[wrong] = value(values[wrong])
        write_csv(path, [table.with_columns({column: values})])
    return folder


def test_they_are_said_of_the_engine_with_the_flights(folder: Path) -> None:
    found = printed("fleet", folder / "fleet.yaml", "--jobs", 1)
    told = {engine["serial"]: [x["words"] for x in engine["instruments"]] for engine in found["engines"]}
    last, n = small_fleet.FLIGHTS, small_fleet.FLIGHTS - SINCE + 1
    where = f"in {n} of {last} flights ({SINCE} to {last})"
    assert told["2"] == []
    (stuck,), (noisy,), (still,) = told["1"], told["3"], told["4"]
    assert stuck.startswith("T5 sensor is stuck at ") and stuck.endswith(where)
    assert noisy.startswith("P3 sensor scatters ") and noisy.endswith(where)
    assert still.startswith("Wf reading is stuck at ") and still.endswith(where)
    for number, words in ((k, told[k]) for k in ("3", "4")):
        rows = printed("trend", "-n", folder / "nominal.yaml", folder / f"engine_{number}.csv")
        assert all(row["instruments"] == words for row in rows)
