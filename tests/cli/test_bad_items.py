"""One bad item among several recordings is named in the result, and the others are judged."""

from __future__ import annotations

import csv
import io
import os
from pathlib import Path

import pytest
from healthy_files import make

from enginediag_cli.__main__ import main


@pytest.fixture(scope="module")
def folder(tmp_path_factory) -> Path:
    here = tmp_path_factory.mktemp("items")
    texts = make(tmp_path_factory.mktemp("made"), records=60).texts
    for name in ("engine.yaml", "nominal.yaml"):
        (here / name).write_text(texts[name], encoding="utf-8")
    flight = texts["flight.csv"]
    (here / "a.csv").write_text(flight, encoding="utf-8")
    (here / "b_empty.csv").touch()
    (here / "c_garbage.csv").write_bytes(bytes(range(256)) * 8)
    (here / "d_dangling.csv").symlink_to(here / "nowhere")
    os.mkfifo(here / "e_pipe.csv")
    (here / "f_folder.csv").mkdir()
    with open(os.fsencode(here) + b"/g_\xe9.csv", "w", encoding="utf-8") as stream:
        stream.write(flight + "\n")
    return here


BAD = ("b_empty.csv", "c_garbage.csv", "d_dangling.csv", "e_pipe.csv", "f_folder.csv")


@pytest.mark.parametrize("command", ["detect", "isolate", "trend", "residual"])
def test_what_cannot_be_read_is_named_and_the_rest_is_judged(folder, monkeypatch, capsys, command):
    monkeypatch.chdir(folder)
    files = ["a.csv", *BAD, os.fsdecode(b"g_\xe9.csv")]
    assert main([command, "-n", "nominal.yaml", *files, "-o", f"{command}.txt"]) == 2
    out, err = Path(f"{command}.txt").read_text(encoding="utf-8"), capsys.readouterr().err
    for name in BAD:
        assert f"not read to its end, the other files are judged: {name}" in err
    assert "internal error" not in err
    if command == "detect":
        lines = [line for line in out.splitlines() if not line.startswith("#")]
        rows = list(csv.DictReader(io.StringIO("\n".join(lines))))
        verdicts = {row["source"]: row["verdict"] for row in rows}
        assert verdicts["a.csv"] == verdicts[r"g_\udce9.csv"] != "no verdict"
        assert {verdicts[name] for name in BAD} == {"no verdict"}


def test_one_bad_recording_alone_and_nothing_but_bad_ones_are_errors(folder, monkeypatch, capsys):
    monkeypatch.chdir(folder)
    assert main(["detect", "-n", "nominal.yaml", "b_empty.csv"]) == 2
    assert main(["detect", "-n", "nominal.yaml", *BAD]) == 2
    assert main(["check", "-n", "nominal.yaml", "a.csv", *BAD]) == 2
    assert "internal error" not in capsys.readouterr().err
