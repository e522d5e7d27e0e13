"""A heat-soaked probe: part of its reading is the temperature of the metal around it, which remembers.

    reading = T + k (T_m − T),        τ dT_m/dt = T − T_m

with the metal's temperature T_m at the first record off by what the engine did before. The share k is small and the lag
τ is minutes, so the reading depends on history: a climb reads low and a descent high.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from enginediag_cli.engine.engine import Engine
from enginediag_cli.units import split_column

SHARE, LAG_S = (0.003, 0.02), (100.0, 900.0)
"""k and τ, from and to, drawn on a logarithmic scale."""
BEFORE_K = 60.0
"""Standard deviation of the metal's temperature from the gas at the first record."""


@dataclass(frozen=True)
class HeatSoak:
    """The probe's column, k, τ [s], and T_m − T at the first record of every flight [K]."""

    column: str
    share: float
    lag_s: float
    before: tuple[float, ...]

    def read(self, flight: int, time_s: np.ndarray, columns: Mapping[str, np.ndarray]) -> dict[str, np.ndarray]:
        """Columns (N,) of one flight, its records equally far apart, with the probe's reading."""
        from scipy.signal import lfilter

        true, good = columns[self.column], np.isfinite(columns[self.column])
        if good.sum() < 2:
            return dict(columns)
        gas = np.interp(time_s, time_s[good], true[good])
        kept = np.exp(-float(np.median(np.diff(time_s))) / self.lag_s)
        metal, _ = lfilter([1.0 - kept], [1.0, -kept], gas, zi=[kept * (gas[0] + self.before[flight])])
        return {**columns, self.column: true + self.share * (metal - true)}


def draw_heat_soak(engine: Engine, flights: int, rng: np.random.Generator) -> HeatSoak | None:
    """A soaked probe, any of the engine's recorded temperatures; None for an engine that has none."""
    probes = [c for c in engine.sensors if split_column(c)[1] == "K"]
    if not probes:
        return None
    share, lag = (float(np.exp(rng.uniform(*np.log(of)))) for of in (SHARE, LAG_S))
    before = tuple(float(x) for x in BEFORE_K * rng.standard_normal(flights))
    return HeatSoak(str(rng.choice(probes)), share, lag, before)
