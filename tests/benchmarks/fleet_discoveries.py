"""False discoveries over engines and time: python tests/benchmarks/fleet_discoveries.py [--engines N] [--wander S]

Healthy engines, and as many as a twentieth of them that are faulty, as local statistics in the turbofan's own geometry
(`tests/fleets/turbofan_fleet.py` says what healthy engines differ by). E at several looks, the share of
engines whose E ever passed 1/α (α at most, by Ville), lists of e-BH among healthy engines alone, and in fleets of which
one engine of twenty is faulty: realised share of false discoveries, and how many faulty ones are listed.
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).parents[1] / "fleets"))

from turbofan_fleet import engine_history, fault, series

from enginediag_cli.detection.sequential import e_path, flag_engines
from enginediag_cli.fleets.findings import engine_flights

LEVEL = 0.05
FLEETS = 200
"""Fleets drawn from the engines, for the mean share of false discoveries."""


def paths(rng: np.random.Generator, engines: int, asked: argparse.Namespace, faulty: bool) -> np.ndarray:
    """log E (engines, flights)."""
    flights = asked.flights
    known, found = series(), []
    for k in range(engines):
        change = fault(rng, flights) if faulty else None
        mine = engine_flights(
            engine_history(rng, str(k), flights, change, scatter=asked.scatter, wander=asked.wander), known
        )
        found.append(e_path(mine.rows(), mine.suspects(True)[0], mine.baseline).log_e)
    return np.array(found)


def main() -> None:
    options = argparse.ArgumentParser(description=__doc__)
    options.add_argument("--engines", type=int, default=1000)
    options.add_argument("--flights", type=int, default=200)
    options.add_argument("--scatter", type=float, default=1.0, help="of flights, by how much larger than usual")
    options.add_argument("--wander", type=float, default=0.0, help="of instruments, by how much of their offsets")
    options.add_argument("--seed", type=int, default=12)
    asked = options.parse_args()
    rng = np.random.default_rng(asked.seed)
    healthy = paths(rng, asked.engines, asked, False)
    faulty = paths(rng, max(asked.engines // 20, 1), asked, True)
    looks = [n for n in (40, 60, 100, 150, 200) if n <= asked.flights] or [asked.flights]
    print(f"{asked.engines} healthy engines, {asked.flights} flights; {len(faulty)} faulty ones")
    print("flights  mean E  largest E  listed of the healthy alone  false share, 5 % faulty  faulty listed")
    for n in looks:
        e, f = healthy[:, n - 1], faulty[:, n - 1]
        shares, hits = [], []
        for _ in range(FLEETS):
            some = rng.choice(len(e), 19 * len(f), replace=False) if 19 * len(f) <= len(e) else np.arange(len(e))
            of_both = flag_engines(np.concatenate([e[some], f]), LEVEL)
            shares.append(of_both[: len(some)].sum() / max(of_both.sum(), 1))
            hits.append(of_both[len(some) :].mean())
        alone = int(flag_engines(e, LEVEL).sum())
        print(
            f"{n:7d}  {np.mean(np.exp(e)):6.2f}  {np.exp(e.max()):9.2f}  {alone:27d}  {np.mean(shares):23.4f}  "
            f"{np.mean(hits):13.3f}"
        )
    highest = healthy.max(axis=1)
    for alpha in (0.05, 0.01):
        ever = int(np.sum(highest >= -np.log(alpha)))
        print(f"E ever above {1 / alpha:g}: {ever} of {asked.engines} healthy engines ({alpha:g} at most)")


if __name__ == "__main__":
    main()
