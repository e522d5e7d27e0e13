"""Fleet files: what is wrong is told where it is; recordings in their order; maintenance; early life."""

from __future__ import annotations

import os
from pathlib import Path

import numpy as np
import pytest

from enginediag_cli.config.files import outside_allowed
from enginediag_cli.errors import ConfigError, DataError, NoVerdictError
from enginediag_cli.fleets.fleet_file import FleetBaseline, find_recordings, load_fleet, natural_order
from enginediag_cli.fleets.models import _choose_lives, _EarlyLife, _evenly_spaced
from enginediag_cli.recordings.table import Recording

GOOD = """\
kind: fleet
engine: turbojet.yaml
recordings: ['*.csv']
baseline: {flights: 3}
"""


def written(folder: Path, text: str) -> Path:
    file = folder / "fleet.yaml"
    file.write_text(text, encoding="utf-8")
    return file


@pytest.mark.parametrize(
    ("old", "new", "told"),
    [
        ("engine:", "engin:", "2:1: error: unknown key 'engin'"),
        ("turbojet.yaml", "turbojt.yaml", "2:9: error: there is no engine file"),
        ("baseline: {flights: 3}", "baseline: {}", "4:11: error: neither 'flights' nor 'records'"),
        ("baseline: {flights: 3}", "baseline: {flights: 0}", "4:21: error: baseline.flights must be"),
        (
            "recordings:",
            "engines: {serial_from: file}\nrecordings:",
            "3:10: error: serial numbers from file names need",
        ),
        ("recordings:", "engines: {serial_from: file, pattern: 'e_('}\nrecordings:", "3:39: error: not a regular"),
        ("recordings:", "engines: {serial_from: file, pattern: 'e'}\nrecordings:", "3:39: error: the pattern has 0"),
        ("recordings:", "judge: {window: ten}\nrecordings:", "3:17: error: 'ten' is not a number of records"),
        (
            "recordings:",
            "judge: {taken_off: ['1', '2']}\nrecordings:",
            "3:20: error: 2 engines do not determine a limit",
        ),
        (
            "recordings:",
            "judge: {taken_off: ['1', '2', '3'], consumed_limit_K: [25, 3]}\nrecordings:",
            "3:20: error: both 'taken_off' and 'consumed_limit_K' are given",
        ),
        ("engine:", "builds: {a: {engine: turbojet.yaml}}\nengine:", "3:9: error: 'engine' stands beside 'builds'"),
        ("recordings:", "recorder: nothing.yaml\nrecordings:", "3:11: error: there is no recorder"),
    ],
)
def test_what_is_wrong_is_told_with_its_place(tmp_path, old, new, told):
    with pytest.raises(ConfigError) as error:
        load_fleet(written(tmp_path, GOOD.replace(old, new, 1)))
    assert told in str(error.value)


@pytest.mark.parametrize(
    ("rows", "told"),
    [
        ("engine,kind,flight\n1,wahs,3\n", "events.csv:2: error: unknown kind of event 'wahs' (did you mean 'wash'?)"),
        ("engine,kind,flight\n1,wash,\n", "events.csv:2: error: the event has neither a flight nor a time"),
        ("engine,kind,flight\n,wash,3\n", "events.csv:2: error: the event names no engine"),
        ("engine,kind\n1,wash\n", "no column 'flight' and none 'time_s'"),
        ("engin,kind,flight\n1,wash,3\n", "unknown column 'engin' (did you mean 'engine'?)"),
    ],
)
def test_events_that_are_wrong_are_told_with_their_line(tmp_path, rows, told):
    (tmp_path / "events.csv").write_text(rows, encoding="utf-8")
    with pytest.raises(ConfigError) as error:
        load_fleet(written(tmp_path, GOOD + "events: events.csv\n"))
    assert told in str(error.value)


def test_events_are_read_with_serial_numbers_as_they_stand(tmp_path):
    (tmp_path / "events.csv").write_text("engine,kind,flight,component\n007,wash,12,hpc\n", encoding="utf-8")
    (event,) = load_fleet(written(tmp_path, GOOD + "events: events.csv\n")).events
    assert (event.engine, event.kind, event.flight, event.component) == ("007", "wash", "12", "hpc")


def test_recordings_come_in_the_order_of_their_numbers_and_are_not_taken_twice(tmp_path):
    for name in ("e_10.csv", "e_9.csv", "e_1.csv"):
        (tmp_path / name).write_text("x\n", encoding="utf-8")
    fleet = load_fleet(written(tmp_path, GOOD))
    assert [r.name for r in find_recordings(fleet)] == ["e_1.csv", "e_9.csv", "e_10.csv"]
    assert sorted(["b", "a10", "a9", "10", "9"], key=natural_order) == ["9", "10", "a9", "a10", "b"]
    with pytest.raises(DataError, match="given twice"):
        find_recordings(fleet, [str(tmp_path / "e_1.csv"), str(tmp_path / "." / "e_1.csv")])


def test_a_fleet_without_recordings_has_no_verdict(tmp_path):
    with pytest.raises(NoVerdictError, match=r"no file matches \*\.csv"):
        find_recordings(load_fleet(written(tmp_path, GOOD)))


def test_a_recording_of_two_builds_is_refused(tmp_path):
    (tmp_path / "e_1.csv").write_text("x\n", encoding="utf-8")
    build = "{engine: turbojet.yaml, recordings: ['*.csv']}"
    text = f"kind: fleet\nbuilds: {{a: {build}, b: {build}}}\nbaseline: {{records: 5}}\n"
    with pytest.raises(DataError, match="of build 'a' and of 'b'"):
        find_recordings(load_fleet(written(tmp_path, text)))


def test_the_baseline_is_the_first_flights_or_those_within_the_first_records():
    assert FleetBaseline(flights=3).count_stretches([20] * 8) == 3
    assert FleetBaseline(flights=9).count_stretches([20] * 8) == 8
    assert FleetBaseline(records=50).count_stretches([20] * 8) == 2
    assert FleetBaseline(records=10).count_stretches([20] * 8) == 0


def flight(records: int) -> Recording:
    return Recording({"mach": np.zeros(records)})


def test_early_lives_end_where_the_baseline_does():
    life = _EarlyLife("1")
    for number in range(6):
        life.take(("a.csv", str(number)), flight(20), FleetBaseline(flights=2))
    assert life.full and life.records == 40
    snapshots = _EarlyLife("2")
    snapshots.take(("a.csv", ""), flight(100), FleetBaseline(flights=7))
    assert snapshots.full and snapshots.records == 7
    some = _EarlyLife("3")
    for number in range(3):
        some.take(("a.csv", str(number)), flight(20), FleetBaseline(records=50))
    assert some.full and some.records == 50


def test_the_model_rests_on_engines_evenly_chosen_and_on_whole_flights_of_them():
    lives = []
    for serial in range(30):
        lives.append(_EarlyLife(str(serial)))
        for number in range(4):
            lives[-1].take(("a.csv", str(number)), flight(100), FleetBaseline(flights=4))
    chosen = _choose_lives(lives, {"engines": 10, "records": 1500})
    assert len(chosen) == 10 and sum(life.records for life in chosen) <= 1500
    assert {life.records % 100 for life in chosen} == {0}
    assert len(_choose_lives(lives, {"engines": 10, "records": 20})) == 3  # not one engine in place of a fleet
    assert _evenly_spaced(100, 5) == [0, 25, 50, 74, 99]


def test_what_a_pattern_finds_and_nobody_can_read_is_named_and_nothing_outside_is_read(tmp_path):
    folder = tmp_path / "fleet"
    (folder / "e_3.csv").mkdir(parents=True)
    for path in (folder / "e_1.csv", tmp_path / "secret.csv"):
        path.write_text("x\n", encoding="utf-8")
    (folder / "e_2.csv").symlink_to(tmp_path / "nowhere")
    (folder / "e_4.csv").symlink_to(tmp_path / "secret.csv")
    os.mkfifo(folder / "e_5.csv")
    fleet = load_fleet(written(folder, GOOD.replace("'*.csv'", "'*.csv', '../sec*'")))
    troubles = {Path(r.path).name: r.trouble for r in find_recordings(fleet)}
    assert troubles.pop("e_1.csv") == ""
    said = {"e_2.csv": "a link to", "e_3.csv": "a folder", "e_4.csv": "outside", "e_5.csv": "a pipe"}
    said["secret.csv"] = "outside"
    assert troubles.keys() == said.keys() and all(said[name] in why for name, why in troubles.items())
    with outside_allowed():
        allowed = {Path(r.path).name for r in find_recordings(fleet) if not r.trouble}
    assert allowed == {"e_1.csv", "e_4.csv", "secret.csv"}
