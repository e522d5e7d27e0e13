"""An actuator whose position follows something: a table or a polynomial."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING

import numpy as np

from enginediag_cli.engine.components.base import Unknown
from enginediag_cli.engine.controls.control import AT_LIMIT, Control, Derived
from enginediag_cli.engine.controls.schedule import Schedule
from enginediag_cli.engine.controls.stops import Stops
from enginediag_cli.engine.dual import Array, Value, maximum, minimum, value
from enginediag_cli.engine.evaluation import Evaluation
from enginediag_cli.parameters import Parameter

if TYPE_CHECKING:
    from enginediag_cli.engine.network import Network


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
