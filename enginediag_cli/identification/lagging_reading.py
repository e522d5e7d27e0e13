"""A reading that lags behind the model where the engine moves, as identification found it."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class LaggingReading:
    """`amounts` (T,): of each deviation of a lag of the command with a time constant of `lags_s` (T,) from the command
    itself, in the column's unit per unit of the command; `spread` (T,): standard deviation of the amounts from stretch
    to stretch. `moved`, `left`: RMS of the residuals without and with that, in the column's unit, where the engine
    moves."""

    sensor: str
    lags_s: tuple[float, ...]
    amounts: tuple[float, ...]
    spread: tuple[float, ...]
    moved: float
    left: float
