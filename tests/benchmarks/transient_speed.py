"""Speed of simulated transients: one engine for an hour at 1 Hz, many engines through a Bodie manoeuvre.

    python tests/benchmarks/transient_speed.py [--engines 1000] [--table]

CPU time of this process, as JSON; ratios to one plain evaluation of the network of one engine, which machines share.
"""

from __future__ import annotations

import argparse
import json
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from enginediag_cli.engine import solver
from enginediag_cli.engine.transient.moving_engine import MovingEngine
from enginediag_cli.engine.transient.states import TransientInputs
from enginediag_cli.physics.engine_file import load_engine

FILE = Path(__file__).parents[2] / "configs" / "turbofan_governed.yaml"
HOUR = {
    "time": (0, 60, 1300, 2500, 3500, 3600),
    "altitude_m": (0, 0, 10_000, 10_000, 300, 300),
    "mach": (0, 0.25, 0.78, 0.78, 0.25, 0.2),
}
POWER = {
    "time": (0, 20, 24, 60, 400, 1300, 1305, 2500, 2505, 3300, 3310, 3400, 3402, 3600),
    "power": (0, 0, 1, 1, 0.9, 0.85, 0.6, 0.6, 0.1, 0.1, 0.5, 0.4, 0.0, 0.0),
}
BODIE = {"time": (0.0, 5.0, 5.5, 9.0, 9.5, 40.0), "power": (1.0, 1.0, 0.0, 0.0, 1.0, 1.0)}


def cpu_s(action: Callable[[], Any]) -> tuple[float, Any]:
    begin = time.process_time()
    found = action()
    return time.process_time() - begin, found


def hour(m: MovingEngine) -> TransientInputs:
    """An hour's flight whose power never stands still: every second is a corner."""
    t = np.arange(3601.0)
    inputs = {c: np.interp(t, HOUR["time"], HOUR[c]) for c in ("altitude_m", "mach")} | {"dT_isa_K": np.full(3601, 5.0)}
    power = np.interp(t, POWER["time"], POWER["power"]) + 0.002 * np.sin(t / 3.0)
    inputs[m.engine.power_setting] = m.engine.power_from_fraction(power, inputs)
    return TransientInputs(t, inputs, t)


def bodie(m: MovingEngine, engines: int) -> list[TransientInputs]:
    rng = np.random.default_rng(0)
    t, still = np.array(BODIE["time"]), np.zeros(len(BODIE["time"]))
    flights = []
    for _ in range(engines):
        inputs = {"altitude_m": still, "mach": still, "dT_isa_K": still + rng.uniform(-10.0, 10.0)}
        power = np.array(BODIE["power"]) * rng.uniform(0.7, 1.0)
        inputs[m.engine.power_setting] = m.engine.power_from_fraction(power, inputs)
        columns = {**inputs, "hpc.efficiency": still + rng.uniform(0.97, 1.0)}
        flights.append(TransientInputs(t, columns, np.arange(0.0, 40.5, 0.5)))
    return flights


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--engines", type=int, default=1000)
    parser.add_argument("--table", action="store_true", help="as a table")
    asked = parser.parse_args()
    engines = asked.engines
    m = MovingEngine(load_engine(FILE))
    network, inputs = m.engine.network, {c: np.array([v]) for c, v in _design(m).items()}
    x = np.array([[u.start] for u in m.engine.unknowns])
    plain = min(
        cpu_s(lambda: [solver.evaluate(network, inputs, m.engine.nominal, x, frozenset()) for _ in range(100)])[0] / 100
        for _ in range(3)
    )
    one, found = cpu_s(lambda: m.fly([hour(m)]))
    many, together = cpu_s(lambda: m.fly(bodie(m, engines)))
    report = {
        "plain_evaluation_ms": 1e3 * plain,
        "one_engine_hour_at_1_Hz_s": one,
        "one_engine_evaluations_per_record": one / plain / 3601,
        "hour_reached": bool(np.isfinite(found[0].states).all()),
        "engines": engines,
        "engine_seconds_per_cpu_second": engines * BODIE["time"][-1] / many,
        "share_reached": float(np.mean([np.isfinite(flown.states).all() for flown in together])),
    }
    print(table(report) if asked.table else json.dumps(report, indent=2))


def table(report: dict[str, Any]) -> str:
    rows = (
        ("one engine for an hour, a corner every second", f"{report['one_engine_hour_at_1_Hz_s']:.1f} s"),
        ("… in plain evaluations of one point, per record", f"{report['one_engine_evaluations_per_record']:.1f}"),
        (
            f"{report['engines']} engines through a Bodie manoeuvre, engine-seconds per CPU second",
            f"{report['engine_seconds_per_cpu_second']:,.0f}",
        ),
        ("… that get to its end", f"{report['share_reached']:.0%}"),
    )
    return "\n".join(["| CPU time | |", "|---|---|", *(f"| {what} | {figure} |" for what, figure in rows)])


def _design(m: MovingEngine) -> dict[str, float]:
    defaults = {"altitude_m": 0.0, "mach": 0.0, "dT_isa_K": 0.0, **m.engine.optional_inputs}
    power = float(m.engine.power_from_fraction(np.array([1.0]), {c: np.zeros(1) for c in defaults})[0])
    return {**defaults, m.engine.power_setting: power}


if __name__ == "__main__":
    main()
