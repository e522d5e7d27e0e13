"""What memory costs: python tests/benchmarks/moving_residuals.py [--records N]

Residuals and statistics of recordings once a second, as `residual` makes them (engine, sensitivities to all that is
monitored and uncertain, windows of a minute), with an engine that carries memory terms against the same engine without.
Every run reads its recording onto a tape of its own, so that nothing is remembered of the run before; the nominal state
is the engine file's. CPU time, the least of some runs, and the ratio, for an engine that carries one, two and three
terms. A table goes to standard output.
"""

from __future__ import annotations

import argparse
import sys
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path

import numpy as np

from enginediag_cli.engine.engine import Engine
from enginediag_cli.engine.recall import MOMENT
from enginediag_cli.physics.engine_file import load_engine
from enginediag_cli.physics.registry import effect
from enginediag_cli.validation.trial_flights import draw_moving_flights

ROOT = Path(__file__).resolve().parents[2]
Terms = Sequence[tuple[str, str, Mapping[str, float]]]
SOAK = {"exchange": 0.02, "time_constant": 40.0}
ENGINES: Mapping[str, Terms] = {
    "turbofan": (
        ("probe_lag", "T45", {"time_constant": 3.0}),
        ("heat_soak", "hpt", SOAK),
        ("heat_soak", "hpc", SOAK),
    ),
    "turboshaft": (
        ("probe_lag", "T45", {"time_constant": 3.0}),
        ("heat_soak", "gas_generator_turbine", SOAK),
        ("heat_soak", "compressor", SOAK),
    ),
}
RUNS = 5


def flight_of(engine: Engine, records: int) -> dict[str, np.ndarray]:
    """Inputs of some flights behind each other, once a second."""
    rng = np.random.default_rng(1)
    flights: list[dict[str, np.ndarray]] = []
    while sum(len(f["time_s"]) for f in flights) < records:
        flights += draw_moving_flights(engine, rng)[0]
    columns = {c: np.concatenate([f[c] for f in flights])[:records] for c in engine.inputs}
    return {"time_s": np.arange(records, dtype=float), **columns}


def cpu_s(run: Callable[[], object]) -> float:
    """CPU time of a run, s: the least of RUNS."""
    found = []
    for _ in range(RUNS):
        start = time.process_time()
        run()
        found.append(time.process_time() - start)
    return min(found)


def residuals(engine: Engine, columns: Mapping[str, np.ndarray]) -> None:
    """Predictions and sensitivities of a recording that was never read before, in blocks as windows come."""
    moment = engine.tapes.add(columns)
    inputs = {c: columns[c] for c in engine.inputs}
    engine.predict({**inputs, MOMENT: moment}, {}, wrt=engine.monitored)


def table(options: argparse.Namespace) -> Iterator[str]:
    """Lines of the table, as soon as they are known."""
    yield "| engine | without memory, µs a record | one term | two | three |\n|---|---|---|---|---|"
    for name, terms in ENGINES.items():
        plain = load_engine(ROOT / "configs" / f"{name}.yaml")
        columns = flight_of(plain, options.records)
        residuals(plain, columns)  # the fitted start
        steady = cpu_s(lambda plain=plain, columns=columns: residuals(plain, columns))
        cells = [f"{1e6 * steady / options.records:.1f}"]
        for k in range(1, len(terms) + 1):
            moving = plain.replace_effects([effect(plain, *label, values) for *label, values in terms[:k]])
            residuals(moving, columns)
            ratio = cpu_s(lambda moving=moving, columns=columns: residuals(moving, columns)) / steady
            cells.append(f"{ratio:.2f}")
        yield f"| {name} | " + " | ".join(cells) + " |"


def main(arguments: list[str] | None = None) -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--records", type=int, default=3000)
    for line in table(parser.parse_args(arguments)):
        print(line, flush=True)


if __name__ == "__main__":
    sys.exit(main())
