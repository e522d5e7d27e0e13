"""A flight path put together leg by leg: altitude, phase and power against time."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray


class Profile:
    """Legs one after the other; each changes altitude linearly in time and has one phase and a power ramp.

    `times`, `altitudes` are the corners, s and m; leg i runs from corner i to i + 1.
    """

    def __init__(self, altitude_m: float) -> None:
        self.times = [0.0]
        self.altitudes = [altitude_m]
        self.phases: list[str] = []
        self.powers: list[tuple[float, float]] = []

    @property
    def altitude_m(self) -> float:
        return self.altitudes[-1]

    @property
    def end_s(self) -> float:
        return self.times[-1]

    def go(
        self,
        phase: str,
        altitude_m: float,
        duration_s: float,
        power: float,
        power_end: float | None = None,
    ) -> None:
        """Add a leg that ends at `altitude_m` after `duration_s`; a leg without duration adds nothing."""
        if duration_s <= 0.0:
            return
        self.times.append(self.end_s + duration_s)
        self.altitudes.append(altitude_m)
        self.phases.append(phase)
        self.powers.append((power, power if power_end is None else power_end))

    def hold(self, phase: str, duration_s: float, power: float, power_end: float | None = None) -> None:
        """Add a level leg."""
        self.go(phase, self.altitude_m, duration_s, power, power_end)

    def move(self, phase: str, altitude_m: float, rate_m_s: float, power: float) -> None:
        """Add a leg to `altitude_m` at a steady rate of climb or descent (given positive)."""
        self.go(phase, altitude_m, abs(altitude_m - self.altitude_m) / rate_m_s, power)

    def _leg(self, time_s: NDArray[np.float64]) -> NDArray[np.intp]:
        return np.clip(np.searchsorted(self.times, time_s, side="right") - 1, 0, len(self.phases) - 1)

    def altitude(self, time_s: NDArray[np.float64]) -> NDArray[np.float64]:
        """Altitude, m, (N,)."""
        return np.interp(time_s, self.times, self.altitudes)

    def phase(self, time_s: NDArray[np.float64]) -> NDArray[np.str_]:
        """Name of the phase, (N,)."""
        return np.asarray(self.phases)[self._leg(time_s)]

    def power(self, time_s: NDArray[np.float64], spool_s: float) -> NDArray[np.float64]:
        """Power fraction, (N,): linear in each leg, reached from the leg before within `spool_s` seconds."""
        leg = self._leg(time_s)
        begin, end = np.asarray(self.powers).T
        times = np.asarray(self.times)
        elapsed = time_s - times[leg]
        wanted = begin[leg] + (end - begin)[leg] * elapsed / np.diff(times)[leg]
        before = np.where(leg > 0, end[np.maximum(leg - 1, 0)], begin[leg])
        return wanted + (before - begin[leg]) * np.clip(1.0 - elapsed / spool_s, 0.0, 1.0)

    def start_of(self, phase: str) -> float:
        """Time, s, at which a phase first begins."""
        return self.times[self.phases.index(phase)]

    def end_of(self, phase: str) -> float:
        """Time, s, at which a phase last ends."""
        return self.times[len(self.phases) - self.phases[::-1].index(phase)]
