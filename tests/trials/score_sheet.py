"""Score sheet of blind trials as tables: python tests/trials/score_sheet.py SHEET [--noise | --misfit | --dynamic]
--dynamic]

SHEET: what `enginediag prove --format json` wrote. Counts with Wilson 95 % intervals beside the targets, for each
kind of truths that it has; `--noise`: false names where the noise is another than assumed;
`--misfit`: χ² per reading of unseen flights; `--dynamic`: of trials whose recordings move.
"""

from __future__ import annotations

import json
import sys
from collections.abc import Mapping
from typing import Any

from enginediag_cli.trials.blind import kinds

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
    "locate_driver_told": "driver among those told",
    "drivers_told": "drivers told",
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
TITLES = {
    kinds.SAME_MODEL: "truth from the same model",
    kinds.MAP_ERROR: "truth with 0.3 % map errors, floor on",
    kinds.REALISTIC: "realistic truth",
}
SIZE = "alias_set_size"
MEANS = (SIZE, "dynamic_alias_set_size", "drivers_told")

Sheet = Mapping[str, Any]


def cell(name: str, own: Mapping[str, Any]) -> str:
    if not own["of"]:
        return "–"
    if name in MEANS:
        return f"{own['rate']:.2f} ({own['of']})"
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
    value = limit if name == SIZE else f"{100 * float(limit):.0f} %"
    return f"{sign.replace('>=', '≥').replace('<=', '≤')} {value}"


def own_titles(sheet: Sheet) -> dict[str, str]:
    """Of the truths that the sheet's trials were drawn from."""
    return {truth: title for truth, title in TITLES.items() if truth in sheet["truths"]}


def scores(sheet: Sheet, rows: Mapping[str, str] = ROWS) -> None:
    titles = own_titles(sheet)
    print("| | " + " | ".join(f"target | {title}" for title in titles.values()) + " |")
    print("|---" * (1 + 2 * len(titles)) + "|")
    for name, words in rows.items():
        cells = [f"{target(name, sheet[name][truth]['target'])} | {cell(name, sheet[name][truth])}" for truth in titles]
        print(f"| {words} | " + " | ".join(cells) + " |")


def dynamic(sheet: Sheet) -> None:
    scores(sheet, DYNAMIC_ROWS)


def noise(sheet: Sheet) -> None:
    print("| false names, null trials with other noise than assumed | count |\n|---|---|")
    for truth, title in own_titles(sheet).items():
        own = [
            entry
            for kind, entry in sheet["false_name"][truth]["kinds"].items()
            if kind != kinds.NULL and kinds.base(kind) == kinds.NULL
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
    what = {"--noise": noise, "--misfit": misfit, "--dynamic": dynamic}.get(
        sys.argv[2] if len(sys.argv) > 2 else "", scores
    )
    what(sheet)


if __name__ == "__main__":
    main()
