"""Isolation to components: which of them changed, whatever each one's parameters did.

A set of components S changed with the probability of `SetPrior`, and in a component that changed every parameter
has the slab prior N(0, slab²·prior_sigma²): what wears a compressor costs efficiency and flow capacity together.
With β_S, I_SS the score and information of all parameters of S, scaled by D = slab·diag(prior_sigma),

    P(S | data) ∝ P(S) · mean over slabs of exp(½ β_Sᵀ A_S⁻¹ β_S − ½ log det A_S),    A_S = 1 + I_SS,

and of the leading sets the slab prior is cut to the way on which wear goes, as for parameters.
Where the maps of the model are generic this is surer than parameters: efficiency and flow capacity of one component
trade against each other with the shape of its map, and one parameter of a neighbour can imitate both together.
A sensor counts as a component of its own, with the prior that sensors have.

Named is what is itself more probable than not, see `more_probable_than_not`: of few components, some of which changed,
a further one that the data do not speak of is by the prior about as probable as not, and would come and go with noise.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np

from enginediag_cli.intake.agreement import Disagreement
from enginediag_cli.isolation.adequacy import (
    Adequacy,
    beyond_bounds,
    fit_after,
    log_of_free_vector,
    noise_level,
    probability_of_unlisted,
    tempered,
)
from enginediag_cli.isolation.advice import ODDS
from enginediag_cli.isolation.classes import Class, class_of
from enginediag_cli.isolation.methods import IsolationOptions
from enginediag_cli.isolation.posterior import plan, size_limit
from enginediag_cli.isolation.prior import Instruments, SetPrior, log_wear
from enginediag_cli.isolation.result import Explanation
from enginediag_cli.residuals.instruments import NoiseLevel
from enginediag_cli.residuals.score import Score
from enginediag_cli.residuals.statistics import LocalStatistics

MAX_SETS = 15_000
"""Enough for all sets of five components beside two of 13 instruments in two forms each."""
HALF = 0.5
"""Probability from which a component is named: as wrong a name as a missing one, both are least often so then."""


@dataclass(frozen=True)
class ComponentIsolation:
    """`components` that changed, empty when none; `probability` of exactly this set; `all_of_them`: that they all
    changed, whatever else did; `perhaps`: beside any of them, those that the most probable set holds, too, or that are
    more probable than not.

    rivals: other sets of components, likeliest first, which with the answer hold `coverage`; inclusion:
    probability per component that it is among those that changed; complete: False when the answer is as large
    as the largest set considered; adequacy: whether the answer fits, every parameter of its components free; one_of:
    the class of components that these data cannot tell apart, where the answer is one.
    """

    components: tuple[str, ...]
    probability: float
    rivals: tuple[Explanation, ...]
    coverage: float
    inclusion: dict[str, float]
    complete: bool
    adequacy: Adequacy = field(default_factory=Adequacy)
    one_of: Class | None = None
    perhaps: tuple[str, ...] = ()
    all_of_them: float = float("nan")


def component_posterior(
    score: Score, prior: SetPrior | None = None, *, largest: int | None = None
) -> tuple[tuple[str, ...], np.ndarray, np.ndarray, float]:
    """Components, sets of them (M, c) bool by falling probability, the probabilities (M,), summing to 1, and ln Z of
    all sets against no change.

    All sets of up to `largest` components are visited (default: as many as MAX_SETS allows).
    """
    prior = prior or SetPrior()
    owner = [p.component for p in score.described]
    components = tuple(dict.fromkeys(owner))
    # an instrument is wrong in one of its forms: each is a unit, and two of one instrument have the prior 0
    wrong, units = np.array([p.fails_alone for p in score.described], bool), list[list[int]]()
    for c in components:
        mine = [i for i, o in enumerate(owner) if o == c]
        units += [[i] for i in mine] if wrong[mine].all() else [mine]
    instruments = Instruments.from_parameters([score.described[m[0]] for m in units])
    b, information = prior.scaled(score)
    p, width = len(owner), max(map(len, units), default=0)
    # every unit is filled up to the same width with a parameter of which the data tell nothing
    beta, I = np.zeros(p + 1), np.zeros((p + 1, p + 1))
    beta[:p], I[:p, :p] = b, information
    padded = np.array([m + [p] * (width - len(m)) for m in units], dtype=int).reshape(len(units), width)
    variance = np.square(prior.slabs)[:, None]
    u, forms, few = len(units), instruments.forms_of, prior.wrong_sensors
    every, _ = plan(u, size_limit(u, largest, MAX_SETS, int(forms.sum()), few), tuple(forms.tolist()), few)
    log_prior = prior.log_of(every, instruments)
    every, log_prior = every[np.isfinite(log_prior)], log_prior[np.isfinite(log_prior)]
    sizes = every.sum(axis=1)
    masks, logs = [every[:1]], [log_prior[:1]]
    for size in range(1, int(sizes.max()) + 1):
        mask = every[sizes == size]
        chosen = np.nonzero(mask)[1].reshape(len(mask), size)
        rows = padded[chosen].reshape(len(chosen), -1)
        A = np.eye(rows.shape[1]) + variance[:, :, None, None] * I[rows[:, :, None], rows[:, None, :]]
        right = np.broadcast_to(beta[rows][:, :, None], (*A.shape[:3], 1))
        gain = variance[:, :, None] * np.linalg.solve(A, right)[..., 0]
        each = 0.5 * np.sum(beta[rows] * gain, axis=2) - 0.5 * np.linalg.slogdet(A)[1]
        logs.append(np.logaddexp.reduce(each, axis=0) - np.log(len(each)) + log_prior[sizes == size])
        masks.append(mask)
    sets, weights = np.concatenate(masks), np.concatenate(logs)
    held = np.array([[i in m for i in range(p)] for m in units], bool).reshape(u, p)
    weights = weights + log_wear(score, sets @ held, weights, prior)
    of_units = np.array([[owner[m[0]] == c for c in components] for m in units], bool).reshape(u, len(components))
    top = float(weights.max())
    total = top + float(np.log(np.exp(weights - top).sum()))
    return components, *_summed(sets @ of_units, np.exp(weights - top)), total


def _summed(sets: np.ndarray, weights: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Each of the sets (M, c) once, by falling probability, and the probabilities, of weights (M,)."""
    found, where = np.unique(sets, axis=0, return_inverse=True)
    total = np.bincount(where.reshape(-1), weights=weights, minlength=len(found))
    order = np.argsort(-total, kind="stable")
    return found[order], total[order] / total.sum()


def more_probable_than_not(sets: np.ndarray, probabilities: np.ndarray) -> int:
    """Position of the set that is named among sets (M, c) bool by falling probability (M,): of the members of the most
    probable one those that are more probable than not, whatever else changed.

    They are the median probability model, which predicts better than the most probable one (Barbieri, M. M. and
    Berger, J. O. (2004) Annals of Statistics 32, 870–897), less what only other sets hold: a name that is missing does
    less harm than a wrong one. Where nothing is left, or a set that the data tell from the most probable one (see
    ODDS), that one is named: its members then stand against others by exchange, of which a class is told.
    """
    members = sets[0] & (probabilities @ sets >= HALF)
    if not members.any():
        return 0
    found = np.flatnonzero((sets == members).all(axis=1))
    return int(found[0]) if found.size and probabilities[found[0]] >= probabilities[0] / ODDS else 0


def isolate_components(
    score: Score,
    options: IsolationOptions | None = None,
    statistics: LocalStatistics | None = None,
    disagreement: Disagreement | None = None,
) -> ComponentIsolation:
    """The components that changed; of the options, those of the posterior method count.

    statistics: those of which `score` was made, for the question whether the answer fits, and disagreement of the
    recording with the engine, as in `diagnose`.
    """
    options = options or IsolationOptions()
    level = NoiseLevel() if statistics is None else noise_level(score, statistics)
    about, score = score, tempered(score, level.factor)
    components, sets, probabilities, total = component_posterior(score, options.prior, largest=options.largest)
    answer, adequacy = more_probable_than_not(sets, probabilities), Adequacy().of_file(disagreement)
    if statistics is not None:
        names = _parameters(score, components, sets[answer])
        unlisted = probability_of_unlisted(level, total, log_of_free_vector(score, options.prior))
        adequacy = replace(fit_after(about, statistics, names), noise=level.factor, unlisted=unlisted)
        adequacy = adequacy.of_file(disagreement)
        if not adequacy.stands:
            adequacy = replace(adequacy, beyond=beyond_bounds(about, options.prior))
    listed = 1.0 - adequacy.unlisted
    probabilities = listed * probabilities
    own, inclusion = float(probabilities[answer]), probabilities @ sets
    count = min(int(np.searchsorted(np.cumsum(probabilities), listed * options.coverage - 1e-12)) + 1, len(sets))

    def named(row: np.ndarray) -> tuple[str, ...]:
        return tuple(c for c, member in zip(components, row, strict=True) if member)

    limit = int(sets.sum(axis=1).max())
    return ComponentIsolation(
        named(sets[answer]),
        own,
        tuple(Explanation(named(sets[i]), float(probabilities[i])) for i in range(count) if i != answer),
        options.coverage,
        dict(zip(components, map(float, inclusion), strict=True)),
        int(sets[0].sum()) < limit or limit == len(components),
        adequacy,
        class_of(components, sets, probabilities, answer),
        named((sets[0] | (inclusion >= HALF)) & ~sets[answer] & sets[answer].any()),
        min(float(probabilities[sets[:, sets[answer]].all(axis=1)].sum()), *inclusion[sets[answer]].tolist(), 1.0),
    )


def _parameters(score: Score, components: tuple[str, ...], members: np.ndarray) -> list[str]:
    """All parameters of the components chosen by `members` (c,) bool."""
    chosen = {c for c, member in zip(components, members, strict=True) if member}
    return [p.name for p in score.described if p.component in chosen]
