"""The monitor of a series, whose windows are compared with each other and not with nominal alone."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from enginediag_cli.residuals.monitor import Monitor
from enginediag_cli.residuals.reduced import ReducedMonitor, curvature_of
from enginediag_cli.residuals.statistics import LocalStatistics
from enginediag_cli.residuals.windows import WindowStatistics

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


def of_series(monitor: Monitor) -> Monitor:
    """The monitor whose windows make a series; what wrong slopes of maps make of a change is asked of the series, not
    of each window."""
    return replace(trusting_no_input(monitor), slopes=None)


def certain(monitor: Monitor) -> Monitor:
    """The monitor without what is uncertain about nominal, for windows that are compared with each other and of which
    `monitored_as_read` keeps nothing else: a third of the work. Only the point at which a window is linearised depends
    on it, by a small share of its standard error."""
    k = len(monitor.monitored)
    alone = replace(
        monitor,
        names=monitor.names[:k],
        theta0=monitor.theta0[:k],
        prior_sigma=monitor.prior_sigma[:k],
        lower=monitor.lower[:k],
        upper=monitor.upper[:k],
        uncertainty=np.zeros((k, k)),
        offsets=(),
        lagging=(),
        doubtful=monitor,
    )
    bent = curvature_of(alone)
    if bent is None:
        return alone
    fields = {name: getattr(alone, name) for name in Monitor.__dataclass_fields__}
    return ReducedMonitor(**fields, curvature=bent, whole=alone, root=np.zeros((k, 0)))


def for_comparison(monitor: Monitor) -> Monitor:
    """The monitor by which a fleet condenses flights that are compared with each other: `certain`, and without the law
    of each statistic, which is asked of windows that are judged alone."""
    found = certain(monitor)
    return replace(found, noise=replace(found.noise, kurtosis=None, readings=None, rho_error=None, rho_common=None))


def effects_of_inputs(
    monitor: Monitor, inputs: Mapping[str, np.ndarray], sizes: Mapping[str, float]
) -> dict[str, dict[str, np.ndarray]]:
    """By how much the reading of each sensor (n,), by the name of its bias, is beyond prediction at `inputs` (n,) that
    were read wrong, for one prior standard deviation: suspected error of an input → bias → effect. sizes: errors, by
    name, for which that is asked, as far as they are of this monitor.

    The difference of two predictions, not a derivative: a wrong reading moves the engine on its maps, too, off the line
    where their errors are known, and of these `error_model.modelled` takes no derivative.
    """
    known = {c: [p.name for p in monitor.engine.sensors[c].parameters()] for c in monitor.sensors}
    bias = {n: i for i, c in enumerate(monitor.sensors) for n in known[c] if n in monitor.monitored}
    base = {n: float(v) for n, v in monitor.base.items() if n in monitor.engine.parameters}
    found: dict[str, dict[str, np.ndarray]] = {}
    read = None
    for name, error in getattr(monitor.engine, "errors", {}).items():
        size = sizes.get(name, 0.0)
        if name not in monitor.monitored or not size:
            continue
        true = {**inputs, error.column: error.corrected(inputs[error.column], error.parameter.nominal + size)}
        read = read or monitor.engine.predict(inputs, base, sensors=monitor.sensors)
        wrong = monitor.engine.predict(true, base, sensors=monitor.sensors)
        if np.all(read.ok & wrong.ok):
            unit = error.parameter.prior_sigma / size
            found[name] = {n: unit * (np.asarray(wrong.y) - np.asarray(read.y))[:, i] for n, i in bias.items()}
    return found


def monitored_as_read(monitor: Monitor, window: WindowStatistics, statistics: LocalStatistics) -> WindowStatistics:
    """The window with the statistics of the monitored parameters alone: what is wrong with nominal is wrong in all
    windows alike, and no noise of any."""
    others = set(monitor.names) - set(monitor.monitored)
    return replace(window, statistics=replace(statistics.without(others), meaning=monitor.meaning))
