"""A trial's recordings: the healthy flights and the one to be judged, as files."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from enginediag_cli.engine.engine import Engine
from enginediag_cli.recordings.table import Recording
from enginediag_cli.recordings.write import CsvWriter, output
from enginediag_cli.validation.blind.flights import stack
from enginediag_cli.validation.blind.recorded import copy_engine
from enginediag_cli.validation.blind.truths.realistic import noisy, realistic_engine
from enginediag_cli.validation.isolated.sealed import Sealed, reading


@dataclass(frozen=True)
class Files:
    """The open folder: engine file, healthy recordings, the one to be judged; `failed`: records that the truth engine
    could not compute."""

    engine: Path
    healthy: tuple[Path, ...]
    judged: Path
    failed: int


def record(engine: Engine, sealed: Sealed, folder: Path) -> Files:
    """Fly the trial and write what is recorded into the open folder."""
    rng = np.random.default_rng(sealed.noise_seed)
    truth = true_engine(engine, sealed)
    drawn = sealed.realistic
    sensors = drawn.sensors if drawn else tuple(engine.sensors)
    paths, failed, last = [], 0, len(sealed.flights) - 1
    for k in range(len(sealed.flights)):
        if k == last:  # trials of one engine share its healthy recordings, not what is judged
            rng = np.random.default_rng((sealed.noise_seed, sealed.trial))
        columns = _true_columns(truth, sealed, k)
        good = np.isfinite(np.stack([columns[c] for c in sensors])).all(axis=0)
        if drawn:
            columns = drawn.read(k, columns)
        columns = _wrong(sealed, columns) if k == last else columns
        columns, good = {c: v[:: sealed.every] for c, v in columns.items()}, good[:: sealed.every]
        failed += int((~good).sum())
        columns = drawn.write(engine, columns, rng) if drawn else noisy(engine, 0.0, columns, rng)
        path = folder / (f"judged_{sealed.trial}.csv" if k == last else f"healthy_{k + 1}.csv")
        with output(path) as stream:
            kept = {c: columns[c][good] for c in ("time_s", *engine.inputs, *sensors)}
            CsvWriter(stream).write(Recording(kept))
        paths.append(path)
    return Files(copy_engine(folder, engine), tuple(paths[:-1]), paths[-1], failed)


def true_engine(engine: Engine, sealed: Sealed) -> Engine:
    """The truth: the model itself, or its realistic relative, whose tables are read back and gone."""
    if sealed.realistic is None:
        return engine
    return realistic_engine(engine, sealed.realistic, stack(sealed.flights[:-1]))


def _true_columns(truth: Engine, sealed: Sealed, k: int) -> dict[str, np.ndarray]:
    """Time, inputs and true outputs (N,) of flight k, the last one changed."""
    flight, theta = sealed.flights[k], dict(sealed.health)
    if k == len(sealed.flights) - 1:
        truth = truth.with_effects((*truth.effects, *sealed.effects))
        theta |= sealed.values
        for c in sealed.changes:
            if c.place in truth.parameters:
                theta[c.place] = theta.get(c.place, truth.parameters[c.place].nominal) + c.size
    p = truth.predict({c: flight[c] for c in (*truth.inputs, *truth.optional_inputs) if c in flight}, theta)
    y = np.where(p.ok[:, None], p.y, np.nan)
    given = {c: flight[c] for c in ("time_s", *truth.inputs)}
    return {**given, **dict(zip(p.columns, y.T, strict=True))}


def _wrong(sealed: Sealed, columns: dict[str, np.ndarray]) -> dict[str, np.ndarray]:
    """Columns (N,) with the errors of instruments that the trial conceals."""
    by_place = {reading(c): c for c in columns}
    found = dict(columns)
    for change in sealed.changes:
        column = by_place.get(change.place)
        if column:
            found[column] = columns[column] * (1.0 + change.size) if change.share else columns[column] + change.size
    return found
