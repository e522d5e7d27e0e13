"""The monitor of a series, whose windows are compared with each other and not with nominal alone."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from enginediag_cli.residuals.monitor import Monitor
from enginediag_cli.residuals.pipeline import WindowStatistics
from enginediag_cli.residuals.statistics import LocalStatistics

PLAUSIBLY = 2.0
"""Plausible errors by which the reading of an input may be off where it is outside what was seen."""


def trusting_no_input(monitor: Monitor) -> Monitor:
    """The monitor with an envelope that allows for the errors of inputs that it suspects: an operating point is known
    no better than the instrument that gives it, and one that reads wrong must not hide itself by being outside."""
    errors = [e for name, e in getattr(monitor.engine, "errors", {}).items() if name in monitor.monitored]
    envelope = monitor.envelope
    if envelope is None or not errors:
        return monitor
    scale = np.array(envelope.scale, float)
    for error in errors:
        if error.column in envelope.inputs:
            j = envelope.inputs.index(error.column)
            size = np.abs(envelope.points[:, j]).max() if error.multiplies else 1.0
            scale[j] = np.hypot(scale[j], PLAUSIBLY * error.parameter.prior_sigma * size)
    return replace(monitor, envelope=replace(envelope, scale=scale))


def monitored_as_read(monitor: Monitor, window: WindowStatistics, statistics: LocalStatistics) -> WindowStatistics:
    """The window with the statistics of the monitored parameters alone: what is wrong with nominal is wrong in all
    windows alike, and no noise of any."""
    others = set(monitor.names) - set(monitor.monitored)
    return replace(window, statistics=replace(statistics.without(others), meaning=dict(monitor.meaning)))
