"""Damaged files are refused with a word, and never crash, hang, warn or lose a record; see campaign.py."""

from __future__ import annotations

import pytest
from campaign import campaign, case_of, prepared, resealed, run, told


def test_sound_files_are_sound_and_a_case_is_its_seed(tmp_path):
    files = prepared(tmp_path / "sound")
    again = case_of(11, files)
    assert case_of(11, files) == again
    for name in ("statistics.csv", "series.csv"):
        assert resealed(files.texts[name]).split() == files.texts[name].split()
    for words in (("detect", "statistics.csv"), ("detect", "-n", "nominal.yaml", "flight.csv")):
        sound = type(again)(0, "nothing", words[-1], files.texts[words[-1]].encode(), words)
        outcome = run(sound, files)
        assert (outcome.code, outcome.wrong) == (0, ""), outcome.stderr


@pytest.mark.parametrize("first", [1, 26, 51, 76])
def test_damaged_files_end_as_they_must(first, tmp_path):
    bad = [told(outcome) for outcome in campaign(first, 25, tmp_path) if outcome.wrong]
    assert not bad, "\n".join(bad)


@pytest.mark.slow
@pytest.mark.parametrize("first", range(10_000, 11_000, 250))
def test_a_thousand_damaged_files_end_as_they_must(first, tmp_path):
    bad = [told(outcome) for outcome in campaign(first, 250, tmp_path) if outcome.wrong]
    assert not bad, "\n".join(bad)
