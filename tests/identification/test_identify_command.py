"""`enginediag identify` on a toy engine: files, report, exit codes."""

from __future__ import annotations

import csv

import numpy as np
import pytest
from click.testing import CliRunner
from identification_toy import PARAMETERS, TRUTH, ToyEngine, fly, health

from enginediag_cli.cli.model import identify
from enginediag_cli.errors import ExitCode, UsageError
from enginediag_cli.identification.nominal_file import engine_file, read_nominal, refuse_changed_engine


def write_csv(path, recording):
    names = list(recording.columns)
    with open(path, "w", newline="", encoding="utf-8") as stream:
        stream.write("# enginediag: toy\n")
        writer = csv.writer(stream)
        writer.writerow(names)
        writer.writerows(np.column_stack([recording.columns[c] for c in names]).tolist())


@pytest.fixture
def folder(tmp_path, monkeypatch):
    """A folder with an engine file, two healthy flights, and a toy that stands for the engine."""
    (tmp_path / "configs").mkdir()
    (tmp_path / "configs" / "toy.yaml").write_text("kind: engine\n", encoding="utf-8")
    rng = np.random.default_rng(0)
    for name in ("day1.csv", "day2.csv"):
        write_csv(tmp_path / name, fly(ToyEngine(), rng, 150))
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr("enginediag_cli.physics.engine_file.load_engine", lambda path: ToyEngine())
    return tmp_path


def run(*arguments, **options):
    return CliRunner().invoke(identify, arguments, standalone_mode=False, catch_exceptions=False, **options)


def test_the_nominal_file_holds_the_engine_and_finds_its_file_again(folder):
    result = run("configs/toy.yaml", "day1.csv", "day2.csv", "-o", "nominal.yaml")
    assert result.return_value == ExitCode.DONE
    assert result.stdout == ""
    nominal = read_nominal("nominal.yaml")
    for e in nominal.estimates:
        assert abs(e.value - TRUTH[e.name]) < 4 * e.standard_error, e
    assert nominal.engine_path == "configs/toy.yaml"
    refuse_changed_engine(nominal, engine_file(nominal, "nominal.yaml"))
    assert nominal.records["used"] == 300
    assert nominal.provenance["recording 2"].startswith("day2.csv sha256:")


def test_the_same_run_gives_the_same_bytes_on_standard_output(folder):
    first, second = (run("configs/toy.yaml", "day1.csv", "--no-cross-validation").stdout for _ in range(2))
    assert first == second
    assert first.startswith("# Nominal engine")


def test_the_report_goes_to_standard_error_with_fit_parameters_and_records(folder):
    report = run("configs/toy.yaml", "day1.csv", "day2.csv", "--holdout", "0.3", "-o", "n.yaml").stderr
    assert "210 records of 2 recordings used; none excluded" in report
    assert "cross-validated over 8 folds" in report
    table = [line.split() for line in report.splitlines()]
    t3 = next(row for row in table if row[:2] == ["T3_K", "all"])
    assert t3[4] == t3[6] == t3[8] == "K"  # in sample, cross-validated, held out
    assert any(row[:1] == ["hpc.efficiency"] and row[-1] == "identified" for row in table)


def test_quiet_says_nothing(folder):
    assert run("configs/toy.yaml", "day1.csv", "-q", "--no-cross-validation", "-o", "n.yaml").stderr == ""


def test_what_stayed_at_its_prior_is_named_but_not_quoted(folder, monkeypatch):
    sensors = {s: v for s, v in ToyEngine().sensors.items() if s in ("T3_K", "P3_Pa")}
    monkeypatch.setattr("enginediag_cli.physics.engine_file.load_engine", lambda path: ToyEngine(sensors=sensors))
    report = run("configs/toy.yaml", "day1.csv", "-o", "n.yaml", "--no-cross-validation").stderr
    assert "not found by these recordings, left at what was assumed: hpt.efficiency" in report
    assert not any(line.startswith("hpt.efficiency") for line in report.splitlines())


def test_no_convergence_is_exit_code_3_and_writes_nothing(folder, monkeypatch):
    broken = ToyEngine(fails=lambda u, p: u["N1_pct"] > 70)
    monkeypatch.setattr("enginediag_cli.physics.engine_file.load_engine", lambda path: broken)
    result = run("configs/toy.yaml", "day1.csv", "-o", "n.yaml")
    assert result.return_value == ExitCode.NO_VERDICT
    assert not (folder / "n.yaml").exists()
    assert "no nominal state" in result.stderr and "flow balance did not converge" in result.stderr


def test_the_last_recording_can_judge_the_fit(folder):
    run("configs/toy.yaml", "day1.csv", "day2.csv", "--holdout-last", "--no-cross-validation", "-o", "n.yaml")
    nominal = read_nominal("n.yaml")
    assert nominal.records["used"] == 150
    assert {q.n for q in nominal.held_out if q.regime == "all"} == {150}
    assert nominal.provenance["held out"] == "the last recording"


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (("--holdout", "0.3", "--holdout-last"), "exclude each other"),
        (("--holdout-last",), "at least two recordings"),
        (("-o", "nowhere/n.yaml"), "there is no folder"),
    ],
)
def test_wrong_usage_is_said_before_the_work(folder, arguments, words):
    import click

    with pytest.raises((click.UsageError, UsageError), match=words):
        run("configs/toy.yaml", "day1.csv", *arguments)


def test_masked_readings_are_counted(folder):
    recording = fly(ToyEngine(), np.random.default_rng(1), 150)
    recording.columns["T3_K"][[3, 50]] = np.nan
    write_csv("gaps.csv", recording)
    report = run("configs/toy.yaml", "gaps.csv", "--no-cross-validation", "-o", "n.yaml").stderr
    assert "gaps.csv: T3_K: 2 of 150 readings masked (missing 2)" in report


def test_the_same_flight_under_two_names_counts_once_and_is_told(folder):
    with open("day1.csv", encoding="utf-8") as stream, open("copy.csv", "w", encoding="utf-8") as copy:
        copy.write("# copied\n" + stream.read())
    once = run("configs/toy.yaml", "day1.csv", "--no-cross-validation", "-o", "once.yaml")
    twice = run("configs/toy.yaml", "day1.csv", "copy.csv", "--no-cross-validation", "-o", "twice.yaml")
    assert "counted once" in twice.stderr and "counted once" not in once.stderr
    assert read_nominal("twice.yaml").estimates == read_nominal("once.yaml").estimates


def bounded(monkeypatch, **limits):
    """The toy with the compressor's efficiency confined to `limits`; flown, it lies at 0.985."""
    narrow = (health("hpc.efficiency", **limits), *PARAMETERS[1:])
    monkeypatch.setattr("enginediag_cli.physics.engine_file.load_engine", lambda path: ToyEngine(parameter_list=narrow))


def test_a_parameter_that_the_records_push_against_its_bound_is_no_success(folder, monkeypatch):
    bounded(monkeypatch, lower=0.998)
    result = run("configs/toy.yaml", "day1.csv", "--no-cross-validation", "-o", "nominal.yaml")
    assert result.return_value == ExitCode.NO_VERDICT
    assert "hpc.efficiency at its lower bound 0.998; nothing is written" in " ".join(result.stderr.split())
    assert not (folder / "nominal.yaml").exists()


def test_a_bound_is_written_when_it_is_asked_for(folder, monkeypatch):
    bounded(monkeypatch, lower=0.998)
    result = run("configs/toy.yaml", "day1.csv", "--no-cross-validation", "--allow-bounds", "-o", "nominal.yaml")
    assert result.return_value == ExitCode.DONE
    assert {e.status for e in read_nominal("nominal.yaml").estimates if e.name == "hpc.efficiency"} == {"at bound"}
