"""Posterior probability of every set of changed parameters, exactly.

A set S changed with prior odds (π/(1−π))^|S|; a change has the slab prior N(0, slab²·prior_sigma²). Then

    log P(S | data) = ½ β_Sᵀ A_S⁻¹ β_S − ½ log det A_S + |S| log(π/(1−π)) + const
    with A_S = 1 + D I_SS D,  β = D b,  D = slab · diag(prior_sigma).

All sets up to a size limit are visited, not sampled: parameter by parameter every set splits into "without"
and "with", the latter by one elimination step, about six operations per set in total (George, E. I. and
McCulloch, R. E. (1997) Statistica Sinica 7, 339–373, give the model; the elimination is Gauss–Jordan).
"""

from __future__ import annotations

from dataclasses import dataclass
from math import comb, log

import numpy as np

from enginediag_cli.residuals.score import Score

MAX_SETS = 1_200_000
"""Enough for all sets of 20 parameters, or up to five of 40; about a second."""


@dataclass(frozen=True)
class SetPosterior:
    """Sets by falling probability: `masks` (M, p) bool, `probabilities` (M,), summing to 1; `inclusion` (p,).

    `log_evidence`: log of the marginal likelihood ratio of "something changed" to "nothing changed" times the
    prior odds. `largest`: size limit that was used.
    """

    parameters: tuple[str, ...]
    masks: np.ndarray
    probabilities: np.ndarray
    inclusion: np.ndarray
    log_evidence: float
    largest: int

    def names(self, i: int) -> tuple[str, ...]:
        """Parameters of the i-th most probable set."""
        return tuple(name for name, member in zip(self.parameters, self.masks[i], strict=True) if member)

    def credible(self, coverage: float = 0.95) -> int:
        """How many of the first sets are needed to hold probability `coverage`."""
        return min(
            int(np.searchsorted(np.cumsum(self.probabilities), coverage - 1e-12)) + 1, len(self.probabilities)
        )


def size_limit(p: int, wanted: int | None = None, max_sets: int = MAX_SETS) -> int:
    """Largest size (at most `wanted`) for which there are no more than `max_sets` sets of p parameters."""
    total, limit = 1, 0
    while limit < (p if wanted is None else min(wanted, p)):
        total += comb(p, limit + 1)
        if total > max_sets:
            break
        limit += 1
    return limit


def set_posterior(
    score: Score,
    *,
    inclusion: float = 0.1,
    slab: float = 1.0,
    largest: int | None = None,
    faults: int | None = None,
    max_sets: int = MAX_SETS,
) -> SetPosterior:
    """Posterior over all sets up to `largest` parameters, or over the sets of exactly `faults`.

    inclusion π: prior probability that a parameter changed; slab: plausible size of a change in multiples of
    `score.prior_sigma`. ValueError when `faults` leaves more than `max_sets` sets to visit.
    """
    if not 0 < inclusion < 1:
        raise ValueError("`inclusion` must lie between 0 and 1")
    p = len(score.parameters)
    limit = size_limit(p, faults if faults is not None else largest, max_sets)
    if faults is not None and limit < min(faults, p):
        raise ValueError(
            f"{faults} faults among {p} parameters are more sets than can be visited ({max_sets})"
        )
    b, information = score.scaled()
    masks, logs = _all_sets(slab * b, slab**2 * information, log(inclusion / (1 - inclusion)), limit)
    sizes = masks.sum(axis=1)
    empty = float(logs[sizes == 0][0])
    if faults is not None:
        chosen = sizes == faults
        masks, logs = masks[chosen], logs[chosen]
    order = np.argsort(-logs, kind="stable")
    masks, logs = masks[order], logs[order]
    weights = np.exp(logs - logs[0])
    probabilities = weights / weights.sum()
    changed = masks.any(axis=1)
    evidence = (
        float(logs[0] + np.log(weights[changed].sum()) - empty) if weights[changed].sum() > 0 else -np.inf
    )
    return SetPosterior(score.parameters, masks, probabilities, probabilities @ masks, evidence, limit)


def _all_sets(
    beta: np.ndarray, information: np.ndarray, log_odds: float, limit: int
) -> tuple[np.ndarray, np.ndarray]:
    """Masks (M, p) and unnormalised log posteriors (M,) of all sets of at most `limit` parameters."""
    p = len(beta)
    masks = np.zeros((1, p), bool)
    logs, size = np.zeros(1), np.zeros(1, int)
    c, G = beta[None], information[None]  # score and information of the undecided, given the decided
    for j in range(p):
        grow = np.flatnonzero(size < limit)
        pivot = 1.0 + G[grow, 0, 0]
        gain = c[grow, 0] / pivot
        column = G[grow, 1:, 0]
        with_logs = logs[grow] + 0.5 * c[grow, 0] * gain - 0.5 * np.log(pivot) + log_odds
        with_c = c[grow, 1:] - column * gain[:, None]
        with_G = G[grow, 1:, 1:] - column[:, :, None] * (column / pivot[:, None])[:, None, :]
        with_masks = masks[grow]
        with_masks[:, j] = True
        masks, logs = np.concatenate([masks, with_masks]), np.concatenate([logs, with_logs])
        size = np.concatenate([size, size[grow] + 1])
        c, G = np.concatenate([c[:, 1:], with_c]), np.concatenate([G[:, 1:, 1:], with_G])
    return masks, logs
