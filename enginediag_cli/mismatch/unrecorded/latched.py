"""Do the states of a switch that no column records follow something recorded, with hysteresis?

A valve that opens at one value of a variable and closes at another is in either state between the two, by the side from
which it came: no threshold gives its states back, two do. With lower l and upper u the latch of a variable x is

    L_n = 1 where x_n ≥ u,   0 where x_n ≤ l,   L_n−1 between

and states are those of L, of what is not L, or of what lies between l and u having come from above (L) or below (not
L). What was before a stretch of records is not known, so nothing is said there until x leaves the band.

Two accounts of N states with T changes are compared by how long it takes to write them down: T moments, or a variable,
thresholds and way out of M, and the w records that these have wrong,

    gain = T ln(N/T) − ln M − w ln N

Source: J. Rissanen, Modeling by shortest data description, Automatica 14 (1978) 465–471.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from enum import Enum
from functools import cached_property

import numpy as np

from enginediag_cli.engine.filters import FilterClock, last_switch_side

GRID, FINER = 80, 30
"""Values of a variable among which thresholds are sought, and about the best of them again."""
SURE = 0.9
"""Probability of a state from which a record has one."""
LEAST = 3.0
"""Gain from which states are said to follow: twenty to one, everything that was tried counted."""


class SwitchingDirection(Enum):
    """When the second of two states is on: from the upper threshold on until below the lower one, the other way round,
    or between the two, having come from above or from below."""

    ABOVE, BELOW, FALLING, RISING = "above", "below", "falling", "rising"


@dataclass(frozen=True)
class States:
    """Records in their order: whether each is `on` (N,) and this is `sure` (N,), and stretches that the clock has."""

    on: np.ndarray
    sure: np.ndarray
    clock: FilterClock

    @staticmethod
    def of(probability: np.ndarray, clock: FilterClock) -> States:
        """By the probability (N,) of being on."""
        return States(probability > 0.5, np.maximum(probability, 1.0 - probability) >= SURE, clock)

    @cached_property
    def changes(self) -> np.ndarray:
        """Sure records next to each other in a stretch, of different states (T, 2)."""
        sure, stretch = np.flatnonzero(self.sure), np.cumsum(self.clock.first)
        a, b = sure[:-1], sure[1:]
        changed = (self.on[a] != self.on[b]) & (stretch[a] == stretch[b])
        return np.stack([a[changed], b[changed]], axis=1)


@dataclass(frozen=True)
class Latched:
    """Thresholds of variable number `variable` that give states back: `turns` changes, and all but `wrong` of `sure`
    records that are told at all; `gain`, in nats."""

    variable: int
    way: SwitchingDirection
    lower: float
    upper: float
    turns: int
    wrong: int
    sure: int
    gain: float


def latched(states: States, variables: Sequence[np.ndarray]) -> list[Latched]:
    """Of each of the variables (N,) that gives the states back the best, best first; none without changes."""
    price = float(np.log(len(variables) * len(SwitchingDirection) * GRID * (GRID - 1) // 2)) if variables else 0.0
    found = []
    for k, x in enumerate(variables):
        levels = _levels(states, x)
        rough = max(_tried(states, k, x, (levels, levels)), key=lambda t: t.gain, default=None)
        if rough is None:
            continue
        finer = [np.linspace(*_about(levels, at), FINER) for at in (rough.lower, rough.upper)]
        tried = [rough, *(t for t in _tried(states, k, x, (finer[0], finer[1])) if t.way is rough.way)]
        most = max(t.gain for t in tried)
        if most - price < LEAST:
            continue
        best = [t for t in tried if t.gain == most]
        # of thresholds that do as well nothing tells which it is: the middle is nearest to all of them
        lower, upper = float(np.mean([t.lower for t in best])), float(np.mean([t.upper for t in best]))
        found.append(replace(best[0], lower=lower, upper=upper, gain=most - price))
    return sorted(found, key=lambda f: -f.gain)


def _tried(states: States, variable: int, x: np.ndarray, levels: tuple[np.ndarray, np.ndarray]) -> Iterator[Latched]:
    """The best of all ways for each lower threshold of these and its best upper ones, variables and thresholds not
    paid for."""
    N, (lower, upper) = len(x), levels
    changes = states.changes
    for low in lower:
        highs = upper[upper > low]
        if not len(highs):
            continue
        above, below = x[None, :] >= highs[:, None], (x <= low)[None, :]  # (pairs, N), (1, N)
        latch, told_at_all = last_switch_side(states.clock, above, below)
        known = told_at_all & states.sure
        for way, told in _ways(latch, ~(above | below)):
            right = known & (told == states.on)
            wrong = (known & ~right).sum(axis=1)
            turns = (right[:, changes[:, 0]] & right[:, changes[:, 1]]).sum(axis=1)
            gain = turns * np.log(N / max(len(changes), 1)) - wrong * np.log(N)
            for j in np.flatnonzero(gain == gain.max()):
                counts = int(turns[j]), int(wrong[j]), int(known[j].sum())
                yield Latched(variable, way, float(low), float(highs[j]), *counts, float(gain[j]))


def _ways(latch: np.ndarray, between: np.ndarray) -> Iterator[tuple[SwitchingDirection, np.ndarray]]:
    yield SwitchingDirection.ABOVE, latch
    yield SwitchingDirection.BELOW, ~latch
    yield SwitchingDirection.FALLING, latch & between
    yield SwitchingDirection.RISING, ~latch & between


def _levels(states: States, x: np.ndarray) -> np.ndarray:
    """Between neighbours of the values on either side of changes of state: thresholds lie there."""
    ends = np.unique(x[states.changes])
    cuts = 0.5 * (ends[:-1] + ends[1:])
    return cuts[np.linspace(0, len(cuts) - 1, GRID).astype(int)] if len(cuts) > GRID else cuts


def _about(levels: np.ndarray, at: float) -> tuple[float, float]:
    """From the level below to that above, beyond the last as far as from the one before."""
    k = int(np.searchsorted(levels, at))
    below = levels[k - 1] if k else 2.0 * levels[0] - levels[1]
    above = levels[k + 1] if k + 1 < len(levels) else 2.0 * levels[-1] - levels[-2]
    return float(below), float(above)
