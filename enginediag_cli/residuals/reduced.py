"""A monitor whose uncertain parameters are r unit normals: the directions in which an uncertain nominal matters.

Identification leaves dozens of parameters uncertain. Their covariance C = L Lᵀ matters only through J L, which has far
fewer directions than parameters: those of the eigenvectors of Lᵀ JᵀR⁻¹J L that carry information. The statistics are
those of the monitor that it comes from, but for what is negligible, and a change of a monitored parameter is
separated from the error with which that parameter was identified, so that only the change moves the point at which
the model is linearised. Offsets, which every recording has anew, stay parameters of their own: what is uncertain about
nominal is one draw for all recordings.

**Curvature**: whether a model that is linear about nominal is enough, or a window needs the engine at its estimate.

    y(θ₀ + δ) = y₀ + J δ + ½ δᵀHδ + …,      neglected, in standard errors:   ‖½ R^-½ δᵀHδ‖ over the records of a window

H by central differences of the engine's exact sensitivities, at operating points that identification saw.

**Lags** of readings of an engine that moves are nuisance of a monitor, with their own course and size. The error of
reading s in record k is Σ_τ a_τ d_τ(k), with d_τ the deviation of a lag of the command from the command. The amounts
are those that identification found, times one unknown number, and beside it each as it differs from stretch to stretch:
1 + T columns, of standard deviation one, that the statistics marginalise as they do instruments' offsets. Nothing is
subtracted: what lags for another reason than in training is not made worse.

**Fitted effects.** `MonitorCache` takes the form of a monitor that is the cheapest for a recording: for few records the
engine computes the effect of what is uncertain about nominal, for many a fit does. The effect J L of the unit normals
of `reduced.py` varies smoothly over the operating points: its leading directions (over the points that identification
saw) are fitted once with polynomials in the engine's inputs. Records then cost the engine's sensitivities to the
monitored parameters alone; the fit costs as much as a few thousand records. How well it holds is checked on points that
it has not seen; where it is not accurate, the engine is used.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from itertools import chain, combinations_with_replacement
from typing import Any

import numpy as np

from enginediag_cli.engine.start import StartFit, coordinates
from enginediag_cli.engine.wrapped import MonitoredModel
from enginediag_cli.error_model.maps import MapErrorModel
from enginediag_cli.identification.instruments import SensorLag
from enginediag_cli.recordings.table import Recording
from enginediag_cli.residuals.monitor import Monitor, Offset, sample_envelope
from enginediag_cli.residuals.statistics import LocalStatistics
from enginediag_cli.residuals.windows import WindowStatistics

POINTS = 30
"""Operating points at which the engine is differentiated; at a hundred the answer is the same to two per cent."""
STEP = 0.25
"""Of a difference, in prior standard deviations."""
SHARE = 0.9
"""Of operating points at which the model is less curved than is assumed of all records."""


@dataclass(frozen=True)
class Curvature:
    """`half` (K, m, a, a): ½ R^-½ ∂²y/∂θ² at K operating points, in noise units per parameter unit squared."""

    half: np.ndarray

    def neglected_error(self, step: np.ndarray, records: np.ndarray) -> np.ndarray:
        """Upper estimate (w,), in standard errors, of what steps (w, a) from nominal add to so many records (w,)."""
        bent = np.einsum("kjab,wa,wb->wkj", self.half, step, step, optimize=True)
        return np.asarray(np.sqrt(records * np.quantile(np.sum(bent**2, axis=2), SHARE, axis=1)))


def curvature(monitor: Monitor, inputs: Mapping[str, np.ndarray], start: np.ndarray | None = None) -> Curvature | None:
    """Curvature in the monitored parameters at some of the operating points `inputs` (n,); None where the engine
    fails about too many of them. start: the engine's unknowns (nx, n) at nominal, to begin with."""
    a, n = len(monitor.monitored), len(next(iter(inputs.values())))
    at = np.unique(np.linspace(0, n - 1, POINTS).astype(int))
    steps = STEP * monitor.prior_sigma[:a]
    theta = np.tile(monitor.theta0, (2 * a, len(at), 1))
    for i, h in enumerate(steps):
        theta[2 * i, :, i] += h
        theta[2 * i + 1, :, i] -= h
    _, J, ok, _ = monitor.predict(
        {c: np.tile(v[at], 2 * a) for c, v in inputs.items()},
        theta.reshape(-1, theta.shape[2]),
        nuisance=False,
        **({} if start is None else {"start": np.tile(start[:, at], 2 * a)}),
    )
    J, good = J.reshape(a, 2, len(at), -1, a), ok.reshape(2 * a, len(at)).all(axis=0)
    if good.sum() < POINTS // 2:
        return None
    second = ((J[:, 0] - J[:, 1]) / (2 * steps[:, None, None, None])).transpose(1, 2, 0, 3)[good]
    weight = 1 / (monitor.noise.sigma * np.sqrt(monitor.noise.inflation))
    return Curvature(0.25 * (second + second.transpose(0, 1, 3, 2)) * weight[:, None, None])


NEGLIGIBLE = 5e-5
"""Information per record of a direction below which it is neglected: a tenth in two thousand records."""


@dataclass(frozen=True)
class ReducedMonitor(Monitor):
    """Its uncertain parameters are r unit normals `nominal.1` …; `curvature`: what a linear model leaves out.

    The effect of the normals comes from the engine: J of the parameters of `whole`, in whose unit `root` (q, r) gives
    a step of one in each normal. A subclass may know the effect otherwise.
    """

    curvature: Curvature | None = field(default=None)
    whole: Monitor | None = field(default=None)
    root: np.ndarray | None = field(default=None)

    @property
    def inner(self) -> int:
        """How many parameters come before the offsets."""
        return len(self.names) - len(self.offsets)

    def predict(
        self, inputs: Mapping[str, np.ndarray], theta: np.ndarray, *, nuisance: bool = True, **options: Any
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray, Any]:
        """As `Monitor.predict`; the unit normals stay at 0, where nominal is."""
        a, q = len(self.monitored), self.inner
        moved, offsets = theta[..., :a], theta[..., q:]
        if not nuisance:
            plain = replace(self, names=(*self.monitored, *self.names[q:]))
            return Monitor.predict(plain, inputs, np.concatenate([moved, offsets], axis=-1), nuisance=False, **options)
        assert self.whole is not None and self.root is not None
        n = self.whole.names
        plain = replace(self, names=(*n, *self.names[q:]), offsets=(*self.whole.offsets, *self.offsets))
        at_nominal = np.broadcast_to(self.whole.theta0[a:], (*theta.shape[:-1], len(n) - a))
        y, J, ok, prediction = Monitor.predict(
            plain, inputs, np.concatenate([moved, at_nominal, offsets], axis=-1), **options
        )
        effect = J[:, :, : len(n)] @ self.root
        return y, np.concatenate([J[:, :, :a], effect, J[:, :, len(n) :]], axis=2), ok, prediction


def is_reducible(monitor: Monitor) -> bool:
    """Whether anything is uncertain, and where the engine ran is known."""
    envelope = monitor.envelope
    known = envelope is not None and all(c in envelope.inputs for c in monitor.engine.inputs) and len(envelope.points)
    return bool(known and len(monitor.names) > len(monitor.monitored))


def reduce_monitor(monitor: Monitor, bent: Curvature | None = None) -> Monitor:
    """The monitor with unit normals in place of what is uncertain about nominal, or as it is where there is nothing to
    replace. bent: its curvature, where that is known."""
    if not is_reducible(monitor):
        return monitor
    k = len(monitor.names) - len(monitor.offsets)
    inner = replace(monitor, offsets=(), **monitor.parameter_fields(range(k)))
    inputs = sample_envelope(monitor.envelope, POINTS)
    _, J, ok, found = inner.predict(inputs, inner.theta0)
    if not ok.any():
        return monitor
    root = uncertainty_root(inner)
    effects = [J[ok] @ root, *largest_map_effects(inner, getattr(found, "frozen", {}), ok, root)]
    root = root @ leading_directions(effects, noise_weight(inner))
    bent = bent or _predicted_curvature(inner, inputs, ok, found)
    fields = normal_fields(inner, root.shape[1])
    found = ReducedMonitor(**fields, curvature=bent, whole=inner, root=root)
    return found.add_nuisance(monitor.names[k:], monitor.prior_sigma[k:], monitor.uncertainty[k:, k:], monitor.offsets)


def envelope_curvature(monitor: Monitor) -> Curvature | None:
    """Curvature at some of the operating points that identification saw; None where they are not known, or the engine
    fails about too many."""
    envelope = monitor.envelope
    if envelope is None or not len(envelope.points) or any(c not in envelope.inputs for c in monitor.engine.inputs):
        return None
    inputs = sample_envelope(monitor.envelope, POINTS)
    _, _, ok, found = monitor.predict(inputs, monitor.theta0)
    return _predicted_curvature(monitor, inputs, ok, found) if ok.any() else None


def _predicted_curvature(
    monitor: Monitor, inputs: Mapping[str, np.ndarray], ok: np.ndarray, found: Any
) -> Curvature | None:
    """Curvature at those `inputs` (n,) of which the engine `found` a prediction, ok (n,)."""
    x = getattr(found, "x", None)
    good = {c: values[ok] for c, values in {**inputs, **getattr(found, "frozen", {})}.items()}
    return curvature(monitor, good, None if x is None else x[:, ok])


def noise_weight(monitor: Monitor) -> np.ndarray:
    """1/σ of every sensor (m,), chance in σ included."""
    return np.asarray(1 / (monitor.noise.sigma * np.sqrt(monitor.noise.inflation)))


def uncertainty_root(monitor: Monitor) -> np.ndarray:
    """L (p, p) of the covariance L Lᵀ of all parameters and offsets, in their units."""
    scale = monitor.prior_sigma
    eigenvalues, vectors = np.linalg.eigh(monitor.uncertainty / scale / scale[:, None])
    return np.asarray(scale[:, None] * vectors * np.sqrt(np.maximum(eigenvalues, 0.0)))


def amount_rows(monitor: Monitor) -> np.ndarray:
    """Which of all parameters (k,) are errors of maps, in the order of `MapErrorModel.amounts`."""
    if not isinstance(monitor.engine, MapErrorModel):
        return np.zeros(0, int)
    position = {n: i for i, n in enumerate(monitor.names)}
    return np.array([position[n] for n in monitor.engine.amounts], int)


def largest_map_effects(
    monitor: Monitor, frozen: Mapping[str, np.ndarray], ok: np.ndarray, root: np.ndarray
) -> list[np.ndarray]:
    """Effects (n, m, q) of the unit normals of `root` (q, q) by each curve of the maps' errors where it is largest,
    on the line of training, off it and beyond.

    frozen: columns of the engine's prediction at points that training saw, where some of them have no effect; ok (n,).
    """
    engine = monitor.engine
    if not isinstance(engine, MapErrorModel) or not frozen:
        return []
    rows = amount_rows(monitor)
    return [effect[ok] @ root[rows] for effect in engine.largest_effects(frozen, monitor.sensors)]


def leading_directions(effects: Sequence[np.ndarray], weight: np.ndarray) -> np.ndarray:
    """Orthonormal directions (q, r) of unit normals whose effect in any of the sets (n, m, q) is not negligible,
    strongest first."""
    information = np.zeros((effects[0].shape[2],) * 2)
    for effect in effects:
        flat = (effect * weight[:, None]).reshape(-1, effect.shape[2])
        information += flat.T @ flat / len(effect)
    strength, directions = np.linalg.eigh(information)
    return np.asarray(directions[:, strength > NEGLIGIBLE][:, ::-1])


def normal_fields(monitor: Monitor, r: int) -> dict[str, Any]:
    """Fields of `monitor` with r unit normals after the monitored parameters, in place of all that is uncertain."""
    alone = drop_nuisance(monitor).add_nuisance([f"nominal.{i + 1}" for i in range(r)], np.ones(r), np.eye(r))
    return {name: getattr(alone, name) for name in Monitor.__dataclass_fields__}


def drop_nuisance(monitor: Monitor) -> Monitor:
    """The monitored parameters alone, everything else about nominal taken for certain."""
    a = len(monitor.monitored)
    fields = monitor.parameter_fields(range(a))
    return replace(monitor, **{**fields, "offsets": (), "uncertainty": np.zeros((a, a))})


def add_sensor_lags(monitor: Monitor) -> Monitor:
    """The monitor with what its readings lag by; as it is where none does."""
    added = [offset for reading in monitor.sensor_lags for offset in _offsets(monitor, reading)]
    k = len(added)
    if not k:
        return monitor
    return monitor.add_nuisance([f"lagging.{i + 1}" for i in range(k)], np.ones(k), np.eye(k), added)


def _offsets(monitor: Monitor, reading: SensorLag) -> list[Offset]:
    if reading.sensor not in monitor.sensors:
        return []
    sensor = monitor.sensors.index(reading.sensor)
    T = len(reading.lags_s)
    each = [tuple(s if i == j else 0.0 for j in range(T)) for i, s in enumerate(reading.spread) if s > 0.0]
    return [Offset(sensor, "lagging", lags=amounts) for amounts in (reading.amounts, *each)]


MANY = 2_000
"""Records, of all files so far, from which a fit saves about what it costs: 0.2 s of CPU against 0.05 to 0.1 ms per
record. Less than a chunk holds, so that no record waits for the next chunk."""


@dataclass
class MonitorCache:
    """Forms of `monitor` that give the same statistics but for what `compact` neglects; `of` chooses one per file.
    Where no fit stands for what is uncertain, that is the monitor itself, for few records and for many.

    A file is judged by one form from its first record to its last: its rows do not depend on how it came in chunks.
    """

    monitor: Monitor
    _records: int = 0
    _exact_monitor: Monitor | None = field(default=None, repr=False)
    _compact_monitor: Monitor | None = field(default=None, repr=False)

    def choose(self, recordings: Iterable[Recording]) -> tuple[Monitor, Iterator[Recording]]:
        """The form for the recordings of one file, and all of these recordings."""
        waiting, held = iter(recordings), []
        while self._records < MANY and (recording := next(waiting, None)) is not None:
            held.append(recording)
            self._records += len(recording)
        return self._form(), chain(held, waiting)

    def _form(self) -> Monitor:
        if self.monitor.smooth is False or (self.monitor.smooth and self._records < MANY):
            if self._exact_monitor is None:
                self._exact_monitor = add_sensor_lags(reduce_monitor(self.monitor))
            return self._exact_monitor
        if self._compact_monitor is None:
            self._compact_monitor = add_sensor_lags(
                compact_monitor(self.monitor, None if self.monitor.sensor_lags else self._exact_monitor)
            )
        return self._compact_monitor


PLAUSIBLY = 2.0
"""Plausible errors by which the reading of an input may be off where it is outside what was seen."""


def widen_envelope(monitor: Monitor) -> Monitor:
    """The monitor with an envelope that allows for the errors of inputs that it suspects: an operating point is known
    no better than the instrument that gives it, and one that reads wrong must not hide itself by being outside."""
    errors = [e for name, e in getattr(monitor.engine, "errors", {}).items() if name in monitor.monitored]
    envelope = monitor.envelope
    if envelope is None or not errors:
        return monitor
    scale = np.array(envelope.scale, float)
    for error in errors:
        if error.column in envelope.inputs:
            j = envelope.inputs.index(error.column)
            size = np.abs(envelope.points[:, j]).max() if error.multiplies else 1.0
            scale[j] = np.hypot(scale[j], PLAUSIBLY * error.parameter.prior_sigma * size)
    return replace(monitor, envelope=replace(envelope, scale=scale))


def monitor_for_series(monitor: Monitor) -> Monitor:
    """The monitor whose windows make a series; what wrong slopes of maps make of a change is computed for the series,
    not for each window."""
    return replace(widen_envelope(monitor), slopes=None)


def ignore_uncertainty(monitor: Monitor) -> Monitor:
    """The monitor without what is uncertain about nominal, for windows that are compared with each other and of which
    `monitored_as_read` keeps nothing else: a third of the work. Only the point at which a window is linearised depends
    on it, by a small share of its standard error."""
    alone = replace(drop_nuisance(monitor), sensor_lags=(), uncertain_monitor=monitor)
    bent = envelope_curvature(alone)
    if bent is None:
        return alone
    fields = {name: getattr(alone, name) for name in Monitor.__dataclass_fields__}
    return ReducedMonitor(**fields, curvature=bent, whole=alone, root=np.zeros((len(alone.names), 0)))


def comparison_monitor(monitor: Monitor) -> Monitor:
    """The monitor by which a fleet condenses flights that are compared with each other: `certain`, and without the law
    of each statistic, which is computed for windows that are judged alone."""
    found = ignore_uncertainty(monitor)
    return replace(found, noise=replace(found.noise, kurtosis=None, readings=None, rho_error=None, rho_common=None))


def keep_monitored(monitor: Monitor, window: WindowStatistics, statistics: LocalStatistics) -> WindowStatistics:
    """The window with the statistics of the monitored parameters alone: what is wrong with nominal is wrong in all
    windows alike, and no noise of any."""
    others = set(monitor.names) - set(monitor.monitored)
    return replace(window, statistics=replace(statistics.drop_parameters(others), meaning=monitor.meaning))


DEGREE = 6
"""Of the polynomial of operating points in corrected coordinates; whether it suffices is tried on points held back
(TOLERANCE)."""
TOLERANCE = 5e-4
"""Information per record that the fit may leave out, half a unit of χ² in a thousand records; beyond it the engine is
asked."""
LEAST_POINTS = 300
"""Fewer computed points would not hold a fit and its trial."""
COMPACT_POINTS = 1500
"""Drawn around the operating points seen: some times the terms of the fit."""
START_DEGREE = 12.0
"""Of the fitted start: from there the engine's own iteration needs one pass less than from its usual start."""


@dataclass(frozen=True)
class OperatingPointPolynomial:
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

    def evaluate(self, terms: np.ndarray) -> np.ndarray:
        """What it gives (N, m, r) for `terms` (N, terms): sensitivities in sensor unit per unit normal; in single
        precision, which is exact enough."""
        _, m, r = self.coefficients.shape
        return np.asarray((terms @ self._single).reshape(-1, m, r))

    @cached_property
    def _single(self) -> np.ndarray:
        return self.coefficients.reshape(len(self.coefficients), -1).astype(np.float32)


@dataclass(frozen=True)
class MapErrorPolynomial:
    """Errors of maps of each record: `fit` gives the K frozen columns `names` that fix them, of which come the effects
    of the amounts; root (k, r): a step of one in each unit normal, in amounts."""

    names: tuple[str, ...]
    fit: OperatingPointPolynomial
    root: np.ndarray

    def frozen(self, terms: np.ndarray) -> dict[str, np.ndarray]:
        """Frozen columns (N,) by name for terms (N, terms) of the polynomials."""
        return dict(zip(self.names, self.fit.evaluate(terms)[:, 0].T.astype(float), strict=True))


@dataclass(frozen=True)
class CompactMonitor(ReducedMonitor):
    """`fit` gives the effect of its unit normals but for the errors of maps, which come of a step of `maps.root` in
    each amount; `start` gives the engine's unknowns at nominal, to begin with. Where training has not been the engine
    is used: a polynomial says nothing there."""

    fit: OperatingPointPolynomial | None = field(default=None)
    start: StartFit | None = field(default=None)
    maps: MapErrorPolynomial | None = field(default=None)

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
            whole[:, :, :a], whole[:, :, a:q], whole[:, :, q:] = J[:, :, :a], self.fit.evaluate(terms), J[:, :, a:]
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
    return isinstance(compact_monitor(monitor), CompactMonitor)


def compact_monitor(monitor: Monitor, exact: Monitor | None = None) -> Monitor:
    """The monitor with a fit in place of its uncertain parameters; as it is where a fit would not do, or where there is
    nothing to replace. exact: the reduced monitor, where it is known."""
    exact = exact or reduce_monitor(monitor)
    if not isinstance(exact, ReducedMonitor):
        return monitor
    points = _sample_points(monitor)
    names = tuple(monitor.envelope.inputs)
    inputs = {c: points[:, i] for i, c in enumerate(names)}
    _, J, ok, found = monitor.predict(inputs, monitor.theta0)
    start = _fit_start(monitor.engine, names, inputs, getattr(found, "x", None), ok)
    own = len(monitor.envelope.points)
    columns: dict[str, np.ndarray] = dict(getattr(found, "frozen", {}))
    J, points = J[ok], points[ok]
    if len(points) < LEAST_POINTS:
        return monitor
    seen = np.arange(len(points)) < np.sum(ok[:own])
    root, weight = uncertainty_root(monitor), noise_weight(monitor)
    elsewhere = largest_map_effects(monitor, {c: v[:own] for c, v in columns.items()}, ok[:own], root)
    root = root @ leading_directions([(J @ root)[seen], *elsewhere], weight)
    # errors of maps bend more than polynomials of this degree: theirs is computed of each record
    amounts = amount_rows(monitor)
    if elsewhere:
        J[:, :, amounts] = 0.0
    effect = J @ root
    # far corners in which the engine hardly runs would bend the fit everywhere
    size = np.sum((effect * weight[:, None]) ** 2, axis=(1, 2))
    usual = size < 25 * np.median(size)
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
    fit = OperatingPointPolynomial(
        names, centre, spread, powers, whole[:, :k].reshape(len(powers), -1, r) / weight[:, None]
    )
    maps = (
        MapErrorPolynomial(tuple(columns), replace(fit, coefficients=whole[:, None, k:]), root[amounts])
        if elsewhere
        else None
    )
    normals = {**normal_fields(monitor, r), "curvature": exact.curvature, "whole": monitor, "root": root}
    return CompactMonitor(**normals, fit=fit, start=start, maps=maps)


def _fit_start(
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


def _sample_points(monitor: Monitor) -> np.ndarray:
    """Operating points (n, d) drawn where records are judged: those that identification saw, then some around them.
    Always the same ones."""
    envelope = monitor.envelope
    rng = np.random.default_rng(0)
    seen = np.asarray(envelope.points)
    near = np.repeat(seen, -(-COMPACT_POINTS // len(seen)), axis=0)
    reach = 0.5 * envelope.threshold * np.asarray(envelope.scale)
    return np.asarray(np.concatenate([seen, near + reach * rng.uniform(-1, 1, near.shape)]))


def _terms(u: np.ndarray, powers: tuple[tuple[int, ...], ...]) -> np.ndarray:
    """Products (N, terms) of the columns of u (N, d) that each term names."""
    known: dict[tuple[int, ...], np.ndarray] = {(): np.ones(len(u))}
    for term in powers:
        if term:
            known[term] = known[term[:-1]] * u[:, term[-1]]
    return np.column_stack([known[term] for term in powers])
