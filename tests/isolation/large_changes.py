"""What the full nonlinear model gains on large changes: python tests/isolation/large_changes.py [--runs 60]

Windows of 100 records of the default engine with one or two of eleven health parameters fallen by 5 or 10 %; exact
isolation with the quadratic alone (`--nonlinear never`) and as the commands do (`auto`). Markdown table.
"""

from __future__ import annotations

import argparse

import numpy as np
from turbofan_trials import faulty_window, turbofan_monitor, window_score

from enginediag_cli.isolation.diagnosis import DiagnosisOptions, diagnose
from enginediag_cli.isolation.nonlinear import WindowModel

CASES = ((1, 0.10), (2, 0.10), (1, 0.05))
SEED = 60


def exact(runs: int, faults: int, size: float) -> tuple[int, int, int]:
    """How many are exact with the quadratic and with the full model where it is needed, and how many have an answer."""
    monitor = turbofan_monitor()
    rng = np.random.default_rng([SEED, faults, round(1000 * size)])
    never = auto = judged = 0
    for _ in range(runs):
        names = rng.choice(monitor.names[: len(monitor.monitored)], faults, replace=False)
        change = {str(name): -size for name in names}
        inputs, y = faulty_window(rng, monitor, change)
        try:
            score = window_score(monitor, inputs, y)
        except AssertionError:  # the re-estimate did not converge: no verdict
            continue
        judged += 1
        plain = diagnose(score, DiagnosisOptions(nonlinear="never"))
        model = WindowModel(monitor, inputs, y)
        full = diagnose(score, DiagnosisOptions(), lambda model=model: model)
        never += set(plain.result.isolated) == set(change)
        auto += set(full.result.isolated) == set(change)
    return never, auto, judged


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--runs", type=int, default=60)
    runs = parser.parse_args().runs
    print("| changed parameters | fall | windows judged | exact, quadratic alone | exact, as the commands do |")
    print("|---|---|---|---|---|")
    for faults, size in CASES:
        never, auto, judged = exact(runs, faults, size)
        print(f"| {faults} | {100 * size:.0f} % | {judged} of {runs} | {never} | {auto} |", flush=True)


if __name__ == "__main__":
    main()
