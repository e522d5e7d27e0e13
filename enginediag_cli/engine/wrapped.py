"""A model around another: what every model that adds to another one does alike.

A wrapper offers parameters of its own beside those of the model inside it and answers for them; all else is the inner
model's. A question is taken apart here, into what is the wrapper's and what is not, so that a wrapper says only what
it adds. Wrappers stand in one another: what one does not know it passes on.

What the other rooms need of an engine: `engine.Engine` has all of it, and so may a small model in a test.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from copy import copy
from dataclasses import dataclass, field, replace
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from enginediag_cli.parameters import Parameter


@dataclass(frozen=True)
class Question:
    """What a wrapper is asked, in the words of `Engine.predict`: `parameters` of the inner model, values of the
    wrapper's `own` as far as they were given, all directions `wrt`, and the `options` of the model innermost."""

    inputs: Mapping[str, Any]
    parameters: Mapping[str, Any]
    own: Mapping[str, Any]
    sensors: Sequence[str] | None
    wrt: tuple[str, ...]
    options: Mapping[str, Any] = field(default_factory=dict)

    def same(self, other: Question) -> bool:
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
        return self._answer(Question(inputs, given, own, sensors, tuple(wrt), options))

    @abstractmethod
    def _answer(self, asked: Question) -> Any:
        """The prediction, with what the wrapper adds."""

    def _ask(self, asked: Question, **other: Any) -> Any:
        """The answer of the inner model, which knows nothing of `own`; `other`: fields that it is asked otherwise."""
        q = replace(asked, **other)
        return self.model.predict(q.inputs, q.parameters, sensors=q.sensors, wrt=q.wrt, **q.options)

    def _ask_along(self, asked: Question, like: Mapping[str, str], slopes: Mapping[str, Any], **other: Any) -> Any:
        """The same where own directions are directions of the inner model: `like` gives its name, `slopes` what its
        column (N, m) is multiplied by, a number or (N,)."""
        along = [like.get(name, name) for name in asked.wrt]
        inner = tuple(dict.fromkeys(along))
        found = self._ask(asked, wrt=inner, **other)
        if inner == asked.wrt:
            return found
        J = np.asarray(found.jacobian)[:, :, [inner.index(name) for name in along]]
        for i, name in enumerate(asked.wrt):
            if name in slopes:
                J[:, :, i] *= np.reshape(slopes[name], (-1, 1))
        result = copy(found)  # predictions are frozen, and those of small models not all data classes
        object.__setattr__(result, "jacobian", J)
        object.__setattr__(result, "wrt", asked.wrt)
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
