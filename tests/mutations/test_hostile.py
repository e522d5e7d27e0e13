"""Hostile files and names end the program as they must, in bounded memory and time; see hostile.py."""

from __future__ import annotations

import sys

import pytest
from hostile import MAKERS, campaign, prepared, run, told

pytestmark = pytest.mark.skipif(sys.platform == "win32", reason="limits of memory are those of POSIX")


@pytest.mark.parametrize("seed", [0, 1, 2])
def test_a_name_that_is_no_text_and_a_file_that_is_none_stop_nobody(seed, tmp_path):
    found = run(seed, prepared(tmp_path / "sound"))
    assert not found.wrong, told(found)


@pytest.mark.slow
@pytest.mark.parametrize("first", range(100, 400, 100))
def test_hostile_files_end_as_they_must(first, tmp_path):
    assert len(MAKERS) > 10
    bad = [told(outcome) for outcome in campaign(first, 100, tmp_path) if outcome.wrong]
    assert not bad, "\n".join(bad)
