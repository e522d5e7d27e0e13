"""Operating conditions: what an engine is asked to do, record by record."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from enginediag_cli.config.hints import near
from enginediag_cli.errors import DataError
from enginediag_cli.parameters import Parameter

LABELS = ("flight", "time_s", "phase")
"""Columns that place a record in a recording; never inputs of an engine."""


class SensorLike(Protocol):
    """What simulation needs of a sensor, in the unit of its column."""

    @property
    def noise_sigma(self) -> float: ...
    @property
    def maximum(self) -> float | None: ...


class PredictionLike(Protocol):
    @property
    def y(self) -> NDArray[np.float64]: ...
    @property
    def status(self) -> NDArray[np.int8]: ...
    @property
    def columns(self) -> Sequence[str]: ...
    def reason(self, k: int) -> str: ...


class EngineLike(Protocol):
    """What simulation needs of an engine; `enginediag_cli.engine.Engine` has it."""

    @property
    def name(self) -> str: ...
    @property
    def inputs(self) -> Sequence[str]: ...
    @property
    def optional_inputs(self) -> Mapping[str, float]: ...
    @property
    def sensors(self) -> Mapping[str, SensorLike]: ...
    @property
    def parameters(self) -> Mapping[str, Parameter]: ...
    @property
    def power_setting(self) -> str: ...
    @property
    def envelope(self) -> Mapping[str, tuple[float, float]]: ...
    def power_from_fraction(
        self,
        fraction: NDArray[np.float64],
        inputs: Mapping[str, NDArray[np.float64]],
    ) -> NDArray[np.float64]: ...
    def predict(
        self,
        inputs: Mapping[str, NDArray[np.float64]],
        parameters: Mapping[str, NDArray[np.float64]] | None = None,
        *,
        sensors: Sequence[str] | None = None,
    ) -> PredictionLike: ...


@dataclass(frozen=True)
class Conditions:
    """Columns of equal length N in the order in which they are written; `flight` and `phase` may be text."""

    columns: Mapping[str, NDArray]

    def __post_init__(self) -> None:
        lengths = {name: len(values) for name, values in self.columns.items()}
        if len(set(lengths.values())) > 1:
            raise ValueError(f"columns differ in length: {lengths}")

    def __len__(self) -> int:
        return len(next(iter(self.columns.values()), ()))

    def slice(self, start: int, stop: int) -> Conditions:
        """Records `start` to `stop` (exclusive, counted from 0)."""
        return Conditions({name: values[start:stop] for name, values in self.columns.items()})


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
