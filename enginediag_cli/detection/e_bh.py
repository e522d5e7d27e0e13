"""Which of many engines stand out: the e-BH procedure.

With e-values e_1 … e_n, each of mean 1 at most for an engine that is healthy, and e_(1) ≥ e_(2) ≥ …, those listed are
the k* largest, k* the largest k with

    e_(k) ≥ n/(k α)

Then the share of healthy engines among those listed is α at most, on the average over fleets, whatever the e-values
have to do with each other, and whenever one looks: R. Wang, A. Ramdas, JRSS B 84 (2022) 822–852, theorem 2.
"""

from __future__ import annotations

import numpy as np


def listed(log_e: np.ndarray, level: float) -> np.ndarray:
    """Which (n,) of the engines with the e-values exp(log_e) (n,) are listed at the rate `level` of false discoveries;
    one without an e-value (NaN) counts, and is not listed. ValueError for a level that is no probability."""
    if not 0 < level < 1:
        raise ValueError("`level` must lie between 0 and 1")
    log_e = np.nan_to_num(np.asarray(log_e, float), nan=-np.inf, posinf=np.inf, neginf=-np.inf)
    n = len(log_e)
    order = np.sort(log_e)[::-1]
    enough = np.flatnonzero(order >= np.log(n / (level * np.arange(1, n + 1))))
    if not enough.size:
        return np.zeros(n, bool)
    return np.asarray(log_e >= order[enough[-1]])
