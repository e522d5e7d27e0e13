"""The past of a flight in constant memory: recent blocks one by one, older ones in ever longer pieces.

Sums of a block are kept in coordinates in which everything unknown is N(0, 1) beforehand, see `Coordinates`.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

RECENT = 48
"""Pieces of one length that are kept before two of them become one of twice that length."""


@dataclass(frozen=True)
class Coordinates:
    """Columns of `basis` (p, d) turn unit normals into parameters: first k nuisance, then a health, then m sensors.

    health, sensors: names of the changes that are looked for, in the order of their columns.
    """

    basis: np.ndarray
    nuisance: int
    health: tuple[str, ...]
    sensors: tuple[str, ...]

    @property
    def changes(self) -> tuple[str, ...]:
        return (*self.health, *self.sensors)


@dataclass(frozen=True)
class Segment:
    """Sums over blocks first … last − 1: s (d,) = Σ GᵀZ and F (d, d) = Σ GᵀG in unit-normal coordinates.

    `clock` is the mean time of its records, `begin` the time of its first record.
    """

    first: int
    last: int
    records: int
    begin: float
    clock: float
    s: np.ndarray
    F: np.ndarray

    def __add__(self, later: Segment) -> Segment:
        n = self.records + later.records
        clock = (self.records * self.clock + later.records * later.clock) / max(n, 1)
        return Segment(self.first, later.last, n, self.begin, clock, self.s + later.s, self.F + later.F)


def append(past: list[Segment], new: Segment) -> list[Segment]:
    """`past` with `new` behind it; where there are more than RECENT pieces of a length, the oldest two are joined."""
    kept, length = [*past, new], 1
    while True:
        same = [i for i, piece in enumerate(kept) if piece.last - piece.first == length]
        if len(same) <= RECENT:
            return kept
        i = same[0]
        kept[i : i + 2] = [kept[i] + kept[i + 1]]
        length *= 2


@dataclass(frozen=True)
class Tails:
    """Sums from each of J possible onsets to now. With law g(t): s = Σ g s_i (J, d), F = Σ g² F_i (J, d, d) and
    cross = Σ g F_i (J, d, d), the product of what changes with what stays. total_s (d,), total_F (d, d): of all."""

    s: np.ndarray
    F: np.ndarray
    cross: np.ndarray
    total_s: np.ndarray
    total_F: np.ndarray


LAWS = ("step", "ramp")


def tails(past: list[Segment], law: str = "step") -> Tails:
    """Sums for an onset at the beginning of each piece; a ramp grows from 0 there to 1 now."""
    s, F = np.stack([piece.s for piece in past]), np.stack([piece.F for piece in past])
    total_s, total_F = s.sum(axis=0), F.sum(axis=0)
    if law == "step":
        from_here = np.cumsum(F[::-1], axis=0)[::-1]
        return Tails(np.cumsum(s[::-1], axis=0)[::-1], from_here, from_here, total_s, total_F)
    begin, clock = np.array([piece.begin for piece in past]), np.array([piece.clock for piece in past])
    since = np.maximum(clock[None, :] - begin[:, None], 0.0)  # (J, pieces)
    g = np.where(np.arange(len(past))[None, :] >= np.arange(len(past))[:, None], since, 0.0)
    g = g / np.maximum(g.max(axis=1, keepdims=True), 1e-300)  # at 1 now, unless the clock runs backwards
    flat = F.reshape(len(past), -1)
    return Tails(g @ s, (g**2 @ flat).reshape(-1, *F.shape[1:]), (g @ flat).reshape(-1, *F.shape[1:]), total_s, total_F)
