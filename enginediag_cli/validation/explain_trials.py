"""Trials of `explain`: recordings, answers, and marks where several causes act; and trials of planning.

A trial of planning explains, plans, flies the plan on the concealed truth, and explains again. Its first flights are
recorded in cruise alone, as many an airline records them, and show an effect that has alternatives; trials are drawn
until there is one. Beside the planned flight others of the same candidates are flown: one at random, an airliner
flight, a power sweep, and the best in hindsight, which sets the truth farthest from its nearest alternative. All have
the same number of records.

Marks of trials with several causes count which causes were named, what else was named, and what stays unexplained. An
alternative r of the true cause t is an alias where, given all other true causes, χ² of the flights without noise
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

import tempfile
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from itertools import permutations
from pathlib import Path
from time import process_time
from typing import Any

import numpy as np

from enginediag_cli.drivers import CONSTANT
from enginediag_cli.engine.engine import Engine
from enginediag_cli.engine.term import Effect
from enginediag_cli.isolation.planned_flights import AIRLINER, RECORDS, SWEEP, WEATHER, Corner, PlannedFlight
from enginediag_cli.mismatch.explain.answer import (
    FORMULA,
    HIDDEN_STATE,
    IDENTIFIED,
    NOT_CONVERGED,
    Coefficient,
    Explanation,
)
from enginediag_cli.mismatch.explain.foreseen import PredictedReadings
from enginediag_cli.mismatch.explain.judging import ALIAS as JUDGING_ALIAS
from enginediag_cli.mismatch.explain.plan import (
    PlannedEvidence,
    expected_separation,
    fitted_alternatives,
    predictions_by_flight,
)
from enginediag_cli.mismatch.fit.freeform import list_locations
from enginediag_cli.mismatch.fit.identified import (
    NULL_HYPOTHESIS,
    Hypothesis,
    IdentifiedHypothesis,
    Nuisance,
    identify_with,
    input_values,
    nuisance,
    stack_column,
)
from enginediag_cli.mismatch.fit.options import EFFECT, Option, effect_option, fault_options, option_scores
from enginediag_cli.mismatch.fit.projection import Projection
from enginediag_cli.parallel import QuestionProcess
from enginediag_cli.physics.engine_file import load_engine
from enginediag_cli.physics.law import formula_variables
from enginediag_cli.physics.registry import candidate_effects
from enginediag_cli.validation import kinds
from enginediag_cli.validation.concealed_effects import (
    SHOWS,
    ConcealedTruth,
    TrialFlights,
    draw_engine_file,
    draw_truth,
    random_stream,
    record_trial,
    true_flight_readings,
    write_recording,
    write_trial_files,
)
from enginediag_cli.validation.concealed_formulas import (
    ConcealedFormula,
    evaluate_formula,
    evaluate_variables,
    formula_term,
)
from enginediag_cli.validation.formula_marks import (
    AnsweredFormula,
    build_formulas,
    describe_formula,
    mark_formula_trial,
    same_driver,
)
from enginediag_cli.validation.marks import ExplainAnswer, Marks, mark_trial, trial_dataset, trial_record
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
    separability,
)
from enginediag_cli.validation.trial_flights import (
    VISIBLE,
    Cause,
    CauseNames,
    cause_names,
    causes_from_options,
    causes_hypothesis,
    hour_columns,
)
from enginediag_cli.validation.trials import EXPLAIN, LOCATE, PLAN, TrialPlan, diagnoser, short


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


RECORDED = (0.3, 0.75)
"""Share of a flight, from and to, that is recorded before the plan: its cruise."""
MOST_DRAWS = 80
"""Draws of a trial: one in eight is ambiguous with exact maps, one in thirty with wrong ones."""
FURTHER_DRAWS = 1_000_000
"""Draw k of trial t is draw t + k FURTHER_DRAWS of the seed: no trial of its own."""


def draw_ambiguous(path: str, seed: int, trial: int, truth: str) -> ConcealedTruth:
    """A visible single effect with at least one alternative that is expected in the answer from the first flights; the
    last draw where none of MOST_DRAWS is one."""
    for k in range(MOST_DRAWS):
        engine = load_engine(path)
        drawn = draw_truth(engine, seed, trial + k * FURTHER_DRAWS, (truth,), (kinds.SINGLE,))
        concealed = replace(
            drawn,
            trial=trial,
            kind=kinds.PLANNED,
            flights=[
                {c: v[int(RECORDED[0] * len(v)) : int(RECORDED[1] * len(v))] for c, v in f.items()}
                for f in drawn.flights[: drawn.training]
            ],
        )
        if _is_ambiguous(engine, concealed):
            break
    return concealed


def _is_ambiguous(engine: Engine, concealed: ConcealedTruth) -> bool:
    clean = trial_dataset(engine, concealed, record_trial(engine, concealed), clean=True)
    separation = separability(
        clean, concealed.causes, dict(concealed.health), concealed.withheld_terms, concealed.values
    )
    return bool(separation.ok and separation.total >= VISIBLE and separation.nearest < JUDGING_ALIAS)


def best_in_hindsight(
    engine: Engine,
    concealed: ConcealedTruth,
    recorded: TrialFlights,
    reported: ExplainAnswer,
    flights: Sequence[PlannedFlight],
) -> int:
    """Which of the flights sets what the truth reads, without noise, farthest from every reported alternative, each
    fitted to the first flights without noise; the first where no alternative can be fitted."""
    evidence = trial_dataset(engine, concealed, recorded, clean=True)
    course = PlannedEvidence(evidence, flights)
    rivals = [
        _explanation(engine, [Cause.from_json(c) for c in x["causes"]], evidence.records, x["coefficients"])
        for x, name in zip(reported.raw["explanations"], reported.aliases, strict=True)
        if name != cause_names(concealed.causes)
    ]
    base = identify_with(evidence, NULL_HYPOTHESIS, nuisance(evidence))
    fitted = fitted_alternatives(course, base, rivals)
    if not fitted:
        return 0
    flown = [
        {c: stack_column(course.evidence, c)[rows] for c in ("time_s", *engine.inputs, *hour_columns())}
        for _, rows in course.planned
    ]
    true = true_flight_readings(engine, replace(concealed, flights=flown), exact_model=True)
    problem = fitted[0].found.problem
    true = true[:, [list(engine.sensors).index(c) for c in problem.sensors]] / problem.sigma
    chances = []
    for rows, foreseen, whitening in predictions_by_flight(fitted, course):
        at = slice(rows.start - course.recorded, rows.stop - course.recorded)
        ok = np.isfinite(true[at]).all(axis=1)
        exact = PredictedReadings(np.where(ok[:, None], true[at], 0.0), np.zeros((*true[at].shape, 0)), ok)
        found = expected_separation(np.ones(1 + len(fitted)), [exact, *foreseen], whitening)
        chances.append(-1.0 if found is None else float(found.chance_each(RECORDS)[0]))
    return int(np.argmax(chances))


def _explanation(
    engine: Engine, causes: Sequence[Cause], records: int, coefficients: Mapping[str, Sequence[float]]
) -> Explanation:
    """What an explainer said, as something to fit."""
    values = {n: float(c[0]) for n, c in coefficients.items()}
    found: Hypothesis = causes_hypothesis(engine, causes, records, values)
    option = Option(EFFECT, found.label, "", CONSTANT, found)
    reported = tuple(Coefficient(n, "", v, 0.0, v, v) for n, v in values.items())
    return Explanation((option,), reported, 0.0, 0.0, 1.0, 0.0, 0.0)


PLANNED, RANDOM, ANOTHER, SWEPT, HINDSIGHT = "planned", "random", "airliner", "sweep", "hindsight"
ARMS = (PLANNED, RANDOM, ANOTHER, SWEPT, HINDSIGHT)
"""What is flown next."""
PLAN_STREAM = 5
"""Of random numbers, beside those of `sealed`: which flights are flown for comparison."""
RESOLVED = 0.95
"""Probability from which a truth that comes first counts as resolved from its alternatives."""


QuestionMaker = Callable[[ConcealedTruth, Path, Sequence[Path]], dict[str, Any]]
"""Makes the question of a trial from the engine file and the recordings."""


def run_planned(
    path: str, seed: int, trial: int, truth: str, explainer: QuestionProcess, asking: QuestionMaker
) -> dict[str, Any]:
    """Draw, ask for an answer and a plan, fly every arm, ask again, and mark the answers."""
    begun = process_time()
    concealed = draw_ambiguous(path, seed, trial, truth)
    engine = load_engine(path)
    recorded = record_trial(engine, concealed)
    t, arms = cause_names(concealed.causes), dict[str, Any]()
    with tempfile.TemporaryDirectory(prefix="enginediag_") as folder:
        model, files = write_trial_files(Path(folder), engine, recorded, concealed.training)
        first = explainer.ask(asking(concealed, model, files) | {"task": PLAN})
        reported, seconds = ExplainAnswer.from_json(first), float(first.get("seconds", 0.0))
        flights = [flight_from_json(f) for f in first.get("flights", ())]
        ambiguous = (
            reported.status == IDENTIFIED and len(reported.aliases) > 1 and t in reported.aliases and bool(flights)
        )
        if ambiguous:
            best = best_in_hindsight(load_engine(path), concealed, recorded, reported, flights)
            chosen = choose_flights(flights, random_stream(seed, trial, PLAN_STREAM), best)
            answers: dict[int, tuple[ExplainAnswer, int]] = {}
            for arm, k in chosen.items():
                if k not in answers:
                    file = Path(folder) / f"next_{k}.csv"
                    flown = _fly(engine, concealed, flights[k], file)
                    answer = explainer.ask(asking(concealed, model, [*files, file]))
                    seconds += float(answer.get("seconds", 0.0))
                    answers[k] = ExplainAnswer.from_json(answer), flown
                after, flown = answers[k]
                arms[arm] = _answer_columns(after) | {
                    "flight": flights[k].words,
                    "records": flown,
                    "resolved": is_resolved(after, t),
                    "misled": after.status == IDENTIFIED and t not in after.aliases,
                }
    marks = {"ambiguous": ambiguous} | {f"resolved_{arm}": a["resolved"] for arm, a in arms.items()}
    if arms:
        plan, random, hindsight = (float(arms[a]["resolved"]) for a in (PLANNED, RANDOM, HINDSIGHT))
        marks |= {
            "misled": arms[PLANNED]["misled"],
            "foreseen": [float(first["chance"])],
            "less_twice_random": [plan - 2.0 * random],
            "less_hindsight": [plan - hindsight],
        }
    return {
        "trial": trial,
        "truth": truth,
        "kind": kinds.PLANNED,
        "causes": [c.to_json() for c in concealed.causes],
        "values": {n: short(v) for n, v in concealed.values.items()},
        "records": int(concealed.records.sum()),
        "failed_records": recorded.failed,
        "scorer_converged": True,
        "error": first.get("error", ""),
        **_answer_columns(reported),
        "chance": first.get("chance"),
        "arms": arms,
        "marks": marks,
        "seconds": round(process_time() - begun, 3),
        "explainer_seconds": round(seconds, 3),
    }


def choose_flights(flights: Sequence[PlannedFlight], rng: np.random.Generator, hindsight: int) -> dict[str, int]:
    """Which of the flights, the planned one first, each arm flies."""
    kinds_of = [f.kind for f in flights]
    sweeps = [k for k, kind in enumerate(kinds_of) if kind == SWEEP]
    order = sorted(range(len(flights)), key=lambda k: flights[k].words)  # not by what is known of them
    usual = [k for k in order if kinds_of[k] in (AIRLINER, WEATHER)]
    return {
        PLANNED: 0,
        RANDOM: order[int(rng.integers(len(order)))],
        ANOTHER: usual[int(rng.integers(len(usual)))],
        SWEPT: sorted(sweeps, key=lambda k: flights[k].words)[int(rng.integers(len(sweeps)))],
        HINDSIGHT: hindsight,
    }


def is_resolved(answer: ExplainAnswer, truth: CauseNames) -> bool:
    """Whether the truth stands alone, or comes first and is as good as certain."""
    if answer.status != IDENTIFIED or answer.aliases[0] != truth:
        return False
    return len(answer.aliases) == 1 or answer.probabilities[0] >= RESOLVED


def flight_from_json(reported: Mapping[str, Any]) -> PlannedFlight:
    """A planned flight from JSON."""
    return PlannedFlight(**{**reported, "corners": [Corner(**c) for c in reported["corners"]]})


def planned_columns(engine: Engine, concealed: ConcealedTruth, flight: PlannedFlight) -> dict[str, np.ndarray]:
    """Time, inputs and hours of the flight, which is flown when the recorded ones are over."""
    time, last = flight.time(RECORDS), concealed.flights[-1]
    hours = {c: last[c][-1] + time / 3600.0 for c in hour_columns()}
    return {"time_s": time, **flight.inputs(engine, RECORDS), **hours}


def _fly(engine: Engine, concealed: ConcealedTruth, flight: PlannedFlight, path: Path) -> int:
    """Write what the concealed truth reads; how many records it has."""
    flown = replace(
        concealed, flights=[planned_columns(engine, concealed, flight)], training=1, noise_seed=concealed.noise_seed + 1
    )
    (read,) = record_trial(engine, flown).noisy
    write_recording(path, read.columns)
    return len(read)


def _answer_columns(answer: ExplainAnswer) -> dict[str, Any]:
    return {
        "status": answer.status,
        "named": [" + ".join(sorted(a)) for a in answer.aliases],
        "probabilities": [short(p) for p in answer.probabilities],
    }


MARKERS = {kinds.LAW: mark_formula_trial, kinds.SEVERAL: mark_several_trial}
"""Marking of trials that are not marked by names alone."""


def run_trial(plan: TrialPlan, trial: int, explainer: QuestionProcess) -> dict[str, Any]:
    """Draw, record, ask, and mark the answer."""
    begun = process_time()
    path_of_model = draw_engine_file(plan.engines, plan.seed, trial)
    engine = load_engine(path_of_model)
    concealed = draw_truth(engine, plan.seed, trial, plan.truths, plan.kinds)
    if concealed.kind == kinds.PLANNED:
        asking = partial(_question, plan)
        return run_planned(path_of_model, plan.seed, trial, concealed.truth, explainer, asking)
    recorded = record_trial(engine, concealed)
    with tempfile.TemporaryDirectory(prefix="enginediag_") as folder:
        path, files = write_trial_files(Path(folder), engine, recorded, concealed.training)
        question = _question(plan, concealed, path, files)
        reported = [explainer.ask(question)]

        def located() -> Mapping[str, Any]:
            reported.append(explainer.ask(question | {"task": LOCATE}))
            return reported[-1]

        # what a trial finds must not depend on what was done before it
        fresh, answer = load_engine(path_of_model), ExplainAnswer.from_json(reported[0])
        if kinds.special_choice(concealed.kind) in MARKERS:
            scored = MARKERS[kinds.special_choice(concealed.kind)](fresh, concealed, recorded, answer)
        else:
            scored = mark_trial(fresh, concealed, recorded, answer, located)
        stands = not kinds.special_choice(concealed.kind)
        if stands and kinds.base_kind(concealed.kind) == kinds.NULL and concealed.truth == kinds.MAP_ERROR:
            reported.append(explainer.ask(question | {"model_error": 0.0}))
            if "error" not in reported[-1]:
                scored["marks"]["false_name_without_floor"] = reported[-1]["status"] in (
                    IDENTIFIED,
                    FORMULA,
                    HIDDEN_STATE,
                )
    if concealed.realistic is not None:
        scored |= {"engine": engine.name, "shape": concealed.realistic.shape, "airline": concealed.realistic.airline}
    if kinds.special_choice(concealed.kind):
        scored |= {"engine": engine.name}
    explaining = sum(t.get("seconds", 0.0) for t in reported)
    return scored | {"seconds": round(process_time() - begun, 3), "explainer_seconds": round(explaining, 3)}


def _question(plan: TrialPlan, concealed: ConcealedTruth, engine: Path, files: Sequence[Path]) -> dict[str, Any]:
    """The question: everything that the diagnosing process knows."""
    reported = concealed.realistic is None  # of realistic truths nothing is known but what the engine file says
    unknown = kinds.noise_variant(concealed.kind) == kinds.UNKNOWN_NOISE
    return {
        "task": EXPLAIN,
        "engine": str(engine),
        "recordings": [str(f) for f in files],
        "model_error": kinds.MODEL_ERROR[concealed.truth],
        "without": list(concealed.withheld_terms),
        "noise": ("estimate" if unknown else "specified") if reported else None,
        "rho": concealed.noise.rho if reported else 0.0,
        "input_noise": dict(concealed.noise.inputs or {}),
        "input_noise_share": dict(concealed.noise.input_shares or {}),
        "false_alarm": plan.false_alarm,
        "drivers": list(hour_columns()),
        "seed": plan.seed,
    }


def run_group(plan: TrialPlan, trials: Sequence[int]) -> list[dict[str, Any]]:
    """Trials with the diagnosing process of this worker."""
    return [run_trial(plan, trial, diagnoser()) for trial in trials]
