"""Faults of components and of instruments, how they grow with time, and the YAML file that describes them.

A fault has an activity g(x) against a clock x, 0 before the onset. The clock is `record` (1 for the first record),
`flight` (1 for the first flight) or `hours` (since the first record). step: g = 1. ramp: g from 0 to 1 within the
duration. drift: g = rate · (x − onset), without end. saturating: g = 1 − exp(−(x − onset)/T), the law of compressor
fouling after a wash (Aker and Saravanamuttoo, J. Eng. Gas Turbines Power 111(2), 1989). intermittent: g = 1 in the
first part of every period.

A component fault changes parameters of the engine. A sensor fault changes a reading after the engine has produced it.
bias: reading + g · size. scale: reading · (1 + g · change). noise: reading + g · size · N(0, 1), white in time, beside
the normal noise of the sensor. stuck: the last reading before the fault, or a stated value, while g > 0. dropped: no
reading while g > 0.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any
from zlib import crc32

import numpy as np
from numpy.typing import NDArray

from enginediag_cli.config.fields import Field, Section, Variants, near
from enginediag_cli.config.validate import load_checked
from enginediag_cli.engine.instrument_errors import forms
from enginediag_cli.engine.wrapped import EngineLike
from enginediag_cli.errors import ConfigError, DataError, Mark, Problem
from enginediag_cli.parameters import Parameter

CLOCKS = ("record", "flight", "hours")

COMMON = (
    Field("clock", "choice", "what onset and durations count", "record", choices=CLOCKS),
    Field("onset", "number", "clock reading from which the fault is there; from the start where absent", None),
    Field("end", "number", "clock reading from which it is gone again (repair, wash)", None),
)

STEP: dict[str, Any] = {"type": "step", "clock": "record", "onset": None, "end": None}
"""Values of the law that is there from the first record on."""

LAWS = Variants(
    "law",
    "how the fault grows",
    {
        "step": Section("step", "sudden and lasting", COMMON),
        "ramp": Section(
            "ramp",
            "grows linearly to full size",
            (*COMMON, Field("duration", "number", "time from onset to full size, in the clock's unit", minimum=1e-9)),
        ),
        "drift": Section(
            "drift",
            "grows without end",
            (*COMMON, Field("rate", "number", "share of the full size gained per unit of the clock", minimum=0.0)),
        ),
        "saturating": Section(
            "saturating",
            "grows fast, then ever slower towards full size",
            (*COMMON, Field("time_constant", "number", "time to 63 % of full size, in the clock's unit", minimum=1e-9)),
        ),
        "intermittent": Section(
            "intermittent",
            "comes and goes",
            (
                *COMMON,
                Field("period", "number", "from one appearance to the next, in the clock's unit", minimum=1e-9),
                Field("present", "number", "share of the period in which it is there", 0.5, minimum=0.0, maximum=1.0),
            ),
        ),
    },
)

Shape = Callable[[NDArray[np.float64], Mapping[str, Any]], NDArray[np.float64]]

SHAPES: dict[str, Shape] = {
    "step": lambda since, law: np.ones_like(since),
    "ramp": lambda since, law: np.clip(since / law["duration"], 0.0, 1.0),
    "drift": lambda since, law: law["rate"] * since,
    "saturating": lambda since, law: -np.expm1(-since / law["time_constant"]),
    "intermittent": lambda since, law: (since % law["period"] < law["present"] * law["period"]).astype(float),
}


@dataclass(frozen=True)
class Clocks:
    """Clock readings of N records; a clock that the conditions do not have is absent."""

    readings: Mapping[str, NDArray[np.float64]]

    def __getitem__(self, clock: str) -> NDArray[np.float64]:
        """Readings (N,). Raises DataError when the conditions lack the column that the clock needs."""
        if clock not in self.readings:
            column = {"flight": "flight", "hours": "time_s"}[clock]
            raise DataError(f"a fault counts by {clock}, but the conditions have no column {column!r}")
        return self.readings[clock]

    def slice(self, start: int, stop: int) -> Clocks:
        return Clocks({name: values[start:stop] for name, values in self.readings.items()})


def clocks_from_columns(columns: Mapping[str, NDArray], n: int) -> Clocks:
    """Clocks of N records from their `flight` and `time_s` columns, where there are any.

    Flights are counted in order of appearance, whatever they are called.
    """
    readings = {"record": np.arange(1.0, n + 1.0)}
    if "flight" in columns:
        _, first, label = np.unique(np.asarray(columns["flight"]), return_index=True, return_inverse=True)
        order = np.empty(len(first))
        order[np.argsort(first)] = np.arange(1.0, len(first) + 1.0)
        readings["flight"] = order[label.reshape(-1)]
    if "time_s" in columns and n:
        time = np.asarray(columns["time_s"], dtype=float)
        readings["hours"] = (time - time[0]) / 3600.0
    return Clocks(readings)


def activity(law: Mapping[str, Any], clocks: Clocks) -> NDArray[np.float64]:
    """Activity g (N,) of a law, given by the values of its section. Raises DataError without its clock."""
    reading = clocks[law["clock"]]
    onset = law["onset"] if law["onset"] is not None else (0.0 if law["clock"] == "hours" else 1.0)
    there = reading >= onset
    if law["end"] is not None:
        there &= reading < law["end"]
    since = np.where(there, reading - onset, 0.0)
    return np.where(there, SHAPES[law["type"]](since, law), 0.0)


EFFECTS = Variants(
    "effect",
    "what the fault does to the reading",
    {
        "bias": Section(
            "bias",
            "adds to the reading; with law drift it grows without end",
            (Field("size", "number", "what is added at full size, in the column's unit"),),
        ),
        "scale": Section(
            "scale",
            "multiplies the reading",
            (Field("change", "number", "relative change of the reading at full size"),),
        ),
        "noise": Section(
            "noise",
            "scatters beyond the noise that it has",
            (Field("size", "number", "standard deviation of the added scatter, in the column's unit", minimum=0.0),),
        ),
        "stuck": Section(
            "stuck",
            "repeats one reading",
            (Field("value", "number", "the reading, in the column's unit; the last good one where absent", None),),
        ),
        "dropped": Section("dropped", "gives no reading", ()),
    },
)

BEFORE_NOISE = ("bias", "scale", "noise")
"""Effects on the transducer; the others act on the recorded number, noise and rounding included."""


@dataclass(frozen=True)
class SensorFault:
    """One instrument, what is wrong with it and since when."""

    name: str
    column: str
    effect: Mapping[str, Any]
    law: Mapping[str, Any] = field(default_factory=lambda: dict(STEP))
    mark: Mark = field(default_factory=lambda: Mark("fault"))
    reference: str = ""
    assumed: bool = False

    @property
    def truth_name(self) -> str:
        """Name in the file of true values: `sensor.T3_K.bias`, `.noise` in the column's unit, `.scale` as a factor."""
        return f"sensor.{self.column}.{self.effect['type']}"


def sensor_truth(faults: Iterable[SensorFault], clocks: Clocks) -> dict[str, NDArray[np.float64]]:
    """What sensor faults do at each record, (N,) by name; biases of one column add, factors multiply."""
    hidden: dict[str, NDArray[np.float64]] = {}
    for fault in faults:
        name, what = fault.truth_name, fault_truth(fault, clocks)
        if name in hidden:
            combine = {"bias": np.add, "scale": np.multiply, "noise": np.hypot}.get(fault.effect["type"], np.maximum)
            what = combine(hidden[name], what)
        hidden[name] = what
    return hidden


def fault_truth(fault: SensorFault, clocks: Clocks) -> NDArray[np.float64]:
    """What the fault does at each record, (N,): the bias, the factor, the added standard deviation, or 1 where stuck or
    dropped."""
    grown = activity(fault.law, clocks)
    if fault.effect["type"] in ("bias", "noise"):
        return grown * fault.effect["size"]
    if fault.effect["type"] == "scale":
        return 1.0 + grown * fault.effect["change"]
    return (grown > 0.0).astype(float)


class SensorFaultState:
    """A sensor fault in a recording that is made chunk by chunk: keeps the last good reading. entropy: of the
    random numbers of one that scatters."""

    def __init__(self, fault: SensorFault, entropy: Sequence[int] = ()) -> None:
        self.fault = fault
        self._held = np.nan
        self._rng = np.random.default_rng(np.random.SeedSequence([*entropy, crc32(fault.name.encode())]))

    def apply(self, reading: NDArray[np.float64], clocks: Clocks) -> NDArray[np.float64]:
        """Readings (n,) of the next records with the fault in them; `clocks` are those of these records."""
        kind, what = self.fault.effect["type"], fault_truth(self.fault, clocks)
        if kind == "bias":
            return reading + what
        if kind == "scale":
            return reading * what
        if kind == "noise":
            return reading + what * self._rng.standard_normal(len(reading))
        if kind == "dropped":
            return np.where(what > 0.0, np.nan, reading)
        return self._repeat_reading(reading, what > 0.0)

    def _repeat_reading(self, reading: NDArray[np.float64], stuck: NDArray[np.bool_]) -> NDArray[np.float64]:
        if self.fault.effect["value"] is not None:
            return np.where(stuck, self.fault.effect["value"], reading)
        # entry 0 is what was held before this chunk; stuck from the start holds the first reading
        if np.isnan(self._held) and np.isfinite(reading).any():
            self._held = float(reading[np.argmax(np.isfinite(reading))])
        known = np.concatenate([[self._held], reading])
        good = np.concatenate([[True], ~stuck & np.isfinite(reading)])
        last = np.maximum.accumulate(np.where(good, np.arange(len(known)), 0))
        held = known[last[1:]]
        self._held = float(held[-1]) if len(held) else self._held
        return np.where(stuck, held, reading)


NOWHERE = Mark("fault")


@dataclass(frozen=True)
class ComponentFault:
    """A direction in parameter space, its size at full activity and the law by which it gets there.

    `changes`: parameter → change at severity 1, relative where the nominal value is not 0, else in its unit.
    """

    name: str
    changes: Mapping[str, float]
    severity: float = 1.0
    law: Mapping[str, Any] = field(default_factory=lambda: dict(STEP))
    marks: Mapping[str, Mark] = field(default_factory=dict)
    mark: Mark = NOWHERE
    reference: str = ""
    assumed: bool = False

    def change_mark(self, parameter: str) -> Mark:
        return self.marks.get(parameter, self.mark)


@dataclass(frozen=True)
class FaultSet:
    """Faults that are in an engine together."""

    components: tuple[ComponentFault, ...] = ()
    sensors: tuple[SensorFault, ...] = ()

    @property
    def names(self) -> tuple[str, ...]:
        return (*(fault.name for fault in self.components), *(fault.name for fault in self.sensors))


def faults_from_changes(name: str, changes: Mapping[str, float], engine: Any) -> FaultSet:
    """Faults, all called `name`, that make these changes of parameters from nominal, each in the parameter's unit, from
    the first record on. Raises DataError for parameters that the engine does not have."""
    errors = {e.parameter.name: e for column in engine.inputs for e in forms(engine, column)}
    unknown = [n for n in changes if n not in engine.parameters and n not in errors]
    if unknown:
        raise DataError(f"engine {engine.name!r} has no parameter {', '.join(unknown)}; was it found with another one?")
    own = {n: engine.parameters[n].nominal for n in changes if n in engine.parameters}
    relative = {n: changes[n] / nominal if nominal else changes[n] for n, nominal in own.items()}
    instruments = [
        SensorFault(
            name,
            errors[n].column,
            {"type": "scale", "change": changes[n]} if errors[n].multiplies else {"type": "bias", "size": changes[n]},
        )
        for n in changes
        if n not in own
    ]
    return FaultSet((ComponentFault(name, relative),) if relative else (), tuple(instruments))


def check_faults(faults: FaultSet, engine: EngineLike) -> None:
    """Raises ConfigError with every parameter and column that the engine does not have, and a near match."""
    problems: list[Problem] = []
    for fault in faults.components:
        problems += [
            Problem(
                fault.change_mark(name),
                f"engine {engine.name!r} has no parameter {name!r}",
                near(name, engine.parameters),
            )
            for name in fault.changes
            if name not in engine.parameters
        ]
    readable = (*engine.sensors, *engine.inputs, *engine.optional_inputs)
    problems += [
        Problem(fault.mark, f"engine {engine.name!r} has no sensor {fault.column!r}", near(fault.column, readable))
        for fault in faults.sensors
        if fault.column not in readable
    ]
    if problems:
        raise ConfigError(problems)


def parameter_values(
    faults: Iterable[ComponentFault],
    parameters: Mapping[str, Parameter],
    clocks: Clocks,
) -> dict[str, NDArray[np.float64]]:
    """Value (N,) of every parameter that a fault changes.

    Faults on one parameter multiply where the nominal value is not 0, θ_k = θ0 Π (1 + severity · change ·
    g_k), and add where it is, θ_k = Σ severity · change · g_k. Raises ConfigError where a value leaves the
    bounds.
    """
    values: dict[str, NDArray[np.float64]] = {}
    for fault in faults:
        grown = fault.severity * activity(fault.law, clocks)
        for name, change in fault.changes.items():
            nominal = parameters[name].nominal
            before = values.get(name, np.full(len(grown), nominal))
            values[name] = before * (1.0 + change * grown) if nominal else before + change * grown
            _check_bounds(fault, parameters[name], values[name])
    return values


def _check_bounds(fault: ComponentFault, parameter: Parameter, values: NDArray[np.float64]) -> None:
    below, above = values < parameter.lower, values > parameter.upper
    beyond = below | above
    if beyond.any():
        k = int(np.argmax(beyond))
        bound = parameter.lower if below[k] else parameter.upper
        raise ConfigError(
            [
                Problem(
                    fault.change_mark(parameter.name),
                    f"fault {fault.name!r} takes {parameter.name} to {values[k]:g} at record {k + 1}, "
                    f"beyond its bound {bound:g}",
                    "lower the severity, or end the fault earlier",
                )
            ]
        )


_LAW = Field("law", "section", "how it grows; a step from the first record where absent", STEP, section=LAWS)

COMPONENT_FAULT = Section(
    "fault",
    "a direction in parameter space",
    (
        Field("description", "text", "what happens in the engine", ""),
        Field("reference", "text", "where direction and size come from", ""),
        Field("assumed", "boolean", "true where the size is engineering judgement, not published", False),
        Field(
            "changes",
            "number_map",
            "change of each parameter at severity 1: relative for scale factors "
            "(nominal not 0), in the parameter's unit for biases (nominal 0)",
        ),
        Field("severity", "number", "how much of these changes at full size", 1.0),
        _LAW,
    ),
)

SENSOR_FAULT = Section(
    "sensor fault",
    "an instrument that reads wrong",
    (
        Field("description", "text", "what happens to the instrument", ""),
        Field("reference", "text", "where the size comes from", ""),
        Field("assumed", "boolean", "true where the size is engineering judgement, not published", False),
        Field("column", "text", "column of the recording that it affects, e.g. T3_K"),
        Field("effect", "section", "what it does to the reading", section=EFFECTS),
        _LAW,
    ),
)

FAULT_FILE = Section(
    "faults",
    "faults of components and of sensors",
    (
        Field("kind", "choice", "kind of file", "faults", choices=("faults",)),
        Field("description", "text", "what this set of faults is", ""),
        Field("source", "text", "where directions and sizes come from", ""),
        Field("faults", "named_sections", "faults of components", (), section=COMPONENT_FAULT),
        Field("sensor_faults", "named_sections", "faults of sensors", (), section=SENSOR_FAULT),
    ),
)


def load_faults(*paths: str | Path) -> FaultSet:
    """Read the faults of one or more fault files.

    Returns
    -------
    FaultSet
        All faults together.

    Raises
    ------
    ConfigError
        For anything wrong in a file, with its line and column.
    """
    components: list[ComponentFault] = []
    sensors: list[SensorFault] = []
    for path in paths:
        checked = load_checked(path, "faults")
        faults, instruments = checked.values["faults"], checked.values["sensor_faults"]
        if not faults and not instruments:
            raise ConfigError(
                [Problem(checked.mark(), "the file describes no fault", "give 'faults:' or 'sensor_faults:'")]
            )
        for k, values in enumerate(faults):
            marks = {name: checked.key_mark(("faults", k, "changes", name)) for name in values["changes"]}
            components.append(
                ComponentFault(
                    values["name"],
                    values["changes"],
                    values["severity"],
                    values["law"],
                    marks,
                    checked.mark(("faults", k)),
                    values["reference"],
                    values["assumed"],
                )
            )
        for k, values in enumerate(instruments):
            sensors.append(
                SensorFault(
                    values["name"],
                    values["column"],
                    values["effect"],
                    values["law"],
                    checked.mark(("sensor_faults", k, "column")),
                    values["reference"],
                    values["assumed"],
                )
            )
    return FaultSet(tuple(components), tuple(sensors))
