"""Records of a window, kept for what needs more than its statistics."""

from __future__ import annotations

import numpy as np
import pytest
from toy_engine import toy_monitor, toy_recording

from enginediag_cli.residuals.long_windows import RecentRecords
from enginediag_cli.residuals.pipeline import window_statistics
from enginediag_cli.residuals.windows import plan_windows


def chunks_of(recording, size):
    return [recording.select(slice(k, k + size)) for k in range(0, len(recording), size)]


@pytest.mark.parametrize("length", [None, "30"])
def test_every_window_finds_its_own_records_whatever_the_chunks(length):
    monitor = toy_monitor()
    recording = toy_recording(np.random.default_rng(1), 60, flights=3)
    kept = RecentRecords(monitor, short_windows=length is not None)
    first = 0
    for window in window_statistics(monitor, kept.record(chunks_of(recording, 25)), plan_windows(length)):
        inputs, y = kept.recall(window)
        rows = slice(first, first + window.records)
        np.testing.assert_array_equal(inputs["mach"], recording.columns["mach"][rows])
        np.testing.assert_array_equal(y[:, 0], recording.columns["T3_K"][rows])
        first += window.records
    assert first == len(recording)


def test_records_of_an_earlier_file_are_let_go_and_those_that_cannot_be_judged_left_out():
    monitor = toy_monitor()
    rng = np.random.default_rng(2)
    one, two = toy_recording(rng, 20, source="a.csv"), toy_recording(rng, 20, source="b.csv")
    two.columns["mach"][3] = np.nan
    kept = RecentRecords(monitor, short_windows=False)
    windows = list(window_statistics(monitor, kept.record([one, two]), plan_windows(None)))
    assert len(kept.recall(windows[0])[1]) == 20
    assert len(kept.recall(windows[1])[1]) == 19
    assert kept.recall(windows[0]) is None
