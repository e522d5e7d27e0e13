"""What a law is worth on flights that nobody has shown it, beside the true one and beside a spline.

Everything identified is fitted to the recordings that were searched; what is left of the unseen flights' true readings
y, without noise, is a model's excess, and its gain the share of what the true law takes away that it takes away too:

    E = Σ ((ŷ − y)/σ)²        gain = (E_none − E)/(E_none − E_true)

The true law has its size fitted to the same recordings; a law that was found stands as it was told. Where a model has
no prediction, it has gained nothing.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from enginediag_cli.engine.engine import Engine
from enginediag_cli.mismatch.fit.evidence import Evidence, Flight
from enginediag_cli.mismatch.fit.identified import (
    NO_HYPOTHESIS,
    Hypothesis,
    Identified,
    Nuisance,
    identify_with,
    nuisance,
    stacked,
)
from enginediag_cli.validation.blind.lowest import lowest
from enginediag_cli.validation.blind.visible import VISIBLE

NONE, FOUND, TRUE, SPLINE = "none", "found", "true", "spline"
"""Models of unseen flights."""


@dataclass(frozen=True)
class Ahead:
    """The recordings that were searched with unseen flights behind them, of which nobody has the readings; `base`: the
    fit without a law; `sets`: of each kind of unseen flights its place among the records."""

    both: Evidence
    along: Nuisance
    base: Identified
    sets: Mapping[str, slice]
    true: np.ndarray

    @staticmethod
    def of(searched: Evidence, unseen: Mapping[str, Sequence[Flight]]) -> Ahead:
        """`unseen`: flights with their true readings, by kind."""
        sensors = list(searched.noise.sigma)
        flights = [f for own in unseen.values() for f in own]
        blind = [
            replace(f, columns={c: np.full_like(v, np.nan) if c in sensors else v for c, v in f.columns.items()})
            for f in flights
        ]
        both = replace(searched, flights=(*searched.flights, *blind))
        sets, first = {}, searched.records
        for name, own in unseen.items():
            n = sum(map(len, own))
            sets[name] = slice(first, first + n)
            first += n
        along = nuisance(both)
        base = identify_with(both, NO_HYPOTHESIS, along)
        true = np.concatenate([np.column_stack([f.columns[c] for c in base.problem.sensors]) for f in flights])
        return Ahead(both, along, base, sets, true)

    def squares(self, hypothesis: Hypothesis = NO_HYPOTHESIS, engine: Engine | None = None) -> np.ndarray | None:
        """((ŷ − y)/σ)² of each unseen record (n,), summed over sensors, NaN without a prediction; None where the fit
        does not converge. `engine`: one that carries more than that of the evidence."""
        both = self.both if engine is None else replace(self.both, engine=engine)
        plain = hypothesis is NO_HYPOTHESIS and engine is None
        fit = self.base if plain else lowest(both, hypothesis, self.along, self.base, 0.0)
        if not fit.converged:
            return None
        last = len(self.true)
        curves = {**self.along.curves, **fit.hypothesis.curves}
        inputs = {c: stacked(both, c) for c in fit.model.inputs}
        inputs |= {c: stacked(both, c, d) for c, d in fit.model.optional_inputs.items() if c not in curves}
        now = {c: v[-last:] for c, v in {**inputs, **curves}.items()}
        p = fit.model.predict(now, fit.theta, sensors=fit.problem.sensors)
        squares = np.sum(((p.y - self.true) / fit.problem.sigma) ** 2, axis=1)
        return np.asarray(np.where(p.ok, squares, np.nan))

    def excess(self, models: Mapping[str, np.ndarray | None]) -> dict[str, dict[str, float]]:
        """E of each model by kind of unseen flights. A model without a fit, or without a prediction of a record, has
        what no law has there; what no law or the true one cannot predict is left out."""
        none, true = models[NONE], models[TRUE]
        if none is None or true is None:
            return {}
        judged = np.isfinite(none) & np.isfinite(true)
        first = self.both.records - len(self.true)
        found: dict[str, dict[str, float]] = {}
        for name, rows in self.sets.items():
            own = np.zeros(len(none), bool)
            own[rows.start - first : rows.stop - first] = True
            keep = own & judged
            if keep.any():
                found[name] = {
                    model: float(np.sum(np.where(np.isfinite(e), e, none)[keep]) if e is not None else none[keep].sum())
                    for model, e in models.items()
                }
        return found


def gain(excess: Mapping[str, float], model: str) -> float | None:
    """Relative to the true law; None where that has too little to gain."""
    most = excess[NONE] - excess[TRUE]
    return (excess[NONE] - excess[model]) / most if most >= VISIBLE else None


def worse(excess: Mapping[str, float], model: str) -> bool:
    """Whether the model predicts worse than no law at all; where no law has nothing to gain, worse by as much as would
    be seen."""
    allowed = 0.0 if gain(excess, model) is not None else VISIBLE
    return excess[model] > excess[NONE] + allowed
