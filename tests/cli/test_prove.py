"""`enginediag prove` through the command line: contract, determinism, resumption."""

from __future__ import annotations

import json

import pytest

from enginediag_cli.__main__ import main
from enginediag_cli.shipped import shipped
from enginediag_cli.validation.score_sheet import SCORES

TARGETS = (
    "exact",
    "covered",
    "alias_set_size",
    "false_name",
    "none_right",
    "exact_pair",
    "interval",
    "held_out_gain",
    "locate_driver",
    "locate_component",
    "hidden_location",
    "hidden_states",
    "no_verdict",
)


def run(*arguments):
    return main(["prove", *map(str, arguments)])


def resume(kept, *more):
    """Go on from the trials in a file, with the plan that made them."""
    plan = ("--trials", 2, "--seed", 4, "--kind", "null", "--truth", "same_model", "--no-sizes")
    return run(*plan, "--trials-output", kept, "--resume", *more)


@pytest.fixture(scope="module")
def finished(tmp_path_factory):
    """Two null trials of the turbofan, their sheet and their file of trials."""
    folder = tmp_path_factory.mktemp("prove")
    out, trials = folder / "sheet.json", folder / "trials.jsonl"
    code = run(
        "--trials",
        2,
        "--seed",
        4,
        "--kind",
        "null",
        "--truth",
        "same_model",
        "--jobs",
        1,
        "--no-sizes",
        "--trials-output",
        trials,
        "-o",
        out,
    )
    assert code == 0
    return out, trials


def test_the_sheet_has_every_score_with_its_interval_by_truth_and_kind(finished):
    sheet = json.loads(finished[0].read_text(encoding="utf-8"))
    assert set(TARGETS) <= set(SCORES) <= set(sheet)
    for name in SCORES:
        assert {"rate", "count", "of", "low", "high", "same_model", "map_error"} <= set(sheet[name])
    assert sheet["no_verdict"]["same_model"]["of"] == 2
    assert sheet["false_name"]["same_model"]["kinds"]["null"]["of"] == 2
    assert sheet["trials"] == 2 and sheet["seed"] == 4 and "bins" in sheet and "numpy" in sheet["versions"]


def test_a_file_of_trials_holds_the_sealed_answer_and_the_marks(finished):
    lines = [json.loads(line) for line in finished[1].read_text(encoding="utf-8").splitlines()]
    assert [r["trial"] for r in lines[1:]] == [0, 1]
    assert all(r["kind"] == "null" and r["causes"] == [] and "false_name" in r["marks"] for r in lines[1:])


def test_a_resumed_run_takes_finished_trials_as_they_are(finished, tmp_path):
    kept = tmp_path / "trials.jsonl"
    head, first, *_ = finished[1].read_text(encoding="utf-8").splitlines()
    changed = json.loads(first) | {"marks": {"no_verdict": True}}
    second = finished[1].read_text(encoding="utf-8").splitlines()[2]
    kept.write_text("\n".join([head, json.dumps(changed), second]) + "\n", encoding="utf-8")
    out = tmp_path / "sheet.json"
    assert resume(kept, "-o", out) == 0
    assert json.loads(out.read_text(encoding="utf-8"))["no_verdict"]["same_model"]["count"] == 1


def test_trials_of_another_seed_are_not_gone_on_from(finished, tmp_path, capsys):
    kept = tmp_path / "trials.jsonl"
    kept.write_text(finished[1].read_text(encoding="utf-8"), encoding="utf-8")
    assert (
        run("--trials", 2, "--seed", 5, "--kind", "null", "--truth", "same_model", "--trials-output", kept, "--resume")
        == 2
    )
    assert "another seed" in capsys.readouterr().err


def test_a_file_of_trials_is_not_overwritten_unasked(finished, capsys):
    before = finished[1].read_bytes()
    assert run("--trials", 2, "--seed", 4, "--kind", "null", "--trials-output", finished[1]) == 2
    assert "--resume" in capsys.readouterr().err and finished[1].read_bytes() == before


def test_table_and_csv_tell_the_same_scores(finished, tmp_path, capsys):
    kept = tmp_path / "trials.jsonl"
    kept.write_text(finished[1].read_text(encoding="utf-8"), encoding="utf-8")
    for form in ("table", "csv"):
        assert resume(kept, "--format", form) == 0
        told = capsys.readouterr().out
        assert "no_verdict" in told and "false_name" in told


def test_resume_without_a_file_of_trials_is_bad_usage(capsys):
    assert run("--trials", 1, "--resume") == 2
    assert "--trials-output" in capsys.readouterr().err


def test_an_engine_without_a_power_range_is_refused_before_any_trial(tmp_path, capsys):
    text = shipped("turbojet.yaml").read_text(encoding="utf-8")
    path = tmp_path / "engine.yaml"
    path.write_text(text.replace("power_range: [0.10, 0.36]\n", ""), encoding="utf-8")
    assert run(path, "--trials", 1) == 2
    assert "power_range" in capsys.readouterr().err


@pytest.mark.parametrize(
    "arguments", [("--kind", "single", "--question", "isolate"), ("--truth", "map_error", "--question", "isolate")]
)
def test_kinds_and_truths_of_another_question_are_bad_usage(arguments, capsys):
    assert run("--trials", 1, *arguments) == 2
    assert "does not go with --question isolate" in capsys.readouterr().err


@pytest.mark.slow
def test_isolation_is_scored_with_targets_and_reliability(tmp_path):
    out, trials = tmp_path / "sheet.json", tmp_path / "trials.jsonl"
    common = (
        "turbojet.yaml",
        "--question",
        "isolate",
        "--trials",
        2,
        "--seed",
        4,
        "--kind",
        "null",
        "--kind",
        "component",
    )
    assert run(*common, "--jobs", 1, "--trials-output", trials, "-o", out) == 0
    found = json.loads(out.read_text(encoding="utf-8"))
    assert found["sheet"]["right_when_sure"]["target"] == ">= 0.88" and found["kinds"]["all"]["trials"] == 2
    assert set(found["reliability"]) <= {"all", "null", "component", "class", "nothing", "changed"}
    lines = [json.loads(line) for line in trials.read_text(encoding="utf-8").splitlines()[1:]]
    assert all(r["truth"] == "realistic" and r["engine"] == "turbojet" and r["outcome"] for r in lines)
    again = tmp_path / "again.csv"
    assert run(*common, "--trials-output", trials, "--resume", "-o", again) == 0
    assert "right_when_sure" in again.read_text(encoding="utf-8")


@pytest.mark.slow
def test_the_same_seed_gives_the_same_bytes_on_any_number_of_jobs(tmp_path):
    for jobs in (1, 2):
        assert (
            run(
                "--trials",
                4,
                "--seed",
                6,
                "--kind",
                "single",
                "--kind",
                "hidden_switch",
                "--jobs",
                jobs,
                "-o",
                tmp_path / f"{jobs}.json",
            )
            == 0
        )
    assert (tmp_path / "1.json").read_bytes() == (tmp_path / "2.json").read_bytes()


@pytest.mark.slow
def test_trials_in_the_field_need_no_engine_and_refuse_one_that_flies_no_airliners_mission(run):
    done = run("prove", "--question", "isolate", "--kind", "field", "--trials", "1", "--seed", "3", "--jobs", "1", "-q")
    assert done.exit_code == 0
    assert "turbofan.yaml" in done.stdout
    ground = run("prove", "power_plant.yaml", "--question", "isolate", "--kind", "field", "--trials", "1", "-q")
    assert ground.exit_code == 2
    assert "stays on the ground" in ground.stderr
