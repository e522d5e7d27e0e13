"""`enginediag locate` from the command line."""

from __future__ import annotations

import csv
import io
import json
from pathlib import Path
from xml.dom import minidom

import numpy as np
import pytest

from enginediag_cli.physics.engine_file import load_engine
from enginediag_cli.physics.registry import effect

ENGINE = Path(__file__).parents[2] / "configs" / "turbofan.yaml"
COUNT, RECORDS = 3, 40


def write(path, exponent, seed=3, first=None):
    """Flights of one engine whose HPC efficiency falls with Reynolds number; `first` changes the first reading."""
    engine, rng = load_engine(ENGINE), np.random.default_rng(seed)
    truth = engine.replace_effects([effect(engine, "reynolds_efficiency", "hpc", {"exponent": exponent})])
    with path.open("w", newline="", encoding="utf-8") as stream:
        out = csv.writer(stream)
        for k in range(COUNT):
            h = rng.uniform(2000, 11500, RECORDS)
            u = {
                "altitude_m": h,
                "mach": 0.35 + 0.45 * h / 11500 + rng.normal(0, 0.02, RECORDS),
                "dT_isa_K": np.full(RECORDS, rng.normal(0, 8)),
            }
            u["Wf_kg_s"] = engine.power_from_fraction(rng.uniform(0.4, 0.95, RECORDS), u)
            p = truth.predict(u)
            if k == 0:
                out.writerow(["flight", *u, *p.columns, "valve_state"])
            noise = np.array([engine.sensors[c].noise_sigma for c in p.columns])
            y = p.y + noise * rng.standard_normal(p.y.shape)
            out.writerows([k + 1, *(v[i] for v in u.values()), *y[i], i % 2] for i in range(RECORDS))
    return path


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    folder = tmp_path_factory.mktemp("locate")
    write(folder / "reynolds.csv", 0.1)
    write(folder / "nothing.csv", 0.0)
    return folder


@pytest.mark.slow
def test_the_map_is_drawn_as_png_the_same_each_time(folder, run):
    pytest.importorskip("resvg_py", reason="no resvg-py here: pip install 'enginediag[report]'")
    maps = [folder / "map.png", folder / "again.png"]
    for path in maps:
        assert run("locate", ENGINE, folder / "reynolds.csv", "--picture", path, "-q").exit_code == 0
    assert maps[0].read_bytes().startswith(b"\x89PNG") and maps[0].read_bytes() == maps[1].read_bytes()


def test_a_located_mismatch_is_a_finding_with_rows_words_and_a_picture(folder, run):
    ended = run("locate", ENGINE, folder / "reynolds.csv", "--picture", folder / "map.svg", "--exit-code")
    assert ended.exit_code == 1
    head = [line for line in ended.stdout.splitlines() if line.startswith("#")]
    assert any(line.startswith("# config: turbofan.yaml sha256:") for line in head)
    assert "# map accuracy: 0.003" in head
    rows = list(csv.DictReader(line for line in io.StringIO(ended.stdout) if not line.startswith("#")))
    assert {r["verdict"] for r in rows} == {"effect"}
    assert rows[0]["location"] == "hpc.efficiency" and rows[0]["component"] == "hpc"
    assert any("reynolds_index" in r["driver"] for r in rows)
    assert float(rows[0]["p_value"]) < 1e-6 and rows[0]["refit"] == "converged"
    assert "it acts at HPC isentropic efficiency" in ended.stderr
    assert "one engine is recorded" in ended.stderr
    picture = minidom.parse(str(folder / "map.svg"))
    assert any(t.firstChild.data == "HPC isentropic efficiency" for t in picture.getElementsByTagName("text"))


def test_no_mismatch_is_said_and_is_no_finding(folder, run):
    ended = run("locate", ENGINE, folder / "nothing.csv", "--exit-code", "--format", "json")
    assert ended.exit_code == 0
    (row,) = json.loads(ended.stdout)
    assert row["verdict"] == "nothing" and row["location"] is None
    assert "no mismatch beyond noise and identified parameters" in ended.stderr


def test_all_writes_the_whole_map_also_when_there_is_nothing(folder, run):
    ended = run(
        "locate",
        ENGINE,
        folder / "nothing.csv",
        "--all",
        "--format",
        "json",
        "--model-error",
        "0",
        "--driver",
        "valve_state",
    )
    rows = json.loads(ended.stdout)
    assert len(rows) > 100 and not any(r["within"] for r in rows)
    assert "valve_state" in {r["driver"] for r in rows} and "time" in {r["driver"] for r in rows}
    assert [r["rank"] for r in rows] == list(range(1, len(rows) + 1))


@pytest.mark.slow
def test_a_fit_without_a_prediction_for_many_records_is_no_verdict(folder, run):
    head, *lines = (folder / "nothing.csv").read_text(encoding="utf-8").splitlines()
    at = head.split(",").index("Wf_kg_s")
    cells = [line.split(",") for line in lines]
    for row in cells[::3]:
        row[at] = "60"  # no engine of this size burns that
    (folder / "absurd.csv").write_text("\n".join([head, *map(",".join, cells)]) + "\n", encoding="utf-8")
    ended = run("locate", ENGINE, folder / "absurd.csv", "--picture", folder / "none.svg")
    assert ended.exit_code == 3 and ended.stdout == ""
    assert "no verdict" in ended.stderr
    assert not (folder / "none.svg").exists()


@pytest.mark.parametrize(
    ("options", "said"),
    [
        (("--driver", "valve"), "valve_state"),
        (("--engine-instance", "B"), "no column `engine`, in which records would name 'B'"),
        (("--model-error", "0.5"), "0.5 is not in the range"),
        (("--picture", "nowhere/map.svg"), "there is no folder"),
    ],
)
def test_what_cannot_be_done_is_said_before_anything_is_written(folder, run, options, said):
    ended = run("locate", ENGINE, folder / "nothing.csv", *options)
    assert ended.exit_code == 2 and ended.stdout == ""
    assert said in ended.stderr
