"""Time as a driver: a change that began at some record of one engine and stays, which is what a fault does."""

from __future__ import annotations

import numpy as np

from enginediag_cli.drivers import TIME
from enginediag_cli.engine.term import DriverValues
from enginediag_cli.mismatch.fit.evidence import Dataset

ONSETS = 11
"""Onsets that are tried on one engine, evenly over its records: a change is seen from 1/12 of them on."""

LEAST_RECORDS = 8  # on either side of an onset


def step_drivers(evidence: Dataset) -> list[DriverValues]:
    """One driver per engine and onset, over all records of the evidence: 0 before, 1 from then on, 0 for the other
    engines. Onsets at the beginning of a flight are preferred to those within it."""
    sizes = [len(next(iter(f.columns.values()))) for f in evidence.flights]
    starts = np.concatenate([[0], np.cumsum(sizes)]).astype(int)
    engine_of = np.repeat([evidence.engines.index(f.engine) for f in evidence.flights], sizes)
    flight_of = np.repeat(np.arange(len(sizes)), sizes)
    found = []
    for k, name in enumerate(evidence.engines):
        mine = np.flatnonzero(engine_of == k)
        begins = {int(starts[j]) for j, f in enumerate(evidence.flights) if f.engine == name}
        for at in _onsets(mine, begins):
            values = np.zeros(starts[-1])
            values[mine[mine >= at]] = 1.0
            j = int(flight_of[at])
            since = f"{evidence.flights[j].moment(int(at - starts[j]))} of " if at > starts[j] else ""
            onset = f"since {since}{evidence.flights[j].label}"
            found.append(DriverValues(TIME, onset, values, onset))
    return found


def _onsets(mine: np.ndarray, begins: set[int]) -> list[int]:
    """Records at which a change may have begun; `mine` (n,) are the records of one engine in order."""
    n = len(mine)
    chosen: dict[int, None] = {}
    near = max(1, n // (2 * (ONSETS + 1)))
    for k in range(1, ONSETS + 1):
        at = k * n // (ONSETS + 1)
        window = range(max(LEAST_RECORDS, at - near), min(n - LEAST_RECORDS, at + near) + 1)
        flight_starts = [i for i in window if int(mine[i]) in begins]
        if flight_starts:
            at = min(flight_starts, key=lambda i: abs(i - at))
        if LEAST_RECORDS <= at <= n - LEAST_RECORDS:
            chosen[int(mine[at])] = None
    return list(chosen)
