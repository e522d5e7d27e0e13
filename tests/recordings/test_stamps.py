"""Clocks of recordings: midnight, dates in a column of their own, zones with summer time, numbers."""

from __future__ import annotations

from datetime import datetime, timedelta, timezone
from zoneinfo import ZoneInfo, available_timezones

import numpy as np
import pytest

from enginediag_cli.errors import DataError
from enginediag_cli.recordings.clocks import TimeStamps
from enginediag_cli.recordings.table import Recording, concat

zones = pytest.mark.skipif("Europe/Berlin" not in available_timezones(), reason="no list of time zones (tzdata)")


def cells(**columns: list[str]) -> Recording:
    n = len(next(iter(columns.values())))
    return Recording({}, columns, line=np.arange(2, n + 2), source="f.csv")


def moments(start: datetime, n: int, step_s: float = 600.0) -> list[datetime]:
    return [start + timedelta(seconds=step_s * k) for k in range(n)]


START = datetime(2024, 3, 4, 22, 0)


@pytest.mark.parametrize(
    ("sources", "form", "write"),
    [
        (("t",), "%H:%M:%S", lambda m: {"t": f"{m:%H:%M:%S}"}),
        (("t",), "iso", lambda m: {"t": f"{m:%H:%M:%S}"}),
        (("t",), "seconds_of_day", lambda m: {"t": str(m.hour * 3600 + m.minute * 60 + m.second)}),
        (("t",), "iso", lambda m: {"t": f"{m.hour}:{m:%M:%S}.0"}),
        (("t",), "iso", lambda m: {"t": f"{m:%Y-%m-%d} {m.hour}:{m:%M}"}),
        (("d", "t"), "iso", lambda m: {"d": f"{m:%Y-%m-%d}", "t": f"{m:%H:%M:%S}"}),
        (("d", "t"), "iso", lambda m: {"d": f"{START:%Y-%m-%d}", "t": f"{m:%H:%M:%S}"}),  # the day on which it began
        (("d", "t"), "%d.%m.%Y %H:%M", lambda m: {"d": f"{m:%d.%m.%Y}", "t": f"{m:%H:%M}"}),
        (("t",), "excel_days", lambda m: {"t": repr((m - datetime(1899, 12, 30)) / timedelta(days=1))}),
        (("t",), "epoch_ms", lambda m: {"t": str(round(m.replace(tzinfo=timezone.utc).timestamp() * 1e3))}),
    ],
)
@pytest.mark.parametrize("size", [1, 1000])
def test_a_clock_goes_on_past_midnight_however_it_is_written(sources, form, write, size):
    written = [write(m) for m in moments(START, 300)]  # two days: midnight twice
    whole = cells(**{c: [row[c] for row in written] for c in sources})
    stamps = TimeStamps(sources, form)
    parts = [stamps.seconds(whole.select(slice(k, k + size))) for k in range(0, 300, size)]
    np.testing.assert_allclose(np.concatenate(parts), 600.0 * np.arange(300), atol=2e-3)


def test_a_date_that_changes_a_record_after_midnight_adds_no_day():
    r = cells(d=["2024-03-04"] * 3 + ["2024-03-05"] * 2, t=["23:59:58", "23:59:59", "00:00:00", "00:00:01", "00:00:02"])
    assert TimeStamps(("d", "t")).seconds(r).tolist() == [0.0, 1.0, 2.0, 3.0, 4.0]


@zones
@pytest.mark.parametrize("zone", ["Europe/Berlin", "America/St_Johns", "Australia/Lord_Howe"])
def test_local_time_of_a_zone_is_read_through_both_changes_of_summer_time(zone):
    for start in (datetime(2024, 3, 1), datetime(2024, 9, 1)):
        utc = moments(start.replace(tzinfo=timezone.utc), 4500, 1200.0)
        local = cells(t=[f"{m.astimezone(ZoneInfo(zone)):%Y-%m-%d %H:%M:%S}" for m in utc])
        found = TimeStamps(("t",), zone=zone, since="epoch").seconds(local)
        np.testing.assert_array_equal(found, [m.timestamp() for m in utc])


@zones
@pytest.mark.parametrize(
    ("stamp", "message"),
    [
        ("2024-03-31 02:30:00", "f.csv:2:t: 2024-03-31 02:30:00 does not exist in Europe/Berlin"),
        ("2024-10-27 02:30:00", "f.csv:2:t: 2024-10-27 02:30:00 comes twice in Europe/Berlin"),
    ],
)
def test_an_hour_that_a_zone_has_not_or_twice_is_refused_where_nothing_says_which(stamp, message):
    with pytest.raises(DataError, match=message):
        TimeStamps(("t",), zone="Europe/Berlin").seconds(cells(t=[stamp]))


def test_stamps_with_their_own_offset_need_no_zone_and_empty_ones_are_missing():
    r = cells(t=["2024-01-01T00:00:00+02:00", "", "No Data", "2023-12-31T22:00:01Z"])
    np.testing.assert_array_equal(TimeStamps(("t",), zone="-05:00").seconds(r), [0.0, np.nan, np.nan, 1.0])


def test_two_recordings_in_turn_are_one_series():
    a, b = cells(t=["23:59:59"]), cells(t=["00:00:00"])
    both = TimeStamps(("t",), "%H:%M:%S").seconds(concat([a, b]))
    stamps = TimeStamps(("t",), "%H:%M:%S")
    assert [*stamps.seconds(a), *stamps.seconds(b)] == both.tolist() == [0.0, 1.0]
