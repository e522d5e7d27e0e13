"""Is an instrument that is wrong named, and it alone, in every form of its fault? Outputs and inputs, default options.

    python tests/benchmarks/instrument_faults.py [--engine turbofan --engine turboshaft] [--seed 1] [--form stuck]

Each fault is simulated in one flight of an engine that was identified from three others, and isolated as `isolate` does
when no option is given. Biases and scales are drawn log-uniformly between 0.8 and 4 plausible errors (`prior_sigma`),
either sign; a drift reaches as much at the end of the flight; the noise of an output is 2.5 to 6 times the stated one,
that of an input so large that its readings scatter by 1 to 4 plausible errors; stuck is an instrument from a record of
the first two thirds of the flight on, at its last reading.
"""

from __future__ import annotations

import argparse
import json
import subprocess
import tempfile
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from enginediag_cli.engine.instrument_errors import InputErrors
from enginediag_cli.physics.engine_file import load_engine
from enginediag_cli.units import split_column

CONFIGS = Path(__file__).parents[2] / "configs"
MISSIONS = {"turboshaft": "helicopter", "turbojet": "airliner", "turbofan": "airliner"}
SMALLEST, LARGEST = 0.8, 4.0
"""Sizes in plausible errors: from what one flight shows to what an engineer sees in a plot."""
TIMES = (2.5, 6.0)
"""Noise of an output over the stated one."""
LATEST = 2 / 3
"""Share of a flight in which an instrument gets stuck."""
FORMS = ("bias", "scale", "drift", "noise", "stuck")


def run(*words: object) -> str:
    """What the installed program prints; no verdict (3) and a recording that is refused (2) are answers, too."""
    done = subprocess.run(["enginediag", *map(str, words)], capture_output=True, text=True)
    if done.returncode not in (0, 2, 3):
        raise RuntimeError(done.stderr)
    return done.stdout


@dataclass(frozen=True)
class Fault:
    """One instrument: its column, form and size (None where it has none), and its effect and law in a fault file."""

    column: str
    form: str
    size: float | None
    effect: str
    law: str = "{type: step}"


def faults_of(name: str, forms: Sequence[str], flown: tuple[int, float], rng: np.random.Generator) -> Iterator[Fault]:
    """A fault of each form of every instrument of an engine; flown: records and hours of a flight."""
    engine = load_engine(CONFIGS / f"{name}.yaml")
    records, hours = flown
    wrapped = InputErrors.wrap(engine)
    known = [(c, p) for c, s in engine.sensors.items() for p in s.parameters() if p.quantity in ("bias", "scale")]
    known += [(e.column, e.parameter) for e in getattr(wrapped, "errors", {}).values()]

    def between(low: float, high: float) -> float:
        return float(np.exp(rng.uniform(np.log(low), np.log(high))))

    for column, parameter in known:
        if parameter.quantity in forms:
            size = parameter.prior_sigma * between(SMALLEST, LARGEST) * rng.choice([-1, 1])
            what = "size" if parameter.quantity == "bias" else "change"
            yield Fault(column, parameter.quantity, size, f"{{type: {parameter.quantity}, {what}: {size}}}")
        if parameter.quantity != "bias":
            continue
        if "drift" in forms:
            rate = parameter.prior_sigma * between(SMALLEST, LARGEST) * rng.choice([-1, 1]) / hours
            drift = "{type: drift, clock: hours, onset: 0, rate: 1}"
            yield Fault(column, "drift", rate, f"{{type: bias, size: {rate}}}", drift)
        if "noise" in forms:
            sensor = engine.sensors.get(column)
            plausible = parameter.prior_sigma * between(1.0, LARGEST)
            size = plausible if sensor is None else sensor.noise_sigma * float(np.sqrt(between(*TIMES) ** 2 - 1))
            yield Fault(column, "noise", size, f"{{type: noise, size: {size}}}")
        if "stuck" in forms:
            onset = int(rng.integers(2, int(LATEST * records)))
            yield Fault(column, "stuck", None, "{type: stuck}", f"{{type: step, onset: {onset}}}")


def flight_of(path: Path) -> tuple[int, float]:
    """Records and hours of the first flight of a file of three."""
    rows = [line.split(",") for line in path.read_text().splitlines() if not line.startswith("#")]
    time = [float(row[1]) for row in rows[1:] if row[0] == "1"]
    return len(time), (time[-1] - time[0]) / 3600.0


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--engine", action="append")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--form", action="append", choices=FORMS)
    parser.add_argument("--table", action="store_true", help="print the table of the README")
    given = parser.parse_args()
    rng = np.random.default_rng(given.seed)
    found: list[tuple[str, str, str]] = []
    for name in given.engine or ["turbofan", "turboshaft"]:
        with tempfile.TemporaryDirectory() as folder:
            here = Path(folder)
            flight = CONFIGS / "flights" / f"{MISSIONS.get(name, 'airliner')}.yaml"
            simulate = ("simulate", CONFIGS / f"{name}.yaml", "--flight", flight, "-q")
            run(*simulate, "--flights", 3, "--seed", given.seed, "-o", here / "healthy.csv")
            run("identify", CONFIGS / f"{name}.yaml", here / "healthy.csv", "-q", "-o", here / "nominal.yaml")
            for k, fault in enumerate(faults_of(name, given.form or FORMS, flight_of(here / "healthy.csv"), rng)):
                one = f"{{name: f, column: {fault.column}, effect: {fault.effect}, law: {fault.law}}}"
                (here / "fault.yaml").write_text(f"kind: faults\nsensor_faults:\n  - {one}\n")
                seed = 1000 * given.seed + k
                run(
                    *simulate, "--flights", 1, "--seed", seed, "--fault", here / "fault.yaml", "-o", here / "judged.csv"
                )
                text = run("isolate", "-n", here / "nominal.yaml", here / "judged.csv", "-q", "-f", "json")
                row = {"isolated": None, "rivals": None, "members": None, "probability": None}
                row |= json.loads(text)[0] if text else {}
                parts = {".".join(x.split(".")[:2]) for x in row["isolated"] or ()}
                quantity = split_column(fault.column)[0]
                alone = parts in ({f"sensor.{quantity}"}, {f"input.{quantity}"})
                others = [name for cell in ("rivals", "members", "isolated") for name in row[cell] or ()]
                known = alone or f".{quantity}." in " ".join(others)
                form = alone and row["isolated"][0].rpartition(".")[2]
                verdict = "right" if alone else "among" if known else "WRONG"
                found.append((fault.form, verdict, form or ""))
                size = "" if fault.size is None else f"{fault.size:+.4g}"
                chance = "" if row["probability"] is None else f"({row['probability']:.2f})"
                named = f"{' & '.join(row['isolated'] or ['nothing'])} {chance}"
                print(f"{name:12} {fault.column:14} {fault.form:5} {size:>10}  {verdict:6} {named}", flush=True)
    if given.table:
        print("\n| form | faults | the instrument alone | … in its form | named or among the alternatives |")
        print("|---|---|---|---|---|")
    for form in given.form or FORMS:
        mine = [(verdict, named) for one, verdict, named in found if one == form]
        right = sum(verdict == "right" for verdict, _ in mine)
        among = sum(verdict != "WRONG" for verdict, _ in mine)
        exact = sum(named == form for _, named in mine)
        print(f"| {form} | {len(mine)} | {right} | {exact} | {among} |")


if __name__ == "__main__":
    main()
