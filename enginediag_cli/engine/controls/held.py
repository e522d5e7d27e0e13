"""An actuator that holds a column at its set point, between its stops."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING

import numpy as np

from enginediag_cli.engine.components.base import Unknown
from enginediag_cli.engine.controls.aim import Aim, selected
from enginediag_cli.engine.controls.complementarity import between_stops
from enginediag_cli.engine.controls.control import AT_LIMIT, Control, Derived
from enginediag_cli.engine.controls.release import Release
from enginediag_cli.engine.controls.stops import Stops
from enginediag_cli.engine.dual import Array, Value, value
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
