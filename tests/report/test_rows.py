"""CSV and JSON rows."""

from __future__ import annotations

import io
import json

import numpy as np

from enginediag_cli.report.output import write_csv, write_json

ROW = {"engine": "007", "T3_K": np.float64(0.1) + 0.2, "N": np.int64(3), "note": "a,b", "alarm": True}


def test_csv_floats_read_back_to_the_same_value():
    stream = io.StringIO()
    write_csv([ROW], list(ROW), stream)
    header, row = stream.getvalue().splitlines()
    assert header == "engine,T3_K,N,note,alarm"
    assert row == '007,0.30000000000000004,3,"a,b",true'
    assert float(row.split(",")[1]) == ROW["T3_K"]


def test_csv_leaves_missing_values_empty():
    stream = io.StringIO()
    write_csv([{"a": float("nan"), "b": None, "d": 1.0}], ["a", "b", "c", "d"], stream)
    assert stream.getvalue() == "a,b,c,d\n,,,1.0\n"


def test_csv_provenance_stands_above_the_header_behind_a_hash():
    stream = io.StringIO()
    write_csv([{"a": 1}], ["a"], stream, provenance=["enginediag 0.1.0", "# seed 7"])
    assert stream.getvalue() == "# enginediag 0.1.0\n# seed 7\na\n1\n"


def test_json_is_one_array_that_any_reader_loads():
    stream = io.StringIO()
    rows = [{"T3_K": np.float32(1.5), "set": ("a", "b")}, {"T3_K": np.nan, "set": np.array([1.0, np.inf])}]
    assert write_json(rows, ["T3_K", "set"], stream) == 2
    assert json.loads(stream.getvalue()) == [{"T3_K": 1.5, "set": ["a", "b"]}, {"T3_K": None, "set": [1.0, None]}]


def test_json_without_rows_is_an_empty_array():
    stream = io.StringIO()
    assert write_json([], [], stream) == 0
    assert json.loads(stream.getvalue()) == []


def test_rows_are_written_before_the_next_one_is_computed():
    stream = io.StringIO()
    seen = []

    def rows():
        for k in range(3):
            seen.append(stream.getvalue().count("\n"))
            yield {"k": k}

    write_csv(rows(), ["k"], stream)
    assert seen == [1, 2, 3]
