"""`simulate -n NOMINAL` and `--health`: an engine as it was identified, and as `trend` found it."""

from __future__ import annotations

import csv
import json

import numpy as np
import pytest
from simulation_toy import CONFIGS

from enginediag_cli import load_engine
from enginediag_cli.__main__ import main
from enginediag_cli.engine.wrapped import NominalEngine
from enginediag_cli.faults.catalogue import FaultSet
from enginediag_cli.simulation.flights import KINDS, column_noise, default_plan, generate_flights
from enginediag_cli.simulation.simulate import simulate

FAULT = """
kind: faults
description: a worn compressor, a probe and a flow meter
source: assumed
faults:
  - {name: worn, assumed: true, changes: {compressor.efficiency: -0.03}, law: {type: step, clock: flight, onset: 5}}
sensor_faults:
  - {name: probe, assumed: true, column: T3_K, effect: {type: bias, size: 15},
     law: {type: step, clock: flight, onset: 4}}
"""


def call(*arguments) -> int:
    return int(main([str(a) for a in arguments]) or 0)


def table(path) -> list[dict[str, str]]:
    with open(path, encoding="utf-8") as stream:
        return list(csv.DictReader(line for line in stream if not line.startswith("#")))


def changes(path) -> dict[str, dict]:
    rows = json.loads(path.read_text())
    rows = rows["rows"] if isinstance(rows, dict) else rows
    return {row["parameter"]: row for row in rows if row["change"] is not None}


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """A turbojet, its nominal file, worn flights, and what `trend` found in them."""
    folder = tmp_path_factory.mktemp("nominal")
    (folder / "fault.yaml").write_text(FAULT, encoding="utf-8")
    engine, nominal, found = CONFIGS / "turbojet.yaml", folder / "nominal.yaml", folder / "found.json"
    healthy, worn = folder / "healthy.csv", folder / "worn.csv"
    assert call("simulate", engine, "--flights", 4, "--seed", 11, "-o", healthy, "-q") == 0
    assert call("identify", engine, healthy, "--no-cross-validation", "-o", nominal, "-q") == 0
    faulty = ["--fault", folder / "fault.yaml", "--flights", 9]
    assert call("simulate", engine, *faulty, "--seed", 12, "-o", worn, "-q") == 0
    assert call("trend", "-n", nominal, worn, "-o", found, "-q") == 0
    return folder


def test_flown_as_identified_without_noise_the_residuals_are_null(folder, tmp_path):
    flown, records = tmp_path / "flown.csv", tmp_path / "records.csv"
    nominal = folder / "nominal.yaml"
    assert call("simulate", "-n", nominal, "--flights", 2, "--seed", 3, "--noise", "none", "-o", flown) == 0
    assert call("residual", "-n", nominal, "--what", "records", flown, "-o", records) == 0
    rows = table(records)
    columns = [c for c in rows[0] if c.endswith(":sigmas")]
    assert len(rows) > 100 and columns
    assert max(abs(float(row[c])) for row in rows for c in columns if row[c]) < 1e-4


def test_what_trend_found_is_found_again_within_its_intervals(folder, tmp_path):
    again, judged = tmp_path / "again.csv", tmp_path / "again.json"
    nominal, found = folder / "nominal.yaml", folder / "found.json"
    before = changes(found)
    assert {"compressor.efficiency", "sensor.T3.bias"} <= set(before)
    options = ["--health", found, "--instruments", "--flights", 6, "--seed", 13]
    assert call("simulate", "-n", nominal, *options, "-o", again) == 0
    assert call("trend", "-n", nominal, again, "-o", judged) == 0
    after = changes(judged)
    for name, row in before.items():
        assert after[name]["change_low"] <= row["change_high"] and after[name]["change_high"] >= row["change_low"], name
        assert after[name]["kind"] == "from start"


def test_instruments_stay_right_unless_they_are_asked_for(folder, tmp_path, capfd):
    nominal, found, truth = folder / "nominal.yaml", folder / "found.json", tmp_path / "truth.csv"
    plain = ["simulate", "-n", nominal, "--health", found, "--flights", 1]
    assert call(*plain, "--truth", truth, "-o", tmp_path / "a.csv") == 0
    assert "compressor isentropic efficiency fell" in capfd.readouterr().err
    assert "compressor.efficiency" in table(truth)[0] and "sensor.T3.bias" not in table(truth)[0]
    # a fault comes on top of what was found
    first = float(table(truth)[-1]["compressor.efficiency"])
    late = tmp_path / "late.yaml"
    late.write_text(FAULT.replace("onset: 5", "onset: 1"), encoding="utf-8")
    assert call(*plain, "--fault", late, "--truth", truth, "-o", tmp_path / "b.csv") == 0
    assert float(table(truth)[-1]["compressor.efficiency"]) == pytest.approx(0.97 * first, rel=1e-9)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["turbojet.yaml", "-n", "nominal.yaml"], "ENGINE or --nominal"),
        ([], "ENGINE or --nominal"),
        (["turbojet.yaml", "--health", "found.json"], "--health needs --nominal"),
        (["-n", "nominal.yaml", "--instruments"], "--health"),
        (["-n", "nominal.yaml", "--health", "healthy.csv"], "recording"),
        (["-n", "nominal.yaml", "--health", "found.json", "--engine-instance", "left"], "no engine 'left'"),
    ],
)
def test_what_makes_no_sense_is_refused(folder, monkeypatch, capfd, arguments, message):
    monkeypatch.chdir(folder)
    assert call("simulate", *arguments) != 0
    assert message in capfd.readouterr().err


def test_a_nominal_engine_without_changes_is_the_engine_also_where_it_moves():
    engine = load_engine("turbofan_governed.yaml")
    same = NominalEngine(engine, engine, {}, {}, {})
    flown = []
    for model in (engine, same):
        rng = np.random.default_rng(5)
        given = generate_flights(default_plan(engine), engine, rng, flights=1, records=40)
        flown.append(simulate(model, given, FaultSet(), column_noise(KINDS["gaussian"], model), rng).columns)
    assert list(flown[0]) == list(flown[1])
    for name, values in flown[0].items():
        np.testing.assert_array_equal(values, flown[1][name])
