"""What readings of a moving engine lag by, as nuisance of a monitor: along its own course, by its own size.

The error of reading s in record k is Σ_τ a_τ d_τ(k), with d_τ the deviation of a lag of the command from the command.
The amounts are those that identification found, times one unknown number, and beside it each as it differs from stretch
to stretch: 1 + T columns, of standard deviation one, that the statistics marginalise as they do instruments' offsets.
Nothing is subtracted: what lags for another reason than in training is not made worse.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from enginediag_cli.identification.lagging_reading import LaggingReading
from enginediag_cli.residuals.monitor import Monitor, Offset


def with_lagging(monitor: Monitor) -> Monitor:
    """The monitor with what its readings lag by; as it is where none does."""
    added = [offset for reading in monitor.lagging for offset in _offsets(monitor, reading)]
    k = len(added)
    if not k:
        return monitor
    p = len(monitor.names)
    uncertainty = np.eye(p + k)
    uncertainty[:p, :p] = monitor.uncertainty
    fields: dict[str, Any] = {
        "offsets": (*monitor.offsets, *added),
        "uncertainty": uncertainty,
        "names": (*monitor.names, *(f"lagging.{i + 1}" for i in range(k))),
        "theta0": np.append(monitor.theta0, np.zeros(k)),
        "prior_sigma": np.append(monitor.prior_sigma, np.ones(k)),
        "lower": np.append(monitor.lower, np.full(k, -np.inf)),
        "upper": np.append(monitor.upper, np.full(k, np.inf)),
    }
    return replace(monitor, **fields)


def _offsets(monitor: Monitor, reading: LaggingReading) -> list[Offset]:
    if reading.sensor not in monitor.sensors:
        return []
    sensor = monitor.sensors.index(reading.sensor)
    T = len(reading.lags_s)
    each = [tuple(s if i == j else 0.0 for j in range(T)) for i, s in enumerate(reading.spread) if s > 0.0]
    return [Offset(sensor, "lagging", lags=amounts) for amounts in (reading.amounts, *each)]
