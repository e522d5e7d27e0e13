"""False alarms of the commands as users run them: simulate, identify, detect, with the nonlinear engine."""

from __future__ import annotations

import csv
import tempfile
from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np

from enginediag_cli.__main__ import main

ROOT = Path(__file__).resolve().parents[2]
ENGINE = ROOT / "configs" / "turbofan.yaml"
RECORDS, LENGTH, FLIGHTS = 1000, 30, 15
NOISES = {"gaussian": "gaussian", "uniform": "uniform, 1 % of the largest reading wide", "correlated": "AR(1) ρ = 0.8"}


def end_to_end(
    seed: int, windows: int, rates: Sequence[float], noises: Sequence[str] = tuple(NOISES)
) -> Iterator[tuple[str, tuple[np.ndarray, np.ndarray]]]:
    """Name of each row, its alarms (n, rates) and judged windows (n,) per identified nominal.

    A nominal is identified from the first records that are flown; it judges later flights in windows of all phases.
    """
    for noise in noises:
        alarms: list[list[int]] = []
        judged: list[int] = []
        with tempfile.TemporaryDirectory() as folder:
            while sum(judged) < windows:
                p = p_values(Path(folder), noise, 1000 * seed + 2 * len(judged))
                alarms.append([int(np.sum(p < rate)) for rate in rates])
                judged.append(len(p))
        name = f"commands: {NOISES[noise]}, identified from {RECORDS} records, all phases"
        yield name, (np.array(alarms), np.array(judged))


def p_values(folder: Path, noise: str, seed: int) -> np.ndarray:
    """p-values of the windows that one identified nominal judges."""
    healthy, nominal, later, judged = (folder / n for n in ("healthy.csv", "nominal.yaml", "later.csv", "judged.csv"))
    run("simulate", ENGINE, "--noise", noise, "--flights", 3, "--records", RECORDS, "--seed", seed, "-o", healthy)
    run("identify", ENGINE, healthy, "--no-cross-validation", "-o", nominal)
    run("simulate", ENGINE, "--noise", noise, "--flights", FLIGHTS, "--seed", seed + 1, "-o", later)
    run("detect", "-n", nominal, later, "--window", LENGTH, "-o", judged)
    with open(judged, encoding="utf-8", newline="") as stream:
        rows = list(csv.DictReader(line for line in stream if not line.startswith("#")))
    return np.array([float(row["p_value"]) for row in rows if row["p_value"]])


def run(*arguments: object, accepted: Sequence[int] = (0,)) -> None:
    """A command, which must end with one of these codes."""
    code = main([*map(str, arguments), "-q"])
    if code not in accepted:
        raise RuntimeError(f"enginediag {' '.join(map(str, arguments))} ended with {code}")
