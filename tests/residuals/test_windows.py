"""Windows cut from streams."""

from __future__ import annotations

import numpy as np
import pytest

from enginediag_cli.residuals.windows import WindowAssembler, plan_windows


def windows(plan, positions, chunk=7):
    """Record numbers in each window, fed in chunks."""
    assembler, found = WindowAssembler(plan), []
    blocks = plan.blocks(np.asarray(positions, float))
    for first in range(0, len(blocks), chunk):
        part = blocks[first : first + chunk]
        for block in np.unique(part):
            records = first + np.flatnonzero(part == block)
            found += assembler.push(int(block), list(records))
    found += assembler.flush()
    return [[record for piece in pieces for record in piece] for pieces in found]


def test_windows_follow_each_other_and_the_last_one_may_be_short():
    assert windows(plan_windows("10"), range(25)) == [
        list(range(10)),
        list(range(10, 20)),
        list(range(20, 25)),
    ]


def test_moving_windows_overlap_by_length_minus_step():
    found = windows(plan_windows("10", "4"), range(22))
    assert found == [list(range(first, first + 10)) for first in (0, 4, 8, 12)]


def test_a_moving_window_ends_with_the_last_record_even_off_the_grid():
    assert windows(plan_windows("10", "4"), range(20))[-1] == list(range(12, 20))


def test_without_a_length_the_whole_flight_is_one_window():
    assert windows(plan_windows(None), range(23)) == [list(range(23))]


def test_windows_in_time_skip_gaps():
    seconds = [0, 5, 9, 12, 1000, 1001, 1009]
    assert windows(plan_windows("10s"), seconds) == [[0, 1, 2], [3], [4, 5, 6]]


def test_a_gap_in_time_gives_no_window_without_new_records():
    seconds = [0, 1, 2, 3, 4, 50, 51]
    assert windows(plan_windows("4s", "1s"), seconds) == [[0, 1, 2, 3], [1, 2, 3, 4], [5], [5, 6]]


@pytest.mark.parametrize(
    ("length", "step", "words"),
    [
        ("ten", None, "number of records"),
        ("10", "20", "skip"),
        ("10", "5s", "both"),
        (None, "5", "needs"),
        ("2.5", None, "number of records"),
    ],
)
def test_plans_that_make_no_sense_are_refused(length, step, words):
    with pytest.raises(ValueError, match=words):
        plan_windows(length, step)
