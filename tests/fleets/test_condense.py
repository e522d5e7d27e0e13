"""Condensing recordings: as `trend` has them, alone or together, and through the file without a digit lost."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import small_fleet

from enginediag_cli.detection.series import build_series
from enginediag_cli.fleets import store as module
from enginediag_cli.fleets.models import SerialRunner
from enginediag_cli.fleets.run import RecordingParts, _StoredWindows, condense_all, engine_tasks
from enginediag_cli.fleets.store import CondensedReader, CondenseTask, FleetStore, condense, whole_monitor
from enginediag_cli.intake.loader import RecordingLoader
from enginediag_cli.intake.selection import RecordingSource, required_columns
from enginediag_cli.recordings.read import read_all
from enginediag_cli.recordings.write import write_csv
from enginediag_cli.residuals.files import WindowReader, WindowSettings


@pytest.fixture(scope="module")
def tasks(fleet_file, tmp_path_factory):
    fleet, recordings, models, store = small_fleet.opened(fleet_file, tmp_path_factory.mktemp("store"))
    outcomes = condense_all(recordings, models, store, SerialRunner())
    found, left_out = engine_tasks(fleet, list(zip(recordings, outcomes, strict=True)), models, store)
    assert left_out == []
    return found


def readings(task):
    stored = _StoredWindows(task, whole_monitor(task.nominal, task.fingerprint))
    return build_series(stored, law="none").readings(task.serial)


def test_each_engine_has_its_flights_and_the_readings_that_trend_has_of_them(fleet_file, tasks):
    assert [task.serial for task in tasks] == ["1", "2", "3", "4"]
    task = tasks[1]
    monitor = whole_monitor(task.nominal, task.fingerprint)
    intake = RecordingLoader(
        RecordingSource((str(fleet_file.parent / "engine_2.csv"),)), required_columns(monitor.engine, monitor.sensors)
    )
    files = WindowReader(intake, monitor, WindowSettings(task_plan(fleet_file)), summed=True, series=True)
    by_trend, mine = build_series(files, law="none").readings(""), readings(task)
    assert mine.z.shape == by_trend.z.shape
    assert len(mine) == small_fleet.FLIGHTS
    # only the point of linearisation differs, by what is uncertain about nominal
    assert np.abs(mine.z - by_trend.z).max() < 0.1


def task_plan(fleet_file):
    from enginediag_cli.fleets.fleet_file import load_fleet

    return load_fleet(fleet_file).plan


def test_recordings_condensed_together_are_what_each_is_alone(fleet_file, tasks, tmp_path):
    paths = tuple(str(fleet_file.parent / f"engine_{k}.csv") for k in (1, 2, 3))
    making = small_fleet.opened(fleet_file, tmp_path)[2]["nominal"].settings
    alone = [condense(CondenseTask((path,), making, str(tmp_path / "alone")))[0] for path in paths]
    together = condense(CondenseTask(paths, making, str(tmp_path / "together")))
    for a, b, task in zip(alone, together, tasks, strict=False):
        assert a.condensed == b.condensed
        one, other = (
            readings(
                replace(
                    task, pieces=(RecordingParts(str(FleetStore(tmp_path / where).path(a.condensed.key)), (0,), "x"),)
                )
            )
            for where in ("alone", "together")
        )
        np.testing.assert_allclose(one.z, other.z, rtol=0, atol=1e-9)


def test_a_recording_that_cannot_be_read_costs_the_others_nothing(fleet_file, tmp_path):
    bad = tmp_path / "engine_9.csv"
    bad.write_text("altitude_m,mach\n1,zwei\n", encoding="utf-8")
    paths = (str(fleet_file.parent / "engine_1.csv"), str(bad), str(tmp_path / "engine_8.csv"))
    making = small_fleet.opened(fleet_file, tmp_path)[2]["nominal"].settings
    good, broken, absent = condense(CondenseTask(paths, making, str(tmp_path)))
    assert good.fresh and good.condensed.parts[0].windows == small_fleet.FLIGHTS
    assert "zwei" in broken.trouble and "engine_9.csv:2" in broken.trouble
    assert "no such file" in absent.trouble


def test_a_recording_of_several_engines_has_a_part_for_each_and_is_written_as_it_comes(
    fleet_file, tmp_path, monkeypatch
):
    monkeypatch.setattr(module, "PART", 5)
    tables = [read_all(str(fleet_file.parent / f"engine_{k}.csv")) for k in (1, 2)]
    named = [replace(t, text={**t.text, "engine": [f"E{k}"] * len(t)}, order=()) for k, t in enumerate(tables, 1)]
    path = tmp_path / "both.csv"
    write_csv(path, named)
    making = small_fleet.opened(fleet_file, tmp_path)[2]["nominal"].settings
    (found,) = condense(CondenseTask((str(path),), making, str(tmp_path)))
    windows = {name: sum(p.windows for p in found.condensed.parts if p.engine == name) for name in ("E1", "E2")}
    assert windows == {"E1": small_fleet.FLIGHTS, "E2": small_fleet.FLIGHTS}
    assert len(found.condensed.parts) >= 4


def test_what_is_read_back_is_what_was_condensed(tasks):
    task = tasks[0]
    meaning = whole_monitor(task.nominal, task.fingerprint).meaning
    with CondensedReader(task.pieces[0].file) as reader:
        windows = list(reader.windows(0, "engine_1.csv", "1", meaning))
        assert reader.condensed.counts["records"] == small_fleet.FLIGHTS * small_fleet.RECORDS
    assert [w.flight for w in windows] == [str(k) for k in range(1, small_fleet.FLIGHTS + 1)]
    first = windows[0].statistics
    assert first.n == small_fleet.RECORDS and first.parameters == tuple(meaning)
    np.testing.assert_array_equal(first.F, first.F.T)
    assert set(windows[0].conditions) >= {"altitude_m", "mach"}


@pytest.mark.parametrize(
    ("gate", "left"),
    [("steady: {minimum: {Wf_kg_s: 0.001}}", 0), ("steady: {maximum: {mach: 0.4}}", 80), ("average_s: 60", 1)],
)
def test_what_a_recorders_gate_has_left_out_is_kept_beside_the_windows(fleet_file, tmp_path, gate, left):
    for name in ("engine.yaml", "nominal.yaml", "engine_1.csv"):
        (tmp_path / name).write_bytes((fleet_file.parent / name).read_bytes())
    columns = read_all(str(tmp_path / "engine_1.csv")).columns
    mapped = [f"  {column}: {{from: {column}}}" for column in columns]
    text = ["kind: recorder", "description: its own columns", "columns:", *mapped, "text: {flight: flight}", gate, ""]
    (tmp_path / "recorder.yaml").write_text("\n".join(text), encoding="utf-8")
    fleet = tmp_path / "fleet.yaml"
    fleet.write_text(f"{small_fleet.FLEET}recorder: recorder.yaml\n", encoding="utf-8")
    _, recordings, models, store = small_fleet.opened(fleet, tmp_path / "store")
    for fresh in (True, False):  # made, and found again
        (outcome,) = condense_all(recordings, models, store, SerialRunner())
        assert outcome.trouble == "" and outcome.fresh == fresh
        (told,) = outcome.condensed.excluded
        assert sum(told.gate.reasons.values()) == left
        assert told.gate.kept == told.gate.total - left
