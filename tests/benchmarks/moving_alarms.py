"""False alarms of `detect` in transients, as users run it: python tests/benchmarks/moving_alarms.py [--nominals N]

Healthy engines that are never left in peace: steps, ramps, slams and staircases of power, once a second, as in blind
trials of kind dynamic; readings with noise, cut to steps of half of it. The truth remembers: metal takes up heat,
probes lag. Each row is an engine and what its file knows of that: all of it ("known"), nothing ("lacking"), or there is
nothing to know ("none"). A nominal is identified from eight flights and judges ten others in windows of a minute,
every record of them, by default options. Printed: windows, alarms in % at nominal 5 and 1 % with 95 % intervals from
the scatter between nominals or binomial, whichever is wider; and how many of the same windows alarm when compressors
have lost 2 % of efficiency.
"""

from __future__ import annotations

import argparse
import csv
import sys
import tempfile
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path

import numpy as np
import yaml

sys.path.insert(0, str(Path(__file__).parent))

from end_to_end import ROOT, run
from false_alarms import Tally, realised

from enginediag_cli.engine.engine import Engine
from enginediag_cli.engine.recall import MOMENT
from enginediag_cli.physics.engine_file import load_engine
from enginediag_cli.physics.registry import effect
from enginediag_cli.recordings.table import Recording
from enginediag_cli.recordings.write import CsvWriter, open_output
from enginediag_cli.validation.trial_flights import draw_moving_flights

Terms = Sequence[tuple[str, str, Mapping[str, float]]]
RATES = (0.05, 0.01)
TRAINING, JUDGED, WINDOW = 8, 10, 60
QUANTUM = 0.5
"""Step of a digital reading, in standard deviations of its noise."""
HEALTH = 0.005
"""Scatter of health parameters between engines of one type."""
ENGINES: Mapping[str, Terms] = {
    "turbofan": (
        ("heat_soak", "hpc", {"exchange": 0.02, "time_constant": 40.0}),
        ("heat_soak", "hpt", {"exchange": 0.03, "time_constant": 60.0}),
        ("probe_lag", "T45", {"time_constant": 3.0}),
    ),
    "turboshaft": (
        ("heat_soak", "compressor", {"exchange": 0.02, "time_constant": 30.0}),
        ("heat_soak", "gas_generator_turbine", {"exchange": 0.03, "time_constant": 45.0}),
        ("probe_lag", "T45", {"time_constant": 2.5}),
    ),
    "recuperated_micro_gas_turbine": (
        ("heat_soak", "turbine", {"exchange": 0.03, "time_constant": 45.0}),
        ("probe_lag", "T6", {"time_constant": 5.0}),
    ),
}
KNOWLEDGE = ("none", "known", "lacking")
WORN: Mapping[str, str] = {
    "turbofan": "hpc.efficiency",
    "turboshaft": "compressor.efficiency",
    "recuperated_micro_gas_turbine": "compressor.efficiency",
}
"""What is then lost of, to show what the test still sees."""
LOSS = 0.02


def nominal_judges(folder: Path, name: str, knows: str, seed: int, *, worn: bool = True) -> list[np.ndarray]:
    """p-values of the windows (n,) that one identified nominal judges: of the healthy engine, and of the worn one."""
    rng = np.random.default_rng([seed, *name.encode(), KNOWLEDGE.index(knows)])
    file = ROOT / "configs" / f"{name}.yaml"
    plain = load_engine(file)
    effects = [effect(plain, *label, values) for *label, values in ENGINES[name]] if knows != "none" else []
    truth = plain.replace_effects(effects)
    described = yaml.safe_load(file.read_text(encoding="utf-8"))
    if knows == "known":
        described["physics"] = [{"term": t, "at": at, "coefficients": dict(c)} for t, at, c in ENGINES[name]]
    model, nominal = folder / "engine.yaml", folder / "nominal.yaml"
    model.write_text(yaml.safe_dump(described, sort_keys=False), encoding="utf-8")
    health = {p: 1.0 + HEALTH * rng.standard_normal() for p in truth.monitored}
    flights: list[dict[str, np.ndarray]] = []
    while len(flights) < TRAINING + JUDGED:
        flights += draw_moving_flights(plain, rng)[0]
    states = [health, {**health, WORN[name]: health[WORN[name]] - LOSS}][: 1 + worn]
    training = written(folder / "training", truth, flights[:TRAINING], health, rng)
    run("identify", model, *training, "--no-cross-validation", "-o", nominal)
    found = []
    for k, state in enumerate(states):
        files = written(folder / f"judged_{k}", truth, flights[TRAINING : TRAINING + JUDGED], state, rng)
        rows = folder / "rows.csv"
        run("detect", "-n", nominal, *files, "--window", WINDOW, "-o", rows, accepted=(0, 3))
        with open(rows, encoding="utf-8", newline="") as stream:
            read = list(csv.DictReader(line for line in stream if not line.startswith("#")))
        found.append(np.array([float(row["p_value"] or "nan") for row in read]))
    return found


def written(
    folder: Path,
    truth: Engine,
    flights: Sequence[Mapping[str, np.ndarray]],
    health: Mapping[str, float],
    rng: np.random.Generator,
) -> list[Path]:
    """The files of these flights."""
    folder.mkdir()
    files = [folder / f"flight_{k + 1}.csv" for k in range(len(flights))]
    for file, flight in zip(files, flights, strict=True):
        with open_output(file) as stream:
            CsvWriter(stream).write(Recording(recorded(truth, flight, health, rng)))
    return files


def recorded(
    truth: Engine, flight: Mapping[str, np.ndarray], health: Mapping[str, float], rng: np.random.Generator
) -> dict[str, np.ndarray]:
    """Columns (N,) of a flight as they are recorded."""
    inputs = {c: flight[c] for c in truth.inputs}
    p = truth.predict({**inputs, MOMENT: truth.tapes.add({"time_s": flight["time_s"], **inputs})}, dict(health))
    sigma = np.array([s.noise_sigma for s in truth.sensors.values()])
    step = QUANTUM * sigma
    y = step * np.round((p.y + sigma * rng.standard_normal(p.y.shape)) / step)
    good = p.ok
    return {
        c: v[good]
        for c, v in {"time_s": flight["time_s"], **inputs, **dict(zip(truth.sensors, y.T, strict=True))}.items()
    }


def table(options: argparse.Namespace) -> Iterator[str]:
    """Lines of the table, as soon as they are known."""
    yield "| engine, memory | windows | at 5 % | at 1 % | worn, at 1 % |\n|---|---|---|---|---|"
    for name in ENGINES:
        for knows in KNOWLEDGE:
            if options.only not in f"{name}, {knows}":
                continue
            tally, seen = Tally(), []
            for k in range(options.nominals):
                with tempfile.TemporaryDirectory() as folder:
                    healthy, worn = nominal_judges(Path(folder), name, knows, options.seed + k)
                judged = healthy[np.isfinite(healthy)]
                tally.alarms.append(np.array([int(np.sum(judged < rate)) for rate in RATES]))
                tally.judged.append(len(judged))
                tally.refused += len(healthy) - len(judged)
                seen += (worn[np.isfinite(worn)] < RATES[1]).tolist()
            cells = [f"{100 * k:.1f} ({100 * low:.1f}–{100 * high:.1f})" for k, low, high in realised(tally, True)]
            refused = f" and {tally.refused} without verdict" if tally.refused else ""
            told = [f"{name}, {knows}", f"{sum(tally.judged)}{refused}", *cells, f"{100 * np.mean(seen):.0f}"]
            yield f"| {' | '.join(told)} |"


def main(arguments: list[str] | None = None) -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--nominals", type=int, default=10, help="identified nominals per row")
    parser.add_argument("--seed", type=int, default=4001)
    parser.add_argument("--only", default="", help="rows whose name contains this text")
    for line in table(parser.parse_args(arguments)):
        print(line, flush=True)


if __name__ == "__main__":
    sys.exit(main())
