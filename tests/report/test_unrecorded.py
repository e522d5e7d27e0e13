"""What a switch follows that no column records is told in a sentence: when it is on, and how sure that is."""

from __future__ import annotations

from types import SimpleNamespace

import pytest

from enginediag_cli.mismatch.explain.follows import HysteresisFit
from enginediag_cli.mismatch.unrecorded.latched import Latched, SwitchingDirection
from enginediag_cli.report.tables.formulas import follows_document, follows_sentences


def follows(way: SwitchingDirection, words: str = "corrected N1", recorded: bool = False) -> HysteresisFit:
    variable = SimpleNamespace(name="corrected_N1", words=words, recorded=recorded)
    return HysteresisFit(SimpleNamespace(variable=variable), Latched(0, way, 0.85, 0.879, 18, 1, 600, 44.3), 18)


@pytest.mark.parametrize(
    ("way", "when"),
    [
        (SwitchingDirection.ABOVE, "on above 0.879, off below 0.85"),
        (SwitchingDirection.BELOW, "on below 0.85, off above 0.879"),
        (SwitchingDirection.FALLING, "on between 0.85 and 0.879 after coming from above"),
        (SwitchingDirection.RISING, "on between 0.85 and 0.879 after coming from below"),
    ],
)
def test_when_it_is_on_is_told_by_both_thresholds(way: SwitchingDirection, when: str) -> None:
    (told,) = follows_sentences([follows(way)])
    assert f"hysteresis in corrected N1 (in design values): {when}" in told
    assert "18 of 18 changes and all but 1 of 600 records" in told


def test_other_variables_that_do_as_well_are_told_beside_it() -> None:
    _, others = follows_sentences(
        [
            follows(SwitchingDirection.ABOVE),
            follows(SwitchingDirection.ABOVE, "N1", True),
            follows(SwitchingDirection.ABOVE, "T4"),
        ]
    )
    assert others.strip() == "Thresholds of N1 or T4 do it nearly as well."
    assert list(follows_sentences([])) == []


def test_the_document_has_the_same() -> None:
    told = follows_document(follows(SwitchingDirection.RISING))
    assert told["way"] == "rising" and (told["lower"], told["upper"]) == (0.85, 0.879) and told["changes"] == 18
