"""Standard error: quiet-able, coloured only when wanted."""

from __future__ import annotations

import io

import pytest

from enginediag_cli.errors import ConfigError, Mark, Problem
from enginediag_cli.progress import listening
from enginediag_cli.report.messages import Messages, wants_color


class Terminal(io.StringIO):
    def isatty(self) -> bool:
        return True


@pytest.mark.parametrize(
    ("choice", "environment", "expected"),
    [
        ("auto", {}, True),
        ("auto", {"NO_COLOR": "1"}, False),
        ("auto", {"NO_COLOR": ""}, True),
        ("auto", {"NO_COLOR": "1", "FORCE_COLOR": "1"}, False),
        ("auto", {"TERM": "dumb"}, False),
        ("always", {"NO_COLOR": "1"}, True),
        ("never", {"FORCE_COLOR": "1"}, False),
    ],
)
def test_the_option_wins_then_no_color_then_the_terminal(choice, environment, expected):
    assert wants_color(choice, Terminal(), environment) is expected


def test_a_pipe_is_coloured_only_by_force():
    assert not wants_color("auto", io.StringIO(), {})
    assert wants_color("auto", io.StringIO(), {"FORCE_COLOR": "1"})


def test_quiet_leaves_only_errors(capsys):
    messages = Messages(quiet=True)
    messages.note("12 records kept")
    messages.warning("T3_K is stuck")
    messages.error("no records left")
    captured = capsys.readouterr()
    assert captured.out == ""
    assert captured.err == "error: no records left\n"


def test_problems_show_the_line_of_the_file_and_a_caret(tmp_path, capsys):
    path = tmp_path / "engine.yaml"
    path.write_text("spol: 1\n")
    Messages().problems(ConfigError([Problem(Mark(str(path), 1, 1), "unknown key 'spol'", "did you mean 'spool'?")]))
    assert capsys.readouterr().err == (
        f"{path}:1:1: error: unknown key 'spol' (did you mean 'spool'?)\n    1 | spol: 1\n      | ^~~~\n"
    )


def test_progress_passes_everything_through_and_is_silent_off_a_terminal(capsys):
    assert list(Messages().progress([1, 2, 3], "windows", total=3)) == [1, 2, 3]
    assert capsys.readouterr().err == ""


def test_progress_on_a_terminal_is_wiped_at_the_end(monkeypatch):
    stream = Terminal()
    monkeypatch.setattr("sys.stderr", stream)
    messages = Messages()
    with listening(messages.listener()):
        assert list(messages.progress(range(2), "windows", total=2)) == [0, 1]
    assert "windows" in stream.getvalue()
    assert stream.getvalue().endswith("\r")
