"""Tables for people: units survive, nothing is cut."""

from __future__ import annotations

import io

import pytest

from enginediag_cli.report.output import short_cell, write_table


class Terminal(io.StringIO):
    def isatty(self) -> bool:
        return True


def test_units_in_brackets_survive():
    columns = ["T30 [K]", "W25 [kg/s]", "phi [deg]", "close [/s]"]
    stream = Terminal()
    row = {"T30 [K]": 800.0, "W25 [kg/s]": 40.5, "phi [deg]": 1.0, "close [/s]": "[red]x"}
    write_table([row], columns, stream, width=80)
    for text in [*columns, "[red]x"]:
        assert text in stream.getvalue()


WIDE = {f"column_{k:02d}_with_unit_K": 1000.123456 + k for k in range(13)}


@pytest.mark.parametrize("stream", [io.StringIO(), Terminal()])
def test_thirteen_wide_columns_are_never_cut(stream):
    write_table([WIDE, WIDE], list(WIDE), stream, width=80)
    text = stream.getvalue()
    assert "…" not in text
    for column in WIDE:
        assert column in text
    assert text.count(" 1005") == 2


def test_a_table_too_wide_for_the_terminal_becomes_blocks():
    stream = Terminal()
    write_table([WIDE], list(WIDE), stream, width=80)
    lines = stream.getvalue().splitlines()
    assert lines[0] == "-- 1 of 1 --"
    assert max(len(line) for line in lines) < 80


def test_a_summary_shows_the_columns_that_matter_most_and_counts_the_others():
    stream = Terminal()
    rows = [{"source": "x" * 60, "verdict": "fault", "empty": None, "p_value": 0.00123456, "reason": "y" * 40}]
    summary = ("empty", "verdict", "reason", "source", "p_value")
    written = write_table(rows, list(rows[0]), stream, width=80, summary=summary)
    assert written == (1, 2)
    assert stream.getvalue().splitlines()[0].split() == ["verdict", "reason", "p_value"]
    assert max(len(line.rstrip()) for line in stream.getvalue().splitlines()) <= 80
    assert "0.001235" in stream.getvalue()


def test_no_line_of_a_table_that_just_fits_is_longer_than_the_terminal():
    stream = Terminal()
    write_table([{"a": "x" * 39, "b": "y" * 39}], ["a", "b"], stream, width=80, summary=("a",))
    assert [len(line) for line in stream.getvalue().splitlines()] == [80, 80]


@pytest.mark.parametrize(
    ("value", "shown"),
    [(10668.0, "10668"), (0.00123456, "0.001235"), (1234567.0, "1.235e+06"), (-3.50001, "-3.5"), (3, "3")],
)
def test_numbers_have_four_digits_and_whole_parts_all_of_theirs(value, shown):
    assert short_cell(value) == shown


@pytest.mark.parametrize("stream", [io.StringIO(), Terminal()])
def test_control_characters_of_a_file_are_shown_and_not_obeyed(stream):
    row = {"fli\x1b[31mght": "a\x1b]0;title\x07b\x9b\u202ec\nd"}
    write_table([row], list(row), stream, width=80)
    assert r"fli\x1b[31mght" in stream.getvalue()
    assert r"a\x1b]0;title\x07b\x9b\u202ec\nd" in stream.getvalue()


def test_in_a_pipe_numbers_are_aligned_right_and_words_left():
    stream = io.StringIO()
    rows = [{"name": "hpc", "value": 1.5}, {"name": "fan", "value": 12.25}]
    assert write_table(rows, ["name", "value"], stream).rows == 2
    assert stream.getvalue() == "name  value\nhpc     1.5\nfan   12.25\n"


def test_colour_is_written_only_when_asked_for():
    plain, coloured = Terminal(), Terminal()
    write_table([{"a": 1}], ["a"], plain, width=80)
    write_table([{"a": 1}], ["a"], coloured, color=True, width=80)
    assert "\x1b[" not in plain.getvalue()
    assert "\x1b[" in coloured.getvalue()


def test_no_rows_give_no_table():
    stream = io.StringIO()
    assert write_table([], ["a"], stream).rows == 0
    assert stream.getvalue() == ""
