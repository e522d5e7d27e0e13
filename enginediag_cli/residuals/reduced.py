"""A monitor whose uncertain parameters are r unit normals: the directions in which an uncertain nominal matters.

Identification leaves dozens of parameters uncertain. Their covariance C = L Lᵀ matters only through J L, which has far
fewer directions than parameters: those of the eigenvectors of Lᵀ JᵀR⁻¹J L that carry information. The statistics are
those of the monitor that it comes from, but for what is negligible, and a change of a monitored parameter is told
apart from the error with which that parameter was identified, so that only the change moves the point at which
the model is linearised. Offsets, which every recording has anew, stay parameters of their own: what is uncertain about
nominal is one draw for all recordings.

What a model that is linear about nominal leaves out: whether a window needs the engine at its estimate as well.

    y(θ₀ + δ) = y₀ + J δ + ½ δᵀHδ + …,      left out, in standard errors:   ‖½ R^-½ δᵀHδ‖ over the records of a window

H by central differences of the engine's exact sensitivities, at operating points that identification saw.

What readings of a moving engine lag by, as nuisance of a monitor: along its own course, by its own size.

The error of reading s in record k is Σ_τ a_τ d_τ(k), with d_τ the deviation of a lag of the command from the command.
The amounts are those that identification found, times one unknown number, and beside it each as it differs from stretch
to stretch: 1 + T columns, of standard deviation one, that the statistics marginalise as they do instruments' offsets.
Nothing is subtracted: what lags for another reason than in training is not made worse.

Which form of a monitor is the cheapest for a recording: few records ask the engine, many pay for a fit.

The monitor of a series, whose windows are compared with each other and not with nominal alone.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import chain
from typing import Any

import numpy as np

from enginediag_cli.error_model.maps import MapErrorModel
from enginediag_cli.identification.instruments import LaggingReading
from enginediag_cli.recordings.table import Recording
from enginediag_cli.residuals.distributions import quantile
from enginediag_cli.residuals.monitor import Monitor, Offset, seen_points
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

    def left_out(self, step: np.ndarray, records: np.ndarray) -> np.ndarray:
        """Upper estimate (w,), in standard errors, of what steps (w, a) from nominal add to so many records (w,)."""
        bent = np.einsum("kjab,wa,wb->wkj", self.half, step, step, optimize=True)
        return np.asarray(np.sqrt(records * quantile(np.sum(bent**2, axis=2), SHARE)))


def curvature(monitor: Monitor, inputs: Mapping[str, np.ndarray], start: np.ndarray | None = None) -> Curvature | None:
    """Curvature in the monitored parameters at some of the operating points `inputs` (n,); None where the engine
    fails about too many of them. start: the engine's unknowns (nx, n) at nominal, to begin with."""
    a, n = len(monitor.monitored), len(next(iter(inputs.values())))
    at = np.array(sorted(set(np.linspace(0, n - 1, POINTS).astype(int).tolist())))
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
"""Information per record of a direction below which it is left out: a tenth in two thousand records."""


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


def can_be_reduced(monitor: Monitor) -> bool:
    """Whether anything is uncertain, and where the engine ran is known."""
    envelope = monitor.envelope
    known = envelope is not None and all(c in envelope.inputs for c in monitor.engine.inputs) and len(envelope.points)
    return bool(known and len(monitor.names) > len(monitor.monitored))


def reduced(monitor: Monitor, bent: Curvature | None = None) -> Monitor:
    """The monitor with unit normals in place of what is uncertain about nominal, or as it is where there is nothing to
    replace. bent: its curvature, where that is known."""
    if not can_be_reduced(monitor):
        return monitor
    inner, inputs = without_offsets(monitor), seen_points(monitor.envelope, POINTS)
    _, J, ok, found = inner.predict(inputs, inner.theta0)
    if not ok.any():
        return monitor
    root = covariance_root(inner)
    effects = [J[ok] @ root, *effects_elsewhere(inner, getattr(found, "frozen", {}), ok, root)]
    root = root @ leading_directions(effects, noise_weight(inner))
    bent = bent or _bent(inner, inputs, ok, found)
    fields = in_normals(inner, root.shape[1])
    return with_offsets(ReducedMonitor(**fields, curvature=bent, whole=inner, root=root), monitor)


def without_offsets(monitor: Monitor) -> Monitor:
    """The monitor of instruments that are the same in all recordings."""
    k = len(monitor.names) - len(monitor.offsets)
    return replace(
        monitor,
        names=monitor.names[:k],
        offsets=(),
        theta0=monitor.theta0[:k],
        prior_sigma=monitor.prior_sigma[:k],
        lower=monitor.lower[:k],
        upper=monitor.upper[:k],
        uncertainty=monitor.uncertainty[:k, :k],
    )


def with_offsets(monitor: Monitor, other: Monitor) -> Monitor:
    """A monitor without offsets with those of another."""
    n, k = len(monitor.names), len(other.names) - len(other.offsets)
    uncertainty = np.zeros((n + len(other.offsets),) * 2)
    uncertainty[:n, :n], uncertainty[n:, n:] = monitor.uncertainty, other.uncertainty[k:, k:]
    return replace(
        monitor,
        names=(*monitor.names, *other.names[k:]),
        offsets=other.offsets,
        theta0=np.append(monitor.theta0, other.theta0[k:]),
        prior_sigma=np.append(monitor.prior_sigma, other.prior_sigma[k:]),
        lower=np.append(monitor.lower, other.lower[k:]),
        upper=np.append(monitor.upper, other.upper[k:]),
        uncertainty=uncertainty,
    )


def curvature_of(monitor: Monitor) -> Curvature | None:
    """Curvature at some of the operating points that identification saw; None where they are not known, or the engine
    fails about too many."""
    envelope = monitor.envelope
    if envelope is None or not len(envelope.points) or any(c not in envelope.inputs for c in monitor.engine.inputs):
        return None
    inputs = seen_points(monitor.envelope, POINTS)
    _, _, ok, found = monitor.predict(inputs, monitor.theta0)
    return _bent(monitor, inputs, ok, found) if ok.any() else None


def _bent(monitor: Monitor, inputs: Mapping[str, np.ndarray], ok: np.ndarray, found: Any) -> Curvature | None:
    """Curvature at those `inputs` (n,) of which the engine `found` a prediction, ok (n,)."""
    x = getattr(found, "x", None)
    good = {c: values[ok] for c, values in {**inputs, **getattr(found, "frozen", {})}.items()}
    return curvature(monitor, good, None if x is None else x[:, ok])


def noise_weight(monitor: Monitor) -> np.ndarray:
    """1/σ of every sensor (m,), chance in σ included."""
    return np.asarray(1 / (monitor.noise.sigma * np.sqrt(monitor.noise.inflation)))


def covariance_root(monitor: Monitor) -> np.ndarray:
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


def effects_elsewhere(
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


def in_normals(monitor: Monitor, r: int) -> dict[str, Any]:
    """Fields of `monitor` with r unit normals after the monitored parameters, in place of all that is uncertain."""
    a = len(monitor.monitored)

    def joined(values: np.ndarray, after: float) -> np.ndarray:
        return np.concatenate([values[:a], np.full(r, after)])

    return {
        **{name: getattr(monitor, name) for name in Monitor.__dataclass_fields__},
        "names": (*monitor.names[:a], *(f"nominal.{i + 1}" for i in range(r))),
        "offsets": (),
        "theta0": joined(monitor.theta0, 0.0),
        "prior_sigma": joined(monitor.prior_sigma, 1.0),
        "lower": joined(monitor.lower, -np.inf),
        "upper": joined(monitor.upper, np.inf),
        "uncertainty": np.diag(np.repeat([0.0, 1.0], [a, r])),
    }


def with_lagging(monitor: Monitor) -> Monitor:
    """The monitor with what its readings lag by; as it is where none does."""
    added = [offset for reading in monitor.lagging for offset in _offsets(monitor, reading)]
    k = len(added)
    if not k:
        return monitor
    p = len(monitor.names)
    uncertainty = np.eye(p + k)
    uncertainty[:p, :p] = monitor.uncertainty
    fields: dict[str, Any] = {
        "offsets": (*monitor.offsets, *added),
        "uncertainty": uncertainty,
        "names": (*monitor.names, *(f"lagging.{i + 1}" for i in range(k))),
        "theta0": np.append(monitor.theta0, np.zeros(k)),
        "prior_sigma": np.append(monitor.prior_sigma, np.ones(k)),
        "lower": np.append(monitor.lower, np.full(k, -np.inf)),
        "upper": np.append(monitor.upper, np.full(k, np.inf)),
    }
    return replace(monitor, **fields)


def _offsets(monitor: Monitor, reading: LaggingReading) -> list[Offset]:
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
class Economy:
    """Forms of `monitor` that give the same statistics but for what `compact` neglects; `of` chooses one per file.
    Where no fit stands for what is uncertain, that is the monitor itself, for few records and for many.

    A file is judged by one form from its first record to its last: its rows do not depend on how it came in chunks.
    """

    monitor: Monitor
    _records: int = 0
    _few: Monitor | None = field(default=None, repr=False)
    _many: Monitor | None = field(default=None, repr=False)

    def of(self, recordings: Iterable[Recording]) -> tuple[Monitor, Iterator[Recording]]:
        """The form for the recordings of one file, and all of these recordings."""
        waiting, held = iter(recordings), []
        while self._records < MANY and (recording := next(waiting, None)) is not None:
            held.append(recording)
            self._records += len(recording)
        return self._form(), chain(held, waiting)

    def _form(self) -> Monitor:
        if self.monitor.smooth is False or (self.monitor.smooth and self._records < MANY):
            if self._few is None:
                self._few = with_lagging(reduced(self.monitor))
            return self._few
        if self._many is None:
            from enginediag_cli.residuals.compact import compact

            self._many = with_lagging(compact(self.monitor, None if self.monitor.lagging else self._few))
        return self._many


PLAUSIBLY = 2.0
"""Plausible errors by which the reading of an input may be off where it is outside what was seen."""


def trusting_no_input(monitor: Monitor) -> Monitor:
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


def of_series(monitor: Monitor) -> Monitor:
    """The monitor whose windows make a series; what wrong slopes of maps make of a change is asked of the series, not
    of each window."""
    return replace(trusting_no_input(monitor), slopes=None)


def certain(monitor: Monitor) -> Monitor:
    """The monitor without what is uncertain about nominal, for windows that are compared with each other and of which
    `monitored_as_read` keeps nothing else: a third of the work. Only the point at which a window is linearised depends
    on it, by a small share of its standard error."""
    k = len(monitor.monitored)
    alone = replace(
        monitor,
        names=monitor.names[:k],
        theta0=monitor.theta0[:k],
        prior_sigma=monitor.prior_sigma[:k],
        lower=monitor.lower[:k],
        upper=monitor.upper[:k],
        uncertainty=np.zeros((k, k)),
        offsets=(),
        lagging=(),
        doubtful=monitor,
    )
    bent = curvature_of(alone)
    if bent is None:
        return alone
    fields = {name: getattr(alone, name) for name in Monitor.__dataclass_fields__}
    return ReducedMonitor(**fields, curvature=bent, whole=alone, root=np.zeros((k, 0)))


def for_comparison(monitor: Monitor) -> Monitor:
    """The monitor by which a fleet condenses flights that are compared with each other: `certain`, and without the law
    of each statistic, which is asked of windows that are judged alone."""
    found = certain(monitor)
    return replace(found, noise=replace(found.noise, kurtosis=None, readings=None, rho_error=None, rho_common=None))


def effects_of_inputs(
    monitor: Monitor, inputs: Mapping[str, np.ndarray], sizes: Mapping[str, float]
) -> dict[str, dict[str, np.ndarray]]:
    """By how much the reading of each sensor (n,), by the name of its bias, is beyond prediction at `inputs` (n,) that
    were read wrong, for one prior standard deviation: suspected error of an input → bias → effect. sizes: errors, by
    name, for which that is asked, as far as they are of this monitor.

    The difference of two predictions, not a derivative: a wrong reading moves the engine on its maps, too, off the line
    where their errors are known, and of these `error_model.modelled` takes no derivative.
    """
    known = {c: [p.name for p in monitor.engine.sensors[c].parameters()] for c in monitor.sensors}
    bias = {n: i for i, c in enumerate(monitor.sensors) for n in known[c] if n in monitor.monitored}
    base = {n: float(v) for n, v in monitor.base.items() if n in monitor.engine.parameters}
    found: dict[str, dict[str, np.ndarray]] = {}
    read = None
    for name, error in getattr(monitor.engine, "errors", {}).items():
        size = sizes.get(name, 0.0)
        if name not in monitor.monitored or not size:
            continue
        true = {**inputs, error.column: error.corrected(inputs[error.column], error.parameter.nominal + size)}
        read = read or monitor.engine.predict(inputs, base, sensors=monitor.sensors)
        wrong = monitor.engine.predict(true, base, sensors=monitor.sensors)
        if np.all(read.ok & wrong.ok):
            unit = error.parameter.prior_sigma / size
            found[name] = {n: unit * (np.asarray(wrong.y) - np.asarray(read.y))[:, i] for n, i in bias.items()}
    return found


def monitored_as_read(monitor: Monitor, window: WindowStatistics, statistics: LocalStatistics) -> WindowStatistics:
    """The window with the statistics of the monitored parameters alone: what is wrong with nominal is wrong in all
    windows alike, and no noise of any."""
    others = set(monitor.names) - set(monitor.monitored)
    return replace(window, statistics=replace(statistics.without(others), meaning=monitor.meaning))
