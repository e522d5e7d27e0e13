"""Sequential monitoring of whole flights: python tests/benchmarks/detection_delay.py [--flights N] [--only ROW] …

Table on standard output: for each kind and size of change that begins on the way, how many flights missed it, alarms
before it, records from onset to alarm (median, 90 % point), the kind that is told at the end of the flight, and in how
many the onset lies in its 95 % interval; and for healthy flights, how many had an alarm at any time. One record
every 10 s, blocks of 20 records, false-alarm probability 1 % for the whole flight.
"""

from __future__ import annotations

import argparse
import subprocess
import sys
import tempfile
from collections import Counter
from pathlib import Path

import numpy as np

from enginediag_cli.history.follow import FlightMonitor
from enginediag_cli.intake.selection import open_baseline
from enginediag_cli.recordings.table import Recording
from enginediag_cli.residuals.monitor import Monitor, build_monitor
from enginediag_cli.simulation.flights import default_plan, engine_inputs, generate_flights

ENGINE = Path(__file__).resolve().parents[2] / "configs" / "turbofan.yaml"
BLOCK, INTERVAL_S = 20, 10.0
CASES = [
    *(("step", "hpc.efficiency", x) for x in (-0.0025, -0.005, -0.01, -0.02)),
    *(("step", "hpt.flow_capacity", x) for x in (0.0025, 0.005, 0.01, 0.02)),
    *(("ramp", "hpc.efficiency", x) for x in (-0.01, -0.02)),
    *(("jump", "T3_K", x) for x in (1.5, 3.0, 6.0)),
]


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
    after = t >= onset if law != "ramp" else np.maximum(t - onset, 0) / (n - onset)
    values = {} if law in ("jump", "none") else {name: 1 + size * after}
    y = np.asarray(engine.predict(inputs, values, sensors=monitor.sensors).y)
    sigma = np.array([engine.sensors[c].noise_sigma for c in monitor.sensors])
    y = y + sigma * rng.standard_normal(y.shape)
    if law == "jump":
        y[:, monitor.sensors.index(name)] += size * after
    readings = {c: y[:, j] for j, c in enumerate(monitor.sensors)}
    columns = {c: np.asarray(v, float) for c, v in inputs.items()}
    return Recording({**columns, "time_s": INTERVAL_S * t, **readings}, line=t), onset


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--flights", type=int, default=20, help="flights per row")
    parser.add_argument("--healthy", type=int, default=100, help="healthy flights")
    parser.add_argument("--only", action="append", help="rows that hold this text; may be given several times")
    parser.add_argument("--false-alarm", type=float, default=0.01)
    parser.add_argument("--seed", type=int, default=0, help="of the first flight of a row")
    options = parser.parse_args()
    monitor = nominal_monitor()
    print("| change | flights | missed | before onset | median delay | 90 % | reported as | onset in interval |")
    print("|---|---|---|---|---|---|---|---|")
    for law, name, size in [*CASES, ("none", "", 0.0)]:
        title = f"{law} {name} {size:+g}" if law != "none" else "none (alarms)"
        if options.only and not any(text in title for text in options.only):
            continue
        flights = options.flights if law != "none" else options.healthy
        delays, kinds, early, missed, covered = [], Counter(), 0, 0, 0
        for seed in range(flights):
            recording, onset = flown(monitor, options.seed + seed + (1000 if law == "none" else 0), law, name, size)
            flight, hit, report = FlightMonitor(monitor, ("", "", ""), options.false_alarm), None, None
            for i in range(0, len(recording), BLOCK):
                report = flight.add(recording.select(slice(i, i + BLOCK)))
                hit = i + BLOCK if report.alarm and hit is None else hit
            if hit is None or report is None or report.change is None:
                missed += 1
            elif hit <= onset or law == "none":
                early += 1
            else:
                delays.append(hit - onset)
                kinds[report.change.kind] += 1
                covered += report.change.low_s <= INTERVAL_S * onset <= report.change.high_s
        middle, late = np.quantile(delays, [0.5, 0.9]) if delays else (np.nan, np.nan)
        told = ", ".join(f"{kind} {count}" for kind, count in kinds.most_common())
        print(
            f"| {title} | {flights} | {missed} | {early} | {middle:.0f} | {late:.0f} | {told} "
            f"| {covered}/{len(delays)} |",
            flush=True,
        )


if __name__ == "__main__":
    main()
