"""How far the truth is from everything else that the explainer could say, on the same flights without noise.

Priors are centred on the true state, so that the true model fits without residual and what is left with another
model is its non-centrality after everything identified has been re-identified:

    λ(t) = χ² of the model without t        λ_sep(t, r) = χ² with r in place of t        aliases C(t): λ_sep < 11

All rivals of the same or smaller size are judged by projection at the fit without t; the nearest few are refitted.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import combinations

import numpy as np

from enginediag_cli.engine.moving.tape import MOMENT
from enginediag_cli.mismatch.explain.worth_fitting import PLAINLY_WORSE
from enginediag_cli.mismatch.fit.evidence import Evidence
from enginediag_cli.mismatch.fit.families import first_products
from enginediag_cli.mismatch.fit.identified import (
    NO_HYPOTHESIS,
    Hypothesis,
    Identified,
    Nuisance,
    Reach,
    identify_with,
    nuisance,
)
from enginediag_cli.mismatch.fit.options import (
    Option,
    OptionScore,
    effect_option,
    effect_options,
    fault_options,
    option_scores,
    together,
)
from enginediag_cli.mismatch.fit.projection import Projection
from enginediag_cli.physics.registry import candidates
from enginediag_cli.validation.blind.causes import Begun, Cause, Key, causes_of, hypothesis, key
from enginediag_cli.validation.blind.lowest import lowest

ALIAS = 11.0
"""λ_sep below which the right of two explanations wins less than 19 times out of 20."""

REFITTED = 3
"""Rivals, nearest by projection first, that are refitted. Judgement between cost and the chance that a fourth is
nearer."""
REFITTED_MOVING = 5
"""Where records know their past, whatever the projection says: a limit or a long delay is no line through nothing."""
NEAR = 30.0
"""λ_sep by projection, beyond 5 % of λ, from which a rival is not worth a refit."""

MOST_IN_PAIRS = 60
"""Options that pairs are made of, as in the search itself."""
SLACK = 0.05  # of the range of a coefficient, which projection knows only roughly


@dataclass(frozen=True)
class Separability:
    """`total`: λ of everything that is concealed; `given`: per cause, λ of it when the others are in the model;
    `nearest`: smallest λ_sep of all rivals, `rival` its name; `aliases`: rivals with λ_sep < 11; `ok`: all fits
    converged."""

    total: float
    given: tuple[float, ...]
    nearest: float
    rival: str
    aliases: frozenset[Key]
    ok: bool


def separability(
    evidence: Evidence,
    truth: Sequence[Cause],
    health: dict[str, float],
    without: Sequence[str],
    values: Mapping[str, float] | None = None,
    said: Begun | None = None,
) -> Separability:
    """Of the truth on noise-free evidence; `health`: true values of what is identified, `values`: true coefficients,
    where effects of the truth that are tried at some size begin. Where records know their past, rivals that are tried
    begin at the size that says most, and more of them are refitted, since scores know such effects only roughly; so is
    what was `said`: whether that can be told from the truth is a fact that no ranking of rivals may miss."""
    known = {n: health[n] for n in evidence.settings.nuisance if n in health}
    evidence = replace(evidence, settings=replace(evidence.settings, prior_mean=known))
    along = nuisance(evidence)
    base = identify_with(evidence, NO_HYPOTHESIS, along)
    projection = Projection(base)
    total, n = projection.objective, sum(len(f.columns["time_s"]) for f in evidence.flights)
    ok = base.converged
    given = []
    for k in range(len(truth)):
        others = [c for j, c in enumerate(truth) if j != k]
        if not others:
            given.append(total)
            continue
        left, good = _left(evidence, hypothesis(evidence.engine, others, n, values), along, base)
        given.append(left)
        ok &= good
    if not truth or not base.converged:
        return Separability(total, tuple(given), np.nan, "", frozenset(), ok)
    moving = all(MOMENT in f.columns for f in evidence.flights)
    library = list(candidates(evidence.engine, without))
    effects = effect_options(library) if moving else [effect_option(e) for e in library]
    scores = option_scores(base, projection, [*effects, *fault_options(base)])
    rivals = sorted(_rivals(scores, total, len(truth), key(truth)), key=lambda r: r[0])
    judged: list[tuple[float, Key]] = []
    nearest = np.inf
    for k, (left, options) in enumerate(rivals):
        if (moving and k < REFITTED_MOVING) or (k < REFITTED and left < NEAR + 0.05 * total):
            # how far what is farther than another one is need not be known
            reach = nearest + PLAINLY_WORSE if moving else np.inf
            left, good = _left(evidence, together(*options), along, base, reach)
            nearest = min(nearest, left)
            # a rival that moves may have a valley without end: what it has reached is what it leaves, or a little more
            ok &= good or moving
        judged.append((left, key(causes_of(options))))
    if moving and said is not None and said[0] and key(said[0]) != key(truth) and len(said[0]) <= len(truth):
        left, _ = _left(evidence, hypothesis(evidence.engine, said[0], n, said[1]), along, base)
        judged.append((left, key(said[0])))
    nearest, name = min(judged, key=lambda j: j[0], default=(total, frozenset({"nothing"})))
    return Separability(
        total,
        tuple(given),
        float(nearest),
        " + ".join(sorted(name)),
        frozenset(k for left, k in judged if left < ALIAS),
        bool(ok),
    )


def _left(
    evidence: Evidence, other: Hypothesis, along: Nuisance, base: Identified, hopeless: float = np.inf
) -> tuple[float, bool]:
    """χ² with another hypothesis, and whether that fit converged; it is given up where it is `hopeless`."""
    if np.isfinite(hopeless):
        found = identify_with(evidence, other, along, base, reach=Reach(hopeless))
    else:
        found = lowest(evidence, other, along, base, ALIAS)
    return Projection(found).objective, found.converged


def _rivals(
    scores: Sequence[OptionScore], total: float, size: int, truth: Key
) -> Iterator[tuple[float, tuple[Option, ...]]]:
    """λ_sep by projection of all rivals of at most this size, the best onset of every step only."""
    # what identification takes nearly all of may still be large: only physical bounds rule a rival out
    usable = [s for s in scores if s.score.dof]
    best: dict[Key, OptionScore] = {}
    for s in usable:
        name = key(causes_of((s.option,)))
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
