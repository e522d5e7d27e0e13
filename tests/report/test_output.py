"""Output files are written completely or not at all."""

from __future__ import annotations

import os
import stat

import numpy as np
import pytest

from enginediag_cli.report.output import Output


def failing_rows(good: int):
    for k in range(good):
        yield {"k": k}
    raise RuntimeError("the third row")


@pytest.mark.parametrize("good", [0, 2])
def test_a_failed_run_leaves_the_old_file_and_nothing_else(tmp_path, good):
    path = tmp_path / "out.csv"
    path.write_text("old\n")
    with pytest.raises(RuntimeError):
        Output(str(path)).write_rows(failing_rows(good))
    assert path.read_text() == "old\n"
    assert os.listdir(tmp_path) == ["out.csv"]


def test_an_interrupted_run_leaves_nothing(tmp_path):
    with pytest.raises(KeyboardInterrupt), Output(str(tmp_path / "out.csv")).open() as stream:
        stream.write("half")
        raise KeyboardInterrupt
    assert os.listdir(tmp_path) == []


def test_an_output_may_replace_its_own_input(tmp_path):
    path = tmp_path / "flight.csv"
    path.write_text("k\n1\n2\n")

    def rows():
        with open(path) as stream:
            next(stream)
            for line in stream:
                yield {"k": int(line) * 10}

    Output(str(path)).write_rows(rows())
    assert path.read_text() == "k\n10\n20\n"


def test_a_replaced_file_keeps_its_mode_and_a_link_stays_a_link(tmp_path):
    path, link = tmp_path / "out.csv", tmp_path / "link.csv"
    path.write_text("old\n")
    path.chmod(0o640)
    link.symlink_to(path)
    Output(str(link)).write_text("new\n")
    assert link.is_symlink()
    assert path.read_text() == "new\n"
    assert stat.S_IMODE(path.stat().st_mode) == 0o640


def test_a_new_file_has_the_mode_that_the_umask_gives(tmp_path):
    before = os.umask(0o027)
    try:
        Output(str(tmp_path / "out.csv")).write_text("new\n")
    finally:
        os.umask(before)
    assert stat.S_IMODE((tmp_path / "out.csv").stat().st_mode) == 0o640


def test_a_device_is_written_and_not_replaced():
    Output("/dev/null").write_text("new\n")
    assert not os.path.isfile("/dev/null")


@pytest.mark.parametrize(
    ("path", "asked", "chosen"),
    [
        ("-", "auto", "csv"),
        ("a.json", "auto", "json"),
        ("a.CSV", "auto", "csv"),
        ("a.dat", "auto", "csv"),
        ("a.json.gz", "auto", "json"),
        ("a.csv", "table", "table"),
    ],
)
def test_the_format_follows_the_option_then_the_suffix(path, asked, chosen, capsys):
    assert Output(path, asked).chosen_format() == chosen


def test_on_a_terminal_the_format_is_a_table(monkeypatch):
    monkeypatch.setattr("sys.stdout.isatty", lambda: True, raising=False)
    assert Output().chosen_format() == "table"


def test_no_header_leaves_out_the_provenance(capsys):
    Output().write_rows([{"a": 1}], provenance=["seed 7"])
    Output(header=False).write_rows([{"a": 1}], provenance=["seed 7"])
    assert capsys.readouterr().out == "# seed 7\na\n1\na\n1\n"


def test_no_rows_with_known_columns_still_give_the_csv_header(capsys):
    assert Output().write_rows([], ["a", "b"]) == 0
    assert capsys.readouterr().out == "a,b\n"


def test_rows_in_parquet_have_the_narrowest_types_that_hold_them(tmp_path):
    pq = pytest.importorskip("pyarrow.parquet", reason="needs pyarrow: pip install 'enginediag[parquet]'")
    rows = [
        {"a": 1, "b": 2, "c": True, "d": "=x", "e": None, "f": 1, "g": np.float64("nan"), "h": [1, "p"], "i": 2**70}
        for _ in range(2500)
    ]
    rows[-1] |= {"b": 0.5, "f": "late", "g": 2.5, "c": None, "d": ""}
    path = tmp_path / "r.parquet"
    assert Output(str(path)).write_rows(rows, provenance=["seed: 1"]) == 2500
    table = pq.read_table(path)
    types = [str(field.type) for field in table.schema]
    assert types == ["int64", "double", "bool", "string", "string", "string", "double", "string", "string"]
    assert table.slice(2499).to_pylist() == [
        {"a": 1, "b": 0.5, "c": None, "d": None, "e": None, "f": "late", "g": 2.5, "h": "1; p", "i": str(2**70)}
    ]
    assert table.slice(0, 1).to_pylist()[0] | {"h": ""} == {
        **rows[0],
        "b": 2.0,
        "f": "1",
        "g": None,
        "h": "",
        "i": str(2**70),
    }
    assert Output(str(path)).write_rows([], ["a"]) == 0
    assert pq.read_table(path).column_names == ["a"]
