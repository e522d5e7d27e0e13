"""False alarms in a regime that identification never saw: python tests/benchmarks/leave_regime_out.py [--nominals N]

Healthy flights of an engine, turbofan.yaml unless another file is given, are flown by the engine itself and by truths
on tables whose shapes are wrong. A nominal is identified by default options from flights without one phase; `detect`
judges windows of that phase alone, in later flights. One row per truth and phase: windows, those without verdict, the
realised rate in % at nominal 5 and 1 % with its 95 % interval by the scatter between nominals, that at 5 % over nominal
and whether it is at most 1.5 times that; beside it the rates of nominals that saw the phase.
"""

from __future__ import annotations

import argparse
import csv
import sys
import tempfile
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).parent))

from end_to_end import run

from enginediag_cli.__main__ import main as enginediag
from enginediag_cli.engine.engine import Engine
from enginediag_cli.errors import ExitCode
from enginediag_cli.faults.catalogue import FaultSet
from enginediag_cli.physics.engine_file import load_engine
from enginediag_cli.probability import NORMAL_95
from enginediag_cli.recordings.table import Recording
from enginediag_cli.recordings.write import CsvWriter, open_output
from enginediag_cli.simulation.flights import KINDS, FlightConditions, column_noise, default_plan, generate_flights
from enginediag_cli.simulation.simulate import simulate, to_recording
from enginediag_cli.validation.truth_engines import tabulate_engine

ENGINE = Path(__file__).resolve().parents[2] / "configs" / "turbofan.yaml"
PHASES = ("climb", "cruise", "ground", "descent")
SHAPES = (0.0, 0.003, 0.01)
"""Errors of map shapes; 0 is the model itself."""
RATES = (0.05, 0.01)
TRAINED, JUDGED = 3, 4
"""Flights to identify from, and to judge."""
EVERY = {"climb": 3, "cruise": 6, "ground": 3, "descent": 3}
"""Of a phase every so many records are identified from, so that none of them rules the fit by its length."""
LENGTH = 30
"""Records of a window."""
MOST = 1.5
"""Times nominal: what is asked for."""


@dataclass
class Tally:
    """Of every nominal: alarms at RATES and windows judged; windows without verdict; nominals that were not found."""

    alarms: list[list[int]] = field(default_factory=list)
    judged: list[int] = field(default_factory=list)
    without: int = 0
    unsettled: int = 0

    def cells(self) -> tuple[str, str]:
        """Realised rates in % with their intervals, and that at the first of RATES over nominal."""
        total = sum(self.judged)
        if not total:
            return "–", "–"
        found = []
        for i in range(len(RATES)):
            each = np.array([a[i] / n for a, n in zip(self.alarms, self.judged, strict=True) if n])
            rate = sum(a[i] for a in self.alarms) / total
            half = NORMAL_95 * float(np.std(each, ddof=1)) / np.sqrt(len(each)) if len(each) > 1 else np.nan
            found.append(f"{100 * rate:.1f} (± {100 * half:.1f})")
        times = sum(a[0] for a in self.alarms) / total / RATES[0]
        return " / ".join(found), f"{times:.2f} {'yes' if times <= MOST else 'no'}"


def truth_of(model: Engine, shape: float, seed: int, folder: Path) -> Engine:
    """The engine that is flown."""
    if not shape:
        return model
    rng = np.random.default_rng([seed, 1])
    flown = generate_flights(default_plan(model), model, rng, flights=2)
    return tabulate_engine(model, {c: flown.columns[c] for c in model.inputs}, shape, rng, folder)


def fly(model: Engine, truth: Engine, flights: int, seed: int, *, thin: bool) -> tuple[Recording, np.ndarray]:
    """A recording of some flights and the phase of each record; thin: of every phase the records that EVERY keeps."""
    rng = np.random.default_rng([seed, 2])
    conditions = generate_flights(default_plan(model), model, rng, flights=flights)
    phase = conditions.columns["phase"]
    number = np.arange(len(phase))
    every = np.array([EVERY.get(str(p), 1) if thin else 1 for p in phase])
    kept = np.isin(phase, PHASES) & (number % every == 0)
    conditions = FlightConditions({c: v[kept] for c, v in conditions.columns.items()})
    noise = column_noise(KINDS["gaussian"], model)
    return to_recording(simulate(truth, conditions, FaultSet((), ()), noise, rng).columns), phase[kept]


def write(path: Path, recording: Recording, rows: np.ndarray) -> Path:
    with open_output(path) as stream:
        CsvWriter(stream).write(recording.select(rows))
    return path


def judge(tally: Tally, nominal: Path, later: Path, judged: Path) -> None:
    """Add the windows that a nominal judges; those outside its envelope have no verdict and are no alarms."""
    code = enginediag(["detect", "-n", str(nominal), str(later), "--window", str(LENGTH), "-o", str(judged), "-q"])
    if code not in (ExitCode.DONE, ExitCode.NO_VERDICT):
        raise RuntimeError(f"detect ended with {code}")
    with open(judged, encoding="utf-8", newline="") as stream:
        p = [row["p_value"] for row in csv.DictReader(line for line in stream if not line.startswith("#"))]
    values = np.array([float(x) for x in p if x])
    tally.alarms.append([int(np.sum(values < rate)) for rate in RATES])
    tally.judged.append(len(values))
    tally.without += len(p) - len(values)


def tallies(model: Engine, shape: float, phase: str, nominals: int, seed: int) -> tuple[Tally, Tally]:
    """Windows of the phase against nominals that never saw it, and that did."""
    found = Tally(), Tally()
    for k in range(nominals):
        with tempfile.TemporaryDirectory() as name:
            folder = Path(name)
            truth = truth_of(model, shape, seed + k, folder)
            recording, phases = fly(model, truth, TRAINED, 1000 * seed + 2 * k, thin=True)
            later, later_phases = fly(model, truth, JUDGED, 1000 * seed + 2 * k + 1, thin=False)
            judged = write(folder / "later.csv", later, later_phases == phase)
            for tally, rows in zip(found, (phases != phase, phases == phases), strict=True):
                healthy, nominal = write(folder / "healthy.csv", recording, rows), folder / "nominal.yaml"
                try:
                    run("identify", model.path, healthy, "-o", nominal)
                except RuntimeError:
                    tally.unsettled += 1
                    continue
                judge(tally, nominal, judged, folder / "judged.csv")
    return found


def main(arguments: list[str] | None = None) -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--nominals", type=int, default=6, help="identified nominals per row")
    parser.add_argument("--seed", type=int, default=2611)
    parser.add_argument("--engine", type=Path, default=ENGINE, help="an engine file of an aircraft's engine")
    parser.add_argument("--only", default="", help="this phase alone")
    parser.add_argument("--shape", type=float, action="append", help="errors of map shapes (default: 0, 0.3 % and 1 %)")
    options = parser.parse_args(arguments)
    model = load_engine(options.engine)
    print(
        "| truth | left out | windows | at 5 % / 1 % | over nominal, at most 1.5 | with that phase |\n"
        + "|---" * 6
        + "|"
    )
    for shape in options.shape or SHAPES:
        for phase in (p for p in PHASES if options.only in ("", p)):
            out, seen = tallies(model, shape, phase, options.nominals, options.seed)
            told = f"{sum(out.judged)} and {out.without} without verdict"
            told += f", {out.unsettled} of {options.nominals} not identified" if out.unsettled else ""
            name = f"maps wrong by {100 * shape:g} %" if shape else "same model"
            rates, times = out.cells()
            print(f"| {name} | {phase} | {told} | {rates} | {times} | {seen.cells()[0]} |", flush=True)


if __name__ == "__main__":
    sys.exit(main())
