"""Every form with the shape that suits a place best, before anything is fitted in the simulator.

A scan tries a form's shape at a few values, between which a narrow one is missed, and at a model without the law, which
answers a large one with other derivatives. Here the shapes of the best tries are sought (`shaping`) at a fit that
carries a law at the place already, which is added back to what this fit leaves.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from enginediag_cli.engine.driver import STILL
from enginediag_cli.mismatch.fit.any_curve import AnyCurve
from enginediag_cli.mismatch.fit.columns import Columns
from enginediag_cli.mismatch.fit.trial_fit import Trial
from enginediag_cli.mismatch.laws.proposed import possible
from enginediag_cli.mismatch.laws.scan import Candidate, Formula, Known, of_same_groups, of_same_variables
from enginediag_cli.mismatch.laws.shaping import Shaping
from enginediag_cli.mismatch.laws.smooth import Carried
from enginediag_cli.progress import stage

AT_ONCE = 500
"""Tries that are scored at once."""
STARTS = 2
"""Tries of a form, best first, from which its shape is sought: what a place and a width say together has several
maxima."""
MOST = 300
"""Tries from which shapes are sought, best first. How far one may be behind cannot be told: a narrow curve that is
misplaced says nothing."""
LEAST = 1e-9
"""Standard deviation of a form of size 1 from which it is anything: a bump far from all records is not."""
ALIKE = 6
"""Forms, likeliest first, of which all variables of the same groups are tried."""
ROUNDS = 12
"""Steps of each shape: what has not settled then is as good as it has become."""


@stage("shaping laws")
def refined(at: Carried, tries: Sequence[Formula], known: Sequence[Known], prior: float) -> list[Candidate]:
    """Every form of the same variables once, likeliest first, from these tries; the likeliest also of all variables of
    the same groups. `prior`: ln, of the place. `weight`: ln evidence against the base."""
    said = _Said(at)
    found = _sought(at, said, tries, prior)
    of = set(map(_form_of, found))
    others = [f for c in found[:ALIKE] for f in of_same_groups(c.formula, known)]
    more = _sought(at, said, others, prior)
    return sorted([*found, *(c for c in more if _form_of(c) not in of)], key=lambda c: -c.weight)


def reshaped(trial: Trial, candidates: Sequence[Candidate], most: int) -> list[Candidate]:
    """The best candidates of as many forms, likeliest first, beside what a trial has, each with the shape that suits
    it."""
    best: dict[object, Candidate] = {}
    for c in candidates:
        best.setdefault((c.location.name, _form_of(c)), c)
    chosen = list(best.values())[:most]
    found: list[Candidate] = []
    for place in {c.location.name: c.location for c in chosen}.values():
        own = [c for c in chosen if c.location.name == place.name]
        nothing = np.zeros(len(trial.found.number))
        at = Carried(trial.found, trial.projection, place, nothing, 0.0)
        prior = own[0].prior - own[0].formula.prior
        tries = [f for c in own for f in (c.formula, *of_same_variables(c.formula))]
        found += _sought(at, _Said(at), tries, prior)
    return sorted(found, key=lambda c: -c.weight)


def _form_of(c: Candidate) -> tuple[str, frozenset[str]]:
    return c.formula.form.name, frozenset(k.variable.name for k in c.formula.of)


def _sought(at: Carried, said: _Said, tries: Sequence[Formula], prior: float) -> list[Candidate]:
    """The best shapes, of each form of the same variables once."""
    shaping = [Shaping.of(f) for f in said.best(tries)]
    for _ in range(ROUNDS):
        said.look([s for s in shaping if not s.settled])
    found: dict[object, Candidate] = {}
    for s in sorted(shaping, key=lambda s: -s.evidence - s.formula.prior):
        if np.isfinite(s.evidence):
            own = s.formula.prior + prior
            weight = at.gain - said.worth + s.evidence + own
            c = Candidate(at.place, s.found(), s.amplitude, s.statistic, weight, own)
            found.setdefault(_form_of(c), c)
    return [c for c in found.values() if possible(c)]


class _Said:
    """What a place says of any curve beside what is carried there; `worth`: ½ χ² that the carried law takes away."""

    def __init__(self, at: Carried):
        through = [at.place.through] if at.place.through is not None else []
        columns = Columns(at.found, [at.place.parameter], through)
        self.any = AnyCurve.at(at.projection, columns, at.place.parameter)
        self.carried, self.scale = at.f, at.place.scale
        own = self.any.grams(at.f[:, None, None])[0, 0, 0]
        self.worth = float(self.any.pulls(at.f)) + 0.5 * own

    def of(self, curves: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Products (K, k, k), and pulls (K, k) of what is left and carried, of sets of curves (N, K, k); standard
        deviation (K,) of an amplitude of the first, none (NaN) of a curve that does not vary."""
        beside = np.broadcast_to(self.carried[:, None, None], (*curves.shape[:2], 1))
        G = self.any.grams(np.concatenate([curves, beside], axis=2))
        rms = np.std(curves[:, :, 0], axis=0)
        varies = rms > np.maximum(STILL * np.abs(curves[:, :, 0]).max(axis=0), LEAST)
        tau = np.where(varies, self.scale / np.where(varies, rms, 1.0), np.nan)
        return G[:, :-1, :-1], self.any.pulls(curves) + G[:, :-1, -1], tau

    def best(self, tries: Sequence[Formula]) -> list[Formula]:
        """Of each form of the same variables, in their order, the best as they stand."""
        weight = np.empty(len(tries))
        for a in range(0, len(tries), AT_ONCE):
            part = slice(a, a + AT_ONCE)
            G, g, tau = self.of(np.stack([f.curve for f in tries[part]], axis=1)[:, :, None])
            narrowed = 1.0 + tau**2 * G[:, 0, 0]
            prior = np.array([f.prior for f in tries[part]])
            weight[part] = 0.5 * (tau * g[:, 0]) ** 2 / narrowed - 0.5 * np.log(narrowed) + prior
        best: dict[object, list[Formula]] = {}
        for k in np.argsort(-weight, kind="stable"):
            own = best.setdefault(tries[k].what, [])
            if len(own) < STARTS:
                own.append(tries[k])
        return [f for own in best.values() for f in own][:MOST]

    def look(self, shaping: Sequence[Shaping]) -> None:
        """One look at each; those with as many letters together."""
        for k in sorted({len(s.z) for s in shaping}):
            own = [s for s in shaping if len(s.z) == k]
            curves = np.stack([s.curves() for s in own], axis=1)
            good = np.isfinite(curves).all(axis=(0, 2))
            G, g, tau = self.of(np.where(good[None, :, None], curves, 0.0))
            for j, s in enumerate(own):
                s.look(G[j], g[j], float(tau[j]) if good[j] else np.nan)
