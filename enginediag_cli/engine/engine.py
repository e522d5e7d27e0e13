"""`Engine`: Y = Φ(U, θ) and ∂Φ/∂θ for whole batches. This is the engine as every other package uses it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from copy import copy
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np

from enginediag_cli.engine import solver
from enginediag_cli.engine import start as anchors
from enginediag_cli.engine.dual import Array
from enginediag_cli.engine.evaluation import Sensor
from enginediag_cli.engine.network import Network
from enginediag_cli.engine.recall import KnownLeaf, MemoryStore, Tape, Tapes
from enginediag_cli.engine.start import correction, total_ratios
from enginediag_cli.engine.strategy import (
    INVALID_INPUT,
    NOT_CONVERGED,
    OK,
    OUTSIDE_MAP,
    STATUS,
    Outputs,
    PointBatch,
    Prediction,
    RetryOptions,
    Strategy,
    chain_known_leaves,
)
from enginediag_cli.engine.term import Effect
from enginediag_cli.parameters import Parameter


class Engine:
    """A sized network with its sensors. Immutable in use; only the fitted start is remembered."""

    def __init__(self, network: Network, declared: Mapping[str, Any], path: str = ""):
        self.network = network
        self.path = path
        self.declared = declared
        self.name: str = declared["name"]
        self.description: str = declared["description"]
        self._network_inputs = dict(network.inputs())  # inputs of the network and of its sensors
        # the column that sets the power: the set point, where there is one
        self.power_setting: str = network.demand.column if network.demand is not None else network.power_setting
        self.sensors = {
            c: Sensor.from_mapping(c, v) for c, v in declared["sensors"].items() if c != network.power_setting
        }
        network.sensors = self.sensors
        for s in self.sensors.values():
            if s.soak:
                self._network_inputs.setdefault(s.soak, 0.0)
        found = self._network_inputs
        if network.demand is not None:
            found = {network.demand.column if c == network.power_setting else c: d for c, d in found.items()}
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
        self._changed_nominals: Mapping[str, float] = {}
        self._strategy = Strategy(network, self._nominal, self._anchors())
        # what recordings show of the past; speeds are known from it where they are measured
        # and the power where it is set
        shows = (s.column for s in self.sensors.values() if dict(s.reads) == {network.power_setting: 1.0})
        self.tapes = Tapes((*self.inputs, *self.optional_inputs, *network.speed_columns, *shows))
        self._recall = MemoryStore(self.tapes)
        self._trials = {n for m in network.memories for n in m.trial_sizes}

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
        """Input columns with the offset of an actuator from its rest, and the scatter of that from day to day."""
        found = (c.release for c in self.network.controls)
        return {r.wander: r.rest_sigma for r in found if r is not None and r.wander}

    def undecided(self, inputs: Mapping[str, Any]) -> dict[str, Array]:
        """Control → records (N,) for which it is uncertain whether it acts."""
        found = {}
        for c in self.network.controls:
            release = c.release
            if release is not None and release.margin > 0.0 and release.column in inputs:
                found[c.name] = release.is_undecided(np.asarray(inputs[release.column], dtype=float))
        return found

    @property
    def switches(self) -> tuple[str, ...]:
        """Input columns that switch an effect: 1 where it is on, 0 where it is off, and nothing between."""
        return tuple(dict.fromkeys(e.switch for e in self.effects if e.switch))

    def replace_effects(self, effects: Sequence[Effect]) -> Engine:
        """The same sized engine, carrying these effects and no others; the fitted start is shared."""
        if not effects and not self.effects:
            return self
        other = Engine(self.network.replace_effects(effects), self.declared, self.path)
        other._strategy.fit, other._strategy.everywhere = self._strategy.fit, self._strategy.everywhere
        other.tapes = self.tapes
        other._recall = MemoryStore(self.tapes)
        return other.replace_nominals({n: v for n, v in self._changed_nominals.items() if n in other.parameters})

    def replace_nominals(self, values: Mapping[str, float]) -> Engine:
        """The same engine with other nominal values of these parameters, as identified. Raises KeyError."""
        if not values:
            return self
        other = copy(self)
        other._changed_nominals = {**self._changed_nominals, **values}
        other.parameters = {**self.parameters, **{n: self.parameters[n].with_nominal(v) for n, v in values.items()}}
        other._nominal = {**self._nominal, **values}
        return other

    @property
    def nominal(self) -> Mapping[str, float]:
        """Parameters at their nominal values."""
        return dict(self._nominal)

    @property
    def changed_nominals(self) -> Mapping[str, float]:
        """Parameters with other nominal values than the file's."""
        return dict(self._changed_nominals)

    @property
    def recalled(self) -> Any:
        """Memories of its effects, for another process (`restore_recall`)."""
        return self._recall.contents

    def restore_recall(self, recalled: Any) -> None:
        """Go on where another process has ended."""
        self._recall.restore(recalled)

    def forget_start(self) -> None:
        """Forgets the fitted start, as if the engine had just been loaded."""
        self._strategy.forget()
        self._recall.forget()

    @np.errstate(all="ignore")  # what a wild input gives is not finite, and flagged as such
    def power_from_fraction(self, fraction: float | Array, inputs: Mapping[str, Any]) -> Array:
        """Power setting (N,), or the set point that asks for it, at a fraction of the corrected power range, 0 idle
        to 1 rating.

        Raises ValueError when the engine file states no range for this power setting.
        """
        if self.power_range is None:
            raise ValueError(f"{self.name}: the engine file gives no power range for {self.power_setting}")
        low, high = self.power_range
        theta, delta = total_ratios(inputs)
        asked = (low + (high - low) * np.asarray(fraction)) * correction(self.network.power_setting, theta, delta)
        return asked if self.network.demand is None else self.network.demand.set_point(asked)

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

        A point that fails is a flagged row, never an exception; so is one whose switch is neither 0 nor 1. `envelope`
        is not checked here: it is for those who generate or judge operating points.

        Parameters
        ----------
        inputs
            Column → values (N,) or a number; all of `self.inputs`, any of `self.optional_inputs`, in the column's unit.
        parameters
            Name → value (N,) or a number, in the parameter's unit; the others are nominal.
        sensors
            Columns to return: sensors, or any column of the model ("T4_K"). By default all sensors.
        wrt
            Parameters or input columns by which derivatives are taken.
        start
            Unknowns (nx, N) to begin with, such as `Prediction.x` of an earlier call.
        also
            Columns of the model to return as values only, without derivatives and without the errors of sensors.
        walk
            Whether points that fail are tried again from every other start.

        Returns
        -------
        Prediction
            Values (N, m), derivatives (N, m, p) and the status (N,) of every point.

        Raises
        ------
        KeyError
            For an unknown name, or an input that is missing.
        ValueError
            For unequal lengths, a column that is requested twice, or a `start` of another shape.
        """
        columns = tuple(self.sensors) if sensors is None else tuple(sensors)
        wrt = tuple(wrt)
        twice = sorted({c for c in columns if columns.count(c) > 1})
        if twice:
            raise ValueError(f"columns requested twice: {', '.join(twice)}")
        points, theta, size, valid, reasons = self._check_request(inputs, parameters or {}, (*columns, *also), wrt)
        if start is not None and np.shape(start) != (len(self.unknowns), size):
            raise ValueError(f"`start` must have shape ({len(self.unknowns)}, {size}), not {np.shape(start)}")
        known: dict[str, KnownLeaf] = {}
        if self.network.demand is not None or self.network.memories:
            known, unsettled = self._recall.known_leaves(self, points, theta, wrt, size)
            points = {c: v for c, v in points.items() if c in self._network_inputs} | {
                n: k.value for n, k in known.items()
            }
            wrong = [
                np.isfinite(k.value) if n != self.network.power_setting else k.value > 0.0 for n, k in known.items()
            ]
            for k in np.flatnonzero(valid & unsettled).tolist():
                reasons[k] = "its dynamic effects did not converge"
            valid &= ~unsettled
            start = self._recall.initial_unknowns({**inputs}, size) if start is None else start
            for (n, of), good in zip(known.items(), wrong, strict=True):
                reasons |= {k: f"{n} is {of.value[k]:g}" for k in np.flatnonzero(valid & ~good).tolist()}
                valid &= good
        further = tuple(n for n, k in known.items() if n not in wrt and k.slopes)
        found = self._predict_valid(
            points, theta, (valid, reasons), _Request(columns, (*wrt, *further), start, also, walk)
        )
        return chain_known_leaves(found, known, wrt) if known else found

    def tape_points(self, tape: Tape) -> dict[str, Any]:
        """Inputs of the network at the records (N,) of a tape; neutral where the tape has no such column."""
        points: dict[str, Any] = {}
        for c, default in self._network_inputs.items():
            lacking = np.full(len(tape), np.nan if default is None else default)
            points[c] = tape.columns.get(c, lacking)
        return points

    def solved(
        self,
        points: Mapping[str, Any],
        theta: Mapping[str, Any],
        size: int,
        columns: Sequence[str],
        wrt: Sequence[str],
        start: Array | None,
        walk: bool = True,
    ) -> Prediction:
        """Signals of memories, or other columns, at these inputs of the network, without any memory but what they
        contain; `walk` as in `predict`."""
        valid = np.logical_and.reduce([np.broadcast_to(np.isfinite(v), (size,)) for v in points.values()])
        valid = valid & (np.nan_to_num(points[self.network.power_setting]) > 0.0)
        return self._predict_valid(points, theta, (valid, {}), _Request(tuple(columns), tuple(wrt), start, (), walk))

    # inside

    def _predict_valid(
        self,
        points: Mapping[str, Any],
        theta: Mapping[str, Any],
        checked: tuple[Array, dict[int, str]],
        asked: _Request,
    ) -> Prediction:
        """The prediction at these inputs of the network, of which the valid ones are solved."""
        (valid, reasons), (columns, wrt, start, also, walk) = checked, asked
        size = len(valid)
        out = Outputs(self.network, self.sensors, columns, wrt, also, size)
        out.reasons.update(reasons)
        batch = PointBatch(self._strategy, points, theta, out)
        batch.solve(valid, start, RetryOptions(by_differences=size <= solver.FEW_POINTS, all_starts=walk))
        for k, balance in batch.worst_balance.items():
            out.reasons[k] = f"{self._balance_names[balance]} not met (residual {batch.residual[k]:.1e})"
        read, found = (out.y, out.jacobian, out.status), (batch.x, batch.residual, batch.passes)
        return Prediction(*read, columns, wrt, *found, out.also, out.reasons, out.limits)

    def _anchors(self) -> dict[str, Array]:
        """Inputs of the network over the envelope and the range of power; none where the engine file does not state
        them."""
        power, needed = self.network.power_setting, tuple(c for c, d in self._network_inputs.items() if d is None)
        ranges = {**self.envelope, **({} if self.power_range is None else {power: (0.0, 1.0)})}
        if any(c not in ranges for c in needed):
            return {}
        found = anchors.anchor_points(ranges, needed)
        if self.power_range is not None:
            low, high = self.power_range
            found[power] = (low + (high - low) * found[power]) * correction(power, *total_ratios(found))
        return found

    def _check_request(
        self, inputs: Mapping[str, Any], parameters: Mapping[str, Any], columns: tuple[str, ...], wrt: tuple[str, ...]
    ) -> tuple[dict[str, Any], dict[str, Any], int, Array, dict[int, str]]:
        """Inputs and parameters as `size` records, which of them (N,) are valid, and why the others are not."""
        self._check_names(inputs, parameters, columns, wrt)
        size = common_length({**inputs, **parameters})
        points: dict[str, Any] = {}
        for c in (*self.inputs, *self.optional_inputs):
            v = np.asarray(inputs.get(c, self.optional_inputs.get(c)), dtype=float)
            if c not in inputs:
                points[c] = float(v)
            else:
                points[c] = v.ravel() if v.size == size else np.broadcast_to(v.ravel(), (size,))
        theta: dict[str, Any] = dict(self._nominal)
        for name, v in parameters.items():
            theta[name] = np.asarray(v, dtype=float) if np.size(v) == size > 1 else float(np.ravel(v)[0])
        valid, reasons = self._valid_records(points, {p: theta[p] for p in parameters}, size)
        return points, theta, size, valid, reasons

    def _check_names(
        self, inputs: Mapping[str, Any], parameters: Mapping[str, Any], columns: Sequence[str], wrt: Sequence[str]
    ) -> None:
        """Raises KeyError for input columns that are missing, and for parameters and columns that do not exist."""
        missing = [c for c in self.inputs if c not in inputs]
        if missing:
            raise KeyError(f"input columns missing: {', '.join(missing)}")
        directions = {*self.parameters, *self.inputs, *self.optional_inputs, *self._trials}
        unknown = [n for n in parameters if n not in self.parameters] + [n for n in wrt if n not in directions]
        if unknown:
            raise KeyError(f"{self.name} has no parameter {', '.join(unknown)}")
        for column in columns:
            if column not in self.sensors and column not in self.model_columns:
                raise KeyError(f"{self.name} has no model column {column}")

    def _valid_records(
        self, points: Mapping[str, Any], parameters: Mapping[str, Any], size: int
    ) -> tuple[Array, dict[int, str]]:
        """Records (N,) whose values are finite, whose power is positive and whose switches are 0 or 1; why others are
        not."""
        valid, reasons = np.ones(size, dtype=bool), {}
        for name, v in (*points.items(), *parameters.items()):
            good = np.isfinite(v)
            if name == self.network.power_setting:
                good = good & (np.nan_to_num(v) > 0.0)
            if np.all(good):
                continue
            good = np.broadcast_to(good, (size,))
            for k in np.flatnonzero(valid & ~good).tolist():
                reasons[k] = f"{name} is {np.broadcast_to(v, (size,))[k]:g}"
            valid &= good
        for column in self.switches:
            v = np.broadcast_to(points[column], (size,))
            between = valid & (v != 0.0) & (v != 1.0)
            reasons |= {k: f"column {column} is a switch and holds {v[k]:g}" for k in np.flatnonzero(between).tolist()}
            valid &= ~between
        return valid, reasons

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


def common_length(values: Mapping[str, Any]) -> int:
    """Number of records of values that are numbers or arrays (N,). Raises ValueError where they differ."""
    lengths = {c: np.size(v) for c, v in values.items() if np.ndim(v)}
    sizes = {n for n in lengths.values() if n != 1} or {1}
    if len(sizes) > 1:
        raise ValueError(f"inputs and parameters differ in length: {', '.join(f'{c} {n}' for c, n in lengths.items())}")
    return sizes.pop()


class _Request(NamedTuple):
    """What a prediction is to contain, as in `Engine.predict`."""

    columns: tuple[str, ...]
    wrt: tuple[str, ...]
    start: Array | None
    also: Sequence[str]
    walk: bool


__all__ = ["INVALID_INPUT", "NOT_CONVERGED", "OK", "OUTSIDE_MAP", "STATUS", "Engine", "Prediction"]
