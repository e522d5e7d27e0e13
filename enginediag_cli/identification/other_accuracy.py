"""A nominal state as it would be if the maps were as accurate as someone says.

Parameters and amounts of map error were found together, x ~ N(μ, C) under priors of variance P (all in prior standard
deviations, where P = 1). What the records alone said is C⁻¹ − 1 and C⁻¹ μ; with other variances P' of the amounts,

    C' = (C⁻¹ − 1 + P'⁻¹)⁻¹,     μ' = C' C⁻¹ μ.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from enginediag_cli.error_model.modelled import FAMILY
from enginediag_cli.identification.nominal import Nominal, status_of

NONE = 1e-4
"""Share of its size to which an amount is held where the maps are said to be right: it vanishes, and C' stays
regular."""


def with_accuracy(nominal: Nominal, accuracy: float) -> Nominal:
    """The nominal state with maps of this relative accuracy; as it is where it knows of no map error."""
    found = nominal.error_model
    if found is None:
        return nominal
    estimates = nominal.estimates
    scale = np.array([e.prior_sigma for e in estimates])
    mean = np.array([e.value - e.prior_mean for e in estimates]) / scale
    own = np.array([e.family == FAMILY for e in estimates])
    factor = np.where(own, np.maximum(accuracy / scale, NONE), 1.0)
    information = np.linalg.inv(nominal.covariance / scale / scale[:, None])
    information = (information + information.T) / 2
    covariance = np.linalg.inv(information - np.eye(len(scale)) + np.diag(factor**-2))
    moved = covariance @ (information @ mean)
    scaled = covariance * scale * scale[:, None]
    errors = np.sqrt(np.diag(scaled))
    values = np.array([e.prior_mean for e in estimates]) + scale * moved
    changed = tuple(
        replace(
            e,
            value=float(v),
            standard_error=float(s),
            prior_sigma=float(e.prior_sigma * f),
            from_data=float(np.clip(1 - (s / (e.prior_sigma * f)) ** 2, 0.0, 1.0)),
        )
        for e, v, s, f in zip(estimates, values, errors, factor, strict=True)
    )
    changed = tuple(replace(e, status=status_of(e.from_data, e.status == "at bound")) for e in changed)
    sizes = dict.fromkeys(found.sizes, accuracy)
    return replace(
        nominal,
        estimates=changed,
        covariance=(scaled + scaled.T) / 2,
        error_model=replace(found, stated=accuracy, sizes=sizes),
        smooth=None if nominal.smooth else nominal.smooth,
    )
