"""How likely laws are that were fitted: evidence by Laplace's method, priors of place, variables and form included.

    ln B = ½ (χ²₀ − χ²) + ½ ln|C| + ln prior

with the objectives χ² of the model as it is and with the law, priors of coefficients included in these, and C the
covariance of the law's coefficients in standard deviations of their priors, everything that is identified eliminated:
what readings narrow is what a coefficient costs.
Source: R. E. Kass, A. E. Raftery, J. Am. Stat. Assoc. 90 (1995) 773–795.
"""

from __future__ import annotations

from collections.abc import Hashable, Iterable, Sequence
from typing import TypeVar

import numpy as np

from enginediag_cli.mismatch.fit.freeform import Location
from enginediag_cli.mismatch.fit.trial import HypothesisFit
from enginediag_cli.mismatch.laws.finding import Group
from enginediag_cli.mismatch.laws.scan import KnownVariable

HELD = 4.0
"""ln probability that a shape at its bound costs, −ln(0.05 · 0.4): what says the same lies within a twentieth of the
prior's standard deviation of the bound. A width that is narrower than any two records tell is no gift."""

T = TypeVar("T")


def evidence_of(base: HypothesisFit, trial: HypothesisFit, prior: float) -> float:
    """ln B of a trial against the base, of what this does not have already; `prior`: ln of that of place, variables and
    form, of all its laws."""
    position = {n: j for j, n in enumerate(trial.found.problem.names)}
    free = np.cumsum(trial.projection.free) - 1
    names = [n for n in trial.hypothesis.names if n not in base.hypothesis.names]
    own = [position[n] for n in names]
    k = [int(free[j]) for j in own if trial.projection.free[j]]
    narrowed = float(np.linalg.slogdet(trial.projection.covariance()[np.ix_(k, k)])[1]) if k else 0.0
    shapes = HELD * held(trial, names)
    return 0.5 * (base.objective - trial.objective) + 0.5 * min(narrowed, 0.0) - shapes + prior


def held(trial: HypothesisFit, names: Sequence[str]) -> int:
    """How many of these coefficients stand at a bound."""
    at_bound = dict(zip(trial.found.problem.names, trial.found.fit.at_bound, strict=True))
    return sum(bool(at_bound[n]) for n in names)


def shares(evidence: Sequence[float]) -> np.ndarray:
    """Probabilities (n,) of things of these ln evidences."""
    if not len(evidence):
        return np.zeros(0)
    w = np.exp(np.asarray(evidence) - max(evidence))
    return np.asarray(w / w.sum())


def places_of(laws: Sequence[tuple[Location, frozenset[int], float]]) -> list[tuple[Location, float]]:
    """Places with their probabilities, likeliest first."""
    return _summed((place.name, place, p) for place, _, p in laws)


def variables_of_laws(
    laws: Sequence[tuple[Location, frozenset[int], float]], known: Sequence[KnownVariable], first: Sequence[str]
) -> list[tuple[tuple[Group, ...], float]]:
    """Groups of variables with their probabilities, likeliest first; variables named `first` lead their groups."""
    return _summed((groups, groups_of(groups, known, first), p) for _, groups, p in laws)


def groups_of(groups: frozenset[int], known: Sequence[KnownVariable], first: Sequence[str] = ()) -> tuple[Group, ...]:
    """The variables of each group."""
    leading = sorted(known, key=lambda k: k.variable.name not in first)
    return tuple(tuple(k.variable for k in leading if k.group == g) for g in sorted(groups))


def _summed(of: Iterable[tuple[Hashable, T, float]]) -> list[tuple[T, float]]:
    """Things of one key with their probabilities added; each key as its first thing."""
    first: dict[Hashable, T] = {}
    total: dict[Hashable, float] = {}
    for key, thing, p in of:
        first.setdefault(key, thing)
        total[key] = total.get(key, 0.0) + p
    return sorted(((first[k], p) for k, p in total.items()), key=lambda pair: -pair[1])
