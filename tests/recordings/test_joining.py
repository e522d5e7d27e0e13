"""Exports of one reading a line, and files of other rates: each value at the record that it belongs to."""

from __future__ import annotations

import io

import numpy as np
import pytest

from enginediag_cli.errors import DataError
from enginediag_cli.recordings import clocks as joining
from enginediag_cli.recordings.clocks import last_values, nearest_records
from enginediag_cli.recordings.recorder_file import load_recorder
from enginediag_cli.recordings.table import concat

LONG = """\
kind: recorder
description: an export of a historian
file: {long: {tag: Tag, value: Value, quality: Status, good: [Good], max_age_s: 25, clock: TI3}}
time: {from: [Timestamp], since: epoch}
columns:
  T3_K: {from: TI3, unit: degC}
  N1_rpm: {from: SI1, unit: rpm}
masks: {stuck_records: 0, outlier_sigma: 0, frozen_records: 0}
"""


def stated(tmp_path, yaml: str):
    path = tmp_path / "r.yaml"
    path.write_text(yaml, encoding="utf-8")
    return load_recorder(path)


def readings(n: int = 200):
    """Lines of two tags by tag: TI3 every 10 s, SI1 every 30 s, some of them bad, and a tag that nobody uses."""
    hour = "2024-05-01T10:{:02d}:{:02d}Z"
    rows = [(10 * k, "TI3", 400 + k, "Good") for k in range(n)] + [(5, "XX", "on", "Good")]
    rows += [(30 * k + 2, "SI1", 5000 + k, "Bad" if k == 2 else "Good") for k in range(n // 3)]
    return [(t, ",".join([hour.format(t // 60, t % 60), tag, str(v), q])) for t, tag, v, q in rows if t < 3600]


def expected(n: int = 200):
    t = 10.0 * np.arange(n)
    k = np.floor((t - 2) / 30)
    speed = np.where((k < 0) | (k >= n // 3) | (t - 2 - 30 * k > 25) | (k == 2), np.nan, 5000 + k)
    return t, 400 + np.arange(n) + 273.15, speed


@pytest.mark.parametrize("block", [3, 4096])
@pytest.mark.parametrize("by_time", [True, False])
def test_a_long_export_becomes_records_whatever_the_order_of_its_lines(tmp_path, monkeypatch, block, by_time):
    monkeypatch.setattr(joining, "BLOCK", block)
    lines = readings()
    lines = sorted(lines) if by_time else lines
    text = "Timestamp,Tag,Value,Status\n" + "\n".join(line for _, line in lines) + "\n"
    recorder = stated(tmp_path, LONG)
    r = recorder.read(io.StringIO(text))[0].recording
    t, temperature, speed = expected()
    np.testing.assert_allclose(r["time_s"] - r["time_s"][0], t)
    np.testing.assert_allclose(r["T3_K"], temperature)
    np.testing.assert_array_equal(r["N1_rpm"], speed)
    parts = concat([p for _, p in recorder.stream(io.StringIO(text), 7)])
    np.testing.assert_array_equal(parts["N1_rpm"], speed)


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("SI1", "SI9", r"no reading of the tag SI1; others are XX, SI9"),
        ("TI3,405,", "TI3,4o5,", r"<stream>:7:Value: not a number: '4o5'"),
        ("10:00:50Z,TI3", "10:00:10Z,TI3", r"<stream>:7: time goes back"),
    ],
)
def test_what_is_wrong_with_a_long_export_has_its_line(tmp_path, old, new, message):
    text = "Timestamp,Tag,Value,Status\n" + "\n".join(line for _, line in readings(30)) + "\n"
    with pytest.raises(DataError, match=message):
        stated(tmp_path, LONG).read(io.StringIO(text.replace(old, new)))


JOINED = """\
kind: recorder
description: two files of a logger
time: {from: [t], format: seconds}
joins:
  - {name: slow, recording: "{name}_slow.csv", cut: _fast, how: HOW, max_age_s: 2.5}
columns:
  N1_rpm: {from: n, unit: rpm}
  T3_K: {from: slow.t3, unit: K}
masks: {stuck_records: 0, outlier_sigma: 0, frozen_records: 0}
"""


@pytest.mark.parametrize(("how", "held"), [("hold", 3), ("nearest", 1)])
@pytest.mark.parametrize("size", [1, 2, 7, 1000])
def test_a_slower_file_is_joined_on_time_held_or_to_the_nearest_record_once(tmp_path, how, held, size):
    (tmp_path / "a_fast.csv").write_text("t,n\n" + "".join(f"{k},{5000 + k}\n" for k in range(60)))
    (tmp_path / "a_slow.csv").write_text("t,t3,u\n" + "".join(f"{5 * k + 0.2},{400 + k},x\n" for k in range(9)))
    recorder = stated(tmp_path, JOINED.replace("HOW", how))
    found = concat([p for _, p in recorder.stream(tmp_path / "a_fast.csv", size)])
    assert found["N1_rpm"].tolist() == [5000.0 + k for k in range(60)]
    want = np.full(60, np.nan)
    for k in range(9):
        first = 5 * k + (1 if how == "hold" else 0)
        want[first : first + (2 if how == "hold" else held)] = 400 + k
    np.testing.assert_array_equal(found["T3_K"], want)


def test_a_file_on_another_clock_or_that_is_not_there_is_an_error(tmp_path):
    recorder = stated(tmp_path, JOINED.replace("HOW", "hold"))
    fast = tmp_path / "a_fast.csv"
    fast.write_text("t,n\n0,1\n1,2\n")
    with pytest.raises(DataError, match=r"a_slow.csv: No such file"):
        recorder.read(fast)
    (tmp_path / "a_slow.csv").write_text("t,t3\n3600,400\n")
    with pytest.raises(DataError, match=r"a_slow.csv: no reading within 2.5 s of a record of .*a_fast.csv"):
        recorder.read(fast)
    with pytest.raises(DataError, match="not standard input"):
        recorder.read(io.StringIO("t,n\n0,1\n"))
    (tmp_path / "b.csv").write_text("t,n\n0,1\n")
    with pytest.raises(DataError, match="does not end in '_fast'"):
        recorder.read(tmp_path / "b.csv")


def test_the_last_reading_and_the_nearest_record_against_every_pair():
    draw = np.random.default_rng(5)
    times, at = np.sort(draw.uniform(0, 10, 40)), np.sort(draw.uniform(0, 10, 60))
    values = draw.normal(size=40)
    for t, found in zip(at, last_values(times, values, at, 0.3), strict=True):
        before = np.flatnonzero(times <= t)
        young = before.size and t - times[before[-1]] <= 0.3
        np.testing.assert_equal(found, values[before[-1]] if young else np.nan)
    rows, records = nearest_records(times, at, 0.1)
    for k, time in enumerate(times):
        near = np.abs(at - time).min()
        assert (k in rows) == (near <= 0.1)
    for k, record in zip(rows, records, strict=True):
        assert abs(at[record] - times[k]) == np.abs(at - times[k]).min()
