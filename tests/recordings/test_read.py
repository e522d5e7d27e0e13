"""Reading CSV: what is a number, what is missing, and where an error is."""

from __future__ import annotations

import gzip
import io
import subprocess
import sys

import numpy as np
import pytest

from enginediag_cli.errors import DataError
from enginediag_cli.recordings.read import read, read_all


def text(content: str):
    return io.StringIO(content, newline="")


def test_columns_with_a_unit_are_numbers_and_all_others_pass_untouched():
    r = read_all(text("serial,T3_K,mach,note_x\n007, 1e2 ,.5,No\n"))
    assert r["T3_K"].tolist() == [100.0] and r["mach"].tolist() == [0.5]
    assert r.text == {"serial": ["007"], "note_x": ["No"]}
    assert r.order == ("serial", "T3_K", "mach", "note_x")


def test_only_declared_columns_are_numbers_when_names_are_not_to_decide():
    content = "T3_K,P3_Pa,x\n1.500,2.500,3\n"
    r = read_all(text(content), declared=["x"], required=["T3_K"], by_suffix=False)
    assert set(r.columns) == {"T3_K", "x"}
    assert r.text["P3_Pa"] == ["2.500"]


@pytest.mark.parametrize("cell", ["", " ", "NA", "NaN", "nan", "null", "N/A"])
def test_missing_values_become_nan(cell):
    assert np.isnan(read_all(text(f"a,T3_K\n1,{cell}\n"))["T3_K"][0])


def test_provenance_lines_bom_blank_lines_crlf_and_quotes_are_understood():
    head = "\ufeff# enginediag: 0\r\n#seed: 7\r\n\r\n"
    r = read_all(text(head + '"T3_K","a,b"\r\n1,"x ""y""\nz"\r\n\r\n2,w\r\n'))
    assert r.provenance == ("enginediag: 0", "seed: 7")
    assert r.text["a,b"] == ['x "y"\nz', "w"]
    assert r["T3_K"].tolist() == [1.0, 2.0]
    assert r.line.tolist() == [5, 8]  # physical lines, though the first record takes two


def test_lines_are_physical_across_chunks_and_blank_lines():
    content = "T3_K,e\n" + "".join(f"{k},x\n" + ("\n" if k % 3 == 0 else "") for k in range(50))
    lines = [n for n, row in enumerate(content.split("\n"), 1) if row and n > 1]
    chunks = list(read(text(content), chunk_records=7))
    assert len(chunks) > 5
    assert np.concatenate([c.line for c in chunks]).tolist() == lines
    assert np.concatenate([c["T3_K"] for c in chunks]).tolist() == list(range(50))


def test_chunks_together_are_the_whole_file():
    content = "T3_K,e\n" + "".join(f"{k},n{k}\n" for k in range(100))
    whole = read_all(text(content))
    parts = list(read(text(content), chunk_records=10))
    assert [len(p) for p in parts] == [10] * 10
    assert [cell for p in parts for cell in p.text["e"]] == whole.text["e"]


@pytest.mark.parametrize(
    ("content", "message"),
    [
        ("# a\nT3_K,e\n1,x\n1..2,x\n", r"<stream>:4:T3_K: not a number: '1\.\.2'"),
        ("T3_K,e\n1,x\n\n1,x,y\n", r"<stream>:4: 3 fields where the header has 2: 1,x,y"),
        ("T3_K,e\n1_000,x\n", r"<stream>:2:T3_K: not a number: '1_000'"),
        ("T3_K,e,T3_K\n1,x,2\n", r"<stream>:1:T3_K: two columns have this name"),
        ("T3_K,T5_K\n1,2\n1,2,3\n1,2\n", r"<stream>:3: 3 fields where the header has 2: 1,2,3"),
        ("# only a head\n", r"<stream>: no header line"),
        ('T3_K,e\n1,"x\n', r"<stream>:2: unexpected end"),
    ],
)
def test_an_error_names_file_physical_line_and_column(content, message):
    with pytest.raises(DataError, match=message):
        read_all(text(content))


def test_a_missing_column_comes_with_a_near_match_and_the_list():
    message = r"missing column T3_K \(did you mean 'T3_k'\?\); the file has T3_k, N1_rpm"
    with pytest.raises(DataError, match=message):
        read_all(text("T3_k,N1_rpm\n1,2\n"), required=["T3_K", "N1_rpm"])


def test_a_file_with_a_header_only_is_an_empty_recording():
    r = read_all(text("T3_K,e\n"))
    assert len(r) == 0 and r.order == ("T3_K", "e")


def test_gzip_files_are_unpacked_and_damaged_or_foreign_ones_reported(tmp_path):
    path = tmp_path / "a.csv.gz"
    path.write_bytes(gzip.compress(b"T3_K,e\n5,x\n"))
    assert read_all(path)["T3_K"].tolist() == [5.0]
    path.write_bytes(gzip.compress(b"T3_K\n" + b"5\n" * 9999)[:40])
    with pytest.raises(DataError, match="gzip"):
        read_all(path)
    other = tmp_path / "latin.csv"
    other.write_bytes(b"T3_K,e\n1,\xb0C\n")
    with pytest.raises(DataError, match="UTF-8"):
        read_all(other)
    with pytest.raises(DataError, match="No such file"):
        read_all(tmp_path / "none.csv")


def test_a_dash_reads_standard_input():
    code = "from enginediag_cli.recordings.read import read_all\nr = read_all('-'); print(r.source, r['T3_K'].sum())"
    content = "T3_K,e\n1,x\n2,°\n".encode()
    done = subprocess.run([sys.executable, "-c", code], input=content, capture_output=True)
    assert done.stdout.decode().split() == ["<stdin>", "3.0"], done.stderr


def test_a_device_is_no_recording():
    with pytest.raises(DataError, match="a device"):
        read_all("/dev/zero")


def test_of_endless_blank_lines_no_more_are_held_than_are_refused(monkeypatch):
    from enginediag_cli.recordings import source as peeked

    monkeypatch.setattr(peeked, "MOST_BLANK_LINES", 10)
    lines = iter(["\n"] * 1000)
    peeked.PeekedLines(lines, "blank.csv")
    assert len(list(lines)) >= 988
