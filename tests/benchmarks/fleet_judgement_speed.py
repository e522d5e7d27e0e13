"""A large fleet judged from its statistics: what is flagged and missed, at what cost:
python tests/benchmarks/fleet_judgement_speed.py [--engines N] [--flights N] [--changed SHARE] [--seed S]

Engines of nine sensors and twenty parameters, as tests/fleets/turbofan_fleet.py simulates them: each differs from its
type, its instruments are off from flight to flight, and what the model misses depends on where it flew. A share of them
changes after the baseline, at once or growing: a component by efficiency and flow capacity, in every third an
instrument; in turn by each of SIZES. Printed: engines flagged, healthy ones among them with the 95 % interval of their
share beside the false discovery rate that is stated, those that changed and were not flagged, by size, and what was
named; CPU time of the account of a history with its margin, and of flags, ranking and forecasts.
"""

from __future__ import annotations

import argparse
import sys
import time
from collections import Counter
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).parents[1] / "fleets"))

from detection_delay import rate
from turbofan_fleet import BASELINE, SETTINGS, engine_history, fault, geometry, judged, known

from enginediag_cli.fleets.findings import CHANGED, EngineFinding, FleetFinding
from enginediag_cli.fleets.run import judge_fleet

SIZES = (0.125, 0.25, 0.5, 1.0, 2.0)
"""Of changes, in prior standard deviations."""
INSTRUMENTS = 3
"""Every such engine of those that change has a wrong instrument."""


def instrument_fault(rng: np.random.Generator, flights: int) -> np.ndarray:
    """Change (flights, p) of the bias of one sensor, at once or growing, by one prior standard deviation."""
    names = geometry().monitor.monitored
    t, onset = np.arange(flights), rng.integers(BASELINE, max(3 * flights // 4, BASELINE + 1))
    grows = rng.random() < 0.5
    course = np.clip((t - onset) / (flights - onset), 0, None) if grows else (t >= onset).astype(float)
    change = np.zeros((flights, len(names)))
    sensor = rng.choice([i for i, name in enumerate(names) if name.endswith(".bias")])
    change[:, sensor] = rng.choice((-1, 1)) * course
    return change


def changed_parameters(change: np.ndarray) -> set[str]:
    """Components and instruments that change."""
    names = geometry().monitor.monitored
    return {names[i].rsplit(".", 1)[0] for i in np.flatnonzero(change.any(axis=0))}


def print_discoveries(fleet: FleetFinding, size: dict[str, float], true: dict[str, set[str]]) -> None:
    """What was flagged and missed. size: serial number → size of its change, of those that changed; true: what."""
    flagged = fleet.flagged.engines
    false = [serial for serial in flagged if serial not in size]
    named = {f.serial: {r.component for r in f.health if r.onset and r.probability >= 0.5} for f in fleet.engines}
    right = sum(bool(named[serial] & true[serial]) for serial in flagged if serial in size)
    print(f"flagged: {len(flagged)}; false among them, stated {SETTINGS.false_discovery:.0%} at most: ", end="")
    print(rate(len(false), len(flagged)) if flagged else "none")
    known_p = {f.serial: f.probability for f in fleet.engines}
    words = (f"{', '.join(sorted(named[serial])) or 'nobody'} ({known_p[serial]:.3f})" for serial in false)
    print(f"false, with their probabilities: {'; '.join(words) or 'none'}")
    print(f"named among what changed: {right} of {len(flagged) - len(false)}")
    print("| size, prior σ | changed | missed |")
    print("|---|---|---|")
    many, missed = Counter(size.values()), Counter(s for serial, s in size.items() if serial not in flagged)
    for one in SIZES:
        print(f"| {one} | {many[one]} | {missed[one]} |")


def judge_timed(histories: list) -> tuple[list[EngineFinding], list[float]]:
    """Findings, and CPU seconds of each."""
    found, spent = [], []
    for history in histories:
        begin = time.process_time()
        found.append(judged(history))
        spent.append(time.process_time() - begin)
    return found, spent


def main() -> None:
    options = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    options.add_argument("--engines", type=int, default=100)
    options.add_argument("--flights", type=int, default=100)
    options.add_argument("--changed", type=float, default=0.1)
    options.add_argument("--seed", type=int, default=1)
    asked = options.parse_args()
    n, rng = asked.engines, np.random.default_rng(asked.seed)
    histories, size, true = [], {}, {}
    for k in range(n):
        change = None
        if k < round(asked.changed * n):
            of = instrument_fault if k % INSTRUMENTS == 0 else fault
            size[str(k)] = SIZES[k % len(SIZES)]
            change = size[str(k)] * of(rng, asked.flights)
            true[str(k)] = changed_parameters(change)
        histories.append(engine_history(rng, str(k), asked.flights, change))
    judged(histories[-1])
    found, spent = judge_timed(histories)
    begin = time.process_time()
    fleet = judge_fleet(found, SETTINGS, known().parameters)
    ranking = time.process_time() - begin
    print_discoveries(fleet, size, true)
    for words, changed in (("changed", True), ("not changed", False)):
        mine = [t for t, f in zip(spent, found, strict=True) if (f.verdict == CHANGED) == changed]
        if mine:
            print(f"{words}: {np.mean(mine):.2f} s CPU an engine of {asked.flights} flights ({len(mine)} engines)")
    print(f"flags, ranking, what is common, forecasts: {1e3 * ranking / n:.1f} ms an engine")


if __name__ == "__main__":
    main()
