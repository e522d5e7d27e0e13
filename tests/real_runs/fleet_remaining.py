"""A fleet run to failure, cut at random: python tests/real_runs/fleet_remaining.py NOMINAL RECORDING [rank|remaining]

`rank`: every engine's life is cut at a flight drawn between its 31st and its last (seeds 0 to 4), engines are ranked by
how much of their margin they have used; Spearman's correlation with the flights that truly remained.

`remaining`: the margin at which engines fail is learnt from the last flights of the others, and how they wear from
their lives; each engine in turn is cut at 50, 60, 70, 80 and 90 % of its life and at a flight drawn from its second
half, and its remaining flights are forecast with 90 % intervals from what came before the cut alone. Errors with and
without the cap of 125 flights that published studies put on the truth; the score of PHM 2008 sums exp(−d/13) − 1 for
early and exp(d/10) − 1 for late forecasts.
"""

from __future__ import annotations

import sys
from collections.abc import Mapping
from pathlib import Path

import numpy as np
from fleet_histories import chosen, fleet_series, histories
from scipy.stats import spearmanr

from enginediag_cli.detection.forecast import Forecast, fit_laws, forecast, learn_population
from enginediag_cli.detection.series import Series
from enginediag_cli.fleets.engine_judgement import judge_engine
from enginediag_cli.fleets.findings import EngineHistory, FleetSettings
from enginediag_cli.fleets.margin import final_consumption, margin_scale, removal_limit
from enginediag_cli.fleets.run import judge_fleet
from enginediag_cli.history.engines import EngineSums

SETTINGS = FleetSettings()
FIRST_CUT = 30
SHARES = (0.5, 0.6, 0.7, 0.8, 0.9)
CAP = 125.0


def rank(series: Series, sums: Mapping[str, EngineSums], seeds: int = 5) -> None:
    scale = margin_scale(series)
    for seed in range(seeds):
        rng = np.random.default_rng(seed)
        found, left = [], []
        for history in histories(series, sums):
            life = len(history.stretches)
            cut = int(rng.integers(FIRST_CUT, life))
            found.append(judge_engine(cut_at(history, cut), series, SETTINGS, scale))
            left.append(life - cut)
        rho = spearmanr([f.severity.value for f in found], left).statistic
        fleet = judge_fleet(found, SETTINGS, series.parameters)
        changed = sum(f.verdict == "changed" for f in found)
        print(
            f"seed {seed}: Spearman {rho:.3f} over {len(found)} engines; {changed} changed, "
            f"{len(fleet.flagged.engines)} flagged, {len(fleet.excluded)} without a verdict"
        )


def remaining(series: Series, sums: Mapping[str, EngineSums]) -> None:
    scale = margin_scale(series)
    judged = [(h, judge_engine(h, series, SETTINGS, scale)) for h in histories(series, sums)]
    known = [(h, f) for h, f in judged if f.course is not None]
    print(f"{len(judged) - len(known)} of {len(judged)} whole lives have no margin")
    findings = [f for _, f in known]
    lives = [len(h.stretches) for h, _ in known]
    courses = [f.course for f in findings if f.course is not None]
    reference = float(np.median([f.severity.value for f in findings]))
    fits = [fit_laws(course, reference) for course in courses]
    everyone = learn_population(fits)
    level, error = final_consumption(fits, everyone)
    print(f"{scale.column}: engines fail at {level.mean():.1f} K ± {level.std(ddof=1):.1f} K of margin used")
    rng = np.random.default_rng(0)
    rows: dict[str, list[tuple[float, Forecast]]] = {}
    unknown = 0
    for k, (history, _) in enumerate(known):
        others = np.arange(len(fits)) != k
        limit, spread = removal_limit(level[others], error[others])
        population = learn_population(fits, without=k)
        cuts = {f"{share:.0%} of life": int(share * lives[k]) for share in SHARES}
        cuts["second half, drawn"] = int(rng.integers(lives[k] // 2, lives[k]))
        for name, cut in cuts.items():
            course = judge_engine(cut_at(history, cut), series, SETTINGS, scale).course
            if course is None:
                unknown += 1
                continue
            found = forecast(fit_laws(course, reference), population, limit, spread)
            rows.setdefault(name, []).append((float(lives[k] - cut), found))
    print(f"{unknown} cuts have no margin")
    print("cut at              held of 90 %  too early  too late  median width  RMSE  RMSE capped  score capped")
    every: list[tuple[float, Forecast]] = []
    for name, of_cut in rows.items():
        _told(name, of_cut)
        if name[0].isdigit():
            every += of_cut
    _told("50 to 90 %", every)


def cut_at(history: EngineHistory, flights: int) -> EngineHistory:
    """The history as it was after so many flights."""
    return chosen(history, range(flights))


def _told(name: str, rows: list[tuple[float, Forecast]]) -> None:
    truth = np.array([left for left, _ in rows])
    low, middle, high = (np.array([f.quantile(q) for _, f in rows]) for q in (0.05, 0.5, 0.95))
    d = middle - truth
    capped = np.minimum(middle, CAP) - np.minimum(truth, CAP)
    score = float(np.sum(np.where(capped < 0, np.exp(-capped / 13) - 1, np.exp(capped / 10) - 1)))
    held = (truth >= low) & (truth <= high)
    errors = f"{np.sqrt(np.mean(d**2)):4.1f}  {np.sqrt(np.mean(capped**2)):11.1f}  {score:12.0f}"
    print(
        f"{name:19s} {np.mean(held):12.3f}  {np.mean(truth > high):9.3f}  {np.mean(truth < low):8.3f}  "
        f"{np.median(high - low):12.0f}  {errors}"
    )


def main() -> None:
    series, sums = fleet_series(Path(sys.argv[1]), Path(sys.argv[2]))
    asked = sys.argv[3:] or ["rank", "remaining"]
    if "rank" in asked:
        rank(series, sums)
    if "remaining" in asked:
        remaining(series, sums)


if __name__ == "__main__":
    main()
