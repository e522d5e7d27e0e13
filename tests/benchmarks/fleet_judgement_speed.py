"""CPU time of judging a fleet: python tests/benchmarks/fleet_judgement_speed.py [--engines N]

Engines of 100 flights, nine sensors and twenty parameters, one of ten worn: e-value, course of health and margin of
each, list and ranking, forecasts, and what the judgement of `trend` adds for an engine that stands out.
"""

from __future__ import annotations

import argparse
import sys
import time
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).parents[1] / "fleets"))

from turbofan_fleet import QUICK, engine_history, fault, judged, known

from enginediag_cli.fleets.findings import FleetSettings
from enginediag_cli.fleets.run import judge_fleet

FLIGHTS = 100


def main() -> None:
    options = argparse.ArgumentParser(description=__doc__)
    options.add_argument("--engines", type=int, default=100)
    n = options.parse_args().engines
    rng = np.random.default_rng(1)
    fleet = [engine_history(rng, str(k), FLIGHTS, 2 * fault(rng, FLIGHTS) if k % 10 == 0 else None) for k in range(n)]
    judged(fleet[0])
    begin = time.process_time()
    found = [judged(h) for h in fleet]
    print(f"e-value, health, margin: {1e3 * (time.process_time() - begin) / n:.1f} ms an engine of {FLIGHTS} flights")
    begin = time.process_time()
    judge_fleet(found, QUICK, known().parameters)
    print(f"list, ranking, what is common, forecasts: {1e3 * (time.process_time() - begin) / n:.1f} ms an engine")
    begin = time.process_time()
    judged(fleet[0], FleetSettings())
    print(f"one that stands out, judged as trend does: {time.process_time() - begin:.2f} s")


if __name__ == "__main__":
    main()
