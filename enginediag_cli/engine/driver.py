"""What an effect varies with: one object per driver, with its words and its values in the records of an engine.

The drivers that are listed stand in `enginediag_cli.drivers`; a term may bring one of its own.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from enginediag_cli.engine.engine import Engine

STILL = 1e-6
"""Relative spread below which a driver has not moved."""


@dataclass(frozen=True)
class Conditions:
    """N records of an engine: its inputs, and `column`, the model columns that drivers asked for, (N,) each; NaN
    where the engine has no prediction."""

    engine: Engine
    inputs: Mapping[str, np.ndarray]
    column: Mapping[str, np.ndarray]


def no_columns(engine: Engine) -> tuple[str, ...]:
    """A driver that reads no model column."""
    return ()


def no_values(at: Conditions) -> Iterable[DriverValues]:
    """A driver of which no engine gives values: it is recorded, or it is none."""
    return ()


@dataclass(frozen=True)
class Driver:
    """One thing that an effect may vary with.

    `word`: how terms and tables call it; `words`: what it is, as an engineer says it ("flight Mach number"); `unit` of
    its values, and `counted_in`, where they are logarithms: what the quantity itself is counted in. `columns`: model
    columns that `values` reads; `values`: its values in the records, one for each shaft or nozzle that the engine has,
    none where the engine has no such thing. `true_values`: the same where an input that it needs was not recorded, for
    those who know what truly happened.
    """

    word: str
    words: str
    unit: str = "1"
    counted_in: str = ""
    columns: Callable[[Engine], tuple[str, ...]] = no_columns
    values: Callable[[Conditions], Iterable[DriverValues]] = no_values
    true_values: Callable[[Conditions], Iterable[DriverValues]] = no_values


@dataclass(frozen=True)
class DriverValues:
    """A driver's values in every record (N,), in its unit; `name` tells apart those of several shafts or nozzles,
    `short` is the name as an engineer says it, on an axis or in a sentence."""

    driver: Driver
    name: str
    values: np.ndarray
    short: str

    @property
    def unit(self) -> str:
        return self.driver.unit

    @property
    def moves(self) -> bool:
        spread = np.nanstd(self.values)
        return bool(spread > STILL * max(1e-300, float(np.nanmean(np.abs(self.values)))))
