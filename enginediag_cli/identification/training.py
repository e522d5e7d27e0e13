"""Training recordings out of recording tables: one per engine and flight, in the order of the file."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from enginediag_cli.errors import DataError
from enginediag_cli.identification.problem import TrainingRecording
from enginediag_cli.recordings.table import Recording

SNAPSHOTS = 2.0
"""Fewer records per flight than this on average: the flights of one engine are one recording of snapshots."""


def training_recordings(recording: Recording, label: str, *, engine: str = "") -> list[TrainingRecording]:
    """Split by the text columns `engine` and `flight`; `engine` keeps only that instance.

    A `phase` column becomes the regime of each record. Raises DataError for an engine that is not there.
    """
    engines = recording.text.get("engine")
    if engine and engines is not None:
        if engine not in engines:
            known = ", ".join(dict.fromkeys(engines))
            raise DataError(f"{recording.source}: no record of engine {engine!r}; it has {known}")
        recording = recording.select(np.asarray(engines) == engine)
    keys = _keys(recording)
    found = []
    for key in dict.fromkeys(keys):
        part = recording.select(np.array([k == key for k in keys], bool)) if len(set(keys)) > 1 else recording
        regimes = np.asarray(part.text["phase"]) if "phase" in part.text else None
        name = " ".join([label, *(f"{what} {k}" for what, k in zip(("engine", "flight"), key, strict=False) if k)])
        found.append(TrainingRecording(name, dict(part.columns), regimes))
    return found


def _keys(recording: Recording) -> list[tuple[str, ...]]:
    n = len(recording)
    engines, flights = (list(recording.text.get(c, [""] * n)) for c in ("engine", "flight"))
    by_flight: list[tuple[str, ...]] = list(zip(engines, flights, strict=True))
    if n < SNAPSHOTS * len(set(by_flight)):
        return [(e,) for e in engines]
    return by_flight


def first_records(recordings: Sequence[TrainingRecording], n: int) -> list[TrainingRecording]:
    """At most the first n records of each recording: early life of each engine."""
    return [part_of(r, slice(0, n)) for r in recordings]


def hold_out_end(
    recordings: Sequence[TrainingRecording], fraction: float
) -> tuple[list[TrainingRecording], list[TrainingRecording]]:
    """The first part of each recording for training, and the last `fraction` of its records to judge by."""
    train, test = [], []
    for r in recordings:
        n = len(next(iter(r.columns.values())))
        cut = n - round(fraction * n)
        if cut > 0:
            train.append(part_of(r, slice(0, cut)))
        if cut < n:
            test.append(part_of(r, slice(cut, n)))
    return train, test


def part_of(r: TrainingRecording, rows: slice | np.ndarray) -> TrainingRecording:
    """Some of the records."""
    regimes = None if r.regimes is None else r.regimes[rows]
    return r._replace(columns={c: v[rows] for c, v in r.columns.items()}, regimes=regimes)
