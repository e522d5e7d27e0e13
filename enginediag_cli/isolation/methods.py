"""The isolation methods by name: what each names of a `Score`, or its `SetIsolation` with alternatives and sizes.

A method names changes by a function of its own, so that trials of thousands of windows need no alternatives.

Sensitivity test: how well a change of the parameters a alone explains the residual, eqs. (12) and (13).

    t̃_a = rᵀΣ⁻¹M_a (M_aᵀΣ⁻¹M_a)⁻¹ M_aᵀΣ⁻¹ r = b_aᵀ I_aa⁺ b_a ~ χ²(|a|)   if nothing else changed

It is biased when parameters outside a changed too; for that there is the min-max test.

Min-max test: whether a changed, whatever the others (b) did, eq. (14) and below.

    b_a* = b_a − I_ab I_bb⁺ b_b      I_a* = I_aa − I_ab I_bb⁺ I_ba      t_a* = b_a*ᵀ (I_a*)⁺ b_a* ~ χ²(rank)

The GLR test splits exactly into two parts: t = t_a* + t̃_b.

Step-down multiple comparison of single parameters by their min-max statistics.

Holm, S. (1979) Scandinavian Journal of Statistics 6, 65–70: the chance of naming any unchanged parameter
is at most α, whatever else changed. Cautious: parameters that others can imitate are rarely named.

Incremental diagnosis, the paper's algorithm for an unknown number of faults (section 5.1.2).

Step 1: best set of i parameters by the sensitivity test. Step 2: rejection test of all other parameters.
Step 3: if it rejects, i grows by one and step 1 is taken again; otherwise the set is the answer.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import combinations
from math import comb

import numpy as np

from enginediag_cli.detection.verdict import threshold
from enginediag_cli.isolation.posterior import SetPosterior, absorb_small_changes, average_sizes, set_posterior
from enginediag_cli.isolation.prior import InstrumentForms, SetPrior
from enginediag_cli.isolation.results import Explanation, SetIsolation, ambiguity_group, estimate_sizes
from enginediag_cli.isolation.subsets import ENUMERATED, best_subsets
from enginediag_cli.residuals.score import Score
from enginediag_cli.residuals.statistics import RANK_TOLERANCE, range_space


def quadratic_form(b: np.ndarray, information: np.ndarray, floor: float = 0.0) -> tuple[float, int]:
    """bᵀ I⁺ b and rank of I for scaled b (q,), I (q, q); eigenvalues up to `floor` count as zero."""
    space = range_space(information, np.ones(len(b)))
    kept = space.eigenvalues > floor
    v = b @ space.basis[:, kept]
    return float(np.sum(v**2 / space.eigenvalues[kept])), int(kept.sum())


def sensitivity_test(score: Score, names: Sequence[str]) -> tuple[float, int]:
    """t̃_a of the parameters `names` and its degrees of freedom."""
    a = score.indices(names)
    b, information = score.scaled()
    floor = RANK_TOLERANCE * float(np.max(np.diag(information), initial=0.0))
    return quadratic_form(b[a], information[np.ix_(a, a)], floor)


def single_sensitivities(score: Score) -> np.ndarray:
    """t̃ of each parameter alone (p,): b_i²/I_ii, zero where the parameter is not excited."""
    b, information = score.scaled()
    diagonal = np.diag(information)
    seen = diagonal > RANK_TOLERANCE * np.max(diagonal, initial=0.0)
    return np.where(seen, b**2 / np.where(seen, diagonal, 1.0), 0.0)


def minmax_test(score: Score, names: Sequence[str]) -> tuple[float, int]:
    """t_a* of the parameters `names` and its degrees of freedom (0: the others can imitate any change)."""
    a = score.indices(names)
    rest = [name for name in score.parameters if name not in names]
    if not rest:
        return score.glr, score.rank
    b, information = score.scaled()
    others = score.indices(rest)
    space = range_space(information[np.ix_(others, others)], np.ones(len(others)))
    regression = information[np.ix_(a, others)] @ (space.basis / space.eigenvalues) @ space.basis.T
    reduced_b = b[a] - regression @ b[others]
    reduced = information[np.ix_(a, a)] - regression @ information[np.ix_(others, a)]
    # what is left of a column after projection is known only to the rank tolerance of the whole column
    floor = RANK_TOLERANCE * float(np.max(np.diag(information), initial=0.0))
    return quadratic_form(reduced_b, reduced, floor)


def single_minmax(score: Score) -> tuple[np.ndarray, np.ndarray]:
    """t* of each parameter alone (p,) and whether it has a degree of freedom left (p,)."""
    results = [minmax_test(score, [name]) for name in score.parameters]
    return np.array([t for t, _ in results]), np.array([dof > 0 for _, dof in results])


def rejection_test(score: Score, isolated: Sequence[str]) -> tuple[float, int]:
    """Is something outside `isolated` needed? t_b* = t − t̃_a with rank − |a| degrees of freedom (step 2)."""
    explained, dof = sensitivity_test(score, isolated) if isolated else (0.0, 0)
    return max(score.glr - explained, 0.0), score.rank - dof


def holm_minmax(score: Score, false_alarm: float = 0.01) -> tuple[tuple[str, ...], np.ndarray]:
    """Parameters that changed whatever the others did, and the adjusted p value of each parameter (p,)."""
    from scipy.special import chdtrc

    t, testable = single_minmax(score)
    p_values = np.where(testable, chdtrc(1, t), 1.0)
    order = np.argsort(p_values, kind="stable")
    steps = (len(order) - np.arange(len(order))) * p_values[order]
    adjusted = np.empty(len(order))
    adjusted[order] = np.minimum(np.maximum.accumulate(steps), 1.0)
    named = tuple(name for name, value in zip(score.parameters, adjusted, strict=True) if value <= false_alarm)
    return named, adjusted


@dataclass(frozen=True)
class IncrementalStep:
    """One turn: the best set, its sensitivity statistic and the rejection test of the rest."""

    parameters: tuple[str, ...]
    statistic: float
    rejection: float
    rejection_dof: int
    rejection_threshold: float


@dataclass(frozen=True)
class IncrementalDiagnosis:
    """`isolated` parameters; `steps` on the way; `accepted`: the last rejection test let the set stand;
    `exact`: every set on the way is proved to be the best of its size."""

    isolated: tuple[str, ...]
    steps: tuple[IncrementalStep, ...]
    accepted: bool
    exact: bool


def incremental_diagnosis(
    score: Score, *, false_alarm: float = 0.01, faults: int | None = None, largest: int | None = None
) -> IncrementalDiagnosis:
    """Isolate by the paper's algorithm; with `faults` = q, the best set of exactly q parameters.

    `false_alarm` is the level of the rejection test, which the paper does not state.
    """
    if faults is None and (score.rank == 0 or score.glr <= threshold(score.rank, false_alarm)):
        return IncrementalDiagnosis((), (), score.rank > 0, True)
    most = faults or min(largest or score.rank, score.rank)
    steps: list[IncrementalStep] = []
    accepted, exact = False, True
    best = best_subsets(score, most) if len(score.parameters) <= ENUMERATED else None
    for size in [most] if faults else range(1, most + 1):
        # a search is cheapest for small sets, and the algorithm seldom gets to large ones
        found = best or best_subsets(score, size)
        if len(found.sets) < size:
            break
        exact = exact and found.exact
        names = tuple(score.parameters[i] for i in found.sets[size - 1])
        rejection, dof = rejection_test(score, names)
        limit = threshold(dof, false_alarm)
        steps.append(IncrementalStep(names, float(found.values[size - 1]), rejection, dof, limit))
        accepted = dof <= 0 or rejection <= limit
        if accepted:
            break
    return IncrementalDiagnosis(steps[-1].parameters if steps else (), tuple(steps), accepted, exact)


MAX_ALTERNATIVES = 50
"""Alternatives listed in tables, more are counted; sentences name three. Where few sensors leave hundreds of sets
possible, of the truths in the credible set one in fifty comes after the first twenty."""
MAX_ALTERNATIVE_TESTS = 5000
"""Sets that are tested for being alternatives: about a second of work."""

Named = tuple[tuple[str, ...], float]
"""The parameters that changed, and the probability that it is exactly these: NaN from a method that states none."""


@dataclass(frozen=True)
class IsolationOptions:
    """Options common to the methods.

    Attributes
    ----------
    faults : int or None
        Number of changed parameters, if known.
    false_alarm : float
        Level of tests.
    prior : SetPrior
        Prior of the posterior method.
    coverage : float
        Probability that the answer and its alternatives hold together; more than the share of truths that shall be
        among them, since how often things are wrong is known roughly.
    confidence : float
        Level of the intervals of sizes.
    largest : int or None
        Most parameters of a set.
    """

    faults: int | None = None
    false_alarm: float = 0.01
    prior: SetPrior = field(default_factory=SetPrior)
    coverage: float = 0.98
    confidence: float = 0.95
    largest: int | None = None


def most_probable_set(score: Score, options: IsolationOptions) -> Named:
    """The most probable set among all sets."""
    posterior = set_posterior(score, options.prior, largest=options.largest, faults=options.faults)
    posterior = posterior.merge_forms(InstrumentForms.from_parameters(score.described))
    return posterior.names(0), float(posterior.probabilities[0])


def incremental_set(score: Score, options: IsolationOptions) -> Named:
    """The set that the paper's incremental algorithm ends with."""
    found = incremental_diagnosis(
        score, false_alarm=options.false_alarm, faults=options.faults, largest=options.largest
    )
    return found.isolated, float("nan")


def best_set(score: Score, options: IsolationOptions) -> Named:
    """The set of `faults` parameters (default one) with the largest sensitivity statistic, eq. (13)."""
    return _best_of_size(score, options)[0], float("nan")


def minmax_set(score: Score, options: IsolationOptions) -> Named:
    """Parameters whose change no other can imitate, by Holm; with `faults` = q, the q with the largest statistics."""
    named, adjusted = holm_minmax(score, options.false_alarm)
    if options.faults is not None:
        order = sorted(range(len(adjusted)), key=lambda i: (adjusted[i], i))
        named = tuple(score.parameters[i] for i in sorted(order[: options.faults]))
    return named, float("nan")


def isolate_by_posterior(score: Score, options: IsolationOptions) -> SetIsolation:
    """Most probable set among all sets; alternatives are the next ones until `coverage` is reached."""
    posterior = set_posterior(score, options.prior, largest=options.largest, faults=options.faults)
    return posterior_result(score, posterior, options, options.prior)


def posterior_result(
    score: Score,
    posterior: SetPosterior,
    options: IsolationOptions,
    prior: SetPrior,
    about: Mapping[bytes, Score] | None = None,
    listed: float = 1.0,
) -> SetIsolation:
    """Answer, alternatives and sizes from a posterior over sets; `score` and `about` give the sizes (`average_sizes`).
    prior: the one with which the posterior was made; listed: probability that one of these sets is it."""
    every, instruments = posterior, InstrumentForms.from_parameters(score.described)
    posterior = absorb_small_changes(score, every.merge_forms(instruments), prior, about)
    posterior = replace(posterior, probabilities=listed * posterior.probabilities)
    isolated = posterior.names(0)
    count = posterior.credible_count(listed * options.coverage)
    rivals = tuple(
        Explanation(posterior.names(i), float(posterior.probabilities[i]))
        for i in range(1, min(count, MAX_ALTERNATIVES + 1))
    )
    wrong = int(instruments.is_form[score.indices(isolated)].sum())
    cut = options.faults is None and len(isolated) == posterior.largest < len(score.parameters)
    notes = [f"sets of more than {posterior.largest} parameters were not considered"] if cut else []
    if wrong and wrong == posterior.max_sensor_faults < instruments.count:
        notes.append(f"more than {wrong} wrong sensors were not considered")
    return SetIsolation(
        "posterior",
        isolated,
        float(posterior.probabilities[0]),
        rivals,
        max(count - 1 - len(rivals), 0),
        options.coverage,
        dict(zip(score.parameters, map(float, listed * instruments.inclusion(every.inclusion)), strict=True)),
        average_sizes(score, every, isolated, prior, options.confidence, about),
        not notes,
        "; ".join(notes),
        ambiguity_group(score.parameters, posterior.masks, posterior.probabilities),
        instruments.shares(score.parameters, isolated, every.inclusion),
    )


def isolate_incrementally(score: Score, options: IsolationOptions) -> SetIsolation:
    """The paper's incremental algorithm; alternatives: sets of equal size that the rejection test accepts."""
    found = incremental_diagnosis(
        score, false_alarm=options.false_alarm, faults=options.faults, largest=options.largest
    )
    notes = [] if found.accepted else ["the isolated set does not explain the residual"]
    notes += [] if found.exact else ["the search for the best set stopped at its limit"]
    rivals, left_out, searched = _accepted_alternatives(score, found.isolated, options.false_alarm)
    notes += [] if searched else ["too many alternative sets to test"]
    return SetIsolation(
        "incremental",
        found.isolated,
        float("nan"),
        rivals,
        left_out,
        1 - options.false_alarm,
        {},
        estimate_sizes(score, found.isolated, options.confidence),
        found.accepted and found.exact,
        "; ".join(notes),
    )


def isolate_by_sensitivity(score: Score, options: IsolationOptions) -> SetIsolation:
    """The answer of `best_set`; alternatives as those of the incremental algorithm."""
    isolated, exact = _best_of_size(score, options)
    rivals, left_out, searched = _accepted_alternatives(score, isolated, options.false_alarm)
    notes = [] if exact else ["the search for the best set stopped at its limit"]
    notes += [] if searched else ["too many alternative sets to test"]
    return SetIsolation(
        "sensitivity",
        isolated,
        float("nan"),
        rivals,
        left_out,
        1 - options.false_alarm,
        {},
        estimate_sizes(score, isolated, options.confidence),
        exact,
        "; ".join(notes),
    )


def isolate_by_minmax(score: Score, options: IsolationOptions) -> SetIsolation:
    """The answer of `minmax_set`, which may name nothing although something changed."""
    named, _ = minmax_set(score, options)
    changed = score.rank > 0 and score.glr > threshold(score.rank, options.false_alarm)
    note = "a change is seen but no single parameter is sure to have changed" if changed and not named else ""
    return SetIsolation(
        "minmax",
        named,
        float("nan"),
        (),
        0,
        1 - options.false_alarm,
        {},
        estimate_sizes(score, named, options.confidence),
        not note,
        note,
    )


NAMING: dict[str, Callable[[Score, IsolationOptions], Named]] = {
    "posterior": most_probable_set,
    "incremental": incremental_set,
    "sensitivity": best_set,
    "minmax": minmax_set,
}
"""What each of METHODS names, without alternatives and sizes."""

METHODS: dict[str, Callable[[Score, IsolationOptions], SetIsolation]] = {
    "posterior": isolate_by_posterior,
    "incremental": isolate_incrementally,
    "sensitivity": isolate_by_sensitivity,
    "minmax": isolate_by_minmax,
}


def isolate(score: Score, method: str = "posterior", options: IsolationOptions | None = None) -> SetIsolation:
    """Isolate changed parameters by the named method; ValueError lists the methods when it is unknown."""
    if method not in METHODS:
        raise ValueError(f"`method` must be one of {', '.join(METHODS)}, not {method!r}")
    return METHODS[method](score if method == "posterior" else keep_first_forms(score), options or IsolationOptions())


def keep_first_forms(score: Score) -> Score:
    """The score without the further forms of instruments' errors: a test that asks what no other can imitate, or counts
    parameters, knows one parameter of an instrument."""
    owner = InstrumentForms.from_parameters(score.described).owner
    kept = [i for i, k in enumerate(owner.tolist()) if k < 0 or k not in owner[:i]]
    if len(kept) == len(owner):
        return score
    b, information = score.scaled()
    space = range_space(information[np.ix_(kept, kept)], np.ones(len(kept)))
    return replace(
        score,
        parameters=tuple(score.parameters[i] for i in kept),
        theta0=score.theta0[kept],
        prior_sigma=score.prior_sigma[kept],
        b=score.b[kept],
        information=score.information[np.ix_(kept, kept)],
        glr=float(np.sum((b[kept] @ space.basis) ** 2 / space.eigenvalues)),
        rank=space.rank,
    )


def _best_of_size(score: Score, options: IsolationOptions) -> tuple[tuple[str, ...], bool]:
    """The best set of `faults` parameters, one where None, and whether the search for it came to its end."""
    size = 1 if options.faults is None else options.faults
    if not size:
        return (), True
    best = best_subsets(score, size)
    return tuple(score.parameters[i] for i in best.sets[-1]) if best.sets else (), best.exact


def _accepted_alternatives(
    score: Score, isolated: tuple[str, ...], false_alarm: float
) -> tuple[tuple[Explanation, ...], int, bool]:
    """Other sets of the same size that the rejection test accepts, by falling p value; how many more; whether
    all could be tested."""
    from scipy.special import chdtrc

    if not isolated:
        return (), 0, True
    if comb(len(score.parameters), len(isolated)) > MAX_ALTERNATIVE_TESTS:
        return (), 0, False
    accepted = []
    for names in combinations(score.parameters, len(isolated)):
        if set(names) != set(isolated):
            statistic, dof = rejection_test(score, names)
            p_value = float(chdtrc(dof, statistic)) if dof > 0 else 1.0
            if p_value > false_alarm:
                accepted.append(Explanation(names, p_value))
    accepted.sort(key=lambda rival: -rival.probability)
    return tuple(accepted[:MAX_ALTERNATIVES]), max(len(accepted) - MAX_ALTERNATIVES, 0), True
