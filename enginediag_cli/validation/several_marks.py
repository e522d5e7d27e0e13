"""Marks of trials with several causes: which were named, what was named besides, what stays unexplained.

An alternative r of the true cause t is an alias where, given all other true causes, χ² of the flights without noise
with r in place of t, everything identified refitted, is below 11.

    several_all          every true cause is named, or one of its aliases         each λ given the others ≥ 40
    several_share        share of the true causes that are named so               the same
    several_none_false   nothing is named that is neither true nor an alias       the same
    several_none_told_false  the same, except for what is reported as one of
                         several alternatives: absent from some explanation, or
                         a formula whose variables or locations hold the truth    the same
    several_unexplained  the stated unexplained share of the excess is within
                         0.1 of the true one                                      the same, where one is stated

As many causes as there are whose joint χ² is below 11 are indistinguishable from the true ones, too. A formula is named
where location and variables of a reported one are the true ones or indistinguishable from them. The unexplained share
is χ² of the flights without noise with everything named, over that without anything.
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
from enginediag_cli.validation.causes import Cause, causes_from_options, causes_hypothesis
from enginediag_cli.validation.concealed_effects import SHOWS, ConcealedTruth, TrialFlights
from enginediag_cli.validation.concealed_formulas import (
    ConcealedFormula,
    evaluate_formula,
    evaluate_variables,
    formula_term,
)
from enginediag_cli.validation.formula_marks import AnsweredFormula, build_formulas, describe_formula, same_driver
from enginediag_cli.validation.marks import ExplainAnswer, Marks, short, trial_dataset, trial_record
from enginediag_cli.validation.separability import (
    ALIAS,
    NEAR,
    REFITTED,
    Separability,
    best_fit,
    centre_priors,
    combine_hypotheses,
    equivalent_places,
    place_separability,
)


@dataclass(frozen=True)
class NamedCause:
    """A cause that was named; `laws`: the effects, where it is a law, several where that is a sum of forms at one
    place; none for a law that no engine could carry."""

    cause: Cause
    laws: tuple[Effect, ...] = ()
    is_law: bool = False

    def is_optional(self, answer: ExplainAnswer) -> bool:
        """Whether one of the reported alternatives lacks it."""
        reported: Sequence[Mapping[str, Any]] = answer.raw.get("explanations", ())
        place = self.cause.name.partition("@")[2] if self.is_law else ""
        return any(not _contains_cause(x, self.cause.name, place) for x in reported)

    def hypothesis(self, engine: Engine, records: int, values: Mapping[str, float]) -> Hypothesis | None:
        """It as something to fit; None where that is not possible."""
        if self.is_law:
            return Hypothesis(self.laws) if self.laws else None
        try:
            return causes_hypothesis(engine, (self.cause,), records, values)
        except KeyError:
            return None


def named_causes(engine: Engine, answer: ExplainAnswer) -> tuple[list[NamedCause], Mapping[str, float]]:
    """All causes of the first explanation, and the reported coefficients; none where nothing was named. What
    forms at one place make together is one law."""
    explained: Sequence[Mapping[str, Any]] = answer.raw.get("explanations", ())
    if answer.status not in (IDENTIFIED, FORMULA) or not explained:
        return [], {}
    first = explained[0]
    laws = {f"{entry['law']}@{entry['at']}": entry for entry in first.get("laws", ())}
    found: list[NamedCause] = []
    at: dict[str, list[str]] = {}
    for reported in first["causes"]:
        cause = Cause.from_json(reported)
        if cause.name in laws:
            at.setdefault(laws[cause.name]["at"], []).append(cause.name)
        else:
            found.append(NamedCause(cause))
    for names in at.values():
        own = build_formulas(engine, [laws[n] for n in names])
        found.append(NamedCause(Cause(names[0]), own or (), is_law=True))
    return found, {n: c[0] for n, c in first.get("coefficients", {}).items()}


def _contains_cause(explanation: Mapping[str, Any], name: str, place: str) -> bool:
    """Whether it has a cause of this name, or a law at this place."""
    if place:
        return any(entry["at"] == place for entry in explanation.get("laws", ()))
    return any(Cause.from_json(c).name == name for c in explanation["causes"])


def match_causes(same: np.ndarray) -> tuple[int, ...]:
    """Of a table (true causes, named ones) of what may stand for what: number of the named cause that stands for each
    true one, −1 for none, so that as many as possible are matched."""
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


def mark_several_trial(
    engine: Engine, concealed: ConcealedTruth, recorded: TrialFlights, answer: ExplainAnswer
) -> dict[str, Any]:
    """The trial's record: truth, answer, aliases of each cause, marks."""
    clean = centre_priors(trial_dataset(engine, concealed, recorded, clean=True), concealed.health)
    beside = nuisance(clean)
    truth = tuple(recorded.place_cause(c) for c in concealed.causes)
    base = identify_with(clean, NULL_HYPOTHESIS, beside)
    opened = SeveralScorer(engine, concealed, truth, base, beside)
    total, given, ok = Projection(base).objective, opened.conditional_fits(), base.converged
    found: Marks = {"no_verdict": answer.status == NOT_CONVERGED}
    kept: dict[str, Any] = {} if concealed.formula is None else {"law": describe_formula(concealed.formula)}
    ok &= all(fit.converged for fit, _ in given)
    left = tuple(x for _, x in given)
    judged = bool(ok and min(left) >= SHOWS)
    if judged and answer.status != NOT_CONVERGED:
        marked, kept["several"] = opened.marks(answer, total, [fit for fit, _ in given])
        found |= marked
    # rivals of single causes are in `kept`: of all together there is no one nearest
    separation = Separability(total, left, np.nan, "", frozenset(), bool(ok))
    return trial_record(concealed, recorded, separation, np.nan, answer, found, ()) | kept


@dataclass(frozen=True)
class SeveralScorer:
    """The causes of a trial, steps counted among its records, and the fit without any to flights without noise."""

    engine: Engine
    concealed: ConcealedTruth
    truth: tuple[Cause, ...]
    base: IdentifiedHypothesis
    nuisance: Nuisance

    def conditional_fits(self) -> list[tuple[IdentifiedHypothesis, float]]:
        """Of each cause the fit with all the others, and the χ² that it leaves."""
        fits = [self._fit(self._others(k)) for k in range(len(self.truth))]
        return [(fit, Projection(fit).objective) for fit in fits]

    def marks(
        self, answer: ExplainAnswer, total: float, fits: Sequence[IdentifiedHypothesis]
    ) -> tuple[Marks, dict[str, Any]]:
        """Marks of what was said, and what the record keeps of it. `total`: χ² without any cause, `fits` with all
        causes but one."""
        named, values = named_causes(self.engine, answer)
        stays = self._unexplained_share(named, values, total)
        same = np.zeros((len(self.truth), len(named)), bool)
        told_law, law_is_open = AnsweredFormula.from_json(answer.raw), False
        aliases = []
        for i, (cause, fit) in enumerate(zip(self.truth, fits, strict=True)):
            law = self._concealed_formula(cause)
            near = self._aliases(cause, fit)
            aliases.append(sorted(near))
            alike = [False] * len(named)
            if law is not None and any(n.laws for n in named):
                known = self._match_formula(law, fit)
                alike = [known.is_named(n) for n in named]
                law_is_open = told_law is not None and known.is_listed(told_law)
            for j, n in enumerate(named):
                same[i, j] = alike[j] if n.is_law and law is not None else n.cause.name in {cause.name, *near}
        for i, j in np.argwhere(~same):  # what has no place yet may still be an alias that nobody has looked at
            if not same[i].any() or not same[:, j].any():
                same[i, j] = self._can_replace(int(i), named[int(j)], values)
        if len(named) == len(self.truth) and stays * total < ALIAS:
            same[:] = True  # all that was named, together
        reported = match_causes(same)
        stated = answer.raw.get("unexplained")
        marks: Marks = {
            "several_all": min(reported) >= 0,
            "several_share": [float(np.mean([j >= 0 for j in reported]))],
            "several_none_false": bool(same.any(axis=0).all()) if named else True,
            "several_none_told_false": all(
                same[:, j].any() or (n.is_law and law_is_open) or n.is_optional(answer) for j, n in enumerate(named)
            ),
        }
        if stated is not None and np.isfinite(stays):
            marks["several_unexplained"] = bool(abs(float(stated) - stays) <= CLOSE)
        return marks, {
            "named": [n.cause.name for n in named],
            "told_by": list(reported),
            "aliases": aliases,
            "stays": short(stays),
            "stated": None if stated is None else short(float(stated)),
        }

    def _fit(self, sought: Hypothesis, start: IdentifiedHypothesis | None = None) -> IdentifiedHypothesis:
        return best_fit(self.base.evidence, sought, self.nuisance, start or self.base, ALIAS)

    def _others(self, k: int) -> Hypothesis:
        return combine_hypotheses(*(self._true_hypothesis(c) for j, c in enumerate(self.truth) if j != k))

    def _true_hypothesis(self, cause: Cause) -> Hypothesis:
        """A true cause as something to fit, begun at its size."""
        effect = next((e for e in self.concealed.effects if e.label == cause.name), None)
        if effect is not None:
            return Hypothesis((effect,))
        return causes_hypothesis(self.engine, (cause,), self.base.evidence.records)

    def _concealed_formula(self, cause: Cause) -> ConcealedFormula | None:
        law = self.concealed.formula
        return law if law is not None and law.effect.label == cause.name else None

    def _aliases(self, cause: Cause, fit: IdentifiedHypothesis) -> frozenset[str]:
        """Effects and steps of the library that are indistinguishable from a cause, given the others (`fit`)."""
        projection = Projection(fit)
        options = [*map(effect_option, candidate_effects(self.engine)), *fault_options(fit)]
        best: dict[str, tuple[float, Hypothesis]] = {}
        for s in option_scores(fit, projection, options):
            (own,) = causes_from_options((s.option,))
            left = projection.objective - s.score.statistic
            known = best.get(own.name, (np.inf, NULL_HYPOTHESIS))[0]
            if s.score.dof and s.feasible and own.name != cause.name and left < known:
                best[own.name] = left, s.option.hypothesis
        near = sorted(best.items(), key=lambda b: b[1][0])[:REFITTED]
        found = set()
        for name, (left, rival) in near:
            if left < NEAR + 0.05 * projection.objective:
                refitted = self._fit(combine_hypotheses(fit.hypothesis, rival), fit)
                if refitted.converged and Projection(refitted).objective < ALIAS:
                    found.add(name)
        return frozenset(found)

    def _match_formula(self, law: ConcealedFormula, fit: IdentifiedHypothesis) -> FormulaMatch:
        """The true law beside the other causes."""
        clean = self.base.evidence
        truth = self.engine.replace_effects((*self.engine.effects, *self.concealed.effects))
        theta = {**self.concealed.health, **self.concealed.values}
        values = evaluate_variables(
            truth, input_values(clean), theta, tuple(formula_variables(self.engine.network).values())
        )
        separation = place_separability(fit, self.nuisance, evaluate_formula(law.effect, values), law.place)
        at = {p.parameter: p.name for p in list_locations(self.engine, list(clean.noise.sigma))}
        return FormulaMatch(
            list(law.law.variables), frozenset({law.place.name, *equivalent_places(separation)}), at, values
        )

    def _can_replace(self, i: int, named: NamedCause, values: Mapping[str, float]) -> bool:
        """Whether a named cause in place of a true one leaves nothing that shows."""
        own = named.hypothesis(self.engine, self.base.evidence.records, values)
        others = self._others(i)
        if own is None or set(own.names) & set(others.names):
            return False
        fit = self._fit(combine_hypotheses(others, own))
        return bool(fit.converged and Projection(fit).objective < ALIAS)

    def _unexplained_share(self, named: Sequence[NamedCause], values: Mapping[str, float], total: float) -> float:
        """Share of the excess that all that was named leaves; NaN where it cannot be fitted."""
        own = [n.hypothesis(self.engine, self.base.evidence.records, values) for n in named]
        if not own:
            return 1.0
        if any(h is None for h in own):
            return np.nan
        fit = self._fit(combine_hypotheses(*(h for h in own if h is not None)))
        return float(np.clip(Projection(fit).objective / total, 0.0, 1.0)) if fit.converged else np.nan


@dataclass(frozen=True)
class FormulaMatch:
    """A true law of these `variables`: its location and those indistinguishable from it; `at`: name of the place of
    each parameter; `values`: of all variables over the records (N,)."""

    variables: Sequence[str]
    places: frozenset[str]
    place_names: Mapping[str, str]
    values: Mapping[str, np.ndarray]

    def is_named(self, named: NamedCause) -> bool:
        """Whether what is named is a law at its place and of its variables."""
        reported = [formula_term(e) for e in named.laws]
        variables = independent_variables([v for each in reported for v in each.variables], self.values)
        place = self.place_names.get(reported[0].acts.leaf) if reported else None
        return place in self.places and same_driver(self.variables, [[v] for v in variables], self.values)

    def is_listed(self, reported: AnsweredFormula) -> bool:
        """Whether it is among the formulas that are reported as equivalent."""
        return not self.places.isdisjoint(reported.equivalent_places) and any(
            same_driver(self.variables, groups, self.values) for groups in reported.driver_groups
        )


def independent_variables(variables: Sequence[str], values: Mapping[str, np.ndarray]) -> list[str]:
    """Those that the records separate from the ones before them. `values`: of all variables over the records (N,)."""
    found: list[str] = []
    for v in variables:
        if not any(same_driver([v], [[other]], values) for other in found):
            found.append(v)
    return found
