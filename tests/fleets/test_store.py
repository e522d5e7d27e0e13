"""The store: what is there is not done again, what is half-written is not there, two runs and two stores agree."""

from __future__ import annotations

import os
import signal
import time
from pathlib import Path

import pytest
import small_fleet

from enginediag_cli.errors import DataError
from enginediag_cli.fleets import run
from enginediag_cli.fleets.fleet_file import find_recordings, load_fleet
from enginediag_cli.fleets.models import SerialRunner, merge_stores, open_runner, prune_store, store_status
from enginediag_cli.fleets.run import condense_all
from enginediag_cli.fleets.store import FleetStore
from enginediag_cli.parallel import ProcessPool


def content(store: FleetStore) -> dict[str, bytes]:
    return {path.name: path.read_bytes() for path in sorted(store.folder.glob("recordings/*/*"))}


@pytest.fixture
def opened(fleet_file, tmp_path):
    return small_fleet.opened(fleet_file, tmp_path / "store")


def fresh(recordings, models, store) -> list[bool]:
    return [outcome.fresh for outcome in condense_all(recordings, models, store, SerialRunner())]


def test_a_second_run_condenses_nothing_and_a_damaged_or_missing_file_is_made_again(opened):
    _, recordings, models, store = opened
    assert fresh(recordings, models, store) == [True] * 4
    whole = content(store)
    assert fresh(recordings, models, store) == [False] * 4
    first, second = (store.folder / "recordings" / name[:2] / name for name in list(whole)[:2])
    first.write_bytes(first.read_bytes()[:-200])  # as a full disk might leave it
    second.unlink()
    assert sum(fresh(recordings, models, store)) == 2
    assert content(store) == whole


def test_another_name_is_known_and_other_bytes_nominal_or_settings_are_new(fleet_file, opened, tmp_path):
    _, recordings, models, store = opened
    condense_all(recordings, models, store, SerialRunner())
    moved = tmp_path / "engine_77.csv"
    moved.write_bytes((fleet_file.parent / "engine_1.csv").read_bytes())
    making = models["nominal"].settings
    from enginediag_cli.fleets.store import CondenseTask, condense

    assert not condense(CondenseTask((str(moved),), making, str(store.folder)))[0].fresh
    with open(moved, "a", encoding="utf-8") as stream:
        stream.write("\n")
    assert condense(CondenseTask((str(moved),), making, str(store.folder)))[0].fresh
    from dataclasses import replace

    for other in (replace(making, fingerprint="another"), replace(making, linearise="nominal")):
        assert store.find(other.key("x")) is None and other.key("x") != making.key("x")


def test_a_run_that_is_killed_while_it_writes_leaves_nothing_that_counts(opened):
    fleet, recordings, _, store = opened
    child = os.fork()
    if not child:
        with store.writing("ab" * 32):
            os.kill(os.getpid(), signal.SIGKILL)
    os.waitpid(child, 0)
    assert store.find("ab" * 32) is None
    assert list(store.keys()) == []
    (left,) = store.partial()
    assert prune_store(fleet, recordings, store) == []  # another run may be writing it
    os.utime(left, (time.time() - 7200,) * 2)
    assert prune_store(fleet, recordings, store) == [left] and not left.exists()


def test_two_runs_at_once_leave_what_one_leaves(opened, tmp_path):
    _, recordings, models, store = opened
    alone = FleetStore(tmp_path / "alone")
    condense_all(recordings, models, alone, SerialRunner())
    child = os.fork()
    if not child:
        try:
            condense_all(recordings, models, store, SerialRunner())
        finally:
            os._exit(0)
    condense_all(recordings, models, store, SerialRunner())
    os.waitpid(child, 0)
    assert content(store) == content(alone)


def test_processes_leave_the_same_bytes_as_one_process_also_when_one_of_them_dies(opened, tmp_path):
    _, recordings, models, store = opened
    alone = FleetStore(tmp_path / "alone")
    condense_all(recordings, models, alone, SerialRunner())
    runner = ProcessPool(2)
    try:
        marker = tmp_path / "died"
        assert sorted(runner.run(dies_once, [(k, str(marker)) for k in range(6)])) == [(k, k * k) for k in range(6)]
        condense_all(recordings, models, store, runner)
    finally:
        runner.close()
    assert content(store) == content(alone)


@pytest.mark.slow
@pytest.mark.parametrize("workers", [2, 8])
def test_however_many_processes_work_all_that_is_found_is_the_same(fleet_file, tmp_path, monkeypatch, workers):
    monkeypatch.setattr(run, "BATCH_FILES", 1)
    fleet = load_fleet(fleet_file)
    recordings = find_recordings(fleet)
    found = {}
    for number in (1, workers):
        store = FleetStore(tmp_path / str(number))
        with open_runner(number) as runner:
            found[number] = str(run.run_fleet(fleet, recordings, store, runner).finding), content(store)
    assert found[1] == found[workers]


def dies_once(task: tuple[int, str]) -> int:
    number, marker = task
    if number == 2:
        try:
            os.close(os.open(marker, os.O_CREAT | os.O_EXCL))
            os.kill(os.getpid(), signal.SIGKILL)
        except FileExistsError:
            pass
    return number * number


def test_stores_of_the_parts_of_a_fleet_merge_to_that_of_the_whole(fleet_file, opened, tmp_path):
    fleet, recordings, models, store = opened
    whole, other = FleetStore(tmp_path / "whole"), FleetStore(tmp_path / "other")
    condense_all(recordings, models, whole, SerialRunner())
    condense_all(recordings[:2], models, store, SerialRunner())
    condense_all(recordings[1:], models, other, SerialRunner())
    merged = merge_stores(store, other)
    assert (merged.copied, merged.present) == (2, 1)
    assert content(store) == content(whole)
    assert all(key for _, key in store_status(fleet, recordings, store).recordings)
    assert fresh(recordings, models, store) == [False] * 4


def test_prune_removes_what_is_no_longer_of_the_fleet(opened):
    fleet, recordings, models, store = opened
    condense_all(recordings, models, store, SerialRunner())
    assert len(store_status(fleet, recordings[:3], store).others) == 1
    assert len(prune_store(fleet, recordings[:3], store, only_tell=True)) == 1
    assert len(list(store.keys())) == 4
    prune_store(fleet, recordings[:3], store)
    assert len(list(store.keys())) == 3


def test_a_folder_without_a_store_is_told(opened, tmp_path):
    fleet, recordings, _, _ = opened
    with pytest.raises(DataError, match="there is no store"):
        store_status(fleet, recordings, FleetStore(Path(tmp_path / "nowhere")))
