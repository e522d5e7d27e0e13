"""What an amplitude that nobody recorded looks like: does it rest against a stop, and what does it serve to hold?

A bleed valve or a vane has an end of its travel: part of the records share one amplitude, whatever the weather. Off
the stop a control moves it for a purpose: one reading stands still that would have moved without it. The reading that
a control holds gives the amplitude from the model alone, with no coefficient to fit, and that predicts the others.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np

from enginediag_cli.mismatch.controlled.still import robust_scatter
from enginediag_cli.mismatch.fit.evidence import Dataset, Flight
from enginediag_cli.mismatch.fit.identified import Nuisance, stack_column
from enginediag_cli.mismatch.unrecorded.per_record import PerRecord, amplitudes_at

GRID = 120
"""Quantiles between which the thresholds of three classes are sought: 7,000 pairs, each a hundredth of the values."""

HELD = 0.2
"""A reading is held when it moves less than this share of what it would have done with the amplitude at its stop."""


@dataclass(frozen=True)
class Stop:
    """`at` (N,): the records at the stop; `level` and `scatter` (within bands, robust) of their amplitude; `bands`:
    (low, high, records at the stop, level, scatter) per band of the driver asked about; `upper`: the stop is the
    larger end; `beyond`: the other end, 2 % of all records from it."""

    at: np.ndarray
    level: float
    scatter: float
    bands: tuple[tuple[float, float, int, float, float], ...]
    upper: bool
    beyond: float


@dataclass(frozen=True)
class HeldReading:
    """A reading off the stop: its median, its scatter (robust), and what that would be with the amplitude of the
    stop."""

    sensor: str
    value: float
    scatter: float
    free_scatter: float

    @property
    def held(self) -> bool:
        return self.scatter < HELD * self.free_scatter


def find_stop(fit: PerRecord, along: np.ndarray, count: int = 6) -> Stop:
    """In each of `count` equally filled bands of the driver `along` (N,) the amplitudes are divided into three classes;
    the stop is the outer class, upper or lower, that is tighter within bands and lies at the same level in all."""
    a = np.where(np.isfinite(fit.amplitude), fit.amplitude, np.nanmedian(fit.amplitude))
    edges = np.quantile(along, np.linspace(0.0, 1.0, count + 1))
    band = np.clip(np.searchsorted(edges, along, side="right") - 1, 0, count - 1)
    ends = {True: np.zeros(len(a), bool), False: np.zeros(len(a), bool)}
    for k in range(count):
        low, high = _divisions(a[band == k])
        ends[True][band == k], ends[False][band == k] = a[band == k] > high, a[band == k] < low
    found = {upper: _bands(a, at, band, edges) for upper, at in ends.items()}
    upper = _looseness(found[True]) <= _looseness(found[False])
    at, bands = ends[upper], found[upper]
    scatter = float(np.sqrt(np.mean([b[4] ** 2 for b in bands])))
    return Stop(at, float(np.median(a[at])), scatter, bands, upper, float(np.quantile(a, 0.02 if upper else 0.98)))


def _bands(
    a: np.ndarray, at: np.ndarray, band: np.ndarray, edges: np.ndarray
) -> tuple[tuple[float, float, int, float, float], ...]:
    bands = []
    for k, (low, top) in enumerate(pairwise(edges)):
        own = a[at & (band == k)]
        if len(own) > 2:
            middle = float(np.median(own))
            bands.append((float(low), float(top), len(own), middle, robust_scatter(own)))
    return tuple(bands)


def _looseness(bands: tuple[tuple[float, float, int, float, float], ...]) -> float:
    """Scatter within bands and of the bands' levels: a stop is at the same place in all of them."""
    level, scatter = np.array([b[3] for b in bands]), np.array([b[4] for b in bands])
    return float(np.sqrt(np.mean(scatter**2) + np.var(level))) if bands else np.inf


def held_readings(evidence: Dataset, fit: PerRecord, along: Nuisance, stop: Stop) -> list[HeldReading]:
    """Every reading off the stop, the one that is held best first."""
    measured = np.column_stack([stack_column(evidence, s)[fit.number] for s in fit.sensors])
    frozen = replace(fit, amplitude=np.full(len(fit.amplitude), stop.level))
    at_stop = measured - amplitudes_at(evidence, frozen, along, ()).residual * fit.sigma
    found = []
    for j, s in enumerate(fit.sensors):
        y, free = measured[~stop.at, j], at_stop[~stop.at, j]
        found.append(HeldReading(s, float(np.nanmedian(y)), robust_scatter(y), robust_scatter(free)))
    return sorted(found, key=lambda h: h.scatter / h.free_scatter)


def by_law(
    evidence: Dataset, fit: PerRecord, along: Nuisance, held: HeldReading, records: np.ndarray
) -> Mapping[str, tuple[float, float]]:
    """Error of every other reading when the amplitude of `records` (N,) is what holds `held` at its value: sensor →
    root mean square, and mean reading. No coefficient is fitted, and no reading used."""
    flights, first = [], 0
    for f in evidence.flights:
        n = len(next(iter(f.columns.values())))
        flights.append(Flight(f.label, f.engine, {**f.columns, held.sensor: np.full(n, held.value)}))
        first += n
    lawful = amplitudes_at(replace(evidence, flights=tuple(flights)), fit, along, (held.sensor,))
    error = {}
    for j, s in enumerate(lawful.sensors):
        if s != held.sensor:
            e = (lawful.residual[:, j] * lawful.sigma[j])[records]
            y = stack_column(evidence, s)[lawful.number][records]
            error[s] = float(np.sqrt(np.nanmean(e**2))), float(np.nanmean(y))
    return error


def _divisions(values: np.ndarray) -> tuple[float, float]:
    """Thresholds of the three classes that differ most for their sizes, max Σ w_i m_i² over a grid of quantiles.
    Source: N. Otsu, IEEE Trans. Syst. Man Cybern. 9 (1979) 62–66."""
    v = np.quantile(values, np.linspace(0.0, 1.0, GRID))
    sums, n = np.concatenate([[0.0], np.cumsum(v)]), np.arange(GRID + 1)
    i, j = np.meshgrid(np.arange(1, GRID - 1), np.arange(2, GRID), indexing="ij")
    between = np.full(i.shape, -np.inf)
    ok = i < j
    i, j = i[ok], j[ok]
    between[ok] = (
        sums[i] ** 2 / n[i] + (sums[j] - sums[i]) ** 2 / (n[j] - n[i]) + (sums[-1] - sums[j]) ** 2 / (GRID - n[j])
    )
    k = np.unravel_index(int(np.argmax(between)), between.shape)
    low, high = k[0] + 1, k[1] + 2
    return 0.5 * float(v[low - 1] + v[low]), 0.5 * float(v[high - 1] + v[high])
