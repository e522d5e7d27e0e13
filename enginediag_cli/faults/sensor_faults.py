"""Faults of instruments: what happens to a reading after the engine has produced it.

bias: reading + g · size. scale: reading · (1 + g · change). noise: reading + g · size · N(0, 1), white in time, beside
the noise that the sensor has. stuck: the last reading before, or a given one, while g > 0. dropped: no reading while
g > 0. g is the activity of the fault's law.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any
from zlib import crc32

import numpy as np
from numpy.typing import NDArray

from enginediag_cli.config.fields import Field, Section, Variants
from enginediag_cli.errors import Mark
from enginediag_cli.faults.laws import STEP, Clocks, activity

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
        name, what = fault.truth_name, truth(fault, clocks)
        if name in hidden:
            combine = {"bias": np.add, "scale": np.multiply, "noise": np.hypot}.get(fault.effect["type"], np.maximum)
            what = combine(hidden[name], what)
        hidden[name] = what
    return hidden


def truth(fault: SensorFault, clocks: Clocks) -> NDArray[np.float64]:
    """What the fault does at each record, (N,): the bias, the factor, the added standard deviation, or 1 where stuck or
    dropped."""
    grown = activity(fault.law, clocks)
    if fault.effect["type"] in ("bias", "noise"):
        return grown * fault.effect["size"]
    if fault.effect["type"] == "scale":
        return 1.0 + grown * fault.effect["change"]
    return (grown > 0.0).astype(float)


class SensorFaultState:
    """A sensor fault in a recording that is made chunk by chunk: remembers the last good reading. entropy: of the
    random numbers of one that scatters."""

    def __init__(self, fault: SensorFault, entropy: Sequence[int] = ()) -> None:
        self.fault = fault
        self._held = np.nan
        self._rng = np.random.default_rng(np.random.SeedSequence([*entropy, crc32(fault.name.encode())]))

    def apply(self, reading: NDArray[np.float64], clocks: Clocks) -> NDArray[np.float64]:
        """Readings (n,) of the next records with the fault in them; `clocks` are those of these records."""
        kind, what = self.fault.effect["type"], truth(self.fault, clocks)
        if kind == "bias":
            return reading + what
        if kind == "scale":
            return reading * what
        if kind == "noise":
            return reading + what * self._rng.standard_normal(len(reading))
        if kind == "dropped":
            return np.where(what > 0.0, np.nan, reading)
        return self._stuck(reading, what > 0.0)

    def _stuck(self, reading: NDArray[np.float64], stuck: NDArray[np.bool_]) -> NDArray[np.float64]:
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
