"""What the network of a moving engine is told along time, from what its flight asks for."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from enginediag_cli.engine.dual import Array
from enginediag_cli.engine.engine import Engine
from enginediag_cli.engine.moving.filters.base import Clock
from enginediag_cli.engine.moving.recall import asked_for
from enginediag_cli.engine.transient.states import remembered

BEND = 16
"""Parts of a stretch between two set points in which a power that is a curve of the set point is taken straight."""


@dataclass(frozen=True)
class Flight:
    """What one engine is asked for: columns (C,) of inputs and, where they are not nominal, parameters at rising
    `time` (C,) s, straight between; `records` (N,): times at which its states are wanted."""

    time: Array
    columns: Mapping[str, Array]
    records: Array


def _numbers(values: Mapping[str, Any], names: Sequence[str]) -> list[float]:
    return [float(np.mean(values[n])) for n in names]


def told(engine: Engine, flight: Flight) -> tuple[Array, dict[str, Array]]:
    """Times and columns of a flight as the network reads them: the power that a set point asks for, and columns that
    come through a filter without states (a delay)."""
    network, time = engine.network, flight.time
    columns = dict(flight.columns)
    if network.demand is not None:
        time, columns = _at(np.interp(np.arange((len(time) - 1) * BEND + 1) / BEND, np.arange(len(time)), time), flight)
        theta = {**engine.nominal, **columns}
        asked = dict(zip(network.demand.names, _numbers(theta, network.demand.names), strict=True))
        columns[network.power_setting] = asked_for(engine, columns, {**theta, **asked}, (), len(time)).value
        del columns[network.demand.column]
    for m in remembered(engine, tuple(columns)):
        if not m.column or m.filter.STATES or m.column not in columns:
            continue
        coefficients = _numbers({**engine.nominal, **columns}, m.coefficients)
        now = Flight(time, columns, flight.records)
        bends = m.filter.bends(time, coefficients)
        time, columns = _at(np.union1d(time, bends[(bends > time[0]) & (bends < time[-1])]), now)
        first = np.zeros(len(time), dtype=bool)
        first[0] = True
        signal = columns[m.column]
        columns[m.column] = signal + m.filter(Clock(time, first), signal, np.zeros((0, len(time))), coefficients).value
    return time, columns


def _at(time: Array, flight: Flight) -> tuple[Array, dict[str, Array]]:
    return time, {c: np.interp(time, flight.time, v) for c, v in flight.columns.items()}
