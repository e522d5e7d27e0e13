"""How far records lie from the one before them, in steps: correlation decays with elapsed time and with the distance of
operating points, never with the count of records.

Two records a usual step apart at the same operating point have correlation ρ, two that are g steps apart ρ^g, records
of different recordings none. g is the elapsed time over the recording's median step, and one step more for each `FAR`
of its range by which an input changed. A recording without time counts its records, and one that moves on with every
record counts time alone: it has no neighbours at one operating point that could say what ρ is, those in time do, and
by time alone the monitor's windows reckon, too.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

TIME = "time_s"
"""Column of the elapsed time."""

FAR = 0.1
"""Share of the range of an input beyond which the error of a model is another one, as in the residuals of two recorded
flights, where it changes with power and Mach number over a tenth of what was flown."""
NEAREST = 0.5
"""Steps: records that lie closer (an irregular clock, a time given twice) still have noise of their own."""
NEIGHBOURS = 1.5
"""Steps up to which two records are neighbours, from which ρ is estimated: judgement, one and no second."""
MOSTLY = 0.5
"""Share of the records of a recording that must lie as near to the one before as that: of fewer, chosen by how little
happened, ρ is not known, and would not be that of the others."""

FADED = 1e-9
"""Correlation below which records no longer know of each other."""


def position(columns: Mapping[str, np.ndarray], inputs: Sequence[str], n: int) -> np.ndarray:
    """Steps since the first of n records of one recording, (n,), not decreasing."""
    time = columns.get(TIME)
    counted = np.arange(n, dtype=float)
    if time is None or n < 2 or not np.isfinite(time).all():
        return counted
    passed = np.abs(np.diff(np.asarray(time, float)))
    if not (passed > 0).any():
        return counted
    gap = passed / np.median(passed[passed > 0])
    moved = np.zeros(n - 1)
    for column in inputs:
        u = np.asarray(columns[column], float)
        span = np.ptp(u[np.isfinite(u)]) if np.isfinite(u).any() else 0.0
        if span > 0:
            moved = np.fmax(moved, np.abs(np.diff(u)) / span)
    steps = gap + moved / FAR
    if np.mean(steps <= NEIGHBOURS) < MOSTLY:
        steps = gap
    return np.concatenate([[0.0], np.cumsum(np.maximum(steps, NEAREST))])


def gaps(position: np.ndarray, recording: np.ndarray) -> np.ndarray:
    """Steps since the record before, (N,), infinite at the beginning of a recording; both arguments (N,)."""
    gap = np.diff(position, prepend=0.0)
    gap[np.diff(recording, prepend=-1) != 0] = np.inf
    return gap


def correlations(gap: np.ndarray, rho: np.ndarray) -> np.ndarray:
    """Correlation of each record with the one before, (N, m), for neighbours' correlations `rho` (m,) and gaps (N,)."""
    # an even power of a negative correlation would be positive, which nobody has seen: it ends with the neighbour
    decay = np.abs(rho) ** np.where(np.isfinite(gap), gap, 0.0)[:, None]
    decay = np.where(rho >= 0, decay, np.where(gap[:, None] <= NEIGHBOURS, rho, 0.0))
    return np.where(np.isfinite(gap)[:, None], decay, 0.0)


def correlated_sum(g: np.ndarray, r: np.ndarray) -> np.ndarray:
    """f_k = Σ_l C_kl g_l for g (N, m, p), C_kl the product of the correlations r (N, m) of the records from l to k."""
    back = np.zeros_like(r)
    back[:-1] = r[1:]
    return _remembered(g, r) + _remembered(g[::-1], back[::-1])[::-1] - g


def _remembered(g: np.ndarray, r: np.ndarray) -> np.ndarray:
    """b_k = g_k + r_k b_k−1 with r_0 = 0, by doubling the reach: log₂ of the memory's length passes over the arrays."""
    b, reach, r = g.copy(), 1, r.copy()
    r[:1] = 0.0
    while reach < len(b) and np.abs(r).max(initial=0.0) > FADED:
        b[reach:] += r[reach:, :, None] * b[:-reach]
        r[reach:] *= r[:-reach].copy()
        r[:reach] = 0.0
        reach *= 2
    return b


def inflation(gap: np.ndarray, rho: np.ndarray) -> np.ndarray:
    """κ (m,): readings per independent one, (1 + ρ)/(1 − ρ) where all records are a step apart, else the mean over the
    records of Σ_l C_kl."""
    inside = np.isfinite(gap)
    if np.all(gap[inside] == 1.0):
        return (1 + rho) / (1 - rho)
    r = correlations(gap, rho)
    found = correlated_sum(np.ones((*r.shape, 1)), r)[:, :, 0].mean(axis=0)
    return np.where(rho >= 0, np.maximum(found, 1.0), (1 + rho) / (1 - rho))
