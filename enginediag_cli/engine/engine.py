"""The engine as the rest of the tool sees it: Y = Φ(U, θ) and ∂Φ/∂θ for whole batches."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from enginediag_cli.engine import solver
from enginediag_cli.engine.dual import Array, Value, value
from enginediag_cli.engine.evaluation import Evaluation
from enginediag_cli.engine.gas import T_LIMIT
from enginediag_cli.engine.network import Network
from enginediag_cli.engine.sensors import Sensor
from enginediag_cli.engine.start import StartFit, coordinates, correction, total_ratios
from enginediag_cli.parameters import Parameter

OK, OUTSIDE_MAP, NOT_CONVERGED, INVALID_INPUT = range(4)
STATUS = ("ok", "outside the maps", "did not converge", "invalid input")
CHUNK = 4000  # points per pass: large enough to hide call overhead, small enough for the cache
CHUNK_WITH_DERIVATIVES = 2000
FIT_FROM = 500  # points from which a fitted start pays
ANCHORS = 320


@dataclass(frozen=True)
class Prediction:
    """Φ at N points: y (N, m), jacobian (N, m, p), status (N,) as in STATUS; y is NaN where status > 1."""

    y: Array
    jacobian: Array
    status: Array
    columns: tuple[str, ...]
    wrt: tuple[str, ...]
    x: Array
    residual: Array
    passes: Array
    _reasons: Mapping[int, str]

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
        for s in self.sensors.values():
            if s.soak:
                found.setdefault(s.soak, 0.0)
        self.inputs = tuple(c for c, default in found.items() if default is None)
        self.optional_inputs = {c: d for c, d in found.items() if d is not None}
        parameters = [*network.parameters(), *(p for s in self.sensors.values() for p in s.parameters())]
        self.parameters: dict[str, Parameter] = {p.name: p for p in parameters}
        self.monitored: tuple[str, ...] = tuple(declared["monitored"]) or tuple(
            p.name for p in parameters if p.family == "health" and not p.name.endswith("burner.efficiency"))
        self.envelope: dict[str, tuple[float, float]] = {c: (v["low"], v["high"]) for c, v in declared["envelope"].items()}
        self.power_range: tuple[float, float] = tuple(declared["power_range"])
        self.unknowns = network.unknowns()
        self._nominal = {p.name: p.nominal for p in parameters}
        self._fit: StartFit | None = None

    def power_from_fraction(self, fraction: Value, inputs: Mapping[str, Value]) -> Array:
        """Power setting (N,) at a fraction of the corrected power range, 0 idle to 1 rating."""
        low, high = self.power_range
        theta, delta = total_ratios(inputs)
        return (low + (high - low) * np.asarray(fraction)) * correction(self.power_setting, theta, delta)

    def predict(self, inputs: Mapping[str, Value], parameters: Mapping[str, Value] | None = None, *,
                sensors: Sequence[str] | None = None, wrt: Sequence[str] = (), start: Array | None = None) -> Prediction:
        """Φ and ∂Φ/∂θ at N operating points.

        `inputs`: column -> (N,) or number, all of `self.inputs`; `parameters`: name -> number or (N,), the
        rest nominal; `sensors`: columns to return, default all sensors, or any model column ("T4_K");
        `wrt`: parameters or input columns; `start`: unknowns (nx, N) to begin with, e.g. an earlier `x`.
        Raises KeyError for unknown names. A point that fails is a flagged row, never an exception.
        """
        columns = tuple(self.sensors) if sensors is None else tuple(sensors)
        points, theta, size, valid = self._checked(inputs, parameters or {}, columns, tuple(wrt))
        m, p = len(columns), len(wrt)
        y, J = np.full((size, m), np.nan), np.full((size, m, p), np.nan)
        x = np.full((len(self.unknowns), size), np.nan)
        residual, passes = np.full(size, np.inf), np.zeros(size, dtype=int)
        status = np.full(size, INVALID_INPUT, dtype=np.int8)
        reasons: dict[int, str] = {k: "an input is missing or not a number" for k in np.flatnonzero(~valid)}
        fit = self._start_fit(points, size, valid) if start is None else None
        for at in _chunks(np.flatnonzero(valid), CHUNK):
            u, t = solver._take(points, at), solver._take(theta, at)
            solved = self._solve(u, t, len(at), fit, None if start is None else start[:, at])
            x[:, at], residual[at], passes[at] = solved.x, solved.residual, solved.passes
            status[at] = np.where(solved.converged, OK, NOT_CONVERGED)
            names = self._balance_names
            reasons.update({int(k): f"{names[w]} not met (residual {r:.1e})" for k, w, r, good in zip(
                at, solved.worst, solved.residual, solved.converged, strict=True) if not good})
        good = np.flatnonzero(status == OK)
        for at in _chunks(good, CHUNK_WITH_DERIVATIVES if p else CHUNK):
            y[at], J[at], flags = self._outputs(solver._take(points, at), solver._take(theta, at), x[:, at], columns, tuple(wrt))
            for name, mask in flags.items():
                for k in at[mask]:
                    reasons[int(k)] = f"{reasons[int(k)]}, {name}" if int(k) in reasons else f"outside the map of {name}"
                status[at[mask]] = OUTSIDE_MAP
        return Prediction(y, J, status, columns, tuple(wrt), x, residual, passes, reasons)

    # inside

    def _checked(self, inputs: Mapping[str, Value], parameters: Mapping[str, Value], columns: tuple[str, ...],
                 wrt: tuple[str, ...]) -> tuple[dict[str, Value], dict[str, Value], int, Array]:
        missing = [c for c in self.inputs if c not in inputs]
        if missing:
            raise KeyError(f"input columns missing: {', '.join(missing)}")
        unknown = [n for n in parameters if n not in self.parameters]
        unknown += [n for n in wrt if n not in self.parameters and n not in self.inputs and n not in self.optional_inputs]
        if unknown:
            raise KeyError(f"{self.name} has no parameter {', '.join(unknown)}")
        points = {c: np.asarray(inputs.get(c, self.optional_inputs.get(c)), dtype=float)
                  for c in (*self.inputs, *self.optional_inputs)}
        theta: dict[str, Value] = {**self._nominal, **parameters}
        size = max((np.size(v) for v in (*points.values(), *parameters.values())), default=1)
        valid = np.ones(size, dtype=bool)
        for c, v in points.items():
            given = c in self.inputs or c in inputs
            points[c] = np.broadcast_to(v, (size,)) if given else float(v)
            valid &= np.isfinite(v)
        if not points[self.power_setting].all():
            valid &= points[self.power_setting] > 0.0
        theta = {k: np.asarray(v, dtype=float) if np.ndim(v) else float(v) for k, v in theta.items()}
        return points, theta, size, valid

    def _start_fit(self, points: Mapping[str, Value], size: int, valid: Array) -> StartFit | None:
        """The remembered start if it covers these points, else a new one from anchors among them when that pays."""
        moving = {c: v for c, v in points.items() if isinstance(v, np.ndarray)}
        at = np.flatnonzero(valid)
        if not at.size:
            return None
        kinds, z = coordinates(self.power_setting, solver._take(moving, at), at.size)
        if self._fit is not None and len(self._fit.low) == len(z) and self._fit.covers(z).mean() > 0.98:
            return self._fit
        if at.size < FIT_FROM:
            return None
        anchors = np.unique(np.concatenate([np.random.default_rng(0).choice(at.size, ANCHORS, replace=False),
                                            z.argmin(axis=1), z.argmax(axis=1)]))
        solved = solver.newton(self.network, solver._take(points, at[anchors]), self._nominal,
                               self._design_start(anchors.size))
        good = solved.converged
        if good.sum() < 0.5 * anchors.size:
            return None
        self._fit = StartFit.fit(kinds, z[:, anchors[good]], solved.x[:, good])
        return self._fit

    def _design_start(self, size: int) -> Array:
        return np.repeat(np.array([[u.start] for u in self.unknowns]), size, axis=1)

    def _solve(self, points: Mapping[str, Value], theta: Mapping[str, Value], size: int, fit: StartFit | None,
               start: Array | None) -> solver.Solution:
        if start is None and fit is not None:
            moving = {c: v for c, v in points.items() if isinstance(v, np.ndarray)}
            start = fit.predict(coordinates(self.power_setting, moving, size)[1])
        solved = solver.newton(self.network, points, theta,
                               self._design_start(size) if start is None else np.where(np.isfinite(start), start, 1.0))
        for attempt in range(3):
            failed = np.flatnonzero(~solved.converged)
            if not failed.size:
                break
            again = self._retry(points, theta, solved, failed, attempt)
            better = again.residual < solved.residual[failed]
            at = failed[better]
            solved.x[:, at], solved.residual[at] = again.x[:, better], again.residual[better]
            solved.worst[at] = again.worst[better]
            solved.passes[failed] += again.passes
        return solved

    def _retry(self, points: Mapping[str, Value], theta: Mapping[str, Value], solved: solver.Solution, failed: Array,
               attempt: int) -> solver.Solution:
        """Failed points once from the design start, then from their nearest converged neighbours."""
        u, t = solver._take(points, failed), solver._take(theta, failed)
        good = np.flatnonzero(solved.converged)
        start = self._design_start(failed.size)
        if attempt and good.size:
            moving = {c: v for c, v in points.items() if isinstance(v, np.ndarray)}
            _, z = coordinates(self.power_setting, moving, len(solved.residual))
            z = z / np.maximum(np.ptp(z, axis=1), 1e-9)[:, None]
            distance = ((z[:, failed, None] - z[:, None, good]) ** 2).sum(axis=0) if failed.size * good.size < 2e6 else None
            nearest = good[distance.argmin(axis=1)] if distance is not None else good[np.arange(failed.size) % good.size]
            start = solved.x[:, nearest]
        return solver.newton(self.network, u, t, start)

    @property
    def _balance_names(self) -> tuple[str, ...]:
        if not hasattr(self, "_balances"):
            inputs = {c: np.array([0.5 * (lo + hi)]) for c, (lo, hi) in self.envelope.items()}
            points = {c: inputs.get(c, np.array([d])) for c, d in (*((c, 1.0) for c in self.inputs), *self.optional_inputs.items())}
            self._balances = tuple(solver.evaluate(self.network, points, self._nominal, self._design_start(1), frozenset()).balances)
        return self._balances

    def _outputs(self, points: Mapping[str, Value], theta: Mapping[str, Value], x: Array, columns: tuple[str, ...],
                 wrt: tuple[str, ...]) -> tuple[Array, Array, dict[str, Array]]:
        """y (n, m), dy/dθ = G_θ − G_x F_x⁻¹ F_θ (implicit function theorem) and the marked components."""
        names = tuple(u.name for u in self.unknowns)
        leaves = tuple(self.network.leaf_of(w) for w in wrt)
        e = solver.evaluate(self.network, points, theta, x, frozenset(names + leaves) if wrt else frozenset())
        with np.errstate(all="ignore"):
            rows = {c: self._read(e, c) for c in columns}
        n = x.shape[1]
        y = np.stack([np.broadcast_to(value(r), (n,)) for r in rows.values()], axis=1) if rows else np.empty((n, 0))
        J = np.empty((n, len(columns), len(wrt)))
        if wrt and columns:
            F = solver.matrix(e, e.balances, names + leaves)
            G = solver.matrix(e, rows, names + leaves)
            k = len(names)
            dx = np.linalg.solve(F[:, :, :k], F[:, :, k:]) if k else np.zeros((n, 0, len(wrt)))
            J = G[:, :, k:] - G[:, :, :k] @ dx
        flags = {f"{name}": np.broadcast_to(mask, (n,)) for name, mask in e.outside.items() if np.any(mask)}
        hot = np.zeros(n, dtype=bool)
        for flow in e.flows.values():
            T = value(flow._T) if flow._T is not None else None
            if T is not None:
                hot |= np.broadcast_to((T > T_LIMIT[1]) | (T < T_LIMIT[0]), (n,))
        if hot.any():
            flags["the gas data"] = hot
        return y, J, flags

    def _read(self, e: Evaluation, column: str) -> Value:
        if column in self.sensors:
            return self.sensors[column].read(self.network, e)
        return self.network.read(e, column)


def _chunks(index: Array, size: int) -> Iterator[Array]:
    for k in range(0, len(index), size):
        yield index[k:k + size]


__all__ = ["STATUS", "Engine", "Prediction"]
