"""Position of an actuator that does not follow at once: a fuel valve, vanes, a nozzle."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING

import numpy as np

from enginediag_cli.engine.controls.aim import selected
from enginediag_cli.engine.controls.complementarity import between_stops, minimum
from enginediag_cli.engine.controls.control import AT_LIMIT, Control
from enginediag_cli.engine.controls.governor import Governor
from enginediag_cli.engine.controls.held import Held
from enginediag_cli.engine.dual import Array, Value, maximum, value
from enginediag_cli.engine.evaluation import Evaluation
from enginediag_cli.engine.hooks import Hooks
from enginediag_cli.engine.transient.state import ELAPSED, STEP, State

if TYPE_CHECKING:
    from enginediag_cli.engine.network import Network


class Actuator(State):
    """τ d ln x/dt = −F of fuel, τ du/dt = −F of a position u between stops, and |dx/dt| at most the rate; F, which the
    control brings to zero, rises with the position. With a rate alone F = 0 holds wherever it can be reached from where
    the actuator stood at the beginning of the step. Where neither is given there is no state."""

    coarser = 20.0
    """Its rate jumps where a limit takes over, and a step across that is only of first order."""

    def __init__(self, control: Control, network: Network):
        self.control, self.governs = control, isinstance(control, Governor)
        self.name, self.words = f"{control.name}.stands", f"{control.name} actuator"
        self.unit = control.actuator.unit
        self._way = 1.0
        if not self.governs:
            stops = getattr(control, "stops", None)
            if stops is None or not control.unknowns():
                raise ValueError(
                    f"{control.name}: what is recorded, or follows an input of the engine, has no time constant or "
                    "rate of its own"
                )
            self._unknown, self._way = stops.unknown, stops.high - stops.low
        self.follows = not control.pace.time_constant_s
        self._rate = control.pace.rate_per_s / self._way

    def install(self, hooks: Hooks, network: Network) -> None:
        """Nothing: it acts through the balance of its control."""

    def value(self, e: Evaluation) -> Value:
        """Fuel flow, kg/s, or the position's unknown, 1 at the low stop to 2."""
        return e.outputs["Wf_kg_s"] if self.governs else e[self._unknown]

    def hurried(self, e: Evaluation, network: Network) -> Array:
        """Where the actuator is on its way as fast as it can (N,); unknown where the control has a time constant."""
        pace, control = self.control.pace, self.control
        if not pace.rate_per_s or pace.time_constant_s or not isinstance(control, (Governor, Held)):
            return np.zeros(e.size, dtype=bool)
        surplus = value(selected(control.aim, control.limits, e, network))
        stopped = (
            np.any(list(control.stops.acting(e, AT_LIMIT).values()), axis=0) if isinstance(control, Held) else False
        )
        return (np.abs(surplus) > AT_LIMIT) & ~np.asarray(stopped)

    def balance(self, e: Evaluation, surplus: Value) -> Value:
        """What is zero: the law, between the positions that can be reached within a stage."""
        x = self.value(e)
        size = x if self.governs else 1.0
        pace = self.control.pace
        if self.follows:
            moved, reach = (x - e[self.base]) / size, e[ELAPSED] * self._rate / size
            return between_stops(moved + reach, reach - moved, surplus)
        if not e.has(self.base):
            e.signals[self.name] = surplus
            return (x - e[self.name]) / size
        moved = (x - e[self.base]) / size
        total = surplus + moved * (pace.time_constant_s / e[STEP])
        if not pace.rate_per_s:
            return total
        reach = e[STEP] * self._rate / size
        return between_stops(moved + reach, reach - moved, total)

    def slope(self, e: Evaluation) -> Value:
        size = self.value(e) if self.governs else 1.0
        free = e.signals[self.name] * size * (-1.0 / self.control.pace.time_constant_s)
        if not self.control.pace.rate_per_s:
            return free
        return maximum(minimum(free, self._rate), -self._rate)

    def overrun(self, time: Array, x: Array, leaves: Mapping[str, Value]) -> Array:
        moved = np.abs(np.diff(x, axis=0)) - self._rate * np.diff(time, axis=0)
        return np.asarray(np.maximum(moved.max(axis=0), 0.0))
