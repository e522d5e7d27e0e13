"""What would flip the name that an answer puts first: per single error the smallest one, and the change of prior odds.

The name has changed where another set leads, but for the error of the instrument that is tried: where an answer gets
"and T3 reads wrong" by an error of T3, the error is told for what it is. A map's error has no name of its own, and
what is put down to its component's health is a flip. Nor has it changed where another set holds the answer and changes
that are too small to matter, as the answer's own probability has it (`averaging.py`).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from enginediag_cli.isolation.averaging import absorb_small_changes, log_too_small
from enginediag_cli.isolation.belief import Belief
from enginediag_cli.isolation.components import HALF, component_posterior, more_probable_than_not
from enginediag_cli.isolation.flips.errors import MAP, PRIOR, SingleError
from enginediag_cli.isolation.flips.lines import Lines, log_prior_of
from enginediag_cli.isolation.flips.search import Crossing, crossings
from enginediag_cli.isolation.posterior import SetPosterior
from enginediag_cli.isolation.prior import Instruments, SetPrior
from enginediag_cli.parameters import Parameter
from enginediag_cli.residuals.score import Score

MOST = 20.0
"""Standard deviations, as stated, up to which errors are tried: what takes more is no error but another instrument."""
LEADING = 150
"""Sets, likeliest first, that are followed along the lines; beside them all that differ from the answer by two
members."""


@dataclass(frozen=True)
class Flip:
    """An error that would change the first name. error: None for a change of prior odds; size: with its sign, as it
    would be added to what is recorded, in the error's unit (of prior odds: the factor for `becomes`); stated: one
    standard deviation in that unit; becomes: the name that is then first, empty for no change."""

    what: str
    kind: str
    size: float
    unit: str
    stated: float
    becomes: tuple[str, ...]
    error: SingleError | None = None

    @property
    def times(self) -> float:
        """The size in standard deviations as stated; of prior odds both are factors, whose logarithms count."""
        if self.kind == PRIOR:
            return float(np.log(self.size) / np.log(self.stated))
        return abs(self.size) / self.stated if self.stated else float("inf")


@dataclass(frozen=True)
class Flips:
    """Flips, the nearest by what is stated first; first: the name that would change; tried: how many errors were; most:
    up to how many standard deviations as stated."""

    found: tuple[Flip, ...]
    first: tuple[str, ...]
    tried: int
    most: float = MOST


def flips_of_parameters(belief: Belief, errors: Sequence[SingleError], most: float = MOST) -> Flips:
    """What would flip the first set of a posterior over sets of parameters."""
    posterior, instruments = belief.posterior, Instruments.from_parameters(belief.score.described)
    merged = posterior.merged(instruments)
    answer = int(
        np.flatnonzero((instruments.in_one_form(posterior.masks, posterior.inclusion) == merged.masks[0]).all(axis=1))[
            0
        ]
    )
    order = np.concatenate([[answer], np.delete(np.arange(len(posterior.masks)), answer)])
    masks, reported = _followed(posterior.masks[order], posterior.probabilities[order])
    possible = log_prior_of(belief, masks)
    kept = np.isfinite(possible) & (masks.sum(axis=1) <= posterior.largest)
    kept[0] = True
    masks, reported, possible = masks[kept], reported[kept], possible[kept]
    along = _lines(errors, len(belief.score.parameters))
    lines = Lines(belief, masks, possible, along, reported, leader_only=True)

    def likeliest(line: np.ndarray, logs: np.ndarray) -> np.ndarray:
        return np.asarray(logs.argmax(axis=1))

    same = partial(_same, _cores(masks, errors, belief.score.described), _Small(belief, masks, along))
    found = crossings(lines, likeliest, same, _limits(errors, most))
    names = posterior.parameters
    told = [_flip(errors[c.line], c, _names(names, masks[c.becomes])) for c in found.values()]
    answers = absorb_small_changes(belief.score, merged, belief.prior, belief.about)
    if len(answers.probabilities) > 1 and answers.probabilities[1] > 0:
        odds = float(answers.probabilities[0] / answers.probabilities[1])
        told.append(_of_prior(odds, answers.names(1), belief.prior))
    return Flips(tuple(sorted(told, key=lambda flip: flip.times)), answers.names(0), len(errors), most)


def flips_of_components(
    score: Score, prior: SetPrior, errors: Sequence[SingleError], largest: int | None = None, most: float = MOST
) -> Flips:
    """What would flip the components that `isolate_components` names of a score."""
    components, sets, probabilities, _ = component_posterior(score, prior, largest=largest)
    limit = int(sets.sum(axis=1).max())
    owner = [p.component for p in score.described]
    held = np.array([[o == c for o in owner] for c in components], bool)
    firsts = [score.described[owner.index(c)] for c in components]
    answer = more_probable_than_not(sets, probabilities)
    order = np.concatenate([[answer], np.delete(np.arange(len(sets)), answer)])
    followed, reported = _followed(sets[order], probabilities[order])
    possible = prior.log_of(followed, Instruments.from_parameters(firsts))
    kept = np.isfinite(possible) & (followed.sum(axis=1) <= limit)
    followed, reported, possible = followed[kept], reported[kept], possible[kept]
    masks = (followed[:, :, None] & held).any(axis=1)
    nothing = SetPosterior(score.parameters, masks, np.exp(reported), np.zeros(len(owner)), 0.0, limit)
    lines = Lines(Belief(score, nothing, prior), masks, possible, _lines(errors, len(owner)), reported)

    def named(line: np.ndarray, logs: np.ndarray) -> np.ndarray:
        return np.array([_named(followed, row) for row in logs], int)

    same = partial(_same, _cores(masks, errors, score.described), None)
    found = crossings(lines, named, same, _limits(errors, most))
    told = [_flip(errors[c.line], c, _names(components, followed[c.becomes])) for c in found.values()]
    second = next((i for i in range(len(sets)) if i != answer), None)
    if second is not None and probabilities[second] > 0:
        odds = max(float(probabilities[answer] / probabilities[second]), 1.0)
        told.append(_of_prior(odds, _names(components, sets[second]), prior))
    first = _names(components, followed[0])
    return Flips(tuple(sorted(told, key=lambda flip: flip.times)), first, len(errors), most)


def _named(sets: np.ndarray, logs: np.ndarray) -> int:
    order = np.argsort(-logs, kind="stable")
    weights = np.exp(logs[order] - logs[order[0]])
    return int(order[more_probable_than_not(sets[order], weights / weights.sum())])


def _followed(masks: np.ndarray, probabilities: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The first of the sets (M, p), the likeliest others and all that differ from the first by one or two members, with
    the logarithms of their probabilities, NaN where they are not listed."""
    with np.errstate(divide="ignore"):
        logs = {mask.tobytes(): float(log) for mask, log in zip(masks, np.log(probabilities), strict=True)}
    p = masks.shape[1]
    one = np.eye(p, dtype=bool)
    i, j = np.triu_indices(p, 1)
    near = masks[0] ^ np.concatenate([one, one[i] | one[j]])
    leading = masks[:LEADING]
    known = {mask.tobytes() for mask in leading}
    followed = np.concatenate([leading, [mask for mask in near if mask.tobytes() not in known] or leading[:0]])
    return followed, np.array([logs.get(mask.tobytes(), np.nan) for mask in followed])


def _lines(errors: Sequence[SingleError], p: int) -> np.ndarray:
    """What each error of one, in its unit, looks like (D, p)."""
    found = np.zeros((len(errors), p))
    for k, error in enumerate(errors):
        found[k, error.position] = error.scale
    return found


def _limits(errors: Sequence[SingleError], most: float) -> np.ndarray:
    return np.array([most * error.stated for error in errors])


def _cores(masks: np.ndarray, errors: Sequence[SingleError], described: Sequence[Parameter]) -> np.ndarray:
    """Whether each set (M,) is the first but for the instrument whose error is tried, of each error (D, M), and for the
    forms of other instruments' errors. described (p,): what each parameter is."""
    instruments = Instruments.from_parameters(described)
    one = instruments.in_one_form(masks, np.ones(len(described)))
    apart = one ^ one[0]
    found = np.repeat(~apart.any(axis=1)[None], len(errors), axis=0)
    for k, error in enumerate(errors):
        if error.kind != MAP:
            others = np.array([p.component != described[error.position].component for p in described], bool)
            found[k] = ~apart[:, others].any(axis=1)
    return found


@dataclass(frozen=True)
class _Small:
    """Whether a set holds the first of `masks` (M, p) and beside it changes that are too small to matter, by the score
    with an error along one of `along` (D, p) in it."""

    belief: Belief
    masks: np.ndarray
    along: np.ndarray

    def __call__(self, line: int, size: float, other: int) -> bool:
        belief, d, mask = self.belief, size * self.along[line], self.masks[other]
        if not np.all(mask | ~self.masks[0]):
            return False

        def moved(score: Score) -> Score:
            return replace(score, b=score.b + score.information @ d)

        own = belief.about.get(mask.tobytes())
        about = {} if own is None else {mask.tobytes(): moved(own)}
        (log,) = log_too_small(moved(belief.score), mask[None], belief.prior, about)
        return bool(np.sum(log[mask & ~self.masks[0]]) > np.log(HALF))


def _same(cores: np.ndarray, small: _Small | None, line: np.ndarray, sizes: np.ndarray, sets: np.ndarray) -> np.ndarray:
    found = np.array(cores[line, sets])
    if small is not None:
        for k in np.flatnonzero(~found):
            found[k] = small(int(line[k]), float(sizes[k]), int(sets[k]))
    return found


def _names(names: Sequence[str], mask: np.ndarray) -> tuple[str, ...]:
    return tuple(name for name, member in zip(names, mask, strict=True) if member)


def _flip(error: SingleError, crossing: Crossing, becomes: tuple[str, ...]) -> Flip:
    return Flip(error.what, error.kind, crossing.size, error.unit, error.stated, becomes, error)


def _of_prior(odds: float, becomes: tuple[str, ...], prior: SetPrior) -> Flip:
    """The factor on the prior odds of the second name against the first at which it comes first."""
    widest = max(*(max(s, 1 / s) for s in prior.spread), 1.0)
    return Flip("prior odds", PRIOR, odds, "times", widest if widest > 1 else math.e, becomes)
