"""A concealed law: where it acts, what it varies with, by how much, and its curve over records."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from enginediag_cli.engine.dual import value
from enginediag_cli.engine.engine import Engine
from enginediag_cli.engine.term import Effect
from enginediag_cli.mismatch.fit.freeform import Location
from enginediag_cli.physics.laws.law import Law, Variable

Columns = Mapping[str, np.ndarray]


@dataclass(frozen=True)
class LawTruth:
    """`effect`: the law with its size; `place`: where it acts; `form`, `outside`: by name, and whether no grammar holds
    it; `higher`: inputs of flights four kilometres above the others, `at_ceiling`: share of their records that the
    engine's envelope keeps lower."""

    effect: Effect
    place: Location
    form: str
    outside: bool
    higher: tuple[Columns, ...] = ()
    at_ceiling: float = 0.0

    @property
    def law(self) -> Law:
        return law_of(self.effect)

    @property
    def values(self) -> dict[str, float]:
        """Its size by the name of the parameter."""
        return {self.effect.parameter_name(c): v for c, v in self.effect.values.items()}


def law_of(effect: Effect) -> Law:
    """The law that an effect is. Raises TypeError for any other effect."""
    if not isinstance(effect.term, Law):
        raise TypeError(f"{effect.label} is no law")
    return effect.term


def along(engine: Engine, inputs: Columns, theta: Mapping[str, Any], of: Sequence[Variable]) -> dict[str, np.ndarray]:
    """Values (N,) of variables at operating points of an engine, by name; NaN where it has no solution."""
    columns = tuple(dict.fromkeys(c for v in of if not v.recorded for c in v.columns))
    at: dict[str, np.ndarray] = {c: np.asarray(x, float) for c, x in inputs.items()}
    n = len(next(iter(at.values())))
    if columns:
        known = {c: x for c, x in inputs.items() if c in engine.inputs or c in engine.optional_inputs}
        own = {k: v for k, v in theta.items() if k in engine.parameters}
        p = engine.predict(known, own, sensors=(), also=columns)
        at |= dict(zip(columns, np.where(p.ok[:, None], p.also, np.nan).T, strict=True))
    return {v.name: np.broadcast_to(v.values(at), (n,)) for v in of}


def curve(effect: Effect, values: Mapping[str, np.ndarray]) -> np.ndarray:
    """f (N,) of a law where its variables have these values."""
    law = law_of(effect)
    numbers = {c.name: effect.values.get(c.name, c.absent) for c in law.COEFFICIENTS}
    n = len(next(iter(values.values()))) if values else 1
    with np.errstate(all="ignore"):
        f = np.asarray(value(law.expression.at({**{k: values[k] for k in law.variables}, **numbers})), float)
    return np.broadcast_to(f, (n,))
