"""Names in words."""

from __future__ import annotations

import pytest
from parameter_makers import meaning_of

from enginediag_cli.report.sentences import listed, parameter_words, spelled


def test_a_parameter_is_told_by_its_own_words_and_one_that_is_not_known_by_its_name():
    known = meaning_of(["hpc.efficiency"])
    assert parameter_words(known, ["hpc.efficiency", "odd.thing"]) == ["HPC isentropic efficiency", "odd.thing"]


@pytest.mark.parametrize(
    ("name", "words"), [("hpc", "HPC"), ("core_nozzle", "core nozzle"), ("hpc_fouling", "HPC fouling"), ("hp", "HP")]
)
def test_names_are_spelt_as_people_write_them(name, words):
    assert spelled(name) == words


def test_a_list_ends_with_its_conjunction():
    assert listed(["a"]) == "a"
    assert listed(["a", "b"]) == "a and b"
    assert listed(["a", "b", "c"], "or") == "a, b or c"
