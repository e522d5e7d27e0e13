"""Windows that are longer than what is computed together, a stretch at a time."""

from __future__ import annotations

import numpy as np
import pytest
from toy_engine import toy_monitor, toy_recording

from enginediag_cli.residuals import long_windows, pipeline
from enginediag_cli.residuals import long_windows as judged_records
from enginediag_cli.residuals.pipeline import window_statistics
from enginediag_cli.residuals.windows import plan_windows

CHANGE = {"hpc.efficiency": -0.03, "hpc.flow_capacity": -0.02}
NUMBERS = ("s", "F", "V", "n", "chi2", "dof")


def cut(recording, size):
    return [recording.select(slice(i, i + size)) for i in range(0, len(recording), size)]


def statistics(monitor, recordings, linearise):
    (window,) = window_statistics(monitor, recordings, plan_windows(None), linearise=linearise)
    assert window.reason == ""
    return window


def alike(one, other, **tolerance):
    for name in NUMBERS:
        a, b = getattr(one.statistics, name), getattr(other.statistics, name)
        np.testing.assert_allclose(
            a, b, err_msg=name, **(tolerance or {"rtol": 1e-9, "atol": 1e-9 * np.max(np.abs(b))})
        )


def short_limits(monkeypatch, stretch=150, batch=200, in_memory=120, kept=False):
    """What counts as long is short, so that a test is."""
    monkeypatch.setattr(long_windows, "STRETCH", stretch)
    monkeypatch.setattr(long_windows, "RUN", 10)
    monkeypatch.setattr(long_windows, "KEPT_BYTES", 1e9 if kept else 0.0)
    monkeypatch.setattr(pipeline, "BATCH_RECORDS", batch)
    monkeypatch.setattr(judged_records, "IN_MEMORY", in_memory)


@pytest.fixture
def recording():
    found = toy_recording(np.random.default_rng(1), 2000, change=CHANGE)
    altitude, T3 = found["altitude_m"].copy(), found["T3_K"].copy()
    altitude[[40, 700]], T3[100:130] = 14e3, np.nan  # not computed, and not recorded
    return found.with_columns({"altitude_m": altitude, "T3_K": T3})


@pytest.mark.parametrize(("linearise", "kept"), [("nominal", False), ("estimate", False), ("estimate", True)])
def test_a_long_window_has_the_statistics_of_all_its_records_at_once(monkeypatch, recording, linearise, kept):
    monitor = toy_monitor(rho=0.6, offset=3.0)
    together = statistics(monitor, [recording], linearise)
    short_limits(monkeypatch, kept=kept)
    found = statistics(monitor, [recording], linearise)
    assert found.failed == together.failed == 2
    assert found.conditions == pytest.approx(together.conditions)
    if linearise == "nominal" or kept:  # the same steps
        alike(found, together)
    else:  # two points within a fifth of a standard error of the estimate: what lies between them is of second order
        alike(found, together, rtol=2e-3, atol=2e-4 * np.max(np.abs(together.statistics.F)))


@pytest.mark.parametrize("linearise", ["nominal", "estimate"])
def test_neither_chunks_nor_the_file_in_which_records_wait_matter(monkeypatch, recording, linearise):
    monitor = toy_monitor(rho=0.6, offset=3.0)
    short_limits(monkeypatch)
    found = [statistics(monitor, cut(recording, size), linearise) for size in (2000, 333, 50)]
    monkeypatch.setattr(judged_records, "IN_MEMORY", 10**6)
    found.append(statistics(monitor, cut(recording, 333), linearise))
    for other in found[1:]:
        for name in NUMBERS:
            np.testing.assert_array_equal(getattr(other.statistics, name), getattr(found[0].statistics, name))
        assert other.counts == found[0].counts


@pytest.mark.parametrize("stretch", [70, 400])
def test_how_many_records_are_computed_together_does_not_matter(monkeypatch, recording, stretch):
    monitor = toy_monitor(rho=0.6)
    short_limits(monkeypatch)
    one = statistics(monitor, [recording], "nominal")
    short_limits(monkeypatch, stretch)
    alike(statistics(monitor, [recording], "nominal"), one)


def test_windows_that_overlap_are_those_of_each_alone(monkeypatch, recording):
    monitor = toy_monitor(rho=0.6)
    short_limits(monkeypatch)
    moving = list(window_statistics(monitor, cut(recording, 90), plan_windows("500", "250"), linearise="nominal"))
    for window, first in zip(moving, range(0, 1501, 250), strict=True):
        alone = statistics(monitor, [recording.select(slice(first, first + 500))], "nominal")
        alike(window, alone)
