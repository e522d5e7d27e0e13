"""Files of statistics: put together, edited, repeated, made otherwise."""

from __future__ import annotations

import csv
import io

import numpy as np
import pytest
from toy_engine import toy_monitor, toy_recording

from enginediag_cli.errors import DataError
from enginediag_cli.recordings.source import PeekedLines
from enginediag_cli.report.output import write_csv
from enginediag_cli.residuals.files import Ledger, read_statistics, refuse_ignored_options
from enginediag_cli.residuals.flat import (
    CHECKSUM,
    ORIGIN_COLUMNS,
    StatisticsOrigin,
    add_checksum,
    flat_columns,
    flat_row,
    is_flat,
    plan_cells,
)
from enginediag_cli.residuals.pipeline import window_statistics
from enginediag_cli.residuals.windows import plan_windows

MADE = StatisticsOrigin("0123", window="20", step="20")


def windows(seed=1, source="a.csv", plan="20", step=None):
    recording = toy_recording(np.random.default_rng(seed), 40, source=source)
    return list(window_statistics(toy_monitor(), [recording], plan_windows(plan, step)))


def text_of(found, made=MADE):
    stream, monitor = io.StringIO(), toy_monitor()
    columns = (*flat_columns(monitor.monitored), *ORIGIN_COLUMNS, CHECKSUM)
    write_csv((add_checksum(flat_row(w), made) for w in found), columns, stream, provenance=["enginediag: x"])
    return stream.getvalue()


def read(*texts, ledger=None):
    ledger = ledger or Ledger()
    return [
        window
        for k, text in enumerate(texts)
        for window, _ in read_statistics(io.StringIO(text), f"f{k}", ledger)
    ]  # fmt: skip


def test_a_file_holds_what_was_flown():
    found = windows()
    back = read(text_of(found))
    assert found[0].conditions and [w.conditions for w in back] == [w.conditions for w in found]


def changed(text, column, value, row=0, reseal=False):
    """The file with one cell changed; `reseal`: and the checksum made to fit, as nobody but a forger would."""
    head, _, body = text.partition("\n")
    rows = list(csv.DictReader(io.StringIO(body)))
    rows[row][column] = value
    if reseal:
        rows[row] = {k: str(v) for k, v in add_checksum(rows[row], MADE).items()}
    stream = io.StringIO()
    writer = csv.DictWriter(stream, list(rows[0]), lineterminator="\n")
    writer.writeheader()
    writer.writerows(rows)
    return f"{head}\n{stream.getvalue()}"


def test_files_put_together_by_cat_are_read_as_their_parts():
    parts = [text_of(windows(seed, f"{seed}.csv")) for seed in (1, 2)]
    together, apart = read("".join(parts)), read(*parts)
    assert len(together) == len(apart) == 4
    for one, other in zip(together, apart, strict=True):
        assert one.source == other.source
        np.testing.assert_array_equal(one.statistics.s, other.statistics.s)


def test_another_header_in_the_middle_is_refused_with_its_line():
    other = text_of(windows(2, "b.csv")).replace("s:hpt.efficiency", "s:lpt.efficiency")
    with pytest.raises(DataError, match=r"f0:6: another header.*new s:lpt\.efficiency"):
        read(text_of(windows()) + other)


def test_an_edited_number_is_refused_with_its_line():
    with pytest.raises(DataError, match=r"f0:4:checksum: .*edited after residual wrote it"):
        read(changed(text_of(windows()), "s:fan.efficiency", "123.0", row=1))


def test_a_number_written_otherwise_but_of_the_same_value_is_no_edit():
    text = text_of(windows())
    value = next(csv.DictReader(io.StringIO(text.partition("\n")[2])))["n"]
    assert len(read(changed(text, "n", f"{value}.00"))) == 2


def test_rows_of_another_making_are_refused_and_what_differs_is_told():
    other = text_of(windows(2, "b.csv"), StatisticsOrigin("0123", window="60", step="60"))
    with pytest.raises(DataError, match=r"f1:3: made otherwise than f0:3: --window 60, there 20; --step"):
        read(text_of(windows()), other)
    with pytest.raises(DataError, match="nominal 4567, there 0123"):
        read(text_of(windows()), text_of(windows(2, "b.csv"), StatisticsOrigin("4567", window="20", step="20")))


def test_the_nominal_that_is_given_must_be_theirs():
    text = text_of(windows())
    assert len(read(text, ledger=Ledger("0123"))) == 2
    with pytest.raises(DataError, match="another nominal than the one given"):
        read(text, ledger=Ledger("ffff"))


def test_a_file_that_does_not_say_how_it_was_made_is_to_be_made_anew():
    stream = io.StringIO()
    monitor = toy_monitor()
    write_csv((flat_row(w) for w in windows()), flat_columns(monitor.monitored), stream)
    with pytest.raises(DataError, match=r"f0:2: .*make them anew with `enginediag residual`"):
        read(stream.getvalue())


def test_rows_given_twice_count_once():
    text, ledger = text_of(windows()), Ledger()
    assert len(read(text, text, ledger=ledger)) == 2 and ledger.repeated == 2


def test_the_same_records_under_another_name_count_once():
    ledger = Ledger()
    found = read(text_of(windows(1, "a.csv")), text_of(windows(1, "copy.csv")), ledger=ledger)
    assert [w.source for w in found] == ["a.csv", "a.csv"] and ledger.repeated == 2


def test_windows_that_share_records_cannot_be_added_up_and_are_otherwise_told():
    first, second = text_of(windows(1)), text_of(windows(2))  # two recordings of one name
    ledger = Ledger()
    assert len(read(first, second, ledger=ledger)) == 4 and ledger.overlapping == 2
    with pytest.raises(DataError, match="would count twice"):
        read(first, second, ledger=Ledger(summed=True))


def test_moving_windows_overlap_because_they_were_asked_to():
    made = StatisticsOrigin("0123", **plan_cells(plan_windows("20", "10")))
    text, ledger = text_of(windows(plan="20", step="10"), made), Ledger()
    assert len(read(text, ledger=ledger)) == 3 and ledger.overlapping == 0
    with pytest.raises(DataError, match="would count twice"):
        read(text, ledger=Ledger(summed=True))


@pytest.mark.parametrize(
    ("column", "value", "where"),
    [
        ("V:fan.efficiency|fan.efficiency", "0", r"f0:3:V"),
        ("V:fan.efficiency|fan.efficiency", "1e30", r"f0:3:V"),
        ("V:fan.efficiency|hpc.efficiency", "1e30", r"f0:3:V"),
        ("V:fan.efficiency|fan.efficiency", "-1", r"f0:3:V:fan.efficiency|fan.efficiency: must not be negative"),
        ("F:fan.efficiency|fan.efficiency", "1e200", r"f0:3:F:fan.efficiency.*too large"),
        ("F:fan.efficiency|hpc.efficiency", "1e9", r"f0:3:F: not positive"),
        ("s:fan.efficiency", "nan", r"f0:3:s:fan.efficiency: not a"),
        ("s:fan.efficiency", "inf", r"f0:3:s:fan.efficiency: not a finite"),
        ("s:fan.efficiency", "1e305", r"f0:3:s:fan.efficiency: too large"),
        ("n", "-3", r"f0:3:n: not a whole number"),
        ("n", "2.5", r"f0:3:n: not a whole number"),
        ("n", "1000", r"f0:3:records: fewer"),
        ("dof", "0", r"f0:3:dof: must be positive"),
        ("chi2", "-5", r"f0:3:chi2: must not be negative"),
        ("prior_sigma:fan.efficiency", "0", r"f0:3:prior_sigma:fan.efficiency"),
        ("sensors", "9", r"f0:3:sensors: more than the 5"),
        ("records", "1e300", r"f0:3:records: not a whole"),
    ],
)
def test_numbers_that_no_records_give_are_refused_with_their_place(column, value, where):
    with pytest.raises(DataError, match=where):
        read(changed(text_of(windows()), column, value, reseal=True))


def test_options_that_statistics_would_ignore_are_named_as_they_are_written():
    given = {"window": "10", "step": None, "reference": 5, "false_alarm": 0.1}
    with pytest.raises(DataError, match="f holds statistics, for which --window, --reference would do nothing"):
        refuse_ignored_options(given, "f")


def test_the_head_of_a_file_tells_statistics_from_a_recording_and_nothing_of_it_is_lost():
    text = text_of(windows())
    peeked = PeekedLines(io.StringIO(text), "f")
    assert is_flat(peeked.columns) and peeked.provenance == ["enginediag: x"] and "".join(peeked) == text
    assert not is_flat(PeekedLines(io.StringIO("altitude_m,mach\n1,2\n"), "f").columns)


def test_a_flat_row_carries_how_many_sensors_were_judged():
    recording = toy_recording(np.random.default_rng(1), 40)
    recording = recording.with_columns({"T5_K": np.full(40, np.nan)})
    (found,) = window_statistics(toy_monitor(), [recording], plan_windows(None))
    assert (found.sensors, found.sensors_of) == (4, 5)
    (again,) = read(text_of([found]))
    assert (again.sensors, again.sensors_of) == (4, 5)
