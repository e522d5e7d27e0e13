"""What a recorder makes of readings: lags, steps of rounding, cells that are missing, and cells that are grossly wrong.

A sensor follows its reading with a first-order lag; between records its reading is a straight line, for which the
deviation d = shown − true obeys, with a = exp(−Δt/τ) and the slope s_k of the line that ends at record k,

    d_k = a d_{k−1} − τ s_k (1 − a)

Every reading is then rounded to a step of its own. A cell of an output is missing with probability MISSING, and any
cell, of outputs and inputs alike, off by SPIKE times its noise with probability SPIKES.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from enginediag_cli.engine.engine import Engine
from enginediag_cli.validation.blind.truths.instruments import input_spread

LAG_S = (0.5, 2.0)
"""Lag of a sensor, from and to: from a pressure line to a thermocouple in a housing."""
QUANTUM = (0.3, 2.0)
"""Step of rounding over the noise, from and to, on a logarithmic scale: what buses of 10 to 12 bits have."""
MISSING, SPIKES = 0.05, 0.01
"""Share of cells that are missing, and of cells that are grossly wrong: what is met in recordings that were not
cleaned."""
SPIKE = (10.0, 30.0)
"""Size of a gross error over the noise, from and to; of an input over what such a channel differs by."""
INPUT_QUANTUM = 0.1
"""Step of rounding of an input over what such a channel differs by from flight to flight: its bus is finer than it."""


@dataclass(frozen=True)
class Recorder:
    """Column → lag [s], and → step of rounding in its unit; `sigma`: column → size by which gross errors are measured,
    in its unit, as a share of the reading where the column is among `shares`."""

    lags_s: Mapping[str, float]
    quanta: Mapping[str, float]
    sigma: Mapping[str, float]
    shares: frozenset[str]
    missing: float = MISSING
    spikes: float = SPIKES

    def follow(self, time_s: np.ndarray, columns: Mapping[str, np.ndarray]) -> dict[str, np.ndarray]:
        """Columns (N,) of one flight, its points equally far apart, as lagging sensors show them."""
        from scipy.signal import lfilter

        found = dict(columns)
        for c, lag in self.lags_s.items():
            if c in columns and np.isfinite(columns[c]).all() and len(time_s) > 1:
                step = float(np.median(np.diff(time_s)))
                kept = np.exp(-step / lag)
                slope = np.diff(columns[c], prepend=columns[c][0]) / step
                found[c] = columns[c] + lfilter([-lag * (1.0 - kept)], [1.0, -kept], slope)
        return found

    def write(self, columns: Mapping[str, np.ndarray], rng: np.random.Generator) -> dict[str, np.ndarray]:
        """Columns (N,) with noise as they stand in the recording."""
        found = dict(columns)
        for c, sigma in self.sigma.items():
            v = np.array(columns[c], float)
            struck = rng.random(len(v)) < self.spikes
            size = rng.choice((-1.0, 1.0), len(v)) * rng.uniform(*SPIKE, len(v)) * sigma
            v = np.where(struck, v + size * (np.abs(v) if c in self.shares else 1.0), v)
            if c in self.quanta:
                v = self.quanta[c] * np.round(v / self.quanta[c])
            if c in self.lags_s:
                v[rng.random(len(v)) < self.missing] = np.nan
            found[c] = v
        return found


def draw_recorder(engine: Engine, flown: Mapping[str, np.ndarray], rng: np.random.Generator) -> Recorder:
    """A recorder of this engine; flown: inputs (N,) of its flights, whose size says what a share of them is."""
    lags = {c: float(rng.uniform(*LAG_S)) for c in engine.sensors}
    sigma = {c: s.noise_sigma for c, s in engine.sensors.items()}
    low, high = np.log(QUANTUM)
    quanta = {c: s * float(np.exp(rng.uniform(low, high))) for c, s in sigma.items()}
    shares = set()
    for c in engine.inputs:
        share, bias = input_spread(c)
        sigma[c] = share or bias
        quanta[c] = INPUT_QUANTUM * (share * float(np.median(np.abs(flown[c]))) or bias)
        if share:
            shares.add(c)
    return Recorder(lags, quanta, sigma, frozenset(shares))
