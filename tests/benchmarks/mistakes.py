"""Wrong files that are named right: python tests/benchmarks/mistakes.py [--seed N] [--identified] [--engines A,B]

Recordings of shipped engines with single mistakes of the people who export them (`tests/intake/made_mistakes.py`):
per kind how many were made, named right, given another name and passed, with the right share's 95 % interval; and how
many recordings without a mistake, of engines drawn from their priors and of engines with a component fault of 8 %,
an instrument fault of five of its prior standard deviations, or all modules worn by 3 %, were refused.
"""

from __future__ import annotations

import argparse
import csv
import sys
import tempfile
from collections import Counter
from collections.abc import Iterator
from pathlib import Path

import numpy as np
from scipy.stats import beta

sys.path.insert(0, str(Path(__file__).parents[1] / "intake"))

from made_mistakes import KINDS, Columns, mistaken, recording

from enginediag_cli.__main__ import main as program
from enginediag_cli.engine.engine import Engine
from enginediag_cli.intake.agreement import Agreement
from enginediag_cli.intake.comparison import yardstick_of_engine, yardstick_of_nominal
from enginediag_cli.physics.engine_file import load_engine
from enginediag_cli.recordings.table import Recording
from enginediag_cli.shipped import shipped

ENGINES = {
    "turbofan": "airliner",
    "three_spool_turbofan": "airliner",
    "turboprop": "sweep",
    "turboshaft": "helicopter",
    "power_plant": "power_plant",
    "recuperated_micro_gas_turbine": "sweep",
}
"""Engines and the flights that they are recorded in."""
RECORDS = 400
"""Of a recording, at most."""


def flown(name: str, flight: str, engine: Engine, seed: int, folder: Path) -> Columns:
    """Inputs of an engine over flights that `simulate` flies."""
    file = folder / f"{name}.csv"
    words = ["simulate", str(shipped(f"{name}.yaml")), "--flight", str(shipped(f"flights/{flight}.yaml"))]
    program([*words, "--flights", "20" if flight == "power_plant" else "3", "--seed", str(seed), "-q", "-o", str(file)])
    with open(file, encoding="utf-8") as stream:
        rows = list(csv.DictReader(line for line in stream if not line.startswith("#")))
    rows = rows[:: max(1, len(rows) // RECORDS)]
    return {c: np.array([float(row[c]) for row in rows]) for c in engine.inputs}


def faulty(engine: Engine, inputs: Columns, rng: np.random.Generator) -> Iterator[Columns]:
    """Engines that nobody should refuse: a component fault, a wrong instrument, wear of every module."""
    health = [
        p for p in engine.parameters.values() if p.family == "health" and p.component not in engine.network.burners
    ]
    chosen = health[rng.integers(len(health))]
    worn = {p.name: 0.97 for p in health if p.wear < 0}
    for values in ({chosen.name: 0.92 if chosen.wear <= 0 else 1.08}, worn):
        answer = engine.predict(inputs, values)
        yield {**inputs, **{c: answer.y[:, j] for j, c in enumerate(engine.sensors)}}
    answer = engine.predict(inputs)
    columns = {**inputs, **{c: answer.y[:, j] for j, c in enumerate(engine.sensors)}}
    wrong = list(engine.sensors)[rng.integers(len(engine.sensors))]
    size = 5.0 * float(rng.choice([-1.0, 1.0])) * engine.sensors[wrong].bias_sigma
    yield {**columns, wrong: columns[wrong] + size}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--repeats", type=int, default=2, help="recordings per engine")
    parser.add_argument("--identified", action="store_true", help="against the engine itself, as an identified one")
    parser.add_argument("--engines", default=",".join(ENGINES))
    parser.add_argument("--all", action="store_true", help="show every recording that was not named right")
    asked = parser.parse_args()
    made, right, other = Counter[str](), Counter[str](), Counter[str]()
    sound = refused = 0
    with tempfile.TemporaryDirectory() as folder:
        for name in asked.engines.split(","):
            engine = load_engine(shipped(f"{name}.yaml"))
            noise = np.array([s.noise_sigma or 0.0 for s in engine.sensors.values()])
            nominal = yardstick_of_nominal(engine, {}, tuple(engine.sensors), noise)
            agreement = Agreement(nominal if asked.identified else yardstick_of_engine(engine), engine)
            for repeat in range(asked.repeats):
                rng = np.random.default_rng([asked.seed, repeat, len(name)])
                inputs = flown(name, ENGINES[name], engine, asked.seed + 100 * repeat, Path(folder))
                healthy = [recording(engine, inputs, rng, identified=asked.identified)]
                for columns in healthy + (list(faulty(engine, inputs, rng)) if asked.identified else []):
                    sound += 1
                    if found := agreement.disagreements(Recording(columns, source=name)):
                        refused += 1
                        print(f"refused: {found[0]}", flush=True)
                for kind in KINDS:
                    columns = recording(engine, inputs, rng, identified=asked.identified)
                    wrong = mistaken(columns, engine, kind, rng)
                    if wrong is None:
                        continue
                    found = agreement.disagreements(Recording(wrong.columns, source=name))
                    given = found[0].trial.mistake if found and found[0].trial else None
                    fits = given is not None and any(word in given.words for word in wrong.words)
                    fits = fits and given is not None and wrong.column in ("", given.column)
                    made[kind] += 1
                    right[kind] += fits
                    other[kind] += bool(found) and not fits
                    if asked.all and not fits:
                        print(f"{name} {kind} {wrong.column}: {found[0] if found else 'passed'}", flush=True)
    print("\n| mistake | made | named right | refused otherwise | passed |\n|---|---|---|---|---|")
    for kind in made:
        print(f"| {kind} | {made[kind]} | {right[kind]} | {other[kind]} | {made[kind] - right[kind] - other[kind]} |")
    n, k = made.total(), right.total()
    low, high = beta.ppf(0.025, k, n - k + 1), beta.ppf(0.975, k + 1, n - k) if k < n else 1.0
    print(f"| all | {n} | {k} | {other.total()} | {n - k - other.total()} |")
    print(f"\nnamed right: {100 * k / n:.1f} % ({100 * low:.1f}–{100 * high:.1f})")
    print(f"sound recordings refused: {refused} of {sound}")


if __name__ == "__main__":
    main()
