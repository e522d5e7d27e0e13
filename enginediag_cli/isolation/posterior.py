"""Posterior probability of every set of changed parameters, exactly.

A set S has the prior probability of `SetPrior`; a change has the slab prior N(0, slab²·prior_sigma²), of an
instrument's error a wider one (`SetPrior.widths`). Then

    P(S | data) ∝ P(S) · mean over slabs of exp(½ β_Sᵀ A_S⁻¹ β_S − ½ log det A_S)
    with A_S = 1 + D I_SS D,  β = D b,  D = slab · diag(prior_sigma).

Of the leading sets the slab prior is cut to the way on which wear goes, all but a doubt (see `wear`).

All sets up to a size limit are visited, not sampled. The model is that of George, E. I. and McCulloch, R. E.
(1997) Statistica Sinica 7, 339–373.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np

from enginediag_cli.isolation.enumeration import all_sets, number_of_sets, sets_of
from enginediag_cli.isolation.prior import Instruments, SetPrior
from enginediag_cli.isolation.wear import log_wear
from enginediag_cli.residuals.score import Score

MAX_SETS = 1_200_000
"""Enough for all sets of 20 parameters, or up to five of 40; about a second."""


ALL_LISTED = 5000
"""Up to so many sets all are listed."""
NEGLIGIBLE = 1e-5
"""Of more, those sets are not listed that would hold less than this share even if all sets were as probable as they."""


@dataclass(frozen=True)
class SetPosterior:
    """Sets by falling probability: `masks` (M, p) bool, `probabilities` (M,), summing to 1; `inclusion` (p,). All sets
    were compared; of many, those that are NEGLIGIBLE are not among them, but for that of no change.

    `log_evidence`: log of the marginal likelihood ratio of "something changed" to "nothing changed" times the
    prior odds; `log_total`: that of all sets, with their prior, to "nothing changed" without it. `largest`: size limit
    that was used; `wrong_sensors`: largest number of sensors in a set.
    """

    parameters: tuple[str, ...]
    masks: np.ndarray
    probabilities: np.ndarray
    inclusion: np.ndarray
    log_evidence: float
    largest: int
    wrong_sensors: int = 0
    log_total: float = 0.0

    def names(self, i: int) -> tuple[str, ...]:
        """Parameters of the i-th most probable set."""
        return tuple(name for name, member in zip(self.parameters, self.masks[i], strict=True) if member)

    def merged(self, instruments: Instruments) -> SetPosterior:
        """The same with sets that differ by forms of instruments' errors as one, each instrument in its likeliest
        form."""
        if instruments.count == len(self.parameters) - int(np.sum(~instruments.forms_of)):
            return self
        masks = instruments.in_one_form(self.masks, self.inclusion)
        packed = np.packbits(masks, axis=1)
        keys = np.ascontiguousarray(packed).view(np.dtype((np.void, packed.shape[1]))).ravel()
        _, first, where = np.unique(keys, return_index=True, return_inverse=True)
        weights = np.bincount(where.reshape(-1), weights=self.probabilities)
        order = np.lexsort((first, -weights))
        return replace(self, masks=masks[first[order]], probabilities=weights[order])

    def credible(self, coverage: float = 0.95) -> int:
        """How many of the first sets are needed to hold probability `coverage`."""
        return min(int(np.searchsorted(np.cumsum(self.probabilities), coverage - 1e-12)) + 1, len(self.probabilities))


def size_limit(
    p: int, wanted: int | None = None, max_sets: int = MAX_SETS, sensors: int = 0, wrong_sensors: int = 0
) -> int:
    """Largest size (at most `wanted`) for which there are no more than `max_sets` sets of p parameters, of which no
    more than `wrong_sensors` are out of `sensors` of them."""
    limit = 0
    while limit < (p if wanted is None else min(wanted, p)):
        if number_of_sets(p, limit + 1, sensors, wrong_sensors) > max_sets:
            break
        limit += 1
    return limit


def set_posterior(
    score: Score,
    prior: SetPrior | None = None,
    *,
    largest: int | None = None,
    faults: int | None = None,
    max_sets: int = MAX_SETS,
) -> SetPosterior:
    """Posterior over all sets up to `largest` parameters, or over the sets of exactly `faults`.

    prior: of sets and sizes of changes. ValueError when `faults` leaves more than `max_sets` sets to visit.
    """
    prior = prior or SetPrior()
    p, instruments = len(score.parameters), Instruments.from_parameters(score.described)
    forms, few = instruments.forms_of, prior.wrong_sensors
    limit = size_limit(p, faults if faults is not None else largest, max_sets, int(forms.sum()), few)
    if faults is not None and limit < min(faults, p):
        raise ValueError(f"{faults} faults among {p} parameters are more sets than can be visited ({max_sets})")
    b, information = prior.scaled(score)
    slabs = np.asarray(prior.slabs, float)
    A = np.eye(p) + slabs[:, None, None] ** 2 * information
    masks, quadratic, log_det = all_sets(slabs[:, None] * b, A, limit, forms, few)
    each = quadratic
    each -= log_det
    each *= 0.5
    wrong, healthy, log_forms = _counted(
        tuple(instruments.owner.tolist()), tuple(prior.log_odds_of(instruments).tolist()), limit, few
    )
    top = np.maximum.reduce(list(each))  # with the prior, a bound of the weight that is no more than ln(slabs) off
    of_size = prior.log_of_size(p - int(forms.sum())) + prior.log_all_right(instruments)
    logs = top + of_size.take(healthy) + log_forms
    sizes = healthy + wrong
    none = int(np.flatnonzero(sizes == 0)[0])
    asked = np.isfinite(log_forms) & ((sizes == faults) if faults is not None else True)
    if len(logs) > ALL_LISTED:
        asked &= logs >= logs[asked].max() + np.log(NEGLIGIBLE / len(logs))
        asked[none] |= faults is None
    kept = np.flatnonzero(asked)
    spread = np.log(np.exp(each[:, kept] - top[kept]).mean(axis=0))
    empty = float(logs[none] + np.logaddexp.reduce(each[:, none] - top[none]) - np.log(len(each)))
    listed = _holding_nearly_all(logs[kept] + spread, kept == none)
    logs, masks = (logs[kept] + spread)[listed], masks[kept[listed]]
    logs = logs + log_wear(score, masks, logs, prior)
    order = np.argsort(-logs, kind="stable")
    masks, logs = masks[order], logs[order]
    weights = np.exp(logs - logs[0])
    probabilities = weights / weights.sum()
    changed = masks.any(axis=1)
    evidence = float(logs[0] + np.log(weights[changed].sum()) - empty) if weights[changed].sum() > 0 else -np.inf
    total = float(logs[0] + np.log(weights.sum()))
    return SetPosterior(
        score.parameters, masks, probabilities, probabilities @ masks, evidence, limit, prior.wrong_sensors, total
    )


@lru_cache(maxsize=8)
def _counted(
    owner: tuple[int, ...], log_odds: tuple[float, ...], limit: int, few: int
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Of each set of `all_sets`, in its order (M,): how many errors of instruments and valves, how many parameters of
    the engine, and the log prior odds of the forms in it, of which each has log_odds (p,)."""
    instruments = Instruments(np.array(owner, int))
    masks = sets_of(len(owner), limit, tuple((instruments.forms_of).tolist()), few)
    wrong = masks[:, instruments.forms_of].sum(axis=1)
    return wrong, masks[:, ~instruments.forms_of].sum(axis=1), instruments.log_forms(masks, np.array(log_odds))


def _holding_nearly_all(logs: np.ndarray, none: np.ndarray) -> np.ndarray:
    """Positions of the sets that hold all but NEGLIGIBLE of the weight exp(logs) (M,), and of the one of no change."""
    weights = np.exp(logs - logs.max())
    count, enough = ALL_LISTED, (1 - NEGLIGIBLE) * float(weights.sum())
    while count < len(logs):
        top = np.argpartition(-weights, count)[:count]
        if float(weights[top].sum()) >= enough:
            kept = none.copy()
            kept[top] = True
            return np.flatnonzero(kept)
        count *= 2
    return np.arange(len(logs))
