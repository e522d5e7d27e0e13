"""Which records can be judged: they have inputs and a reading, and lie where identification has been."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

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


def judged_inputs(
    monitor: Monitor, recording: Recording
) -> tuple[dict[str, np.ndarray], np.ndarray, np.ndarray, np.ndarray]:
    """Inputs (N,) by column, measurements y (N, m), and masks (N,): incomplete, outside the envelope."""
    engine, N = monitor.engine, len(recording)
    inputs = {c: recording.columns[c] for c in engine.inputs}
    for column, default in engine.optional_inputs.items():
        values = recording.columns.get(column, np.full(N, default))
        inputs[column] = np.where(np.isfinite(values), values, default)
    y = np.column_stack([recording.columns.get(c, np.full(N, np.nan)) for c in monitor.sensors])
    y = np.where(np.isfinite(y), y, np.nan)
    complete = np.all([np.isfinite(inputs[c]) for c in engine.inputs], axis=0) & np.isfinite(y).any(axis=1)
    outside = np.zeros(N, bool)
    if monitor.envelope is not None and N:
        outside = complete & np.asarray(monitor.envelope.outside(inputs))
    return inputs, y, ~complete, outside


@dataclass(frozen=True)
class JudgedChunk:
    """Records of a chunk: what is judged of them and, at nominal, residuals e (N, m), J (N, m, p) and failed (N,)."""

    inputs: Mapping[str, np.ndarray]
    y: np.ndarray
    incomplete: np.ndarray
    outside: np.ndarray
    failed: np.ndarray
    e: np.ndarray | None = None
    J: np.ndarray | None = None

    def of(self, rows: np.ndarray) -> JudgedChunk:
        """The records of one flight and engine."""
        return JudgedChunk(
            {c: v[rows] for c, v in self.inputs.items()},
            self.y[rows],
            self.incomplete[rows],
            self.outside[rows],
            self.failed[rows],
            None if self.e is None else self.e[rows],
            None if self.J is None else self.J[rows],
        )


def judged_chunk(monitor: Monitor, recording: Recording, *, at_nominal: bool) -> JudgedChunk:
    """Everything that does not depend on flights, for a whole chunk: the engine likes long calls."""
    inputs, y, incomplete, outside = judged_inputs(monitor, recording)
    failed = np.zeros(len(y), bool)
    kept = np.flatnonzero(~incomplete & ~outside)
    if not at_nominal or not kept.size:
        return JudgedChunk(inputs, y, incomplete, outside, failed)
    predicted, sensitivities, ok, _ = monitor.predict({c: v[kept] for c, v in inputs.items()}, monitor.theta0)
    e, J = np.full(y.shape, np.nan), np.full((*y.shape, len(monitor.names)), np.nan)
    e[kept], J[kept] = np.where(ok[:, None], y[kept] - predicted, np.nan), sensitivities
    failed[kept[~ok]] = True
    return JudgedChunk(inputs, y, incomplete, outside, failed, e, J)
