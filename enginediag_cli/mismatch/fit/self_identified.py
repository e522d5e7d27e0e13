"""A nominal state out of the very recordings that are searched, where no nominal file is given.

It is that of `identify` on all of them, just as `-n` would bring it, of each engine by itself where there are a few:
two engines are not one, and what one of them does at a time shows the other's left-out block. Of their states the mean
counts, of their noise and errors of maps the larger. Where that does not converge, which is what a
state that switches may do to it, noise must not be what the fit leaves, or the state would hide behind it: its level
is the median error on left-out blocks; what changes from one record to the next is read from neighbours, which are of
one state but for the few where it changes:

    w = median |e_k − e_{k−1}|/(0.6745 √2)     v = median |e_k|/0.6745
    σ = max(stated, v, w)                      ρ = 1 − w²/σ²
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from enginediag_cli.engine.engine import Engine
from enginediag_cli.error_model.maps import ErrorModel
from enginediag_cli.identification.identify import identify
from enginediag_cli.identification.nominal import Nominal
from enginediag_cli.identification.problem import IdentificationProblem
from enginediag_cli.mismatch.fit.evidence import Flight, as_recordings
from enginediag_cli.mismatch.fit.noise import LEAST_RHO

LARGEST_RHO = 0.9
"""The median of neighbours knows nothing of their tails, which are heavy where power or attitude changes: a step from
one record to the next is believed to be noise up to √(1 − ρ²) = 0.44 of the level, however quiet most records are."""
SIDE_BY_SIDE = 4
"""Engines that are identified one by one at most, those of an aircraft; a fleet is identified together, which shares
the work. Judgement."""
DEVIATION = 0.6745  # median |x| of a standard normal x


@dataclass(frozen=True)
class SelfIdentified:
    """`theta0`: parameters as far as identified, empty where that ended far from any optimum: the engine file's own
    state; `sigma`, `rho1`: noise by sensor column, robust where that did not converge; `error_model` of the maps, None
    where none was found; `fitted`: the noise is what the fit left, not what it did not predict."""

    theta0: Mapping[str, float]
    sigma: Mapping[str, float]
    rho1: Mapping[str, float]
    error_model: ErrorModel | None = None
    fitted: bool = False

    @property
    def engine_values(self) -> Mapping[str, float]:
        """As of a `Nominal`."""
        return self.theta0


def self_identified(engine: Engine, flights: Sequence[Flight]) -> Nominal | SelfIdentified:
    """Identification of the flights of each engine, of a fleet together, by the engine file's own settings; none of
    them is taken for clean."""
    engines = dict.fromkeys(f.engine for f in flights)
    if not 1 < len(engines) <= SIDE_BY_SIDE:
        return _of_one(engine, flights)
    return _together([_of_one(engine, [f for f in flights if f.engine == name]) for name in engines])


def _together(found: Sequence[Nominal | SelfIdentified]) -> SelfIdentified:
    """One state and one noise for engines of one type. Amounts of map error are of curves of each engine's own, and are
    left at 0; curves are the first one's that has any."""
    values = [f.engine_values for f in found if f.engine_values]
    names = [n for n in (values[0] if values else ()) if all(n in v for v in values)]
    sensors = list(dict.fromkeys(s for f in found for s in f.sigma))
    largest = {s: max(found, key=lambda f: f.sigma.get(s, 0.0)) for s in sensors}
    maps = [f.error_model for f in found if f.error_model is not None]
    sizes = {t: max(m.sizes.get(t, 0.0) for m in maps) for m in maps for t in m.sizes}
    return SelfIdentified(
        {n: float(np.mean([v[n] for v in values])) for n in names},
        {s: f.sigma[s] for s, f in largest.items()},
        {s: f.rho1.get(s, 0.0) for s, f in largest.items()},
        replace(maps[0], sizes={t: v for t, v in sizes.items() if t in maps[0].sizes}) if maps else None,
        any(left_by_the_fit(f, sensors) for f in found),
    )


def left_by_the_fit(found: Nominal | SelfIdentified, sensors: Sequence[str]) -> bool:
    """Whether the noise of some sensor is what the fit left. What cross-validation leaves is the model's error where it
    has not seen the readings: large enough as it is."""
    if isinstance(found, SelfIdentified):
        return found.fitted
    return any(n.sigma_from not in ("stated", "cross_validation") for n in found.noise if n.sensor in sensors)


def _of_one(engine: Engine, flights: Sequence[Flight]) -> Nominal | SelfIdentified:
    found = identify(engine, as_recordings(flights))
    if found.converged:
        return found.nominal(engine.path, "", {})
    p, fit = found.problem, found.fit
    usable = fit.decrement < 1.0 and fit.failed.mean() < 0.1
    unseen = p.measured - found.cross_validation.predicted
    sigma, rho = robust_noise(p, unseen if np.isfinite(unseen).any() else fit.equations.residual)
    theta = {n: v for n, v in p.to_physical(fit.x).items() if n in engine.parameters}
    return SelfIdentified(theta if usable else {}, sigma, rho)


def robust_noise(problem: IdentificationProblem, residual: np.ndarray) -> tuple[dict[str, float], dict[str, float]]:
    """Standard deviation and lag-1 correlation by sensor column, from residuals (N, m)."""
    same = problem.recording[1:] == problem.recording[:-1]
    sigma, rho = {}, {}
    for s, column in enumerate(problem.sensors):
        e = residual[:, s]
        step = np.abs(np.diff(e))[same]
        step = step[np.isfinite(step)]
        w = float(np.median(step)) / (DEVIATION * np.sqrt(2.0)) if step.size else 0.0
        level = float(np.median(np.abs(_read(e)))) / DEVIATION if np.isfinite(e).any() else 0.0
        total = max(float(problem.sigma[s]), level, w)
        correlation = 1.0 - (w / total) ** 2 if step.size else 0.0
        sigma[column] = total
        rho[column] = float(np.clip(correlation, 0.0, LARGEST_RHO)) if correlation > LEAST_RHO else 0.0
    return sigma, rho


def _read(e: np.ndarray) -> np.ndarray:
    return np.asarray(e[np.isfinite(e)])
