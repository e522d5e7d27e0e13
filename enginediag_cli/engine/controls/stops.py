"""The stops of an actuator, and its position between them as an unknown of order one."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from enginediag_cli.engine.components.base import Actuator, Unknown
from enginediag_cli.engine.dual import Array, Value, value
from enginediag_cli.engine.evaluation import Evaluation
from enginediag_cli.parameters import Parameter, spelled

STOP_SHARE = 0.1
"""How far a stop plausibly lies from what is stated, as a share of the way between the stops. Judgement."""
BEYOND = 0.5
"""How far beyond a stop the iteration may go on its way, as a share of the way between them."""


@dataclass(frozen=True)
class Stops:
    """x = low + (high − low) (u − 1): position x in the actuator's unit, unknown u from 1 at the low stop to 2."""

    owner: str
    actuator: Actuator
    low: float
    high: float

    @property
    def unknown(self) -> str:
        return f"{self.owner}.position"

    def unknowns(self) -> tuple[Unknown, ...]:
        start = 1.0 + np.clip((self.actuator.neutral - self.low) / (self.high - self.low), 0.0, 1.0)
        return (Unknown(self.unknown, float(start), 1.0 - BEYOND, 2.0 + BEYOND),)

    def parameters(self) -> tuple[Parameter, ...]:
        sigma = STOP_SHARE * (self.high - self.low)
        found = []
        for quantity, nominal in (("low", self.low), ("high", self.high)):
            found.append(
                Parameter(
                    f"{self.owner}.{quantity}",
                    "design",
                    nominal,
                    self.actuator.lower,
                    self.actuator.upper,
                    sigma,
                    self.actuator.unit,
                    f"{quantity} stop of the {self.actuator.words}",
                    self.owner,
                    quantity,
                    f"{spelled(self.owner)} {quantity} stop",
                    spelled(self.owner),
                )
            )
        return tuple(found)

    def position(self, e: Evaluation) -> Value:
        low = e[f"{self.owner}.low"]
        return low + (e[f"{self.owner}.high"] - low) * (e[self.unknown] - 1.0)

    def unknown_at(self, e: Evaluation, position: Value) -> Value:
        """u of a position."""
        low = e[f"{self.owner}.low"]
        return 1.0 + (position - low) / (e[f"{self.owner}.high"] - low)

    def acting(self, e: Evaluation, within: float) -> Mapping[str, Array]:
        u = np.asarray(value(e[self.unknown]))
        return {f"{self.owner}.low": u - 1.0 < within, f"{self.owner}.high": 2.0 - u < within}
