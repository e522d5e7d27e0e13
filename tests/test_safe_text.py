"""Text from files is harmless on a terminal and in a spreadsheet, and comes back as it was."""

from __future__ import annotations

import csv
import io

import pytest

from enginediag_cli.recordings.read import read_all
from enginediag_cli.recordings.write import CsvWriter
from enginediag_cli.report.output import json_text, write_csv
from enginediag_cli.safe_text import guarded, unguarded, visible

TEXTS = [
    "＝1+1",
    "'＠x",
    "=1+1",
    "+x",
    "-x",
    "@SUM(A1)",
    "\tx",
    "\rx",
    "'=1",
    "''+x",
    "'x",
    "'",
    "-",
    "-3.5",
    "+1e5",
    "x=1",
    "",
    "007",
]


@pytest.mark.parametrize("text", TEXTS)
def test_a_guarded_text_comes_back(text):
    assert unguarded(guarded(text)) == text


@pytest.mark.parametrize(
    "text", ["=1+1", "+x", "-x", "@SUM(A1)", "\tx", "\rx", "＝1+1", "＋x", "－x", "＠SUM(A1)", "﹦1"]
)
def test_what_a_spreadsheet_would_run_gets_an_apostrophe(text):
    assert guarded(text) == "'" + text


@pytest.mark.parametrize("text", ["-3.5", "+1e5", "-", "-inf", "hpc.efficiency", ""])
def test_numbers_and_harmless_texts_stay(text):
    assert guarded(text) == text


def test_our_own_reader_gives_back_what_our_writers_wrote():
    stream = io.StringIO()
    texts = [text for text in TEXTS if text != "\rx"]  # the reader takes a bare carriage return for a line end
    write_csv([{"=name": text, "k_K": -3.5} for text in texts], ["=name", "k_K"], stream)
    first = read_all(io.StringIO(stream.getvalue()))
    assert first.text["=name"] == texts
    again = io.StringIO()
    CsvWriter(again).write(first)
    second = read_all(io.StringIO(again.getvalue()))
    assert second.text == first.text
    assert set(second.columns["k_K"]) == {-3.5}


def test_a_list_of_numbers_is_no_text():
    stream = io.StringIO()
    write_csv([{"a": [-1.5, 2.0], "b": ["-x", "y"], "c": -1, "d": -2.5}], ["a", "b", "c", "d"], stream)
    assert list(csv.reader(io.StringIO(stream.getvalue())))[1] == ["-1.5; 2.0", "'-x; y", "-1", "-2.5"]


@pytest.mark.parametrize(
    "character",
    [
        *("\x00", "\x1b", "\x7f", "\x9b", "\u202e", "\u2066"),
        *("\u061c", "\u200e", "\u200f", "\u2028", "\u200b", "\u2064", "\ufeff", "\U000e0041", "\udce9"),
    ],
)
def test_control_characters_are_shown_and_never_written_raw(character):
    assert character not in visible(f"a{character}b")
    assert character not in json_text({"a": character})
    assert visible(f"Δη ± 1\n\t{'é'}") == "Δη ± 1\n\té"
