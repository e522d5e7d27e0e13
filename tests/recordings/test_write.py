from __future__ import annotations

import io
import os
import subprocess
import sys

import numpy as np
import pytest

from enginediag_cli.errors import DataError
from enginediag_cli.recordings.read import read_all
from enginediag_cli.recordings.source import file_sha256, header_lines
from enginediag_cli.recordings.table import Recording
from enginediag_cli.recordings.write import CsvWriter, open_output, write_csv


def recording() -> Recording:
    rng = np.random.default_rng(3)
    values = rng.normal(1e3, 50.0, 40)
    values[5] = np.nan
    return Recording({"T3_K": values}, {"note": [f'a,"{k}"\nb' for k in range(40)]}, ("note", "T3_K"))


def test_what_is_written_reads_back_to_ten_digits_with_text_untouched(tmp_path):
    path = tmp_path / "a.csv"
    assert write_csv(path, [recording(), recording()], ["enginediag: 0", "seed: 7"]) == 80
    back = read_all(path)
    np.testing.assert_allclose(back["T3_K"][:40], recording()["T3_K"], rtol=5e-10)
    assert back.text["note"][:40] == recording().text["note"]
    assert back.provenance == ("enginediag: 0", "seed: 7") and back.order == ("note", "T3_K")


def test_the_header_is_written_once_and_the_provenance_can_be_left_out():
    stream = io.StringIO()
    writer = CsvWriter(stream)
    for _ in range(2):
        writer.write(Recording({"T3_K": np.array([1.0, np.nan])}, {"e": ["x", "y"]}))
    assert stream.getvalue() == "T3_K,e\n1,x\n,y\n1,x\n,y\n"


def test_a_chunk_with_other_columns_is_refused():
    writer = CsvWriter(io.StringIO())
    writer.write(Recording({"T3_K": np.ones(1)}))
    with pytest.raises(DataError, match="P3_Pa"):
        writer.write(Recording({"P3_Pa": np.ones(1)}))


def test_an_error_leaves_the_old_file_and_no_other(tmp_path):
    path = tmp_path / "a.csv"
    path.write_text("old")
    with pytest.raises(RuntimeError), open_output(path) as stream:
        stream.write("half")
        raise RuntimeError
    assert path.read_text() == "old" and os.listdir(tmp_path) == ["a.csv"]
    with pytest.raises(DataError, match="nothing to write"):
        write_csv(path, [])
    assert path.read_text() == "old"


def test_an_output_through_a_link_replaces_the_file_and_keeps_mode_and_link(tmp_path):
    real, link = tmp_path / "real.csv", tmp_path / "link.csv"
    real.write_text("old")
    real.chmod(0o640)
    link.symlink_to(real)
    with open_output(link) as stream:
        stream.write("new")
    assert link.is_symlink() and real.read_text() == "new" and real.stat().st_mode & 0o777 == 0o640


def test_a_device_is_written_to_and_not_replaced():
    with open_output("/dev/null") as stream:
        stream.write("x")
    assert not os.path.isfile("/dev/null")


def test_packed_files_of_the_same_data_are_the_same_bytes(tmp_path):
    paths = [tmp_path / "a.csv.gz", tmp_path / "b.csv.gz"]
    for path in paths:
        write_csv(path, [recording()])
    assert paths[0].read_bytes() == paths[1].read_bytes()
    assert len(read_all(paths[0])) == 40


def test_provenance_names_the_configuration_by_hash(tmp_path):
    config = tmp_path / "engine.yaml"
    config.write_text("kind: engine\n")
    lines = header_lines("simulate", seed=7, configs=[config], notes={"flight": "climb\nx"}, inherited=["seed: 3"])
    assert str(tmp_path) not in "\n".join(lines) and all("\n" not in line for line in lines)
    assert {"seed: 7", "command: simulate", "flight: climb x"} <= set(lines)
    assert f"config: engine.yaml sha256:{file_sha256(config)[:16]}" in lines


def test_a_name_of_an_open_file_is_written_to_as_the_shell_opened_it(tmp_path):
    kept = tmp_path / "kept.txt"
    kept.write_text("kept\n", encoding="utf-8")
    write = (
        "from enginediag_cli.recordings.write import open_output\n"
        "with open_output('/dev/stdout') as s: s.write('added\\n')"
    )
    with open(kept, "a", encoding="utf-8") as stream:
        subprocess.run([sys.executable, "-c", write], stdout=stream, check=True)
    assert kept.read_text(encoding="utf-8") == "kept\nadded\n"
