"""Score sheet of blind trials as tables: python tests/validation/score_sheet.py SHEET [--noise | --misfit | --dynamic |
--law | --several]

SHEET: what `enginediag prove --format json` wrote. Counts with Wilson 95 % intervals beside the targets, for each
kind of truths that it has; `--noise`: false names where the noise is another than assumed;
`--misfit`: χ² per reading of unseen flights; `--dynamic`: of trials whose recordings move; `--law`: of laws that no
library holds; `--several`: of several causes at once.
"""

from __future__ import annotations

import json
import sys
from collections.abc import Mapping
from typing import Any

from enginediag_cli.validation import kinds

ROWS = {
    "exact": "right name first, λ_sep ≥ 22",
    "covered": "right name in the alias set",
    "alias_set_size": "mean size of that set",
    "false_name": "false names when nothing is missing",
    "false_name_without_floor": "… without the floor",
    "none_right": '"none of these" when the effect is not in the library',
    "exact_pair": "exact pair",
    "right_when_sure": "stated at least 0.9 and right",
    "interval": "95 % intervals that hold the coefficient",
    "held_out_gain": "unseen flights fitted better",
    "locate_driver": "driver first (λ ≥ 40)",
    "locate_driver_told": "driver among those reported",
    "drivers_told": "drivers reported",
    "locate_component": "component first (λ ≥ 40)",
    "hidden_location": "hidden switch: location (signal-to-noise ≥ 2)",
    "hidden_states": "hidden switch: states right",
    "fault_called_fault": "a fault called a fault",
    "exact_effect_and_fault": "an effect and a fault together, both named",
    "no_verdict": "did not converge",
}
DYNAMIC_ROWS = {
    "dynamic_exact": "right name first, λ_sep ≥ 22",
    "dynamic_covered": "right name in the alias set",
    "dynamic_alias_set_size": "mean size of that set",
    "dynamic_wrongly_none": '"none of these", though the library has it',
    "dynamic_wrong_name": "wrong name where something is concealed",
    "dynamic_false_name": "false names when nothing is missing",
    "dynamic_exact_pair": "exact pair, λ_sep ≥ 22",
    "dynamic_interval": "95 % intervals that hold the coefficient",
    "dynamic_held_out_gain": "unseen flights fitted better",
    "dynamic_no_verdict": "did not converge",
}
LAW_ROWS = {
    "law_judged": "λ ≥ 60, and nothing in the library near",
    "law_given": "a correction reported, of these",
    "law_wrong_name": "a wrong listed effect reported instead",
    "law_place": "place right or inseparable, where a correction is reported",
    "law_place_of_all": "… of all",
    "law_place_exact": "place first",
    "law_place_right_less_stated": "… rate less mean stated probability",
    "law_driver": "its variables, each by a group that these flights do not separate",
    "law_driver_of_all": "… of all",
    "law_driver_told": "its variables in the reported 95 % set",
    "law_drivers_told": "size of that set",
    "law_driver_or_alike": "… or those of a law that these flights cannot tell from the true one",
    "law_driver_right_less_stated": "… rate less mean stated probability of the variables",
    "law_curve": "curve within noise of the truth (D < 11)",
    "law_curve_of_all": "… of all",
    "law_form": "… with its coefficients fitted to flights without noise",
    "law_alone": "at one place, not at two together",
    "law_error": "error of the curve over its range, median",
    "law_gain_unseen": "gain on unseen flights over that of the true law, median",
    "spline_gain_unseen": "… of a spline in the same place and variables",
    "law_gain_higher": "gain four kilometres higher, median",
    "spline_gain_higher": "… of the spline",
    "higher_at_ceiling": "records kept at the envelope's ceiling there",
    "law_worse": "worse than no law, of all unseen and higher sets of flights",
    "spline_worse": "… the spline",
    "law_false": "false laws when nothing is concealed",
    "law_false_name": "false names of the library when nothing is concealed",
    "law_no_verdict": "did not converge",
}
SEVERAL_ROWS = {
    "several_all_of_two": "all of two causes named",
    "several_all_of_three": "all of three",
    "several_all_of_four": "all of four",
    "several_share": "share of the causes named",
    "several_none_false": "none named that is not there",
    "several_none_told_false": "none stated false: what is open between alternatives is not stated",
    "several_unexplained": "unexplained share within 10 points",
    "several_no_verdict": "did not converge",
}
TITLES = {
    kinds.SAME_MODEL: "truth from the same model",
    kinds.MAP_ERROR: "truth with 0.3 % map errors, floor on",
    kinds.REALISTIC: "realistic truth",
}
SIZE = "alias_set_size"
MEANS = (SIZE, "dynamic_alias_set_size", "drivers_told", "law_drivers_told")
MEDIANS = tuple(n for n in LAW_ROWS if "gain" in n)
DIFFERENCES = ("law_place_right_less_stated", "law_driver_right_less_stated")

Sheet = Mapping[str, Any]


def cell(name: str, own: Mapping[str, Any]) -> str:
    if not own["of"]:
        return "–"
    if name in MEANS:
        return f"{own['rate']:.2f} ({own['of']})"
    if name in MEDIANS:
        ends = "" if own["low"] is None else f"{own['low']:.2f}–{own['high']:.2f}; "
        return f"{own['rate']:.2f} ({ends}{own['of']})"
    if name in DIFFERENCES:
        return f"{100 * own['rate']:+.1f} points ({100 * own['low']:+.0f} to {100 * own['high']:+.0f})"
    if own["low"] is None or own["count"] != int(own["count"]):
        return f"{100 * own['rate']:.1f} % ({own['of']} trials)"
    return f"{own['count']} of {own['of']} ({100 * own['low']:.0f}–{100 * own['high']:.0f} %)"


def target(name: str, words: str | None) -> str:
    if not words:
        return ""
    sign, _, limit = words.rpartition(" ")
    if " to " in words:
        low, high = (100 * float(x) for x in words.split(" to "))
        return f"{low:.0f}–{high:.0f} %"
    value = limit if name in (SIZE, *MEDIANS) else f"{100 * float(limit):.0f} %"
    return f"{sign.replace('>=', '≥').replace('<=', '≤')} {value}"


def own_titles(sheet: Sheet) -> dict[str, str]:
    """Of the truths that the sheet's trials were drawn from."""
    return {truth: title for truth, title in TITLES.items() if truth in sheet["truths"]}


def scores(sheet: Sheet, rows: Mapping[str, str] = ROWS) -> None:
    titles = own_titles(sheet)
    print("| | " + " | ".join(f"target | {title}" for title in titles.values()) + " |")
    print("|---" * (1 + 2 * len(titles)) + "|")
    for name, words in rows.items():
        if name not in sheet:
            continue  # asked of no trial of these kinds
        cells = [f"{target(name, sheet[name][truth]['target'])} | {cell(name, sheet[name][truth])}" for truth in titles]
        print(f"| {words} | " + " | ".join(cells) + " |")


def dynamic(sheet: Sheet) -> None:
    scores(sheet, DYNAMIC_ROWS)


def law(sheet: Sheet) -> None:
    scores(sheet, LAW_ROWS)


def several(sheet: Sheet) -> None:
    scores(sheet, SEVERAL_ROWS)


def noise(sheet: Sheet) -> None:
    print("| false names, null trials with other noise than assumed | count |\n|---|---|")
    for truth, title in own_titles(sheet).items():
        own = [
            entry
            for kind, entry in sheet["false_name"][truth]["kinds"].items()
            if kind != kinds.NULL and kinds.base_kind(kind) == kinds.NULL
        ]
        print(f"| {title} | {sum(e['count'] for e in own)} of {sum(e['of'] for e in own)} |")


def misfit(sheet: Sheet) -> None:
    print(
        "| χ² per reading of unseen flights | before | after | with the true effect | trials |\n|---|---|---|---|---|"
    )
    for truth, title in own_titles(sheet).items():
        m = sheet["held_out_misfit"][truth]
        values = " | ".join("–" if m[k] is None else f"{m[k]:.3f}" for k in ("before", "after", "true"))
        print(f"| {title} | {values} | {m['trials']} |")


def main() -> None:
    with open(sys.argv[1], encoding="utf-8") as stream:
        sheet = json.load(stream)
    tables = {"--noise": noise, "--misfit": misfit, "--dynamic": dynamic, "--law": law, "--several": several}
    tables.get(sys.argv[2] if len(sys.argv) > 2 else "", scores)(sheet)


if __name__ == "__main__":
    main()
