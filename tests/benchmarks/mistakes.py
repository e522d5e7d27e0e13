"""Wrong files that are named right: python tests/benchmarks/mistakes.py [--seed N] [--identified] [--public]

Recordings of shipped engines with single mistakes of the people who export them (`tests/intake/made_mistakes.py`):
per kind how many were made, named right, given another name, refused without a name and passed, with the 95 % interval
of the right share; and how many recordings without a mistake, of engines drawn from their priors and of engines with a
component fault of 8 %, an instrument fault of five of its prior standard deviations, or all modules worn by 3 %, were
refused. Where several mistakes would mend a recording, the answer is right if the true one is among those listed. Of a
mistake that moves no reading against the model by VISIBLE tolerances silence and "cannot tell which" are right as well,
and only another name is wrong. Lines appear as recordings are judged, so that a run may be stopped.

--public: the same mistakes put into public recordings (`ENGINEDIAG_SHARED`, or `../shared` beside the checkout), one of
each kind of machine and regime, and how many of all pairs of recording and engine that are right were refused.
"""

from __future__ import annotations

import argparse
import csv
import os
import sys
import tempfile
from collections import Counter
from collections.abc import Iterator
from pathlib import Path

import numpy as np
from scipy.stats import beta

sys.path.insert(0, str(Path(__file__).parents[1] / "intake"))

from made_mistakes import KINDS, Columns, Made, mistaken, recording

from enginediag_cli.__main__ import main as program
from enginediag_cli.engine.engine import Engine
from enginediag_cli.intake.agreement import NEAR, NEAR_GENERIC, AgreementCheck, RecordingMismatch, check_against_engine
from enginediag_cli.intake.comparison import engine_reference, nominal_reference
from enginediag_cli.intake.loader import RecordingLoader
from enginediag_cli.intake.mistakes import Mistake
from enginediag_cli.intake.selection import RecordingSource, required_columns
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
VISIBLE = 3.0
"""Deviations up to which nothing is looked at more closely (NEAR, NEAR_GENERIC) by which a mistake must move the median
of a sensor against the model: less is within what engines and maps differ by, and no judge of files can see it."""


PUBLIC = (
    ("power_plant", "uci_gas_turbine", "uci_gas_turbine/gt_2011.csv", True),
    ("power_plant", "uci_gas_turbine", "uci_gas_turbine/gt_2012.csv", False),
    ("power_plant", "uci_gas_turbine_base_load", "uci_gas_turbine/gt_2011.csv", False),
    ("power_plant", "uci_gas_turbine_base_load", "uci_gas_turbine/gt_2012.csv", True),
    ("citation_jt15d", "citation_jt15d", "c550_jt15d/flight_ref.csv", True),
    ("citation_jt15d", "citation_jt15d", "c550_jt15d/flight_b22.csv", True),
    ("amt_olympus", "amt_olympus", "amt_olympus/bench.csv", True),
    ("naval_gas_generator", "naval_gas_turbine", "naval_gas_turbine/states.csv", True),
    ("cmapss_turbofan", "cmapss", "cmapss/train_FD001.csv.gz", True),
    ("cmapss_turbofan", "cmapss", "cmapss/train_FD002.csv.gz", False),
    *(
        ("micro_gas_turbine", "micro_gas_turbine", f"micro_gas_turbine/ex_{k}.csv", k == 1)
        for k in (1, 9, 20, 21, 23, 24)
    ),
)
"""Engine, recorder and file of public recordings, and whether mistakes are put into the first engine of each."""


def effect(agreement: AgreementCheck, right: Columns, wrong: Columns) -> float:
    """By how much a mistake moves a sensor against the model, relative, in the median of the records; the largest."""
    before, after = (agreement.yardstick.deviations(c)[0] for c in (right, wrong))
    return float(np.nanmax(np.nanmedian(np.abs(after - before), axis=0)))


def fits(made: Made, name: Mistake | None, others: tuple[str, ...]) -> bool:
    """Whether the answer is the mistake that was made, or lists it among those that would mend the recording."""
    if name is None:
        return any(made.column in text and any(word in text for word in made.words) for text in others)
    return any(word in name.words for word in made.words) and made.column in ("", name.column)


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


class Tally:
    """What became of mistakes, by kind, and of sound recordings."""

    def __init__(self, show: bool):
        self.show, self.sound, self.refused = show, 0, 0
        self.made, self.right, self.other, self.unnamed, self.small, self.silent = (Counter[str]() for _ in range(6))

    def add_sound(self, found: list[RecordingMismatch]) -> None:
        self.sound += 1
        if found:
            self.refused += 1
            print(f"refused: {found[0]}", flush=True)

    def add(self, name: str, wrong: Made, visible: bool, found: list[RecordingMismatch]) -> None:
        given = found[0].trial.mistake if found and found[0].trial else None
        same = bool(found) and fits(wrong, given, found[0].others)
        kind = wrong.kind
        self.made[kind] += 1
        self.small[kind] += not visible
        self.right[kind] += same
        self.other[kind] += given is not None and not same
        self.unnamed[kind] += visible and bool(found) and given is None and not same
        self.silent[kind] += not visible and given is None and not same
        if self.show and not same:
            print(f"{name} {kind} {wrong.column}: {found[0] if found else 'passed'}", flush=True)

    @property
    def good(self) -> int:
        return self.right.total() + self.silent.total()

    def print_table(self) -> None:
        print("\n| mistake | made | of them small | named right | small, not named | another name | no name | passed |")
        print("|---|---|---|---|---|---|---|---|")
        for kind in [k for k in KINDS if self.made[k]]:
            counts = (self.right[kind], self.silent[kind], self.other[kind], self.unnamed[kind])
            row = (self.made[kind], self.small[kind], *counts, self.made[kind] - sum(counts))
            print(f"| {kind} | {' | '.join(map(str, row))} |")
        n, k = self.made.total(), self.good
        low = beta.ppf(0.025, k, n - k + 1) if k else 0.0
        high = beta.ppf(0.975, k + 1, n - k) if k < n else 1.0
        wrong_ones = (self.other.total(), self.unnamed.total(), n - k - self.other.total() - self.unnamed.total())
        row = (n, self.small.total(), self.right.total(), self.silent.total(), *wrong_ones)
        print(f"| all | {' | '.join(map(str, row))} |")
        print(f"\nright: {100 * k / max(n, 1):.1f} % ({100 * low:.1f}–{100 * high:.1f})")
        print(f"sound recordings refused: {self.refused} of {self.sound}")


class Kept:
    """Stands in an agreement's place and keeps the first recording of each engine."""

    def __init__(self) -> None:
        self.recordings: dict[str, Recording] = {}

    def disagreements(self, recording: Recording, engine: str = "", *_: object) -> list[RecordingMismatch]:
        self.recordings.setdefault(engine, recording)
        return []


def public(tally: Tally, seed: int, engines: list[str]) -> None:
    """Public recordings as their recorders map them, sound and with mistakes."""
    data = Path(os.environ.get("ENGINEDIAG_SHARED") or Path(__file__).resolve().parents[3] / "shared") / "data"
    for number, (name, recorder, file, spoilt) in enumerate(PUBLIC):
        if name not in engines:
            continue
        engine, kept = load_engine(shipped(f"{name}.yaml")), Kept()
        source = RecordingSource((str(data / file),), str(shipped(f"recorders/{recorder}.yaml")))
        for _ in RecordingLoader(source, required_columns(engine, past=True), fleet=True, agreement=kept).chunks():  # type: ignore[arg-type]
            pass
        agreement = check_against_engine(engine)
        assert agreement is not None
        for read in kept.recordings.values():
            tally.add_sound(agreement.find_mismatches(read))
        if not spoilt:
            continue
        known = {*engine.inputs, *engine.optional_inputs, *engine.sensors}
        first = next(iter(kept.recordings.values()))
        columns = {c: np.asarray(v, float) for c, v in first.columns.items() if c in known}
        rng = np.random.default_rng([seed, number])
        for kind in KINDS:
            wrong = mistaken(columns, engine, kind, rng)
            if wrong is not None:
                visible = effect(agreement, columns, wrong.columns) >= VISIBLE * NEAR_GENERIC
                tally.add(file, wrong, visible, agreement.find_mismatches(Recording(wrong.columns, source=file)))
        print(f"{file}: {tally.good} of {tally.made.total()} right", flush=True)


def simulated(tally: Tally, seed: int, engines: list[str], repeats: int, identified: bool) -> None:
    """Recordings that `simulate` flies, sound and with mistakes."""
    with tempfile.TemporaryDirectory() as folder:
        for name in engines:
            engine = load_engine(shipped(f"{name}.yaml"))
            noise = np.array([s.noise_sigma or 0.0 for s in engine.sensors.values()])
            nominal = nominal_reference(engine, {}, tuple(engine.sensors), noise)
            agreement = AgreementCheck(nominal if identified else engine_reference(engine), engine)
            least = VISIBLE * (NEAR if identified else NEAR_GENERIC)
            for repeat in range(repeats):
                rng = np.random.default_rng([seed, repeat, len(name)])
                inputs = flown(name, ENGINES[name], engine, seed + 100 * repeat, Path(folder))
                healthy = [recording(engine, inputs, rng, identified=identified)]
                for columns in healthy + (list(faulty(engine, inputs, rng)) if identified else []):
                    tally.add_sound(agreement.find_mismatches(Recording(columns, source=name)))
                for kind in KINDS:
                    columns = recording(engine, inputs, rng, identified=identified)
                    wrong = mistaken(columns, engine, kind, rng)
                    if wrong is not None:
                        visible = effect(agreement, columns, wrong.columns) >= least
                        tally.add(
                            name, wrong, visible, agreement.find_mismatches(Recording(wrong.columns, source=name))
                        )
                print(f"{name}, recording {repeat + 1}: {tally.good} of {tally.made.total()} right", flush=True)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--repeats", type=int, default=2, help="recordings per engine")
    parser.add_argument("--identified", action="store_true", help="against the engine itself, as an identified one")
    parser.add_argument("--public", action="store_true", help="public recordings")
    parser.add_argument("--engines", help="only these, separated by commas")
    parser.add_argument("--all", action="store_true", help="show every recording that was not named right")
    asked = parser.parse_args()
    tally = Tally(asked.all)
    if asked.public:
        public(tally, asked.seed, asked.engines.split(",") if asked.engines else [name for name, *_ in PUBLIC])
    else:
        engines = asked.engines.split(",") if asked.engines else list(ENGINES)
        simulated(tally, asked.seed, engines, asked.repeats, asked.identified)
    tally.print_table()


if __name__ == "__main__":
    main()
