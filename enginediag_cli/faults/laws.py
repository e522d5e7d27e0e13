"""How a fault grows: activity g(x) against a clock x, 0 before the onset.

The clock is `record` (1 for the first record), `flight` (1 for the first flight) or `hours` (since the first
record). step: g = 1. ramp: g from 0 to 1 within the duration. drift: g = rate · (x − onset), without end.
saturating: g = 1 − exp(−(x − onset)/T), the law of compressor fouling after a wash (Aker and Saravanamuttoo,
J. Eng. Gas Turbines Power 111(2), 1989). intermittent: g = 1 in the first part of every period.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from enginediag_cli.config.fields import Field, Section, Variants
from enginediag_cli.errors import DataError

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


def clocks_of(columns: Mapping[str, NDArray], n: int) -> Clocks:
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
