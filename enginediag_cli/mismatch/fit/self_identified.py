"""A nominal state out of the very recordings that are searched, where no nominal file is given.

No flight of them is taken for clean, so noise must not be what a fit leaves: a state that switches would be counted as
noise, and hide behind it. It is read from neighbours instead, which are of one state but for the few where it changes:

    w = median |e_k − e_{k−1}|/(0.6745 √2)     v = median over short runs of the standard deviation within a run
    σ = max(stated, v, w)                      ρ = 1 − w²/σ²
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from enginediag_cli.engine.engine import Engine
from enginediag_cli.identification.identify import identify
from enginediag_cli.identification.problem import Problem, TrainingRecording
from enginediag_cli.mismatch.fit.evidence import Flight
from enginediag_cli.mismatch.fit.noise import LARGEST_RHO, LEAST_RHO

RUN = 15
"""Records of a short run: minutes of a flight, within which most runs see no change of state."""
LEAST_RUN = 5
"""Readings without which a run has no spread."""
DEVIATION = 0.6745  # median |x| of a standard normal x


@dataclass(frozen=True)
class SelfIdentified:
    """`theta0`: parameters as identified; `sigma`, `rho1`: robust noise by sensor column; `converged`: whether the
    identification did, else `theta0` is empty: the engine file's own state."""

    theta0: Mapping[str, float]
    sigma: Mapping[str, float]
    rho1: Mapping[str, float]
    converged: bool


def self_identified(engine: Engine, flights: Sequence[Flight]) -> SelfIdentified:
    """Identification of all flights together, by the engine file's own settings."""
    found = identify(engine, [TrainingRecording(f.label, f.columns) for f in flights], cross_validation=False)
    p, fit = found.problem, found.fit
    usable = found.converged or (fit.decrement < 1.0 and fit.failed.mean() < 0.1)
    sigma, rho = robust_noise(p, fit.equations.residual)
    return SelfIdentified(p.physical(fit.x) if usable else {}, sigma, rho, found.converged)


def robust_noise(problem: Problem, residual: np.ndarray) -> tuple[dict[str, float], dict[str, float]]:
    """Standard deviation and lag-1 correlation by sensor column, from residuals (N, m)."""
    same = problem.recording[1:] == problem.recording[:-1]
    run = np.concatenate([[0], np.cumsum(~same)]) * len(residual) + np.arange(len(residual)) // RUN
    sigma, rho = {}, {}
    for s, column in enumerate(problem.sensors):
        e = residual[:, s]
        step = np.abs(np.diff(e))[same]
        step = step[np.isfinite(step)]
        w = float(np.median(step)) / (DEVIATION * np.sqrt(2.0)) if step.size else 0.0
        spread = [np.std(own, ddof=1) for r in np.unique(run) if (own := _read(e[run == r])).size >= LEAST_RUN]
        total = max(float(problem.sigma[s]), float(np.median(spread)) if spread else 0.0, w)
        correlation = 1.0 - (w / total) ** 2 if step.size else 0.0
        sigma[column] = total
        rho[column] = float(np.clip(correlation, 0.0, LARGEST_RHO)) if correlation > LEAST_RHO else 0.0
    return sigma, rho


def _read(e: np.ndarray) -> np.ndarray:
    return np.asarray(e[np.isfinite(e)])
