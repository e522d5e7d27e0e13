"""Mean and covariance of all changes together, averaged over everything that the posterior holds possible.

With weight P(S | data) P(w | S, data) of set and slab, x_S ~ N(P b_S, P) within, 0 of what a set does not hold: the
first two moments of that mixture, as `averaging` has of one parameter.
"""

from __future__ import annotations

import numpy as np

from enginediag_cli.isolation.belief import Belief

LEFT_OUT = 1e-3
"""Probability that the sets which are left out hold together."""
MOST_SETS = 400
"""Sets averaged over at most, likeliest first."""


def moments(belief: Belief) -> tuple[np.ndarray, np.ndarray]:
    """Mean (p,) and covariance (p, p) of the changes of the score's parameters, in their units."""
    posterior, prior = belief.posterior, belief.prior
    count = int(np.searchsorted(np.cumsum(posterior.probabilities), 1 - LEFT_OUT)) + 1
    masks = posterior.masks[: min(count, MOST_SETS)]
    weights = posterior.probabilities[: len(masks)] / posterior.probabilities[: len(masks)].sum()
    p, slabs = len(belief.score.parameters), np.asarray(prior.slabs, float)
    first, second = np.zeros(p), np.zeros((p, p))
    sizes = masks.sum(axis=1)
    own = np.array([mask.tobytes() in belief.about for mask in masks], bool)
    groups = [(np.flatnonzero(~own & (sizes == size)), belief.score) for size in np.unique(sizes[~own]) if size]
    groups += [(np.array([k]), belief.about[masks[k].tobytes()]) for k in np.flatnonzero(own) if sizes[k]]
    for rows, local in groups:
        b, information = prior.scaled(local)
        size = int(sizes[rows[0]])
        members = np.nonzero(masks[rows])[1].reshape(len(rows), size)
        I = information[members[:, :, None], members[:, None, :]]
        P = np.linalg.inv(I + slabs[:, None, None, None] ** -2 * np.eye(size))  # (slabs, sets, size, size)
        mean = np.einsum("wsij,sj->wsi", P, b[members])
        log = 0.5 * np.einsum("wsi,si->ws", mean, b[members]) + 0.5 * np.linalg.slogdet(P)[1]
        log -= size * np.log(slabs)[:, None]
        share = np.exp(log - np.logaddexp.reduce(log, axis=0)) * weights[rows]
        np.add.at(first, members, np.einsum("ws,wsi->si", share, mean))
        square = P + mean[..., :, None] * mean[..., None, :]
        at = (members[:, :, None], members[:, None, :])
        np.add.at(second, at, np.einsum("ws,wsij->sij", share, square))
    D = belief.score.prior_sigma * prior.widths(belief.score.described)
    return D * first, D[:, None] * (second - np.outer(first, first)) * D
