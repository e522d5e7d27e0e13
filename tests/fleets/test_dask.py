"""A Dask cluster of separate processes gives what one process gives, also when one of its workers is killed."""

from __future__ import annotations

import os
import signal

import pytest
import small_fleet

from enginediag_cli.errors import DataError
from enginediag_cli.fleets.models import SerialRunner
from enginediag_cli.fleets.run import condense_all, engine_tasks, judge_task
from enginediag_cli.fleets.store import FleetStore

distributed = pytest.importorskip("distributed", reason="pip install 'enginediag[fleet]' for tests with Dask")


def killed_once(task):
    """The work of a recording, in a worker that dies of its first one."""
    import os

    from enginediag_cli.fleets.store import condense

    marker = os.path.join(os.path.dirname(task.store), "died")
    try:
        os.close(os.open(marker, os.O_CREAT | os.O_EXCL))
    except FileExistsError:
        return condense(task)
    os.kill(os.getpid(), signal.SIGKILL)
    return None


@pytest.mark.slow
@pytest.mark.parametrize("workers", [2, 8])
def test_a_cluster_that_loses_a_worker_finds_what_one_process_finds(fleet_file, tmp_path, monkeypatch, workers):
    from enginediag_cli.fleets import run
    from enginediag_cli.fleets.models import DaskRunner

    monkeypatch.setattr(run, "BATCH_FILES", 1)
    fleet, recordings, models, alone = small_fleet.opened(fleet_file, tmp_path / "alone")
    store = FleetStore(tmp_path / "store")
    condense_all(recordings, models, alone, SerialRunner())
    environment = {"PYTHONPATH": os.pathsep.join([os.path.dirname(__file__), os.environ.get("PYTHONPATH", "")])}
    with pytest.MonkeyPatch.context() as patch:
        for name, value in environment.items():
            patch.setenv(name, value)
        with distributed.LocalCluster(
            n_workers=workers, threads_per_worker=1, processes=True, dashboard_address=None, silence_logs=50
        ) as cluster:
            runner = DaskRunner(cluster.scheduler_address)
            patch.setattr(run, "condense", killed_once)
            outcomes = condense_all(recordings, models, store, runner)
            tasks, _ = engine_tasks(fleet, list(zip(recordings, outcomes, strict=True)), models, store)
            findings = dict(runner.run(judge_task, tasks))
            runner.close()
    assert (tmp_path / "died").exists()
    assert all(outcome.condensed is not None for outcome in outcomes)
    for key in alone.keys():
        assert store.path(key).read_bytes() == alone.path(key).read_bytes()
    for number, task in enumerate(tasks):
        assert str(findings[number].finding) == str(judge_task(task).finding)


def test_a_scheduler_that_does_not_answer_is_told(monkeypatch):
    from enginediag_cli.fleets import models as on_dask

    monkeypatch.setattr(on_dask, "CONNECT_S", 0.2)
    with pytest.raises(DataError, match="no Dask scheduler answers"):
        on_dask.DaskRunner("tcp://127.0.0.1:9")
