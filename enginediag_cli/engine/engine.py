"""The engine as the rest of the tool sees it: Y = Φ(U, θ) and ∂Φ/∂θ for whole batches."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from copy import copy
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

import numpy as np

from enginediag_cli.engine import solver
from enginediag_cli.engine.dual import Array, Value, value
from enginediag_cli.engine.evaluation import Evaluation
from enginediag_cli.engine.gas import T_LIMIT
from enginediag_cli.engine.network import Network
from enginediag_cli.engine.sensors import Sensor
from enginediag_cli.engine.start import correction, total_ratios
from enginediag_cli.engine.strategy import Strategy
from enginediag_cli.engine.term import Effect
from enginediag_cli.parameters import Parameter

OK, OUTSIDE_MAP, NOT_CONVERGED, INVALID_INPUT = range(4)
"""Status of a point, the better the smaller: up to OUTSIDE_MAP it has values."""
STATUS = ("ok", "outside the maps", "did not converge", "invalid input")
CHUNK = (1_000, 10_000)
"""Least and most points of a pass: enough to hide the overhead of calls, few enough for memory."""
IN_CACHE = 150_000
"""Points × directions of a pass: the derivatives of a quantity, 1.2 MB, stay about in the cache of a core. Ten thousand
points along eighty directions take 2.4 times as long at once as in passes of this size."""


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


class Engine:
    """A sized network with its sensors. Immutable in use; only the fitted start is remembered."""

    def __init__(self, network: Network, declared: Mapping[str, Any], path: str = ""):
        self.network = network
        self.path = path
        self.declared = declared
        self.name: str = declared["name"]
        self.description: str = declared["description"]
        found = network.inputs()
        self.power_setting: str = network.power_setting
        self.sensors = {c: Sensor.declared(c, v) for c, v in declared["sensors"].items() if c != network.power_setting}
        network.sensors = self.sensors
        for s in self.sensors.values():
            if s.soak:
                found.setdefault(s.soak, 0.0)
        self.inputs = tuple(c for c, default in found.items() if default is None)
        self.optional_inputs = {c: d for c, d in found.items() if d is not None}
        parameters = [*network.parameters(), *(p for s in self.sensors.values() for p in s.parameters())]
        self.parameters: dict[str, Parameter] = {p.name: p for p in parameters}
        self.monitored: tuple[str, ...] = tuple(declared["monitored"]) or tuple(
            p.name for p in parameters if p.family == "health" and p.component not in network.burners
        )
        self.envelope: dict[str, tuple[float, float]] = {
            c: (v["low"], v["high"]) for c, v in declared["envelope"].items()
        }
        self.power_range: tuple[float, float] | None = declared["power_range"] and tuple(declared["power_range"])
        self.unknowns = network.unknowns()
        self._nominal = {p.name: p.nominal for p in parameters}
        self._moved: Mapping[str, float] = {}
        self._strategy = Strategy(network, self._nominal)

    @property
    def effects(self) -> tuple[Effect, ...]:
        """Physical effects that the model carries."""
        return self.network.effects

    @property
    def controlled(self) -> bool:
        """Whether controls move anything, so that limits may act."""
        return bool(self.network.controls)

    @property
    def wanders(self) -> dict[str, float]:
        """Input columns with what an actuator stands off its rest by, and by how much that differs from day to day."""
        found = (getattr(c, "release", None) for c in self.network.controls)
        return {r.wander: r.rest_sigma for r in found if r is not None and r.wander}

    def undecided(self, inputs: Mapping[str, Any]) -> dict[str, Array]:
        """Control → records (N,) whose inputs do not tell whether it acts."""
        found = {}
        for c in self.network.controls:
            release = getattr(c, "release", None)
            if release is not None and release.margin > 0.0 and release.column in inputs:
                found[c.name] = release.undecided(np.asarray(inputs[release.column], dtype=float))
        return found

    @property
    def switches(self) -> tuple[str, ...]:
        """Input columns that switch an effect: 1 where it is on, 0 where it is off, and nothing between."""
        return tuple(dict.fromkeys(e.switch for e in self.effects if e.switch))

    def with_effects(self, effects: Sequence[Effect]) -> Engine:
        """The same sized engine, carrying these effects and no others; the fitted start is shared."""
        if not effects and not self.effects:
            return self
        other = Engine(self.network.with_effects(effects), self.declared, self.path)
        other._strategy.fit = self._strategy.fit
        return other.at({n: v for n, v in self._moved.items() if n in other.parameters})

    def at(self, values: Mapping[str, float]) -> Engine:
        """The same engine with other nominal values of these parameters, as identified. Raises KeyError."""
        if not values:
            return self
        other = copy(self)
        other._moved = {**self._moved, **values}
        other.parameters = {**self.parameters, **{n: self.parameters[n].moved(v) for n, v in values.items()}}
        other._nominal = {**self._nominal, **values}
        return other

    @property
    def nominal(self) -> Mapping[str, float]:
        """Parameters at their nominal values."""
        return dict(self._nominal)

    @property
    def moved(self) -> Mapping[str, float]:
        """Those that were given other nominal values than the file's."""
        return dict(self._moved)

    def forget_start(self) -> None:
        """Forgets the fitted start, as if the engine had just been loaded."""
        self._strategy.fit = None

    @np.errstate(all="ignore")  # what a wild input gives is not finite, and flagged as such
    def power_from_fraction(self, fraction: float | Array, inputs: Mapping[str, Any]) -> Array:
        """Power setting (N,) at a fraction of the corrected power range, 0 idle to 1 rating.

        Raises ValueError when the engine file states no range for this power setting.
        """
        if self.power_range is None:
            raise ValueError(f"{self.name}: the engine file gives no power range for {self.power_setting}")
        low, high = self.power_range
        theta, delta = total_ratios(inputs)
        return (low + (high - low) * np.asarray(fraction)) * correction(self.power_setting, theta, delta)

    @np.errstate(all="ignore")  # what a wild input gives is not finite, and flagged as such
    def predict(
        self,
        inputs: Mapping[str, Any],
        parameters: Mapping[str, Any] | None = None,
        *,
        sensors: Sequence[str] | None = None,
        wrt: Sequence[str] = (),
        start: Array | None = None,
        also: Sequence[str] = (),
        walk: bool = True,
    ) -> Prediction:
        """Φ and ∂Φ/∂θ at N operating points.

        `inputs`: column -> (N,) or number, all of `self.inputs`; `parameters`: name -> number or (N,), the
        rest nominal; `sensors`: columns to return, default all sensors, or any model column ("T4_K");
        `wrt`: parameters or input columns; `start`: unknowns (nx, N) to begin with, e.g. an earlier `x`; `also`: model
        columns of which the values will do, without derivatives. `walk`: whether
        points that fail from there are worth every other way to them.
        Raises KeyError for unknown names, ValueError for unequal lengths and for a column asked for twice. A point
        that fails is a flagged row, never an exception; so is one whose switch is neither 0 nor 1. `envelope` is not
        checked here: it is for those who generate or judge operating points.
        """
        columns = tuple(self.sensors) if sensors is None else tuple(sensors)
        wrt = tuple(wrt)
        twice = sorted({c for c in columns if columns.count(c) > 1})
        if twice:
            raise ValueError(f"asked for twice: {', '.join(twice)}")
        points, theta, size, valid, reasons = self._checked(inputs, parameters or {}, (*columns, *also), wrt)
        if start is not None and np.shape(start) != (len(self.unknowns), size):
            raise ValueError(f"`start` must have shape ({len(self.unknowns)}, {size}), not {np.shape(start)}")
        m, p = len(columns), len(wrt)
        y, J = np.full((size, m), np.nan), np.full((size, m, p), np.nan)
        x, beside = np.full((len(self.unknowns), size), np.nan), np.full((size, len(also)), np.nan)
        residual, passes = np.full(size, np.inf), np.zeros(size, dtype=int)
        status = np.full(size, INVALID_INPUT, dtype=np.int8)
        limits: dict[str, Array] = {}
        if start is None:
            self._strategy.prepare(points, valid)
        final = self._directions(wrt)
        fitting = IN_CACHE // (len(self.unknowns) + p)
        for at in _chunks(np.flatnonzero(valid), min(max(fitting, CHUNK[0]), CHUNK[1])):
            u, t = solver.take(points, at), solver.take(theta, at)
            solved = self._strategy.solve(u, t, len(at), None if start is None else start[:, at], final, walk)
            x[:, at], residual[at], passes[at] = solved.x, solved.residual, solved.passes
            status[at] = np.where(solved.converged, OK, NOT_CONVERGED)
            for k in np.flatnonzero(~solved.converged):
                balance = self._balance_names[solved.worst[k]]
                reasons[int(at[k])] = f"{balance} not met (residual {solved.residual[k]:.1e})"
            for e, good in self._evaluations(u, t, solved, final):
                rows = at[good]
                y[rows], J[rows], flags = self._outputs(e, columns, wrt)
                for c, column in enumerate(also):
                    beside[rows, c] = np.broadcast_to(value(self._read(e.evaluation, column)), (e.evaluation.size,))[
                        e.rows
                    ]
                for name, mask in self.network.acting(e.evaluation).items():
                    limits.setdefault(name, np.zeros(size, dtype=bool))[rows] = np.broadcast_to(
                        mask, (e.evaluation.size,)
                    )[e.rows]
                for name, mask in flags.items():
                    status[rows[mask]] = OUTSIDE_MAP
                    for i in rows[mask].tolist():
                        reasons[i] = f"{reasons[i]}, {name}" if i in reasons else f"outside {name}"
        return Prediction(y, J, status, columns, wrt, x, residual, passes, beside, reasons, limits)

    # inside

    def _checked(
        self, inputs: Mapping[str, Any], parameters: Mapping[str, Any], columns: tuple[str, ...], wrt: tuple[str, ...]
    ) -> tuple[dict[str, Any], dict[str, Any], int, Array, dict[int, str]]:
        missing = [c for c in self.inputs if c not in inputs]
        if missing:
            raise KeyError(f"input columns missing: {', '.join(missing)}")
        unknown = [n for n in parameters if n not in self.parameters]
        unknown += [
            n for n in wrt if n not in self.parameters and n not in self.inputs and n not in self.optional_inputs
        ]
        if unknown:
            raise KeyError(f"{self.name} has no parameter {', '.join(unknown)}")
        for column in columns:
            self._known_column(column)
        points: dict[str, Any] = {}
        lengths = {c: np.size(v) for c, v in (*inputs.items(), *parameters.items()) if np.ndim(v)}
        sizes = {n for n in lengths.values() if n != 1} or {1}
        if len(sizes) > 1:
            raise ValueError(
                f"inputs and parameters differ in length: {', '.join(f'{c} {n}' for c, n in lengths.items())}"
            )
        size = sizes.pop()
        for c in (*self.inputs, *self.optional_inputs):
            v = np.asarray(inputs.get(c, self.optional_inputs.get(c)), dtype=float)
            points[c] = np.broadcast_to(v.ravel() if v.ndim else v, (size,)) if c in inputs else float(v)
        theta: dict[str, Any] = dict(self._nominal)
        for name, given in parameters.items():
            theta[name] = np.asarray(given, dtype=float) if np.size(given) == size > 1 else float(np.ravel(given)[0])
        valid, reasons = np.ones(size, dtype=bool), {}
        for name, v in (*points.items(), *((p, theta[p]) for p in parameters)):
            good = np.broadcast_to(np.isfinite(v), (size,))
            if name == self.power_setting:
                good = good & (np.nan_to_num(v) > 0.0)
            for k in np.flatnonzero(valid & ~good).tolist():
                reasons[k] = f"{name} is {np.broadcast_to(v, (size,))[k]:g}"
            valid &= good
        for column in self.switches:
            v = np.broadcast_to(points[column], (size,))
            between = valid & (v != 0.0) & (v != 1.0)
            reasons |= {k: f"column {column} is a switch and holds {v[k]:g}" for k in np.flatnonzero(between).tolist()}
            valid &= ~between
        return points, theta, size, valid, reasons

    def _known_column(self, column: str) -> None:
        if column not in self.sensors and column not in self.model_columns:
            raise KeyError(f"{self.name} has no model column {column}")

    @property
    def model_columns(self) -> tuple[str, ...]:
        """Every column that the model itself gives: stations, speeds, powers, thrust."""
        return self._sample[1]

    @property
    def _balance_names(self) -> tuple[str, ...]:
        return self._sample[0]

    @cached_property
    def _sample(self) -> tuple[tuple[str, ...], tuple[str, ...]]:
        """Names of the balances and of the model's columns, from an evaluation at the start."""
        points = {c: np.array([1.0 if d is None else d]) for c, d in self.network.inputs().items()}
        x = np.array([[u.start] for u in self.unknowns])
        e = solver.evaluate(self.network, points, self._nominal, x, frozenset())
        return tuple(e.balances), self.network.columns(e)

    def _directions(self, wrt: Sequence[str]) -> frozenset[str]:
        """The leaves along which outputs are differentiated: none, or the unknowns and `wrt`."""
        if not wrt:
            return frozenset()
        return frozenset([u.name for u in self.unknowns] + [self.network.leaf_of(w) for w in wrt])

    def _evaluations(
        self, points: Mapping[str, Any], theta: Mapping[str, Any], solved: solver.Solution, final: frozenset[str]
    ) -> Iterator[tuple[_Rows, Array]]:
        """Evaluations at the solution, with the converged points that each stands for: the confirming pass
        of the solver, whose other rows are ignored, and one more for points that it does not cover."""
        left = solved.converged.copy()
        if solved.evaluation is not None and solved.evaluated is not None:
            covered = np.full(len(left), -1)
            covered[solved.evaluated] = np.arange(len(solved.evaluated))
            current = solver.largest_balance(solved.evaluation) <= solver.TOLERANCE
            good = np.flatnonzero(left & (covered >= 0))
            good = good[current[covered[good]]]
            yield _Rows(solved.evaluation, covered[good]), good
            left[good] = False
        rest = np.flatnonzero(left)
        if rest.size:
            e = solver.evaluate(
                self.network, solver.take(points, rest), solver.take(theta, rest), solved.x[:, rest], final
            )
            yield _Rows(e, slice(None)), rest

    def _outputs(
        self, e: _Rows, columns: tuple[str, ...], wrt: tuple[str, ...]
    ) -> tuple[Array, Array, dict[str, Array]]:
        """y (n, m), dy/dθ = G_θ − G_x F_x⁻¹ F_θ (implicit function theorem) and the marked components."""
        names = tuple(u.name for u in self.unknowns)
        with np.errstate(all="ignore"):
            rows = {c: self._read(e.evaluation, c) for c in columns}
        n = e.evaluation.size
        y = np.stack([np.broadcast_to(value(r), (n,)) for r in rows.values()], axis=1) if rows else np.empty((n, 0))
        J = np.empty((n, len(columns), len(wrt)))[e.rows]
        if wrt and columns:
            along = tuple(self.network.leaf_of(w) for w in wrt)
            balances = e.evaluation.balances
            F_x, G_x = (solver.matrix(e.evaluation, r, names)[e.rows] for r in (balances, rows))
            # G_x F_x⁻¹ first: there are fewer outputs than parameters
            weights = solver.linear_solve(F_x.transpose(0, 2, 1), G_x.transpose(0, 2, 1)).transpose(2, 1, 0)
            F_theta, G_theta = (solver.directed(e.evaluation, r, along)[..., e.rows] for r in (balances, rows))
            for row, out in zip(weights, G_theta, strict=True):
                for weight, balance in zip(row, F_theta, strict=True):
                    out -= weight * balance
            J = np.ascontiguousarray(G_theta.transpose(2, 0, 1))
        flags = {name: mask[e.rows] for name, mask in _marked(e.evaluation).items()}
        return y[e.rows], J, {name: mask for name, mask in flags.items() if mask.any()}

    def _read(self, e: Evaluation, column: str) -> Value:
        if column in self.sensors:
            return self.sensors[column].read(self.network, e)
        return self.network.read(e, column)


@dataclass(frozen=True)
class _Rows:
    """Some points of an evaluation."""

    evaluation: Evaluation
    rows: Array | slice


def _marked(e: Evaluation) -> dict[str, Array]:
    """Components met outside their maps, and temperatures outside the gas data; masks (N,)."""
    marked = {what: np.broadcast_to(mask, (e.size,)) for what, mask in e.outside.items() if np.any(mask)}
    beyond = np.zeros(e.size, dtype=bool)
    for flow in e.flows.values():
        if flow.known_temperature is not None:
            T = value(flow.known_temperature)
            beyond |= np.broadcast_to((T > T_LIMIT[1]) | (T < T_LIMIT[0]), (e.size,))
    if beyond.any():
        marked["the gas data"] = beyond
    return marked


def _chunks(index: Array, size: int) -> Iterator[Array]:
    for k in range(0, len(index), size):
        yield index[k : k + size]


__all__ = ["STATUS", "Engine", "Prediction"]
