"""Parquet by the command line: what comes in and goes out is what it is as CSV."""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
import pytest
from known_engine import climb, recorded, write_known

from enginediag_cli.physics.engine_file import load_engine
from enginediag_cli.recordings.read import read_all
from enginediag_cli.recordings.table import Recording
from enginediag_cli.recordings.write import open_recording_output, write_csv
from enginediag_cli.shipped import shipped

N = 120


def test_without_pyarrow_nothing_is_begun_and_the_mending_told(run, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setitem(sys.modules, "pyarrow", None)
    Path("f.parquet").write_bytes(b"PAR1")
    for line in (
        "simulate turbofan.yaml -o x.parquet",
        "simulate turbofan.yaml -o x.csv --truth x.parquet",
        "check f.parquet",
        "recorder f.parquet",
        "locate turbofan.yaml f.parquet",
    ):
        ended = run(*line.split())
        assert ended.exit_code == 2
        assert "pip install 'enginediag[parquet]', or " in ended.stdout + ended.stderr
    assert [p.name for p in Path().iterdir()] == ["f.parquet"]


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """nominal.yaml, and one recording as csv/rec, and as parquet/rec: gaps, a wild reading, three flights."""
    pytest.importorskip("pyarrow", reason="needs pyarrow: pip install 'enginediag[parquet]'")
    folder = tmp_path_factory.mktemp("parquet")
    path = shipped("turbofan.yaml")
    engine, rng = load_engine(path), np.random.default_rng(7001)
    inputs = climb(engine, N)
    readings = recorded(engine, inputs, {"hpc.efficiency": 0.98}, rng)
    readings["T3_K"][7::11] = np.nan
    readings["P3_Pa"][20] = 1e9
    flight = ["1"] * 40 + ["2"] * 40 + ["3"] * 40
    recording = Recording(readings, {"flight": flight})
    (folder / "csv").mkdir()
    (folder / "parquet").mkdir()
    write_csv(folder / "csv" / "rec", [recording], ["seed: 7001"], digits=17)
    with open_recording_output(folder / "rec.parquet", ["seed: 7001"]) as writer:
        writer.write(recording)
    (folder / "rec.parquet").rename(folder / "parquet" / "rec")
    write_known(engine, path, inputs, folder / "nominal.yaml")
    return folder


@pytest.mark.parametrize(
    "line", ["residual --sensors", "residual --what records", "residual --window 30", "detect", "detect --window 5min"]
)
def test_a_recording_gives_the_same_bytes_in_both_formats(folder, run, monkeypatch, line):
    told = []
    for form in ("csv", "parquet"):
        monkeypatch.chdir(folder / form)
        told.append(run(*line.split(), "-n", "../nominal.yaml", "rec"))
    assert told[0].exit_code == 0 and told[0] == told[1]


@pytest.mark.slow
def test_statistics_and_trends_go_from_command_to_command_in_parquet(folder, run, monkeypatch, tmp_path):
    monkeypatch.chdir(folder / "csv")
    for name in ("s.parquet", "s.csv"):
        options = ["--sensors", "--window", "40", "-o", str(tmp_path / name)]
        assert run("residual", "-n", "../nominal.yaml", *options, "rec").exit_code == 0
    monkeypatch.chdir(tmp_path)
    Path("a").mkdir()
    Path("b").mkdir()
    Path("s.parquet").rename("a/s")
    Path("s.csv").rename("b/s")
    for command in ("isolate", "trend", "detect"):
        told = [run(command, f"{where}/s") for where in "ab"]
        assert told[0].exit_code == 0 and told[0].stdout == told[1].stdout
    assert run("isolate", "a/s", "-o", "i.parquet").exit_code == 0
    from_csv = run("isolate", "a/s").stdout
    import pyarrow.parquet as pq

    table = pq.read_table("i.parquet")
    assert table.schema.metadata[b"enginediag"].decode().startswith("enginediag: ")
    assert table.column_names == next(x for x in from_csv.splitlines() if x[0] != "#").split(",")


def test_a_row_of_statistics_edited_in_parquet_is_refused(folder, run, monkeypatch, tmp_path):
    import pyarrow as pa
    import pyarrow.parquet as pq

    monkeypatch.chdir(folder / "csv")
    run("residual", "-n", "../nominal.yaml", "-o", str(tmp_path / "s.parquet"), "rec")
    table = pq.read_table(tmp_path / "s.parquet")
    k = table.column_names.index("chi2")
    other = pa.array([x + 1.0 for x in table.column("chi2").to_pylist()])
    pq.write_table(table.set_column(k, "chi2", other), tmp_path / "s.parquet")
    ended = run("isolate", str(tmp_path / "s.parquet"))
    assert ended.exit_code == 2 and "checksum does not fit" in ended.stderr


def test_simulated_recordings_and_their_truth_hold_what_csv_holds_to_ten_digits(folder, run, monkeypatch, tmp_path):
    monkeypatch.chdir(tmp_path)
    for suffix in ("csv", "parquet"):
        line = f"simulate turbofan.yaml --records 30 --seed 7001 -o r.{suffix} --truth t.{suffix}"
        assert run(*line.split()).exit_code == 0
    for name in "rt":
        ours, theirs = read_all(f"{name}.parquet"), read_all(f"{name}.csv")
        assert (ours.order, ours.text, ours.provenance) == (theirs.order, theirs.text, theirs.provenance)
        for column in theirs.columns:
            np.testing.assert_allclose(ours[column], theirs[column], rtol=5e-10)
    head = run("simulate", "turbofan.yaml", "--records", "2", "--no-header", "-o", "n.parquet")
    assert head.exit_code == 0 and read_all("n.parquet").provenance == ()
    chosen = run("simulate", "turbofan.yaml", "--records", "2", "--columns", "T3_K,flight", "-o", "c.parquet")
    assert chosen.exit_code == 0 and read_all("c.parquet").order == ("T3_K", "flight")


def test_a_flight_that_is_followed_may_be_a_parquet_file_which_is_whole(folder, run, monkeypatch):
    told = []
    for form in ("csv", "parquet"):
        monkeypatch.chdir(folder / form)
        told.append(run("detect", "-n", "../nominal.yaml", "--follow", "--idle", "0", "rec"))
    assert told[0].exit_code == 0 and told[0] == told[1]


def test_a_parquet_file_in_a_pipe_is_refused_with_what_to_do(folder, shell):
    import subprocess

    with open(folder / "parquet" / "rec", "rb") as stream:
        ended = subprocess.run(
            [sys.executable, "-m", "enginediag_cli", "check", "-"], stdin=stream, capture_output=True, text=True
        )
    assert ended.returncode == 2
    assert "<stdin>: a Parquet file, in a pipe or packed" in ended.stdout + ended.stderr
