"""The command on the default engine, through the entry point that the shell uses."""

from __future__ import annotations

import csv
import json

import pytest
from simulation_toy import CONFIGS

from enginediag_cli.__main__ import main

ENGINE = str(CONFIGS / "turbofan.yaml")
SNAPSHOTS = str(CONFIGS / "flights" / "snapshots.yaml")


def fault(name: str) -> str:
    return str(CONFIGS / "faults" / f"{name}.yaml")


def run(tmp_path, *arguments: str, name: str = "out.csv") -> list[dict[str, str]]:
    path = tmp_path / name
    six = ["--flight", SNAPSHOTS, "--flights", "6"]
    assert main(["simulate", ENGINE, *six, *arguments, "-o", str(path)]) == 0
    with open(path, encoding="utf-8") as stream:
        return list(csv.DictReader(line for line in stream if not line.startswith("#")))


def test_a_recording_has_labels_inputs_sensors_and_status(tmp_path):
    rows = run(tmp_path)
    assert list(rows[0])[:7] == ["flight", "time_s", "phase", "altitude_m", "mach", "dT_isa_K", "Wf_kg_s"]
    assert len(rows) == 12 and {row["status"] for row in rows} == {"ok"}
    assert 600 < float(rows[0]["T3_K"]) < 900


def test_same_seed_gives_same_bytes_and_another_seed_others(tmp_path):
    for name, seed in (("a", "4"), ("b", "4"), ("c", "5")):
        run(tmp_path, "--seed", seed, name=name)
    a, b, c = ((tmp_path / name).read_bytes() for name in "abc")
    assert a == b != c


def test_the_same_seed_flies_the_same_flights_with_and_without_a_fault(tmp_path):
    healthy = run(tmp_path, name="a.csv")
    faulty = run(tmp_path, "--fault", fault("hpc_damage"), name="b.csv")
    assert [row["Wf_kg_s"] for row in healthy] == [row["Wf_kg_s"] for row in faulty]
    # the damage is there from flight 3 on: the first four records are the same, the others hotter
    assert healthy[:4] == faulty[:4]
    assert all(float(f["T45_K"]) > float(h["T45_K"]) for h, f in zip(healthy[4:], faulty[4:], strict=True))


def test_the_truth_goes_to_its_own_file_and_not_into_the_recording(tmp_path):
    truth = tmp_path / "truth.csv"
    rows = run(tmp_path, "--fault", fault("hpc_and_T3"), "--truth", str(truth))
    assert not any("hpc" in column or "bias" in column for column in rows[0])
    true = list(csv.DictReader(line for line in truth.open() if not line.startswith("#")))
    assert float(true[0]["hpc.efficiency"]) == 1.0 and float(true[-1]["hpc.efficiency"]) == 0.99
    assert float(true[-1]["sensor.T3_K.bias"]) == -4.0


def test_conditions_of_a_recording_give_its_readings_again_without_noise(tmp_path):
    rows = run(tmp_path, "--noise", "none")
    again = tmp_path / "again.csv"
    options = ["--conditions", str(tmp_path / "out.csv"), "--noise", "none", "--no-header"]
    assert main(["simulate", ENGINE, *options, "-o", str(again)]) == 0
    for row, other in zip(rows, csv.DictReader(again.open()), strict=True):
        assert float(other["P3_Pa"]) == pytest.approx(float(row["P3_Pa"]), rel=1e-7)
        assert other["phase"] == row["phase"]


def test_an_empty_input_keeps_its_row_and_is_counted_on_stderr(tmp_path, capfd):
    conditions = tmp_path / "c.csv"
    conditions.write_text("altitude_m,mach,dT_isa_K,Wf_kg_s\n0,0.2,0,2.0\n0,0.2,0,\n")
    assert main(["simulate", ENGINE, "--conditions", str(conditions), "--no-header", "--format", "csv"]) == 0
    out, err = capfd.readouterr()
    rows = list(csv.DictReader(out.splitlines()))
    assert [row["status"] for row in rows] == ["ok", "invalid-input"] and rows[1]["T3_K"] == ""
    assert "1 of 2 records: Wf_kg_s is nan" in err


def test_header_names_seed_and_files_and_no_header_leaves_them_out(tmp_path):
    run(tmp_path, "--seed", "9", "--fault", fault("fan_damage"))
    head = (tmp_path / "out.csv").read_text()
    assert "# seed: 9\n" in head and "# config: fan_damage.yaml sha256:" in head
    run(tmp_path, "--no-header")
    assert (tmp_path / "out.csv").read_text().startswith("flight,")


def test_json_holds_the_same_records(tmp_path):
    assert main(["simulate", ENGINE, "--records", "3", "-q", "-o", str(tmp_path / "a.json")]) == 0
    assert len(json.loads((tmp_path / "a.json").read_text())) == 3


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (["--flight", SNAPSHOTS, "--conditions", SNAPSHOTS], "exclude each other"),
        (["--conditions", SNAPSHOTS, "--flights", "3"], "--conditions brings its own"),
        (["--truth", "-"], "a file of its own"),
        (["--fault", SNAPSHOTS], "this is a file of kind 'flight'"),
    ],
)
def test_wrong_usage_ends_with_2_and_writes_nothing(tmp_path, capfd, arguments, said):
    path = tmp_path / "out.csv"
    assert main(["simulate", ENGINE, *arguments, "-o", str(path)]) == 2
    assert said in capfd.readouterr().err and not path.exists()


def test_a_misspelt_parameter_is_shown_with_place_and_near_name(tmp_path, capfd):
    path = tmp_path / "bad.yaml"
    path.write_text("kind: faults\nfaults:\n  - name: x\n    changes: {hpt.efficency: -0.01}\n")
    assert main(["simulate", ENGINE, "--fault", str(path), "-o", str(tmp_path / "o.csv")]) == 2
    err = capfd.readouterr().err
    assert f"{path}:4:15: error:" in err and "did you mean 'hpt.efficiency'?" in err
    assert sorted(p.name for p in tmp_path.iterdir()) == ["bad.yaml"]
