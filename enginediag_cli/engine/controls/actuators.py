"""Actuators of a control: governed, held at a set point, recorded, or scheduled.

The fuel control: it meets the power that is asked for, unless a limit takes over.

An actuator that holds a column at its set point, between its stops.

An actuator whose position the recording holds.

An actuator whose position follows something: a table or a polynomial.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING

import numpy as np

from enginediag_cli.engine.components.base import Actuator, Unknown
from enginediag_cli.engine.controls.control import (
    AT_LIMIT,
    Aim,
    Control,
    Derived,
    Release,
    Schedule,
    Stops,
    between_stops,
    selected,
)
from enginediag_cli.engine.dual import Array, Value, maximum, minimum, value
from enginediag_cli.engine.evaluation import Evaluation
from enginediag_cli.parameters import Parameter

if TYPE_CHECKING:
    from enginediag_cli.engine.network import Network


class Held(Control):
    """ψ(u − 1, 2 − u, F) = 0: the column stands at its set point, or the actuator at a stop; F as `selected` gives
    it."""

    def __init__(self, name: str, stops: Stops, aim: Aim, limits: tuple[Aim, ...], release: Release | None = None):
        super().__init__(name, stops.actuator)
        self.stops, self.aim, self.limits, self.release = stops, aim, limits, release

    def aims(self) -> tuple[Aim, ...]:
        return (self.aim, *self.limits)

    def inputs(self) -> dict[str, float | None]:
        wander = {self.release.wander: 0.0} if self.release is not None and self.release.wander else {}
        return inputs_of(self.aims()) | wander

    def parameters(self) -> tuple[Parameter, ...]:
        return (*self.stops.parameters(), *(p for aim in self.aims() for p in aim.parameters()))

    def unknowns(self) -> tuple[Unknown, ...]:
        return self.stops.unknowns()

    def position(self) -> Mapping[str, Derived]:
        return {self.actuator.name: self._stands}

    def _stands(self, e: Evaluation) -> Value:
        """Between the stops, or, released, as far off its rest as the wander says."""
        position = self.stops.position(e)
        r = self.release
        return position + r.off_rest(e) if r is not None and r.wander else position

    def close(self, e: Evaluation, network: Network) -> None:
        u = e[self.stops.unknown]
        F = selected(self.aim, self.limits, e, network)
        if self.release is not None:
            F = self.release.of(F, e, network)
        e.balances[f"{self.name} position"] = network.paced(self, e, between_stops(u - 1.0, 2.0 - u, F))

    def acting(self, e: Evaluation, network: Network) -> Mapping[str, Array]:
        found = dict(self.stops.acting(e, AT_LIMIT))
        free = ~np.any(list(found.values()), axis=0)
        limits = limits_acting(self.limits, e, network)
        return found | {name: mask & free for name, mask in limits.items()}


def inputs_of(aims: tuple[Aim, ...]) -> dict[str, float | None]:
    """Columns that schedules of the recording's own read."""
    schedules = [aim.schedule for aim in aims if aim.schedule is not None]
    return {s.column: None for s in schedules if s.is_input}


def limits_acting(limits: tuple[Aim, ...], e: Evaluation, network: Network) -> dict[str, Array]:
    """Which limits are met (N,)."""
    return {limit.name: np.abs(value(limit.surplus(e, network))) < AT_LIMIT for limit in limits}


FUEL_VALVE = Actuator("fuel", "kg/s", 0.0, 0.0, float("inf"), "fuel valve")


class Governor(Control):
    """F = 0 with F as `selected` gives it: the burner's fuel flow, an unknown already, has no stops of its own."""

    def __init__(self, name: str, aim: Aim, limits: tuple[Aim, ...]):
        super().__init__(name, FUEL_VALVE)
        self.aim, self.limits = aim, limits

    def aims(self) -> tuple[Aim, ...]:
        return (self.aim, *self.limits)

    def inputs(self) -> dict[str, float | None]:
        return inputs_of(self.aims())

    def parameters(self) -> tuple[Parameter, ...]:
        return tuple(p for aim in self.aims() for p in aim.parameters())

    def position(self) -> Mapping[str, Derived]:
        return {}

    def close(self, e: Evaluation, network: Network) -> None:
        e.balances[f"{self.name} fuel"] = network.paced(self, e, selected(self.aim, self.limits, e, network))

    def acting(self, e: Evaluation, network: Network) -> Mapping[str, Array]:
        return limits_acting(self.limits, e, network)


class Recorded(Control):
    """x = the input column, in the actuator's unit."""

    def __init__(self, name: str, actuator: Actuator, column: str):
        super().__init__(name, actuator)
        self.column = column

    def inputs(self) -> dict[str, float | None]:
        return {self.column: None}

    def position(self) -> Mapping[str, Derived]:
        return {self.actuator.name: lambda e: e[self.column]}


class Scheduled(Control):
    """x = v(…) between the stops. Of an input it is known at once; of a model column, which lies further down the gas
    path, the position is an unknown and u − u(v) = 0 its balance."""

    def __init__(self, name: str, stops: Stops, schedule: Schedule):
        super().__init__(name, stops.actuator)
        self.stops, self.schedule = stops, schedule

    def inputs(self) -> dict[str, float | None]:
        return {self.schedule.column: None} if self.schedule.is_input else {}

    def parameters(self) -> tuple[Parameter, ...]:
        return (*self.stops.parameters(), *self.schedule.parameters())

    def unknowns(self) -> tuple[Unknown, ...]:
        return () if self.schedule.is_input else self.stops.unknowns()

    def position(self) -> Mapping[str, Derived]:
        return {self.actuator.name: self._given if self.schedule.is_input else self.stops.position}

    def close(self, e: Evaluation, network: Network) -> None:
        if not self.schedule.is_input:
            wanted = self.stops.unknown_at(e, self._stopped(e, self.schedule.at(e, network)))
            e.balances[f"{self.name} position"] = network.paced(self, e, e[self.stops.unknown] - wanted)

    def acting(self, e: Evaluation, network: Network) -> Mapping[str, Array]:
        u = np.asarray(value(self.stops.unknown_at(e, self.schedule.at(e, network))))
        return {f"{self.name}.low": u - 1.0 < -AT_LIMIT, f"{self.name}.high": 2.0 - u < -AT_LIMIT}

    def _given(self, e: Evaluation) -> Value:
        return self._stopped(e, self.schedule.of(e, e[self.schedule.column]))

    def _stopped(self, e: Evaluation, position: Value) -> Value:
        low, high = e[f"{self.name}.low"], e[f"{self.name}.high"]
        return minimum(maximum(position, low), high)
