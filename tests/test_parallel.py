"""Work that several processes share gives what one process gives, and an end that is told."""

from __future__ import annotations

import os
import signal
import time

import numpy as np
import pytest

from enginediag_cli.engine import strategy as batch
from enginediag_cli.engine.strategy import SHARE
from enginediag_cli.errors import DataError, WorkerDiedError
from enginediag_cli.parallel import (
    CAN_FORK,
    ProcessCodec,
    parallel_imap,
    parallel_map,
    process_count,
    resident_MB,
    use_processes,
)
from enginediag_cli.physics.engine_file import load_engine
from enginediag_cli.shipped import shipped

pytestmark = pytest.mark.skipif(not CAN_FORK, reason="processes cannot begin as copies on this system")


@pytest.mark.parametrize("jobs", [1, 2, 3, 8])
def test_results_come_in_the_order_of_the_pieces_whoever_does_them(jobs):
    with use_processes(jobs):
        for pieces in (0, 1, 2, 7):
            assert parallel_map(lambda k: k * k, pieces) == [k * k for k in range(pieces)]
        for pieces in (0, 1, 40, 47):
            assert list(parallel_imap(lambda k: k * k, pieces)) == [k * k for k in range(pieces)]


def test_other_processes_do_pieces_and_are_gone_afterwards():
    with use_processes(3):
        found = parallel_map(lambda k: os.getpid(), 6)
    assert len(set(found)) == 3 and found[0] == os.getpid()
    for process in set(found) - {os.getpid()}:
        with pytest.raises(ProcessLookupError):
            os.kill(process, 0)


def test_pieces_of_a_piece_are_done_where_it_is():
    with use_processes(2):
        found = parallel_map(lambda k: (os.getpid(), parallel_map(lambda j: os.getpid(), 3)), 2)
    assert all(inner == [outer] * 3 for outer, inner in found) and process_count(9) == 1


@pytest.mark.parametrize("bad", [0, 1, 3])
def test_what_a_piece_raises_is_raised(bad):
    def work(k: int) -> int:
        if k >= bad:
            raise DataError(f"piece {k}")
        return k

    for jobs in (1, 2):
        with use_processes(jobs), pytest.raises(DataError, match=f"piece {bad}"):
            parallel_map(work, 4)


def test_a_result_that_cannot_be_pickled_is_an_error_with_its_reason():
    with use_processes(2), pytest.raises(TypeError, match="cannot be pickled"):
        parallel_map(lambda k: lambda: k, 2)


@pytest.mark.parametrize("jobs", [1, 2])
def test_what_both_processes_have_comes_back_as_itself(jobs):
    known = [object(), [1.0], "a name"]
    with use_processes(jobs):
        found = parallel_map(lambda k: (known[0], {"of": known[1]}, [k]), 4, ProcessCodec(shared=known))
    assert [own for *_, own in found] == [[0], [1], [2], [3]]
    assert all(first is known[0] and named["of"] is known[1] for first, named, _ in found)


def test_only_what_another_process_did_is_packed():
    handing = ProcessCodec(pack=lambda f: f(), unpack=lambda value: lambda: value + 10)
    with use_processes(2):
        found = parallel_map(lambda k: lambda: k, 4, handing)
    assert [f() for f in found] == [0, 11, 2, 13]


def test_a_process_that_is_killed_is_told():
    def work(k: int) -> int:
        if k == 1:
            os.kill(os.getpid(), signal.SIGKILL)
        return k

    with use_processes(2), pytest.raises(WorkerDiedError, match="fewer --jobs"):
        parallel_map(work, 2)


def test_whoever_is_interrupted_leaves_no_process_behind(tmp_path):
    other = tmp_path / "other"

    def work(k: int) -> int:
        if k:
            other.write_text(f"{os.getpid()}\n")
            time.sleep(60)
        while not (other.exists() and other.read_text().endswith("\n")):
            time.sleep(0.01)
        raise KeyboardInterrupt

    with use_processes(2), pytest.raises(KeyboardInterrupt):
        parallel_map(work, 2)
    with pytest.raises(ProcessLookupError):
        os.kill(int(other.read_text()), 0)


@pytest.mark.parametrize("fails", [False, True])
def test_a_prediction_is_the_same_to_the_last_digit_whoever_solves_its_points(fails, monkeypatch):
    monkeypatch.setattr(batch, "resident_MB", lambda: 0.0)
    engine = load_engine(shipped("turbofan.yaml"))
    rng = np.random.default_rng(5)
    n = 3 * SHARE + 17
    inputs = {"altitude_m": rng.uniform(0, 11e3, n), "mach": rng.uniform(0.2, 0.8, n), "dT_isa_K": np.zeros(n)}
    inputs[engine.power_setting] = engine.power_from_fraction(rng.uniform(0.3, 1.0, n), inputs)
    inputs["mach"][5] = np.nan
    if fails:
        inputs[engine.power_setting][7] *= 50.0
    found = []
    for jobs in (1, 2, 3):
        with use_processes(jobs):
            found.append(engine.predict(inputs, {"hpc.efficiency": 0.98}, wrt=engine.monitored, also=("T4_K",)))
    one, *others = found
    assert (not one.ok[7]) == fails and not one.ok[5]
    for other in others:
        for name in ("y", "jacobian", "also", "x", "residual", "passes", "status"):
            assert np.array_equal(getattr(one, name), getattr(other, name), equal_nan=True), name
        assert [one.reason(k) for k in range(n)] == [other.reason(k) for k in range(n)]
        assert all(np.array_equal(one.limits[name], other.limits[name]) for name in one.limits)


def test_a_large_process_has_no_copy_of_it_solve_few_points(monkeypatch):
    """The copy would take longer than the points."""
    engine, n, asked = load_engine(shipped("turbojet.yaml")), 2 * SHARE, []
    inputs = {"altitude_m": np.zeros(n), "mach": np.zeros(n), "dT_isa_K": np.zeros(n)}
    inputs[engine.power_setting] = engine.power_from_fraction(np.full(n, 0.8), inputs)
    monkeypatch.setattr(batch, "parallel_map", lambda work, pieces: asked.append(pieces) or [None] * pieces)
    for memory in (0.0, 1000.0):
        monkeypatch.setattr(batch, "resident_MB", lambda memory=memory: memory)
        with use_processes(2):
            assert engine.predict(inputs, {}).ok.all()
        assert asked == [2]


def test_a_process_knows_how_much_memory_it_holds():
    before = resident_MB()
    kept = np.ones(25_000_000)
    assert 150.0 < resident_MB() - before < 300.0 and kept.size
