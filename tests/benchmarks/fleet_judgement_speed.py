"""CPU time of judging a fleet: python tests/benchmarks/fleet_judgement_speed.py [--engines N]

Engines of 100 flights, nine sensors and twenty parameters, one of ten worn: the account of each history with its
margin, of healthy and of worn ones; flags and ranking, forecasts.
"""

from __future__ import annotations

import argparse
import sys
import time
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).parents[1] / "fleets"))

from turbofan_fleet import SETTINGS, engine_history, fault, judged, known

from enginediag_cli.fleets.run import judge_fleet

FLIGHTS = 100


def main() -> None:
    options = argparse.ArgumentParser(description=__doc__)
    options.add_argument("--engines", type=int, default=100)
    n = options.parse_args().engines
    rng = np.random.default_rng(1)
    fleet = [engine_history(rng, str(k), FLIGHTS, 2 * fault(rng, FLIGHTS) if k % 10 == 0 else None) for k in range(n)]
    judged(fleet[1])
    found, spent = [], []
    for history in fleet:
        begin = time.process_time()
        found.append(judged(history))
        spent.append(time.process_time() - begin)
    for words, changed in (("changed", True), ("not changed", False)):
        mine = [t for t, f in zip(spent, found, strict=True) if (f.verdict == "changed") == changed]
        if mine:
            print(f"{words}: {np.mean(mine):.2f} s an engine of {FLIGHTS} flights ({len(mine)} engines)")
    begin = time.process_time()
    judge_fleet(found, SETTINGS, known().parameters)
    print(f"flags, ranking, what is common, forecasts: {1e3 * (time.process_time() - begin) / n:.1f} ms an engine")


if __name__ == "__main__":
    main()
