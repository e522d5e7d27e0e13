"""Tables for people: units survive, nothing is cut."""

from __future__ import annotations

import io

import pytest

from enginediag_cli.presentation.tables import write_table


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
    assert text.count("1005.12") == 2


def test_a_table_too_wide_for_the_terminal_becomes_blocks():
    stream = Terminal()
    write_table([WIDE], list(WIDE), stream, width=80)
    lines = stream.getvalue().splitlines()
    assert lines[0] == "-- 1 of 1 --"
    assert max(len(line) for line in lines) < 80


def test_in_a_pipe_numbers_are_aligned_right_and_words_left():
    stream = io.StringIO()
    rows = [{"name": "hpc", "value": 1.5}, {"name": "fan", "value": 12.25}]
    assert write_table(rows, ["name", "value"], stream) == 2
    assert stream.getvalue() == "name  value\nhpc     1.5\nfan   12.25\n"


def test_colour_is_written_only_when_asked_for():
    plain, coloured = Terminal(), Terminal()
    write_table([{"a": 1}], ["a"], plain, width=80)
    write_table([{"a": 1}], ["a"], coloured, color=True, width=80)
    assert "\x1b[" not in plain.getvalue()
    assert "\x1b[" in coloured.getvalue()


def test_no_rows_give_no_table():
    stream = io.StringIO()
    assert write_table([], ["a"], stream) == 0
    assert stream.getvalue() == ""
