"""A share of long recordings to search on: whole stretches of time, over all flights alike.

What a search costs grows with the records, what it can tell apart soon does not: 200 flights over the same operating
points say the same 200 times. Long recordings are therefore identified, and searched for what no column records, by a
share of their records. Records of a stretch follow each other as they were taken, so that noise stays correlated as it
is and what switches is seen to. Flights are taken evenly from first to last, and stretches evenly over each of them,
later by another part of the spacing in each, so that no phase is missed in all.

No record is picked by what it reads, but for flights in which something switches that no column shows: these are added
whole (`unrecorded/elsewhere.py`).
"""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import replace

import numpy as np

from enginediag_cli.engine.recall import MOMENT
from enginediag_cli.mismatch.fit.evidence import Dataset, Flight

MANY, SHARE = 5000, 2000
"""Records from which on a share is taken, and about how many it is of. A year of hours and a handful of flights are
taken whole; 2,000 readings of a sensor give its σ to 1.6 %, and what 2,000 records cannot tell apart is told apart on
all of them."""
FLIGHTS = 8
"""Flights that they are of, where these have so many: each brings offsets of its instruments, which cost more than its
records do, and more flights of the same kind say little more about what all flights share."""
STRETCH = 75
"""Records of a stretch: noise that is correlated by 0.9 with the next record has lost all of it after 40. Judgement."""
MOVING = (6000, STRETCH)
"""Share and stretch where records know their past: transients are far between, and stretches that miss them tell
nothing of what changes; more of them do not. What came before a stretch is on its tape. Judgement."""
GOLDEN = 0.5 * (5.0**0.5 - 1.0)
"""Shares of multiples of it spread evenly, however many there are."""


def is_long(flights: Sequence[Flight]) -> bool:
    """Whether a share of the records is searched."""
    return sum(map(len, flights)) >= MANY


def share_of(flights: Sequence[Flight], whole: Collection[int] = ()) -> list[Flight]:
    """The flights with some of their records, all of them where they are few, and of the `whole` ones, by position."""
    if not is_long(flights):
        return list(flights)
    moving = all(MOMENT in f.columns and bool(np.all(f.columns[MOMENT] >= 0.0)) for f in flights)
    rows = chosen(list(map(len, flights)), *(MOVING if moving else (SHARE, STRETCH)))
    for k in whole:
        rows[k] = np.arange(len(flights[k]))
    return [_only(f, own) for f, own in zip(flights, rows, strict=True) if len(own)]


def chosen(lengths: Sequence[int], share: int = SHARE, stretch: int = STRETCH) -> list[np.ndarray]:
    """Records of each flight of so many that are taken, in order: a share in stretches of so many."""
    R = len(lengths)
    flights = min(R, max(FLIGHTS, -(-share * R // max(1, sum(lengths)))))
    taken = {int(k) for k in np.linspace(0, R - 1, flights).round()}
    part = min(1.0, share / max(1, sum(lengths[k] for k in taken)))
    found: list[np.ndarray] = []
    for k, n in enumerate(lengths):
        if k not in taken:
            found.append(np.zeros(0, int))
            continue
        count = max(1, round(n * part / stretch))
        size = min(n, stretch)
        room = max(0.0, (n - count * size) / count)  # between one stretch and the next
        first = (np.arange(count) * (size + room) + room * ((k * GOLDEN) % 1.0)).astype(int)
        found.append(np.unique(np.minimum(first[:, None] + np.arange(size), n - 1)))
    return found


def on_share(evidence: Dataset, whole: Collection[int] = ()) -> Dataset:
    """The evidence with a share of its records, and all of some flights; itself where they are few."""
    if not is_long(evidence.flights):
        return evidence
    return replace(evidence, flights=tuple(share_of(evidence.flights, whole)))


def every_so_often(evidence: Dataset, most: int) -> Dataset:
    """The evidence with every k-th record of each flight, so that about `most` are left; itself where it has no more:
    what many sets of options are compared by. Of a lag-1 correlation ρ of noise the k-th power is left, of a negative
    one, which changes sign from record to record, nothing."""
    step = -(-evidence.records // most)
    if step < 2:
        return evidence
    flights = (_only(f, np.arange(0, len(f), step)) for f in evidence.flights)
    rho = {s: max(r, 0.0) ** step for s, r in evidence.noise.rho.items()}
    return replace(evidence, flights=tuple(flights), noise=replace(evidence.noise, rho=rho))


def _only(flight: Flight, rows: np.ndarray) -> Flight:
    at = rows if flight.at is None else flight.at[rows]
    return replace(flight, columns={c: v[rows] for c, v in flight.columns.items()}, at=at)
