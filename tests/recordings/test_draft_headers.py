"""Columns of public formats: how many a draft takes for what they are, and that it is never silently wrong."""

from __future__ import annotations

import pytest
from draft_headers import NOT_IN_UNITS, HeaderCase
from draft_headers_public import FIFTH, FOURTH, FRESH, SECOND, SIXTH, THIRD, TUNED

from enginediag_cli.recordings.draft import Draft, make_draft
from enginediag_cli.recordings.quantities import interpret_name, parse_name
from enginediag_cli.recordings.sniff import sniff

REQUIRED = 0.90
"""Share of all columns that must be right, in sum."""


def outcome(case: HeaderCase, tmp_path) -> tuple[list[str], list[str], list[str]]:
    """Columns that are right, wrong but left to the user, and silently wrong, each with what was found."""
    file = tmp_path / "f.csv"
    file.write_text(case.text, encoding="utf-8")
    found = make_draft(sniff(str(file)))
    made = meanings(found)
    right, open_, silent = [], [], []
    for e in case.expected:
        target, unit, scale, doubt = made.get(e.column, ("-", "", 1.0, False))
        if target != e.target:
            visible = doubt or target == "-"  # not used, and listed so
            (open_ if visible else silent).append(f"{e.column}: {target} for {e.target}")
            continue
        wanted = NOT_IN_UNITS.get(e.unit, (e.unit, 1.0, False))[:2]
        if e.target in ("-", "clock", "text") or (unit, round(scale, 6)) == (wanted[0] or "1", round(wanted[1], 6)):
            right.append(e.column)
        else:
            (open_ if doubt else silent).append(f"{e.column}: {unit} for {e.unit}")
    return right, open_, silent


def meanings(found: Draft) -> dict[str, tuple[str, str, float, bool]]:
    """Column of the file → target, unit, factor, whether something about it is left to the user."""
    made: dict[str, tuple[str, str, float, bool]] = {}
    for g in found.columns.values():
        target = g.gauge_of or g.target
        probe = [t for t, rule in found.derived.items() if "consensus" in rule and f"{g.target}" in rule]
        target = probe[0] if probe else target
        asked = bool(g.doubts) or any(text.startswith(f"{target}:") for text in found.open)
        for prefix in found.engines.values() or ("",):
            made[g.source.replace("{prefix}", prefix)] = (target, g.unit, g.scale, asked)
    if found.clock:
        made.update({c: ("clock", "", 1.0, bool(found.clock.doubt)) for c in found.clock.sources})
    made.update({c: ("text", "", 1.0, False) for c in found.header.texts.values()})
    return made


@pytest.mark.parametrize("case", [*TUNED, *FRESH, *SECOND, *THIRD, *FOURTH, *FIFTH, *SIXTH], ids=lambda case: case.name)
def test_no_column_of_a_public_format_is_silently_wrong(case, tmp_path):
    assert outcome(case, tmp_path)[2] == []


@pytest.mark.parametrize(
    "cases",
    [TUNED, FRESH, SECOND, THIRD, FOURTH, FIFTH, SIXTH],
    ids=["tuned", "fresh", "second", "third", "fourth", "fifth", "sixth"],
)
def test_nine_columns_of_ten_are_taken_for_what_they_are(cases, tmp_path):
    outcomes = [outcome(case, tmp_path) for case in cases]
    right = sum(len(right) for right, _, _ in outcomes)
    columns = sum(len(case.expected) for case in cases)
    assert right >= REQUIRED * columns, (right, columns, [open_ for _, open_, _ in outcomes if open_])


NO_QUANTITY = """Cabin Alt|Selected Altitude|ALT_SEL|Radio Altitude|RALT|Fuel Temp|N1 Redline|EGT Limit|T oil|P_hyd|MAP
    |Wind Speed|Mach Hold|Ground Speed|Alt Target|Alt rate|N1_std|EGT_max|EGT_min|dEGT|EGT_delta|N1K|N1R2|NGcorr|Wf_corr
    |T3_corr|T_oil_in|P_oil_out|T_fuel|P_fuel|Fuel Total|Power Lever|Power Setting|N1 exceed|Engine Hours|Exhaust Spread
    |Compressor Efficiency|Compressor Pressure Ratio|T3/T2|P3/P2|T3-T2|EGT-EGTref|N1/sqrt(theta)|Delta P3|Starter Torque
    |APU EGT|Bleed Pressure|Wing temp|Steam Temp|HRSG Inlet Temp|Gas fuel temp|Fuel gas pressure|T5 spread|T5 max
    |Reactive power|Power factor|Speed reference|Temperature|Pressure|Speed|Flow|T|P|x|F|N2O|T99|IVV|TLA|EPR_CMD|N1 vib
    |Altimeter setting|Dewpoint|Relative bearing|Torque limit|NR|ENG OT|Prop Pitch|ITT Margin|Corrected fan speed"""
"""Names beside those of quantities: set points, limits, statistics, differences, other systems."""


@pytest.mark.parametrize("name", [name.strip() for name in NO_QUANTITY.split("|")])
def test_a_name_beside_a_quantity_s_is_not_taken_for_it(name):
    assert interpret_name(parse_name(name)) is None
