"""Engines of a fleet from end to end: python tests/benchmarks/fleet_recordings.py [--healthy N] [--faulty N]

Recordings of the turbofan that `enginediag simulate` makes, thirty airliner flights an engine, every thirtieth record;
`identify` from the first five flights of the healthy ones; local statistics, verdicts and flags as a fleet makes them.
A faulty engine loses two per cent of HPC efficiency with its sixteenth flight.
"""

from __future__ import annotations

import argparse
import csv
import subprocess
import sys
import tempfile
from pathlib import Path

import numpy as np

from enginediag_cli.detection.series import build_series
from enginediag_cli.fleets.engine_judgement import judge_engine
from enginediag_cli.fleets.findings import EngineHistory, FleetSettings
from enginediag_cli.fleets.run import judge_fleet
from enginediag_cli.history.engines import HistoryWindows
from enginediag_cli.intake.loader import RecordingLoader
from enginediag_cli.intake.selection import RecordingSource, open_baseline, required_columns
from enginediag_cli.residuals.files import WindowReader, WindowSettings
from enginediag_cli.residuals.monitor import build_monitor
from enginediag_cli.residuals.reduced import monitor_for_series
from enginediag_cli.residuals.windows import WindowPlan

ENGINE = Path(__file__).resolve().parents[2] / "configs" / "turbofan.yaml"
FLIGHTS, BASELINE, THINNED, IDENTIFIED = 30, 12, 30, 5
FAULT = """kind: faults
description: sudden loss of HPC efficiency
faults:
  - name: hpc_loss
    changes: {hpc.efficiency: -0.02}
    law: {type: saturating, clock: flight, onset: 15, time_constant: 0.01}
"""


def enginediag(*arguments: object) -> None:
    """One run of the program that must end well."""
    done = subprocess.run(
        [sys.executable, "-m", "enginediag_cli", *map(str, arguments)], capture_output=True, text=True
    )
    if done.returncode:
        raise SystemExit(done.stderr)


def recording(folder: Path, serial: str, seed: int, faulty: bool) -> tuple[Path, Path]:
    """A thinned recording of one engine, and that of its first flights."""
    whole, thin, early = (folder / f"{serial}{part}.csv" for part in ("_all", "", "_early"))
    fault = ("--fault", folder / "fault.yaml") if faulty else ()
    enginediag("simulate", ENGINE, "--flights", FLIGHTS, "--seed", seed, "-q", *fault, "-o", whole)
    with whole.open(encoding="utf-8", newline="") as stream:
        head, *rows = list(csv.reader(line for line in stream if not line.startswith("#")))
    flight = head.index("flight")
    kept = [[serial, *row] for row in rows[::THINNED]]
    for path, some in ((thin, kept), (early, [r for r in kept if int(r[flight + 1]) <= IDENTIFIED])):
        with path.open("w", encoding="utf-8", newline="") as stream:
            csv.writer(stream).writerows([["engine", *head], *some])
    whole.unlink()
    return thin, early


def main() -> None:
    options = argparse.ArgumentParser(description=__doc__)
    options.add_argument("--healthy", type=int, default=40)
    options.add_argument("--faulty", type=int, default=4)
    asked = options.parse_args()
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        (folder / "fault.yaml").write_text(FAULT, encoding="utf-8")
        count = asked.healthy + asked.faulty
        files = [recording(folder, f"e{k}", k, k >= asked.healthy) for k in range(count)]
        learnt = [early for _, early in files[: min(asked.healthy, 10)]]
        enginediag("identify", ENGINE, *learnt, "--no-cross-validation", "-q", "-o", folder / "nominal.yaml")
        monitor = build_monitor(open_baseline(folder / "nominal.yaml"), sensors=True)
        monitor = monitor_for_series(monitor)
        intake = RecordingLoader(
            RecordingSource(tuple(str(f) for f, _ in files)), required_columns(monitor.engine, monitor.sensors)
        )
        plan = WindowSettings(WindowPlan().series_plan)
        windows = HistoryWindows(WindowReader(intake, monitor, plan, series=True))
        series = build_series(windows, law="none")
    settings = FleetSettings()
    histories = [
        EngineHistory(serial, "", mine, windows.engines[serial], BASELINE) for serial, mine in series.stretches.items()
    ]
    fleet = judge_fleet([judge_engine(h, series, settings) for h in histories], settings, series.parameters)
    faulty = {f"e{k}" for k in range(asked.healthy, count)}
    healthy = [f for f in fleet.engines if f.serial not in faulty]
    others = [f for f in fleet.engines if f.serial in faulty]
    p = np.array([f.probability for f in healthy])
    print(f"{len(healthy)} healthy engines of {FLIGHTS} flights: P(changed) {p.mean():.2f}, {p.max():.2f} at most")
    print(
        f"called changed: {sum(f.verdict == 'changed' for f in healthy)} healthy, "
        f"{sum(f.verdict == 'changed' for f in others)} of {len(others)} faulty"
    )
    listed = set(fleet.flagged.engines)
    print(f"flagged: {len(listed - faulty)} healthy, {len(listed & faulty)} of {len(others)} faulty")
    since = ", ".join(f"{f.since} ({f.since_low} to {f.since_high})" for f in others if f.since)
    print(f"since flight (true 16): {since}")


if __name__ == "__main__":
    main()
