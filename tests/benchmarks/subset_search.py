"""Exact subset search by branch and bound as JSON: python tests/benchmarks/subset_search.py [--problems 20]

Random linear-Gaussian problems: N records of m sensors whose sensitivities resemble each other, k of p parameters
changed. CPU seconds on one core and nodes visited, middle, 90 % and worst of all problems; how often the best set is
proved best and is the true one; and, for problems of up to 20 parameters, whether the best set of every size is that of
exhaustive search over all sets. Changes are of about ten standard errors ("clear") or five ("faint").
"""

from __future__ import annotations

import argparse
import json
import time
from collections.abc import Mapping
from itertools import combinations
from typing import Any

import numpy as np

from enginediag_cli.isolation.subsets import ENUMERATED, best_subsets
from enginediag_cli.residuals.instruments import NoiseModel
from enginediag_cli.residuals.score import Score, fisher_score
from enginediag_cli.residuals.statistics import ParameterFrame, block_statistics

SIZES = ((20, 4), (40, 8), (60, 6), (100, 5))
EXHAUSTIVE = ((8, 8), (10, 10), (12, 12), (13, 13), (15, 15), (17, 6), (20, 5))
"""Parameters, and the largest set that exhaustive search visits."""


def problem(rng: np.random.Generator, p: int, k: int, size: float, common: float = 0.5) -> tuple[Score, set[int]]:
    """Score of 4 p records of four sensors in which k of p parameters changed by about `size` standard errors of a
    parameter that nothing imitates; and which."""
    J = rng.standard_normal((4 * p, 4, p)) @ (np.eye(p) + common * rng.standard_normal((p, p)) / np.sqrt(p) * 2)
    change = np.zeros(p)
    true = rng.choice(p, k, replace=False)
    change[true] = size * rng.choice([-1.0, 1.0], k) / np.sqrt(np.mean(np.sum(J**2, axis=(0, 1))))
    e = rng.standard_normal(J.shape[:2]) + J @ change
    frame = ParameterFrame([f"p{i}" for i in range(p)], np.ones(p), np.full(p, 0.02))
    (block,) = block_statistics(e, J, NoiseModel(np.ones(4), np.zeros(4)), np.array([0]), frame)
    return fisher_score(block.statistics), set(true.tolist())


def timed(p: int, k: int, size: float, problems: int) -> dict[str, object]:
    seconds, nodes, exact, right = [], [], 0, 0
    for seed in range(problems):
        score, true = problem(np.random.default_rng([seed, p, k]), p, k, size)
        begun = time.process_time()
        found = best_subsets(score, k)
        seconds.append(time.process_time() - begun)
        nodes.append(found.nodes)
        exact += found.exact
        right += set(found.sets[-1]) == true
    middle, late, worst = (round(float(t), 4) for t in np.quantile(seconds, [0.5, 0.9, 1.0]))
    return {
        "problems": problems,
        "seconds": middle,
        "seconds_90": late,
        "seconds_worst": worst,
        "nodes": int(np.median(nodes)),
        "nodes_worst": max(nodes),
        "proved_best": exact,
        "true_set": right,
    }


def exhaustive(score: Score, size: int) -> tuple[float, tuple[int, ...]]:
    """Largest b_Sᵀ I_SS⁻¹ b_S over all sets of a size, and the set."""
    b, information = score.scaled()
    best, chosen = -np.inf, ()
    sets = np.array(list(combinations(range(len(b)), size)))
    for part in np.array_split(sets, max(len(sets) // 20_000, 1)):
        A, right = information[part[:, :, None], part[:, None, :]], b[part]
        value = np.sum(right * np.linalg.solve(A, right[:, :, None])[:, :, 0], axis=1)
        k = int(np.argmax(value))
        if value[k] > best:
            best, chosen = float(value[k]), tuple(part[k].tolist())
    return best, chosen


def agreement(p: int, largest: int, problems: int) -> dict[str, int]:
    """In how many (problem, size) the search gives the set of exhaustive search."""
    same = total = 0
    for seed in range(problems):
        score, _ = problem(np.random.default_rng([seed, p]), p, max(p // 4, 1), float(seed % 2 * 4 + 1))
        found = best_subsets(score, largest)
        for size in range(1, largest + 1):
            value, chosen = exhaustive(score, size)
            same += found.sets[size - 1] == chosen or abs(found.values[size - 1] - value) < 1e-9 * value
            total += 1
    return {"compared": total, "same": int(same), "enumerated": p <= ENUMERATED}


def table(report: Mapping[str, Any]) -> None:
    """Markdown tables: times of the random problems, and agreement with exhaustive search."""
    print("| problem | CPU s, median | worst | proved best | true set found |\n|---|---|---|---|---|")
    for name, found in report.items():
        if name != "exhaustive":
            n = found["problems"]
            print(
                f"| {name} | {found['seconds']:.2f} | {found['seconds_worst']:.2f} | {found['proved_best']} of {n} "
                f"| {found['true_set']} of {n} |"
            )
    same, compared = (sum(v[k] for v in report["exhaustive"].values()) for k in ("same", "compared"))
    print(f"| same as exhaustive search (8 to 20 parameters, every size) | | | {same} of {compared} | |")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--problems", type=int, default=10)
    parser.add_argument("--table", action="store_true", help="a Markdown table instead of JSON")
    options = parser.parse_args()
    report: dict[str, object] = {}
    for name, size in (("clear", 10.0), ("faint", 5.0)):
        for p, k in SIZES:
            report[f"p={p} k={k} {name}"] = timed(p, k, size, options.problems)
    report["exhaustive"] = {f"p={p} up to {k}": agreement(p, k, max(options.problems // 4, 2)) for p, k in EXHAUSTIVE}
    if options.table:
        table(report)
    else:
        print(json.dumps(report, indent=2))


if __name__ == "__main__":
    main()
