"""What a model that is not quite the engine's own may get wrong about a change.

A model with generic maps sees *that* something changed as well as an exact one, but the pattern of the change over
the sensors is a little off, in proportion to the change. Each sensor is therefore allowed a relative error of

    f · √(mean_j d_j²)        d_j = relative deviation of sensor j in the window

as a scale offset that is constant in the window, independent from sensor to sensor: an error of the fraction f of
the length of the deviation. Under no change d is noise and the allowance is far below it.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from enginediag_cli.residuals.monitor import Monitor, Offset
from enginediag_cli.residuals.statistics import LocalStatistics

PLAUSIBLE_SCALE = 0.01
"""Unit in which an added scale offset is measured; it only has to be of the right order."""


def scale_offsets(monitor: Monitor) -> np.ndarray:
    """Positions (m,) of each sensor's scale offset among the parameters of a monitor that has all of them."""
    first = len(monitor.names) - len(monitor.offsets)
    position = {o.sensor: first + i for i, o in enumerate(monitor.offsets) if o.kind == "scale"}
    return np.array([position[j] for j in range(len(monitor.sensors))], dtype=int)


def with_scale_offsets(monitor: Monitor, sigma: float = 0.0) -> Monitor:
    """The monitor with a scale offset for every sensor; those added have standard deviation `sigma`."""
    have = {o.sensor for o in monitor.offsets if o.kind == "scale"}
    added = tuple(Offset(j, "scale") for j in range(len(monitor.sensors)) if j not in have)
    k = len(added)
    uncertainty = np.zeros((len(monitor.names) + k,) * 2)
    uncertainty[: len(monitor.names), : len(monitor.names)] = monitor.uncertainty
    uncertainty[range(len(monitor.names), len(uncertainty)), range(len(monitor.names), len(uncertainty))] = sigma**2
    return replace(
        monitor,
        offsets=(*monitor.offsets, *added),
        uncertainty=uncertainty,
        names=(*monitor.names, *(f"offset.{monitor.sensors[o.sensor]}.scale" for o in added)),
        theta0=np.append(monitor.theta0, np.zeros(k)),
        prior_sigma=np.append(monitor.prior_sigma, np.full(k, PLAUSIBLE_SCALE)),
        lower=np.append(monitor.lower, np.full(k, -np.inf)),
        upper=np.append(monitor.upper, np.full(k, np.inf)),
    )


def model_error_covariance(statistics: LocalStatistics, scales: np.ndarray, fraction: float) -> np.ndarray:
    """Covariance (p, p) to add to the uncertainty of the window's parameters.

    scales (m,): positions of the scale offset of each sensor among the p parameters. A sensor without a reading
    has no information and takes no part.
    """
    C = np.zeros_like(statistics.F)
    information = np.diag(statistics.F)[scales]
    read = scales[information > 0]
    if read.size:
        deviation = statistics.s[read] / np.diag(statistics.F)[read]
        C[read, read] = fraction**2 * float(np.mean(deviation**2))
    return C
