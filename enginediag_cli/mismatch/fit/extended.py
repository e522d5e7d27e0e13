"""An engine whose parameters may vary from record to record along given curves.

A *discrepancy* adds c · φ_k to one parameter of the engine in record k, with φ (N,) a given curve (a polynomial in
a driver, a step in time, one engine of a fleet) and c sought like any parameter:

    θ_target,k = θ_target + Σ_d c_d φ_dk        ∂y_k/∂c_d = ∂y_k/∂θ_target · φ_dk

The curves travel as extra input columns, so that identification can cut and select records without knowing.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from enginediag_cli.engine.engine import Engine
from enginediag_cli.engine.warm import WarmEngine
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


class ExtendedModel:
    """`engine` with discrepancies, as identification sees a model; points are solved warm, from where they were last
    solved by this model or by another, `like`."""

    def __init__(self, engine: Engine, discrepancies: Sequence[Discrepancy] = (), *, like: ExtendedModel | None = None):
        self.engine = engine
        self._warm: WarmEngine = WarmEngine(engine, walk=False, like=like._warm if like else None)
        self._discrepancies = {d.name: d for d in discrepancies}
        curves = {d.curve: 0.0 for d in discrepancies}
        self.inputs = engine.inputs
        # what effects read beside the engine's own inputs travels along: they are looked for at fits without them
        self.optional_inputs = {**library_inputs(), **engine.optional_inputs, NUMBER: -1.0, **curves}
        self.sensors = engine.sensors
        self.parameters: dict[str, Parameter] = {
            **engine.parameters,
            **{d.name: self._parameter(d) for d in discrepancies},
        }

    def _parameter(self, d: Discrepancy) -> Parameter:
        p = self.engine.parameters[d.target]
        told, words = f"{d.target} along {d.curve}", f"{p.words} along {d.curve}"
        return Parameter(
            d.name, "discrepancy", 0.0, d.lower, d.upper, d.sigma, p.unit, told, p.component, p.quantity, words, p.part
        )

    def predict(
        self,
        inputs: Mapping[str, Any],
        parameters: Mapping[str, Any] | None = None,
        *,
        sensors: Sequence[str] | None = None,
        wrt: Sequence[str] = (),
    ) -> Any:
        """As `Engine.predict`, with discrepancies among the parameters and directions."""
        from dataclasses import replace

        given = dict(parameters or {})
        theta = {n: v for n, v in given.items() if n not in self._discrepancies}
        for name, c in given.items():
            d = self._discrepancies.get(name)
            if d is not None and c != 0.0:
                base = theta.get(d.target, self.engine.parameters[d.target].nominal)
                theta[d.target] = base + c * np.asarray(inputs[d.curve], float)
        plain = {c: v for c, v in inputs.items() if c in self.engine.inputs or c in self.engine.optional_inputs}
        targets = [self._discrepancies[n].target if n in self._discrepancies else n for n in wrt]
        along = tuple(dict.fromkeys(targets))
        p = self._warm.predict(plain, theta, sensors=sensors, wrt=along)
        if along == tuple(wrt):
            return p
        J = p.jacobian[:, :, [along.index(t) for t in targets]]
        for j, n in enumerate(wrt):
            if n in self._discrepancies:
                J[:, :, j] *= np.asarray(inputs[self._discrepancies[n].curve], float)[:, None]
        return replace(p, jacobian=J, wrt=tuple(wrt))

    @property
    def discrepancies(self) -> tuple[Discrepancy, ...]:
        return tuple(self._discrepancies.values())

    def __getattr__(self, name: str) -> Any:
        return getattr(self.engine, name)
