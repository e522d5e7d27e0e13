"""Which records can be judged: they have inputs and a reading, and lie where identification has been.

Beyond that a model whose error begins to grow there still answers, with limits as wide as it says, up to a distance
at which it is not known any more (`Envelope.within_reach`).
"""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from enginediag_cli.error_model.modelled import MapErrorModel
from enginediag_cli.errors import DataError
from enginediag_cli.recordings.table import Recording
from enginediag_cli.residuals.monitor import Monitor


def check_inputs(monitor: Monitor, recording: Recording) -> None:
    """DataError unless the recording has every input column and at least one sensor of the monitor."""
    missing = [c for c in monitor.engine.inputs if c not in recording.columns]
    if missing:
        from difflib import get_close_matches

        near = {c: get_close_matches(c, recording.order, n=1) for c in missing}
        words = [c + (f" (did you mean {near[c][0]!r}?)" if near[c] else "") for c in missing]
        raise DataError(f"{recording.source}: no column {', '.join(words)}, which {monitor.engine.name} needs")
    if not any(c in recording.columns for c in monitor.sensors):
        raise DataError(f"{recording.source}: none of the sensors {', '.join(monitor.sensors)}")


class Elsewhere(NamedTuple):
    """Where records lie that training did not cover: the input that is farthest beyond its range, "" where it is their
    combination, and whether they are judged all the same."""

    column: str
    judged: bool


@dataclass(frozen=True)
class JudgedInputs:
    """Inputs (N,) by column, measurements y (N, m), masks (N,): incomplete, outside (too far to be judged), and beyond:
    not covered by training, judged or not. columns: of `beyond_by`, (N,), −1 for a combination."""

    inputs: dict[str, np.ndarray]
    y: np.ndarray
    incomplete: np.ndarray
    outside: np.ndarray
    beyond: np.ndarray
    beyond_by: np.ndarray
    columns: tuple[str, ...]

    @property
    def judged(self) -> np.ndarray:
        """Which records can be judged, (N,)."""
        return ~self.incomplete & ~self.outside

    def of(self, rows: np.ndarray) -> JudgedInputs:
        """Some of the records."""
        inputs = {c: v[rows] for c, v in self.inputs.items()}
        y, incomplete, outside = self.y[rows], self.incomplete[rows], self.outside[rows]
        return JudgedInputs(inputs, y, incomplete, outside, self.beyond[rows], self.beyond_by[rows], self.columns)

    def elsewhere(self, rows: slice | np.ndarray) -> Counter[Elsewhere]:
        """Of some records: how many lie where."""
        found: Counter[Elsewhere] = Counter()
        if not self.beyond[rows].any():
            return found
        for judged in (True, False):
            here = self.beyond[rows] & (self.outside[rows] != judged)
            for j, n in zip(*np.unique(self.beyond_by[rows][here], return_counts=True), strict=True):
                found[Elsewhere(self.columns[j] if j >= 0 else "", judged)] += int(n)
        return found


def judged_inputs(monitor: Monitor, recording: Recording, *, widening: bool = True) -> JudgedInputs:
    """What can be judged of a recording. widening: whether limits become as wide as the error of the model is beyond
    what training covered, where that is known."""
    engine, N = monitor.engine, len(recording)
    inputs = {c: recording.columns[c] for c in engine.inputs}
    for column, default in engine.optional_inputs.items():
        values = recording.columns.get(column, np.full(N, default))
        inputs[column] = np.where(np.isfinite(values), values, default)
    y = np.column_stack([recording.columns.get(c, np.full(N, np.nan)) for c in monitor.sensors])
    y = np.where(np.isfinite(y), y, np.nan)
    complete = np.all([np.isfinite(inputs[c]) for c in engine.inputs], axis=0) & np.isfinite(y).any(axis=1)
    outside, beyond, by, columns = np.zeros(N, bool), np.zeros(N, bool), np.full(N, -1), tuple[str, ...]()
    envelope = monitor.envelope
    if envelope is not None and N:
        columns = envelope.inputs
        distance = np.asarray(envelope.distance(inputs))
        beyond = complete & ~(distance <= envelope.threshold)
        outside = beyond
        if beyond.any():
            if widening and isinstance(monitor.engine, MapErrorModel):
                outside = complete & ~envelope.within_reach(inputs, distance)
            by[beyond] = envelope.farthest_input({c: inputs[c][beyond] for c in columns})
    for control, unclear in getattr(engine, "undecided", lambda _: {})(inputs).items():
        columns = (*columns, f"whether {control} acts")
        by[complete & unclear] = len(columns) - 1
        outside, beyond = outside | complete & unclear, beyond | complete & unclear
    return JudgedInputs(inputs, y, ~complete, outside, beyond, by, columns)


@dataclass(frozen=True)
class JudgedChunk:
    """Records of a chunk: what is judged of them and, at nominal, residuals e (N, m), J (N, m, p) and failed (N,)."""

    taken: JudgedInputs
    failed: np.ndarray
    e: np.ndarray | None = None
    J: np.ndarray | None = None

    def of(self, rows: np.ndarray) -> JudgedChunk:
        """The records of one flight and engine."""
        return JudgedChunk(
            self.taken.of(rows),
            self.failed[rows],
            None if self.e is None else self.e[rows],
            None if self.J is None else self.J[rows],
        )


def judged_chunk(monitor: Monitor, recording: Recording, *, at_nominal: bool) -> JudgedChunk:
    """Everything that does not depend on flights, for a whole chunk: the engine likes long calls."""
    taken = judged_inputs(monitor, recording)
    y, failed, kept = taken.y, np.zeros(len(taken.y), bool), np.flatnonzero(taken.judged)
    if not at_nominal or not kept.size:
        return JudgedChunk(taken, failed)
    predicted, sensitivities, ok, _ = monitor.predict({c: v[kept] for c, v in taken.inputs.items()}, monitor.theta0)
    e, J = np.full(y.shape, np.nan), np.full((*y.shape, len(monitor.names)), np.nan)
    e[kept], J[kept] = np.where(ok[:, None], y[kept] - predicted, np.nan), sensitivities
    failed[kept[~ok]] = True
    return JudgedChunk(taken, failed, e, J)
