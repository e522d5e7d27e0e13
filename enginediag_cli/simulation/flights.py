"""Simulated flights: the flight file, the missions that it names, the conditions record by record, and sensor noise.

Noise is Gaussian or uniform, correlated in time, rounded to a step, with gross outliers. Every column has its own
stream of random numbers, made from the seed and the column's name. So a further sensor does not change the noise of the
others, and a recording that is made in chunks is the same.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from copy import deepcopy
from dataclasses import dataclass
from typing import Any
from zlib import crc32

import numpy as np
from numpy.typing import NDArray

from enginediag_cli.config.fields import REQUIRED, Field, Section, Variants, near
from enginediag_cli.engine.evaluation import standard_atmosphere
from enginediag_cli.engine.wrapped import EngineLike
from enginediag_cli.errors import ConfigError, DataError, Mark, Problem
from enginediag_cli.simulation.missions import (
    AIRLINER,
    FOOT_M,
    GROUND,
    MANOEUVRES,
    SNAPSHOTS,
    SWEEP,
    UNRECORDED,
    draw_snapshots,
    draw_sweep,
    fly_airliner,
    fly_manoeuvres,
    run_on_ground,
)


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


Columns = dict[str, NDArray]


@dataclass(frozen=True)
class Mission:
    """A kind of mission: its keys in a flight file, and what makes the columns of so many flights.

    The columns are `flight`, `time_s`, `phase`, `altitude_m`, `mach`, `dT_isa_K` and `power_fraction`. series: whether
    records follow each other in time; then there may be a column UNRECORDED, 1 at points that bend the course but are
    not recorded.
    """

    section: Section
    generate: Callable[[Mapping[str, Any], int, EngineLike, np.random.Generator], Columns]
    series: bool = True


MISSIONS = {
    "airliner": Mission(AIRLINER, fly_airliner),
    "snapshots": Mission(SNAPSHOTS, draw_snapshots, series=False),
    "sweep": Mission(SWEEP, draw_sweep, series=False),
    "ground": Mission(GROUND, run_on_ground),
    "manoeuvres": Mission(MANOEUVRES, fly_manoeuvres),
}
MISSION = Variants("mission", "kind of mission", {name: m.section for name, m in MISSIONS.items()})

FLIGHT_FILE = Section(
    "flight",
    "flights to simulate, and how noisily they are recorded",
    (
        Field("kind", "choice", "kind of file", "flight", choices=("flight",)),
        Field("description", "text", "what these flights are", ""),
        Field("source", "text", "where the numbers come from", ""),
        Field("flights", "integer", "flights (days on the ground), if the command does not say", 1, minimum=1),
        Field("mission", "section", "what a flight looks like", section=MISSION),
        Field("constants", "number_map", "further inputs of the engine, each at one value", {}),
        Field("noise", "section", "sensor noise, if the command does not say", {}, section=NOISE),
    ),
)


LABELS = ("flight", "time_s", "phase")
"""Columns that place a record in a recording; never inputs of an engine."""


@dataclass(frozen=True)
class FlightConditions:
    """Columns of equal length N in the order in which they are written; `flight` and `phase` may be text.

    `series`: whether records follow each other in time, rather than being points that were drawn one by one. `way`:
    what is flown between them, too, where that has corners: the same columns at more points of time.
    """

    columns: Mapping[str, NDArray]
    series: bool = True
    path: FlightConditions | None = None

    def __post_init__(self) -> None:
        lengths = {name: len(values) for name, values in self.columns.items()}
        if len(set(lengths.values())) > 1:
            raise ValueError(f"columns differ in length: {lengths}")

    def __len__(self) -> int:
        return len(next(iter(self.columns.values()), ()))

    def slice(self, start: int, stop: int) -> FlightConditions:
        """Records `start` to `stop` (exclusive, counted from 0)."""
        cut = {name: values[start:stop] for name, values in self.columns.items()}
        return FlightConditions(cut, self.series, self.path)


def engine_inputs(engine: EngineLike, conditions: FlightConditions) -> dict[str, NDArray[np.float64]]:
    """The engine's input columns, (N,) each: all required ones, and the optional ones that are given.

    Raises DataError naming the missing column and a near match among those that are there.
    """
    inputs = {}
    for column in engine.inputs:
        if column not in conditions.columns:
            raise DataError(
                f"engine {engine.name!r} needs the column {column!r}, which the conditions lack "
                f"({near(column, conditions.columns)})"
            )
        inputs[column] = np.asarray(conditions.columns[column], dtype=float)
    for column in engine.optional_inputs:
        if column in conditions.columns:
            inputs[column] = np.asarray(conditions.columns[column], dtype=float)
    return inputs


def outside_envelope(engine: EngineLike, conditions: FlightConditions) -> dict[str, int]:
    """Column → number of records outside the engine's declared envelope; empty where all are inside."""
    counts = {}
    for column, (low, high) in engine.envelope.items():
        if column in conditions.columns:
            values = np.asarray(conditions.columns[column], dtype=float)
            margin = 1e-9 * max(abs(low), abs(high))
            outside = int(np.count_nonzero((values < low - margin) | (values > high + margin)))
            if outside:
                counts[column] = outside
    return counts


MAX_FLIGHTS_FOR_RECORDS = 100_000
"""Flights that are made for a wanted number of records at most: a stop for what should not happen."""


def generate_flights(
    plan: Mapping[str, Any],
    engine: EngineLike,
    rng: np.random.Generator,
    *,
    flights: int | None = None,
    records: int | None = None,
) -> FlightConditions:
    """Operating conditions of flights described by a flight file.

    Flight k is the same however many flights follow it, in the missions that draw flight by flight (airliner).

    Parameters
    ----------
    plan : values of a flight file
    engine : whose inputs are made
    rng : of all random draws
    flights : number of flights; default: the file's
    records : end after so many records; without `flights`, as many flights are flown as that takes

    Raises
    ------
    DataError
        The engine has an input that the flights do not give.
    """
    mission = plan["mission"]
    kind = MISSIONS[mission["type"]]
    count = flights if flights is not None else plan["flights"]
    if records is not None and flights is None:
        first = kind.generate(mission, 1, engine, deepcopy(rng))
        count = min(1 + records // max(len(first["time_s"]) // 2, 1), MAX_FLIGHTS_FOR_RECORDS)
    columns = kind.generate(mission, count, engine, rng)
    conditions = _recorded(complete_inputs(columns, engine, plan["constants"]), columns, kind.series)
    return conditions if records is None else conditions.slice(0, records)


def complete_inputs(
    columns: Mapping[str, NDArray], engine: EngineLike, constants: Mapping[str, float]
) -> FlightConditions:
    """The engine's columns from generated ones: power fraction → power setting, unknown columns dropped."""
    n = len(columns["time_s"])
    temperature, pressure = standard_atmosphere(columns["altitude_m"])
    given = {
        "ambient_temperature_K": np.asarray(temperature) + columns["dT_isa_K"],
        "ambient_pressure_Pa": np.asarray(pressure),
        **columns,
        **{name: np.full(n, value) for name, value in constants.items()},
    }
    unknown = [name for name in constants if name not in (*engine.inputs, *engine.optional_inputs)]
    if unknown:
        raise DataError(
            f"constants of the flight file that engine {engine.name!r} has no input for: "
            f"{', '.join(unknown)}; its inputs are {', '.join(engine.inputs)}"
        )
    known = {name: given[name] for name in (*engine.inputs, *engine.optional_inputs) if name in given}
    power = engine.power_from_fraction(columns["power_fraction"], known)
    given[engine.power_setting] = np.broadcast_to(np.asarray(power, dtype=float), (n,))
    missing = [name for name in engine.inputs if name not in given]
    if missing:
        raise DataError(
            f"the flight file gives no {', '.join(missing)}, which engine {engine.name!r} needs; "
            "hold it under 'constants:' or simulate with --conditions"
        )
    inputs = (*engine.inputs, *(name for name in engine.optional_inputs if name in given))
    return FlightConditions({name: given[name] for name in (*LABELS, *inputs)})


def _recorded(way: FlightConditions, columns: Mapping[str, NDArray], series: bool) -> FlightConditions:
    """The records among all points that a mission gives."""
    if UNRECORDED not in columns:
        return FlightConditions(way.columns, series)
    kept = columns[UNRECORDED] == 0
    return FlightConditions({name: values[kept] for name, values in way.columns.items()}, series, way)


AIRLINER_FLIGHTS = 5
"""Flights of an engine for which none are described: some thousand records."""
GROUND_DAYS = 30
"""Days of an engine on the ground: a month's weather."""
MARGIN_M = 100.0
"""Kept from the ceiling of the engine's envelope, so that no record is outside by rounding."""


def default_plan(engine: EngineLike) -> dict[str, Any]:
    """Values of a flight file: airliner flights within the engine's envelope, or days on the ground for an
    engine that knows no altitude."""
    flies = "altitude_m" in engine.inputs
    kind = "airliner" if flies else "ground"
    mission = {"type": kind, **_defaults(MISSIONS[kind].section)}
    if flies:
        _keep_inside(mission, engine)
    return {
        "flights": AIRLINER_FLIGHTS if flies else GROUND_DAYS,
        "mission": mission,
        "constants": {},
        "noise": _defaults(NOISE),
    }


def _keep_inside(mission: dict[str, Any], engine: EngineLike) -> None:
    """Lower cruise Mach number and levels to what the engine's envelope allows, step climbs included."""
    fastest = engine.envelope.get("mach", (0.0, 1.0))[1]
    low, high = mission["cruise_mach"]
    mission["cruise_mach"] = [low * min(1.0, fastest / high), min(high, fastest)]
    steps = 60.0 * mission["cruise_duration_min"][1] // (60.0 * mission["step_interval_min"])
    ceiling = engine.envelope.get("altitude_m", (0.0, 20000.0))[1] - MARGIN_M
    highest = ceiling / FOOT_M - steps * mission["step_climb_ft"]
    mission["cruise_levels_ft"] = sorted({min(level, highest) for level in mission["cruise_levels_ft"]})


def _defaults(section: Section) -> dict[str, Any]:
    """Values of a section of which the file gives none; tuples become lists as a file would give them."""
    assert all(field.default is not REQUIRED for field in section.fields)
    return {
        field.name: list(field.default) if isinstance(field.default, tuple) else field.default
        for field in section.fields
    }
