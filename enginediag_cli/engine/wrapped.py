"""Models around another model that add parameters to it: the common base, an engine with a warm start, and lags.

A wrapper has parameters of its own beside those of the model inside it. `WrappedModel` splits a request into what
belongs to the wrapper and what goes on to the inner model, so that a wrapper contains only what it adds. Wrappers can
be nested.

What other packages need of an engine is declared as protocols (`Model`, `MonitoredModel`, `EngineLike`). `Engine` meets
all of them, and so may a small model in a test.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections import OrderedDict
from collections.abc import Iterator, Mapping, Sequence
from contextlib import AbstractContextManager, contextmanager, nullcontext
from copy import copy
from dataclasses import dataclass, field, replace
from itertools import islice
from typing import Any, Protocol, TypeVar

import numpy as np
from numpy.typing import NDArray

from enginediag_cli.engine.engine import Engine, Prediction
from enginediag_cli.engine.filters import Lag
from enginediag_cli.engine.recall import MOMENT, UNKNOWN_PAST, bridge_gaps
from enginediag_cli.parameters import Parameter


@dataclass(frozen=True)
class PredictionRequest:
    """What is requested of a wrapper, in the words of `Engine.predict`: `parameters` of the inner model, values of the
    wrapper's `own` as far as they were given, all directions `wrt`, and the `options` of the model innermost."""

    inputs: Mapping[str, Any]
    parameters: Mapping[str, Any]
    own: Mapping[str, Any]
    sensors: Sequence[str] | None
    wrt: tuple[str, ...]
    options: Mapping[str, Any] = field(default_factory=dict)

    def is_same(self, other: PredictionRequest) -> bool:
        """Whether it is the same question, so that the answer is."""
        mine, theirs = (None if q.sensors is None else tuple(q.sensors) for q in (self, other))
        return (mine, self.wrt) == (theirs, other.wrt) and all(
            a.keys() == b.keys() and all(np.array_equal(v, b[name]) for name, v in a.items())
            for a, b in (
                (self.inputs, other.inputs),
                (self.parameters, other.parameters),
                (self.own, other.own),
                (self.options, other.options),
            )
        )


class WrappedModel(ABC):
    """`model` with parameters of its `own` beside the model's; what a wrapper adds is its `_answer`."""

    # what a model has, found at the inner one unless a wrapper has its own
    name: str
    inputs: tuple[str, ...]
    optional_inputs: Mapping[str, float]
    sensors: Mapping[str, Any]
    monitored: tuple[str, ...]

    def __init__(self, model: Any, own: Mapping[str, Parameter]):
        self.model = model
        self.own: dict[str, Parameter] = dict(own)
        self.parameters: dict[str, Parameter] = {**model.parameters, **own}

    def __getattr__(self, name: str) -> Any:
        if name == "model" or name.startswith("__"):  # not there yet while a copy is being made
            raise AttributeError(name)
        return getattr(self.model, name)

    def predict(
        self,
        inputs: Mapping[str, Any],
        parameters: Mapping[str, Any] | None = None,
        *,
        sensors: Sequence[str] | None = None,
        wrt: Sequence[str] = (),
        **options: Any,
    ) -> Any:
        """As `Engine.predict`, with the wrapper's own among the parameters and directions."""
        given = dict(parameters or {})
        own = {name: given.pop(name) for name in tuple(given) if name in self.own}
        return self._predict(PredictionRequest(inputs, given, own, sensors, tuple(wrt), options))

    @abstractmethod
    def _predict(self, request: PredictionRequest) -> Any:
        """The prediction, with what the wrapper adds."""

    def _predict_inner(self, request: PredictionRequest, **other: Any) -> Any:
        """The answer of the inner model, which knows nothing of `own`; `other`: fields that it is asked otherwise."""
        q = replace(request, **other)
        return self.model.predict(q.inputs, q.parameters, sensors=q.sensors, wrt=q.wrt, **q.options)

    def _predict_inner_scaled(
        self, request: PredictionRequest, like: Mapping[str, str], slopes: Mapping[str, Any], **other: Any
    ) -> Any:
        """The same where own directions are directions of the inner model: `like` gives its name, `slopes` what its
        column (N, m) is multiplied by, a number or (N,)."""
        along = [like.get(name, name) for name in request.wrt]
        inner = tuple(dict.fromkeys(along))
        found = self._predict_inner(request, wrt=inner, **other)
        if inner == request.wrt:
            return found
        J = np.asarray(found.jacobian)[:, :, [inner.index(name) for name in along]]
        for i, name in enumerate(request.wrt):
            if name in slopes:
                J[:, :, i] *= np.reshape(slopes[name], (-1, 1))
        result = copy(found)  # predictions are frozen, and those of small models not all data classes
        object.__setattr__(result, "jacobian", J)
        object.__setattr__(result, "wrt", request.wrt)
        return result


class Model(Protocol):
    """What identification needs: inputs, sensors and parameters by name, and y = Φ(u, θ) with ∂Φ/∂θ."""

    @property
    def inputs(self) -> tuple[str, ...]: ...
    @property
    def optional_inputs(self) -> Mapping[str, float]: ...
    @property
    def sensors(self) -> Mapping[str, Any]: ...
    @property
    def parameters(self) -> Mapping[str, Parameter]: ...
    def predict(
        self,
        inputs: Mapping[str, Any],
        parameters: Mapping[str, Any] | None = None,
        *,
        sensors: Sequence[str] | None = None,
        wrt: Sequence[str] = (),
    ) -> Any: ...


class MonitoredModel(Model, Protocol):
    """What monitoring needs besides: a name for messages, and which parameters are watched."""

    @property
    def name(self) -> str: ...
    @property
    def monitored(self) -> tuple[str, ...]: ...


class SensorLike(Protocol):
    """What simulation needs of a sensor, in the unit of its column."""

    @property
    def noise_sigma(self) -> float: ...
    @property
    def maximum(self) -> float | None: ...


class PredictionLike(Protocol):
    @property
    def y(self) -> NDArray[np.float64]: ...
    @property
    def status(self) -> NDArray[np.int8]: ...
    @property
    def columns(self) -> Sequence[str]: ...
    def reason(self, k: int) -> str: ...


class EngineLike(Protocol):
    """What simulation needs of an engine."""

    @property
    def name(self) -> str: ...
    @property
    def inputs(self) -> Sequence[str]: ...
    @property
    def optional_inputs(self) -> Mapping[str, float]: ...
    @property
    def sensors(self) -> Mapping[str, SensorLike]: ...
    @property
    def parameters(self) -> Mapping[str, Parameter]: ...
    @property
    def power_setting(self) -> str: ...
    @property
    def envelope(self) -> Mapping[str, tuple[float, float]]: ...
    def power_from_fraction(
        self,
        fraction: NDArray[np.float64],
        inputs: Mapping[str, NDArray[np.float64]],
    ) -> NDArray[np.float64]: ...
    def predict(
        self,
        inputs: Mapping[str, NDArray[np.float64]],
        parameters: Mapping[str, NDArray[np.float64]] | None = None,
        *,
        sensors: Sequence[str] | None = None,
    ) -> PredictionLike: ...


REMEMBERED = 300_000
"""Records whose solution is kept, 200 bytes each: a fit in blocks comes back to the first after the last."""
KEPT = 5_000_000
"""Numbers of the predictions that are kept, the last ones, 40 MB."""
MOVED, BATCHES = 0.02, 40
"""Share of the largest value of each input by which records may have moved to be taken for the same, and batches, the
last that were solved, among which they are sought. Judgement: from as far as that an iteration converges at once."""
NEIGHBOURS = 4
"""Batches, the last that were solved, among whose operating points new records look for the nearest."""

AnyModel = TypeVar("AnyModel")
Memory = OrderedDict[int, tuple[np.ndarray, np.ndarray]]
"""Operating points (N, d) and unknowns (nx, N) of batches, by a key that distinguishes them, the last one last."""


class WarmEngine(WrappedModel):
    """An engine that starts where it ended: for fits, which solve the same records again and again.

    From one iteration of a fit to the next the parameters move a little and the operating points not at all, so the
    last solution of the same records is a far better start than any other, and records that do not converge from
    afar do so from there. Records that are new begin at the solution of the nearest operating point. What was predicted
    last is kept: a fit asks for it again, for the covariance of its estimates and where its next pass begins.

    `engine` with a memory of the unknowns of its last batches, or with that of another engine of the same unknowns,
    `like`; everything else is the engine's own. `walk`: records that had a solution and lose it are sought in every
    way; without, parameters that lose them are too far."""

    def __init__(
        self, engine: Engine, remembered: int = REMEMBERED, *, walk: bool = True, like: WarmEngine | None = None
    ):
        super().__init__(engine, {})
        self._walk, self._remembered = walk, remembered
        self._last: Memory = OrderedDict()
        self._found: OrderedDict[int, _KnownPrediction] = OrderedDict()
        if like is not None and like.model.unknowns == engine.unknowns:
            self._last = like._last

    def _predict(self, request: PredictionRequest) -> Prediction:
        """From the remembered start, on which the answer does not depend beyond the solver's tolerance."""
        points = self._points(request.inputs)
        key = hash(points.tobytes())
        known = self._last.get(key)
        met = known is not None and np.array_equal(known[0], points)
        before = self._found.get(key)
        if before is not None and before.request.is_same(request):
            return before.prediction
        start = known[1] if known is not None and met else self._shifted_start(points)
        start = self._nearest_start(points) if start is None else start
        ways = {} if self._walk or not met else {"walk": False}
        found: Prediction = self._predict_inner(request, options={**request.options, "start": start, **ways})
        # a point that failed keeps the start that it had: the next parameters may suit it again
        x = np.where(found.ok, found.x, np.nan if start is None else start)
        if len(points) == found.y.shape[0] and np.isfinite(x).any():
            self._last[key] = points, x
            self._last.move_to_end(key)
            while len(self._last) > 1 and sum(len(p) for p, _ in self._last.values()) > self._remembered:
                self._last.popitem(last=False)
        self._found.pop(key, None)
        self._found[key] = _KnownPrediction(replace(request, inputs=dict(request.inputs)), found)
        while sum(f.size for f in self._found.values()) > KEPT:
            self._found.popitem(last=False)
        return found

    @contextmanager
    def preserve_memory(self) -> Iterator[None]:
        """What is solved inside is forgotten: whatever comes next begins where it would have begun without it."""
        last, found = self._last.copy(), self._found.copy()
        try:
            yield
        finally:
            self._last.clear()  # others may share it
            self._last.update(last)
            self._found.clear()
            self._found.update(found)

    @property
    def memory(self) -> tuple[Memory, Any]:
        """Where records had their solutions, and what effects remember of recordings, for another process."""
        return self._last, self.model.recalled

    def restore_memory(self, memory: tuple[Memory, Any]) -> None:
        """Begin where another process has ended."""
        self._last, recalled = memory
        self.model.restore_recall(recalled)

    def forget_predictions(self) -> None:
        """Forget what was predicted last: the fit is over."""
        self._found.clear()

    def _points(self, inputs: Mapping[str, Any]) -> np.ndarray:
        """Operating points (N, d): all inputs that the engine must have."""
        return np.column_stack(np.broadcast_arrays(*(np.atleast_1d(np.asarray(inputs[c], float)) for c in self.inputs)))

    def _shifted_start(self, points: np.ndarray) -> np.ndarray | None:
        """Unknowns (nx, N) of the remembered batch of which these are the same records, read a little otherwise: as a
        fit reads its inputs when it seeks their errors. None where there is no such batch."""
        size = np.maximum(np.abs(points).max(axis=0, initial=0.0), 1e-9)
        best, found = MOVED, None
        for key in islice(reversed(self._last), BATCHES):
            before, x = self._last[key]
            if before.shape == points.shape and (far := float(np.abs((before - points) / size).max())) < best:
                best, found = far, x
        return found

    def _nearest_start(self, points: np.ndarray) -> np.ndarray | None:
        """Unknowns (nx, N) of the nearest remembered operating points; None when there are none."""
        from scipy.spatial import cKDTree

        if not self._last or not np.isfinite(points).all():
            return None
        last = [self._last[key] for key in islice(reversed(self._last), NEIGHBOURS)]
        known = np.concatenate([p for p, _ in last])
        x = np.concatenate([x for _, x in last], axis=1)
        solved = np.isfinite(x).all(axis=0) & np.isfinite(known).all(axis=1)
        if not solved.any():
            return None
        scale = np.maximum(np.ptp(known[solved], axis=0), 1e-9)
        return np.asarray(x[:, solved][:, cKDTree(known[solved] / scale).query(points / scale)[1]])


@dataclass(frozen=True)
class _KnownPrediction:
    """A prediction, and what it was asked for."""

    request: PredictionRequest
    prediction: Prediction

    @property
    def size(self) -> int:
        """Numbers that it holds, mostly."""
        return self.prediction.jacobian.size


def warm_start(model: AnyModel) -> AnyModel | WarmEngine:
    """The model with a memory, if it is an engine; any other model as it is."""
    return WarmEngine(model) if isinstance(model, Engine) else model


def preserve_memory(model: Any) -> AbstractContextManager[None]:
    """`WarmEngine.preserve_memory` of the engine with a memory that a model wraps, if it does."""
    own = getattr(model, "preserve_memory", None)
    return nullcontext() if own is None else own()


class NominalEngine(WrappedModel):
    """`model`, an engine or one with errors of its maps, at its nominal state: parameters that a request does not give
    are as identified.

    Along time flies `engine`, the engine alone; errors of maps are then those of the same records at rest, to first
    order. sigma: standard deviation of one reading, as identified, by column in its unit; rho1: its correlation from
    record to record."""

    def __init__(
        self,
        model: Any,
        engine: Engine,
        values: Mapping[str, float],
        sigma: Mapping[str, float],
        rho1: Mapping[str, float],
    ):
        super().__init__(model, {})
        self._values = {name: v for name, v in values.items() if name in model.parameters}
        self.parameters = {
            name: p.with_nominal(self._values[name]) if name in self._values else p
            for name, p in model.parameters.items()
        }
        plain = {name: v for name, v in self._values.items() if name in engine.parameters}
        self.engine, self.rho1 = engine.replace_nominals(plain), dict(rho1)
        self.sensors = {c: replace(s, noise_sigma=sigma.get(c, s.noise_sigma)) for c, s in engine.sensors.items()}

    def _predict(self, request: PredictionRequest) -> Any:
        return self._predict_inner(request, parameters={**self._values, **request.parameters})

    def model_error(
        self, inputs: Mapping[str, Any], parameters: Mapping[str, Any], sensors: Sequence[str]
    ) -> NDArray[np.float64]:
        """By how much errors of the maps move the readings (N, m), in the units of their columns."""
        if self.model is self.engine:
            return np.zeros(())
        whole = self.predict(inputs, parameters, sensors=sensors)
        alone = self.engine.predict(inputs, parameters, sensors=sensors)
        both = np.asarray(whole.ok) & alone.ok
        return np.where(both[:, None], np.asarray(whole.y) - alone.y, 0.0)


LAGS_S = (2.0, 6.0, 20.0, 60.0)
"""Time constants of the lags, s: those of probes and actuators, of thin metal and of casings (Walsh and Fletcher, Gas
Turbine Performance, ch. 8), a factor of three apart, so that what lies between two is a sum of both."""
TAPES_KEPT = 4
"""Tapes whose deviations are kept: windows of one recording come one after the other."""


class LagModel(WrappedModel):
    """How far readings of an engine are ahead of what follows them with a lag, record by record.

    Whatever a model of a moving engine lacks (heat that metal takes up, a probe's lag, an actuator's) shows in a
    reading, in first order, as a sum of such deviations: of the reading y as the engine has it at once and first-order
    lags of it, m_τ − y, which is 0 at rest.

    The model, which may have no memory itself, called with the past of every record: for what readings lag by.
    `parameters`: values at which its readings are followed."""

    def __init__(self, model: Any, parameters: Mapping[str, float], lags_s: Sequence[float] = LAGS_S):
        super().__init__(model, {})
        self._at = {name: v for name, v in parameters.items() if name in model.parameters}
        self.lags_s = tuple(lags_s)
        self.optional_inputs = {**model.optional_inputs, **UNKNOWN_PAST}
        self._known: OrderedDict[tuple[Any, ...], np.ndarray] = OrderedDict()

    def deviations(self, inputs: Mapping[str, Any], sensors: Sequence[str], size: int) -> np.ndarray:
        """m_τ − y (size, m, T) of the readings `sensors` in records with these inputs; 0 where no past is known."""
        moment = np.broadcast_to(inputs.get(MOMENT, UNKNOWN_PAST[MOMENT]), (size,))
        number, place = self.model.tapes.locate(moment)
        found = np.zeros((size, len(sensors), len(self.lags_s)))
        for k in np.unique(number[number >= 0]).tolist():
            rows = number == k
            found[rows] = self._tape_deviations(k, tuple(sensors))[place[rows]]
        return found

    def _tape_deviations(self, k: int, sensors: tuple[str, ...]) -> np.ndarray:
        """(n, m, T) at all records of a tape."""
        tape = self.model.tapes.tapes[k]
        key = (k, len(tape), sensors)
        if key in self._known:
            return self._known[key]
        # at once: without the past that the engine itself may remember
        every = (*self.model.inputs, *self.model.optional_inputs)
        points = {c: tape.columns[c] for c in every if tape.has_column(c) and c != MOMENT}
        if any(c not in points for c in self.model.inputs):
            return np.zeros((len(tape), len(sensors), len(self.lags_s)))
        p = self.model.predict(points, self._at, sensors=sensors)
        y, clock, none = np.where(p.ok[:, None], p.y, np.nan), tape.clock(), np.zeros((0, len(tape)))
        found = np.zeros((*y.shape, len(self.lags_s)))
        for i, reading in enumerate(y.T):
            if np.isfinite(reading).any():
                whole = bridge_gaps(reading)
                for j, lag in enumerate(self.lags_s):
                    found[:, i, j] = Lag()(clock, whole, none, (lag,)).value
        self._known[key] = found
        while len(self._known) > TAPES_KEPT:
            self._known.popitem(last=False)
        return found

    def _predict(self, request: PredictionRequest) -> Any:
        return self._predict_inner(request)
