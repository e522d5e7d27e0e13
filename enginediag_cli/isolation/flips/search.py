"""The smallest error along each of many lines at which another name comes first: all lines abreast."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from enginediag_cli.isolation.flips.lines import Lines

FIRST = 0.02
"""First size that is tried, in standard errors of the score: smaller ones change a log probability by nothing."""
GROWTH = 1.3
"""From one size that is tried to the next. A set that leads between two of them and at neither is passed over."""
HALVINGS = 9
"""Of such a step: the size is then known to half a thousandth of itself."""

Named = Callable[[np.ndarray, np.ndarray], np.ndarray]
"""named(lines (n,), log posterior (n, M)) → number of the set that is named on each (n,)."""
Same = Callable[[np.ndarray, np.ndarray, np.ndarray], np.ndarray]
"""same(lines (n,), sizes (n,), sets (n,)) → (n,) whether a set, at this size along that line, is the answer under
another guise."""


@dataclass(frozen=True)
class Crossing:
    """Along line number `line` the name changes at `size`, with its sign, to set number `becomes`."""

    line: int
    size: float
    becomes: int


def crossings(lines: Lines, named: Named, same: Same, most: np.ndarray) -> dict[int, Crossing]:
    """The nearest crossing along each line, on either side of nothing; those beyond `most` (D,) are left out."""
    D = len(most)
    line, sign = np.repeat(np.arange(D), 2), np.tile([1.0, -1.0], D)
    error = lines.standard_errors[line]
    limit = most[line]
    known = np.isfinite(error) & (limit > 0)
    line, sign, limit, low = line[known], sign[known], limit[known], np.zeros(int(known.sum()))
    high = np.minimum(FIRST * error[known], limit)
    found_low, found_high = np.full(len(line), np.nan), np.full(len(line), np.nan)
    waiting = np.arange(len(line))
    nearest = np.full(D, np.inf)
    while waiting.size:
        changed = ~_stays(lines, named, same, line[waiting], sign[waiting] * high[waiting])
        found_low[waiting[changed]], found_high[waiting[changed]] = low[waiting[changed]], high[waiting[changed]]
        np.minimum.at(nearest, line[waiting[changed]], high[waiting[changed]])
        waiting = waiting[~changed]
        waiting = waiting[(high[waiting] < limit[waiting]) & (high[waiting] < nearest[line[waiting]])]
        low[waiting] = high[waiting]
        high[waiting] = np.minimum(GROWTH * high[waiting], limit[waiting])
    at = np.flatnonzero(np.isfinite(found_high))
    if not at.size:
        return {}
    line, sign, low, high = line[at], sign[at], found_low[at], found_high[at]
    for _ in range(HALVINGS):
        middle = (low + high) / 2
        stays = _stays(lines, named, same, line, sign * middle)
        low, high = np.where(stays, middle, low), np.where(stays, high, middle)
    becomes = named(line, lines.at(line, sign * high))
    found: dict[int, Crossing] = {}
    for k in np.argsort(-high, kind="stable"):  # the nearest of each line last
        found[int(line[k])] = Crossing(int(line[k]), float(sign[k] * high[k]), int(becomes[k]))
    return found


def _stays(lines: Lines, named: Named, same: Same, line: np.ndarray, a: np.ndarray) -> np.ndarray:
    return same(line, a, named(line, lines.at(line, a)))
