"""Patterns of files, used in bounded time."""

from __future__ import annotations

import glob
import os
import time

import pytest

from enginediag_cli.config import files as patterns
from enginediag_cli.config.files import compile_pattern, matching, search
from enginediag_cli.errors import DataError


@pytest.mark.parametrize(
    "text",
    [r"SN(\d+)", r"engine_([^_/]+)_\d{4}-\d\d\.csv", r"(?:left|right)/(\w+)", r"(a|b)*(\d{2,3})"],
)
def test_patterns_of_serial_numbers_are_taken(text):
    assert compile_pattern(text).pattern == text


@pytest.mark.parametrize(
    "text", [r"(a+)+$", r"((a*)*)*b", r"(a|aa)+$", r"(?:\w+\s?)*$", r"(x+x+)+y", r"(.*a){20}", r"(a?){30}b"]
)
def test_a_pattern_that_may_take_exponential_time_is_refused(text):
    with pytest.raises(ValueError, match="a repetition within a repetition"):
        compile_pattern(text)


def test_what_is_no_pattern_is_refused():
    with pytest.raises(ValueError, match="not a regular expression"):
        compile_pattern("(")


def test_a_slow_pattern_ends_in_bounded_time(monkeypatch):
    monkeypatch.setattr(patterns, "MATCH_S", 0.2)
    slow = compile_pattern(".*" * 9 + "x")
    with pytest.raises(DataError, match=r"fleet.yaml: the pattern .* takes more than 0.2 s"):
        search(slow, "a" * 300, "fleet.yaml")
    assert search(compile_pattern(r"SN(\d+)"), "a/SN12.csv", "f")[1] == "12"


@pytest.mark.parametrize(
    "pattern",
    ["*.csv", "**/*.csv", "a/*", "**", "a/../b/[xy]?.csv", "*/*/x1.csv", "none/*.csv", "**/b/**/*.csv", "./a/x1.csv"],
)
def test_the_files_of_a_pattern_are_those_of_the_standard_library(tmp_path, pattern):
    for name in ("x1.csv", "a/x1.csv", "a/b/y2.csv", "b/x1.csv", "b/c/d/z.csv", ".h/x.csv", "b/.x.csv", "b/u.txt"):
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / name).write_text("")
    wanted = {os.path.normpath(p) for p in glob.glob(str(tmp_path / pattern), recursive=True) if os.path.isfile(p)}
    assert {os.path.normpath(p) for p in matching(tmp_path, pattern) if os.path.isfile(p)} == wanted


def test_a_pattern_looks_at_a_bounded_number_of_files_and_no_longer_than_stated(tmp_path, monkeypatch):
    for k in range(30):
        (tmp_path / str(k)).mkdir()
        (tmp_path / str(k) / "loop").symlink_to(tmp_path)
    assert len(matching(tmp_path, "**/**/**/*")) == 60
    monkeypatch.setattr(patterns, "MOST_ENTRIES", 40)
    with pytest.raises(DataError, match=r"'\*\*/\*' looks at more than 40 files"):
        matching(tmp_path, "**/*")
    monkeypatch.setattr(patterns, "WALK_S", -1.0)
    start = time.monotonic()
    with pytest.raises(DataError, match="name the folder of the recordings"):
        matching(tmp_path, "/**/*")
    assert time.monotonic() - start < 30.0
