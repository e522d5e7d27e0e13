"""An engine whose parameters may vary from record to record along given curves.

A *discrepancy* adds c · φ_k to one parameter of the engine in record k, with φ (N,) a given curve (a polynomial in
a driver, a step in time, one engine of a fleet) and c sought like any parameter:

    θ_target,k = θ_target + Σ_d c_d φ_dk        ∂y_k/∂c_d = ∂y_k/∂θ_target · φ_dk

The curves travel as extra input columns, so that identification can cut and select records without knowing.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from enginediag_cli.engine.engine import Engine
from enginediag_cli.engine.wrapped import PredictionRequest, WarmEngine, WrappedModel
from enginediag_cli.parameters import Parameter
from enginediag_cli.physics.registry import term, term_names

NUMBER = "record_number"
"""Input column with the place of each record in all that was read, so that it is found again after selection."""


@dataclass(frozen=True)
class Discrepancy:
    """c · φ on the parameter `target`; `curve` is φ's column, `sigma` the prior standard deviation of c in the
    target's unit. A name of its own, `<target>|<curve>`, tells it from the target."""

    target: str
    curve: str
    sigma: float
    lower: float = -np.inf
    upper: float = np.inf

    @property
    def name(self) -> str:
        return f"{self.target}|{self.curve}"


def library_inputs() -> dict[str, float]:
    """Input columns that terms of the library read, with the value that stands for "not recorded"."""
    return {c: default for n in term_names() for c, default in term(n).INPUTS.items()}


class ExtendedModel(WrappedModel):
    """`engine` with discrepancies, as identification sees a model; points are solved warm, from where they were last
    solved by this model or by another, `like`."""

    def __init__(self, engine: Engine, discrepancies: Sequence[Discrepancy] = (), *, like: ExtendedModel | None = None):
        self.engine = engine
        self._discrepancies = {d.name: d for d in discrepancies}
        curves = {d.curve: 0.0 for d in discrepancies}
        super().__init__(
            WarmEngine(engine, walk=False, like=like.model if like else None),
            {d.name: self._parameter(d) for d in discrepancies},
        )
        # what effects read beside the engine's own inputs travels along: they are looked for at fits without them
        self.optional_inputs = {**library_inputs(), **engine.optional_inputs, NUMBER: -1.0, **curves}

    def _parameter(self, d: Discrepancy) -> Parameter:
        p = self.engine.parameters[d.target]
        told, words = f"{d.target} along {d.curve}", f"{p.words} along {d.curve}"
        return Parameter(
            d.name, "discrepancy", 0.0, d.lower, d.upper, d.sigma, p.unit, told, p.component, p.quantity, words, p.part
        )

    def _predict(self, asked: PredictionRequest) -> Any:
        """At parameters that follow the curves, and along these."""
        theta, inputs = dict(asked.parameters), asked.inputs
        for name, c in asked.own.items():
            if c != 0.0:
                d = self._discrepancies[name]
                base = theta.get(d.target, self.engine.parameters[d.target].nominal)
                theta[d.target] = base + c * np.asarray(inputs[d.curve], float)
        plain = {c: v for c, v in inputs.items() if c in self.engine.inputs or c in self.engine.optional_inputs}
        sought = [self._discrepancies[name] for name in asked.wrt if name in self._discrepancies]
        slopes = {d.name: np.asarray(inputs[d.curve], float) for d in sought}
        like = {d.name: d.target for d in sought}
        return self._predict_inner_scaled(asked, like, slopes, inputs=plain, parameters=theta)

    @property
    def discrepancies(self) -> tuple[Discrepancy, ...]:
        return tuple(self._discrepancies.values())
