"""Which records can be judged: they have inputs and a reading, and lie where identification has been.

Beyond that a model whose error begins to grow there still answers, with limits as wide as it says, up to a distance
at which it is not known any more (`Envelope.within_reach`).
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping
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
class NominalResiduals:
    """N records held against nominal, before any change is estimated: `inputs`, column -> (N,), what the engine
    freezes at nominal among them; readings y (N, m), NaN where there is none; predicted (N, m), J (N, m, p); ok (N,):
    those that the engine can compute; x: its unknowns (nx, N) there, None where it shows none."""

    inputs: Mapping[str, np.ndarray]
    y: np.ndarray
    predicted: np.ndarray
    J: np.ndarray
    ok: np.ndarray
    x: np.ndarray | None

    @property
    def e(self) -> np.ndarray:
        """Residuals (N, m), NaN where there is none."""
        return np.where(self.ok[:, None], self.y - self.predicted, np.nan)

    def rows(self, some: slice | np.ndarray) -> NominalResiduals:
        """Some of the records."""
        inputs = {c: np.asarray(v)[some] for c, v in self.inputs.items()}
        x = None if self.x is None else self.x[:, some]
        return NominalResiduals(inputs, self.y[some], self.predicted[some], self.J[some], self.ok[some], x)


def nominal_residuals(
    monitor: Monitor,
    inputs: Mapping[str, np.ndarray],
    y: np.ndarray,
    distinct: np.ndarray | None = None,
) -> NominalResiduals:
    """Records that are judged held against nominal: inputs (N,) by column and readings y (N, m). distinct (N,): number
    of each record, where windows share some."""
    rows = slice(None) if distinct is None else np.unique(distinct, return_index=True)[1]
    asked = {c: v[rows] for c, v in inputs.items()}
    predicted, J, ok, prediction = monitor.predict(asked, monitor.theta0)
    # a fault is hypothesised with the errors of the maps where nominal has the machines: see `error_model.modelled`
    known = {**asked, **getattr(prediction, "frozen", {})}
    # unknowns of the engine, from which the next solution is near
    found = NominalResiduals(known, y[rows], predicted, J, np.asarray(ok), getattr(prediction, "x", None))
    return found if distinct is None else found.rows(np.unique(distinct, return_inverse=True)[1])
