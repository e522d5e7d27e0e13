"""The answer by component in words."""

from __future__ import annotations

from parameter_makers import meaning_of

from enginediag_cli.isolation.diagnosis import ComponentIsolation
from enginediag_cli.isolation.results import Explanation
from enginediag_cli.report.tables.isolation import component_sentence

KNOWN = meaning_of(("compressor.efficiency", "hpt.efficiency", "lpt.efficiency"))
RIVALS = (Explanation(("compressor", "hpt", "lpt"), 0.47),)
INCLUSION = {"compressor": 0.96, "hpt": 0.98, "lpt": 0.49}


def test_an_answer_of_which_all_is_known_is_told_with_the_probability_of_exactly_this():
    found = ComponentIsolation(("compressor", "hpt"), 0.8, RIVALS, 0.98, INCLUSION, True)
    assert component_sentence(found, KNOWN) == (
        "compressor and HPT changed (probability 0.80); next: compressor, HPT and LPT (0.47)"
    )


def test_what_is_as_probable_as_not_is_told_beside_what_is_sure():
    found = ComponentIsolation(
        ("compressor", "hpt"), 0.46, RIVALS, 0.98, INCLUSION, True, possible=("lpt",), p_all=0.95
    )
    assert component_sentence(found, KNOWN) == (
        "compressor and HPT changed (probability 0.95), perhaps LPT (0.49) as well; exactly this: probability 0.46; "
        "next: compressor, HPT and LPT (0.47)"
    )
