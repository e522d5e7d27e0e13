"""Files of historians, spreadsheets, loggers and C programs: what is a record, and what only looks like one."""

from __future__ import annotations

import gzip
import io
import sys
import zipfile
from datetime import datetime, time

import numpy as np
import pytest

from enginediag_cli.errors import DataError
from enginediag_cli.recordings.read import read, read_all
from enginediag_cli.recordings.recorder_file import load_recorder
from enginediag_cli.recordings.source import GrowingFile
from enginediag_cli.recordings.table import ReadingCounts, concat


def text(content: str):
    return io.StringIO(content, newline="")


def recorder(tmp_path, keys: str, columns: str = "{T3_K: {from: t, unit: K}}"):
    path = tmp_path / "r.yaml"
    path.write_text(f"kind: recorder\ndescription: x\n{keys}\ncolumns: {columns}\n", encoding="utf-8")
    return load_recorder(path)


def counted(content: str, **how):
    counts = ReadingCounts()
    return read_all(text(content), counts=counts, **how), counts


@pytest.mark.parametrize(
    "word", ["Bad", "No Data", "***", "-", "#N/A", "I/O Timeout", "shutdown", "[-11059] No Good Data", "1.#QNAN"]
)
def test_the_words_of_historians_for_no_value_are_missing_values_and_counted(word):
    r, counts = counted(f"time_s,T3_K\n0,400\n1,{word}\n2,402\n")
    np.testing.assert_array_equal(r["T3_K"], [400.0, np.nan, 402.0])
    assert counts.words == {"T3_K": {word: 1}}


def test_a_recorder_states_further_words_and_codes_for_missing(tmp_path):
    r = recorder(tmp_path, 'file: {missing: ["out to lunch", "-9999"]}')
    (mapped,) = r.read(text("t\n400\nOut to Lunch\n-9999.00\n401\n"))
    assert np.isnan(mapped.recording["T3_K"]).tolist() == [False, True, True, False]
    assert "T3_K" not in mapped.counts.words and mapped.counts.words["t"] == {"Out to Lunch": 1, "-9999": 1}
    with pytest.raises(DataError, match=r":3:t: not a number: 'lunch'; .*missing: \[\"lunch\"\]"):
        r.read(text("t\n400\nlunch\n401\n"))


@pytest.mark.parametrize(
    ("mark", "decimal", "cell", "value"),
    [
        ("comma", "point", '"1,234.5"', 1234.5),
        ("point", "comma", "1.234,5", 1234.5),
        ("space", "comma", "1 234,5", 1234.5),
        ("space", "point", "12\u202f345", 12345.0),
        ("apostrophe", "point", "1'234'567", 1234567.0),
    ],
)
def test_groups_of_three_digits_are_parted_by_the_stated_mark_and_only_so(tmp_path, mark, decimal, cell, value):
    r = recorder(tmp_path, f"file: {{thousands: {mark}, decimal: {decimal}, delimiter: semicolon}}", "{x: {from: t}}")
    assert r.read(text(f"t;u\n{cell};0\n1;0\n"))[0].recording["x"].tolist() == [value, 1.0]
    wrong = cell.replace("234", "23").replace("345", "34")
    with pytest.raises(DataError, match=":2:t: not a number"):
        r.read(text(f"t;u\n{wrong};0\n1;0\n"))


def test_columns_parted_by_blanks_and_without_a_header_are_named_by_the_recorder(tmp_path):
    keys = "file: {delimiter: whitespace, header: none, names: [unit, cycle, '', t]}\ntext: {engine: unit}"
    (mapped,) = recorder(tmp_path, keys).read(text("1 1  0.5 400.5  \n1 2  0.5 401\n\n2 1  0.5 402\n"))
    r = mapped.recording
    assert r["T3_K"].tolist() == [400.5, 401.0, 402.0] and r.text["engine"] == ["1", "1", "2"]
    assert r.line.tolist() == [1, 2, 4]
    with pytest.raises(DataError, match=r":2: 3 fields where `names` has 4"):
        recorder(tmp_path, keys).read(text("1 1 0 400\n1 2 0\n1 3 0 402\n"))


def test_columns_of_fixed_width(tmp_path):
    keys = "file: {delimiter: fixed, widths: [4, 6, 6], header_line: 2}"
    r = recorder(tmp_path, keys, "{T3_K: {from: T3, unit: K}, N1_rpm: {from: N1, unit: rpm}}")
    body = "logger 7\nt   T3    N1    \n   0400.5 12345\n   1      12346\n   2401.5 12347\n"
    found = r.read(text(body))[0].recording
    np.testing.assert_array_equal(found["T3_K"], [400.5, np.nan, 401.5])
    assert found["N1_rpm"].tolist() == [12345.0, 12346.0, 12347.0]


@pytest.mark.parametrize(
    "content",
    [
        ",time_s,T3_K\n0,0,400\n1,1,401\n",  # the index of pandas
        "time_s,T3_K,\n0,400,\n1,401,\n",  # loggers that end lines with a comma
        "time_s,T3_K,\n0,400\n1,401\n",
        "time_s,T3_K\n0,400,\n1,401,\n",
        "time_s,T3_K,spare,spare\n0,400,1,2\n1,401,1,2\n",
        "time_s,T3_K\ntime_s,T3_K\n0,400\ntime_s,T3_K\n1,401\n",
        "time_s,T3_K\ns,K\n0,400\n1,401\n",
        "time_s,T3_K\n[s],[degK]\n0,400\n1,401\n".replace("degK", "K"),
        "time_s,T3_K\n0,400\n# paused\n1,401\n",
        "time_s,T3_K\n0,400\n1,401\n\nEnd of log\n2 rows selected\n",
        "time_s,T3_K\n0,400\n1,401\nMean,400.5\n",
        "time_s,T3_K,x\n0,400,a\n1,401,b\n2,4",  # cut off
        "\ntime_s,T3_K\r\n0,400\r\n\r\n1,401\r\n",
    ],
)
@pytest.mark.parametrize("size", [1, 2, 1000])
def test_what_is_no_record_is_passed_over_whatever_the_chunks(content, size):
    r = concat(list(read(text(content), chunk_records=size)))
    assert r["time_s"].tolist() == [0.0, 1.0] and r["T3_K"].tolist() == [400.0, 401.0]


def test_what_was_passed_over_is_counted_with_its_line():
    _, counts = counted("a_s,T3_K\n0,1\na_s,T3_K\n1,2\nEnd\n")
    assert counts.lines == {"repeated header": [1, 3], "footer": [1, 5]}
    assert counts.report_lines()[0] == "line 3 is passed over: repeated header"


@pytest.mark.parametrize(
    ("content", "message"),
    [
        ("time_s,T3_K\n0,400\nEnd of log\n1,401\n", ":3: 1 fields where the header has 2: End of log"),
        ("time_s,T3_K\n0,400\n1,4o1\n2,402\n", ":3:T3_K: not a number: '4o1'"),
        ("time_s,T3_K\n0,400\n1,4o1\n", ":3:T3_K: not a number: '4o1'"),
        ("time_s,T3_K\n0,400\n1,401,7\n", ":3: 3 fields where the header has 2"),
        ("time_s,T3_K\ns,DEG C\n0,400\n", ":2:T3_K: the row of units says DEG C, the column's name K"),
        ("time_s,P3_psi\nsec,psig\n0,400\n", ":2:P3_psi: the row of units says psig, the column's name psi"),
        ('time_s,T3_K\n0,"1,400"\n1,2\n', ":2:T3_K: not a number: '1,400'.*thousands: comma"),
        ("1 1 0.5 400.5\n1 2 0.5 401\n", ":1: numbers where a header should.*delimiter: whitespace, header: none"),
        ("0,400\n1,401\n", ":1: numbers where a header should name the columns"),
        ("time_s T3_K\n0 400\n", r":1: one column.*delimiter: whitespace"),
        ("time_s,T3_K,T3_K\n0,400,1\n", ":1:T3_K: two columns have this name"),
    ],
)
def test_what_is_neither_a_record_nor_a_footer_is_an_error_with_its_place(content, message):
    with pytest.raises(DataError, match=message):
        read_all(text(content))


def test_lines_that_are_no_records_are_counted_in_a_file_that_is_still_written():
    r, counts = counted("time_s,T3_K\n0,400\ngarb\x01age\n1,401\n", tolerant=True)
    assert r["T3_K"].tolist() == [400.0, 401.0] and counts.lines == {"unreadable": [1, 3]}


@pytest.mark.parametrize("codec", ["utf-16", "utf-8-sig", "utf-32"])
def test_a_byte_order_mark_says_which_unicode_a_file_is(tmp_path, codec):
    path = tmp_path / "f.csv"
    path.write_text("time_s,T3_K,Öl\n0,400,ä\n", encoding=codec)
    assert read_all(path).text["Öl"] == ["ä"]


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (b"\x89HDF\r\n\x1a\n0000", "an HDF5 file.*export it as CSV or Parquet"),
        (b"MATLAB 5.0 MAT-file, Platform", "a MATLAB .mat file"),
        (b"PK\x03\x04....", "a zip archive, or an Excel workbook"),
        (b"\xd0\xcf\x11\xe0\xa1\xb1\x1a\xe1", "an Excel 97 workbook"),
        ("T3_K\n400\n".encode("utf-16-le"), "UTF-16 text without a byte order mark.*utf-16-le"),
        (b"T3_K\n4\x0000\n", "binary data"),
        (b"T3_K\n" + b"400\n" * 500 + b"4\x0001\n", r":502:2: a NUL character"),
        (b"x" * 1_500_000, ":1: a line of more than 1000000 characters"),
        (gzip.compress(gzip.compress(b"T3_K\n400\n", mtime=0), mtime=0), "packed by gzip twice"),
        (gzip.compress(b"T3_K\n" + b"\0" * 3_000_000), ":2: a line of more than|binary data"),
    ],
)
def test_what_is_no_text_is_named_and_refused_early(tmp_path, content, message):
    path = tmp_path / "f.csv"
    path.write_bytes(content)
    with pytest.raises(DataError, match=message):
        read_all(path)


def test_a_packed_file_is_read_whatever_it_is_called(tmp_path):
    path = tmp_path / "f.csv"
    path.write_bytes(gzip.compress(b"T3_K\n400\n"))
    assert read_all(path)["T3_K"].tolist() == [400.0]


@pytest.fixture
def workbook(tmp_path):
    openpyxl = pytest.importorskip("openpyxl")
    book = openpyxl.Workbook()
    sheet = book.active
    for row in [
        ["Test bench 3", None],
        ["Date", "Time", "T3", "n"],
        [None, None, "degC", "rpm"],
        [datetime(2024, 3, 4), time(23, 59, 59), 15.5, 5000],
        [datetime(2024, 3, 5), time(0, 0, 0), "#N/A", 5001],
        [datetime(2024, 3, 5), time(0, 0, 1), 16, 5002],
        [None, "Mean", 15.75, 5001],
    ]:
        sheet.append(row)
    book.create_sheet("notes").append(["nothing"])
    book.save(tmp_path / "bench.xlsx")
    return tmp_path / "bench.xlsx"


BENCH = "time: {from: [Date, Time]}\nfile: {header_line: 2, unit_row: true, sheet: SHEET, decimal: comma}"


def test_a_sheet_of_a_workbook_is_a_table(tmp_path, workbook):
    columns = "{T3_K: {from: T3, unit: degC}, N1_rpm: {from: n, unit: rpm}}"
    r = recorder(tmp_path, BENCH.replace("SHEET", "Sheet"), columns)
    (mapped,) = r.read(workbook)
    assert mapped.recording["time_s"].tolist() == [0.0, 1.0, 2.0] and mapped.recording.line.tolist() == [4, 5, 6]
    np.testing.assert_allclose(mapped.recording["T3_K"], [288.65, np.nan, 289.15])
    assert mapped.counts.words == {"T3": {"#N/A": 1}}
    with pytest.raises(DataError, match="no sheet 'data'; there are Sheet, notes"):
        recorder(tmp_path, BENCH.replace("SHEET", "data"), columns).read(workbook)


def test_a_workbook_that_is_damaged_or_cannot_be_read_here_is_named(tmp_path, workbook, monkeypatch):
    whole = workbook.read_bytes()
    with zipfile.ZipFile(workbook) as archive, zipfile.ZipFile(tmp_path / "cut.xlsx", "w") as cut:
        for name in archive.namelist():
            content = archive.read(name)
            cut.writestr(name, content[: len(content) // 2] if "sheet1" in name else content)
    with pytest.raises(DataError, match=r"cut.xlsx: a damaged Excel workbook"):
        read_all(tmp_path / "cut.xlsx")
    (tmp_path / "half.xlsx").write_bytes(whole[: len(whole) // 2])
    with pytest.raises(DataError, match=r"half.xlsx: a zip archive, or an Excel workbook"):
        read_all(tmp_path / "half.xlsx")
    monkeypatch.setitem(sys.modules, "openpyxl", None)
    with pytest.raises(DataError, match=r"needs openpyxl.*enginediag\[excel\]', or save it as CSV"):
        read_all(workbook)


@pytest.mark.parametrize("keys", ["file: {unit_row: true}", ""])
@pytest.mark.parametrize(("unit", "doubts"), [("DEG F", ["t: the row of units says DEG F, the recorder K"]), ("K", [])])
def test_a_row_of_units_that_the_recorder_contradicts_is_reported(tmp_path, keys, unit, doubts):
    (mapped,) = recorder(tmp_path, keys).read(text(f"t\n{unit}\n400\n401\n"))
    assert mapped.recording["T3_K"].tolist() == [400.0, 401.0] and mapped.counts.doubts == doubts


def test_a_growing_file_is_read_in_the_stated_encoding_and_its_lines_are_bounded(tmp_path):
    path = tmp_path / "f.csv"
    path.write_bytes("t;Öl\n1;2\n".encode("latin-1"))
    assert list(GrowingFile(str(path), 0.0, codec="latin-1")) == ["t;Öl\n", "1;2\n"]
    path.write_bytes(b"x" * 3_000_000)
    with pytest.raises(DataError, match="longer than 1000000 characters"):
        list(GrowingFile(str(path), 0.0))


@pytest.mark.parametrize("size", [3, 1000])
def test_a_file_that_ends_within_its_last_number_has_one_record_less(size):
    whole = "time_s,T3_K\n" + "".join(f"{k},{400 + k}.25\n" for k in range(20))
    lengths = {cut: sum(map(len, read(text(whole[:-cut]), chunk_records=size))) for cut in range(1, 9)}
    assert lengths == {1: 20, 2: 19, 3: 19, 4: 19, 5: 19, 6: 19, 7: 19, 8: 19}
    assert len(read_all(text("time_s,T3_K\n0,400.25\n1,4"))) == 2  # nobody knows how long these numbers are
