"""The switched state of the Citation's flight b22 as two Markdown tables: python tests/real_runs/citation_tables.py

The same search as `citation_mismatch.py`, whose prose has every rival and every RMS; about 80 s of one core.
"""

from __future__ import annotations

import sys
import tempfile
from collections.abc import Callable, Mapping
from dataclasses import replace
from pathlib import Path

import numpy as np
from citation_mismatch import (
    B22,
    BLEED,
    RAW_STEPS_S,
    REF,
    SIDES,
    Errors,
    Found,
    Judged,
    changes,
    cut,
    judged,
    load,
    nominal,
    refitted,
    search,
)
from ground_recordings import public_data

from enginediag_cli.mismatch.fit.identified import stack_column
from enginediag_cli.mismatch.fit.projection import Projection
from enginediag_cli.mismatch.fit.trial import HypothesisFit

NAME = "@".join(BLEED)
NO_GAIN = 0.98
"""Of χ² without anything: rivals that leave more of it on both engines are not told."""

Trials = Mapping[str, Mapping[str, HypothesisFit]]


def row(title: str, cell: Callable[[str], str]) -> None:
    print(f"| {title} | " + " | ".join(cell(side) for side in SIDES) + " |")


def checks(found: Mapping[str, Found], trials: Trials, flights: Path) -> None:
    print("| check | left | right |\n|---|---|---|")
    row("records of flight_ref inferred on", lambda s: seen_on(found[s]))
    left, right = (
        dict(zip(stack_column(f.evidence, "time_s")[f.of(B22)], f.states[f.of(B22)], strict=True))
        for f in found.values()
    )
    both = [t for t in left if t in right]
    same = sum(left[t] == right[t] for t in both)
    print(f"| records of b22 in which both engines are in the same state | {same} of {len(both)} | |")
    when = {
        side: ", ".join(f"{'on' if c.on else 'off'} {c.time_s:.0f}" for c in changes(found[side], t[NAME], flights))
        for side, t in trials.items()
    }
    row("switch times from the 1 Hz recording, s", lambda s: when[s])
    print(f"| raw steps of fuel flow and ITT, s | {', '.join(f'{t:.0f}' for t, _ in RAW_STEPS_S)} | |")
    bare = {side: Projection(f.base) for side, f in found.items()}
    row("χ² with nothing (readings)", lambda s: f"{bare[s].objective:.0f} ({bare[s].dof})")
    best = {side: min(t.values(), key=lambda x: x.objective).label for side, t in trials.items()}
    for label in trials["left"]:
        if any(t[label].objective < NO_GAIN * bare[s].objective for s, t in trials.items()):
            row(f"χ² with {label}", lambda s, label=label: fitted(trials[s][label], label == best[s]))


def seen_on(f: Found) -> str:
    return f"{f.states[f.of(REF)].sum():.0f} of {f.of(REF).sum()}"


def fitted(trial: HypothesisFit, best: bool) -> str:
    """χ² and the coefficients; bold where it is the lowest."""
    values = ", ".join(f"{v:.3g} ± {s:.2g}" for v, s in trial.coefficients.values())
    limit = ", at its limit" if trial.at_bound else ""
    chi2 = f"{trial.objective:.0f}"
    return f"{f'**{chi2}**' if best else chi2} ({values}{limit})"


def unseen(found: Mapping[str, Found], trials: Trials, flights: Path, folder: Path) -> None:
    print(
        "\n| unseen, on state: RMS without → with the bleed | N2, points | ITT, K | fuel flow, % |\n|---|---|---|---|"
    )
    for side, other in (SIDES, SIDES[::-1]):
        coefficient = trials[side][NAME].coefficients[".".join((*BLEED, "fraction"))][0]
        known = load(flights, (REF,), other, nominal(folder, flights, other))
        f = found[other]
        j = judged(known, np.zeros(int(f.of(REF).sum())), f.evidence.flights[1], coefficient)
        both(f"{other} engine in b22, identified on flight_ref, bleed from the {side} one", j)
    for side in SIDES:
        f = found[side]
        first, second = cut(f.evidence.flights[1], RAW_STEPS_S[2][0])
        train = search(replace(f.evidence, flights=(f.evidence.flights[0], first)), side)
        title = f"{side}, second part of b22, states and bleed from the first"
        if train.first.states is None:
            print(f"| {title} | no two states told in the first part alone | | |")
        else:
            both(title, judged(train.evidence, train.states, second))


def both(title: str, j: Judged) -> None:
    pair(f"{title}, as recorded", j.before["on"], j.after["on"])
    pair("… instruments set to zero on that flight's off state", j.zeroed_before, j.zeroed_after)


def pair(title: str, before: Errors, after: Errors) -> None:
    digits = (2, 1, 2)
    cells = [f"{b:.{d}f} → {a:.{d}f}" for b, a, d in zip(before, after, digits, strict=True)]
    print(f"| {title} | " + " | ".join(cells) + " |", flush=True)


def main() -> None:
    flights = public_data("c550_jt15d")
    with tempfile.TemporaryDirectory() as scratch:
        folder = Path(scratch)
        found = {s: search(load(flights, (REF, B22), s, nominal(folder, flights, s)), s) for s in SIDES}
        trials = {s: refitted(found[s]) for s in SIDES}
        if "--unseen" in sys.argv:
            unseen(found, trials, flights, folder)
        else:
            checks(found, trials, flights)


if __name__ == "__main__":
    main()
