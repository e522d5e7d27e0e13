"""How well a model that was fitted to some flights predicts others, which it has not seen.

The flights to be predicted stand in the evidence with their readings taken away, so that the curves of the
model-error floor are the same for both. With the fit's posterior N(θ̂, C) of what was identified, and offsets of
the unseen recording itself by their prior, the whitened readings e of a flight are predicted as N(0, V):

    V = 1 + B Bᵀ      B = [J C^½, offsets]      ℓ = −½ (eᵀV⁻¹e + ln det V + Σ ln 2πσ²(1 − ρ²))

Source: A. Gelman, J. Hwang and A. Vehtari, "Understanding predictive information criteria for Bayesian models",
Stat. Comput. 24 (2014) 997–1016, section 2 (the log predictive density of data held out).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from enginediag_cli.identification.gauss_newton import Fit
from enginediag_cli.identification.normal_equations import normal_equations
from enginediag_cli.identification.quality import SensorQuality, sensor_quality
from enginediag_cli.mismatch.fit.evidence import Evidence, Flight
from enginediag_cli.mismatch.fit.identified import Identified, Nuisance, problem_with
from enginediag_cli.mismatch.fit.projection import Frame, nuisance_columns
from enginediag_cli.mismatch.fit.trial_fit import Trial

FEW_FLIGHTS = 5
"""With fewer unseen flights than this each is cut into BLOCKS runs of records, which are then compared instead."""

BLOCKS = 8
"""Runs of a flight: long enough to be nearly independent, enough of them for a signed-rank test."""


@dataclass(frozen=True)
class Unseen:
    """Two models on the same unseen readings: log predictive densities (R,) of each flight and (U,) of each unit of
    comparison, quality by sensor, and χ² per reading, before and after."""

    labels: tuple[str, ...]
    flights_before: np.ndarray
    flights_after: np.ndarray
    units_before: np.ndarray
    units_after: np.ndarray
    unit: str  # "flight" or "run of records"
    quality_before: tuple[SensorQuality, ...]
    quality_after: tuple[SensorQuality, ...]
    chi2_before: float
    chi2_after: float
    readings: int
    lost: int  # records that one of the two models cannot compute
    states: Mapping[str, tuple[float, float, int]] | None = None  # of a hidden switch: χ² per reading and readings

    @property
    def flight_gains(self) -> np.ndarray:
        return self.flights_after - self.flights_before

    @property
    def unit_gains(self) -> np.ndarray:
        return self.units_after - self.units_before


def concealed(evidence: Evidence, unseen: Sequence[int]) -> Evidence:
    """The same evidence with the readings of some flights taken away; their operating points stay."""
    sensors = evidence.engine.sensors

    def without(f: Flight) -> Flight:
        return replace(f, columns={c: np.full(len(v), np.nan) if c in sensors else v for c, v in f.columns.items()})

    flights = tuple(without(f) if k in unseen else f for k, f in enumerate(evidence.flights))
    return replace(evidence, flights=flights)


def predicted(evidence: Evidence, unseen: Sequence[int], trial: Trial, along: Nuisance) -> Identified:
    """The trial's fit put to the unseen flights of the evidence (with their readings), nothing estimated."""
    starts = np.cumsum([0, *(len(next(iter(f.columns.values()))) for f in evidence.flights)])
    rows = np.concatenate([np.arange(starts[k], starts[k + 1]) for k in unseen])
    there = evidence.only(list(unseen))
    hypothesis = trial.hypothesis
    hypothesis = replace(hypothesis, curves={k: v[rows] for k, v in hypothesis.curves.items()})
    nuisance = Nuisance(along.sigma, along.discrepancies, {k: v[rows] for k, v in along.curves.items()})
    model, problem, rho = problem_with(there, hypothesis, nuisance)
    z = np.zeros((len(problem.labels), len(problem.offsets)))
    equations = normal_equations(problem, trial.found.fit.x, z)
    fit = Fit(trial.found.fit.x, z, equations, trial.found.fit.at_bound, True, "", ())
    return Identified(there, hypothesis, model, problem, fit, settled=True, rho=rho)


def compare(evidence: Evidence, unseen: Sequence[int], before: Trial, after: Trial, along: Nuisance) -> Unseen:
    """Both trials, fitted to `concealed` evidence, on the unseen flights."""
    pair = [predicted(evidence, unseen, t, along) for t in (before, after)]
    both = np.isfinite(pair[0].fit.equations.residual) & np.isfinite(pair[1].fit.equations.residual)
    lost = int(np.sum(pair[0].fit.failed | pair[1].fit.failed))
    pair = [_only(p, both) for p in pair]
    flight = pair[0].problem.recording
    unit, name = (flight, "flight") if len(unseen) >= FEW_FLIGHTS else (_runs(flight), "run of records")
    density = [[log_density(t, p, u) for u in (flight, unit)] for t, p in zip((before, after), pair, strict=True)]
    sigma = pair[1].problem.sigma
    quality, chi2 = [], []
    for p in pair:
        e = p.fit.equations.residual
        quality.append(sensor_quality(p.problem.sensors, e, p.fit.equations.predicted, sigma, np.full(len(e), "all")))
        chi2.append(float(np.nanmean((e / sigma) ** 2)))
    return Unseen(
        pair[0].problem.labels,
        density[0][0],
        density[1][0],
        density[0][1],
        density[1][1],
        name,
        quality[0],
        quality[1],
        chi2[0],
        chi2[1],
        int(both.sum()),
        lost,
    )


def log_density(trial: Trial, there: Identified, unit: np.ndarray) -> np.ndarray:
    """ℓ (U,) of each unit of the records; `unit` (N,) is the number of each record's, from 0."""
    frame = Frame(there)
    e, B = row_parts(trial, there)
    rho = frame.correlation()
    scale = np.broadcast_to(np.log(frame.sigma), rho.shape) + 0.5 * np.log1p(-(rho**2))
    scale = scale[frame.keep] + 0.5 * np.log(2.0 * np.pi)
    result = []
    for u in range(int(unit.max()) + 1):
        rows = unit[frame.record] == u
        b = B[rows]
        inner = np.eye(b.shape[1]) + b.T @ b
        w = b.T @ e[rows]
        chi2 = e[rows] @ e[rows] - w @ np.linalg.solve(inner, w)
        result.append(-0.5 * (chi2 + np.linalg.slogdet(inner)[1]) - scale[rows].sum())
    return np.array(result)


def row_parts(trial: Trial, there: Identified) -> tuple[np.ndarray, np.ndarray]:
    """Whitened readings e (n,) and B (n, q) as above."""
    frame = Frame(there)
    J, offsets = nuisance_columns(there)
    free = trial.projection.free[: J.shape[2]]
    C = trial.projection.covariance()[: int(free.sum()), : int(free.sum())]
    root = np.linalg.cholesky(C + 1e-12 * np.eye(len(C)))
    e = frame.rows(there.fit.equations.residual[:, :, None])[:, 0]
    return e, np.concatenate([frame.rows(J[:, :, free]) @ root, frame.rows(offsets)], axis=1)


def _only(there: Identified, keep: np.ndarray) -> Identified:
    e = there.fit.equations
    equations = replace(e, residual=np.where(keep, e.residual, np.nan))
    return replace(there, fit=replace(there.fit, equations=equations))


def _runs(flight: np.ndarray) -> np.ndarray:
    """Each flight cut into BLOCKS runs of consecutive records, numbered through."""
    unit = np.zeros(len(flight), int)
    first = 0
    for f in np.unique(flight):
        rows = np.flatnonzero(flight == f)
        count = min(BLOCKS, len(rows))
        unit[rows] = first + np.arange(len(rows)) * count // len(rows)
        first += count
    return unit
