"""Causes that an answer names, each against each of the true ones: the same, or one that the readings cannot tell from
it when the others are known.

A rival r of the true cause t is an alias where, given all other true causes,

    χ² of the flights without noise with r in place of t, all that is identified fitted anew, is below 11

A trial of several causes opened: which of them were named, what was named beside, what stays unexplained.

    several_all          every true cause is named, or one of its aliases         each λ given the others ≥ 40
    several_share        share of the true causes named so                        the same
    several_none_false   nothing is named that is neither true nor an alias       the same
    several_none_told_false  the same, but for what is told as one of several
                         that cannot be told apart: not in all explanations, or a
                         law with variables or places that hold the true one      the same
    several_unexplained  the share of the excess that is said to stay is within
                         0.1 of the one that stays                                the same, where one was said

As many causes as there are that together leave less than 11 cannot be told from the true ones, either. A law is named
where the place of one that was told is the true one's, or cannot be told from it, and so its variables. What stays of
the excess is χ² of the flights without noise with all that was named, over that without anything.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import permutations
from typing import Any

import numpy as np

from enginediag_cli.engine.engine import Engine
from enginediag_cli.engine.term import Effect
from enginediag_cli.mismatch.explain.answer import FORMULA, IDENTIFIED, NOT_CONVERGED
from enginediag_cli.mismatch.fit.freeform import list_locations
from enginediag_cli.mismatch.fit.identified import (
    NULL_HYPOTHESIS,
    Hypothesis,
    IdentifiedHypothesis,
    Nuisance,
    identify_with,
    input_values,
    nuisance,
)
from enginediag_cli.mismatch.fit.options import effect_option, fault_options, option_scores
from enginediag_cli.mismatch.fit.projection import Projection
from enginediag_cli.physics.law import formula_variables
from enginediag_cli.physics.registry import candidate_effects
from enginediag_cli.validation.causes import Cause, causes_of, hypothesis
from enginediag_cli.validation.concealed_effects import SHOWS, Recorded, Sealed
from enginediag_cli.validation.concealed_formulas import LawTruth, along, curve, law_of
from enginediag_cli.validation.formula_marks import ToldLaw, all_built, centred, described, same_driver
from enginediag_cli.validation.marks import Marks, Said, evidence_of, short, trial_record
from enginediag_cli.validation.separability import (
    ALIAS,
    NEAR,
    REFITTED,
    Separability,
    inseparable,
    joined,
    lowest,
    place_separability,
)


@dataclass(frozen=True)
class Named:
    """A cause that was named; `laws`: the effects, where it is a law, several where that is a sum of forms at one
    place; none for a law that no engine could carry."""

    cause: Cause
    laws: tuple[Effect, ...] = ()
    is_law: bool = False

    def lacks_in(self, said: Said) -> bool:
        """Whether one of the explanations that were told as rivals does without it."""
        told: Sequence[Mapping[str, Any]] = said.raw.get("explanations", ())
        place = self.cause.name.partition("@")[2] if self.is_law else ""
        return any(not _has(x, self.cause.name, place) for x in told)

    def hypothesis(self, engine: Engine, records: int, values: Mapping[str, float]) -> Hypothesis | None:
        """It as something to fit; None where that is not possible."""
        if self.is_law:
            return Hypothesis(self.laws) if self.laws else None
        try:
            return hypothesis(engine, (self.cause,), records, values)
        except KeyError:
            return None


def named_causes(engine: Engine, said: Said) -> tuple[list[Named], Mapping[str, float]]:
    """All causes of the first explanation, and the coefficients that were told; none where nothing was named. What
    forms at one place make together is one law."""
    explained: Sequence[Mapping[str, Any]] = said.raw.get("explanations", ())
    if said.status not in (IDENTIFIED, FORMULA) or not explained:
        return [], {}
    first = explained[0]
    laws = {f"{entry['law']}@{entry['at']}": entry for entry in first.get("laws", ())}
    found: list[Named] = []
    at: dict[str, list[str]] = {}
    for told in first["causes"]:
        cause = Cause.from_json(told)
        if cause.name in laws:
            at.setdefault(laws[cause.name]["at"], []).append(cause.name)
        else:
            found.append(Named(cause))
    for names in at.values():
        own = all_built(engine, [laws[n] for n in names])
        found.append(Named(Cause(names[0]), own or (), is_law=True))
    return found, {n: c[0] for n, c in first.get("coefficients", {}).items()}


def _has(explanation: Mapping[str, Any], name: str, place: str) -> bool:
    """Whether it has a cause of this name, or a law at this place."""
    if place:
        return any(entry["at"] == place for entry in explanation.get("laws", ()))
    return any(Cause.from_json(c).name == name for c in explanation["causes"])


def matched(same: np.ndarray) -> tuple[int, ...]:
    """Of a table (true causes, named ones) of what may stand for what: number of the named cause that each true one is
    told by, −1 for none, as many told as can be."""
    true, named = same.shape
    slots = [*range(named), *[-1] * true]
    best: tuple[int, ...] = (-1,) * true
    for order in set(permutations(slots, true)):
        usable = tuple(j if j >= 0 and same[i, j] else -1 for i, j in enumerate(order))
        if sum(j >= 0 for j in usable) > sum(j >= 0 for j in best):
            best = usable
    return best


CLOSE = 0.1
"""How far a stated share may be from the true one."""


def opened_several(engine: Engine, sealed: Sealed, recorded: Recorded, said: Said) -> dict[str, Any]:
    """The trial's record: truth, answer, aliases of each cause, marks."""
    clean = centred(evidence_of(engine, sealed, recorded, clean=True), sealed.health)
    beside = nuisance(clean)
    truth = tuple(recorded.place(c) for c in sealed.causes)
    base = identify_with(clean, NULL_HYPOTHESIS, beside)
    opened = Opened(engine, sealed, truth, base, beside)
    total, given, ok = Projection(base).objective, opened.given(), base.converged
    found: Marks = {"no_verdict": said.status == NOT_CONVERGED}
    kept: dict[str, Any] = {} if sealed.law is None else {"law": described(sealed.law)}
    ok &= all(fit.converged for fit, _ in given)
    left = tuple(x for _, x in given)
    judged = bool(ok and min(left) >= SHOWS)
    if judged and said.status != NOT_CONVERGED:
        marked, kept["several"] = opened.marks(said, total, [fit for fit, _ in given])
        found |= marked
    # rivals of single causes are in `kept`: of all together there is no one nearest
    far = Separability(total, left, np.nan, "", frozenset(), bool(ok))
    return trial_record(sealed, recorded, far, np.nan, said, found, ()) | kept


@dataclass(frozen=True)
class Opened:
    """The causes of a trial, steps counted among its records, and the fit without any to flights without noise."""

    engine: Engine
    sealed: Sealed
    truth: tuple[Cause, ...]
    base: IdentifiedHypothesis
    nuisance: Nuisance

    def given(self) -> list[tuple[IdentifiedHypothesis, float]]:
        """Of each cause the fit with all the others, and the χ² that it leaves."""
        fits = [self._fit(self._others(k)) for k in range(len(self.truth))]
        return [(fit, Projection(fit).objective) for fit in fits]

    def marks(self, said: Said, total: float, fits: Sequence[IdentifiedHypothesis]) -> tuple[Marks, dict[str, Any]]:
        """Marks of what was said, and what the record keeps of it. `total`: χ² without any cause, `fits` with all
        causes but one."""
        named, values = named_causes(self.engine, said)
        stays = self._stays(named, values, total)
        same = np.zeros((len(self.truth), len(named)), bool)
        told_law, law_is_open = ToldLaw.of(said.raw), False
        aliases = []
        for i, (cause, fit) in enumerate(zip(self.truth, fits, strict=True)):
            law = self._law(cause)
            near = self._aliases(cause, fit)
            aliases.append(sorted(near))
            alike = [False] * len(named)
            if law is not None and any(n.laws for n in named):
                known = self._known(law, fit)
                alike = [known.is_told_by(n) for n in named]
                law_is_open = told_law is not None and known.is_among(told_law)
            for j, n in enumerate(named):
                same[i, j] = alike[j] if n.is_law and law is not None else n.cause.name in {cause.name, *near}
        for i, j in np.argwhere(~same):  # what has no place yet may still be an alias that nobody has looked at
            if not same[i].any() or not same[:, j].any():
                same[i, j] = self._stands_for(int(i), named[int(j)], values)
        if len(named) == len(self.truth) and stays * total < ALIAS:
            same[:] = True  # all that was named, together
        told = matched(same)
        stated = said.raw.get("unexplained")
        marks: Marks = {
            "several_all": min(told) >= 0,
            "several_share": [float(np.mean([j >= 0 for j in told]))],
            "several_none_false": bool(same.any(axis=0).all()) if named else True,
            "several_none_told_false": all(
                same[:, j].any() or (n.is_law and law_is_open) or n.lacks_in(said) for j, n in enumerate(named)
            ),
        }
        if stated is not None and np.isfinite(stays):
            marks["several_unexplained"] = bool(abs(float(stated) - stays) <= CLOSE)
        return marks, {
            "named": [n.cause.name for n in named],
            "told_by": list(told),
            "aliases": aliases,
            "stays": short(stays),
            "stated": None if stated is None else short(float(stated)),
        }

    def _fit(self, sought: Hypothesis, start: IdentifiedHypothesis | None = None) -> IdentifiedHypothesis:
        return lowest(self.base.evidence, sought, self.nuisance, start or self.base, ALIAS)

    def _others(self, k: int) -> Hypothesis:
        return joined(*(self._true(c) for j, c in enumerate(self.truth) if j != k))

    def _true(self, cause: Cause) -> Hypothesis:
        """A true cause as something to fit, begun at its size."""
        effect = next((e for e in self.sealed.effects if e.label == cause.name), None)
        if effect is not None:
            return Hypothesis((effect,))
        return hypothesis(self.engine, (cause,), self.base.evidence.records)

    def _law(self, cause: Cause) -> LawTruth | None:
        law = self.sealed.law
        return law if law is not None and law.effect.label == cause.name else None

    def _aliases(self, cause: Cause, fit: IdentifiedHypothesis) -> frozenset[str]:
        """Effects and steps of the library that cannot be told from a cause, given the others (`fit`)."""
        projection = Projection(fit)
        options = [*map(effect_option, candidate_effects(self.engine)), *fault_options(fit)]
        best: dict[str, tuple[float, Hypothesis]] = {}
        for s in option_scores(fit, projection, options):
            (own,) = causes_of((s.option,))
            left = projection.objective - s.score.statistic
            known = best.get(own.name, (np.inf, NULL_HYPOTHESIS))[0]
            if s.score.dof and s.feasible and own.name != cause.name and left < known:
                best[own.name] = left, s.option.hypothesis
        near = sorted(best.items(), key=lambda b: b[1][0])[:REFITTED]
        found = set()
        for name, (left, rival) in near:
            if left < NEAR + 0.05 * projection.objective:
                refitted = self._fit(joined(fit.hypothesis, rival), fit)
                if refitted.converged and Projection(refitted).objective < ALIAS:
                    found.add(name)
        return frozenset(found)

    def _known(self, law: LawTruth, fit: IdentifiedHypothesis) -> KnownLaw:
        """The true law beside the other causes."""
        clean = self.base.evidence
        truth = self.engine.replace_effects((*self.engine.effects, *self.sealed.effects))
        theta = {**self.sealed.health, **self.sealed.values}
        values = along(truth, input_values(clean), theta, tuple(formula_variables(self.engine.network).values()))
        far = place_separability(fit, self.nuisance, curve(law.effect, values), law.place)
        at = {p.parameter: p.name for p in list_locations(self.engine, list(clean.noise.sigma))}
        return KnownLaw(list(law.law.variables), frozenset({law.place.name, *inseparable(far)}), at, values)

    def _stands_for(self, i: int, named: Named, values: Mapping[str, float]) -> bool:
        """Whether a named cause in place of a true one leaves nothing that shows."""
        own = named.hypothesis(self.engine, self.base.evidence.records, values)
        others = self._others(i)
        if own is None or set(own.names) & set(others.names):
            return False
        fit = self._fit(joined(others, own))
        return bool(fit.converged and Projection(fit).objective < ALIAS)

    def _stays(self, named: Sequence[Named], values: Mapping[str, float], total: float) -> float:
        """Share of the excess that all that was named leaves; NaN where it cannot be fitted."""
        own = [n.hypothesis(self.engine, self.base.evidence.records, values) for n in named]
        if not own:
            return 1.0
        if any(h is None for h in own):
            return np.nan
        fit = self._fit(joined(*(h for h in own if h is not None)))
        return float(np.clip(Projection(fit).objective / total, 0.0, 1.0)) if fit.converged else np.nan


@dataclass(frozen=True)
class KnownLaw:
    """A true law of these `variables`: its place and those that cannot be told from it; `at`: name of the place of each
    parameter; `values`: of all variables over the records (N,)."""

    variables: Sequence[str]
    places: frozenset[str]
    at: Mapping[str, str]
    values: Mapping[str, np.ndarray]

    def is_told_by(self, named: Named) -> bool:
        """Whether what is named is a law at its place and of its variables."""
        told = [law_of(e) for e in named.laws]
        variables = apart([v for each in told for v in each.variables], self.values)
        place = self.at.get(told[0].acts.leaf) if told else None
        return place in self.places and same_driver(self.variables, [[v] for v in variables], self.values)

    def is_among(self, told: ToldLaw) -> bool:
        """Whether it is one of those that are told as not to be told apart."""
        return not self.places.isdisjoint(told.alike) and any(
            same_driver(self.variables, groups, self.values) for groups in told.along
        )


def apart(variables: Sequence[str], values: Mapping[str, np.ndarray]) -> list[str]:
    """Those that the records can tell from the ones before them. `values`: of all variables over the records (N,)."""
    found: list[str] = []
    for v in variables:
        if not any(same_driver([v], [[other]], values) for other in found):
            found.append(v)
    return found
