"""Instruments that drift: a model that offers an error growing with the time since the recording began as parameters.

A bias, a scale and a drift are forms of one fault of one instrument. With the rate d of the instrument, in its unit per
hour, and t the hours since the first record of the flight,

    y_read = y + d t,   ∂y/∂d = t          (an output)
    u_true = u_read − d t,   ∂Φ/∂d = −t ∂Φ/∂u          (an input of the model)

where t is an input column of the model, which whoever reads recordings writes; it is 0 where no time was recorded.
"""

from __future__ import annotations

from collections.abc import Mapping
from copy import copy
from dataclasses import replace
from typing import Any

import numpy as np

from enginediag_cli.engine.model import MonitoredModel
from enginediag_cli.engine.wrapped import Question, WrappedModel
from enginediag_cli.parameters import Parameter

ELAPSED = "elapsed_h"
"""Input column: hours since the first record of the flight."""
DRIFT = "drift"
"""Quantity of such a parameter."""


class InstrumentDrifts(WrappedModel):
    """`model` with the drifts of instruments as further parameters: column → its parameter, of outputs and of inputs;
    all else is the model's."""

    def __init__(self, model: MonitoredModel, outputs: Mapping[str, Parameter], inputs: Mapping[str, Parameter]):
        self._outputs = {p.name: column for column, p in outputs.items()}
        self._inputs = {p.name: column for column, p in inputs.items()}
        super().__init__(model, {p.name: p for p in (*outputs.values(), *inputs.values())})
        self.optional_inputs = {**model.optional_inputs, ELAPSED: 0.0}

    @staticmethod
    def from_biases(
        model: MonitoredModel, outputs: Mapping[str, Parameter], inputs: Mapping[str, Parameter]
    ) -> InstrumentDrifts:
        """With a drift for each instrument of which the bias is known, by column: it may reach in an hour what is
        plausible of the bias."""
        return InstrumentDrifts(
            model, {c: drift_of(p) for c, p in outputs.items()}, {c: drift_of(p) for c, p in inputs.items()}
        )

    def _answer(self, asked: Question) -> Any:
        true = dict(asked.inputs)
        hours = np.asarray(true.pop(ELAPSED, 0.0), float)
        rates = {name: np.asarray(value, float) for name, value in asked.own.items() if np.any(value)}
        for name, rate in rates.items():
            if name in self._inputs:
                true[self._inputs[name]] = np.asarray(true[self._inputs[name]], float) - rate * hours
        slopes = {name: -hours for name in asked.wrt if name in self._inputs}
        inner = tuple(name for name in asked.wrt if name not in self._outputs)
        like = {name: self._inputs[name] for name in slopes}
        plain = replace(asked, wrt=inner)
        found = self._ask_along(plain, like, slopes, inputs=true)
        drifting = [name for name in (*asked.wrt, *rates) if name in self._outputs]
        return self._with_drifts(found, asked.wrt, inner, hours, rates) if drifting else found

    def _with_drifts(
        self,
        found: Any,
        wrt: tuple[str, ...],
        inner: tuple[str, ...],
        hours: np.ndarray,
        rates: Mapping[str, np.ndarray],
    ) -> Any:
        """The prediction with the drifts of outputs in it, and their columns among its sensitivities."""
        y, columns = np.array(found.y, float), list(found.columns)
        J = np.zeros((*y.shape, len(wrt)))
        if inner:
            J[:, :, [k for k, name in enumerate(wrt) if name in inner]] = found.jacobian
        for name, column in self._outputs.items():
            if column in columns:
                j = columns.index(column)
                if name in rates:
                    y[:, j] += rates[name] * hours
                if name in wrt:
                    J[:, j, wrt.index(name)] = hours
        result = copy(found)  # predictions are frozen
        for attribute, value in (("y", y), ("jacobian", J), ("wrt", wrt)):
            object.__setattr__(result, attribute, value)
        return result


def drift_of(bias: Parameter) -> Parameter:
    """The drift of the instrument whose bias this is."""
    per_hour = f"{bias.shown_unit or '1'}/h"
    return replace(
        bias,
        name=f"{bias.component}.{DRIFT}",
        nominal=0.0,
        lower=bias.lower - bias.nominal,
        upper=bias.upper - bias.nominal,
        unit=per_hour,
        description=f"drift of the {bias.part}",
        quantity=DRIFT,
        words=f"{bias.part} drift",
        roams=None,
    )
