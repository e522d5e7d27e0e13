"""residual, detect and isolate as commands, on a turbofan whose nominal state is written by hand."""

from __future__ import annotations

import csv
import io
import json
import sys
from pathlib import Path

import numpy as np
import pytest
from known_engine import climb, recorded, write_known

from enginediag_cli.__main__ import main
from enginediag_cli.physics.engine_file import load_engine
from enginediag_cli.recordings.table import Recording
from enginediag_cli.recordings.write import write_csv

ENGINE = Path(__file__).parents[2] / "configs" / "turbofan.yaml"
N = 120


@pytest.fixture(scope="module")
def files(tmp_path_factory):
    """nominal.yaml and two recordings: healthy.csv, and faulty.csv with 2 % of HPC efficiency lost."""
    folder = tmp_path_factory.mktemp("windows")
    engine, rng = load_engine(ENGINE), np.random.default_rng(1)
    inputs = climb(engine, N)
    for name, health in (("healthy", {}), ("faulty", {"hpc.efficiency": 0.98})):
        write_csv(folder / f"{name}.csv", [Recording(recorded(engine, inputs, health, rng))])
    write_known(engine, ENGINE, inputs, folder / "nominal.yaml")
    return folder


@pytest.fixture
def run(files, capsys, monkeypatch, tmp_path):
    """`run(command, *arguments, stdin="")` with -n nominal.yaml filled in: exit code, rows, stderr."""

    def call(command, *arguments, nominal=True, stdin=""):
        piped = tmp_path / "stdin"
        piped.write_text(stdin)
        words = [str(files / a) if str(a).endswith(".csv") else str(a) for a in arguments]
        with open(piped) as stream:
            monkeypatch.setattr(sys, "stdin", stream)
            code = main([command, *(["-n", str(files / "nominal.yaml")] if nominal else []), *words])
        out, err = capsys.readouterr()
        body = [line for line in io.StringIO(out) if not line.startswith("#")]
        rows = list(csv.DictReader(body)) if "json" not in arguments else json.loads(out)
        return code, rows, err, out

    return call


def test_a_healthy_engine_is_healthy_and_a_faulty_one_is_found_and_told_by_the_exit_code(run):
    code, rows, err, _ = run("detect", "healthy.csv", "--exit-code")
    assert (code, [r["verdict"] for r in rows]) == (0, ["healthy"])
    assert "1 healthy" in err
    assert run("detect", "faulty.csv")[0] == 0
    code, rows, _, _ = run("detect", "faulty.csv", "--exit-code")
    assert (code, rows[0]["verdict"], rows[0]["alarm"]) == (1, "fault", "true")


def test_windows_give_one_row_each_with_their_lines_and_times(run):
    rows = run("detect", "faulty.csv", "--window", "60", "--step", "30")[1]
    assert [(r["first_line"], r["last_line"], r["start_s"]) for r in rows] == [
        ("2", "61", "0.0"),
        ("32", "91", "300.0"),
        ("62", "121", "600.0"),
    ]
    assert len(run("detect", "faulty.csv", "--window", "10min")[1]) == 2


def test_the_lost_efficiency_is_isolated_with_its_size_and_told_in_words(run):
    _, rows, err, _ = run("isolate", "faulty.csv")
    assert rows[0]["parameter"] == "hpc.efficiency"
    assert float(rows[0]["lower"]) < -0.02 < float(rows[0]["upper"])
    assert "HPC isentropic efficiency fell by" in err


@pytest.mark.parametrize("method", ["incremental", "sensitivity", "minmax"])
def test_every_method_can_be_chosen(run, method):
    assert "hpc.efficiency" in run("isolate", "faulty.csv", "--method", method, "--faults", "1")[1][0]["isolated"]


NUMBERS = {"fit", "fit_before", "explained", "unlisted", "probability", "inclusion"}
NUMBERS |= {"change", "lower", "upper", "percent", "rivals"}


def test_a_drift_is_named_from_statistics_as_from_the_recording(run, files):
    engine = load_engine(ENGINE)
    table = recorded(engine, climb(engine, N), {}, np.random.default_rng(4))
    hours = 10.0 * np.arange(N) / 3600
    write_csv(files / "drift.csv", [Recording(table | {"time_s": 3600 * hours, "P3_Pa": table["P3_Pa"] + 4e4 * hours})])
    statistics = run("residual", "drift.csv", "--sensors")[3]
    direct, piped = run("isolate", "drift.csv")[1], run("isolate", "-", nominal=False, stdin=statistics)[1]
    assert direct[0]["isolated"] == piped[0]["isolated"] == "sensor.P3.drift"
    assert float(piped[0]["change"]) == pytest.approx(float(direct[0]["change"]), rel=0.02)


def test_statistics_through_a_pipe_give_the_same_answers_without_the_nominal_file(run):
    statistics = run("residual", "faulty.csv", "--sensors")[3]
    direct, piped = run("isolate", "faulty.csv")[1], run("isolate", "-", nominal=False, stdin=statistics)[1]
    # recordings are at hand for the full model, statistics are not
    different = {k for k in direct[0] if direct[0][k] != piped[0][k]}
    assert len(piped) == len(direct) == 1 and different <= NUMBERS, different
    for k in different - {"rivals", "unlisted"}:
        assert float(piped[0][k]) == pytest.approx(float(direct[0][k]), rel=0.05), k
    statistics = run("residual", "faulty.csv")[3]
    code, rows, err, _ = run("isolate", "-", nominal=False, stdin=statistics)
    assert code == 0 and rows == run("isolate", "faulty.csv", "--no-sensors")[1]
    assert "hold no errors of sensors" in err
    assert "hold no errors" not in run("isolate", "-", "--no-sensors", nominal=False, stdin=statistics)[2]
    direct, piped = run("detect", "faulty.csv")[1], run("detect", "-", nominal=False, stdin=statistics)[1]
    for row in (*direct, *piped):
        del row["gross_readings"]  # statistics do not hold how many readings were rejected
    assert piped == direct


def test_a_recording_through_a_pipe_needs_the_nominal_file(run, files):
    recording = (files / "healthy.csv").read_text()
    assert run("detect", "-", stdin=recording)[1][0]["verdict"] == "healthy"
    code, _, err, _ = run("detect", "-", nominal=False, stdin=recording)
    assert code == 2 and "--nominal" in err


def test_residuals_record_by_record_are_in_units_and_in_sigmas(run):
    rows = run("residual", "healthy.csv", "--what", "records")[1]
    assert len(rows) == N and {r["state"] for r in rows} <= {"ok", "outside the maps"}
    sigmas = np.array([float(r["T3_K:sigmas"]) for r in rows])
    assert 0.8 < sigmas.std() < 1.2
    ratio = np.array([float(r["T3_K:residual"]) for r in rows]) / sigmas
    assert np.ptp(ratio) < 1e-6 * ratio[0]


def test_the_smallest_detectable_changes_are_columns_in_the_parameters_units(run):
    (row,) = run("detect", "healthy.csv", "--detectable")[1]
    sizes = {c: float(v) for c, v in row.items() if c.startswith("detectable:")}
    assert len(sizes) == 11 and 1e-4 < sizes["detectable:hpc.efficiency"] < 0.02


def test_silence_that_would_hide_what_matters_is_no_verdict_and_json_has_the_power(run):
    code, rows, _, _ = run("detect", "healthy.csv", "--must-show", "*=0.0005", "--format", "json")
    (row,) = rows
    assert (code, row["verdict"], row["alarm"]) == (3, "no verdict", False)
    assert "too few records" in row["reason"] and "0.05 % must" in row["reason"]
    assert row["detectable:fan.efficiency"] > 0.0005  # JSON has it unasked
    # what a window would have shown grows as the root of the records falls: one record says nothing of a small change
    few = run("detect", "healthy.csv", "--window", "1", "--must-show", "*=0.002")[1]
    assert {r["verdict"] for r in few if r["alarm"] == "false"} == {"no verdict"}
    assert run("detect", "healthy.csv", "--window", "1", "--must-show", "none")[1][0]["verdict"] == "healthy"
    assert run("detect", "faulty.csv", "--must-show", "*=0.0005")[1][0]["verdict"] == "fault"  # an alarm stands
    code, _, err, _ = run("detect", "healthy.csv", "--must-show", "hpc.eficiency=0.01")
    assert code == 2 and "hpc.efficiency" in err
    for wrong in ("hpc.efficiency", "hpc.efficiency=-1", "=0.01", "x=nan"):
        assert run("detect", "healthy.csv", "--must-show", wrong)[0] == 2


def test_a_sensor_fault_can_be_monitored_too(run):
    rows = run("residual", "healthy.csv", "--monitor", "hpc.*efficiency", "--monitor", "sensor.T3.bias")[1]
    assert {c for c in rows[0] if c.startswith("s:")} == {"s:hpc.efficiency", "s:sensor.T3.bias"}
    code, _, err, _ = run("residual", "healthy.csv", "--monitor", "hpc.eficiency")
    assert code == 2 and "hpc.efficiency" in err


def test_records_that_nobody_has_seen_are_no_verdict_and_exit_3(run, files, tmp_path):
    text = (files / "healthy.csv").read_text().splitlines()
    altitude = text[0].split(",").index("altitude_m")
    far = [line.split(",") for line in text[1:]]
    for cells in far:
        cells[altitude] = "16000"
    text_far = "\n".join([text[0], *map(",".join, far)]) + "\n"
    code, rows, err, _ = run("detect", "-", "--accept-mismatch", stdin=text_far)
    assert code == 3 and rows[0]["verdict"] == "no verdict"
    assert "outside the operating points identified" in rows[0]["reason"] and f"{N} records outside" in err


def test_a_missing_input_column_is_trouble_and_names_it(run, files):
    text = (files / "healthy.csv").read_text().replace("mach", "Mach")
    code, _, err, _ = run("detect", "-", stdin=text)
    assert code == 2 and "no column mach" in err and "Traceback" not in err


@pytest.mark.parametrize(
    "arguments",
    [
        ("--window", "ten"),
        ("--window", "5", "--step", "9"),
        ("--step", "5"),
        ("--false-alarm", "0"),
        ("--method", "guess"),
    ],
)
def test_options_that_make_no_sense_are_usage_errors(run, arguments):
    assert run("isolate", "healthy.csv", *arguments)[0] == 2


def test_json_holds_lists_and_numbers(run):
    (row,) = run("isolate", "faulty.csv", "--format", "json")[1]
    assert row["isolated"] == ["hpc.efficiency"] and isinstance(row["change"], float)


def test_a_file_without_records_is_no_verdict_and_exit_3_in_every_command(run, files):
    header = (files / "healthy.csv").read_text().splitlines()[0] + "\n"
    for words in (("detect",), ("detect", "--exit-code"), ("isolate",), ("trend",), ("residual",)):
        assert run(*words, "-", stdin=header)[0] == 3, words
    statistics = run("residual", "faulty.csv")[3].split("\n")
    head = "\n".join(line for line in statistics[:10] if line.startswith(("#", "source")))
    assert run("detect", "-", nominal=False, stdin=head + "\n")[0] == 3


def test_a_recorder_that_stands_still_is_no_verdict_and_never_a_fault(run, files):
    lines = (files / "healthy.csv").read_text().splitlines()
    still = "\n".join([lines[0], *[lines[40]] * 60]) + "\n"
    code, rows, err, _ = run("detect", "-", "--exit-code", stdin=still)
    assert (code, rows[0]["verdict"]) == (3, "no verdict") and "the recorder was frozen" in err


def without_columns(text, *columns):
    cells = [line.split(",") for line in text.splitlines()]
    kept = [k for k, name in enumerate(cells[0]) if name not in columns]
    return "\n".join(",".join(row[k] for k in kept) for row in cells) + "\n"


def test_rows_say_how_many_sensors_were_judged_and_one_alone_is_no_verdict(run, files):
    text = (files / "healthy.csv").read_text()
    sensors = [
        c for c in text.split("\n")[0].split(",") if c not in ("altitude_m", "mach", "dT_isa_K", "Wf_kg_s", "time_s")
    ]
    m = str(len(sensors))
    for lost in (0, 1, len(sensors) - 1):
        row = run("detect", "-", stdin=without_columns(text, *sensors[:lost]))[1][0]
        assert (row["sensors"], row["sensors_of"]) == (str(len(sensors) - lost), m)
        assert (row["verdict"] == "no verdict") == (lost == len(sensors) - 1)


def test_a_sensor_without_a_column_is_no_rival_of_what_is_isolated(run, files):
    text = (files / "faulty.csv").read_text()
    assert any("sensor.T3.bias" in str(row) for row in run("isolate", "-", "--coverage", "0.9999", stdin=text)[1])
    found = run("isolate", "-", "--coverage", "0.9999", "--nonlinear", "always", stdin=without_columns(text, "T3_K"))
    assert found[0] == 0 and not any("sensor.T3" in str(row) for row in found[1])


def test_statistics_put_together_are_read_and_given_twice_are_told(run):
    first, second = (run("residual", f"{name}.csv")[3] for name in ("healthy", "faulty"))
    rows = run("detect", "-", nominal=False, stdin=first + second)[1]
    assert [row["verdict"] for row in rows] == ["healthy", "fault"]
    code, rows, err, _ = run("detect", "-", nominal=False, stdin=second * 3)
    assert code == 0 and len(rows) == 1 and "2 rows of statistics given twice" in err


@pytest.mark.parametrize(
    "option",
    [("--window", "10"), ("--linearise", "nominal"), ("--monitor", "hpc.*"), ("--reference", "5"), ("--last", "5")],
)
def test_an_option_that_statistics_would_ignore_is_refused(run, option):
    statistics = run("residual", "faulty.csv")[3]
    code, _, err, out = run("detect", "-", *option, nominal=False, stdin=statistics)
    assert code == 2 and out == "" and f"{option[0]} would do nothing" in err


def test_a_nominal_beside_statistics_must_be_theirs(run, files, tmp_path):
    statistics = run("residual", "faulty.csv")[3]
    assert run("detect", "-", stdin=statistics)[1][0]["verdict"] == "fault"
    other = tmp_path / "nominal.yaml"
    text = (files / "nominal.yaml").read_text().replace("rho1: 0.0", "rho1: 0.1")
    other.write_text("".join(line for line in text.splitlines(True) if not line.startswith("checksum")))
    code, _, err, _ = run("detect", "-n", other, "-", nominal=False, stdin=statistics)
    assert code == 2 and "another nominal" in err


def test_an_edited_nominal_is_trouble_and_names_its_place(run, files, tmp_path):
    edited = tmp_path / "nominal.yaml"
    edited.write_text((files / "nominal.yaml").read_text().replace("rho1: 0.0", "rho1: 0.1", 1))
    code, _, err, _ = run("detect", "-n", edited, "healthy.csv", nominal=False)
    assert code == 2 and "edited after identify wrote it" in err and "nominal.yaml:" in err
