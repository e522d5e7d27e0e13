"""Statistics as rows of a file, and back."""

from __future__ import annotations

import numpy as np
import pytest
from toy_engine import toy_monitor, toy_recording

from enginediag_cli.errors import DataError
from enginediag_cli.report.output import cell
from enginediag_cli.residuals.flat import flat_columns, flat_row, is_flat, read_flat
from enginediag_cli.residuals.pipeline import window_statistics
from enginediag_cli.residuals.windows import plan_windows


@pytest.fixture
def rows():
    monitor = toy_monitor()
    recording = toy_recording(np.random.default_rng(1), 40)
    far = recording.with_columns({"altitude_m": np.where(np.arange(40) < 20, recording["altitude_m"], 6e4)})
    windows = list(window_statistics(monitor, [far], plan_windows("20")))
    columns = flat_columns(monitor.monitored)
    flat = [flat_row(w) for w in windows]
    assert set().union(*flat) <= set(columns)
    return windows, [{c: cell(row.get(c)) for c in columns} for row in flat]


def test_statistics_survive_the_way_through_text_unchanged(rows):
    windows, texts = rows
    assert is_flat(texts[0])
    for before, (after, known) in zip(windows, read_flat(texts, "x.csv", [2, 3]), strict=True):
        assert (after.first_line, after.records, after.outside, after.reason) == (
            before.first_line,
            before.records,
            before.outside,
            before.reason,
        )
        if before.statistics is None:
            assert after.statistics is None
            continue
        assert known["hpc.efficiency"].as_mapping() == before.statistics.meaning["hpc.efficiency"].as_mapping()
        assert known["hpc.efficiency"].words == "HPC isentropic efficiency"
        for name in ("theta0", "prior_sigma", "s", "F", "V"):
            np.testing.assert_array_equal(getattr(after.statistics, name), getattr(before.statistics, name))
        assert (after.statistics.chi2, after.statistics.dof) == (
            before.statistics.chi2,
            before.statistics.dof,
        )


def test_a_wrong_cell_is_reported_with_file_line_and_column(rows):
    texts = rows[1]
    texts[0]["F:fan.efficiency|hpc.efficiency"] = "abc"
    with pytest.raises(DataError, match=r"x\.csv:2:F:fan\.efficiency\|hpc\.efficiency: not a number: 'abc'"):
        list(read_flat(texts, "x.csv", [2, 3]))


def test_a_missing_column_is_named(rows):
    texts = rows[1]
    del texts[0]["dof"]
    with pytest.raises(DataError, match=r"x\.csv:2: missing column dof"):
        list(read_flat(texts, "x.csv", [2, 3]))


def test_a_recording_is_not_mistaken_for_statistics():
    assert not is_flat(("altitude_m", "mach", "T3_K", "time_s"))


def test_statistics_that_do_not_say_what_a_parameter_is_are_refused(rows):
    texts = rows[1]
    del texts[0]["parameters"]
    with pytest.raises(DataError, match=r"x\.csv:2: missing column parameters"):
        list(read_flat(texts, "x.csv", [2, 3]))


@pytest.mark.parametrize(
    ("text", "reason"),
    [
        ("{", "not JSON"),
        ("3", "not a list of parameters"),
        ("[]", "does not say what"),
        ('[{"name": "a"}]', "'family' is missing"),
    ],
)
def test_a_spoilt_description_of_parameters_is_told_with_its_place(rows, text, reason):
    texts = rows[1]
    texts[0]["parameters"] = text
    with pytest.raises(DataError, match=rf"x\.csv:2:parameters: .*{reason}"):
        list(read_flat(texts, "x.csv", [2, 3]))
