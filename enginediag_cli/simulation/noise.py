"""Sensor noise: Gaussian or uniform, correlated in time, rounded to a step, with gross outliers.

Every column has a stream of random numbers of its own, made from the seed and the column's name. So adding a
sensor leaves the noise of the others as it was, and cutting a recording into chunks changes nothing.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any
from zlib import crc32

import numpy as np
from numpy.typing import NDArray

from enginediag_cli.config.fields import Field, Section
from enginediag_cli.config.hints import near
from enginediag_cli.engine.wrapped import EngineLike
from enginediag_cli.errors import ConfigError, Mark, Problem


@dataclass(frozen=True)
class ColumnNoise:
    """Noise of one column, sizes in the column's unit.

    `sigma` is the standard deviation of Gaussian noise (stationary, also where `correlation` is not 0),
    `width` the range of uniform noise; `quantum` is a rounding step; an outlier adds ± `outlier_size`.
    """

    distribution: str = "gaussian"
    sigma: float = 0.0
    width: float = 0.0
    correlation: float = 0.0
    quantum: float = 0.0
    outlier_probability: float = 0.0
    outlier_size: float = 0.0


NONE: Mapping[str, Any] = {
    "type": "none",
    "scale": 1.0,
    "range_fraction": 0.01,
    "quantum_sigmas": 0.0,
    "correlation": 0.0,
    "outlier_probability": 0.0,
    "outlier_sigmas": 0.0,
    "columns": {},
}
"""Values of a noise section without noise."""

KINDS: Mapping[str, Mapping[str, Any]] = {
    "none": NONE,
    "gaussian": {**NONE, "type": "gaussian"},
    "uniform": {**NONE, "type": "uniform"},
    "correlated": {**NONE, "type": "gaussian", "correlation": 0.8},
    # rounding to a step q makes an error of standard deviation q/√12
    "quantised": {**NONE, "quantum_sigmas": float(np.sqrt(12.0))},
}
"""Noise sections by a single word: what the command line offers."""


def column_noise(values: Mapping[str, Any], engine: EngineLike, mark: Mark | None = None) -> dict[str, ColumnNoise]:
    """Noise of every sensor of the engine, and of the inputs that the section names, by column.

    `values` are those of the section `noise`. Raises ConfigError for a column that the engine does not have,
    for noise that is both uniform and correlated, and for sensors whose size of noise nobody gives.
    """
    mark = mark or Mark("noise")
    readable = (*engine.sensors, *engine.inputs, *engine.optional_inputs)
    problems = [
        Problem(mark, f"engine {engine.name!r} has no column {name!r}", near(name, readable))
        for name in values["columns"]
        if name not in readable
    ]
    noise = {
        column: _make_noise(values, _default_noise(values, sensor), sensor) for column, sensor in engine.sensors.items()
    }
    for column, own in values["columns"].items():
        noise[column] = _make_noise(values, own, engine.sensors.get(column))
    for column, one in noise.items():
        if one.distribution == "uniform" and one.correlation:
            problems.append(
                Problem(mark, f"{column}: noise cannot be both uniform and correlated", "correlated noise is Gaussian")
            )
        size = {"gaussian": one.sigma, "uniform": one.width, "none": 0.0}[one.distribution]
        if not np.isfinite(size):
            own, of_engine = ("sigma", "noise_sigma") if one.distribution == "gaussian" else ("width", "maximum")
            problems.append(
                Problem(
                    mark,
                    f"{column}: the size of its noise is not known",
                    f"give '{own}:' under noise.columns.{column}, or '{of_engine}:' in the engine file",
                )
            )
    if problems:
        raise ConfigError(problems)
    return noise


def _default_noise(values: Mapping[str, Any], sensor: Any) -> Mapping[str, Any]:
    """What a column without noise of its own takes from the section."""
    quantum = values["quantum_sigmas"]
    step = quantum * (values["scale"] * _number(sensor, "noise_sigma")) if quantum else 0.0
    return {**values, "sigma": None, "width": None, "quantum": step}


def _make_noise(values: Mapping[str, Any], own: Mapping[str, Any], sensor: Any) -> ColumnNoise:
    """The noise of a column; sizes that it does not state come from its sensor in the engine file."""
    sigma, width = own["sigma"], own["width"]
    sigma = values["scale"] * _number(sensor, "noise_sigma") if sigma is None else sigma
    width = values["range_fraction"] * _number(sensor, "maximum") if width is None else width
    # a uniform distribution of range w has the standard deviation w/√12
    spread = width / np.sqrt(12.0) if own["type"] == "uniform" else sigma
    outlier = own["outlier_sigmas"] * spread
    return ColumnNoise(
        own["type"], sigma, width, own["correlation"], own["quantum"], own["outlier_probability"], outlier
    )


def _number(sensor: Any, attribute: str) -> float:
    value = getattr(sensor, attribute, None)
    return float("nan") if value is None else float(value)


class NoiseSource:
    """Noise of one column, drawn chunk by chunk."""

    def __init__(self, column: str, noise: ColumnNoise, entropy: tuple[int, ...]) -> None:
        self.noise = noise
        self._random = _stream(entropy, column)
        self._outliers = _stream(entropy, column + " outliers")
        self._last: float | None = None

    def apply(self, reading: NDArray[np.float64]) -> NDArray[np.float64]:
        """The next readings (n,) with their noise; NaN stays NaN and uses up its random number."""
        noise, n = self.noise, len(reading)
        noisy = reading
        if noise.distribution == "gaussian":
            noisy = noisy + noise.sigma * self._correlated(self._random.standard_normal(n))
        elif noise.distribution == "uniform":
            noisy = noisy + noise.width * (self._random.random(n) - 0.5)
        if noise.outlier_probability:
            uniform = self._outliers.random((n, 2))
            sign = np.where(uniform[:, 1] < 0.5, -1.0, 1.0)
            struck = uniform[:, 0] < noise.outlier_probability
            noisy = noisy + np.where(struck, sign * noise.outlier_size, 0.0)
        if noise.quantum:
            noisy = noise.quantum * np.round(noisy / noise.quantum)
        return noisy

    def _correlated(self, white: NDArray[np.float64]) -> NDArray[np.float64]:
        """x_k = ρ x_{k−1} + √(1 − ρ²) ε_k with x_1 = ε_1: unit variance from the first record on."""
        rho = self.noise.correlation
        if not rho or not len(white):
            return white
        from scipy.signal import lfilter

        shocks = np.sqrt(1.0 - rho**2) * white
        if self._last is None:
            shocks[0], self._last = white[0], 0.0
        x, _ = lfilter([1.0], [1.0, -rho], shocks, zi=[rho * self._last])
        self._last = float(x[-1])
        return np.asarray(x)


def noise_sources(noise: Mapping[str, ColumnNoise], rng: np.random.Generator) -> dict[str, NoiseSource]:
    """A source for every column; takes the same few numbers from `rng` however many columns there are."""
    entropy = tuple(int(word) for word in rng.integers(0, 2**32, size=4))
    return {column: NoiseSource(column, one, entropy) for column, one in noise.items()}


def _stream(entropy: tuple[int, ...], name: str) -> np.random.Generator:
    return np.random.default_rng(np.random.SeedSequence([*entropy, crc32(name.encode())]))


DISTRIBUTIONS = ("gaussian", "uniform", "none")

_SHAPE = (
    Field("correlation", "number", "ρ from record to record (Gaussian noise only)", 0.0, minimum=0.0, maximum=0.999),
    Field("outlier_probability", "number", "probability of a gross error", 0.0, minimum=0.0, maximum=0.5),
    Field("outlier_sigmas", "number", "size of a gross error in standard deviations of the noise", 20.0, minimum=0.0),
)

COLUMN_NOISE = Section(
    "column noise",
    "noise of one column, in its own unit",
    (
        Field("type", "choice", "distribution", "gaussian", choices=DISTRIBUTIONS),
        Field("sigma", "number", "standard deviation, if Gaussian; default: the engine file's", None, minimum=0.0),
        Field("width", "number", "range, if uniform; default: `range_fraction` of the maximum", None, minimum=0.0),
        Field("quantum", "number", "step to which readings are rounded; 0 for none", 0.0, minimum=0.0),
        *_SHAPE,
    ),
)

NOISE = Section(
    "noise",
    "sensor noise",
    (
        Field("type", "choice", "distribution", "gaussian", choices=DISTRIBUTIONS),
        Field("scale", "number", "factor on the standard deviations of the engine file", 1.0, minimum=0.0),
        Field("range_fraction", "number", "range, if uniform, per maximum reading", 0.01, minimum=0.0, maximum=1.0),
        Field("quantum_sigmas", "number", "rounding step per standard deviation of the engine file", 0.0, minimum=0.0),
        *_SHAPE,
        Field("columns", "section_map", "columns with noise of their own, inputs too", {}, section=COLUMN_NOISE),
    ),
)
