"""Throttle manoeuvres: power against time as a sequence of set points, at one flight condition or several."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from enginediag_cli.config.fields import Field, Section
from enginediag_cli.errors import DataError
from enginediag_cli.simulation.missions import UNRECORDED

SERIES = True

SET_POINT = Section(
    "set_point",
    "a corner of the course, straight lines between",
    (
        Field("time_s", "number", "since the beginning", unit="s", minimum=0.0),
        Field("power", "number", "fraction of the rating, 0 idle", minimum=0.0, maximum=1.2),
        Field("phase", "text", "what begins here; default as before", ""),
        Field("altitude_m", "number", "altitude; default as before, from 0", None, unit="m"),
        Field("mach", "number", "Mach number; default as before, from 0", None, minimum=0.0),
        Field("dT_isa_K", "number", "deviation from ISA; default as before, from 0", None, unit="K"),
    ),
)
SECTION = Section(
    "manoeuvres",
    "throttle manoeuvres: accelerations, decelerations, Bodie manoeuvres, run-ups",
    (
        Field("set_points", "sections", "in the order of time, the first one at 0 s", section=SET_POINT),
        Field("record_interval_s", "number", "time between records", 1.0, unit="s", minimum=0.001),
        Field("flight_interval_s", "number", "from one flight to the next", 3600.0, unit="s", minimum=0.0),
    ),
)


def generate(
    settings: Mapping[str, Any],
    count: int,
    engine: object,
    rng: np.random.Generator,
) -> dict[str, NDArray]:
    """Columns of `count` flights, all alike: the records, and the corners between them. Raises DataError for set points
    whose times do not rise from 0."""
    points = settings["set_points"]
    times = np.array([p["time_s"] for p in points], dtype=float)
    if len(times) < 2 or times[0] != 0.0 or (np.diff(times) <= 0.0).any():
        raise DataError("the set points of manoeuvres need times that rise from 0 s, two at least")
    records = settings["record_interval_s"] * np.arange(int(times[-1] / settings["record_interval_s"] + 1e-9) + 1)
    every = np.union1d(records, times)
    # a corner beside a record is that record
    corner = ~np.isin(every, records)
    near = corner & (np.abs(every[:, None] - records).min(axis=1) < 1e-9)
    every, corner = every[~near], corner[~near]
    phases = _kept([p["phase"] or None for p in points], "manoeuvre")
    leg = np.clip(np.searchsorted(times, every, side="right") - 1, 0, len(times) - 1)
    columns = {"power_fraction": np.interp(every, times, [p["power"] for p in points])}
    for column in ("altitude_m", "mach", "dT_isa_K"):
        columns[column] = np.interp(every, times, _kept([p[column] for p in points], 0.0))
    shift = max(settings["flight_interval_s"], times[-1] + settings["record_interval_s"]) if count > 1 else 0.0
    flight = np.repeat(np.arange(count), len(every))
    return {
        **{name: np.tile(v, count) for name, v in columns.items()},
        "time_s": np.tile(every, count) + shift * flight,
        "phase": np.tile(np.array(phases)[leg], count),
        "flight": 1 + flight,
        UNRECORDED: np.tile(corner.astype(int), count),
    }


def _kept(values: list[Any], before: Any) -> list[Any]:
    """What is not said is as before."""
    found = []
    for v in values:
        before = before if v is None else v
        found.append(before)
    return found
