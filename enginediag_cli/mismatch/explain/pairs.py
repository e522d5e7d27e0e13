"""Which pairs of options are worth a fit: the best by their joint score at the fit without them, and those that single
ones leave something for."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from enginediag_cli.drivers import TIME
from enginediag_cli.mismatch.explain.members import Members, add
from enginediag_cli.mismatch.fit.families import first_products
from enginediag_cli.mismatch.fit.options import Option, OptionScore, with_best_onset
from enginediag_cli.mismatch.fit.remainder import remainder
from enginediag_cli.mismatch.fit.trial import HypothesisFit

MOST = 60
"""Options that pairs are made of: 1,770 pairs, a second's work."""

EXTENDED = 2
"""Of the best singles, how many are extended to pairs by what they leave."""


def best_pairs(scores: Sequence[OptionScore], most: int) -> list[tuple[Option, Option]]:
    """At most `most` pairs, by the joint statistic T of both blocks' columns at the fit without them."""
    # an option that is nothing alone may matter beside another: rank by what each could be at all
    ranked = [s for s in scores if not s.score.absorbed and s.score.dof][:MOST]
    found: list[tuple[float, Option, Option]] = []
    if len(ranked) < 2:
        return []
    T = _pair_statistics(first_products(ranked), ranked)
    allowed = np.triu(np.ones_like(T, bool), 1)
    for i, a in enumerate(ranked):
        for j, b in enumerate(ranked[:i]):
            if set(a.option.hypothesis.names) & set(b.option.hypothesis.names):
                allowed[j, i] = False
            if a.option.driver == b.option.driver == TIME and a.option.component == b.option.component:
                allowed[j, i] = False
    order = np.argsort(np.where(allowed, -T, np.inf), axis=None)
    for flat in order[: 4 * most]:
        i, j = np.unravel_index(flat, T.shape)
        if allowed[i, j]:
            found.append((float(T[i, j]), ranked[i].option, ranked[j].option))
    result: list[tuple[Option, Option]] = []
    for _, one, other in sorted(found, key=lambda f: -f[0]):
        if not any({one.label, other.label} == {x.label, y.label} for x, y in result):
            result.append((one, other))
        if len(result) == most:
            break
    return result


def _pair_statistics(G: np.ndarray, ranked: Sequence[OptionScore]) -> np.ndarray:
    """T (k, k) of every pair, with the first column of each block, whose products are G (k, k); −inf where a
    coefficient has the wrong sign."""
    z, length = np.array([s.z for s in ranked]), np.sqrt(np.diag(G))
    r = np.clip(G / np.outer(length, length), -0.999999, 0.999999)
    a, b = z[:, None], z[None, :]
    T = (a * a - 2 * r * a * b + b * b) / (1 - r * r)
    # joint coefficients in units of their own lengths; an effect must go where physics lets it
    first, second = (a - r * b) / (1 - r * r), (b - r * a) / (1 - r * r)
    bad = _wrong(ranked, first) | _wrong(ranked, second.T).T
    np.fill_diagonal(bad, True)
    return np.asarray(np.where(bad, -np.inf, T))


def _wrong(ranked: Sequence[OptionScore], coefficients: np.ndarray) -> np.ndarray:
    """Whether row k's coefficients have a sign that its option cannot have, (k, k)."""
    bad = np.zeros(coefficients.shape, bool)
    for k, s in enumerate(ranked):
        for e in s.option.hypothesis.effects[:1]:
            c = e.term.amplitudes()[0]
            bad[k] = (coefficients[k] < 0) & (c.lower >= c.absent) | (coefficients[k] > 0) & (c.upper <= c.absent)
    return bad


def forward(library: Sequence[Option], singles: Sequence[HypothesisFit]) -> list[Members]:
    """Each single option with the effect, and with the change in time, that says most about what it leaves."""
    wider: list[Members] = []
    for trial in singles:
        left = remainder(trial, library, ())
        for timed in (False, True):
            best = next((s for s in left.scores if (s.option.driver == TIME) == timed and s.surprise > 0.0), None)
            if best is not None:
                add(wider, (*trial.options, with_best_onset(trial.found, trial.projection, best.option)))
    return wider
