"""`fleet` and its parts in a shell: one document, the same from one process and from two, and a store that is kept."""

from __future__ import annotations

import json
import shutil
from pathlib import Path

import pytest
import small_fleet


@pytest.fixture(scope="module")
def folder(tmp_path_factory) -> Path:
    folder = tmp_path_factory.mktemp("fleet")
    small_fleet.make(folder)
    return folder


def test_one_document_whatever_the_number_of_processes_and_a_store_that_makes_the_second_run_short(run, folder):
    fleet, store = folder / "fleet.yaml", folder / "kept"
    shutil.copy(folder / "engine_1.csv", folder / "engine_5.csv")  # the same bytes: counted once
    ended = run("fleet", fleet, "--jobs", 1, "-o", folder / "one.json", "--store", store)
    assert ended.exit_code == 0, ended.stderr
    assert "engine_5.csv: excluded: holds the same bytes as engine_1.csv" in ended.stderr
    assert "4 recordings newly reduced to statistics" in ended.stderr
    again = run("fleet", fleet, "--jobs", 2, "-o", folder / "two.json", "--store", store)
    assert "0 recordings newly reduced to statistics" in again.stderr
    one, two = (json.loads((folder / f"{name}.json").read_text()) for name in ("one", "two"))
    one["counts"].pop("fresh"), two["counts"].pop("fresh")
    assert one == two
    assert one["schema"] == "enginediag/fleet/2"
    assert sorted(engine["serial"] for engine in one["engines"]) == ["1", "2", "3", "4"]
    assert one["discoveries"]["engines"] == ["2"]  # the one that wears
    assert one["counts"]["records"] == 4 * small_fleet.FLIGHTS * small_fleet.RECORDS
    assert one["sums"][0]["records"] == one["counts"]["records"]
    assert [x for x in one["left_out"] if "recording" in x] == [
        {"recording": "engine_5.csv", "reason": "holds the same bytes as engine_1.csv, which are counted once"}
    ]
    status = run("fleet", "status", fleet, "--store", store, "-f", "csv")
    assert status.stdout.splitlines()[1] == "engine_1.csv,nominal,1,condensed"
    assert run("fleet", "merge", folder / "other", store).exit_code == 0
    pruned = run("fleet", "prune", fleet, folder / "engine_1.csv", "--store", folder / "other")
    assert "3 files removed" in pruned.stderr


def test_a_fleet_says_of_each_engine_what_its_trend_says_in_whatever_order_the_files_are(run, folder):
    files = [folder / f"engine_{k}.csv" for k in (3, 1, 4, 2)]
    ended = run("fleet", folder / "fleet.yaml", *files, "--jobs", 1, "-f", "json", "-q")
    records = 3 * small_fleet.RECORDS  # of the baseline
    for engine in json.loads(ended.stdout)["engines"]:
        own = ("trend", "-n", folder / "nominal.yaml", folder / f"engine_{engine['serial']}.csv")
        rows = json.loads(run(*own, "--reference", records, "-f", "json", "-q").stdout)
        assert (engine["verdict"], rows[0]["verdict"]) in {("changed", "changed"), ("healthy", "steady")}
        # a fleet's baseline may hold a change; in --reference none begins, because somebody says so
        found = {r["parameter"]: (r["kind"], r["onset"]) for r in rows if r["onset"]}
        stated = {r["parameter"]: (r["kind"], max(r["onset"], 4)) for r in engine["health"] if r["onset"]}
        assert stated == found


def test_rows_of_engines_health_and_flights_have_their_columns(run, folder):
    for what, columns in (
        ("engines", "rank,engine,build,verdict"),
        ("health", "engine,build,parameter,component"),
        ("flights", "engine,build,number,flight"),
    ):
        names = [str(folder / f"engine_{k}.csv") for k in (1, 2)]
        ended = run(
            "fleet", folder / "fleet.yaml", *names, "--jobs", 1, "--what", what, "-f", "csv", "--no-header", "-q"
        )
        assert ended.exit_code in (0, 3), ended.stderr
        if ended.stdout.strip():
            assert ended.stdout.startswith(columns)


@pytest.mark.parametrize("part", ["acknowledge", "status", "prune", "merge"])
def test_the_parts_have_help_with_an_example(run, part):
    text = run("fleet", part, "--help").stdout
    assert f"enginediag fleet {part}" in text.split("Options:")[0].split("\n", 1)[1]
    assert "Exit codes:" in text


def test_jobs_and_a_scheduler_exclude_each_other(run, folder):
    ended = run("fleet", folder / "fleet.yaml", "--jobs", 2, "--scheduler", "tcp://127.0.0.1:9")
    assert ended.exit_code == 2
    assert "exclude each other" in ended.stderr
