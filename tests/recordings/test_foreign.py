"""Foreign files: how they are written, time stamps, lower rates, units, and the same rows in a stream."""

from __future__ import annotations

import io
import os
import socket
import threading

import numpy as np
import pytest
from shared_recordings import RECORDERS, shared_data

from enginediag_cli.errors import ConfigError, DataError
from enginediag_cli.recordings.read import read_all
from enginediag_cli.recordings.recorder_file import load_recorder
from enginediag_cli.recordings.table import MissingColumn, concat, find_missing_columns

LOGGER = """\
Prüfstand 3;Messung vom 4. März
Zeit;P3 [kPa];T3 (degC);Kraftstoff;Leistung
;kPa;°C;l/h;shp
2024-03-04T10:00:00.5+01:00;1.013,25;15,0;100,0;10
"""
RECORDER = """\
kind: recorder
description: a test bench
file: {decimal: comma, encoding: latin-1, header_line: 2, unit_row: true}
time: {from: [Zeit]}
columns:
  P3_Pa: {from: "P3 [kPa]"}
  T3_K: {from: "T3 (degC)"}
  Wf_kg_s: {from: Kraftstoff, unit: l/h, density_kg_m3: 800}
  power_W: {from: Leistung, unit: shp}
"""
ROWS = ["101,325;15,0;100,0;10", "101,5;16,0;180,0;20", "102;17,25;360,0;30"]
STAMPS = ["2024-03-04T10:00:00.5+01:00", "2024-03-04T09:00:01.5Z", "2024-03-04T09:00:02,25"]


def bench(tmp_path, recorder=RECORDER, stamps=STAMPS):
    head = LOGGER.splitlines()[:3]
    file, yaml = tmp_path / "f.csv", tmp_path / "r.yaml"
    text = "\n".join([*head, *(f"{a};{b}" for a, b in zip(stamps, ROWS, strict=True))]) + "\n"
    file.write_text(text, encoding="latin-1")
    yaml.write_text(recorder, encoding="utf-8")
    return load_recorder(yaml), file


def test_a_bench_file_with_titles_units_decimal_commas_latin_text_and_time_stamps_is_read(tmp_path):
    recorder, file = bench(tmp_path)
    (mapped,) = recorder.read(file)
    r = mapped.recording
    np.testing.assert_allclose(r["time_s"], [0.0, 1.0, 1.75])
    np.testing.assert_allclose(r["P3_Pa"], [101325.0, 101500.0, 102000.0])
    np.testing.assert_allclose(r["T3_K"], [288.15, 289.15, 290.4])
    np.testing.assert_allclose(r["Wf_kg_s"], 800 * np.array([100, 180, 360]) / 3.6e6)
    np.testing.assert_allclose(r["power_W"], 745.69987158227 * np.array([10, 20, 30]))
    assert r.line.tolist() == [4, 5, 6]


def test_time_may_be_counted_from_the_epoch_in_a_stated_form_and_zone(tmp_path):
    stated = RECORDER.replace(
        "{from: [Zeit]}", "{from: [Zeit], format: '%d.%m.%Y %H:%M:%S', zone: '+02:00', since: epoch}"
    )
    recorder, file = bench(tmp_path, stated, ["01.01.1970 02:00:00", "01.01.1970 02:00:01", ""])
    time = recorder.read(file)[0].recording["time_s"]
    np.testing.assert_array_equal(time, [0.0, 1.0, np.nan])


@pytest.mark.parametrize(
    ("stamps", "message"),
    [
        ([*STAMPS[:2], "4.3.2024 9:00"], r"f.csv:6:Zeit: not an ISO 8601 time stamp: '4.3.2024 9:00'"),
        ([STAMPS[0], STAMPS[2], STAMPS[1]], r"f.csv:6: time goes back by 0.75 s \(line 5 is later\)"),
    ],
)
def test_a_bad_stamp_and_time_that_goes_back_name_their_line(tmp_path, stamps, message):
    recorder, file = bench(tmp_path, stamps=stamps)
    with pytest.raises(DataError, match=message):
        recorder.read(file)
    with pytest.raises(DataError, match=message):
        list(recorder.stream(file))


def test_a_byte_that_is_no_text_names_line_byte_and_cure(tmp_path):
    recorder, file = bench(tmp_path, RECORDER.replace("latin-1", "utf-8"))
    with pytest.raises(DataError, match=r"f.csv:1: not UTF-8 text: byte 0xfc \(.*encoding: latin-1"):
        recorder.read(file)


def test_a_group_of_thousands_in_a_file_with_decimal_commas_is_refused(tmp_path):
    recorder, file = bench(tmp_path)
    file.write_text(LOGGER, encoding="latin-1")
    with pytest.raises(DataError, match=r"f.csv:4:P3 \[kPa\]: not a number"):
        recorder.read(file)


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("latin-1", "latin-11", "no encoding 'latin-11'"),
        ("decimal: comma", "decimal: comma, delimiter: comma", "both commas"),
        ("[Zeit]}", "[Zeit], zone: Europe/Berln}", "no time zone 'Europe/Berln'.*'Europe/Berlin'"),
        (", density_kg_m3: 800", "", "l/h is a volume flow and Wf_kg_s a mass flow.*density_kg_m3"),
        ("unit: shp", "unit: shp, density_kg_m3: 800", "a density turns"),
        ("unit: shp", "unit: shp, fill: hold", "belong together"),
        ("  P3_Pa", "  time_s: {from: t, unit: s}\n  P3_Pa", "time_s is made twice"),
    ],
)
def test_what_does_not_fit_together_in_a_recorder_is_told_with_its_line(tmp_path, old, new, message):
    with pytest.raises(ConfigError, match=message):
        bench(tmp_path, RECORDER.replace(old, new))


@pytest.mark.parametrize("delimiter", [",", ";", "\t", "|"])
def test_the_delimiter_is_the_one_that_the_header_has_most_of(tmp_path, delimiter):
    path = tmp_path / "r.yaml"
    path.write_text("kind: recorder\ndescription: x\ncolumns: {T3_K: {from: 'T3 K'}}\n", encoding="utf-8")
    text = delimiter.join(['"a,b;c"', "T3 K", "n"]) + "\n" + delimiter.join(["1", "400.5", "x"]) + "\n"
    assert load_recorder(path).read(io.StringIO(text))[0].recording["T3_K"].tolist() == [400.5]


SLOW = """\
kind: recorder
description: two rates
columns:
  time_s: {from: t, unit: s}
  N1_rpm: {from: n, unit: rpm}
  T3_K: {from: t3, unit: K, fill: hold, fill_records: 4}
  T5_K: {from: t5, unit: K, fill: interpolate, fill_records: 5}
masks: {stuck_records: 0, outlier_sigma: 0}
"""


def two_rates(n=60):
    rows = [f"{k},{5000 + k}," + (f"{600 + k},{700 + k}" if k % 5 == 0 and k != 20 else ",") for k in range(n)]
    return "\n".join(["t,n,t3,t5", *rows]) + "\n"


def test_a_slower_column_is_held_or_interpolated_as_stated_and_no_further(tmp_path):
    path = tmp_path / "r.yaml"
    path.write_text(SLOW, encoding="utf-8")
    r = load_recorder(path).read(io.StringIO(two_rates()))[0].recording
    assert r["T3_K"][:12].tolist() == [600.0] * 5 + [605.0] * 5 + [610.0] * 2
    assert r["T5_K"][:12].tolist() == [700.0 + k for k in range(12)]
    assert np.flatnonzero(np.isnan(r["T3_K"])).tolist() == [20, 21, 22, 23, 24]
    assert np.flatnonzero(np.isnan(r["T5_K"])).tolist() == [*range(16, 25), 56, 57, 58, 59]


@pytest.mark.parametrize("size", [1, 7, 1000])
def test_in_a_stream_slower_columns_are_filled_alike(tmp_path, size):
    path = tmp_path / "r.yaml"
    path.write_text(SLOW, encoding="utf-8")
    recorder = load_recorder(path)
    whole = recorder.read(io.StringIO(two_rates()))[0].recording
    parts = concat([r for _, r in recorder.stream(io.StringIO(two_rates()), size)])
    for column in whole.columns:
        np.testing.assert_array_equal(parts[column], whole[column])


@pytest.mark.shared_data
@pytest.mark.parametrize("size", [97, 3000])
@pytest.mark.parametrize("file", ["flight_ref.csv", "flight_b22.csv"])
def test_in_a_stream_the_citation_gives_the_windows_and_masks_of_the_whole_file(file, size):
    recorder, path = load_recorder(RECORDERS / "citation_jt15d.yaml"), shared_data(f"c550_jt15d/{file}")
    stream = recorder.stream(path, size)
    found: dict[str, list] = {}
    for engine, records in stream:
        found.setdefault(engine, []).append(records)
    for mapped in recorder.read(path):
        parts = concat(found[mapped.engine])
        np.testing.assert_array_equal(parts.line, mapped.recording.line)
        for column, values in mapped.recording.columns.items():
            np.testing.assert_allclose(parts[column], values, rtol=1e-6, atol=0.1 if "soak" in column else 0)
        counts = stream.engines[mapped.engine].counts
        assert {c: dict(v) for c, v in counts.columns.items()} == {c: dict(v) for c, v in mapped.masks.columns.items()}


def test_a_folder_a_device_and_a_socket_are_refused_before_they_are_read(tmp_path):
    with pytest.raises(DataError, match="a folder, not a file"):
        read_all(tmp_path)
    with pytest.raises(DataError, match="/dev/zero: a device, not a file"):
        read_all("/dev/zero")
    with socket.socket(socket.AF_UNIX) as listener:
        listener.bind(str(tmp_path / "s"))
        with pytest.raises(DataError, match="a socket, not a file"):
            read_all(tmp_path / "s")


def test_a_pipe_is_read(tmp_path):
    path = tmp_path / "pipe"
    os.mkfifo(path)
    writer = threading.Thread(target=path.write_text, args=("T3_K\n400\n",))
    writer.start()
    assert read_all(path)["T3_K"].tolist() == [400.0]
    writer.join()


def test_absent_columns_are_data_with_a_near_match_that_nobody_else_wants():
    assert find_missing_columns(["T3_K", "P3_Pa", "N1_rpm"], ["T3_k", "N1_rpm", "x"]) == (
        MissingColumn("T3_K", "T3_k"),
        MissingColumn("P3_Pa", ""),
    )
