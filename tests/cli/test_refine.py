"""`explain` and `refine` as commands, and the refined engine in every other command."""

from __future__ import annotations

import json

import pytest
from refine_flights import ENGINE, flights, write_csv

from enginediag_cli.__main__ import main

LEFT_OUT = [
    f"--without={t}"
    for t in (
        "active_clearance_control",
        "bearing_loss",
        "thermocouple_radiation",
        "nozzle_discharge",
        "cooling_flow_variation",
        "reynolds_turbine_efficiency",
        "guide_vanes",
        "guide_vanes_load",
        "compressor_tip_clearance",
        "handling_bleed",
    )
]


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """A recording with a concealed effect, and the engine refined by it."""
    place = tmp_path_factory.mktemp("refine")
    write_csv(flights("reynolds_efficiency@hpc", {"exponent": 0.1}, seed=1)[0], place / "flights.csv")
    code = main(
        [
            "refine",
            str(ENGINE),
            str(place / "flights.csv"),
            "--term",
            "reynolds_efficiency@hpc",
            "--holdout-last",
            "2",
            "-q",
            "-o",
            str(place / "refined.yaml"),
            "--picture",
            str(place / "b.svg"),
            "--report",
            str(place / "report.json"),
        ]
    )
    assert int(code) == 0
    return place


def test_the_report_and_the_picture_show_before_and_after(folder):
    told = json.loads((folder / "report.json").read_text(encoding="utf-8"))
    assert told["refused"] is None and told["verdict"] == "accepted" and all(c["met"] for c in told["criteria"])
    assert told["chi2_per_reading"]["after"] < told["chi2_per_reading"]["before"]
    assert {"rms", "chi2 per reading", "false-alarm rate of detect"} <= {r["what"] for r in told["rows"]}
    assert told["detect"]["after"]["of"] > 0
    svg = (folder / "b.svg").read_text(encoding="utf-8")
    assert svg.startswith("<svg") and "T45_K" in svg and svg.rstrip().endswith("</svg>")


@pytest.mark.slow
def test_the_refined_engine_runs_in_every_other_command(folder, run):
    engine, flown, nominal = folder / "refined.yaml", folder / "flights.csv", folder / "nominal.yaml"
    assert run("check", engine).exit_code == 0
    assert run("simulate", engine, "--records", "40", "-o", folder / "more.csv").exit_code == 0
    assert run("identify", engine, flown, "--no-cross-validation", "-q", "-o", nominal).exit_code == 0
    assert run("residual", "-n", nominal, flown, "-q", "-o", folder / "statistics.csv").exit_code == 0
    assert run("detect", "-n", nominal, flown, "--exit-code", "-q").exit_code == 0
    assert run("isolate", folder / "statistics.csv", "-q").exit_code == 0


@pytest.mark.slow
def test_what_the_refined_engine_carries_is_not_searched_for_again(folder, run):
    done = run("explain", folder / "refined.yaml", folder / "flights.csv", "--format", "json", "--exit-code", *LEFT_OUT)
    told = json.loads(done.stdout)
    assert done.exit_code == 0 and told["status"] == "nothing"
    assert "reynolds_efficiency@hpc" not in {c["label"] for c in told["floor"]}
    again = run(
        "refine",
        folder / "refined.yaml",
        folder / "flights.csv",
        "--term",
        "reynolds_efficiency@hpc",
        "--holdout-last",
        "2",
        "-o",
        folder / "again.yaml",
    )
    assert again.exit_code == 2 and "carries it already" in again.stderr


@pytest.mark.slow
def test_explain_writes_rows_and_ends_with_1_on_request(folder, run):
    done = run("explain", ENGINE, folder / "flights.csv", "--format", "csv", "--no-header", "--exit-code", *LEFT_OUT)
    assert done.exit_code == 1
    head, row = done.stdout.splitlines()
    assert head.startswith("status,rank,kind,name") and row.startswith("named,1,effect,reynolds_efficiency@hpc")
    assert done.stderr.startswith("Missing: ")


def test_a_refusal_writes_nothing_and_ends_with_3(folder, run):
    write_csv(flights("", {}, seed=3)[0], folder / "healthy.csv")
    done = run(
        "refine",
        ENGINE,
        folder / "healthy.csv",
        "--term",
        "power_offtake@hp",
        "--holdout-last",
        "2",
        "-o",
        folder / "none.yaml",
    )
    assert done.exit_code == 3 and "is not written" in done.stderr
    assert not (folder / "none.yaml").exists()


def test_refine_must_be_told_what_to_judge_by(folder, run):
    for wrong in ([], ["--holdout-last", "1", "--test", str(folder / "flights.csv")]):
        done = run("refine", ENGINE, folder / "flights.csv", *wrong, "-o", folder / "x.yaml")
        assert done.exit_code == 2 and "--holdout-last K or --test FILE" in done.stderr


def test_an_unknown_term_is_refused_with_a_near_name(folder, run):
    done = run(
        "refine",
        ENGINE,
        folder / "flights.csv",
        "--term",
        "reynolds_eficiency@hpc",
        "--holdout-last",
        "1",
        "-o",
        folder / "x.yaml",
    )
    assert done.exit_code == 2 and "reynolds_efficiency@hpc" in done.stderr
