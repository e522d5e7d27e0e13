"""Statistics that add over windows, flights and files, and what is marginalised at which level.

Of s ~ N(F (Δθ, x), V) with Δθ what is monitored and x ~ N(0, C) what is uncertain beside it, the sums s, F, V and N of
two windows add as long as both hold x. x is of two kinds:

- *common*: nominal as identified, errors of its maps: one draw for all windows. It stays a parameter in every sum, in
  unit normals (`reduced.py`), and is marginalised last, once.
- *own*: errors of instruments that each recording has anew. Windows of one recording are added first, then it is
  marginalised, then recordings are added.

V of two windows that follow each other in one recording lacks what noise that is correlated from record to record adds
across their border. At nominal the sum is that of the whole; windows that are linearised at their own estimates are
carried back to θ0, and their sum is about all these points, not about the estimate of the whole.
"""

from __future__ import annotations

from collections.abc import Hashable, Iterable
from dataclasses import replace
from functools import reduce
from operator import add

import numpy as np

from enginediag_cli.residuals.monitor import Monitor
from enginediag_cli.residuals.pipeline import Condense, condensed
from enginediag_cli.residuals.reduced import ReducedMonitor
from enginediag_cli.residuals.root import root_of
from enginediag_cli.residuals.score import marginalise
from enginediag_cli.residuals.statistics import LocalStatistics
from enginediag_cli.residuals.window import WindowStatistics


def unmarginalised(monitor: Monitor) -> Condense:
    """Statistics of all parameters of a monitor. How uncertain the noise is, and what wrong slopes make of a change, is
    that of the window alone, marginalised."""
    a = len(monitor.monitored)
    own = monitor.names[len(monitor.names) - len(monitor.offsets) :]

    def condense(window: WindowStatistics, statistics: LocalStatistics) -> WindowStatistics:
        alone = condensed(monitor, statistics, monitor.uncertainty)
        whole = statistics if isinstance(monitor, ReducedMonitor) else _in_normals(monitor, statistics)
        p = len(whole.parameters)
        whole = replace(
            whole,
            by_sensor=None,
            rows=None,
            kurtosis=None,
            points=None,
            doubt=alone.doubt,
            additive=True,
            slopes=None if alone.slopes is None else np.pad(alone.slopes, (0, p - a)),
            common=whole.parameters[a : p - len(own)],
            own=own,
        )
        return replace(window, statistics=whole)

    return condense


def nuisance_of(monitor: Monitor) -> int:
    """How many parameters `unmarginalised` statistics have beside the monitored ones."""
    k = len(monitor.names) - len(monitor.offsets)
    if isinstance(monitor, ReducedMonitor):
        return len(monitor.names) - len(monitor.monitored)
    return root_of(monitor.uncertainty[:k, :k], monitor.prior_sigma[:k]).shape[1] + len(monitor.offsets)


def _in_normals(monitor: Monitor, statistics: LocalStatistics) -> LocalStatistics:
    """The statistics with unit normals n in place of what is uncertain but for offsets, x = L n with L Lᵀ = C:

    s' = Tᵀ s,   F' = Tᵀ F T,   V' = Tᵀ V T,   T = (1, L) for the monitored and the normals.
    """
    a, k, p = len(monitor.monitored), len(monitor.names) - len(monitor.offsets), len(monitor.names)
    root = root_of(monitor.uncertainty[:k, :k], monitor.prior_sigma[:k])
    r = root.shape[1]
    T = np.zeros((p, a + r + p - k))
    T[:a, :a], T[:k, a : a + r], T[k:, a + r :] = np.eye(a), root, np.eye(p - k)
    return replace(
        statistics,
        parameters=(*monitor.monitored, *(f"nominal.{i + 1}" for i in range(r)), *monitor.names[k:]),
        theta0=np.concatenate([statistics.theta0[:a], np.zeros(r + p - k)]),
        prior_sigma=np.concatenate([statistics.prior_sigma[:a], np.ones(r), statistics.prior_sigma[k:]]),
        s=T.T @ statistics.s,
        F=T.T @ statistics.F @ T,
        V=T.T @ statistics.V @ T,
    )


def marginalised(statistics: LocalStatistics) -> LocalStatistics:
    """Statistics of the monitored parameters, everything else counted as noise: of windows that are judged together."""
    if not statistics.additive:
        return statistics
    return marginalise(statistics, statistics.monitored, _covariance(statistics, (*statistics.common, *statistics.own)))


def as_read(statistics: LocalStatistics) -> LocalStatistics:
    """Statistics of the monitored parameters at nominal as it is, for windows that are compared with each other."""
    return statistics.without({*statistics.common, *statistics.own})


def added(windows: Iterable[tuple[Hashable, LocalStatistics]]) -> LocalStatistics:
    """The sum of windows, each with its recording: windows of one recording first, then recordings without what is
    their own. What is common stays, until the sum is `marginalised`. ValueError for windows that do not add."""
    recordings: dict[Hashable, list[LocalStatistics]] = {}
    for recording, statistics in windows:
        recordings.setdefault(recording, []).append(statistics)
    return reduce(add, [_without_own(reduce(add, mine)) for mine in recordings.values()])


def _without_own(statistics: LocalStatistics) -> LocalStatistics:
    if not statistics.own:
        return statistics
    kept = tuple(name for name in statistics.parameters if name not in statistics.own)
    return replace(marginalise(statistics, kept, _covariance(statistics, statistics.own)), additive=True)


def _covariance(statistics: LocalStatistics, names: tuple[str, ...]) -> np.ndarray:
    """C (p, p): of these parameters, zero for the others."""
    variance = np.zeros(len(statistics.parameters))
    at = statistics.indices(names)
    variance[at] = statistics.prior_sigma[at] ** 2
    return np.diag(variance)
