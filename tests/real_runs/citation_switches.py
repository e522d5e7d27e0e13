"""States that `explain --amplitudes` tells for the Citation's flights against the raw 1 Hz steps of flight b22.

    python tests/real_runs/citation_switches.py AMPLITUDES.csv ...

prints a row of a table for each file: what switched, in how many records the state is right, how many are told as
doubtful, and the interval of each change, with a star where it reaches further than 10 s from the raw step. No label
exists: fuel flow and ITT step in the raw recording of b22, and nowhere in flight_ref.
"""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
from citation_mismatch import RAW_STEPS_S
from ground_recordings import table

SURE = 0.45
"""Distance of a probability from one half from which a state counts as told."""

NEAR_S = 10.0
"""Within which a time is to be told."""


def truth(flight: str, time_s: float) -> bool:
    """Whether the bleed is on: before the first raw step, which is downwards, and between the others."""
    if "b22" not in flight:
        return False
    return bool(next((up for at, up in reversed(RAW_STEPS_S) if time_s >= at), not RAW_STEPS_S[0][1]))


def row(path: Path) -> str:
    """One file's row of the table."""
    rows = table(path.read_text(encoding="utf-8"))
    if not rows:
        return f"| {path.stem} | nothing | – | – | – |"
    on = np.array([float(r["probability_on"]) for r in rows])
    right = np.array([truth(r["flight"], float(r["time_s"])) for r in rows])
    doubtful = np.abs(on - 0.5) <= SURE
    hits = int(((on > 0.5) == right).sum())
    told = []
    for r in rows:
        if r["changed_from_s"]:
            low, high = float(r["changed_from_s"]), float(r["changed_to_s"])
            step = min((s for s, _ in RAW_STEPS_S), key=lambda s: abs(s - 0.5 * (low + high)))
            far = max(step - low, high - step) if "b22" in r["flight"] else np.inf
            beside = max(low - step, step - high, 0.0) if "b22" in r["flight"] else np.inf
            note = f" ({beside:.0f} s beside)" if beside >= 0.5 else ""
            told.append(f"{low:.0f}–{high:.0f}{note}" + ("" if far <= NEAR_S else " *"))
    place = rows[0]["location"]
    return f"| {path.stem} | {place} | {hits} of {len(rows)} | {int(doubtful.sum())} | {', '.join(told)} |"


def main(paths: list[str]) -> None:
    print("| file | what switches | state right | doubtful | changes between, s |")
    print("|---|---|---|---|---|")
    for p in paths:
        print(row(Path(p)))


if __name__ == "__main__":
    main(sys.argv[1:])
