"""How far readings of an engine are ahead of what follows them with a lag, record by record.

Whatever a model of a moving engine lacks (heat that metal takes up, a probe's lag, an actuator's) shows in a reading,
in first order, as a sum of such deviations: of the reading y as the engine has it at once and first-order lags of it,
m_τ − y, which is 0 at rest.
"""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from enginediag_cli.engine.moving.filters.lag import Lag
from enginediag_cli.engine.moving.tape import MOMENT, PAST
from enginediag_cli.engine.wrapped import Question, WrappedModel

LAGS_S = (2.0, 6.0, 20.0, 60.0)
"""Time constants of the lags, s: those of probes and actuators, of thin metal and of casings (Walsh and Fletcher, Gas
Turbine Performance, ch. 8), a factor of three apart, so that what lies between two is a sum of both."""
KEPT = 4
"""Tapes whose deviations are kept: windows of one recording come one after the other."""


class Lagging(WrappedModel):
    """The model, which may have no memory itself, asked with the past of every record: for what readings lag by.
    `parameters`: values at which its readings are followed."""

    def __init__(self, model: Any, parameters: Mapping[str, float], lags_s: Sequence[float] = LAGS_S):
        super().__init__(model, {})
        self._at = {name: v for name, v in parameters.items() if name in model.parameters}
        self.lags_s = tuple(lags_s)
        self.optional_inputs = {**model.optional_inputs, **PAST}
        self._known: OrderedDict[tuple[Any, ...], np.ndarray] = OrderedDict()

    def deviations(self, inputs: Mapping[str, Any], sensors: Sequence[str], size: int) -> np.ndarray:
        """m_τ − y (size, m, T) of the readings `sensors` in records with these inputs; 0 where no past is known."""
        moment = np.broadcast_to(inputs.get(MOMENT, PAST[MOMENT]), (size,))
        number, place = self.model.tapes.found(moment)
        found = np.zeros((size, len(sensors), len(self.lags_s)))
        for k in np.unique(number[number >= 0]).tolist():
            rows = number == k
            found[rows] = self._of_tape(k, tuple(sensors))[place[rows]]
        return found

    def _of_tape(self, k: int, sensors: tuple[str, ...]) -> np.ndarray:
        """(n, m, T) at all records of a tape."""
        tape = self.model.tapes.tapes[k]
        key = (k, len(tape), sensors)
        if key in self._known:
            return self._known[key]
        # at once: without the past that the engine itself may remember
        every = (*self.model.inputs, *self.model.optional_inputs)
        points = {c: tape.columns[c] for c in every if tape.tells(c) and c != MOMENT}
        if any(c not in points for c in self.model.inputs):
            return np.zeros((len(tape), len(sensors), len(self.lags_s)))
        p = self.model.predict(points, self._at, sensors=sensors)
        y, clock, none = np.where(p.ok[:, None], p.y, np.nan), tape.clock(), np.zeros((0, len(tape)))
        found = np.zeros((*y.shape, len(self.lags_s)))
        for i, reading in enumerate(y.T):
            good = np.isfinite(reading)
            if good.any():
                whole = np.interp(np.arange(len(y)), np.flatnonzero(good), reading[good])
                for j, lag in enumerate(self.lags_s):
                    found[:, i, j] = Lag()(clock, whole, none, (lag,)).value
        self._known[key] = found
        while len(self._known) > KEPT:
            self._known.popitem(last=False)
        return found

    def _answer(self, asked: Question) -> Any:
        return self._ask(asked)
