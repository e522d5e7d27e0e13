"""A flight that might be flown next: the corners of its course, as a mission file has them, and its conditions."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from enginediag_cli.engine.engine import Engine
from enginediag_cli.simulation.flights import with_power

RECORDS = 160
"""Records of a planned flight: an hour and a half of one every half minute, what an airline's flight brings in."""
INTERVAL_S = 30.0
"""Between records of a flight: slow enough for heat soak and rotors to follow."""


@dataclass(frozen=True)
class Corner:
    """Of the course, straight lines between: `share` of the flight's duration from 0 to 1; power as fraction of the
    rating; deviation from the standard day in K. An engine that stays where it is is at altitude 0."""

    share: float
    power: float
    altitude_m: float = 0.0
    mach: float = 0.0
    dT_isa_K: float = 0.0


@dataclass(frozen=True)
class PlannedFlight:
    """`kind` of flight, `words` that tell it from others, its corners, further inputs of the engine held at
    `constants`; records every `interval_s`."""

    kind: str
    words: str
    corners: Sequence[Corner]
    constants: Mapping[str, float] = field(default_factory=dict)
    records: int = RECORDS
    interval_s: float = INTERVAL_S

    @property
    def duration_s(self) -> float:
        return self.interval_s * (self.records - 1)

    def time(self, records: int) -> np.ndarray:
        """Times (records,) evenly over the flight, in s."""
        return np.linspace(0.0, self.duration_s, records)

    def inputs(self, engine: Engine, records: int) -> dict[str, np.ndarray]:
        """The engine's inputs (records,), evenly over the flight."""
        time = self.time(records)
        at = self.duration_s * np.array([c.share for c in self.corners])
        course = {
            name: np.interp(time, at, [getattr(c, name) for c in self.corners])
            for name in ("altitude_m", "mach", "dT_isa_K")
        }
        power = np.interp(time, at, [c.power for c in self.corners])
        labels = {"time_s": time, "flight": np.ones(records), "phase": np.zeros(records)}
        flown = with_power({**course, **labels, "power_fraction": power}, engine, self.constants)
        return {c: np.asarray(flown.columns[c], float) for c in engine.inputs}

    def flight_file(self, engine: Engine) -> dict[str, Any]:
        """Values of a flight file that says the same."""
        last = None
        points = []
        for c in self.corners:
            point: dict[str, Any] = {"time_s": round(c.share * self.duration_s, 3), "power": round(c.power, 4)}
            if "altitude_m" in engine.inputs and c.altitude_m != getattr(last, "altitude_m", 0.0):
                point["altitude_m"] = round(c.altitude_m, 1)
            if "mach" in engine.inputs and c.mach != getattr(last, "mach", 0.0):
                point["mach"] = round(c.mach, 4)
            if c.dT_isa_K != getattr(last, "dT_isa_K", 0.0):
                point["dT_isa_K"] = round(c.dT_isa_K, 2)
            points.append(point)
            last = c
        return {
            "kind": "flight",
            "description": f"planned: {self.words}",
            "source": "planned between rival explanations",
            "flights": 1,
            "mission": {"type": "manoeuvres", "record_interval_s": self.interval_s, "set_points": points},
            **({"constants": {c: float(f"{v:.6g}") for c, v in self.constants.items()}} if self.constants else {}),
        }
