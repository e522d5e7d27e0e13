"""How often adversarial errors change the name that `isolate` gives, and whether what it says of them holds.

    python tests/verification/flip_rates.py --engines 4 --recordings 30

Each engine is trained on recordings whose instruments differ by the spread that its engine file states, and whose
maps are wrong in other shapes than the tool's curves (`validation/truth_engines.py`, 0.3 and 0.15 %). Each judged
recording has a drawn change (or none) and an answer with its flips. Then the same recording, the same noise, is judged
again with an error put in:

- inside:  the nearest single error of an instrument or input by one stated standard deviation, in the direction that
           hurts; all instruments and inputs at once, each by one stated standard deviation of either sign;
- maps:    another truth of the same engine file, maps and training, whose maps are drawn anew within what is stated;
- just inside and outside: the nearest errors of each kind at 0.9 and 1.1 times the size that was computed.

A name has flipped when it differs by more than the instrument whose error was put in.
"""

from __future__ import annotations

import argparse
import sys
import tempfile
from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from enginediag_cli.__main__ import main
from enginediag_cli.engine.engine import Engine
from enginediag_cli.intake.loader import RecordingLoader
from enginediag_cli.intake.selection import RecordingSource, open_baseline, required_columns
from enginediag_cli.isolation.diagnosis import DiagnosisOptions
from enginediag_cli.isolation.sensitivity_analysis import ConclusionChange, SensitivityAnalysis
from enginediag_cli.isolation.windows import WindowIsolation
from enginediag_cli.physics.engine_file import load_engine
from enginediag_cli.recordings.table import Recording
from enginediag_cli.recordings.write import write_csv
from enginediag_cli.residuals.files import WindowReader, WindowSettings
from enginediag_cli.residuals.long_windows import RecentRecords
from enginediag_cli.residuals.monitor import Monitor, build_monitor
from enginediag_cli.residuals.windows import WindowPlan
from enginediag_cli.shipped import shipped
from enginediag_cli.validation.trials import wilson
from enginediag_cli.validation.truth_engines import draw_map_errors

SPREADS = {
    "N1_rpm": 2.0,
    "N2_rpm": 4.0,
    "T25_K": 0.3,
    "P25_Pa": 300.0,
    "T3_K": 0.5,
    "P3_Pa": 1500.0,
    "T45_K": 0.8,
    "T5_K": 0.6,
    "P5_Pa": 120.0,
}
"""Stated zero of each sensor from recording to recording: a third of one reading's noise."""
INPUTS = {"altitude_m": 3.0, "mach": 0.0005, "dT_isa_K": 0.1, "Wf_kg_s": 0.0005}
"""Of inputs (of fuel flow a share), which `identify` has to find from the scatter between recordings."""
TRAINING, RECORDS = 6, 80
FAR = 3.0
"""Stated standard deviations from which an answer counts as far from a flip."""


@dataclass(frozen=True)
class Truth:
    """An engine whose maps are not quite the file's, with the health it was delivered with."""

    engine: Engine
    health: Mapping[str, float]
    parameters: Mapping[str, float]


@dataclass(frozen=True)
class Drawn:
    """One recording before anything is put in: inputs, health and the seed of its noise; offsets of its instruments."""

    inputs: Mapping[str, np.ndarray]
    change: Mapping[str, float]
    seed: int
    offsets: Mapping[str, float]


def drawn_truth(engine: Engine, rng: np.random.Generator) -> Truth:
    errors = draw_map_errors(engine, rng)
    health = {n: 1 + 0.003 * rng.standard_normal() for n in engine.monitored}
    return Truth(engine.replace_effects(list(errors.effects)), health, {})


def course(engine: Engine, rng: np.random.Generator) -> dict[str, np.ndarray]:
    """A climb, a cruise and a descent in power."""
    phase = np.linspace(0, 1, RECORDS)
    columns = {
        "altitude_m": rng.uniform(8e3, 11e3) * np.minimum(phase * 1.6, 1.0),
        "mach": 0.3 + rng.uniform(0.4, 0.5) * np.minimum(phase * 1.6, 1.0),
        "dT_isa_K": np.full(RECORDS, rng.uniform(-10, 15)),
    }
    power = 0.95 - rng.uniform(0.25, 0.45) * phase + 0.02 * rng.standard_normal(RECORDS)
    columns[engine.power_setting] = engine.power_from_fraction(power, columns)
    return columns


def recorded(truth: Truth, drawn: Drawn, wrong: Mapping[str, float], health: Mapping[str, float]) -> dict:
    """Columns as recorded; wrong: column → what is added (to fuel flow in proportion); health: parameter → what is
    added to it."""
    rng = np.random.default_rng(drawn.seed)
    values = dict(truth.health)
    for change in (drawn.change, health):
        for name, by in change.items():
            values[name] = values.get(name, 1.0) + by
    p = truth.engine.predict(drawn.inputs, values)
    if not p.ok.all():
        raise RuntimeError(f"not computed: {p.reason(int(np.argmin(p.ok)))}")
    table = dict(drawn.inputs)
    for j, (column, sensor) in enumerate(truth.engine.sensors.items()):
        table[column] = p.y[:, j] + sensor.noise_sigma * rng.standard_normal(RECORDS)
    for offsets in (drawn.offsets, wrong):
        for column, by in offsets.items():
            table[column] = table[column] * (1 + by) if column == "Wf_kg_s" else table[column] + by
    return {**table, "time_s": 10.0 * np.arange(RECORDS)}


def write_flights(path: Path, tables: list[dict]) -> None:
    columns = {c: np.concatenate([t[c] for t in tables]) for c in tables[0]}
    labels = [str(k) for k in range(len(tables)) for _ in range(RECORDS)]
    write_csv(path, [Recording(columns, {"flight": labels})])


def answers(monitor: Monitor, path: Path, tables: list[dict], *, flips: bool = False) -> list:
    """What `isolate` answers of each recording, in order."""
    write_flights(path, tables)
    plan = WindowPlan()
    files = WindowReader(
        RecordingLoader(RecordingSource((str(path),)), required_columns(monitor.engine, monitor.sensors)),
        monitor,
        WindowSettings(plan),
    )
    kept = RecentRecords(monitor, short_windows=False)
    return list(
        WindowIsolation(
            files, DiagnosisOptions(), 0.01, kept_records=kept, wants_sensitivity=lambda number, named: flips
        ).windows()
    )


def named(found, own: str = "") -> frozenset[str] | None:
    """What is named, but for the parameter `own`; None without a verdict."""
    return None if found.diagnosis is None else frozenset(set(found.diagnosis.result.isolated) - {own})


def identified(folder: Path, name: str, truth: Truth, rng: np.random.Generator) -> Monitor:
    """The monitor of an engine identified from recordings with offsets of their own."""
    engine_file = folder / "engine.yaml"
    tables = [
        recorded(truth, Drawn(course(truth.engine, rng), {}, int(rng.integers(1 << 30)), offsets(rng)), {}, {})
        for _ in range(TRAINING)
    ]
    write_flights(folder / f"{name}.csv", tables)
    nominal = folder / f"{name}.yaml"
    code = main(["identify", str(engine_file), str(folder / f"{name}.csv"), "-q", "-o", str(nominal)])
    if code:
        raise RuntimeError(f"identify ended with {code}")
    return build_monitor(open_baseline(str(nominal)), sensors=True)


def offsets(rng: np.random.Generator) -> dict[str, float]:
    return {c: s * rng.standard_normal() for c, s in {**SPREADS, **INPUTS}.items()}


def drawn_change(engine: Engine, rng: np.random.Generator) -> dict[str, float]:
    """None in one of five; else one or both parameters of a turbomachine worn."""
    if rng.uniform() < 0.2:
        return {}
    names = rng.permutation([n for n in engine.monitored if engine.parameters[n].quantity == "efficiency"])
    machine = engine.parameters[str(names[0])].component
    size = float(np.exp(rng.uniform(np.log(0.003), np.log(0.03))))
    change = {f"{machine}.efficiency": -size}
    if rng.uniform() < 0.5:
        change[f"{machine}.flow_capacity"] = -size * rng.uniform(1.0, 2.0)
    return change


def put_in(flip: ConclusionChange, size: float) -> tuple[dict[str, float], dict[str, float]]:
    """What is added to columns and to health for an error of `size`, in the unit of the flip."""
    by = size * flip.error.scale
    return ({}, {flip.name: by}) if flip.kind == "map" else ({flip.error.column: by}, {})


class Tally:
    """Counts of flips by what was put in."""

    def __init__(self) -> None:
        self.flipped: Counter[str] = Counter()
        self.of: Counter[str] = Counter()

    def add(self, what: str, flipped: bool) -> None:
        self.of[what] += 1
        self.flipped[what] += flipped

    def told(self) -> list[str]:
        lines = []
        for what in sorted(self.of):
            k, n = self.flipped[what], self.of[what]
            low, high = wilson(float(k), n)
            lines.append(f"{what:62s} {k:4d} of {n:4d}  {100 * k / n:5.1f} %  ({100 * low:.1f} to {100 * high:.1f})")
        return lines


def of_answer(flips: SensitivityAnalysis) -> tuple[list[ConclusionChange], float]:
    """Flips by single errors, and how many stated standard deviations the nearest is away."""
    errors = [flip for flip in flips.changes if flip.error is not None]
    return errors, min((flip.times for flip in errors), default=float("inf"))


def one_engine(folder: Path, seed: int, recordings: int, tally: Tally) -> None:
    rng = np.random.default_rng(seed)
    engine = load_engine(folder / "engine.yaml")
    truth, other = drawn_truth(engine, rng), drawn_truth(engine, rng)
    other = Truth(other.engine, truth.health, {})
    monitor = identified(folder, f"nominal{seed}", truth, np.random.default_rng(seed + 1000))
    monitor_of_other = identified(folder, f"other{seed}", other, np.random.default_rng(seed + 1000))
    drawn = [
        Drawn(course(engine, rng), drawn_change(engine, rng), int(rng.integers(1 << 30)), {}) for _ in range(recordings)
    ]
    plain = answers(monitor, folder / "plain.csv", [recorded(truth, d, {}, {}) for d in drawn], flips=True)
    others = answers(monitor_of_other, folder / "others.csv", [recorded(other, d, {}, {}) for d in drawn])
    cases: list[tuple[str, int, str, dict]] = []
    for k, (d, found) in enumerate(zip(drawn, plain, strict=True)):
        if found.diagnosis is None or found.sensitivity is None:
            continue
        errors, nearest = of_answer(found.sensitivity)
        group = f"beyond {FAR:g} stated" if nearest > FAR else f"within {FAR:g} stated"
        if named(others[k]) is not None:
            tally.add(f"inside, other maps of the stated accuracy, {group}", named(others[k]) != named(found))
        instruments = [flip for flip in errors if flip.kind != "map"]
        for flip in instruments[:1]:
            wrong, health = put_in(flip, float(np.sign(flip.size)) * flip.stated)
            cases.append(
                (f"inside, nearest instrument by 1 stated, {group}", k, flip.name, recorded(truth, d, wrong, health))
            )
        for flip in [f for f in errors if f.kind == "map"][:1]:
            wrong, health = put_in(flip, float(np.sign(flip.size)) * flip.stated)
            cases.append((f"inside, nearest map by 1 left open, {group}", k, "", recorded(truth, d, wrong, health)))
        signs = {c: float(s) for c, s in zip((*SPREADS, *INPUTS), rng.choice([-1.0, 1.0], 13), strict=True)}
        wrong = {c: signs[c] * s for c, s in {**SPREADS, **INPUTS}.items()}
        cases.append((f"inside, all instruments at once by 1 stated, {group}", k, "", recorded(truth, d, wrong, {})))
        for kind in ("map", "sensor", "input"):
            for flip in [f for f in errors if f.kind == kind][:1]:
                for share in (0.9, 1.1):
                    wrong, health = put_in(flip, share * flip.size)
                    own = flip.name if kind != "map" else ""
                    cases.append(
                        (f"{kind} at {share:g} of the size computed", k, own, recorded(truth, d, wrong, health))
                    )
    found = answers(monitor, folder / "cases.csv", [case[3] for case in cases])
    for (what, k, own, _), now in zip(cases, found, strict=True):
        if named(now) is not None:
            tally.add(what, named(now, own) != named(plain[k], own))
    for found in plain:
        if found.sensitivity is not None:
            tally.add(f"answers (how many are beyond {FAR:g} stated)", of_answer(found.sensitivity)[1] > FAR)


def run(engines: int, recordings: int, seed: int) -> Tally:
    tally = Tally()
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        block = "".join(f"    {c}: {s:g}\n" for c, s in SPREADS.items())
        text = Path(shipped("turbofan.yaml")).read_text(encoding="utf-8")
        stated = f"{text}\nidentification:\n  recording_bias_sigma:\n{block}"
        (folder / "engine.yaml").write_text(stated, encoding="utf-8")
        for k in range(engines):
            one_engine(folder, seed + k, recordings, tally)
            print(f"engine {k + 1} of {engines}", *tally.told(), sep="\n", file=sys.stderr)
    return tally


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--engines", type=int, default=4)
    parser.add_argument("--recordings", type=int, default=30)
    parser.add_argument("--seed", type=int, default=1)
    given = parser.parse_args()
    print("\n".join(run(given.engines, given.recordings, given.seed).told()))
