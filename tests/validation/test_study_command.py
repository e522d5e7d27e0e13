"""Small studies through the command line: contract, determinism, resumption, interruption."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from enginediag_cli.__main__ import main
from enginediag_cli.validation.studies import StudyRunner, batches, load_study

ENGINE = Path(__file__).parents[2] / "configs" / "turbofan.yaml"

HEAD = f"""
kind: study
engine: {ENGINE}
records: 100
mission: {{type: sweep, altitude_m: [1500, 12000], mach: [0.3, 0.85], cas_kt: [200, 380], power: [0.5, 1.0]}}
noise: {{type: uniform, range_fraction: 0.001}}
methods:
  - {{name: posterior, type: posterior}}
  - {{name: known, type: sensitivity, linearise: nominal}}
false_alarm: 0.05
reliability: true
seed: 11
"""
# 103 repetitions of 100 records are two batches
SMALL = (
    HEAD
    + """
cases:
  - {name: strong, repetitions: 103, changes: {hpc.efficiency: -0.01, hpt.flow_capacity: 0.01}}
  - {name: healthy, repetitions: 10}
"""
)
OTHERS = (
    HEAD
    + """
cases:
  - {name: healthy, repetitions: 60}
  - {name: drawn, repetitions: 30, draw: {faults: [0, 2], size: [0.01, 0.015], sign: fall}}
"""
)


@pytest.fixture(scope="module")
def study_file(tmp_path_factory):
    path = tmp_path_factory.mktemp("study") / "small.yaml"
    path.write_text(SMALL, encoding="utf-8")
    return path


@pytest.fixture(scope="module")
def finished(study_file):
    """Result on one process, and the journal that it kept."""
    out, journal = study_file.with_name("one.json"), study_file.with_name("one.journal")
    assert run(study_file, "--processes", 1, "-o", out, "--journal", journal) == 0
    return json.loads(out.read_text(encoding="utf-8")), journal.read_text(encoding="utf-8")


def run(*arguments):
    return main(["study", "-q", *map(str, arguments)])


def without_times(result):
    return {what: value for what, value in result.items() if what != "timings"}


def law_entry(result, case, method):
    return next(e for e in result["cases"] if (e["case"], e["method"]) == (case, method))


def test_the_json_holds_counts_of_every_case_and_method(finished):
    result, _ = finished
    assert [(e["case"], e["method"]) for e in result["cases"]] == [
        (case, method) for case in ("strong", "healthy") for method in ("posterior", "known")
    ]
    for e in result["cases"]:
        assert {"repetitions", "detected", "exact", "contained", "parameter_counts"} <= set(e)
        assert 0 <= e["exact"] <= e["contained"] <= e["repetitions"]
        assert e["exact"] <= e["right_size"] and e["no_verdict"] == 0
        assert len(e["parameter_counts"]) == 11
        assert sum(e["parameter_counts"].values()) == pytest.approx(e["mean_size"] * e["repetitions"])
        assert all(c <= e["parameter_counts"][n] for n, c in e["parameter_counts_contained"].items())
        assert e["exact_rate"]["low"] <= e["exact"] / e["repetitions"] <= e["exact_rate"]["high"]
    assert [(t["case"], t["method"]) for t in result["timings"]] == [(e["case"], e["method"]) for e in result["cases"]]
    assert all(t["seconds_per_diagnosis"] > 0 for t in result["timings"])


def test_strong_faults_are_isolated_exactly(finished):
    e = law_entry(finished[0], "strong", "posterior")
    assert e["detected"] == e["repetitions"] == 103
    assert e["exact"] >= 98
    assert e["parameter_counts"]["hpc.efficiency"] == e["parameter_counts"]["hpt.flow_capacity"] == 103


@pytest.fixture(scope="module")
def others(tmp_path_factory):
    """Tallies of the healthy and of the drawn case, made in this process."""
    path = tmp_path_factory.mktemp("others") / "others.yaml"
    path.write_text(OTHERS, encoding="utf-8")
    study = load_study(path)
    laboratory = StudyRunner(study, study.seed)
    return [laboratory.run(batch)["posterior"] for batch in batches(study)]


def test_a_healthy_engine_alarms_as_often_as_asked_for(others):
    healthy, _ = others
    assert healthy.unchanged == healthy.repetitions == 60
    assert healthy.false_alarms == healthy.detected
    assert healthy.false_alarms <= 10  # binomial(60, 0.05) is larger with probability 0.0004


def test_drawn_faults_are_as_many_as_asked_for_and_found(others):
    _, drawn = others
    assert 2 <= drawn.unchanged <= 19  # binomial(30, 1/3), probability 0.999
    assert drawn.exact >= 26


def test_answers_with_a_stated_probability_are_put_into_bins(finished):
    bins = law_entry(finished[0], "strong", "posterior")["reliability"]
    assert sum(row["answers"] for row in bins) == 103
    assert sum(row["right"] for row in bins) == law_entry(finished[0], "strong", "posterior")["exact"]
    assert all(row["from"] <= row["stated"] <= row["to"] for row in bins)
    assert "reliability" not in law_entry(finished[0], "strong", "known")


def test_two_processes_give_the_same_counts_as_one(study_file, finished):
    out = study_file.with_name("two.json")
    assert run(study_file, "--processes", 2, "-o", out) == 0
    assert without_times(json.loads(out.read_text(encoding="utf-8"))) == without_times(finished[0])
    assert not out.with_name("two.json.journal").exists()


def test_a_study_goes_on_from_its_journal_to_the_identical_result(study_file, finished):
    result, journal = finished
    lines = journal.splitlines(keepends=True)
    out, kept = study_file.with_name("again.json"), study_file.with_name("again.json.journal")
    kept.write_text("".join(lines[:2]) + lines[2][:40], encoding="utf-8")  # the last line was being written
    assert run(study_file, "-o", out) == 0
    assert without_times(json.loads(out.read_text(encoding="utf-8"))) == without_times(result)


def test_a_finished_journal_gives_the_result_without_work(study_file, finished):
    result, journal = finished
    out, kept = study_file.with_name("done.json"), study_file.with_name("done.journal")
    kept.write_text(journal, encoding="utf-8")
    assert run(study_file, "-o", out, "--journal", kept) == 0
    assert json.loads(out.read_text(encoding="utf-8")) == result


def test_the_journal_of_another_study_is_refused(study_file, finished, capsys):
    other = study_file.with_name("other.yaml")
    other.write_text(SMALL.replace("seed: 11", "seed: 12"), encoding="utf-8")
    kept = study_file.with_name("kept.journal")
    kept.write_text(finished[1], encoding="utf-8")
    assert run(other, "--journal", kept) == 2
    assert "another study" in capsys.readouterr().err
    kept.write_text("time_s,T3_K\n1,2\n", encoding="utf-8")
    assert run(other, "--journal", kept) == 2
    assert "not the journal" in capsys.readouterr().err


@pytest.mark.slow
def test_an_interrupted_study_keeps_its_journal_and_no_output(study_file, tmp_path):
    many = tmp_path / "many.yaml"
    many.write_text(SMALL.replace("repetitions: 103", "repetitions: 6000"), encoding="utf-8")
    out, kept = tmp_path / "out.json", tmp_path / "out.json.journal"
    child = subprocess.Popen(
        [sys.executable, "-m", "enginediag_cli", "study", str(many), "-o", str(out), "--processes", "1"],
        stderr=subprocess.PIPE,
        text=True,
        # a background job of a shell without job control inherits SIGINT ignored
        preexec_fn=lambda: signal.signal(signal.SIGINT, signal.SIG_DFL),
    )
    patience = time.monotonic() + 60
    while time.monotonic() < patience and (not kept.exists() or kept.read_text().count("\n") < 2):
        time.sleep(0.05)
    os.kill(child.pid, signal.SIGINT)
    _, words = child.communicate(timeout=60)
    assert child.returncode == 130
    assert "goes on from there" in words and "Traceback" not in words
    assert not out.exists()
    assert all(json.loads(line) for line in kept.read_text(encoding="utf-8").splitlines())


def test_the_csv_of_counts_has_a_column_per_parameter(study_file, finished, capsys):
    kept = study_file.with_name("csv.journal")
    kept.write_text(finished[1], encoding="utf-8")
    assert run(study_file, "--journal", kept, "--format", "csv", "--show", "counts", "--no-header") == 0
    header, first, *_ = capsys.readouterr().out.splitlines()
    assert header.startswith("case,method,repetitions,fan.efficiency,")
    assert first.startswith("strong,posterior,103,")


def test_the_table_shows_rates_with_their_intervals(study_file, finished, capsys):
    kept = study_file.with_name("table.journal")
    kept.write_text(finished[1], encoding="utf-8")
    assert run(study_file, "--journal", kept, "--format", "table") == 0
    text = capsys.readouterr().out
    assert "100.0 (96.5–100.0)" in text
    assert run(study_file, "--journal", kept, "--format", "csv", "--show", "reliability") == 0
    assert "stated" in capsys.readouterr().out


@pytest.mark.parametrize(
    "old, new, words",
    [
        ("hpc.efficiency: -0.01", "hpc.eficiency: -0.01", "did you mean"),
        ("size: [0.01, 0.015]", "size: [0.01, 0.015], sigmas: [1, 2]", "not both"),
        ("faults: [0, 2]", "faults: [0, 12]", "more faults than the 11"),
        ("hpc.efficiency: -0.01", "hpc.efficiency: -0.9", "leaves its bounds"),
        (str(ENGINE), "nowhere.yaml", "no engine file"),
        ("type: sensitivity", "type: sensitive", "sensitivity"),
        ("type: uniform, range_fraction: 0.001", "type: none", "without noise"),
    ],
)
def test_mistakes_in_a_study_file_are_named(tmp_path, capsys, old, new, words):
    path = tmp_path / "wrong.yaml"
    path.write_text((OTHERS if old in OTHERS else SMALL).replace(old, new), encoding="utf-8")
    assert main(["check", str(path)]) == 2
    assert words in capsys.readouterr().err
