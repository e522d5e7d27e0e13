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
from enginediag_cli.identification.nominal import EVERYTHING, SensorQuality, sensor_quality
from enginediag_cli.identification.normal_equations import normal_equations
from enginediag_cli.mismatch.fit.evidence import Dataset, Flight
from enginediag_cli.mismatch.fit.identified import IdentifiedHypothesis, Nuisance, problem_with
from enginediag_cli.mismatch.fit.projection import Frame, nuisance_columns
from enginediag_cli.mismatch.fit.trial import HypothesisFit
from enginediag_cli.mismatch.refine.criteria import Prediction, Records
from enginediag_cli.mismatch.refine.prediction import Change

Quality = tuple[SensorQuality, ...]


@dataclass(frozen=True)
class Unseen:
    """Two models on the same unseen readings: log predictive densities (R,) of each flight, quality by sensor, and χ²
    per reading, before and after. `states`: quality before and after within each state of a hidden switch, which for
    every sensor is inferred from others."""

    labels: tuple[str, ...]
    flights_before: np.ndarray
    flights_after: np.ndarray
    quality_before: Quality
    quality_after: Quality
    chi2_before: float
    chi2_after: float
    readings: int
    lost: int  # records that one of the two models cannot compute
    states: Mapping[str, tuple[Quality, Quality]] | None = None

    @property
    def flight_gains(self) -> np.ndarray:
        return self.flights_after - self.flights_before

    @property
    def gain(self) -> float:
        """Of log predictive density, all flights together."""
        return float(self.flight_gains.sum())


def concealed(evidence: Dataset, unseen: Sequence[int]) -> Dataset:
    """The same evidence with the readings of some flights taken away; their operating points stay."""
    sensors = evidence.engine.sensors

    def without(f: Flight) -> Flight:
        return replace(f, columns={c: np.full(len(v), np.nan) if c in sensors else v for c, v in f.columns.items()})

    flights = tuple(without(f) if k in unseen else f for k, f in enumerate(evidence.flights))
    return replace(evidence, flights=flights)


def predicted(evidence: Dataset, unseen: Sequence[int], trial: HypothesisFit, along: Nuisance) -> IdentifiedHypothesis:
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
    return IdentifiedHypothesis(there, hypothesis, model, problem, fit, settled=True, rho=rho)


def compare(
    evidence: Dataset, unseen: Sequence[int], before: HypothesisFit, after: HypothesisFit, along: Nuisance
) -> tuple[Unseen, Prediction]:
    """Both trials, fitted to `concealed` evidence, on the unseen flights."""
    pair, lost = comparable(*(predicted(evidence, unseen, t, along) for t in (before, after)))
    change = Change(len(pair[0].number))
    change.add(pair, row_parts(before, pair[0]), Records.ALL)
    flight = pair[0].problem.recording
    density = [log_density(t, p, flight) for t, p in zip((before, after), pair, strict=True)]
    return unseen_of(pair, density, lost), change.judged(Records.ALL)


def comparable(
    one: IdentifiedHypothesis, other: IdentifiedHypothesis
) -> tuple[tuple[IdentifiedHypothesis, IdentifiedHypothesis], int]:
    """Both with the readings that both can compute, and the records that one of them cannot."""
    both = np.isfinite(one.fit.equations.residual) & np.isfinite(other.fit.equations.residual)
    return (only(one, both), only(other, both)), int(np.sum(one.fit.failed | other.fit.failed))


def unseen_of(
    pair: tuple[IdentifiedHypothesis, IdentifiedHypothesis],
    density: Sequence[np.ndarray],
    lost: int,
    on: np.ndarray | None = None,
) -> Unseen:
    """What two models leave of the same readings; `on` (N, m): whether a hidden switch is on there."""
    one, other = pair
    chi2 = [float(np.nanmean((p.fit.equations.residual / one.problem.sigma) ** 2)) for p in pair]
    states = {}
    for name, rows in (("on", on), ("off", None if on is None else ~on)):
        if rows is not None and (rows & np.isfinite(one.fit.equations.residual)).any():
            states[name] = _quality(one, rows), _quality(other, rows)
    whole = np.ones(one.fit.equations.residual.shape, bool)
    return Unseen(
        one.problem.labels,
        density[0],
        density[1],
        _quality(one, whole),
        _quality(other, whole),
        chi2[0],
        chi2[1],
        int(np.isfinite(one.fit.equations.residual).sum()),
        lost,
        states if on is not None else None,
    )


def _quality(p: IdentifiedHypothesis, keep: np.ndarray) -> Quality:
    e = np.where(keep, p.fit.equations.residual, np.nan)
    everything = np.full(len(e), EVERYTHING)
    return sensor_quality(p.problem.sensors, e, p.fit.equations.predicted, p.problem.sigma, everything)


def log_density(trial: HypothesisFit, there: IdentifiedHypothesis, unit: np.ndarray) -> np.ndarray:
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


def row_parts(trial: HypothesisFit, there: IdentifiedHypothesis) -> tuple[np.ndarray, np.ndarray]:
    """Whitened readings e (n,) and B (n, q) as above."""
    frame = Frame(there)
    J, offsets = nuisance_columns(there)
    free = trial.projection.free[: J.shape[2]]
    C = trial.projection.covariance()[: int(free.sum()), : int(free.sum())]
    root = np.linalg.cholesky(C + 1e-12 * np.eye(len(C)))
    e = frame.rows(there.fit.equations.residual[:, :, None])[:, 0]
    return e, np.concatenate([frame.rows(J[:, :, free]) @ root, frame.rows(offsets)], axis=1)


def only(there: IdentifiedHypothesis, keep: np.ndarray) -> IdentifiedHypothesis:
    """The same with the readings (N, m) that are kept."""
    e = there.fit.equations
    return with_residual(there, np.where(keep, e.residual, np.nan))


def with_residual(there: IdentifiedHypothesis, residual: np.ndarray) -> IdentifiedHypothesis:
    """The same with other residuals (N, m)."""
    return replace(there, fit=replace(there.fit, equations=replace(there.fit.equations, residual=residual)))
