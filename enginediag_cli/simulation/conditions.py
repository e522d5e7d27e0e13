"""Operating conditions: what an engine is asked to do, record by record."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from enginediag_cli.config.hints import near
from enginediag_cli.engine.model import EngineLike
from enginediag_cli.errors import DataError

LABELS = ("flight", "time_s", "phase")
"""Columns that place a record in a recording; never inputs of an engine."""


@dataclass(frozen=True)
class Conditions:
    """Columns of equal length N in the order in which they are written; `flight` and `phase` may be text.

    `series`: whether records follow each other in time, rather than being points that were drawn one by one. `way`:
    what is flown between them, too, where that has corners: the same columns at more points of time.
    """

    columns: Mapping[str, NDArray]
    series: bool = True
    way: Conditions | None = None

    def __post_init__(self) -> None:
        lengths = {name: len(values) for name, values in self.columns.items()}
        if len(set(lengths.values())) > 1:
            raise ValueError(f"columns differ in length: {lengths}")

    def __len__(self) -> int:
        return len(next(iter(self.columns.values()), ()))

    def slice(self, start: int, stop: int) -> Conditions:
        """Records `start` to `stop` (exclusive, counted from 0)."""
        cut = {name: values[start:stop] for name, values in self.columns.items()}
        return Conditions(cut, self.series, self.way)


def engine_inputs(engine: EngineLike, conditions: Conditions) -> dict[str, NDArray[np.float64]]:
    """The engine's input columns, (N,) each: all required ones, and the optional ones that are given.

    Raises DataError naming the missing column and a near match among those that are there.
    """
    inputs = {}
    for column in engine.inputs:
        if column not in conditions.columns:
            raise DataError(
                f"engine {engine.name!r} needs the column {column!r}, which the conditions lack "
                f"({near(column, conditions.columns)})"
            )
        inputs[column] = np.asarray(conditions.columns[column], dtype=float)
    for column in engine.optional_inputs:
        if column in conditions.columns:
            inputs[column] = np.asarray(conditions.columns[column], dtype=float)
    return inputs


def outside_envelope(engine: EngineLike, conditions: Conditions) -> dict[str, int]:
    """Column → number of records outside the engine's declared envelope; empty where all are inside."""
    counts = {}
    for column, (low, high) in engine.envelope.items():
        if column in conditions.columns:
            values = np.asarray(conditions.columns[column], dtype=float)
            margin = 1e-9 * max(abs(low), abs(high))
            outside = int(np.count_nonzero((values < low - margin) | (values > high + margin)))
            if outside:
                counts[column] = outside
    return counts
