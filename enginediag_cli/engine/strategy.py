"""From operating points to a prediction: where the iteration begins, what is tried when it fails, and what is read.

`Strategy` begins at the caller's start, at the fitted start of many points, or at the design point. There the air flow
follows the speed where a shaft speed is the power setting, because design flow does not suit a low speed. Points that
fail are tried again from there, by a walk in power setting, from their nearest neighbours that converged, and from less
air flow: an engine whose compressor swallows far less than at design (closed vanes) is beyond its choking flow at every
other start.

`PointBatch` solves the points of one prediction in chunks, each of which several processes may share. The solution of a
point depends on that point alone, so every process finds the same digits. Only a retry begins from neighbours: a chunk
with such points is done by one process.

`Outputs` reads the passes that confirmed the solutions. Outputs are y = G(x, θ) where the balances F(x, θ) = 0, so that
by the implicit function theorem

    dy/dθ = G_θ − G_x F_x⁻¹ F_θ.

`Prediction` is the answer: values, derivatives and the status of every point.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from enginediag_cli.engine import solver
from enginediag_cli.engine.dual import Array, Value, value
from enginediag_cli.engine.evaluation import Evaluation, Sensor
from enginediag_cli.engine.gas import T_LIMIT
from enginediag_cli.engine.network import Network
from enginediag_cli.engine.recall import KnownLeaf
from enginediag_cli.engine.start import ANCHORS, StartFit, coordinates, correction, total_ratios
from enginediag_cli.parallel import parallel_map, process_count, resident_MB

OK, OUTSIDE_MAP, NOT_CONVERGED, INVALID_INPUT = range(4)
"""Status of a point, the better the smaller: up to OUTSIDE_MAP it has values."""
STATUS = ("ok", "outside the maps", "did not converge", "invalid input")


@dataclass(frozen=True)
class Prediction:
    """Φ and its derivatives at N operating points.

    Attributes
    ----------
    y
        Values (N, m) of `columns`, in their units; NaN where `status` > OUTSIDE_MAP.
    jacobian
        Derivatives (N, m, p) of `y` by `wrt`.
    status
        Status (N,) of each point, an index of STATUS.
    columns, wrt
        Names of the m outputs and the p directions.
    x, residual, passes
        Unknowns (nx, N) of the network, largest residual (N,) of the balances, and passes (N,) of the iteration.
    also
        Values (N, k) of further columns that were requested without derivatives.
    limits
        Limits and stops of controls that act somewhere → where (N,).
    """

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
        names = np.full(len(self.status), "", dtype=object)
        for name, mask in self.limits.items():
            names[mask] = np.array([f"{t}+{name}" if t else name for t in names[mask]], dtype=object)
        return names.astype(str)

    @property
    def ok(self) -> Array:
        """Points whose values can be used (N,)."""
        return self.status <= OUTSIDE_MAP

    def reason(self, k: int) -> str:
        """Why point k is flagged: the component or the balance; empty where all is well."""
        return self._reasons.get(k, "")


def chain_known_leaves(found: Prediction, known: Mapping[str, KnownLeaf], wrt: tuple[str, ...]) -> Prediction:
    """Derivatives along `wrt` through leaves that were known beforehand, which were directions of their own."""
    J = found.jacobian[:, :, : len(wrt)].copy()
    at = {n: j for j, n in enumerate(found.wrt)}
    for leaf, of in known.items():
        for j, n in enumerate(wrt):
            if n in of.slopes:
                J[:, :, j] += found.jacobian[:, :, at[leaf]] * of.slopes[n][:, None]
    return replace(found, jacobian=J, wrt=wrt)


def outside_marks(e: Evaluation) -> dict[str, Array]:
    """Components met outside their maps, and temperatures outside the gas data; masks (N,)."""
    outside_marks = {what: np.broadcast_to(mask, (e.size,)) for what, mask in e.outside.items() if np.any(mask)}
    beyond = np.zeros(e.size, dtype=bool)
    for flow in e.flows.values():
        if flow.known_temperature is not None:
            T = value(flow.known_temperature)
            if not (np.max(T) <= T_LIMIT[1] and np.min(T) >= T_LIMIT[0]):
                beyond |= (T > T_LIMIT[1]) | (T < T_LIMIT[0])
    if beyond.any():
        outside_marks["the gas data"] = beyond
    return outside_marks


@dataclass(frozen=True)
class PointReadings:
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
        self._along = tuple(network.input_leaf(w) for w in wrt)
        self.directions = frozenset((*self._unknowns, *self._along)) if wrt else frozenset()

    def subset(self, points: Array) -> SubsetReader:
        """A reader for a batch that is these points (n,) of all."""
        return SubsetReader(self, points)

    def part(self, points: Array) -> PointReadings:
        """What was read of these points (n,)."""
        reasons = {k: self.reasons[i] for k, i in enumerate(points.tolist()) if i in self.reasons}
        limits = {name: mask[points] for name, mask in self.limits.items()}
        return PointReadings(
            self.y[points], self.jacobian[points], self.also[points], self.status[points], reasons, limits
        )

    def take(self, points: Array, read: PointReadings) -> None:
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
                self.also[points, c] = _values(e, self._model_column(e, column))[rows]
        for c, x in enumerate(found.values()):
            self.y[points, c] = _values(e, x)[rows]
        if self.wrt and self.columns:
            self.jacobian[points], left = self._sensitivities(e, found, rows)
            self.y[points] += np.where(np.isfinite(left), left, 0.0)  # a singular point keeps what it has
        self.status[points] = OK
        for name, mask in self.network.acting(e).items():
            acts = self.limits.setdefault(name, np.zeros(len(self.status), dtype=bool))
            acts[points] = np.broadcast_to(mask, (e.size,))[rows]
        for name, mask in outside_marks(e).items():
            outside = points[mask[rows]]
            self.status[outside] = OUTSIDE_MAP
            for i in outside.tolist():
                self.reasons[i] = f"{self.reasons[i]}, {name}" if i in self.reasons else f"outside {name}"

    def _sensitivities(self, e: Evaluation, outputs: Mapping[str, Value], rows: Array) -> tuple[Array, Array]:
        """dy/dθ (n, m, p) of some rows, and −G_x F_x⁻¹ F (n, m): what the outputs lack for balances F not zero."""
        some = slice(None) if len(rows) == e.size else rows
        F_x, G_x = (solver.directed(e, r, self._unknowns)[..., some] for r in (e.balances, outputs))
        # G_x F_x⁻¹ first: there are fewer outputs than parameters
        weights = solver.substituted(*solver.factors(F_x.transpose(1, 0, 2)), G_x.transpose(1, 0, 2))
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
                self.sensors[self._signals[column]].read(self.network.read, e)
            return e.signals[column]
        if column in self.sensors:
            return self.sensors[column].read(self.network.read, e)
        return self.network.read(e, column)

    def _model_column(self, e: Evaluation, column: str) -> Value:
        """What is there, whatever a sensor reads of it; of what only a sensor has, what that reads."""
        try:
            return self.network.read(e, column)
        except KeyError:
            return self._read(e, column)


class SubsetReader:
    """The reader of a batch that is part of all points."""

    def __init__(self, outputs: Outputs, points: Array):
        self.outputs, self.points, self.directions = outputs, points, outputs.directions

    def subset(self, some: Array) -> SubsetReader:
        """The reader of some of its points."""
        return SubsetReader(self.outputs, self.points[some])

    def read(self, e: Evaluation, rows: Array, points: Array) -> None:
        self.outputs.read(e, rows, self.points[points])


def _values(e: Evaluation, x: Value) -> Array:
    v = value(x)
    return v if isinstance(v, np.ndarray) and v.shape == (e.size,) else np.broadcast_to(v, (e.size,))


FIT_FROM = 500  # points from which a fitted start of their own pays
COVERED = 0.98
"""Share of the points that a fitted start must cover to serve. Judgement."""
LEARNING = solver.Effort(max_iterations=9, tolerance=1e-3, by_differences=True)
"""Of the anchors: a start need not be exact, and anchors that take longer can be spared."""
WALK_STEP = {"rpm": 0.12, "other": 0.6}  # largest change of ln(corrected power setting) in one step of a walk
MAX_WALK_STEPS = 12
"""Steps of a walk from the design point at most; further points take longer steps."""
ENOUGH = 0.9
"""Share of the anchors that is enough for a fit. Judgement: of fewer, those at the ends of the range are missing."""
WALK = solver.Effort(max_iterations=6, tolerance=1e-3, by_differences=True)
"""On the way, where a point is only a start of the next one and need not converge."""
LOST = 2
"""Steps of a walk that lead nowhere, one after the other, before it is given up."""
RETRY_ITERATIONS = 30
"""Iterations of a second try from another start: half of the usual number, since most of these points have no solution.
Judgement."""
FLOW_EXPONENT = 1.2
"""Air flow rises a little faster than speed, as on the working line of most compressors. A first guess, no result."""
LARGEST_NEIGHBOUR_TABLE = 2_000_000
"""Distances between failed and solved points that are computed at once: 16 MB."""
LESS_FLOW = (0.9, 0.8, 0.7, 0.6, 0.5)  # of the design point's


@dataclass(frozen=True)
class RetryOptions:
    """`by_differences`: as in `solver.Effort`; `all_starts`: points that fail are tried from every start, or only from
    their neighbours."""

    by_differences: bool = False
    all_starts: bool = True


class Strategy:
    """Solves batches of operating points of one network; keeps only its fitted start."""

    def __init__(self, network: Network, nominal: Mapping[str, float], envelope: Mapping[str, Array]) -> None:
        """`envelope`: anchors (n,) by input column, none where it is not known."""
        self.network = network
        self.nominal = nominal
        self.envelope = envelope
        self.fit: StartFit | None = None
        self.everywhere = False  # the fit is of the envelope, and of no batch

    def forget(self) -> None:
        """Forgets the fitted start."""
        self.fit, self.everywhere = None, False

    def prepare(self, points: Mapping[str, Any], valid: Array) -> None:
        """Fits a start for many points (N,), once, from anchors over the envelope, so that it is the same for every
        batch; where that is not known, from some of their own, again when the remembered one does not cover them."""
        at = np.flatnonzero(valid)
        if at.size <= solver.FEW_POINTS:
            return
        if self.fit is None and self.envelope:
            defaults = {c: v for c, v in self.network.inputs().items() if v is not None}
            self._learn({**defaults, **self.envelope})
            self.everywhere = self.fit is not None
            if not self.everywhere:
                self.envelope = {}
        if self.everywhere:
            return
        names, z = self._coordinates(solver.take(points, at), at.size)
        if at.size < FIT_FROM or (self.fit is not None and self.fit.covers(names, z).mean() > COVERED):
            return
        drawn = np.random.default_rng(0).choice(at.size, min(ANCHORS, at.size), replace=False)
        anchors = np.array(sorted({*drawn.tolist(), *z.argmin(axis=1).tolist(), *z.argmax(axis=1).tolist()}))
        self._learn(solver.take(points, at[anchors]))

    def _learn(self, anchors: Mapping[str, Any]) -> None:
        """Fits a start to the solutions of these points, if half of them have one."""
        names, z = self._coordinates(anchors, next(np.size(v) for v in anchors.values() if np.ndim(v)))
        solved = solver.newton(self.network, anchors, self.nominal, self._plain(anchors, z.shape[1]), LEARNING)
        x, good = solved.x, solved.residual <= LEARNING.aim
        if good.mean() < ENOUGH:
            far = np.flatnonzero(~good)
            u = solver.take(anchors, far)
            solved = solver.newton(self.network, u, self.nominal, self._walk(u, self.nominal, far.size), LEARNING)
            x[:, far], good[far] = solved.x, solved.residual <= LEARNING.aim
        good &= np.isfinite(z).all(axis=0)  # a wild input may have no coordinate
        if good.mean() >= 0.5:
            self.fit = StartFit.fit(names, z[:, good], x[:, good])

    def solve(
        self,
        points: Mapping[str, Any],
        theta: Mapping[str, Any],
        start: Array | None,
        reader: SubsetReader,
        tries: RetryOptions,
    ) -> solver.Solution:
        """Unknowns of all points of the reader, which takes what it wants of those that converge; start (nx, n) or
        None."""
        solved = self.first(points, theta, start, reader, tries)
        # few points, or they would not be worth the effort; in the same way in every batch
        again_effort = solver.Effort(max_iterations=RETRY_ITERATIONS, by_differences=True)
        # less air flow last: from there the way may lead to a solution that no engine runs at
        ways = (self._from_design, self._walk_failed, self._from_neighbours, self._from_less_flow)
        for again in ways if tries.all_starts else (self._from_neighbours,):
            failed = np.flatnonzero(~solved.converged)
            if not failed.size:
                break
            x = again(points, theta, solved, failed)
            if x is None:
                continue
            u, t = solver.take(points, failed), solver.take(theta, failed)
            retried = solver.newton(self.network, u, t, x, again_effort, reader.subset(failed))
            better = retried.residual < solved.residual[failed]
            at = failed[better]
            solved.x[:, at], solved.residual[at] = retried.x[:, better], retried.residual[better]
            solved.balances[:, at] = retried.balances[:, better]
            solved.passes[failed] += retried.passes
            solved.read[failed] |= retried.read
        return solved

    def first(
        self,
        points: Mapping[str, Any],
        theta: Mapping[str, Any],
        start: Array | None,
        reader: SubsetReader,
        tries: RetryOptions,
    ) -> solver.Solution:
        """As `solve`, without another try for what does not converge."""
        size = len(reader.points)
        x = self._first(points, size) if start is None else np.where(np.isfinite(start), start, self._design(size))
        return solver.newton(self.network, points, theta, x, solver.Effort(by_differences=tries.by_differences), reader)

    # starts (nx, n)

    def _design(self, size: int) -> Array:
        return np.repeat(np.array([[u.start] for u in self.network.unknowns()]), size, axis=1)

    def _first(self, points: Mapping[str, Any], size: int) -> Array:
        x = self._plain(points, size)
        if self.fit is not None:
            names, z = self._coordinates(points, size)
            if self.everywhere:  # of further inputs it knows nothing
                names, z = self.fit.names, z[[names.index(n) for n in self.fit.names]]
            # far from its anchors it may lead to a solution that no engine runs at
            known = self.fit.covers(names, z)
            if known.any():
                # of what effects solve for beside the engine's own a fit that is shared may know nothing
                found = self.fit.predict(z[:, known])
                x[: len(found), known] = found
        return x

    def _plain(self, points: Mapping[str, Any], size: int) -> Array:
        """The design point; where the speed of a compressor is given, air flow ∝ speed^FLOW_EXPONENT."""
        x = self._design(size)
        setting = self.network.power_setting
        column = setting if setting in self.network.speed_columns else self.network.air_speed_column
        if column is not None:
            design = self.network.design_setting if column == setting else self.network.design_corrected_speed(column)
            flow = next(k for k, u in enumerate(self.network.unknowns()) if u.is_flow)
            with np.errstate(all="ignore"):
                ratio = points[column] / (design * correction(column, *total_ratios(points)))
            x[flow] *= np.nan_to_num(np.clip(ratio, 0.1, 1.2), nan=1.0) ** FLOW_EXPONENT
        return x

    def _walk(self, points: Mapping[str, Any], theta: Mapping[str, Any], size: int) -> Array:
        """From the design power setting to the wanted one in equal ratios, a few iterations at each."""
        setting = self.network.power_setting
        target = np.broadcast_to(points[setting], (size,))
        with np.errstate(all="ignore"):
            origin = self.network.design_setting * correction(setting, *total_ratios(points))
            ratio = np.nan_to_num(np.log(target / origin), nan=0.0, posinf=0.0, neginf=0.0)
        largest = WALK_STEP["rpm" if setting in self.network.speed_columns else "other"]
        steps = np.clip(np.ceil(np.abs(ratio) / largest), 1, MAX_WALK_STEPS)
        x, lost = self._design(size), np.zeros(size, dtype=int)
        for k in range(int(steps.max())):
            on = np.flatnonzero((k < steps) & (lost < LOST))
            if not on.size:
                break
            here = {**points, setting: origin * np.exp(ratio * (k / steps))}
            u, t = solver.take(here, on), solver.take(theta, on)
            found = solver.newton(self.network, u, t, x[:, on], WALK)
            there = found.residual < 0.1
            x[:, on] = np.where(there, found.x, x[:, on])
            lost[on] = np.where(there, 0, lost[on] + 1)
        return x

    def _from_design(
        self, points: Mapping[str, Any], theta: Mapping[str, Any], solved: solver.Solution, failed: Array
    ) -> Array:
        return self._plain(solver.take(points, failed), failed.size)

    def _walk_failed(
        self, points: Mapping[str, Any], theta: Mapping[str, Any], solved: solver.Solution, failed: Array
    ) -> Array:
        return self._walk(solver.take(points, failed), solver.take(theta, failed), failed.size)

    def _from_neighbours(
        self, points: Mapping[str, Any], theta: Mapping[str, Any], solved: solver.Solution, failed: Array
    ) -> Array | None:
        good = np.flatnonzero(solved.converged)
        if not good.size:
            return None
        good = good[:: max(1, failed.size * good.size // LARGEST_NEIGHBOUR_TABLE)]
        _, z = self._coordinates(points, len(solved.residual))
        z = z / np.maximum(np.ptp(z, axis=1), 1e-9)[:, None]
        distance = ((z[:, failed, None] - z[:, None, good]) ** 2).sum(axis=0)
        return solved.x[:, good[distance.argmin(axis=1)]]

    def _from_less_flow(
        self, points: Mapping[str, Any], theta: Mapping[str, Any], solved: solver.Solution, failed: Array
    ) -> Array:
        u, t = solver.take(points, failed), solver.take(theta, failed)
        flow = [k for k, x in enumerate(self.network.unknowns()) if x.is_flow]
        x = np.repeat(self._plain(u, failed.size)[:, None], len(LESS_FLOW), axis=1)
        x[flow] *= np.array(LESS_FLOW)[:, None]
        u, t = solver.repeated(u, len(LESS_FLOW)), solver.repeated(t, len(LESS_FLOW))
        found = solver.newton(self.network, u, t, x.reshape(len(x), -1), WALK)
        best = found.residual.reshape(len(LESS_FLOW), -1).argmin(axis=0)
        return found.x.reshape(x.shape)[:, best, np.arange(failed.size)]

    def _coordinates(self, points: Mapping[str, Any], size: int) -> tuple[tuple[str, ...], Array]:
        states = self.network.remembered
        moving = {c: v for c, v in points.items() if isinstance(v, np.ndarray) and c not in states}
        with np.errstate(invalid="ignore"):
            return coordinates(self.network.power_setting, moving, size)


CHUNK = 10_000
"""Most points that are solved together: enough to hide the overhead of calls, few enough for memory."""
SHARE, SHARE_PER_MB = 300, 4.0
"""Fewest points for which another process is begun, and how many more for each megabyte that this one holds: a copy of
a small process takes as long as some hundred points, and one of a large process has its tables of memory to copy."""


@dataclass(frozen=True)
class SharedSolution:
    """What another process found of some points: unknowns, residuals, passes, and what was read."""

    x: Array
    residual: Array
    passes: Array
    read: PointReadings


class PointBatch:
    """Points (N,) with parameters `theta` of an engine, read by `out`; x (nx, N), residual (N,), passes (N,). unmet: of
    points that did not converge, the index of the balance that is met least."""

    def __init__(self, strategy: Strategy, points: Mapping[str, Any], theta: Mapping[str, Any], out: Outputs):
        self.strategy, self.points, self.theta, self.out = strategy, points, theta, out
        size = len(out.status)
        self.x = np.full((len(strategy.network.unknowns()), size), np.nan)
        self.residual, self.passes = np.full(size, np.inf), np.zeros(size, dtype=int)
        self.worst_balance: dict[int, int] = {}

    def solve(self, valid: Array, start: Array | None, tries: RetryOptions) -> None:
        """The points valid (N,), from unknowns `start` (nx, N), or None."""
        if start is None:
            self.strategy.prepare(self.points, valid)
        for at in _chunks(np.flatnonzero(valid), CHUNK):
            if not self._solve_shared(at, start, tries):
                self._solve_alone(at, start, tries)

    def _solve_alone(self, at: Array, start: Array | None, tries: RetryOptions) -> None:
        u, t, first = self._subset(at, start)
        self._finish(at, self.strategy.solve(u, t, first, self.out.subset(at), tries))

    def _solve_shared(self, at: Array, start: Array | None, tries: RetryOptions) -> bool:
        """Whether several processes solved these points."""
        n = process_count(len(at) // SHARE)
        if n > 1:  # seldom so, and to ask for the memory takes time
            n = process_count(int(len(at) / (SHARE + SHARE_PER_MB * resident_MB())))
        if n == 1:
            return False
        parts = np.array_split(at, n)
        found = parallel_map(lambda k: self._share(parts[k], start, tries), n)
        shares = [share for share in found if share is not None]
        if len(shares) < n:
            self.out.forget(at)
            return False
        for part, share in zip(parts, shares, strict=True):
            self.x[:, part], self.residual[part], self.passes[part] = share.x, share.residual, share.passes
            self.out.take(part, share.read)
        return True

    def _share(self, at: Array, start: Array | None, tries: RetryOptions) -> SharedSolution | None:
        """None where not all of the points converge at once."""
        u, t, first = self._subset(at, start)
        solved = self.strategy.first(u, t, first, self.out.subset(at), tries)
        if not solved.converged.all():
            return None
        self._finish(at, solved)
        return SharedSolution(self.x[:, at], self.residual[at], self.passes[at], self.out.part(at))

    def _subset(self, at: Array, start: Array | None) -> tuple[Mapping[str, Any], Mapping[str, Any], Array | None]:
        return solver.take(self.points, at), solver.take(self.theta, at), None if start is None else start[:, at]

    def _finish(self, at: Array, solved: solver.Solution) -> None:
        """Takes over what was found, and reads what is not read yet."""
        out = self.out
        self.x[:, at], self.residual[at], self.passes[at] = solved.x, solved.residual, solved.passes
        failed = ~solved.converged
        out.status[at[failed]] = NOT_CONVERGED
        self.worst_balance |= {int(at[k]): solved.worst(k) for k in np.flatnonzero(failed).tolist()}
        reader = out.subset(at)
        rest = np.flatnonzero(solved.converged & ~solved.read)
        for some in solver.blocks(rest, out.directions):
            u, t, _ = self._subset(at[some], None)
            e = solver.evaluate(self.strategy.network, u, t, solved.x[:, some], out.directions)
            reader.read(e, np.arange(some.size), some)


def _chunks(index: Array, size: int) -> Iterator[Array]:
    for k in range(0, len(index), size):
        yield index[k : k + size]
