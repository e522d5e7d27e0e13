"""Detection delay of `detect --follow` and of `trend`, beside those of classic tests that know the nominal engine:
python tests/benchmarks/detection_delay.py [--flights N] [--only ROW] …

Flights. For each kind and size of change that begins on the way: mean delay in records from the onset to the alarm of

    CUSUM     E. S. Page, Biometrika 41 (1954) 100–115: knows nominal, what changes, and how much
    GLR       A. S. Willsky, H. L. Jones, IEEE Trans. Automatic Control 21 (1976) 108–112: knows nominal; any one
              parameter or sensor, any size, any onset
    follow    knows the nominal that was identified from six flights with what is uncertain about it; looks after every
              `--block` records

over the flights in which all three have one after the onset, the ratio of follow to GLR with its standard error,
flights that follow missed, in which it had an alarm before the onset, and in which the GLR did. With --kinds: the kind
that is reported at the end, and in how many the onset lies in its 95 % interval. The thresholds of CUSUM and GLR are
those of which 1 % of healthy flights have an alarm, by simulation; `--follow` states 1 %. --healthy: the alarms of
GLR and of follow, after every five records, in the same healthy flights, with 95 % intervals of their rates; in a fifth
as many in which one reading of a hundred is a gross error; and of the evidence alone, with the nominal known, in three
times as many. One record every 10 s.

Histories. Flights after the onset until `trend` says that something changed (`judge_history` of a growing history),
beside a GLR that knows the nominal, on the same statistics, with an alarm in 1 % of healthy histories at any flight.
--healthy: both in the same healthy histories, after every fourth flight from the tenth on.
"""

from __future__ import annotations

import argparse
import subprocess
import sys
import tempfile
from collections import Counter
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from scipy.stats import beta

from enginediag_cli.detection.sequential import Coordinates, EProcess
from enginediag_cli.history.background import History
from enginediag_cli.history.follow import FlightMonitor, StepEvidence, mean_overshoot, unit_coordinates
from enginediag_cli.history.posterior import judge_history
from enginediag_cli.intake.selection import open_baseline
from enginediag_cli.recordings.table import Recording
from enginediag_cli.residuals.monitor import Monitor, build_monitor
from enginediag_cli.simulation.flights import default_plan, engine_inputs, generate_flights

ENGINE = Path(__file__).resolve().parents[2] / "configs" / "turbofan.yaml"
INTERVAL_S, BEFORE, BLOCK = 10.0, 20, 5
"""Seconds between records; records of a block far from the onset, and of one near it, by default of the command."""
CASES = [
    *(("step", "fan.efficiency", x) for x in (-0.01, -0.02)),
    *(("step", "hpc.efficiency", x) for x in (-0.003, -0.005, -0.01, -0.02)),
    *(("step", "hpt.flow_capacity", x) for x in (0.0025, 0.005, 0.01)),
    *(("jump", "T3_K", x) for x in (1.5, 3.0, 6.0, 12.0)),
    *(("ramp", "hpc.efficiency", x) for x in (-0.01, -0.03)),
    ("ramp", "hpt.flow_capacity", 0.02),
    *(("drift", "T3_K", x) for x in (5.0, 20.0)),
]
HISTORY_CASES = [
    *(("step", "hpc.efficiency", x) for x in (-0.0015, -0.003)),
    ("step", "fan.efficiency", -0.005),
    *(("jump", "T3_K", x) for x in (1.0, 2.0)),
    *(("ramp", "hpc.efficiency", x) for x in (-0.003, -0.01)),
    ("drift", "T3_K", 3.0),
]
SENSORS = ("jump", "drift")
"""Laws of the error of a sensor; the others are of the engine. A ramp and a drift grow evenly to the end."""
FALSE_ALARM, SIMULATED, KINDS_OF_FLIGHTS = 0.01, 600, 10
"""Share of healthy flights with an alarm; simulated ones that thresholds are taken from, and flights these are like."""
SPIKES, SPIKE_SIGMAS = 0.01, 10.0
"""Share of readings that are gross errors, and by how much, in standard deviations of their noise."""
HISTORY, ONSET, SNAPSHOTS, LOOKS = 60, 20, 10, range(10, 61, 4)
"""Flights of a history, the number, from 0, of the first after a change, and records of a flight; flights after
which healthy histories are looked at. A ramp ends with the history."""


def nominal_monitor() -> Monitor:
    """Monitor of an engine identified from six flights."""
    tool = [sys.executable, "-m", "enginediag_cli"]
    with tempfile.TemporaryDirectory() as folder:
        healthy, nominal = f"{folder}/healthy.csv", f"{folder}/nominal.yaml"
        simulate = ["simulate", str(ENGINE), "--flights", "6", "--seed", "1", "-q", "-o", healthy]
        subprocess.run([*tool, *simulate], check=True)
        identify = ["identify", str(ENGINE), healthy, "--no-cross-validation", "-q", "-o", nominal]
        subprocess.run([*tool, *identify], check=True)
        return build_monitor(open_baseline(nominal))


def flown(monitor: Monitor, seed: int, law: str, name: str, size: float) -> tuple[Recording, int]:
    """A flight of the true engine with a change from 30–50 % of it on (a ramp grows to its end), and the onset."""
    rng, engine = np.random.default_rng([seed, 7]), monitor.engine
    inputs = engine_inputs(engine, generate_flights(default_plan(engine), engine, rng, flights=1))
    n = len(inputs["mach"])
    onset, t = int(n * rng.uniform(0.3, 0.5)), np.arange(n)
    after = np.maximum(t - onset, 0) / (n - onset) if law in ("ramp", "drift") else t >= onset
    values = {} if law in (*SENSORS, "none") else {name: 1 + size * after}
    y = np.asarray(engine.predict(inputs, values, sensors=monitor.sensors).y)
    y = y + noise_sigma(monitor) * rng.standard_normal(y.shape)
    if law in SENSORS:
        y[:, monitor.sensors.index(name)] += size * after
    readings = {c: y[:, j] for j, c in enumerate(monitor.sensors)}
    columns = {c: np.asarray(v, float) for c, v in inputs.items()}
    return Recording({**columns, "time_s": INTERVAL_S * t, **readings}, line=t), onset


def noise_sigma(monitor: Monitor) -> np.ndarray:
    """Standard deviation (m,) of the noise of each sensor, as the engine file has it."""
    return np.array([monitor.engine.sensors[c].noise_sigma for c in monitor.sensors])


@dataclass(frozen=True)
class KnownResiduals:
    """Of a flight with the true nominal engine: z (n, m) white residuals, G (n, m, c) what one prior standard deviation
    of each parameter and of each sensor's bias does to them."""

    z: np.ndarray
    G: np.ndarray

    @staticmethod
    def from_recording(monitor: Monitor, recording: Recording) -> KnownResiduals:
        engine, sigma, unit = monitor.engine, noise_sigma(monitor), unit_coordinates(monitor).unit
        inputs = {c: recording.columns[c] for c in engine.inputs if c in recording.columns}
        found = engine.predict(inputs, {}, sensors=monitor.sensors, wrt=monitor.monitored)
        a, y = len(monitor.monitored), np.column_stack([recording.columns[c] for c in monitor.sensors])
        jumps = np.broadcast_to(np.diag(unit[a:] / sigma), (len(y), len(sigma), len(sigma)))
        G = np.concatenate([np.asarray(found.jacobian) / sigma[:, None] * unit[:a], jumps], axis=2)
        return KnownResiduals((y - np.asarray(found.y)) / sigma, G)

    def shift(self, monitor: Monitor, name: str, size: float) -> np.ndarray:
        """Mean (n, m) of the residuals after a change of this size."""
        unit = unit_coordinates(monitor).unit
        names = [*monitor.monitored, *monitor.sensors]
        return self.G[:, :, names.index(name)] * size / unit[names.index(name)]


def glr_path(score: np.ndarray, information: np.ndarray) -> np.ndarray:
    """2 log of the largest likelihood ratio (n,) after each of n epochs, over onsets and one of c parameters: score and
    information (n, c) of each epoch."""
    b, S = (np.vstack([np.zeros(x.shape[1]), np.cumsum(x, axis=0)]) for x in (score, information))
    n = len(score)
    return np.array([np.max((b[k + 1] - b[: k + 1]) ** 2 / np.maximum(S[k + 1] - S[: k + 1], 1e-9)) for k in range(n)])


def glr(z: np.ndarray, G: np.ndarray) -> np.ndarray:
    """The same (n,) of residuals z (n, m) with sensitivities G (n, m, c)."""
    return glr_path(np.einsum("nmc,nm->nc", G, z), np.sum(G**2, axis=1))


def cusum(z: np.ndarray, shift: np.ndarray) -> np.ndarray:
    """Page's sum (n,) of log likelihood ratios of a known change."""
    gain = np.sum(shift * z - 0.5 * shift**2, axis=1)
    total = np.concatenate([[0.0], np.cumsum(gain)])
    return total[1:] - np.minimum.accumulate(total)[:-1]


def first_alarm(path: np.ndarray, limit: float, onset: int) -> float:
    """Epochs from the onset on until a statistic (n,) reaches its limit, NaN where it does not."""
    hit = np.flatnonzero(path[onset:] >= limit)
    return float(hit[0] + 1) if hit.size else np.nan


@dataclass(frozen=True)
class FollowedFlight:
    """What follow made of a flight: delay in records (NaN without an alarm), kind, whether the interval holds the
    onset."""

    delay: float
    kind: str = ""
    covered: bool = False


def follow(monitor: Monitor, recording: Recording, onset: int, block: int, kinds: bool) -> FollowedFlight:
    """The flight in blocks, those before the onset larger; to the alarm, or with kinds to its end."""
    flight = FlightMonitor(monitor, ("", "", ""), FALSE_ALARM)
    position, hit, report = 0, None, None
    while position < len(recording) and (kinds or hit is None):
        near = hit is None and position >= onset - BEFORE
        length = block if near else min(BEFORE, onset - BEFORE - position if position < onset - BEFORE else BEFORE)
        report = flight.add(recording.select(slice(position, position + length)))
        position += length
        hit = min(position, len(recording)) if report.alarm and hit is None else hit
    if hit is None:
        return FollowedFlight(np.nan)
    change = report.change if report is not None and kinds else None
    if change is None:
        return FollowedFlight(float(hit - onset))
    covered = change.low_s is not None and change.low_s <= INTERVAL_S * onset <= (change.high_s or 0.0)
    return FollowedFlight(float(hit - onset), change.kind, covered)


@dataclass(frozen=True)
class Thresholds:
    """That of the GLR, and of CUSUM for each change, which a share FALSE_ALARM of healthy flights reach."""

    glr: float
    cusum: dict[tuple[str, float], float]

    @staticmethod
    def simulate(monitor: Monitor, cases: list[tuple[str, str, float]]) -> Thresholds:
        rng = np.random.default_rng(0)
        alike = [
            KnownResiduals.from_recording(monitor, flown(monitor, 9000 + k, "none", "", 0.0)[0])
            for k in range(KINDS_OF_FLIGHTS)
        ]
        shifts = [{(name, size): like.shift(monitor, name, size) for _, name, size in cases} for like in alike]
        most: list[float] = []
        sums: dict[tuple[str, float], list[float]] = {change: [] for change in shifts[0]}
        for k in range(SIMULATED):
            like = alike[k % KINDS_OF_FLIGHTS]
            z = rng.standard_normal(like.z.shape)
            most.append(float(glr(z, like.G).max()))
            for change, shift in shifts[k % KINDS_OF_FLIGHTS].items():
                sums[change].append(float(cusum(z, shift).max()))
        level = 1 - FALSE_ALARM
        return Thresholds(float(np.quantile(most, level)), {c: float(np.quantile(x, level)) for c, x in sums.items()})


def rate(alarms: int, of: int) -> str:
    """A count with the 95 % interval of its rate (C. J. Clopper, E. S. Pearson, Biometrika 26 (1934) 404–413)."""
    low = beta.ppf(0.025, alarms, of - alarms + 1) if alarms else 0.0
    high = beta.ppf(0.975, alarms + 1, of - alarms) if alarms < of else 1.0
    return f"{alarms} of {of} ({100 * low:.1f}–{100 * high:.1f} %)"


def ratio(later: np.ndarray, sooner: np.ndarray) -> str:
    """Ratio of two mean delays (n,) of the same flights, with its standard error by the jackknife."""
    n = len(later)
    whole = later.sum() / sooner.sum()
    without = (later.sum() - later) / (sooner.sum() - sooner)
    error = np.sqrt((n - 1) / n * np.sum((without - without.mean()) ** 2))
    return f"{whole:.2f} ± {error:.2f}"


def print_flights(monitor: Monitor, options: argparse.Namespace, cases: list[tuple[str, str, float]]) -> None:
    """The table of flights."""
    limits = Thresholds.simulate(monitor, cases)
    extra = " reported as | onset held |" if options.kinds else ""
    print(f"| change | CUSUM | GLR | follow | follow over GLR | missed | early | GLR early |{extra}")
    print("|---" * (10 if options.kinds else 8) + "|")
    seeds = range(options.seed, options.seed + options.flights)
    for law, name, size in cases:
        rows, found = [], []
        for seed in seeds:
            recording, onset = flown(monitor, seed, law, name, size)
            known = KnownResiduals.from_recording(monitor, recording)
            followed = follow(monitor, recording, onset, options.block, options.kinds)
            by_sum = first_alarm(cusum(known.z, known.shift(monitor, name, size)), limits.cusum[name, size], onset)
            path = glr(known.z, known.G)
            early = bool(np.any(path[:onset] >= limits.glr))
            rows.append((by_sum, np.nan if early else first_alarm(path, limits.glr, onset), followed.delay))
            found.append(followed)
        delay = np.array(rows)
        seen = np.all(delay > 0, axis=1)
        early, missed = int(np.sum(delay[:, 2] <= 0)), int(np.isnan(delay[:, 2]).sum())
        kinds = Counter(each.kind for each, good in zip(found, seen, strict=True) if good)
        held = sum(each.covered for each, good in zip(found, seen, strict=True) if good)
        words = ", ".join(f"{kind} {count}" for kind, count in kinds.most_common())
        figures = " | ".join(f"{x:.1f}" for x in delay[seen].mean(axis=0))
        extra = f" {words} | {held}/{int(seen.sum())} |" if options.kinds else ""
        print(
            f"| {law} {name} {size:+g} | {figures} | {ratio(delay[seen, 2], delay[seen, 1])} | {missed} | {early} "
            f"| {int(np.isnan(delay[:, 1]).sum())} |{extra}",
            flush=True,
        )
    if options.healthy:
        print_healthy_flights(monitor, options, limits)


def statistic_alarms(monitor: Monitor, flights: int) -> int:
    """Simulated healthy flights of which E, with the nominal known and after every block, reaches its limit: without
    what `follow` does to single readings, and a third of its time."""
    at, rng = unit_coordinates(monitor), np.random.default_rng(1)
    known_at, evidence = replace(at, basis=np.eye(len(at.described)), nuisance=0), StepEvidence(at.described)
    overshoot = mean_overshoot(monitor, at)
    alike = [
        KnownResiduals.from_recording(monitor, flown(monitor, 9000 + k, "none", "", 0.0)[0])
        for k in range(KINDS_OF_FLIGHTS)
    ]
    alarms = 0
    for k in range(flights):
        G = alike[k % KINDS_OF_FLIGHTS].G
        z, process = rng.standard_normal(G.shape[:2]), EProcess(known_at, evidence, FALSE_ALARM, overshoot)
        for n in range(0, len(z), BLOCK):
            process.add([process.segment(n, G[n : n + BLOCK], z[n : n + BLOCK], 0.0, 0.0)], [])
        alarms += process.alarm_block is not None
    return alarms


def print_healthy_flights(monitor: Monitor, options: argparse.Namespace, limits: Thresholds) -> None:
    """Rates of false alarms, of clean flights and of some with gross errors of single readings."""
    alone = rate(statistic_alarms(monitor, 3 * options.healthy), 3 * options.healthy)
    print(f"| none, the statistic alone: flights with an alarm | | | {alone} | | | | |", flush=True)
    for words, share, count in (("none", 0.0, options.healthy), ("none, spikes", SPIKES, options.healthy // 5)):
        by_glr, by_follow = 0, 0
        for seed in range(options.seed, options.seed + count):
            recording, _ = flown(monitor, seed + 500_000, "none", "", 0.0)
            rng = np.random.default_rng([seed, 13])
            for column, sigma in zip(monitor.sensors, noise_sigma(monitor), strict=True):
                wrong = rng.random(len(recording)) < share
                recording.columns[column][wrong] += SPIKE_SIGMAS * sigma * rng.choice((-1, 1), int(wrong.sum()))
            known = KnownResiduals.from_recording(monitor, recording)
            by_glr += bool(glr(known.z, known.G).max() >= limits.glr)
            flight = FlightMonitor(monitor, ("", "", ""), FALSE_ALARM)
            parts = (recording.select(slice(i, i + BLOCK)) for i in range(0, len(recording), BLOCK))
            by_follow += any(flight.add(part).alarm for part in parts)
        print(
            f"| {words}: flights with an alarm | | {rate(by_glr, count)} | {rate(by_follow, count)} | | | | |",
            flush=True,
        )


def flight_sums(monitor: Monitor, flights: int) -> tuple[np.ndarray, np.ndarray]:
    """Information (n, d, d) of some flights, of the changes first, then of what is uncertain about nominal, and its
    square roots."""
    at = unit_coordinates(monitor)
    order = np.r_[at.nuisance : at.basis.shape[1], : at.nuisance]
    found = []
    for k in range(flights):
        recording, _ = flown(monitor, 9500 + k, "none", "", 0.0)
        some = np.linspace(0, len(recording) - 1, SNAPSHOTS).round().astype(int)
        inputs = {c: recording.columns[c][some] for c in monitor.engine.inputs if c in recording.columns}
        _, J, _, _ = monitor.predict(inputs, monitor.theta0)
        bias = np.broadcast_to(np.eye(J.shape[1]), (len(J), J.shape[1], J.shape[1]))
        X = (np.concatenate([J, bias], axis=2) / monitor.noise.sigma[:, None]) @ at.basis[:, order]
        columns = X.reshape(-1, X.shape[2])
        found.append(columns.T @ columns)
    F = np.stack(found)
    value, vector = np.linalg.eigh(F)
    return F, vector * np.sqrt(np.maximum(value, 0.0))[:, None, :]


def drawn_history(
    at: Coordinates,
    names: list[str],
    sums: tuple[np.ndarray, np.ndarray],
    rng: np.random.Generator,
    change: tuple[str, str, float] | None,
) -> tuple[History, np.ndarray]:
    """A history of which the change begins with flight `ONSET`, and its scores (T, c) with the nominal known; names:
    what the changes are of."""
    p, d = len(at.described), at.basis.shape[1]
    nu = rng.standard_normal(d - p)
    like = rng.integers(len(sums[0]), size=HISTORY)
    F, root = sums[0][like], sums[1][like]
    t, theta = np.arange(HISTORY), np.zeros((HISTORY, p))
    if change is not None:
        law, name, size = change
        i = names.index(name)
        course = np.maximum(t - ONSET + 1, 0) / (HISTORY - ONSET) if law in ("ramp", "drift") else t >= ONSET
        theta[:, i] = size / at.unit[i] * course
    drawn = np.einsum("tde,te->td", root, rng.standard_normal((HISTORY, d)))
    known = np.einsum("tij,tj->ti", F[:, :p, :p], theta) + drawn[:, :p]
    score = np.einsum("tij,tj->ti", F, np.hstack([theta, np.tile(nu, (HISTORY, 1))])) + drawn
    return History(at.described, at.unit, score, F), known


def prefix(history: History, flights: int) -> History:
    """Its first flights."""
    return History(history.parameters, history.unit, history.score[:flights], history.information[:flights])


def trend_delay(history: History) -> tuple[float, bool]:
    """Flights from the onset on until the history is changed (NaN if never), and whether it was before the onset."""
    early = judge_history(prefix(history, ONSET)).changed
    for n in range(ONSET + 1, HISTORY + 1):
        if judge_history(prefix(history, n)).changed:
            return float(n - ONSET), early
    return np.nan, early


def print_histories(monitor: Monitor, options: argparse.Namespace, cases: list[tuple[str, str, float]]) -> None:
    """The table of histories."""
    sums, rng = flight_sums(monitor, KINDS_OF_FLIGHTS), np.random.default_rng(1)
    at, names = unit_coordinates(monitor), [*monitor.monitored, *monitor.sensors]
    p = len(at.described)

    def path(history: History, known: np.ndarray) -> np.ndarray:
        return glr_path(known, np.einsum("tii->ti", history.information[:, :p, :p]))

    most = [float(path(*drawn_history(at, names, sums, rng, None)).max()) for _ in range(SIMULATED)]
    limit = float(np.quantile(most, 1 - FALSE_ALARM))
    print(f"| change from flight {ONSET + 1} on | GLR | trend | trend over GLR | missed | early |")
    print("|---|---|---|---|---|---|")
    for case in cases:
        rows, early = [], 0
        for seed in range(options.seed, options.seed + options.flights):
            history, known = drawn_history(at, names, sums, np.random.default_rng([seed, 11]), case)
            delay, before = trend_delay(history)
            rows.append((first_alarm(path(history, known), limit, ONSET), delay))
            early += before
        delay = np.array(rows)
        seen = np.isfinite(delay).all(axis=1)
        figures = " | ".join(f"{x:.1f}" for x in delay[seen].mean(axis=0))
        print(
            f"| {case[0]} {case[1]} {case[2]:+g} | {figures} | {ratio(delay[seen, 1], delay[seen, 0])} "
            f"| {int(np.isnan(delay[:, 1]).sum())} | {early} |",
            flush=True,
        )
    by_glr, by_trend = 0, 0
    for seed in range(options.seed, options.seed + options.healthy):
        history, known = drawn_history(at, names, sums, np.random.default_rng([seed, 12]), None)
        by_glr += bool(path(history, known).max() >= limit)
        by_trend += any(judge_history(prefix(history, n)).changed for n in LOOKS)
    if options.healthy:
        print(
            f"| none: histories called changed | {rate(by_glr, options.healthy)} | {rate(by_trend, options.healthy)} |"
        )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--flights", type=int, default=20, help="flights, and histories, per row")
    parser.add_argument("--healthy", type=int, default=100, help="healthy flights, or histories")
    parser.add_argument("--block", type=int, default=1, help="records of a block of follow after the onset")
    parser.add_argument("--kinds", action="store_true", help="follow flights to their end, and show what is reported")
    parser.add_argument("--only", action="append", help="rows that hold this text; may be given several times")
    parser.add_argument("--seed", type=int, default=0, help="of the first flight of a row")
    parser.add_argument("--part", choices=("flights", "histories"), default="flights", help="which table")
    options = parser.parse_args()
    monitor = nominal_monitor()
    chosen = [
        [c for c in cases if not options.only or any(x in f"{c[0]} {c[1]} {c[2]:+g}" for x in options.only)]
        for cases in (CASES, HISTORY_CASES)
    ]
    if options.part == "flights":
        print_flights(monitor, options, chosen[0])
    else:
        print_histories(monitor, options, chosen[1])


if __name__ == "__main__":
    main()
