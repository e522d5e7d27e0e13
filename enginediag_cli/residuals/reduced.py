"""A monitor whose uncertain parameters are r unit normals: the directions in which an uncertain nominal matters.

Identification leaves dozens of parameters uncertain. Their covariance C = L Lᵀ matters only through J L, which has far
fewer directions than parameters: those of the eigenvectors of Lᵀ JᵀR⁻¹J L that carry information. The statistics are
those of the monitor that it comes from, but for what is negligible, and a change of a monitored parameter is told
apart from the error with which that parameter was identified, so that only the change moves the point at which
the model is linearised. Offsets, which every recording has anew, stay parameters of their own: what is uncertain about
nominal is one draw for all recordings.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from enginediag_cli.error_model.modelled import MapErrorModel
from enginediag_cli.residuals.curvature import Curvature, curvature
from enginediag_cli.residuals.monitor import Monitor, seen_points

NEGLIGIBLE = 5e-5
"""Information per record of a direction below which it is left out: a tenth in two thousand records."""
POINTS = 30
"""Operating points at which directions are sought; a fit over fifty times as many finds as many directions."""


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
