"""What an explanation is worth on the flights that were held back, beside the true one.

Everything identified is fitted to the training flights alone; the readings of the held-back flights are then
predicted, their χ² per reading compared flight by flight with that of the model as it was.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from enginediag_cli.mismatch.fit.evidence import Evidence, Flight
from enginediag_cli.mismatch.fit.identified import NO_HYPOTHESIS, Identified, Nuisance, identify_with, nuisance, stacked
from enginediag_cli.validation.blind.causes import Begun, hypothesis, key


@dataclass(frozen=True)
class HeldBack:
    """χ² per reading of every held-back flight (F,) with the model as it was, with what was named, with the truth;
    NaN where a fit did not converge."""

    before: np.ndarray
    after: np.ndarray
    true: np.ndarray


def held_back(evidence: Evidence, held: Sequence[Flight], named: Begun, truth: Begun) -> HeldBack:
    """`evidence` are the training flights as the explainer had them, `held` the others."""
    sensors = list(evidence.noise.sigma)
    blind = [
        replace(f, columns={c: np.full_like(v, np.nan) if c in sensors else v for c, v in f.columns.items()})
        for f in held
    ]
    both = replace(evidence, flights=(*evidence.flights, *blind))
    records = sum(len(f.columns["time_s"]) for f in both.flights)
    along = nuisance(both)
    base = identify_with(both, NO_HYPOTHESIS, along)
    before = _misfit(both, base, along, held)
    found = {key(()): before}
    for causes, values in (named, truth):
        if key(causes) not in found:
            fit = identify_with(both, hypothesis(both.engine, causes, records, values), along, base)
            found[key(causes)] = _misfit(both, fit, along, held)
    return HeldBack(before, found[key(named[0])], found[key(truth[0])])


def _misfit(both: Evidence, fit: Identified, along: Nuisance, held: Sequence[Flight]) -> np.ndarray:
    """χ² per reading of each held-back flight."""
    if not fit.converged:
        return np.full(len(held), np.nan)
    curves = {**along.curves, **fit.hypothesis.curves}
    inputs = {c: stacked(both, c) for c in fit.model.inputs}
    inputs |= {c: stacked(both, c, d) for c, d in fit.model.optional_inputs.items() if c not in curves}
    sizes = [len(f.columns["time_s"]) for f in held]
    last = sum(sizes)
    p = fit.model.predict(
        {c: v[-last:] for c, v in {**inputs, **curves}.items()}, fit.theta, sensors=fit.problem.sensors
    )
    y = np.where(p.ok[:, None], p.y, np.nan)
    result, start = [], 0
    for f, n in zip(held, sizes, strict=True):
        read = np.column_stack([f.columns[c] for c in fit.problem.sensors])
        e = (read - y[start : start + n]) / fit.problem.sigma
        result.append(float(np.nanmean(e**2)))
        start += n
    return np.array(result)
