"""Whether the flights that are believed healthy stand still: an engine that wears while its baseline is taken is held
against its own wear, and nothing stands out later.

Per reading j, with r its deviations (conditions taken out) over the b flights of the baseline and t = 1 … b,

    T_j = Σ (t − t̄) r_j / (Σ (t − t̄)²)^½ ,      T_j² / S_jj ~ F(1, ν)

where S is the scatter from one flight to the next, which a slow course hardly changes, of ν differences; the smallest p
of m readings is taken m times.
"""

from __future__ import annotations

import numpy as np
from scipy.special import stdtr

from enginediag_cli.fleet_judgement.consumption import of_conditions
from enginediag_cli.fleet_judgement.health import Course
from enginediag_cli.fleet_judgement.rows import Flights

MOVES = 0.01
"""Probability from which on a baseline that stands still is taken for one that moves: of a hundred healthy engines one
gets no verdict for it."""


def p_of_still(flights: Flights, course: Course) -> float:
    """Probability that a baseline which stands still has as much of a course; NaN of fewer than three flights."""
    b = flights.baseline
    if b < 3:
        return float("nan")
    r = (flights.z - of_conditions(flights, course))[:b]
    t = np.arange(b) - 0.5 * (b - 1)
    contrast = t @ r / np.sqrt(t @ t)
    size = np.abs(contrast) / np.sqrt(np.diag(course.scatter))
    p = 2.0 * stdtr(max(len(flights) - 1, 1), -size)
    return float(min(1.0, len(p) * p.min()))
