"""A scale offset for every sensor of a monitor: what one engine's readings differ from those of its type by."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from enginediag_cli.residuals.monitor import Monitor, Offset

PLAUSIBLE_SCALE = 0.01
"""Unit in which an added scale offset is measured; it only has to be of the right order."""


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
