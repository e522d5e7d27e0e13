"""Is an instrument that reads wrong named, and it alone? Bias and scale of every output and input, default options.

    python tests/benchmarks/instrument_faults.py [--engine turbofan --engine turboshaft] [--seed 1]

Each fault is simulated in one flight of an engine that was identified from three others, and isolated as `isolate` does
when no option is given. Sizes are drawn log-uniformly between 0.8 and 4 plausible errors (`prior_sigma`), either sign.
"""

from __future__ import annotations

import argparse
import json
import subprocess
import tempfile
from pathlib import Path

import numpy as np

from enginediag_cli.engine.input_errors import InputErrors
from enginediag_cli.physics.engine_file import load_engine
from enginediag_cli.units import split_column

CONFIGS = Path(__file__).parents[2] / "configs"
MISSIONS = {"turboshaft": "helicopter", "turbojet": "airliner", "turbofan": "airliner"}
SMALLEST, LARGEST = 0.8, 4.0
"""Sizes in plausible errors: from what one flight shows to what an engineer sees in a plot."""


def run(*words: object) -> str:
    """What the installed program prints."""
    done = subprocess.run(["enginediag", *map(str, words)], check=True, capture_output=True, text=True)
    return done.stdout


def faults_of(name: str, rng: np.random.Generator) -> list[dict[str, object]]:
    """A bias and a scale error of every instrument of an engine: column, form and size."""
    engine = load_engine(CONFIGS / f"{name}.yaml")
    wrapped = InputErrors.of(engine)
    forms = [(c, p) for c, s in engine.sensors.items() for p in s.parameters() if p.quantity in ("bias", "scale")]
    forms += [(e.column, e.parameter) for e in getattr(wrapped, "errors", {}).values()]
    found: list[dict[str, object]] = []
    for column, parameter in forms:
        size = parameter.prior_sigma * np.exp(rng.uniform(np.log(SMALLEST), np.log(LARGEST))) * rng.choice([-1, 1])
        found.append({"column": column, "form": parameter.quantity, "size": float(size)})
    return found


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--engine", action="append")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--most", type=int, default=26, help="faults per engine at most")
    given = parser.parse_args()
    rng = np.random.default_rng(given.seed)
    right = among = total = 0
    for name in given.engine or ["turbofan", "turboshaft"]:
        with tempfile.TemporaryDirectory() as folder:
            here = Path(folder)
            flight = CONFIGS / "flights" / f"{MISSIONS.get(name, 'airliner')}.yaml"
            simulate = ("simulate", CONFIGS / f"{name}.yaml", "--flight", flight, "-q")
            run(*simulate, "--flights", 3, "--seed", given.seed, "-o", here / "healthy.csv")
            run("identify", CONFIGS / f"{name}.yaml", here / "healthy.csv", "-q", "-o", here / "nominal.yaml")
            for k, fault in enumerate(faults_of(name, rng)[: given.most]):
                what = "size" if fault["form"] == "bias" else "change"
                effect = f"{{type: {fault['form']}, {what}: {fault['size']}}}"
                text = f"kind: faults\nsensor_faults:\n  - {{name: f, column: {fault['column']}, effect: {effect}}}\n"
                (here / "fault.yaml").write_text(text)
                seed = 1000 * given.seed + k
                run(
                    *simulate, "--flights", 1, "--seed", seed, "--fault", here / "fault.yaml", "-o", here / "judged.csv"
                )
                rows = json.loads(run("isolate", "-n", here / "nominal.yaml", here / "judged.csv", "-q", "-f", "json"))
                row = rows[0]
                parts = {".".join(x.split(".")[:2]) for x in row["isolated"] or ()}
                quantity = split_column(str(fault["column"]))[0]
                alone = parts in ({f"sensor.{quantity}"}, {f"input.{quantity}"})
                right, total = right + alone, total + 1
                known = alone or f".{quantity}." in " ".join([*row["rivals"], *(row["members"] or ())])
                among += known
                verdict = "right" if alone else "among" if known else "WRONG"
                named = f"{' & '.join(row['isolated'] or ['nothing'])} ({row['probability']:.2f})"
                print(
                    f"{name:12} {fault['column']:14} {fault['form']:5} {fault['size']:+10.4g}  {verdict:6} {named}",
                    flush=True,
                )
    print(f"the instrument alone is named in {right} of {total}; it is named or among the alternatives in {among}")


if __name__ == "__main__":
    main()
