"""What is wanted of an engine at operating points that are solved, read from the passes that confirmed them.

Outputs are y = G(x, θ) where the balances F(x, θ) = 0, so that by the implicit function theorem

    dy/dθ = G_θ − G_x F_x⁻¹ F_θ.

The answer of an engine: values, derivatives and the status of every point.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from enginediag_cli.engine import solver
from enginediag_cli.engine import solver as elimination
from enginediag_cli.engine.dual import Array, Value, value
from enginediag_cli.engine.evaluation import Evaluation
from enginediag_cli.engine.gas import T_LIMIT
from enginediag_cli.engine.moving.recall import Known
from enginediag_cli.engine.network import Network
from enginediag_cli.engine.sensors import Sensor

OK, OUTSIDE_MAP, NOT_CONVERGED, INVALID_INPUT = range(4)
"""Status of a point, the better the smaller: up to OUTSIDE_MAP it has values."""
STATUS = ("ok", "outside the maps", "did not converge", "invalid input")


@dataclass(frozen=True)
class Prediction:
    """Φ at N points: y (N, m), jacobian (N, m, p), status (N,) as in STATUS; y is NaN where status > 1. `also` (N, k):
    further columns that were asked for, values only. `limits`: limits and stops of controls that act somewhere → where
    (N,)."""

    y: Array
    jacobian: Array
    status: Array
    columns: tuple[str, ...]
    wrt: tuple[str, ...]
    x: Array
    residual: Array
    passes: Array
    also: Array
    _reasons: Mapping[int, str]
    limits: Mapping[str, Array] = field(default_factory=dict)

    @property
    def active_limit(self) -> Array:
        """Names (N,) of the limits and stops that act, joined by `+`; empty where every control holds what it is to."""
        told = np.full(len(self.status), "", dtype=object)
        for name, mask in self.limits.items():
            told[mask] = np.array([f"{t}+{name}" if t else name for t in told[mask]], dtype=object)
        return told.astype(str)

    @property
    def ok(self) -> Array:
        """Points whose values can be used (N,)."""
        return self.status <= OUTSIDE_MAP

    def reason(self, k: int) -> str:
        """Why point k is flagged: the component or the balance; empty where all is well."""
        return self._reasons.get(k, "")


def through(found: Prediction, known: Mapping[str, Known], wrt: tuple[str, ...]) -> Prediction:
    """Derivatives along `wrt` through leaves that were known beforehand, which were directions of their own."""
    J = found.jacobian[:, :, : len(wrt)].copy()
    at = {n: j for j, n in enumerate(found.wrt)}
    for leaf, of in known.items():
        for j, n in enumerate(wrt):
            if n in of.slopes:
                J[:, :, j] += found.jacobian[:, :, at[leaf]] * of.slopes[n][:, None]
    return replace(found, jacobian=J, wrt=wrt)


def marked(e: Evaluation) -> dict[str, Array]:
    """Components met outside their maps, and temperatures outside the gas data; masks (N,)."""
    marked = {what: np.broadcast_to(mask, (e.size,)) for what, mask in e.outside.items() if np.any(mask)}
    beyond = np.zeros(e.size, dtype=bool)
    for flow in e.flows.values():
        if flow.known_temperature is not None:
            T = value(flow.known_temperature)
            if not (np.max(T) <= T_LIMIT[1] and np.min(T) >= T_LIMIT[0]):
                beyond |= (T > T_LIMIT[1]) | (T < T_LIMIT[0])
    if beyond.any():
        marked["the gas data"] = beyond
    return marked


@dataclass(frozen=True)
class Read:
    """What was read of n points: as `Outputs` has it, reasons by place among them."""

    y: Array
    jacobian: Array
    also: Array
    status: Array
    reasons: Mapping[int, str]
    limits: Mapping[str, Array]


class Outputs:
    """Values y (N, m) of `columns` and their derivatives jacobian (N, m, p) along `wrt`, values also (N, k) of further
    columns, status (N,) and reasons by point: NaN and INVALID_INPUT until they are read; limits: those that act → where
    (N,)."""

    def __init__(
        self,
        network: Network,
        sensors: Mapping[str, Sensor],
        columns: tuple[str, ...],
        wrt: tuple[str, ...],
        also: Sequence[str],
        size: int,
    ):
        self.network, self.sensors, self.columns, self.wrt, self.columns_also = network, sensors, columns, wrt, also
        self.y, self.also = np.full((size, len(columns)), np.nan), np.full((size, len(also)), np.nan)
        self.jacobian = np.full((size, len(columns), len(wrt)), np.nan)
        self.status = np.full(size, INVALID_INPUT, dtype=np.int8)
        self.reasons: dict[int, str] = {}
        self.limits: dict[str, Array] = {}
        self._signals = {m.name: m.sensor for m in network.memories}
        self._unknowns = tuple(u.name for u in network.unknowns())
        self._along = tuple(network.leaf_of(w) for w in wrt)
        self.along = frozenset((*self._unknowns, *self._along)) if wrt else frozenset()

    def of(self, points: Array) -> OfPoints:
        """A reader for a batch that is these points (n,) of all."""
        return OfPoints(self, points)

    def part(self, points: Array) -> Read:
        """What was read of these points (n,)."""
        reasons = {k: self.reasons[i] for k, i in enumerate(points.tolist()) if i in self.reasons}
        limits = {name: mask[points] for name, mask in self.limits.items()}
        return Read(self.y[points], self.jacobian[points], self.also[points], self.status[points], reasons, limits)

    def take(self, points: Array, read: Read) -> None:
        """Takes over what was read of these points (n,) elsewhere."""
        self.y[points], self.jacobian[points], self.also[points] = read.y, read.jacobian, read.also
        self.status[points] = read.status
        self.reasons |= {int(points[k]): reason for k, reason in read.reasons.items()}
        for name, mask in read.limits.items():
            self.limits.setdefault(name, np.zeros(len(self.status), dtype=bool))[points] = mask

    def forget(self, points: Array) -> None:
        """As if these points (n,) had not been read."""
        self.status[points] = INVALID_INPUT
        for i in points.tolist():
            self.reasons.pop(i, None)

    def read(self, e: Evaluation, rows: Array, points: Array) -> None:
        """Takes over what `rows` of an evaluation at their solution say of `points`."""
        with np.errstate(all="ignore"):
            found = {c: self._read(e, c) for c in self.columns}
            for c, column in enumerate(self.columns_also):
                self.also[points, c] = _values(e, self._of_model(e, column))[rows]
        for c, x in enumerate(found.values()):
            self.y[points, c] = _values(e, x)[rows]
        if self.wrt and self.columns:
            self.jacobian[points], left = self._sensitivities(e, found, rows)
            self.y[points] += np.where(np.isfinite(left), left, 0.0)  # a singular point keeps what it has
        self.status[points] = OK
        for name, mask in self.network.acting(e).items():
            acts = self.limits.setdefault(name, np.zeros(len(self.status), dtype=bool))
            acts[points] = np.broadcast_to(mask, (e.size,))[rows]
        for name, mask in marked(e).items():
            outside = points[mask[rows]]
            self.status[outside] = OUTSIDE_MAP
            for i in outside.tolist():
                self.reasons[i] = f"{self.reasons[i]}, {name}" if i in self.reasons else f"outside {name}"

    def _sensitivities(self, e: Evaluation, outputs: Mapping[str, Value], rows: Array) -> tuple[Array, Array]:
        """dy/dθ (n, m, p) of some rows, and −G_x F_x⁻¹ F (n, m): what the outputs lack for balances F not zero."""
        some = slice(None) if len(rows) == e.size else rows
        F_x, G_x = (solver.directed(e, r, self._unknowns)[..., some] for r in (e.balances, outputs))
        # G_x F_x⁻¹ first: there are fewer outputs than parameters
        weights = elimination.substituted(*elimination.factors(F_x.transpose(1, 0, 2)), G_x.transpose(1, 0, 2))
        F_theta, G_theta = (solver.directed(e, r, self._along)[..., some] for r in (e.balances, outputs))
        for weight, balance in zip(weights, F_theta, strict=True):
            for out, w in zip(G_theta, weight, strict=True):
                out -= w * balance
        F = [_values(e, balance)[some] for balance in e.balances.values()]
        left = sum(weight * balance for weight, balance in zip(weights, F, strict=True))
        return G_theta.transpose(2, 0, 1), -np.asarray(left).T

    def _read(self, e: Evaluation, column: str) -> Value:
        if column in self._signals:
            if column not in e.signals:
                self.sensors[self._signals[column]].read(self.network, e)
            return e.signals[column]
        if column in self.sensors:
            return self.sensors[column].read(self.network, e)
        return self.network.read(e, column)

    def _of_model(self, e: Evaluation, column: str) -> Value:
        """What is there, whatever a sensor reads of it; of what only a sensor has, what that reads."""
        try:
            return self.network.read(e, column)
        except KeyError:
            return self._read(e, column)


class OfPoints:
    """The reader of a batch that is part of all points."""

    def __init__(self, outputs: Outputs, points: Array):
        self.outputs, self.points, self.along = outputs, points, outputs.along

    def of(self, some: Array) -> OfPoints:
        """The reader of some of its points."""
        return OfPoints(self.outputs, self.points[some])

    def read(self, e: Evaluation, rows: Array, points: Array) -> None:
        self.outputs.read(e, rows, self.points[points])


def _values(e: Evaluation, x: Value) -> Array:
    v = value(x)
    return v if isinstance(v, np.ndarray) and v.shape == (e.size,) else np.broadcast_to(v, (e.size,))
