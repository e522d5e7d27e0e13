"""A monitor that computes the effect of what is uncertain about nominal from a fit instead of from the engine.

Identification leaves dozens of parameters uncertain. Their covariance C = L Lᵀ matters only through J L, which has far
fewer directions than parameters, and which varies smoothly over the operating points: its leading directions (singular
value decomposition over the points that identification saw) are fitted once with polynomials in the engine's inputs.
Records then cost the engine's sensitivities to the monitored parameters alone. How well the fit holds is checked on
points that it has not seen; where it does not hold, the monitor stays as it was.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from itertools import combinations_with_replacement
from typing import Any

import numpy as np

from enginediag_cli.engine.model import MonitoredModel
from enginediag_cli.engine.start import StartFit, coordinates
from enginediag_cli.residuals.curvature import Curvature, curvature
from enginediag_cli.residuals.monitor import Monitor
from enginediag_cli.residuals.order_statistics import median

DEGREE = 5
"""Of the polynomial of operating points; whether it suffices is tried on points held back (TOLERANCE)."""
NEGLIGIBLE = 5e-5
"""Information per record of a direction below which it is left out: a tenth in two thousand records."""
TOLERANCE = 2e-4
"""Information per record that the fit may leave out; beyond it the engine is asked."""
LEAST_POINTS = 300
"""Fewer computed points would not hold a fit and its trial."""
POINTS = 1500
"""Drawn around the operating points seen: some times the terms of the fit."""
START_DEGREE = 12.0
"""Of the fitted start: from there the engine's own iteration needs one pass less than from its usual start."""


@dataclass(frozen=True)
class Fit:
    """Polynomial of the scaled inputs: `powers` lists the factors of each term, `coefficients` (terms, m, r)."""

    inputs: tuple[str, ...]
    centre: np.ndarray
    scale: np.ndarray
    powers: tuple[tuple[int, ...], ...]
    coefficients: np.ndarray

    def at(self, inputs: Mapping[str, np.ndarray], optional: Mapping[str, float]) -> np.ndarray:
        """Sensitivities (N, m, r) in sensor unit per unit normal."""
        X = _terms(_scaled(inputs, self.inputs, optional, self.centre, self.scale), self.powers)
        terms, m, r = self.coefficients.shape
        single = X.astype(np.float32) @ self.coefficients.reshape(terms, m * r).astype(np.float32)  # exact enough
        return single.reshape(-1, m, r).astype(float)


@dataclass(frozen=True)
class CompactMonitor(Monitor):
    """Its uncertain parameters are r unit normals `nominal.1` … whose effect `fit` gives.

    `start` gives the engine's unknowns at nominal, to begin with; `curvature` what a linear model leaves out.
    """

    fit: Fit | None = field(default=None)
    start: StartFit | None = field(default=None)
    curvature: Curvature | None = field(default=None)

    def predict(
        self, inputs: Mapping[str, np.ndarray], theta: np.ndarray, *, nuisance: bool = True, **options: Any
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray, Any]:
        """As `Monitor.predict`; the unit normals stay at 0, where nominal is."""
        assert self.fit is not None
        a, q = len(self.monitored), len(self.names) - len(self.offsets)
        if self.start is not None and "start" not in options:
            options["start"] = self.start.predict(_corrected(self.engine, self.fit.inputs, inputs)[1])
        plain = replace(self, names=(*self.monitored, *self.names[q:]))
        y, J, ok, prediction = Monitor.predict(
            plain, inputs, np.delete(theta, np.s_[a:q], axis=-1), nuisance=nuisance, **options
        )
        if nuisance:
            effect = self.fit.at(inputs, self.engine.optional_inputs)
            J = np.concatenate([J[:, :, :a], effect, J[:, :, a:]], axis=2)
        return y, J, ok, prediction


def compact(monitor: Monitor) -> Monitor:
    """The monitor with a fit in place of its uncertain parameters, or as it is where a fit would not do."""
    a, q = len(monitor.monitored), len(monitor.names) - len(monitor.offsets)
    points = _points(monitor)
    if q == a or len(points) == 0 or np.any(monitor.uncertainty[:q, q:]):
        return monitor
    names = tuple(monitor.envelope.inputs)
    inputs = {c: points[:, i] for i, c in enumerate(names)}
    _, J, ok, found = monitor.predict(inputs, monitor.theta0)
    x = getattr(found, "x", None)
    start = _fitted_start(monitor.engine, names, inputs, x, ok)
    J, points = J[ok, :, :q], points[ok]
    if len(points) < LEAST_POINTS:
        return monitor
    scale = monitor.prior_sigma[:q]
    eigenvalues, vectors = np.linalg.eigh(monitor.uncertainty[:q, :q] / scale / scale[:, None])
    effect = J @ (scale[:, None] * vectors * np.sqrt(np.maximum(eigenvalues, 0.0)))
    weight = 1 / (monitor.noise.sigma * np.sqrt(monitor.noise.inflation))
    whitened = effect * weight[:, None]
    flat = whitened[: int(np.sum(ok[: len(monitor.envelope.points)]))].reshape(-1, q)
    strength, directions = np.linalg.eigh(flat.T @ flat / len(flat) * whitened.shape[1])
    leading = directions[:, strength > NEGLIGIBLE][:, ::-1]
    effect = effect @ leading
    # far corners in which the engine hardly runs would bend the fit everywhere
    size = np.sum((effect * weight[:, None]) ** 2, axis=(1, 2))
    usual = size < 25 * median(size)
    own = np.arange(len(points))[usual] < np.sum(ok[: len(monitor.envelope.points)])
    effect, points = effect[usual], points[usual]
    x = None if x is None else x[:, ok][:, usual][:, own]
    r = effect.shape[2]
    centre, spread = points.mean(axis=0), np.maximum(points.std(axis=0), 1e-9)
    powers = tuple(p for d in range(DEGREE + 1) for p in combinations_with_replacement(range(points.shape[1]), d))
    X = _terms((points - centre) / spread, powers)
    target = (effect * weight[:, None]).reshape(len(points), -1)
    held = own & (np.arange(len(points)) % 3 == 0)
    trial = np.linalg.lstsq(X[~held], target[~held], rcond=1e-10)[0]
    error = float(np.mean(np.sum((X[held] @ trial - target[held]) ** 2, axis=1)))
    if not error < TOLERANCE:
        return monitor
    coefficients = np.linalg.lstsq(X, target, rcond=1e-10)[0].reshape(len(powers), -1, r) / weight[:, None]
    uncertainty = np.zeros((a + r + len(monitor.offsets),) * 2)
    uncertainty[range(a, a + r), range(a, a + r)] = 1.0
    uncertainty[a + r :, a + r :] = monitor.uncertainty[q:, q:]

    def joined(values: np.ndarray, between: float) -> np.ndarray:
        return np.concatenate([values[:a], np.full(r, between), values[q:]])

    return CompactMonitor(
        engine=monitor.engine,
        sensors=monitor.sensors,
        base=monitor.base,
        names=(*monitor.monitored, *(f"nominal.{i + 1}" for i in range(r)), *monitor.names[q:]),
        monitored=monitor.monitored,
        meaning=monitor.meaning,
        offsets=monitor.offsets,
        theta0=joined(monitor.theta0, 0.0),
        prior_sigma=joined(monitor.prior_sigma, 1.0),
        lower=joined(monitor.lower, -np.inf),
        upper=joined(monitor.upper, np.inf),
        uncertainty=uncertainty,
        noise=monitor.noise,
        envelope=monitor.envelope,
        nominal=monitor.nominal,
        fit=Fit(names, centre, spread, powers, coefficients),
        start=start,
        curvature=curvature(monitor, {c: points[own, i] for i, c in enumerate(names)}, x),
    )


def _fitted_start(
    engine: MonitoredModel,
    names: tuple[str, ...],
    inputs: Mapping[str, np.ndarray],
    x: np.ndarray | None,
    ok: np.ndarray,
) -> StartFit | None:
    """Unknowns x (nx, n) as a polynomial of corrected coordinates; None for a model that shows none."""
    if x is None or not hasattr(engine, "power_setting"):
        return None
    kinds, z = _corrected(engine, names, inputs)
    return StartFit.fit(kinds, z[:, ok], x[:, ok], START_DEGREE)


def _corrected(
    engine: MonitoredModel, names: tuple[str, ...], inputs: Mapping[str, np.ndarray]
) -> tuple[tuple[str, ...], np.ndarray]:
    N = len(next(iter(inputs.values())))
    values = {c: np.broadcast_to(inputs.get(c, engine.optional_inputs.get(c, 0.0)), (N,)) for c in names}
    return coordinates(getattr(engine, "power_setting"), values, N)  # noqa: B009 - not every model has one


def _points(monitor: Monitor) -> np.ndarray:
    """Operating points (n, d) drawn where records are judged: around those that identification saw, none where the
    envelope does not hold all inputs. Always the same ones."""
    envelope = monitor.envelope
    if envelope is None or any(c not in envelope.inputs for c in monitor.engine.inputs):
        return np.zeros((0, 0))
    rng = np.random.default_rng(0)
    seen = np.asarray(envelope.points)
    near = np.repeat(seen, -(-POINTS // len(seen)), axis=0)
    reach = 0.5 * envelope.threshold * np.asarray(envelope.scale)
    return np.asarray(np.concatenate([seen, near + reach * rng.uniform(-1, 1, near.shape)]))


def _scaled(
    inputs: Mapping[str, np.ndarray],
    names: tuple[str, ...],
    optional: Mapping[str, float],
    centre: np.ndarray,
    scale: np.ndarray,
) -> np.ndarray:
    N = len(next(iter(inputs.values())))
    columns = [np.broadcast_to(inputs.get(c, np.full(N, optional.get(c, 0.0))), (N,)) for c in names]
    return (np.column_stack(columns) - centre) / scale


def _terms(u: np.ndarray, powers: tuple[tuple[int, ...], ...]) -> np.ndarray:
    """Products (N, terms) of the columns of u (N, d) that each term names."""
    known: dict[tuple[int, ...], np.ndarray] = {(): np.ones(len(u))}
    for term in powers:
        if term:
            known[term] = known[term[:-1]] * u[:, term[-1]]
    return np.column_stack([known[term] for term in powers])
