"""A monitor that computes the effect of what is uncertain about nominal from a fit instead of from the engine.

The effect J L of the unit normals of `reduced.py` varies smoothly over the operating points: its leading directions
(over the points that identification saw) are fitted once with polynomials in the engine's inputs. Records then cost the
engine's sensitivities to the monitored parameters alone; the fit costs as much as a few thousand records. How well it
holds is checked on points that it has not seen; where it does not hold, the engine is asked.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from itertools import combinations_with_replacement
from typing import Any

import numpy as np

from enginediag_cli.engine.start import StartFit, coordinates
from enginediag_cli.engine.wrapped import MonitoredModel
from enginediag_cli.error_model.maps import MapErrorModel
from enginediag_cli.residuals.distributions import median
from enginediag_cli.residuals.monitor import Monitor
from enginediag_cli.residuals.reduced import (
    ReducedMonitor,
    amount_rows,
    covariance_root,
    effects_elsewhere,
    in_normals,
    leading_directions,
    noise_weight,
    reduced,
)

DEGREE = 6
"""Of the polynomial of operating points in corrected coordinates; whether it suffices is tried on points held back
(TOLERANCE)."""
TOLERANCE = 5e-4
"""Information per record that the fit may leave out, half a unit of χ² in a thousand records; beyond it the engine is
asked."""
LEAST_POINTS = 300
"""Fewer computed points would not hold a fit and its trial."""
POINTS = 1500
"""Drawn around the operating points seen: some times the terms of the fit."""
START_DEGREE = 12.0
"""Of the fitted start: from there the engine's own iteration needs one pass less than from its usual start."""


@dataclass(frozen=True)
class Fit:
    """Polynomial of the scaled coordinates of operating points: `powers` lists the factors of each term,
    `coefficients` (terms, m, r); inputs: the columns that `_coordinates` takes."""

    inputs: tuple[str, ...]
    centre: np.ndarray
    scale: np.ndarray
    powers: tuple[tuple[int, ...], ...]
    coefficients: np.ndarray

    def terms(self, coordinates: np.ndarray) -> np.ndarray:
        """Values (N, terms) of the terms at operating points (N, d), in single precision."""
        return _terms((coordinates - self.centre) / self.scale, self.powers).astype(np.float32)

    def of(self, terms: np.ndarray) -> np.ndarray:
        """What it gives (N, m, r) for `terms` (N, terms): sensitivities in sensor unit per unit normal; in single
        precision, which is exact enough."""
        _, m, r = self.coefficients.shape
        return np.asarray((terms @ self._single).reshape(-1, m, r))

    @cached_property
    def _single(self) -> np.ndarray:
        return self.coefficients.reshape(len(self.coefficients), -1).astype(np.float32)


@dataclass(frozen=True)
class MapsFit:
    """Errors of maps of each record: `fit` gives the K frozen columns `names` that fix them, of which come the effects
    of the amounts; root (k, r): a step of one in each unit normal, in amounts."""

    names: tuple[str, ...]
    fit: Fit
    root: np.ndarray

    def frozen(self, terms: np.ndarray) -> dict[str, np.ndarray]:
        """Frozen columns (N,) by name for terms (N, terms) of the polynomials."""
        return dict(zip(self.names, self.fit.of(terms)[:, 0].T.astype(float), strict=True))


@dataclass(frozen=True)
class CompactMonitor(ReducedMonitor):
    """`fit` gives the effect of its unit normals but for the errors of maps, which come of a step of `maps.root` in
    each amount; `start` gives the engine's unknowns at nominal, to begin with. Where training has not been the engine
    is asked: a polynomial says nothing there."""

    fit: Fit | None = field(default=None)
    start: StartFit | None = field(default=None)
    maps: MapsFit | None = field(default=None)

    def predict(
        self, inputs: Mapping[str, np.ndarray], theta: np.ndarray, *, nuisance: bool = True, **options: Any
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray, Any]:
        """As `Monitor.predict`; the unit normals stay at 0, where nominal is."""
        assert self.fit is not None
        a, q = len(self.monitored), self.inner
        at = _coordinates(self.engine, self.fit.inputs, inputs)
        if self.start is not None and "start" not in options:
            options["start"] = self.start.predict(at.T)
        # a window that is re-estimated comes back with its frozen columns and asks for nothing uncertain
        unfixed = self.maps is not None and self.maps.names[0] not in inputs
        beyond = np.asarray(self.envelope.outside(inputs)) if nuisance or unfixed else np.zeros(len(at), bool)
        terms = self.fit.terms(at) if nuisance or unfixed else np.empty((0, 0))
        if unfixed and self.maps is not None and isinstance(self.engine, MapErrorModel):
            frozen = self.maps.frozen(terms)
            if beyond.any():
                near = {} if options.get("start") is None else {"start": options["start"][:, beyond]}
                here = {c: np.asarray(v)[beyond] for c, v in inputs.items()}
                exact = self.engine.frozen(here, self.sensors, **near)
                for name, values in exact.items():
                    frozen[name][beyond] = values
            inputs = {**inputs, **frozen}
        plain = replace(self, names=(*self.monitored, *self.names[q:]))
        y, J, ok, prediction = Monitor.predict(
            plain, inputs, np.delete(theta, np.s_[a:q], axis=-1), nuisance=nuisance, **options
        )
        if nuisance:
            whole = np.empty((*J.shape[:2], J.shape[2] + q - a))
            whole[:, :, :a], whole[:, :, a:q], whole[:, :, q:] = J[:, :, :a], self.fit.of(terms), J[:, :, a:]
            J, effect = whole, whole[:, :, a:q]
            if self.maps is not None and isinstance(self.engine, MapErrorModel):
                effect += self.engine.effects_along(inputs, self.sensors, self.maps.root)
            if beyond.any():
                here = {c: np.asarray(v)[beyond] for c, v in inputs.items()}
                there = theta if theta.ndim == 1 else theta[beyond]
                x = getattr(prediction, "x", None)
                near = {} if x is None else {"start": x[:, beyond]}
                effect[beyond] = ReducedMonitor.predict(self, here, there, **near)[1][:, :, a:q]
        return y, J, ok, prediction


def is_smooth(monitor: Monitor) -> bool:
    """Whether a fit over the operating points stands for what is uncertain about nominal."""
    return isinstance(compact(monitor), CompactMonitor)


def compact(monitor: Monitor, exact: Monitor | None = None) -> Monitor:
    """The monitor with a fit in place of its uncertain parameters; as it is where a fit would not do, or where there is
    nothing to replace. exact: the reduced monitor, where it is known."""
    exact = exact or reduced(monitor)
    if not isinstance(exact, ReducedMonitor):
        return monitor
    points = _points(monitor)
    names = tuple(monitor.envelope.inputs)
    inputs = {c: points[:, i] for i, c in enumerate(names)}
    _, J, ok, found = monitor.predict(inputs, monitor.theta0)
    start = _fitted_start(monitor.engine, names, inputs, getattr(found, "x", None), ok)
    own = len(monitor.envelope.points)
    columns: dict[str, np.ndarray] = dict(getattr(found, "frozen", {}))
    J, points = J[ok], points[ok]
    if len(points) < LEAST_POINTS:
        return monitor
    seen = np.arange(len(points)) < np.sum(ok[:own])
    root, weight = covariance_root(monitor), noise_weight(monitor)
    elsewhere = effects_elsewhere(monitor, {c: v[:own] for c, v in columns.items()}, ok[:own], root)
    root = root @ leading_directions([(J @ root)[seen], *elsewhere], weight)
    # errors of maps bend more than polynomials of this degree: theirs is computed of each record
    amounts = amount_rows(monitor)
    if elsewhere:
        J[:, :, amounts] = 0.0
    effect = J @ root
    # far corners in which the engine hardly runs would bend the fit everywhere
    size = np.sum((effect * weight[:, None]) ** 2, axis=(1, 2))
    usual = size < 25 * median(size)
    effect, points, seen = effect[usual], points[usual], seen[usual]
    r = effect.shape[2]
    points = _coordinates(monitor.engine, names, {c: points[:, i] for i, c in enumerate(names)})
    centre, spread = points.mean(axis=0), np.maximum(points.std(axis=0), 1e-9)
    powers = tuple(p for d in range(DEGREE + 1) for p in combinations_with_replacement(range(points.shape[1]), d))
    X = _terms((points - centre) / spread, powers)
    target = (effect * weight[:, None]).reshape(len(points), -1)
    held = seen & (np.arange(len(points)) % 3 == 0)
    taken = np.column_stack([v[ok][usual] for v in columns.values()]) if elsewhere else np.empty((len(X), 0))
    both = np.hstack([target, taken])
    k = target.shape[1]
    trial = X[held] @ np.linalg.lstsq(X[~held], both[~held], rcond=1e-10)[0]
    error = (trial - both[held])[:, :k].reshape(held.sum(), -1, r)
    if elsewhere and isinstance(monitor.engine, MapErrorModel):
        fitted, true = (dict(zip(columns, v[:, k:].T, strict=True)) for v in (trial, both[held]))
        missed = monitor.engine.effects(fitted, monitor.sensors) - monitor.engine.effects(true, monitor.sensors)
        error = error + missed @ root[amounts] * weight[:, None]
    if not np.mean(np.sum(error**2, axis=(1, 2))) < TOLERANCE:
        return monitor
    whole = np.linalg.lstsq(X, both, rcond=1e-10)[0]
    fit = Fit(names, centre, spread, powers, whole[:, :k].reshape(len(powers), -1, r) / weight[:, None])
    maps = MapsFit(tuple(columns), replace(fit, coefficients=whole[:, None, k:]), root[amounts]) if elsewhere else None
    normals = {**in_normals(monitor, r), "curvature": exact.curvature, "whole": monitor, "root": root}
    return CompactMonitor(**normals, fit=fit, start=start, maps=maps)


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
    return StartFit.fit(
        _corrected(engine, names, inputs)[0], _coordinates(engine, names, inputs)[ok].T, x[:, ok], START_DEGREE
    )


def _coordinates(engine: MonitoredModel, names: tuple[str, ...], inputs: Mapping[str, np.ndarray]) -> np.ndarray:
    """Operating points (N, d) in coordinates in which an engine is smooth: corrected, where it says by what it is set;
    else its inputs."""
    if hasattr(engine, "power_setting"):
        return _corrected(engine, names, inputs)[1].T
    N = len(next(iter(inputs.values())))
    optional = engine.optional_inputs
    return np.column_stack([np.broadcast_to(inputs.get(c, np.full(N, optional.get(c, 0.0))), (N,)) for c in names])


def _corrected(
    engine: MonitoredModel, names: tuple[str, ...], inputs: Mapping[str, np.ndarray]
) -> tuple[tuple[str, ...], np.ndarray]:
    """Kinds of the corrected coordinates, and their values (d, N)."""
    N = len(next(iter(inputs.values())))
    values = {c: np.broadcast_to(inputs.get(c, engine.optional_inputs.get(c, 0.0)), (N,)) for c in names}
    return coordinates(getattr(engine, "power_setting"), values, N)  # noqa: B009 - not every model has one


def _points(monitor: Monitor) -> np.ndarray:
    """Operating points (n, d) drawn where records are judged: those that identification saw, then some around them.
    Always the same ones."""
    envelope = monitor.envelope
    rng = np.random.default_rng(0)
    seen = np.asarray(envelope.points)
    near = np.repeat(seen, -(-POINTS // len(seen)), axis=0)
    reach = 0.5 * envelope.threshold * np.asarray(envelope.scale)
    return np.asarray(np.concatenate([seen, near + reach * rng.uniform(-1, 1, near.shape)]))


def _terms(u: np.ndarray, powers: tuple[tuple[int, ...], ...]) -> np.ndarray:
    """Products (N, terms) of the columns of u (N, d) that each term names."""
    known: dict[tuple[int, ...], np.ndarray] = {(): np.ones(len(u))}
    for term in powers:
        if term:
            known[term] = known[term[:-1]] * u[:, term[-1]]
    return np.column_stack([known[term] for term in powers])
