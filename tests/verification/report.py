"""How the engine model agrees with answers that nobody here computed, and whether it converges.

    python tests/verification/report.py [--section agreement|columns|convergence]

`agreement`: the largest figures of several columns together, as a Markdown table; `columns`: every column by itself;
`convergence`: of random operating points over the envelope of the default engine.
"""

from __future__ import annotations

import argparse
import sys
import tempfile
from collections.abc import Mapping, Sequence
from pathlib import Path

import jt9d_npss
import numpy as np
import pycycle_hbtf
import shared_data

from enginediag_cli.physics.engine_file import load_engine

SECTIONS = ("agreement", "columns", "convergence")
ROWS = {
    "T, P, W at stations 2, 13, 21, 25, 3, 4, 45, 5": tuple(
        f"{what}{s}_{unit}" for s in jt9d_npss.STATIONS for what, unit in (("T", "K"), ("P", "Pa"), ("W", "kg_s"))
    ),
    "N1, N2": ("N1_rpm", "N2_rpm"),
    "net thrust": ("Fn_N",),
    "fuel flow": ("Wf_kg_s",),
}
POINTS, SEED = 10_000, 3
HEALTH = (0.95, 1.02)
"""Range of every health parameter at every point."""

Deviations = Mapping[str, np.ndarray]
"""|calculated/published − 1| in % by column, (N,); 0 throughout for what is given, NaN where a point did not solve."""


def compared(scratch: Path) -> dict[str, Deviations]:
    """The three comparisons that there are data for, by title."""
    found: dict[str, Deviations] = {}
    if shared_data.available("jt9d"):
        for setting, words in (("Wf_kg_s", "fuel flow"), ("N1_rpm", "N1")):
            found[f"JT9D, NPSS 2.4, {words} given"] = jt9d_npss.compare(shared_data.DATA / "jt9d", scratch, setting)
    if shared_data.available("pycycle_hbtf"):
        found["CFM56 class, pyCycle 4.4, N1 given"] = pycycle_hbtf.compare(shared_data.DATA / "pycycle_hbtf", scratch)
    return found


def agreement(found: Mapping[str, Deviations]) -> None:
    print("| median / largest, % | " + " | ".join(found) + " |")
    print("|---" * (1 + len(found)) + "|")
    solved = [f"{int(np.isfinite(d['T3_K']).sum())} of {len(d['T3_K'])}" for d in found.values()]
    print("| points solved | " + " | ".join(solved) + " |")
    for title, columns in ROWS.items():
        print(f"| {title} | " + " | ".join(cell(d, columns) for d in found.values()) + " |")


def cell(deviations: Deviations, columns: Sequence[str]) -> str:
    own = [deviations[c] for c in columns if c in deviations and np.any(deviations[c] != 0.0)]
    if not own:
        return "given"
    return f"{max(np.nanmedian(d) for d in own):.3f} / {max(np.nanmax(d) for d in own):.3f}"


def columns(found: Mapping[str, Deviations]) -> None:
    for title, deviations in found.items():
        solved = int(np.isfinite(deviations["T3_K"]).sum())
        print(f"\n{title}: {solved} of {len(deviations['T3_K'])} points solved; |calculated/published − 1| in %")
        print(f"{'column':>10} {'median':>8} {'largest':>8}")
        for column, d in deviations.items():
            if not np.all(d == 0.0):
                print(f"{column:>10} {np.nanmedian(d):8.3f} {np.nanmax(d):8.3f}")


def convergence() -> None:
    engine = load_engine(Path(__file__).resolve().parents[2] / "configs" / "turbofan.yaml")
    rng = np.random.default_rng(SEED)
    points = {
        "altitude_m": rng.uniform(0, 12000, POINTS),
        "mach": rng.uniform(0, 0.85, POINTS),
        "dT_isa_K": rng.uniform(-15, 20, POINTS),
    }
    points[engine.power_setting] = engine.power_from_fraction(rng.uniform(0.3, 1.0, POINTS), points)
    health = {name: rng.uniform(*HEALTH, POINTS) for name in engine.monitored}
    print("| random points over the envelope, 30–100 % of corrected power | converge to 1e-10 |\n|---|---|")
    for title, theta in (
        ("nominal engine", {}),
        (f"{len(health)} health parameters, each {HEALTH[0]} to {HEALTH[1]}", health),
    ):
        solved = int(np.sum(engine.predict(points, theta).status < 2))
        print(f"| {title} | {solved:,} of {POINTS:,} |")


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--section", choices=SECTIONS, default="columns")
    section = parser.parse_args().section
    if section == "convergence":
        convergence()
        return 0
    missing = [f for f in ("jt9d", "pycycle_hbtf") if not shared_data.available(f)]
    for folder in missing:
        print(shared_data.reason(folder), file=sys.stderr)
    with tempfile.TemporaryDirectory() as scratch:
        (agreement if section == "agreement" else columns)(compared(Path(scratch)))
    return 2 if missing else 0


if __name__ == "__main__":
    sys.exit(main())
