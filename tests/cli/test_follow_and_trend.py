"""`detect --follow` and `trend` as commands, on the turbofan."""

from __future__ import annotations

import csv
import io
import json
import sys
from pathlib import Path

import pytest
import yaml

from enginediag_cli.__main__ import main
from enginediag_cli.recordings.recorder_file import load_recorder
from enginediag_cli.units import split_column

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
    identify = ["identify", ENGINE, paths["healthy.csv"], "--no-cross-validation", "-q", "-o", paths["nominal.yaml"]]
    assert run(*identify)[0] == 0
    faulty = ["--flights", "5", "--seed", "4", "--fault", str(folder / "fault.yaml"), "-o", paths["flown.csv"]]
    assert run(*plain, *faulty)[0] == 0
    return paths


def test_follow_gives_a_row_per_block_and_an_alarm_in_faulty_flights_only(files):
    code, out = run(
        "detect",
        "--follow",
        "--idle",
        "0",
        "--window",
        "100",
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
    assert {row["kind"] for row in rows if row["flight"] == "5"} - {""} <= {"from start", "cannot tell"}


def test_follow_refuses_what_it_cannot_do_and_says_why(files, capsys):
    follow = ["detect", "--follow", "-n", files["nominal.yaml"], files["flown.csv"]]
    for options in (
        ["--step", "5", "--window", "50"],
        ["--detectable"],
        ["--reference", "9"],
        ["--last", "9"],
    ):
        assert run(*follow, *options)[0] == 2
        assert f"{options[0]} does not go with --follow: " in capsys.readouterr().err
    assert run("detect", "--follow", files["flown.csv"])[0] == 2


@pytest.mark.slow
def test_maps_that_are_said_to_be_poor_make_a_followed_flight_stand_out_less(files):
    follow = ["detect", "--follow", "--idle", "0", "--window", "200", "-q", "--no-header", "--format", "csv"]
    evidence = []
    for share in ("0.003", "0.1"):
        _, out = run(*follow, "-n", files["nominal.yaml"], files["flown.csv"], "--model-error", share)
        evidence.append(max(float(row["log10_e"]) for row in csv.DictReader(io.StringIO(out)) if row["log10_e"]))
    assert evidence[0] > 2 * evidence[1] > 0


@pytest.mark.slow
def test_a_foreign_recording_is_followed_as_its_recorder_maps_it(files, tmp_path):
    """The same flights under other names of columns; the recorder keeps what was recorded in flight."""
    lines = [line for line in Path(files["flown.csv"]).read_text(encoding="utf-8").splitlines() if line[0] != "#"]
    names = lines[0].split(",")
    shown = {name: f"x_{k}" for k, name in enumerate(names)}
    foreign, recorder = tmp_path / "foreign.csv", tmp_path / "recorder.yaml"
    foreign.write_text("\n".join([",".join(shown.values()), *lines[1:]]) + "\n", encoding="utf-8")
    numbers = {
        name: {"from": shown[name], "unit": split_column(name)[1] or "1"}
        for name in names
        if name not in ("flight", "phase", "status")
    }
    recorder.write_text(
        yaml.safe_dump(
            {
                "kind": "recorder",
                "description": "other names",
                "columns": numbers,
                "text": {"flight": shown["flight"]},
                "steady": {"window_s": 60, "minimum": {"mach": 0.2}, "spread": {"N1_rpm": 400}},
            }
        ),
        encoding="utf-8",
    )
    common = [
        "detect",
        "--follow",
        "--idle",
        "0",
        "--window",
        "50",
        "-n",
        files["nominal.yaml"],
        "--no-header",
        "--format",
        "csv",
    ]
    code, out = run(*common, "-q", str(foreign), "--recorder", str(recorder))
    rows = list(csv.DictReader(io.StringIO(out)))
    alarms = {row["flight"]: row["alarm"] for row in rows}
    assert code == 0 and alarms == {"1": "false", "2": "false", "3": "true", "4": "true", "5": "true"}
    whole = load_recorder(recorder).read(foreign)[0].recording
    assert sum(int(row["records"]) for row in rows) == len(whole) < len(lines) - 1


def test_one_engine_of_a_recording_can_be_chosen_without_a_recorder(files, tmp_path):
    lines = [line for line in Path(files["flown.csv"]).read_text(encoding="utf-8").splitlines() if line[0] != "#"]
    flight = lines[0].split(",").index("flight")
    named = [f"{line},{'A' if line.split(',')[flight] in '12' else 'B'}" for line in lines[1:]]
    both = tmp_path / "both.csv"
    both.write_text("\n".join([lines[0] + ",engine", *named]) + "\n", encoding="utf-8")
    common = ["-q", "-n", files["nominal.yaml"], "--engine-instance", "A", "--format", "json"]
    rows = json.loads(run("detect", *common, str(both))[1])
    assert [(row["engine"], row["flight"]) for row in rows] == [("A", "1"), ("A", "2")]
    assert run("detect", *common, files["flown.csv"])[0] == 2


@pytest.mark.slow
def test_trend_from_recordings_and_from_statistics_tells_the_same_change(files):
    """Statistics hold what is uncertain about nominal as noise of each flight: probabilities differ a little."""
    condense = ["residual", "-q", "--sensors", "-n", files["nominal.yaml"], files["flown.csv"]]
    assert run(*condense, "-o", files["statistics.csv"])[0] == 0
    direct = json.loads(run("trend", "-q", "-n", files["nominal.yaml"], files["flown.csv"], "--format", "json")[1])
    stored = json.loads(run("trend", "-q", files["statistics.csv"], "--format", "json")[1])
    for rows in (direct, stored):
        changed = [row for row in rows if row["kind"] != "steady" and row["probability"] > 0.5]
        assert {row["component"] for row in changed} == {"hpc"}
        (loss,) = (row for row in changed if row["parameter"] == "hpc.efficiency")
        assert (loss["parameter"], loss["kind"], loss["onset"], loss["onset_flight"]) == (
            "hpc.efficiency",
            "step",
            3,
            "3",
        )
        assert abs(loss["change"] + 0.02) < 0.004
    assert {row["parameter"] for row in direct} == {row["parameter"] for row in stored}


def test_trend_by_component_names_it_once(files):
    rows = json.loads(
        run("trend", "-q", "-n", files["nominal.yaml"], files["flown.csv"], "--by", "component", "--format", "json")[1]
    )
    assert [(row["components"], row["kind"], row["onset"]) for row in rows] == [(["hpc"], "step", 3)]


@pytest.mark.slow
def test_a_recording_without_flights_is_a_series_of_windows(files, tmp_path):
    """A step of the T3 reading in the middle of one long flight, without a column that tells flights."""
    lines = [line for line in Path(files["healthy.csv"]).read_text(encoding="utf-8").splitlines() if line[0] != "#"]
    names = lines[0].split(",")
    kept = [k for k, name in enumerate(names) if name not in ("flight", "phase", "status")]
    t3 = names.index("T3_K")
    rows = [line.split(",") for line in lines[1:]]
    half = len(rows) // 2
    for row in rows[half:]:
        row[t3] = f"{float(row[t3]) + 8:.4f}" if row[t3] else ""
    path = tmp_path / "long.csv"
    text = [",".join(names[k] for k in kept), *(",".join(row[k] for k in kept) for row in rows)]
    path.write_text("\n".join(text) + "\n", encoding="utf-8")
    found = json.loads(run("trend", "-q", "-n", files["nominal.yaml"], str(path), "--format", "json")[1])
    changed = [row for row in found if row["kind"] != "steady" and row["probability"] > 0.5]
    assert [(row["parameter"], row["kind"]) for row in changed] == [("sensor.T3.bias", "step")]
    assert abs(changed[0]["onset_line"] - (half + 2)) <= 20 and abs(changed[0]["change"] - 8) < 1.5


def test_trend_of_statistics_says_what_cannot_be_judged_without_a_nominal(files, capsys):
    condense = ["residual", "-q", "--sensors", "-n", files["nominal.yaml"], files["flown.csv"]]
    assert run(*condense, "-o", files["statistics.csv"])[0] == 0
    assert run("trend", files["statistics.csv"])[0] == 0
    assert "without --nominal it is not known which inputs are weather" in " ".join(capsys.readouterr().err.split())


@pytest.mark.slow
def test_a_series_that_differs_from_nominal_from_its_first_flight_is_never_steady(files, tmp_path, capsys):
    names, *rows = (line.split(",") for line in Path(files["flown.csv"]).read_text().splitlines() if line[0] != "#")
    k = names.index("T45_K")
    off = [[*row[:k], f"{float(row[k]) + 60.0}" if row[k] else "", *row[k + 1 :]] for row in rows]
    path = tmp_path / "off.csv"
    path.write_text("\n".join(",".join(row) for row in [names, *off]) + "\n", encoding="utf-8")
    words = ["trend", "--accept-mismatch", "-n", files["nominal.yaml"], str(path), "--format", "json"]
    code, out = run(*words)
    assert code == 0
    found = json.loads(out)
    assert found and "steady" not in {row["verdict"] for row in found}
    assert {"sensor.T45.bias"} <= {row["parameter"] for row in found if row["kind"] not in ("steady", "cannot tell")}
    assert "differs from nominal from the first flight on" in " ".join(capsys.readouterr().err.split())


def test_a_trend_of_some_parameters_alone_needs_no_direction_that_single_flights_do_not_show(files):
    code, out = run("trend", "-q", "-n", files["nominal.yaml"], files["flown.csv"], "--monitor", "hpc.*", "-f", "json")
    assert code == 0 and {"hpc.efficiency", "hpc.map.work_slope"} <= {row["parameter"] for row in json.loads(out)}


def test_more_flights_than_memory_should_hold_are_refused_with_what_to_do(files, monkeypatch, capsys):
    monkeypatch.setattr("enginediag_cli.detection.series.MOST_BYTES", 50e3)
    assert run("trend", "-n", files["nominal.yaml"], files["flown.csv"])[0] == 2
    assert "MB of memory; give fewer files at once" in capsys.readouterr().err
