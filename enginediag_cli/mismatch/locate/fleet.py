"""Engines of a fleet beside each other: which one is worn, and whether all of them show the same mismatch.

A part of one engine that is worn is constant in time and condition: identification takes it up as that engine's
health, so it is no mismatch. Engines of a fleet differ a little in every part; wear is what stands out of that. Of an
engine's parameters less the mean of the others', with mean m, covariance V and prior covariance V₀ when all else is
marginalised,

    s = V⁻¹m    I = V⁻¹ − V₀⁻¹                      what the readings say
    ln L(τ) = ½ sᵀ(I + (τ²D)⁻¹)⁻¹s − ½ ln|1 + τ²DI|     natural scatter τ of the other engines, its upper limit
    s' = s − I(I + (τ²D)⁻¹)⁻¹s,  I' = I − I(I + (τ²D)⁻¹)⁻¹I,  T_j = s'_j²/I'_jj   parameter j beyond that scatter

with D the variance of the differences if every engine scattered by the prior's standard deviation.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy import stats

from enginediag_cli.mismatch.fit.families import Sums, grid
from enginediag_cli.mismatch.fit.freeform import Cell
from enginediag_cli.mismatch.fit.projection import Projection

LEAST_ENGINES = 4
"""With fewer, wear of one cannot be told from the scatter of all."""

SCATTERS = np.geomspace(0.003, 3.0, 40)
"""Scatter τ between engines that is tried, in prior standard deviations: from nothing visible to three times what is
plausible."""
WITHIN = 1.92  # ½ · 3.84: half the χ² of a 95 % interval


@dataclass(frozen=True)
class Difference:
    """The change of one parameter that makes an engine stand out of its fleet most: `value` ± `standard_error` in the
    parameter's unit, natural scatter included; `p` is adjusted for all engines and parameters."""

    engine: str
    parameter: str
    value: float
    standard_error: float
    statistic: float
    p: float


def differences(projection: Projection) -> list[Difference]:
    """Every engine's most outstanding change, largest statistic first; [] for a fleet of fewer than LEAST_ENGINES.

    Only the first is to be believed: the others are held against a mean that the first is part of.
    """
    engines = projection.found.evidence.engines
    if len(engines) < LEAST_ENGINES:
        return []
    found = []
    for name in engines:
        rest = [e for e in engines if e != name]
        told = _told(projection, name, rest)
        if not told.names:
            return []
        scatter = _scatter([_told(projection, other, [e for e in rest if e != other]) for other in rest])
        s, information = told.beyond(scatter)
        T = s**2 / np.diag(information)
        j = int(T.argmax())
        p = min(1.0, len(engines) * len(T) * float(stats.chi2.sf(T[j], 1)))
        I_j = float(information[j, j])
        found.append(Difference(name, told.names[j], float(s[j] / I_j), float(I_j**-0.5), float(T[j]), p))
    return sorted(found, key=lambda d: -d.statistic)


@dataclass(frozen=True)
class _Told:
    """What the readings say about one engine's parameters (q,) against the mean of others'."""

    names: list[str]
    s: np.ndarray
    information: np.ndarray
    D: np.ndarray

    def _inner(self, scatter: float) -> np.ndarray:
        return np.asarray(self.information + np.diag(1.0 / (scatter**2 * self.D)))

    def likelihood(self, scatter: float) -> float:
        """ln L(τ)."""
        inner = self._inner(scatter)
        _, determinant = np.linalg.slogdet(inner * (scatter**2 * self.D))
        return float(0.5 * self.s @ np.linalg.solve(inner, self.s) - 0.5 * determinant)

    def beyond(self, scatter: float) -> tuple[np.ndarray, np.ndarray]:
        """s' (q,) and I' (q, q)."""
        inner = self._inner(scatter)
        return (
            self.s - self.information @ np.linalg.solve(inner, self.s),
            self.information - self.information @ np.linalg.solve(inner, self.information),
        )


def _scatter(others: Sequence[_Told]) -> float:
    """Natural scatter τ of engines of which none is worn: the upper limit of 97.5 %, since few engines tell little."""
    ln_L = np.array([sum(o.likelihood(float(t)) for o in others) for t in SCATTERS])
    return float(SCATTERS[np.flatnonzero(ln_L > ln_L.max() - WITHIN)[-1]])


def _told(projection: Projection, name: str, others: Sequence[str]) -> _Told:
    m, V, V0, D, names = _contrast(projection, name, others)
    if not names:
        return _Told([], m, V, D)
    # parameters that the readings say nothing about leave V at V₀: the inverse is of the scaled matrix
    root = np.sqrt(V0)
    values, vectors = np.linalg.eigh(V / np.outer(root, root))
    values = np.clip(values, 1e-12, 1.0 - 1e-9)
    scaled = vectors / root[:, None]
    information = (scaled * (1.0 / values - 1.0)) @ scaled.T
    return _Told(names, (scaled / values) @ scaled.T @ m, information, D)


def _contrast(
    projection: Projection, name: str, others: Sequence[str]
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray, list[str]]:
    """Mean (q,), covariance (q, q) and prior variance (q,) of one engine's parameters less the mean of others', and
    their variance (q,) if engines scatter by one prior standard deviation."""
    found = projection.found
    engines, problem = found.evidence.engines, found.problem
    free = np.cumsum(projection.free) - 1
    at = {n: int(free[j]) for j, n in enumerate(problem.names) if projection.free[j]}
    scale = {n: float(problem.prior_sigma[j]) for j, n in enumerate(problem.names)}
    covariance, theta = projection.covariance(), found.theta
    targets = list(dict.fromkeys(n.partition("|")[0] for n in problem.names if "|engine " in n))
    targets = [t for t in targets if all(f"{t}|engine {e}" in at for e in engines[1:])]
    # engine 0 is the reference, whose own value is 0
    w = np.array([1.0 if e == name else -1.0 / len(others) if e in others else 0.0 for e in engines])
    own = [[f"{t}|engine {e}" for e in engines[1:]] for t in targets]
    A = np.zeros((len(targets), len(covariance)))
    for j, names in enumerate(own):
        A[j, [at[n] for n in names]] = w[1:] * [scale[n] for n in names]
    m = np.array([w[1:] @ [theta[n] for n in names] for names in own])
    D = np.array([scale[names[0]] ** 2 for names in own]) * (w @ w)
    return m, A @ covariance @ A.T, (A**2).sum(axis=1), D, targets


@dataclass(frozen=True)
class PerEngine:
    """A cell fitted to each engine by itself: statistics by engine, χ² of the differences between the engines'
    coefficients and its p."""

    statistics: dict[str, float]
    between: float
    p: float


def per_engine(projection: Projection, cell: Cell) -> PerEngine | None:
    """Whether the engines agree on a cell's coefficients; None for a single engine.

    With one coefficient vector per engine instead of one for all, χ² falls further by `between`, which has as many
    degrees of freedom as coefficients were added.
    """
    found = projection.found
    evidence = found.evidence
    engines = evidence.engines
    if len(engines) < 2:
        return None
    of_flight = np.array([engines.index(f.engine) for f in evidence.flights])
    engine_of = of_flight[found.problem.recording]
    parts = cell.location.parts
    q = cell.curves.shape[1] // len(parts)  # both quantities of a machine have the same curves
    own = [np.where((engine_of == k)[:, None], cell.curves[:, :q], 0.0) for k in range(len(engines))]
    curves = np.concatenate(own, axis=1)
    everything = range(curves.shape[1])
    pairs = [(0, 1)] if len(parts) == 2 else []
    sums = Sums(projection, cell.sums.columns, grid([p.parameter for p in parts], curves, [everything], pairs))
    candidates = np.array([[t, c] for t in range(len(parts)) for c in everything])
    alone = {e: sums.score(candidates[candidates[:, 1] // q == k]).statistic for k, e in enumerate(engines)}
    lengths = sums.lengths[candidates[:, 0], candidates[:, 1]]
    together = sums.score(candidates[np.argsort(-lengths, kind="stable")])
    between, dof = together.statistic - cell.score.statistic, together.dof - cell.score.dof
    return PerEngine(alone, between, float(stats.chi2.sf(max(between, 0.0), dof)) if dof > 0 else 1.0)
