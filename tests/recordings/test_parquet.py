"""Parquet: the same records as from CSV, in bounded memory; what is wrong with a file is told with its place."""

from __future__ import annotations

import os
import sys
from datetime import datetime, timezone
from decimal import Decimal
from pathlib import Path

import numpy as np
import pytest

from enginediag_cli.errors import DataError
from enginediag_cli.recordings.read import open_table, read, read_all
from enginediag_cli.recordings.recorder_file import load_recorder
from enginediag_cli.recordings.sniff import sniff
from enginediag_cli.recordings.source import header_lines
from enginediag_cli.recordings.table import Recording
from enginediag_cli.recordings.write import open_recording_output, write_csv


def test_without_pyarrow_a_parquet_file_is_refused_with_what_to_install_and_csv_is_not(tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "pyarrow", None)
    there, new = tmp_path / "a.parquet", tmp_path / "b.parquet"
    there.write_bytes(b"PAR1")
    told = r"needs pyarrow, which is not installed .*pip install 'enginediag\[parquet\]', or "
    with pytest.raises(DataError, match=rf"a.parquet: .*{told}convert the file to CSV"):
        read_all(there)
    with pytest.raises(DataError, match=rf"b.parquet: .*{told}write a .csv"), open_recording_output(new) as writer:
        writer.write(Recording({"T3_K": np.ones(1)}))
    assert not new.exists()
    write_csv(tmp_path / "c.csv", [Recording({"T3_K": np.ones(1)})])
    assert read_all(tmp_path / "c.csv")["T3_K"] == [1.0]


@pytest.fixture
def pa():
    return pytest.importorskip("pyarrow", reason="needs pyarrow: pip install 'enginediag[parquet]'")


@pytest.fixture
def put(pa, tmp_path):
    """`put(columns, ...)`: the path of a Parquet file with these columns."""
    import pyarrow.parquet as pq

    def written(columns, name="f.parquet", **options) -> Path:
        pq.write_table(pa.table(columns), tmp_path / name, **options)
        return tmp_path / name

    return written


def recording(n: int = 2500) -> Recording:
    rng = np.random.default_rng(7)
    numbers = {"time_s": np.arange(n) / 3.0, "T3_K": rng.normal(1e3, 50.0, n), "P3_Pa": rng.normal(1e6, 1e3, n)}
    numbers["T3_K"][5::7] = np.nan
    return Recording(numbers, {"flight": ["a,'=b"] * n, "note": [""] * n}, ("flight", *numbers, "note"))


NOTES = ("enginediag: 0", "seed: 7", "input:", "  seed: 6")


def test_what_is_written_reads_back_to_the_last_bit_and_as_from_csv_with_all_digits(pa, tmp_path):
    whole = recording()
    with open_recording_output(tmp_path / "a.parquet", NOTES) as writer:
        writer.write(whole.select(slice(0, 700)))
        writer.write(whole.select(slice(700, None)))
    write_csv(tmp_path / "a.csv", [whole], NOTES, digits=17)
    chunks = [list(read(tmp_path / name, chunk_records=600)) for name in ("a.parquet", "a.csv")]
    assert [len(c) for c in chunks[0]] == [len(c) for c in chunks[1]] == [600, 600, 600, 600, 100]
    for ours, theirs in zip(*chunks, strict=True):
        assert (ours.order, ours.text, ours.provenance) == (theirs.order, theirs.text, theirs.provenance)
        np.testing.assert_array_equal(ours.line, theirs.line)
        for column in theirs.columns:
            np.testing.assert_array_equal(ours[column], theirs[column])
    assert sorted(os.listdir(tmp_path)) == ["a.csv", "a.parquet"]
    with open_table(tmp_path / "a.parquet") as ours, open_table(tmp_path / "a.csv") as theirs:
        assert ours.columns == theirs.columns
        assert [x for x in ours.lines if x[0] == "#"] == [f"# {n.strip()}\n" for n in NOTES]


def test_the_header_lines_are_metadata_of_the_file(pa, tmp_path):
    import pyarrow.parquet as pq

    head = header_lines("simulate", seed=7)
    with open_recording_output(tmp_path / "a.parquet", head) as writer:
        writer.write(recording(3))
    assert pq.read_schema(tmp_path / "a.parquet").metadata[b"enginediag"].decode().splitlines() == list(head)


def test_the_same_records_give_the_same_bytes(pa, tmp_path):
    for name in ("a.parquet", "b.parquet"):
        with open_recording_output(tmp_path / name, NOTES) as writer:
            writer.write(recording())
    assert (tmp_path / "a.parquet").read_bytes() == (tmp_path / "b.parquet").read_bytes()


def test_an_error_leaves_the_old_file_and_no_other(pa, tmp_path):
    path = tmp_path / "a.parquet"
    path.write_text("old")
    with pytest.raises(RuntimeError), open_recording_output(path) as writer:
        writer.write(recording(5))
        raise RuntimeError
    with pytest.raises(DataError, match="nothing to write"), open_recording_output(path):
        pass
    with (
        pytest.raises(DataError, match="differ from those already written: T4_K"),
        open_recording_output(path) as writer,
    ):
        writer.write(recording(5))
        writer.write(recording(5).with_columns({"T4_K": np.ones(5)}))
    assert path.read_text() == "old" and os.listdir(tmp_path) == ["a.parquet"]


def test_numbers_of_any_type_are_numbers_and_a_null_is_a_missing_reading(pa, put):
    columns = {
        "T3_K": pa.array([300, None, 302], pa.int16()),
        "T4_K": pa.array([0.5, None, float("nan")], pa.float32()),
        "P3_Pa": pa.array([Decimal("1.25"), None, Decimal("3.00")]),
        "on": pa.array([True, None, False]),
        "mach": pa.array(["0.5", "n/a", None]),
        "Wf_kg_s": pa.nulls(3),
        "T5_K": pa.array(["1", "2", "1"]).dictionary_encode(),
    }
    found = read_all(put(columns), declared=("on",))
    expected = {
        "T3_K": [300, np.nan, 302],
        "T4_K": [0.5, np.nan, np.nan],
        "P3_Pa": [1.25, np.nan, 3],
        "on": [1, np.nan, 0],
        "mach": [0.5, np.nan, np.nan],
        "Wf_kg_s": [np.nan] * 3,
        "T5_K": [1, 2, 1],
    }
    assert found.order == tuple(expected)
    for column, values in expected.items():
        np.testing.assert_array_equal(found[column], values)


def test_columns_that_hold_no_numbers_by_their_name_are_the_texts_that_csv_has(pa, put):
    columns = {
        "flight": [7, None],
        "ok": [True, False],
        "x": [0.1, 1.0],
        "kind": pa.array(["b", "b"]).dictionary_encode(),
    }
    found = read_all(put({**columns, "day": pa.array([0, 1], pa.date32())}))
    assert found.text["flight"] == ["7", ""] and found.text["ok"] == ["true", "false"]
    assert found.text["x"] == ["0.1", "1"] and found.text["kind"] == ["b", "b"]
    assert found.text["day"] == ["1970-01-01", "1970-01-02"]


def test_a_file_is_known_by_its_content_whatever_its_name(put):
    assert read_all(put({"T3_K": [1.0]}, "f.csv"))["T3_K"] == [1.0]


def test_a_file_without_records_is_one_empty_recording(pa, put):
    (empty,) = read(put({"T3_K": pa.array([], pa.float64()), "note": pa.array([], pa.string())}))
    assert len(empty) == 0 and list(empty.columns) == ["T3_K"] and list(empty.text) == ["note"]


def test_chunks_do_not_depend_on_row_groups(put):
    path = put({"T3_K": np.arange(1000.0)}, row_group_size=37)
    chunks = list(read(path, chunk_records=250))
    assert [len(c) for c in chunks] == [250] * 4
    np.testing.assert_array_equal(np.concatenate([c["T3_K"] for c in chunks]), np.arange(1000.0))
    np.testing.assert_array_equal(np.concatenate([c.line for c in chunks]), np.arange(1000) + 2)


def test_time_stamps_are_no_seconds_but_a_recorder_reads_them(pa, put, tmp_path):
    stamps = [datetime(2024, 3, 4, 9, 0, k, tzinfo=timezone.utc) for k in range(3)]
    zoned = pa.array([*stamps[:2], None], pa.timestamp("ns", tz="Europe/Berlin"))
    path = put({"time_s": zoned, "T3": [300.0, 301.0, 302.0]})
    with pytest.raises(DataError, match=r"column time_s: not numbers but time stamps .*time: \{from: \[time_s\]\}"):
        read_all(path)
    assert read_all(path, by_suffix=False).text["time_s"][:2] == [f"2024-03-04T09:00:0{k}.000000Z" for k in range(2)]
    yaml = tmp_path / "r.yaml"
    yaml.write_text(
        "kind: recorder\ndescription: a logger\ntime: {from: [time_s]}\ncolumns:\n  T3_K: {from: T3, unit: K}\n"
    )
    (mapped,) = load_recorder(yaml).read(path)
    np.testing.assert_array_equal(mapped.recording["time_s"], [0.0, 1.0, np.nan])
    naive = put({"stamp": pa.array([stamps[0].replace(tzinfo=None)]), "T3_K": [1.0]})
    assert read_all(naive).text["stamp"] == ["2024-03-04T09:00:00.000000"]


def test_a_recorder_drafted_from_a_parquet_file_knows_its_columns(pa, put):
    stamps = pa.array([datetime(2024, 3, 4, 9, 0, k) for k in range(3)])
    found = sniff(str(put({"stamp": stamps, "T3 (K)": [300.0, None, 302.5]})))
    assert found.header == ("stamp", "T3 (K)") and found.values("stamp") is None
    np.testing.assert_array_equal(found.values("T3 (K)"), [300.0, np.nan, 302.5])


def test_what_no_table_can_hold_is_refused_by_column(pa, put):
    for values, what in (([[1.0]], "nested values"), ([{"a": 1}], "nested values"), ([b"x"], "another type")):
        with pytest.raises(DataError, match=rf"f.parquet: column raw: .*{what}.*leave it out"):
            read_all(put({"T3_K": [1.0], "raw": pa.array(values)}))


def test_a_text_that_is_no_number_is_told_with_row_row_group_and_column(put):
    path = put({"T3_K": ["1", "2", "3", "4", "x"]}, row_group_size=2)
    with pytest.raises(DataError, match=r"f.parquet: row 5 \(row group 2\): column T3_K: not a number: 'x'"):
        read_all(path)


def test_missing_columns_and_absurd_clocks_are_told_as_of_csv(put):
    path = put({"T3_K": [1.0], "time_s": [1e20]})
    with pytest.raises(DataError, match=r"missing column T3_k \(did you mean 'T3_K'\?\)"):
        read_all(path, required=("T3_k",))
    with pytest.raises(DataError, match=r"f.parquet:2:time_s: 1e\+20 s cannot be a time"):
        read_all(path)


def test_a_damaged_file_is_told_with_its_row_group(put):
    path = put({"T3_K": np.random.default_rng(1).normal(size=4000)}, row_group_size=2000, write_page_checksum=True)
    whole = path.read_bytes()
    path.write_bytes(whole[: len(whole) // 2])
    with pytest.raises(DataError, match=r"f.parquet: its head or its index at the end cannot be read .*copy it anew"):
        read_all(path)
    path.write_bytes(whole[:30000] + bytes([whole[30000] ^ 255]) + whole[30001:])
    with pytest.raises(DataError, match=r"f.parquet: row group 1 cannot be read .*damaged"):
        read_all(path)
    path.write_bytes(b"no such thing")
    with pytest.raises(DataError, match=r"f.parquet: called Parquet, but does not begin as such a file"):
        read_all(path)
    with pytest.raises(DataError, match=r"gone.parquet: No such file"):
        read_all(path.with_name("gone.parquet"))


def test_a_parquet_stream_that_cannot_be_read_from_its_end_is_told_as_such(put):
    path = put({"T3_K": np.random.default_rng(1).normal(size=4000)})
    packed = path.with_name("f.csv.gz")
    import gzip

    packed.write_bytes(gzip.compress(path.read_bytes()))
    with pytest.raises(DataError, match=r"f.csv.gz: a Parquet file, in a pipe or packed.*give the file itself"):
        read_all(packed)
