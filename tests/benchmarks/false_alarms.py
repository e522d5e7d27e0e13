"""Realised false-alarm rates of `detect` over healthy windows: python tests/benchmarks/false_alarms.py [--windows N]

A linear twin of the whole chain with the sensitivities of the real engine along real flight phases: draw an engine,
identify its parameters and its noise from N records as `identify` does, judge windows of later flights. Every window
goes through the product's own statistics, uncertainty and threshold. A table goes to standard output, one row per
noise, nominal and phase: windows, and realised rate in % at nominal 5, 1 and 0.1 % with its 95 % interval: binomial
where the nominal is known; where windows share an identified nominal, from the scatter between nominals, which is
wider. The last rows come from the commands themselves, with the nonlinear engine (`end_to_end.py`).
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from scipy.stats import beta

sys.path.insert(0, str(Path(__file__).parent))

from end_to_end import end_to_end
from linear_twin import Flown, draw_noise, fly, identified

from enginediag_cli.detection.verdict import critical_value, is_noise_unknown
from enginediag_cli.probability import NORMAL_95
from enginediag_cli.residuals.instruments import NoiseModel
from enginediag_cli.residuals.monitor import noise_model
from enginediag_cli.residuals.score import fisher_score, marginalise, score_map
from enginediag_cli.residuals.statistics import ParameterFrame, block_statistics, range_space, whiten

ROOT = Path(__file__).resolve().parents[2]
PHASES = ("ground", "climb", "cruise", "descent")
MISSING = "cruise, sensors missing"
RATES = (0.05, 0.01, 0.001)
GEOMETRIES = 2
"""Different stretches of a phase judged against each identified nominal."""

NOMINALS = {100: 200, 300: 120, 1000: 60}
"""How many nominals are identified from so many records: their rates scatter the more the fewer records they have."""

DIGITS = (1, 2, 3)
"""Decimals of a rate in per cent at each of RATES."""


UNIFORM = -1.2
"""Excess kurtosis of the uniform law."""


@dataclass
class Tally:
    """Alarms (n, 3) at RATES of (n,) windows, one row per nominal; `refused`: windows without verdict;
    `unsettled`: engines whose identification did not converge, as `identify` would have said."""

    alarms: list[np.ndarray] = field(default_factory=list)
    judged: list[int] = field(default_factory=list)
    refused: int = 0
    unsettled: int = 0


@dataclass(frozen=True)
class Watched:
    """Error of the nominal parameters (p,), its covariance and the noise model that windows are judged with."""

    error: np.ndarray
    covariance: np.ndarray
    noise: NoiseModel


def known(flown: Flown, kind: str, rho: float) -> Watched:
    """Parameters and law of the noise are what they are."""
    p, m = len(flown.names), len(flown.sigma)
    kurtosis = np.full(m, UNIFORM) if kind == "uniform" else None
    return Watched(np.zeros(p), np.zeros((p, p)), NoiseModel(flown.sigma, np.full(m, rho), kurtosis=kurtosis))


def found(rng: np.random.Generator, flown: Flown, records: int, kind: str, rho: float) -> Watched | None:
    """As `detect` reads them from what `identify` writes; None when it writes none."""
    result = identified(rng, flown, records, kind, rho)
    if result is None:
        return None
    error, nominal = result
    return Watched(error, nominal.covariance, noise_model(nominal, flown.sensors))


def stretches(flown: Flown, phase: str, window: int) -> list[np.ndarray]:
    """Consecutive records of the phase in flights after the first two, `window` records each."""
    rows = np.flatnonzero((flown.phase == phase) & (flown.flight > 2))
    found = []
    for run in np.split(rows, np.flatnonzero(np.diff(rows) > 1) + 1):
        found += [run[i : i + window] for i in range(0, len(run) - window + 1, window)]
    return found


def tested(
    rng: np.random.Generator,
    flown: Flown,
    kind: str,
    rho: float,
    records: int | None,
    *,
    windows: int,
    length: int,
    nominals: int = 0,
) -> dict[str, Tally]:
    """Alarms per phase; records None: nominal and noise are known. nominals 0: as many as NOMINALS says."""
    places = {phase: stretches(flown, phase.partition(",")[0], length) for phase in (*PHASES, MISSING)}
    tallies = {phase: Tally() for phase in places}
    nominals = 1 if records is None else nominals or NOMINALS[records]
    rounds = GEOMETRIES if records is not None else 25 * GEOMETRIES
    for _ in range(nominals):
        watched = known(flown, kind, rho) if records is None else found(rng, flown, records, kind, rho)
        for phase, tally in tallies.items():
            if watched is None:
                tally.unsettled += 1
                continue
            tally.alarms.append(np.zeros(len(RATES), int))
            tally.judged.append(0)
            for _ in range(rounds):
                J = flown.J[places[phase][rng.integers(len(places[phase]))]].copy()
                if phase == MISSING:  # two sensors not there at all, and one that drops out half way
                    gone = rng.choice(len(flown.sigma), 3, replace=False)
                    J[:, gone[:2]], J[length // 2 :, gone[2]] = np.nan, np.nan
                count = -(-windows // (rounds * nominals))
                alarms = _alarms(rng, flown, watched, J, kind, rho, count)
                if alarms is None:
                    tally.refused += count
                else:
                    tally.alarms[-1] += alarms
                    tally.judged[-1] += count
    return tallies


def _alarms(
    rng: np.random.Generator, flown: Flown, watched: Watched, J: np.ndarray, kind: str, rho: float, count: int
) -> np.ndarray | None:
    """Alarms (3,) of `count` windows with sensitivities J; None where there is no verdict."""
    noise = watched.noise
    frame = ParameterFrame(flown.names, np.zeros(len(flown.names)), flown.prior)
    (block,) = block_statistics(np.zeros(J.shape[:2]), J, noise, np.array([0]), frame)
    geometry = block.statistics
    score = fisher_score(marginalise(geometry, flown.monitored, watched.covariance))  # all but the residuals
    if is_noise_unknown(score):
        return None
    _, G = whiten(np.zeros(J.shape[:2]), J, noise)
    space = range_space(geometry.F, geometry.prior_sigma)
    to_score = score_map(space, geometry, flown.monitored, watched.covariance)[1]
    D = score.prior_sigma
    values, vectors = np.linalg.eigh(D[:, None] * score.information * D)
    kept = np.argsort(values)[len(values) - score.rank :]
    normalised = (vectors[:, kept] / np.sqrt(values[kept])).T * D @ to_score
    weight = (G @ normalised.T) / (noise.sigma * np.sqrt(noise.inflation))[:, None]  # v = Σ weight · e
    alarms = np.zeros(len(RATES), int)
    limits = [critical_value(score, rate) for rate in RATES]
    departure = np.nan_to_num(J) @ watched.error
    for first in range(0, count, 2000):
        drawn = draw_noise(rng, kind, rho, (min(2000, count - first), *J.shape[:2]))
        e = (flown.sigma * drawn + departure).reshape(len(drawn), -1)
        t = np.sum((e @ weight.reshape(-1, score.rank)) ** 2, axis=1)
        alarms += [int(np.sum(t > limit)) for limit in limits]
    return alarms


def realised(tally: Tally, shared: bool) -> list[tuple[float, float, float]]:
    """Rate at each of RATES with its 95 % interval; shared: the windows of one nominal share its error."""
    judged = np.array(tally.judged)
    used, total = judged > 0, int(judged.sum())
    found = []
    for hits in np.array(tally.alarms).T if total else ():
        k = int(hits.sum())
        low, high = beta.ppf(0.025, k, total - k + 1) if k else 0.0, beta.ppf(0.975, k + 1, total - k)
        if shared and used.sum() > 1:
            error = NORMAL_95 * np.std(hits[used] / judged[used], ddof=1) / np.sqrt(used.sum())
            low, high = min(low, max(k / total - error, 0.0)), max(high, k / total + error)
        found.append((k / total, float(low), float(high)))
    return found


def row(name: str, tally: Tally, shared: bool) -> str:
    """A line of the table."""
    total = int(np.sum(tally.judged))
    if not total:
        return f"| {name} | {tally.refused} without verdict |  |  |  |"
    cells = [f"{100 * k:.3f} ({100 * low:.3f}–{100 * high:.3f})" for k, low, high in realised(tally, shared)]
    refused = f" and {tally.refused} without verdict" if tally.refused else ""
    refused += f", {tally.unsettled} of {len(tally.judged) + tally.unsettled} not identified" if tally.unsettled else ""
    return f"| {name} | {total}{refused} | " + " | ".join(cells) + " |"


@dataclass
class Summary:
    """Of a case, the lowest and highest rate over its phases; over all cases, how many rates lie within their 95 %
    intervals, and on which side the others do."""

    inside: int = 0
    below: int = 0
    above: int = 0

    def line(self, case: str, tallies: Mapping[str, Tally], shared: bool) -> str:
        rates = [found for t in tallies.values() if (found := realised(t, shared))]
        for found in rates:
            for rate, (_, low, high) in zip(RATES, found, strict=True):
                self.inside += low <= rate <= high
                self.below += high < rate
                self.above += rate < low
        cells = []
        for i, digits in enumerate(DIGITS):
            own = [100 * found[i][0] for found in rates]
            cells.append(f"{min(own):.{digits}f}–{max(own):.{digits}f}" if own else "")
        told = f"| {case} | " + " | ".join(cells) + " |"
        unsettled = max(t.unsettled for t in tallies.values())
        n = unsettled + max(len(t.judged) for t in tallies.values())
        return told + (f"\n| … identifications that did not settle | {unsettled} of {n} | | |" if unsettled else "")


def scatter(case: str, tallies: Mapping[str, Tally]) -> str:
    """A line: how far the rates of single nominals at RATES[0] lie apart, standard deviation in points, by phase."""
    cells = []
    for tally in tallies.values():
        each = [100 * a[0] / n for a, n in zip(tally.alarms, tally.judged, strict=True) if n]
        cells.append(f"{np.std(each, ddof=1):.1f}" if len(each) > 1 else "–")
    return f"| {case} | " + " | ".join(cells) + " |"


CASES = [
    (kind, rho, records)
    for kind, rho in (("gaussian", 0.0), ("uniform", 0.0), ("gaussian", 0.5), ("gaussian", 0.9))
    for records in (None, 100, 300, 1000)
]


TOLD = ("nominal known", "identified, white or ρ = 0.5", "identified, ρ = 0.9")


def _told(rho: float, records: int | None) -> str:
    return TOLD[0] if records is None else TOLD[1] if rho < 0.9 else TOLD[2]


def table(options: argparse.Namespace) -> Iterator[str]:
    """Lines of the table, as soon as they are known."""
    flown = fly(options.engine)
    summaries = {told: Summary() for told in TOLD}
    if options.scatter:
        yield f"| points of {100 * RATES[0]:g} % | " + " | ".join((*PHASES, MISSING)) + " |\n" + "|---" * 6 + "|"
    elif options.summary:
        yield "| noise, nominal | at 5 % | at 1 % | at 0.1 % |\n|---|---|---|---|"
    else:
        yield "| noise, nominal, phase | windows | at 5 % | at 1 % | at 0.1 % |\n|---|---|---|---|---|"
    for kind, rho, records in CASES:
        noise = kind if not rho else f"AR(1) ρ = {rho:g}"
        case = f"{noise}, " + ("known" if records is None else f"identified from {records} records")
        if options.only not in case:
            continue
        rng = np.random.default_rng([options.seed, *case.encode()])
        tallies = tested(
            rng, flown, kind, rho, records, windows=options.windows, length=options.length, nominals=options.nominals
        )
        if options.scatter:
            yield scatter(case, tallies)
            continue
        if options.summary:
            yield summaries[_told(rho, records)].line(case, tallies, records is not None)
            continue
        for phase, tally in tallies.items():
            yield row(f"{case}, {phase}", tally, records is not None)
    if options.summary:
        for told, x in summaries.items():
            n = x.inside + x.below + x.above
            rates = f"{x.inside} of {n} | {x.below} lower | {x.above} higher"
            yield f"| {told}: rates within their 95 % interval | {rates} |"
        return
    if options.commands and not options.scatter and options.only in ("", "commands"):
        for name, (alarms, judged) in end_to_end(options.seed, options.commands, RATES):
            yield row(name, Tally(list(alarms), list(judged)), True)


def main(arguments: list[str] | None = None) -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--windows", type=int, default=100_000, help="windows per row")
    parser.add_argument("--nominals", type=int, default=0, help=f"identified nominals per row (default: {NOMINALS})")
    parser.add_argument("--length", type=int, default=30, help="records per window")
    parser.add_argument("--commands", type=int, default=3000, help="windows per row through the commands")
    parser.add_argument("--engine", default=str(ROOT / "configs" / "turbofan.yaml"))
    parser.add_argument("--seed", type=int, default=2611)
    parser.add_argument("--summary", action="store_true", help="one line per noise and nominal, without the commands")
    parser.add_argument("--scatter", action="store_true", help="how far single nominals lie apart")
    parser.add_argument("--only", default="", help="cases whose name contains this text; `commands` for the last rows")
    for line in table(parser.parse_args(arguments)):
        print(line, flush=True)


if __name__ == "__main__":
    sys.exit(main())
