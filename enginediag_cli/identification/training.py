"""Training recordings out of recording tables: one per engine and flight, in the order of the file.

Recordings given twice: records that an earlier recording holds already would be counted twice as evidence.

The same flight may come under two names, with its clock set differently, or inside a longer file: records are
compared by what the engine is compared with, inputs and readings, not by file or time.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

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


FEWEST = 5
"""Records that must be repeated before it is more than chance: coarse readings at a standstill agree now and then."""
SHARE = 0.5
"""Share of the records of the shorter of two recordings that must stand in both: flights do not share half."""


@dataclass(frozen=True)
class Repeat:
    """`records` of the recording `label` stand in the earlier recording `of`, too; `whole`: all of them do."""

    label: str
    of: str
    records: int
    whole: bool


def without_repeats(
    recordings: Sequence[TrainingRecording], columns: Sequence[str]
) -> tuple[list[TrainingRecording], tuple[Repeat, ...]]:
    """The recordings with every record once, in their order, and what was left out; a recording of which nothing is
    left is left out whole. columns: inputs and sensors of the engine, by which records are compared.

    Records that repeat within one recording are no matter of this function.
    """
    kept: list[TrainingRecording] = []
    found: list[Repeat] = []
    seen: list[tuple[str, frozenset[bytes]]] = []
    for recording in recordings:
        keys = _record_keys(recording, columns)
        own = frozenset(key for key in keys if key)
        again = np.zeros(len(keys), bool)
        for label, theirs in seen:
            common = own & theirs
            shorter = min(len(own), len(theirs))
            if not common or len(common) < min(FEWEST, shorter) or len(common) < SHARE * shorter:
                continue
            here = np.array([key in common for key in keys]) & ~again
            again |= here
            if here.any():
                found.append(Repeat(recording.label, label, int(here.sum()), bool(here.all())))
        seen.append((recording.label, own))
        if not again.any():
            kept.append(recording)
        elif not again.all():
            kept.append(_rows(recording, ~again))
    return kept, tuple(found)


def _record_keys(recording: TrainingRecording, columns: Sequence[str]) -> list[bytes]:
    """One key per record, empty where it has no number at all; -0.0 is 0.0, and a missing value is one."""
    n = len(next(iter(recording.columns.values()))) if recording.columns else 0
    table = np.column_stack(
        [np.asarray(recording.columns.get(c, np.full(n, np.nan)), float) for c in columns] or [np.zeros((n, 0))]
    )
    table = np.where(np.isfinite(table), table + 0.0, np.nan)
    something = np.isfinite(table).any(axis=1)
    return [row.tobytes() if there else b"" for row, there in zip(table, something, strict=True)]


def _rows(recording: TrainingRecording, rows: np.ndarray) -> TrainingRecording:
    regimes = None if recording.regimes is None else recording.regimes[rows]
    return recording._replace(columns={c: v[rows] for c, v in recording.columns.items()}, regimes=regimes)
