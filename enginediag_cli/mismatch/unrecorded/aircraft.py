"""Engines of one aircraft, side by side: what switches for one of them switches for all.

A recording of an aircraft gives one flight of each of its engines, at the same times and in the same air. Their records
are laid on one grid of times, the readings of each engine in columns of its own, so that a hidden amplitude or state is
one for all engines at a time while nuisance and noise stay those of each. Flights that have no companion keep their
place with one engine. Where an engine lacks the record before, the state of the grid's last time stands for it.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from enginediag_cli.mismatch.fit.neighbours import TIME, neighbours_of

if TYPE_CHECKING:
    from enginediag_cli.mismatch.fit.identified import IdentifiedHypothesis

Columns = Mapping[str, np.ndarray]

SAME_AIR = 1e-3
"""Largest difference of the air data of two engines of one aircraft, as a share of their size: a rounding."""
SHARED = 0.5
"""Share of the records of the shorter flight that must have the time of a record of the other."""


@dataclass(frozen=True)
class Grid:
    """Of N records: `at` (N,), the row of each of them among `rows`; `seat` (N,), which engine of its aircraft;
    `seats`, the most of them; `gap` (rows,): time since the row before in usual steps, 0 where a flight begins."""

    at: np.ndarray
    seat: np.ndarray
    rows: int
    seats: int
    gap: np.ndarray

    def laid(self, values: np.ndarray) -> np.ndarray:
        """(rows, seats·m, …) of values (N, m, …), 0 where there is no record."""
        m, tail = values.shape[1], values.shape[2:]
        found = np.zeros((self.rows, self.seats, m, *tail), values.dtype)
        found[self.at, self.seat] = values
        return found.reshape(self.rows, self.seats * m, *tail)

    def folded(self, values: np.ndarray) -> np.ndarray:
        """(rows,) of values (N,) that are one for all engines of a row."""
        found = np.zeros(self.rows)
        found[self.at] = values
        return found


def grid_of(found: IdentifiedHypothesis) -> Grid | None:
    """The grid of a fit's records; None where no two engines fly together."""
    flights, recording = found.evidence.flights, found.problem.recording
    partner = _companions(found)
    if not partner:
        return None
    near = neighbours_of(found)
    time = np.concatenate([np.asarray(f.columns.get(TIME, np.full(len(f), np.nan)), float) for f in flights])
    time = time[found.number]
    at, seat, gap, first = np.zeros(len(time), int), np.zeros(len(time), int), [], 0
    done: set[int] = set()
    for r in range(len(flights)):
        if r in done:
            continue
        own = [r, *partner.get(r, ())]
        done |= set(own)
        members = [np.flatnonzero(recording == k) for k in own]
        if len(own) == 1:
            at[members[0]] = first + np.arange(len(members[0]))
            gap.append(near.gap[members[0]])
            first += len(members[0])
            continue
        stamps = np.unique(np.concatenate([time[m] for m in members]))
        for s, m in enumerate(members):
            at[m], seat[m] = first + np.searchsorted(stamps, time[m]), s
        gap.append(np.concatenate([[0.0], np.diff(stamps) / near.step_s]))
        first += len(stamps)
    return Grid(at, seat, first, 1 + int(seat.max()), np.concatenate(gap))


def _companions(found: IdentifiedHypothesis) -> dict[int, list[int]]:
    """Flight → the flights of other engines of its aircraft, by position; the first of them only."""
    flights, engine = found.evidence.flights, found.evidence.engine
    air = [c for c in engine.inputs if c != engine.power_setting]
    result: dict[int, list[int]] = {}
    taken: set[int] = set()
    for j, a in enumerate(flights):
        for k, b in enumerate(flights[j + 1 :], start=j + 1):
            others = {flights[x].engine for x in result.get(j, ())}
            if not a.file or a.file != b.file or a.engine == b.engine or b.engine in others or {j, k} & taken - {j}:
                continue
            if j not in taken and _together(a.columns, b.columns, air):
                result.setdefault(j, []).append(k)
                taken.add(k)
    return result


def _together(a: Columns, b: Columns, air: list[str]) -> bool:
    """Whether two flights are at the same times in the same air."""
    if TIME not in a or TIME not in b:
        return False
    ta, tb = np.asarray(a[TIME], float), np.asarray(b[TIME], float)
    if len(np.unique(ta)) < len(ta) or len(np.unique(tb)) < len(tb) or not (len(ta) and len(tb)):
        return False
    _, i, k = np.intersect1d(ta, tb, return_indices=True)
    if len(i) < max(2.0, SHARED * min(len(ta), len(tb))):
        return False
    for c in air:
        x, y = np.asarray(a[c], float)[i], np.asarray(b[c], float)[k]
        if not np.allclose(
            x, y, rtol=SAME_AIR, atol=SAME_AIR * max(float(np.nanmax(np.abs(x))), 1e-12), equal_nan=True
        ):
            return False
    return True
