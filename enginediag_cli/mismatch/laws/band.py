"""The curve of a law over the conditions that were flown, whatever its form: a mean of the likely ones, with its band.

    f̄ = Σ p_i f_i        σ² = Σ p_i (σ_i² + (f_i − f̄)²)        σ_i² = ∂f_i/∂c C ∂f_i/∂cᵀ

of laws i with probabilities p_i and coefficients c of covariance C. A constant belongs to what is identified: curves
are told about their means over the records. Source: J. A. Hoeting et al., Statistical Science 14 (1999) 382–417.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from enginediag_cli.engine.dual import value
from enginediag_cli.engine.term import Effect
from enginediag_cli.mismatch.fit.trial import HypothesisFit
from enginediag_cli.mismatch.laws.scan import KnownVariable, past_of
from enginediag_cli.physics.law import Law, Past

POINTS = 25
"""Of a band."""
STEP = 1e-4
"""Of a coefficient, in its standard errors' place: relative to its own size, for differences."""
EDGES = (0.02, 0.98)
"""Quantiles of a variable between which it was flown: a few records beyond them tell little."""


APART = 0.25
"""Of what a law changes in the records, by which forms must differ to have parted company."""
BEYOND, ABOVE_ZERO = 1.0, 0.05
"""How far beyond what was flown forms are followed, in ranges of the variable, which is a ratio and stays above
zero."""

Weighed = tuple[Sequence[Effect], HypothesisFit, float]
"""Laws that act together at one place, the trial that has fitted them, and their probability."""


@dataclass(frozen=True)
class Band:
    """Along the variable `of`, at values (G,) that it has in the records, `at`: `change` and `standard_error` (G,), in
    `unit`, about the mean. `parts`: the nearest values, below and above these, at which likely forms differ by APART of
    what the law changes; None where they do not as far as BEYOND."""

    of: KnownVariable
    at: np.ndarray
    change: np.ndarray
    standard_error: np.ndarray
    unit: str
    parts: tuple[float | None, float | None]


def curve_of(
    effects: Sequence[Effect], trial: HypothesisFit, known: Sequence[KnownVariable]
) -> tuple[np.ndarray, np.ndarray]:
    """Fitted laws at one place together over the fit's records (N,), about their mean, with the standard error (N,)."""
    told = trial.coefficients
    names = [e.parameter_name(c.name) for e in effects for c in e.term.COEFFICIENTS]
    c = np.array([told[n][0] for n in names])
    f = _centred(effects, known, dict(zip(names, c, strict=True)))
    steps = STEP * np.maximum(np.abs(c), STEP)
    slopes = np.stack(
        [
            (_centred(effects, known, dict(zip(names, c + d, strict=True))) - f) / s
            for s, d in zip(steps, np.diag(steps), strict=True)
        ]
    )
    C = _covariance(trial, names)
    return f, np.sqrt(np.maximum(np.einsum("in,ij,jn->n", slopes, C, slopes), 0.0))


def band_of(laws: Sequence[Weighed], known: Sequence[KnownVariable], unit: str) -> Band | None:
    """The band of laws at one place that all vary with one variable or its likes; None where one has two."""
    variables = [variables_in(effects) for effects, _, _ in laws]
    if not laws or any(len(own) != 1 for own in variables):
        return None
    of = next(k for k in known if k.variable.name in variables[0])
    p = np.array([share for _, _, share in laws])
    p = p / p.sum()
    curves = [curve_of(e, t, known) for e, t, _ in laws]
    f = np.stack([c for c, _ in curves])
    error = np.stack([s for _, s in curves])
    mean = p @ f
    sigma = np.sqrt(p @ (error**2 + (f - mean) ** 2))
    order = np.argsort(of.values)
    low, high = (int(q * (len(order) - 1)) for q in EDGES)
    rows = order[np.unique(np.linspace(low, high, POINTS).astype(int))]
    same = [w for w, own in zip(laws, variables, strict=True) if of.variable.name in own]
    return Band(of, of.values[rows], mean[rows], sigma[rows], unit, _parting(same, of, of.values[rows]))


def _parting(laws: Sequence[Weighed], of: KnownVariable, flown: np.ndarray) -> tuple[float | None, float | None]:
    """Where laws of one variable part, below and above what was flown."""
    low, high = float(flown[0]), float(flown[-1])
    reach = BEYOND * (high - low)
    below = np.linspace(low, low - reach if of.variable.recorded else max(low - reach, ABOVE_ZERO * low), POINTS)
    found: list[float | None] = []
    for x in (below, np.linspace(high, high + reach, POINTS)):
        f = np.stack([_along(e, t, of, x) for e, t, _ in laws])
        size = float(np.ptp(np.stack([_along(e, t, of, flown) for e, t, _ in laws]), axis=1).max())
        apart = np.flatnonzero(~(np.ptp(f, axis=0) <= APART * size))
        found.append(float(x[apart[0]]) if len(apart) else None)
    return found[0], found[1]


def _along(effects: Sequence[Effect], trial: HypothesisFit, of: KnownVariable, x: np.ndarray) -> np.ndarray:
    """Laws of one variable at values of it, about their mean over the records."""
    c = trial.values
    name = of.variable.name
    flown = _total(effects, {name: of.values}, c, None)
    return np.asarray(_total(effects, {name: x}, c, None) - np.nanmean(flown))


def variables_in(effects: Sequence[Effect]) -> frozenset[str]:
    """Names of the variables of laws."""
    return frozenset(n for e in effects if isinstance(e.term, Law) for n in e.term.variables)


def _centred(effects: Sequence[Effect], known: Sequence[KnownVariable], c: Mapping[str, float]) -> np.ndarray:
    f = summed(effects, known, c)
    return np.asarray(f - np.nanmean(f))


def summed(effects: Sequence[Effect], known: Sequence[KnownVariable], c: Mapping[str, float]) -> np.ndarray:
    """Σ f over the fit's records (N,), of variables known there; `c`: coefficients by parameter name."""
    return _total(effects, {k.variable.name: k.values for k in known}, c, past_of(known))


def _total(
    effects: Sequence[Effect], x: Mapping[str, np.ndarray], c: Mapping[str, float], past: Past | None
) -> np.ndarray:
    """The same at values of the variables; in equilibrium without a past."""
    total: np.ndarray = np.zeros(np.shape(next(iter(x.values()))))
    for e in effects:
        law = e.term
        assert isinstance(law, Law)
        own = {k.name: c[e.parameter_name(k.name)] for k in law.COEFFICIENTS}
        with np.errstate(all="ignore"):
            total = total + np.asarray(
                value(law.expression.evaluate({**{n: x[n] for n in law.variables}, **own}, past))
            )
    return total


def _covariance(trial: HypothesisFit, names: Sequence[str]) -> np.ndarray:
    """Of coefficients, in their units; none of those at a bound."""
    position = {n: j for j, n in enumerate(trial.found.problem.names)}
    own = [position[n] for n in names]
    free = trial.projection.free
    at = np.cumsum(free) - 1
    C = np.zeros((len(names), len(names)))
    k = [i for i, j in enumerate(own) if free[j]]
    sigma = trial.found.problem.prior_sigma
    rows = [int(at[own[i]]) for i in k]
    scale = np.array([sigma[own[i]] for i in k])
    C[np.ix_(k, k)] = trial.projection.covariance()[np.ix_(rows, rows)] * np.outer(scale, scale)
    return C
