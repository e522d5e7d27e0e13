"""The margin of one engine: `trend --what margin`, and the page of `report`."""

from __future__ import annotations

import html
import json
import re
import shutil
from pathlib import Path

import numpy as np
import pytest
import small_fleet
from washed_engine import BASELINE, LIMIT_K, WASHED, make

from enginediag_cli.report.tables.fleet import interval_columns

ASKED = ("--limit", "T5_K", f"{LIMIT_K:g}", "--events", "washes.csv", "--baseline", str(BASELINE))
JUDGED = ("-n", "nominal.yaml", "engine_7.csv")


@pytest.fixture(scope="module")
def made(tmp_path_factory) -> Path:
    folder = tmp_path_factory.mktemp("washed")
    make(folder)
    return folder


@pytest.fixture
def here(made, tmp_path, monkeypatch) -> Path:
    shutil.copytree(made, tmp_path, dirs_exist_ok=True)
    monkeypatch.chdir(tmp_path)
    return tmp_path


def margin(run, *asked: str) -> list[dict]:
    ended = run("trend", *JUDGED, "--what", "margin", *asked, "-q", "-f", "json")
    assert ended.exit_code == 0, ended.stderr
    return json.loads(ended.stdout)


def words(page: Path) -> str:
    text = re.sub(r"<(script|style)\b.*?</\1>", " ", page.read_text(encoding="utf-8"), flags=re.S)
    return re.sub(r"\s+", " ", html.unescape(re.sub(r"<[^>]+>", " ", text)))


def figure(page: Path, key: str) -> str:
    return page.read_text(encoding="utf-8").split(f'<figure id="{key}"')[1].split("</figure>")[0]


def test_the_same_engine_alone_and_in_a_fleet_has_the_same_margin(here, run):
    assert run("fleet", "fleet.yaml", "--jobs", "1", "-q", "-f", "json", "-o", "fleet.json").exit_code == 0
    (engine,) = json.loads(Path("fleet.json").read_text())["engines"]
    *flights, wash, whole = margin(run, *ASKED)
    told, m = engine["margin"], whole
    assert [told["column"], told["condition"], told["limit_K"]] == [m["column"], m["condition"], m["limit_K"]]
    for estimate, name in (
        ("consumed_K", "used"),
        ("now_K", "margin"),
        ("remaining_flights", "remaining_flights"),
        ("rate_K_per_flight", "rate"),
    ):
        value = m[name] if name == "remaining_flights" else m[f"{name}_K"]
        # a fleet compares engines with themselves, and leaves out what is uncertain about nominal
        tenth = 0.1 * (m[f"{name}_high"] - m[f"{name}_low"])
        found = told[estimate]
        assert found["value"] == pytest.approx(value, abs=tenth)
        assert m[f"{name}_low"] - tenth < found["low"] < found["high"] < m[f"{name}_high"] + tenth
    used = [f["used_K"] for f in flights]
    assert [f["consumed_K"] for f in engine["by_flight"]] == pytest.approx(
        used, abs=0.1 * (m["used_high"] - m["used_low"])
    )
    assert engine["events"][0]["recovered_K"]["value"] == pytest.approx(
        wash["recovered_K"], abs=0.1 * (wash["recovered_high"] - wash["recovered_low"])
    )


def test_a_limit_of_lost_margin_serves_one_engine_as_it_serves_a_fleet(here, run):
    judge = "judge: {consumed_limit_K: [25, 3]}"
    Path("fleet.yaml").write_text(Path("fleet.yaml").read_text().replace("judge: {limits_K: {T5_K: 1050}}", judge))
    assert run("fleet", "fleet.yaml", "--jobs", "1", "-q", "-f", "json", "-o", "fleet.json").exit_code == 0
    (engine,) = json.loads(Path("fleet.json").read_text())["engines"]
    *_, whole = margin(run, "--consumed-limit", "25", "3", *ASKED[3:])
    left = engine["margin"]["remaining_flights"]
    alone = {k: whole[n] for k, n in zip(left, interval_columns("remaining_flights"), strict=True)}
    assert left == pytest.approx(alone, abs=0.1 * (left["high"] - left["low"]))
    assert left["low"] < (25 - whole["used_K"]) / whole["rate_K"] < left["high"] and whole["margin_K"] is None
    told = run("trend", *JUDGED, "--what", "margin", "--consumed-limit", "25", "3", *ASKED[3:]).stderr
    assert "until as much is lost as when engines are removed from wing (90 %:" in told
    both = run("trend", *JUDGED, "--what", "margin", "--consumed-limit", "25", "3", *ASKED)
    assert both.exit_code == 2 and "--limit, --consumed-limit and --taken-off exclude each other" in both.stderr


def test_engines_that_were_taken_off_tell_the_others_how_far_they_may_go(tmp_path, monkeypatch, run):
    small_fleet.make(tmp_path)
    monkeypatch.chdir(tmp_path)
    lines = []
    for k in range(1, 5):
        head, *rows = Path(f"engine_{k}.csv").read_text().splitlines()
        lines += [f"engine,{head}"] * (k == 1) + [f"{k},{row}" for row in rows]
    Path("all.csv").write_text("\n".join(lines) + "\n")
    asked = ("trend", "-n", "nominal.yaml", "all.csv", "--what", "margin", "--baseline", "3", "-f", "json")
    ended = run(*asked, "--taken-off", "1", "--taken-off", "2", "--taken-off", "3")
    assert ended.exit_code == 0 and "engines were removed from wing with" in ended.stderr
    *_, fourth = json.loads(ended.stdout)
    assert fourth["engine"] == "4" and "no limit" not in fourth["reason"]
    few = run(*asked, "--taken-off", "1", "--taken-off", "2")
    assert few.exit_code == 2 and "a limit is learnt from 3 lives at least, and 2 can be followed" in few.stderr
    other = run(*asked, "--taken-off", "1", "--taken-off", "2", "--taken-off", "7")
    assert other.exit_code == 2 and "--taken-off names engine 7, which is not judged" in other.stderr
    unnamed = run("trend", "-n", "nominal.yaml", "engine_1.csv", "--what", "margin", "--taken-off", "1")
    assert unnamed.exit_code == 2 and "the recordings name no engines" in unnamed.stderr


def test_a_wash_that_gave_back_one_per_cent_is_told_with_its_gain_of_turbine_temperature(here, run):
    from enginediag_cli.fleets.work_scope import choose_reference, solve_equal_power
    from enginediag_cli.physics.engine_file import load_engine

    (wash,) = (row for row in margin(run, *ASKED) if row["row"] == "maintenance")
    assert (wash["event"], wash["number"]) == ("wash", WASHED)
    assert wash["brought"][0].startswith("compressor isentropic efficiency rose by ")
    engine = load_engine("engine.yaml")
    reference = choose_reference(engine, {}, {})
    y = solve_equal_power(engine, reference, {}, ("compressor.efficiency",), np.array([[-0.014], [-0.004]])).y
    true, share = y[0, 0] - y[1, 0], 100 * (y[0, 1] - y[1, 1]) / y[0, 1]
    assert wash["temperature_gain_low"] < true < wash["temperature_gain_high"]
    assert wash["fuel_gain_percent_low"] < share < wash["fuel_gain_percent_high"]
    assert wash["temperature_gain_low"] > 0.4 * true  # and is no guess
    ended = run("trend", *JUDGED, "--what", "margin", *ASKED, "-o", "margin.csv")
    assert f"wash before flight {WASHED}: compressor isentropic efficiency rose by " in ended.stderr
    assert "it lowered T5 by" in ended.stderr and "T5 margin" in ended.stderr


def test_the_page_of_one_engine_has_its_margin_with_forecast_and_maintenance(here, run):
    assert run("report", *JUDGED, *ASKED, "--static", "-q", "-o", "page.html").exit_code == 0
    told, drawn = words(Path("page.html")), figure(Path("page.html"), "engine-1-margin")
    assert f"to the limit of {LIMIT_K:g} K" in told and "flights to it (90 %:" in told
    first = Path("page.html").read_text(encoding="utf-8").split('<nav aria-label="Contents">')[0]
    assert "<dt>Margin</dt><dd>T5 margin" in first and "flights to it (90 %:" in first
    assert "T5 margin and its forecast" in drawn and "90 % of the forecast" in drawn
    assert ">wash</text>" in drawn and f"limit {LIMIT_K:g} K" in drawn
    assert ">wash</text>" in figure(Path("page.html"), "engine-1-health")
    assert "What maintenance brought (T5 at equal thrust, design point)" in told
    assert "compressor isentropic efficiency rose by " in told and "fell by" in told
    assert "--limit T5_K 1050.0 --events washes.csv --baseline 3" in told  # what makes it again
    assert run("report", *JUDGED, *ASKED, "--static", "-q", "-o", "again.html").exit_code == 0
    assert Path("again.html").read_text().replace("again.html", "page.html") == Path("page.html").read_text()


def test_a_page_of_results_draws_the_same_margin_as_one_of_recordings(here, run):
    for what, asked in (("flights", ()), ("trend", ()), ("margin", ASKED)):
        assert run("trend", *JUDGED, "--what", what, *asked, "-q", "-o", f"{what}.csv").exit_code == 0
    results = ("flights.csv", "trend.csv", "margin.csv", "nominal.yaml")
    assert run("report", *results, "--static", "-q", "-o", "read.html").exit_code in (0, 3)
    assert run("report", *JUDGED, *ASKED, "--static", "-q", "-o", "made.html").exit_code == 0
    pictures = [figure(Path(name), "engine-1-margin").split("<svg")[1].split("</svg>")[0] for name in PAGES]
    assert pictures[0] == pictures[1]
    assert ">wash</text>" in figure(Path("read.html"), "engine-1-health")
    without = ("flights.csv", "trend.csv", "nominal.yaml")
    assert run("report", *without, "--static", "-q", "-o", "without.html").exit_code in (0, 3)
    assert "<dt>Margin</dt>" not in Path("without.html").read_text(encoding="utf-8")
    assert "The margin of the turbine temperature is unknown: none of these results follows it" in words(
        Path("without.html")
    )


PAGES = ("read.html", "made.html")


def test_without_a_limit_the_page_says_why_there_is_no_margin(here, run):
    assert run("report", *JUDGED, "--static", "-q", "-o", "page.html").exit_code == 0
    told = words(Path("page.html"))
    assert "of the T5 margin is used; the remaining margin is unknown: no limit is stated: --limit T5_K KELVIN" in told
    assert told.count("the remaining margin is unknown") == 1 and "and its forecast" not in told


def test_too_few_flights_have_no_margin_and_say_so(here, run):
    lines = Path("engine_7.csv").read_text().splitlines()
    Path("engine_7.csv").write_text("\n".join(lines[:32]) + "\n")
    (whole,) = margin(run, *ASKED[:3])
    assert whole["margin_K"] is None and "too few" in whole["reason"]
    ended = run("trend", *JUDGED, "--what", "margin", "-o", "margin.csv")
    assert "the margin of the turbine temperature is unknown:" in ended.stderr


def test_a_limit_that_is_passed_is_told_so_and_has_no_forecast(here, run):
    (picture, *asked) = ("margin.svg", *ASKED[3:], "--limit", "T5_K", "985")
    ended = run("trend", *JUDGED, "--what", "margin", *asked, "-o", "margin.csv", "--picture", picture)
    assert "T5 has passed its limit of 985 K by" in ended.stderr
    drawn = Path(picture).read_text()
    assert "The limit is passed." in drawn and "90 % of the forecast" not in drawn


def test_a_limit_of_what_has_no_margin_is_refused_with_the_column_that_has(here, run):
    ended = run("trend", *JUDGED, "--what", "margin", "--limit", "T3_K", "900")
    assert ended.exit_code == 2 and "T3_K is no temperature of burnt gas" in ended.stderr and "T5_K" in ended.stderr
    ended = run("trend", *JUDGED, "--what", "margin", "--limit", "T55_K", "900")
    assert ended.exit_code == 2 and "did you mean 'T5_K'?" in ended.stderr
    assert run("trend", "engine_7.csv", "--what", "margin").exit_code == 2
    ended = run("report", "nominal.yaml", *ASKED[:3], "-o", "page.html")
    assert ended.exit_code == 2 and "need -n NOMINAL" in ended.stderr


def test_events_that_are_misspelt_or_of_nobody_are_told_with_what_may_be_meant(here, run):
    asked = ("trend", *JUDGED, "--what", "margin", "--events", "events.csv", "-o", "margin.csv")
    Path("events.csv").write_text("kind,flight\nwahs,15\n")
    ended = run(*asked)
    assert ended.exit_code == 2 and "events.csv:2" in ended.stderr and "did you mean 'wash'?" in ended.stderr
    Path("events.csv").write_text("kind,flihgt\nwash,15\n")
    assert "did you mean 'flight'?" in run(*asked).stderr
    Path("events.csv").write_text("kind,flight\nwash,150\n")
    ended = run(*asked)
    assert ended.exit_code == 0 and "maintenance before flight '150', which is not recorded" in ended.stderr
    Path("events.csv").write_text("engine,kind,flight\n7,wash,15\n8,wash,3\n")
    ended = run(*asked)
    assert ended.exit_code == 2 and "keep those of one" in ended.stderr


def test_maintenance_in_a_trend_is_no_change_of_its_own_and_stands_on_the_page(here, run):
    assert run("trend", *JUDGED, "--event", "15", "-q", "-o", "trend.csv").exit_code == 0
    assert run("trend", *JUDGED, "--what", "flights", "-q", "-o", "flights.csv").exit_code == 0
    assert run("trend", *JUDGED, "-q", "-o", "plain.csv").exit_code == 0
    verdicts = []
    for name in ("trend", "plain"):
        run("report", f"{name}.csv", "flights.csv", "nominal.yaml", "--static", "-q", "-o", f"{name}.html")
        verdicts.append(Path(f"{name}.html").read_text().split('class="verdict">')[1].split("</p>")[0])
    assert all(verdict.startswith("compressor isentropic efficiency fell by 1.") for verdict in verdicts)
    assert ">maintenance</text>" in figure(Path("trend.html"), "engine-1-health")


def test_a_limit_of_the_file_of_options_is_that_of_the_command_line(here, run):
    typed = margin(run, *ASKED)
    Path("enginediag.yaml").write_text("kind: defaults\ntrend: {limit: [T5_K 1050], events: washes.csv, baseline: 3}\n")
    assert margin(run) == typed


def test_maintenance_that_brought_nothing_is_not_blamed_for_the_wear_of_the_flights_about_it(here, run):
    Path("events.csv").write_text("kind,flight,component\nwash,5,\noverhaul,10,\nwash,15,\nexchange,30,turbine\n")
    rows = margin(run, "--limit", "T5_K", "1050", "--events", "events.csv")
    early, overhaul, wash, later = (row for row in rows if row["row"] == "maintenance")
    for nothing in (early, overhaul):
        half = (nothing["temperature_gain_high"] - nothing["temperature_gain_low"]) / 2
        assert abs(nothing["temperature_gain_K"]) < 1.5 * half and nothing["temperature_gain_high"] < 8  # three sigma
    assert wash["temperature_gain_low"] > 0 and wash["recovered_low"] > 0
    assert "another one since" in overhaul["reason"] and "before the engine was renewed" in early["reason"]
    assert later["number"] is None and later["reason"] == "no flight is after it"
    assert min(row["number"] for row in rows if row["row"] == "flight") == 10  # a renewed engine begins again
