"""How far the truth is from every alternative answer, on the same flights without noise.

Priors are centred on the true state, so that the true model fits without residual. The residual of another model is its
non-centrality after everything identified has been refitted:

    λ(t) = χ² of the model without t        λ_sep(t, r) = χ² with r in place of t        aliases C(t): λ_sep < 11

All alternatives of the same or smaller size are judged by projection at the fit without t; the nearest few are
refitted. A large effect that the model lacks may take the fit into another valley, where it stays when the effect is
added. A fit that begins at the priors, which lie near the true state, finds the valley of the truth; so the lower of
both is taken.

The alternatives to the location of a concealed formula have its own curve f over the records, of any size and with a
constant, at another location:

    λ_sep(location) = χ² of the flights without noise with c₁ f + c₀ at the location, everything identified refitted
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import combinations

import numpy as np

from enginediag_cli.drivers import CONSTANT, SAME, SWITCH, true_drivers
from enginediag_cli.engine.recall import MOMENT
from enginediag_cli.engine.term import Driver
from enginediag_cli.mismatch.explain.worth_fitting import MUCH_LESS_LIKELY
from enginediag_cli.mismatch.fit.columns import Columns
from enginediag_cli.mismatch.fit.evidence import Dataset
from enginediag_cli.mismatch.fit.extended import Discrepancy
from enginediag_cli.mismatch.fit.families import Sums, first_products, grid
from enginediag_cli.mismatch.fit.freeform import Location, locations
from enginediag_cli.mismatch.fit.identified import (
    NULL_HYPOTHESIS,
    FitBudget,
    Hypothesis,
    IdentifiedHypothesis,
    Nuisance,
    driver_values,
    identify_with,
    input_values,
    nuisance,
)
from enginediag_cli.mismatch.fit.options import (
    Option,
    OptionScore,
    combine_options,
    effect_option,
    effect_options,
    fault_options,
    option_scores,
)
from enginediag_cli.mismatch.fit.projection import Projection
from enginediag_cli.physics.registry import candidate_effects
from enginediag_cli.validation.trial_flights import (
    Cause,
    CauseNames,
    FittedCauses,
    cause_names,
    causes_from_options,
    causes_hypothesis,
)


def best_fit(
    evidence: Dataset, sought: Hypothesis, along: Nuisance, start: IdentifiedHypothesis, enough: float
) -> IdentifiedHypothesis:
    """The lower of the fits from `start` and from the priors; the first alone where it is below `enough`."""
    found = identify_with(evidence, sought, along, start)
    least = residual_chi2(found)
    if least < enough:
        return found
    anew = identify_with(evidence, sought, along)
    return anew if residual_chi2(anew) < least else found


def residual_chi2(fit: IdentifiedHypothesis) -> float:
    """χ² that a fit leaves, priors included; infinite where it did not converge."""
    return Projection(fit).objective if fit.converged else float(np.inf)


ALIAS = 11.0
"""λ_sep below which the right of two explanations wins less than 19 times out of 20."""

REFITTED = 3
"""Alternatives, nearest by projection first, that are refitted. Judgement between cost and the chance that a fourth is
nearer."""
REFITTED_MOVING = 5
"""Where records know their past, whatever the projection says: a limit or a long delay is no line through nothing."""
NEAR = 30.0
"""λ_sep by projection, beyond 5 % of λ, from which an alternative is not refitted."""

MOST_IN_PAIRS = 60
"""Options that pairs are made of, as in the search itself."""
SLACK = 0.05  # of the range of a coefficient, which projection knows only roughly


@dataclass(frozen=True)
class Separability:
    """`total`: λ of everything that is concealed; `given`: per cause, λ of it when the others are in the model;
    `nearest`: smallest λ_sep of all alternatives; `aliases`: alternatives with λ_sep < 11; `ok`: all fits
    converged."""

    total: float
    conditional: tuple[float, ...]
    nearest: float
    nearest_name: str
    aliases: frozenset[CauseNames]
    ok: bool


def centre_priors(evidence: Dataset, health: Mapping[str, float]) -> Dataset:
    """The data set with priors at the true state, so that the true model leaves no residual."""
    known = {n: health[n] for n in evidence.settings.nuisance if n in health}
    return replace(evidence, settings=replace(evidence.settings, prior_mean=known))


def separability(
    evidence: Dataset,
    truth: Sequence[Cause],
    health: dict[str, float],
    without: Sequence[str],
    values: Mapping[str, float] | None = None,
    named: FittedCauses | None = None,
) -> Separability:
    """Of the truth on noise-free evidence; `health`: true values of what is identified, `values`: true coefficients,
    where effects of the truth that are tried at some size begin. Where records have a history, alternatives that are
    tried begin at the size that says most, and more of them are refitted, since scores know such effects only roughly;
    so is the answer, `named`: whether it is an alias must not depend on the ranking of alternatives."""
    evidence = centre_priors(evidence, health)
    along = nuisance(evidence)
    base = identify_with(evidence, NULL_HYPOTHESIS, along)
    projection = Projection(base)
    total, n = projection.objective, sum(len(f.columns["time_s"]) for f in evidence.flights)
    ok = base.converged
    given = []
    for k in range(len(truth)):
        others = [c for j, c in enumerate(truth) if j != k]
        if not others:
            given.append(total)
            continue
        left, good = _fitted_chi2(evidence, causes_hypothesis(evidence.engine, others, n, values), along, base)
        given.append(left)
        ok &= good
    if not truth or not base.converged:
        return Separability(total, tuple(given), np.nan, "", frozenset(), ok)
    moving = all(MOMENT in f.columns for f in evidence.flights)
    library = list(candidate_effects(evidence.engine, without))
    effects = effect_options(library) if moving else [effect_option(e) for e in library]
    scores = option_scores(base, projection, [*effects, *fault_options(base)])
    rivals = sorted(_projected_alternatives(scores, total, len(truth), cause_names(truth)), key=lambda r: r[0])
    judged: list[tuple[float, CauseNames]] = []
    nearest = np.inf
    for k, (left, options) in enumerate(rivals):
        if (moving and k < REFITTED_MOVING) or (k < REFITTED and left < NEAR + 0.05 * total):
            # how far what is farther than another one is need not be known
            reach = nearest + MUCH_LESS_LIKELY if moving else np.inf
            left, good = _fitted_chi2(evidence, combine_options(*options), along, base, reach)
            nearest = min(nearest, left)
            # a rival that moves may have a valley without end: what it has reached is what it leaves, or a little more
            ok &= good or moving
        judged.append((left, cause_names(causes_from_options(options))))
    if (
        moving
        and named is not None
        and named[0]
        and cause_names(named[0]) != cause_names(truth)
        and len(named[0]) <= len(truth)
    ):
        left, _ = _fitted_chi2(evidence, causes_hypothesis(evidence.engine, named[0], n, named[1]), along, base)
        judged.append((left, cause_names(named[0])))
    nearest, name = min(judged, key=lambda j: j[0], default=(total, frozenset({"nothing"})))
    return Separability(
        total,
        tuple(given),
        float(nearest),
        " + ".join(sorted(name)),
        frozenset(k for left, k in judged if left < ALIAS),
        bool(ok),
    )


def _fitted_chi2(
    evidence: Dataset, other: Hypothesis, along: Nuisance, base: IdentifiedHypothesis, hopeless: float = np.inf
) -> tuple[float, bool]:
    """χ² with another hypothesis, and whether that fit converged; it is given up where it is `hopeless`."""
    if np.isfinite(hopeless):
        found = identify_with(evidence, other, along, base, reach=FitBudget(hopeless))
    else:
        found = best_fit(evidence, other, along, base, ALIAS)
    return Projection(found).objective, found.converged


def _projected_alternatives(
    scores: Sequence[OptionScore], total: float, size: int, truth: CauseNames
) -> Iterator[tuple[float, tuple[Option, ...]]]:
    """λ_sep by projection of all alternatives of at most this size, the best onset of every step only."""
    # what identification takes nearly all of may still be large: only physical bounds rule a rival out
    usable = [s for s in scores if s.score.dof]
    best: dict[CauseNames, OptionScore] = {}
    for s in usable:
        name = cause_names(causes_from_options((s.option,)))
        if name not in best or s.score.statistic > best[name].score.statistic:
            best[name] = s
    for name, s in best.items():
        if name != truth and _possible(s, s.z):
            yield total - s.score.statistic, (s.option,)
    if size < 2:
        return
    names = sorted(best, key=lambda k: -best[k].score.statistic)[:MOST_IN_PAIRS]
    # the truth's own parts may be small alone
    names += [k for k in best if k <= truth and k not in names]
    if len(names) < 2:
        return
    G = first_products([best[n] for n in names])
    length = np.sqrt(np.maximum(np.diag(G), 1e-300))
    r = np.clip(G / np.outer(length, length), -0.999999, 0.999999)
    for (i, a), (j, b) in combinations(enumerate(names), 2):
        if a | b != truth:
            T = _joint(best[a], best[b], float(r[i, j]))
            if np.isfinite(T):
                yield total - T, (best[a].option, best[b].option)


def _joint(a: OptionScore, b: OptionScore, r: float) -> float:
    """Statistic of the first columns of two options together, of correlation r; −∞ where an effect would need an
    impossible sign."""
    first, second = (a.z - r * b.z) / (1 - r * r), (b.z - r * a.z) / (1 - r * r)
    if not (_possible(a, first) and _possible(b, second)):
        return -np.inf
    return float((a.z**2 - 2 * r * a.z * b.z + b.z**2) / (1 - r * r))


def _possible(s: OptionScore, z: float) -> bool:
    """Whether an effect's first coefficient, in units of its own length, would be within its physical bounds."""
    if s.option.tried:
        return s.feasible
    for e in s.option.hypothesis.effects:
        c = e.term.amplitudes()[0]
        value = c.absent + z / max(s.score.length, 1e-300)
        return c.lower - SLACK * (c.upper - c.lower) <= value <= c.upper + SLACK * (c.upper - c.lower)
    return True


PLACES_FITTED = 4
"""Locations, nearest by projection first, that are fitted."""
BELIEVED = 10.0
"""Prior standard deviation of an alternative's curve, over the plausible range of its location: a larger one is no
alternative."""


def place_separability(
    base: IdentifiedHypothesis, along: Nuisance, f: np.ndarray, truth: Location
) -> Mapping[str, float]:
    """λ_sep by name of every place but the true one. `base`: fit without the law, and with all else that is concealed,
    to flights without noise; `f`: the law's curve over all records of the evidence (N,)."""
    where = [p for p in locations(base) if p.name != truth.name]
    columns = Columns(base, [p.parameter for p in where], [p.through for p in where if p.through is not None])
    names = list(dict.fromkeys(p.parameter for p in where))
    projection = Projection(base)
    curves = np.column_stack([f, np.ones(len(f))])[base.number]
    sums = Sums(projection, columns, grid(names, curves, [[0, 1]]))
    left = {}
    for p in where:
        own = np.array([[names.index(p.parameter), 0], [names.index(p.parameter), 1]])
        left[p.name] = projection.objective - sums.score(own).statistic
    near = sorted((p for p in where if left[p.name] < NEAR + 0.05 * projection.objective), key=lambda p: left[p.name])
    for p in near[:PLACES_FITTED]:
        rival = combine_hypotheses(base.hypothesis, free_curve(p, {"law": f - f.mean()}, base, BELIEVED))
        fit = best_fit(base.evidence, rival, along, base, ALIAS)
        if fit.converged:
            left[p.name] = Projection(fit).objective
    return left


def equivalent_places(left: Mapping[str, float]) -> frozenset[str]:
    """Names of the locations that are indistinguishable from the true one."""
    return frozenset(name for name, x in left.items() if x < ALIAS)


def combine_hypotheses(*hypotheses: Hypothesis) -> Hypothesis:
    """All of them at once."""
    return Hypothesis(
        tuple(e for h in hypotheses for e in h.effects),
        tuple(d for h in hypotheses for d in h.discrepancies),
        {k: v for h in hypotheses for k, v in h.curves.items()},
    )


def free_curve(
    place: Location, curves: Mapping[str, np.ndarray], base: IdentifiedHypothesis, over: float = 1.0
) -> Hypothesis:
    """The place's parameter free to follow curves (N,) of the evidence's records, and to be off by a constant where it
    is not identified; each by `over` times what the place roams, as root mean square."""
    own = {n: c / max(float(np.nanstd(c)), 1e-300) for n, c in curves.items()}
    if place.parameter not in base.problem.names and place.through is None:
        own["always"] = np.ones(len(next(iter(own.values()))))
    sought = tuple(Discrepancy(place.parameter, n, over * place.scale) for n in own)
    return Hypothesis(() if place.through is None else (place.through,), sought, own)


def find_place(places: Sequence[Location], name: str) -> Location | None:
    return next((p for p in places if p.name == name), None)


UNDRIVEN = (CONSTANT, SWITCH)
"""What effects need not vary with."""


def driver_is_right(evidence: Dataset, health: Mapping[str, float], driver: Driver, named: str) -> bool | None:
    """Whether the driver of that name is indistinguishable from `driver` in these records; None where it stands
    for nothing that varies here."""
    engine = evidence.engine
    inputs, theta = input_values(evidence), {n: v for n, v in health.items() if n in engine.parameters}
    found = driver_values(evidence, theta)
    values = {d.name: d.values for d in found}
    moving = [d for d in found if d.driver == driver]
    true = [d.values for d in moving or true_drivers(engine, inputs, theta, driver)]
    if driver in UNDRIVEN or not true:
        return None
    if named not in values:
        return False
    return any(_correlation(values[named], t) > SAME for t in true)


def _correlation(a: np.ndarray, b: np.ndarray) -> float:
    """0 where one of them stands still."""
    good = np.isfinite(a) & np.isfinite(b)
    if not (good.any() and np.ptp(a[good]) and np.ptp(b[good])):
        return 0.0
    return abs(float(np.corrcoef(a[good], b[good])[0, 1]))
