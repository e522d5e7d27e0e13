"""What the other rooms need of an engine: `engine.Engine` has all of it, and so may a small model in a test."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from enginediag_cli.parameters import Parameter


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
