"""Marks of what was answered about a concealed formula.

t is the truth, with location p, variables V and curve f over the records; the first answer has location p̂, groups of
variables Ĝ and curve f̂. Visible: λ ≥ 60, and λ_sep ≥ 25 from everything in the library.

    law_judged   visible
    law_given    a formula was answered                                     visible
    law_place    p̂ = p, λ_sep(p̂) < 11, or D < 11                            visible, a formula was answered
    law_driver   as many groups as variables, each v ∈ V correlated with
                 one of its own by more than 0.95 in these recordings       visible, a formula was answered
    law_driver_told  law_driver of one of the groups that together hold
                 the truth, of which there are law_drivers_told             visible, a formula was answered
    law_driver_or_alike  law_driver, or D < 11                              visible, a formula was answered
    law_curve    D < 11                                                     visible, a formula was answered
    law_form     D < 11 with the formula's coefficients refitted, too       visible, a formula was answered
    law_error    rms(f̂ − f − mean(f̂ − f))/(max f − min f)                    visible, p̂ = p
    law_alone    the answer acts at one location                            visible, a formula was answered
    stated       stated probability of p̂ and of the locations equivalent
                 to it, together, and whether law_place                     visible, a formula was answered
    stated_driver  stated probability of the first groups, and whether
                 law_driver                                                 visible, a formula was answered
    law_gain_…   gain on unseen flights; law_worse: worse than no formula   visible, a formula was answered
    law_false    a formula was answered                                     nothing concealed
    higher_at_ceiling  share of the records four kilometres higher that the
                 envelope keeps lower than that

    D = χ² of the recordings without noise with the answered formula in place of the true one, everything identified
        refitted: the non-centrality at which a test could separate the two

`…_of_all`: the same over all visible trials, wrong where no formula was answered.

The gain on unseen flights compares excesses E. Everything identified is fitted to the recordings that were searched;
with y the unseen flights' true readings, without noise,

    E = Σ ((ŷ − y)/σ)²        gain = (E_none − E)/(E_none − E_true)

The size of the true formula is fitted to the same recordings; an answered formula is used as it is. A model without a
prediction has no gain.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import permutations
from typing import Any

import numpy as np

from enginediag_cli.config.document import appended, dump
from enginediag_cli.drivers import SAME
from enginediag_cli.engine.engine import Engine
from enginediag_cli.engine.load import EngineDescription
from enginediag_cli.engine.term import Effect
from enginediag_cli.errors import EngineDiagError
from enginediag_cli.mismatch.explain.answer import (
    FORMULA,
    HIDDEN_STATE,
    IDENTIFIED,
    NO_DISCREPANCY,
    NOT_CONVERGED,
    Answer,
    Explanation,
)
from enginediag_cli.mismatch.fit.evidence import Dataset, Flight
from enginediag_cli.mismatch.fit.freeform import Location, list_locations
from enginediag_cli.mismatch.fit.identified import (
    NULL_HYPOTHESIS,
    Hypothesis,
    IdentifiedHypothesis,
    Nuisance,
    identify_with,
    input_values,
    nuisance,
)
from enginediag_cli.mismatch.fit.options import Option
from enginediag_cli.physics.engine_file import law_entry, load_engine
from enginediag_cli.physics.law import Law, formula_variables
from enginediag_cli.validation.concealed_effects import ConcealedTruth, TrialFlights, true_flight_readings
from enginediag_cli.validation.concealed_formulas import (
    ConcealedFormula,
    evaluate_formula,
    evaluate_variables,
    formula_term,
    spline_basis,
)
from enginediag_cli.validation.marks import ExplainAnswer, HeldOutFlights, Marks, short, trial_dataset, trial_record
from enginediag_cli.validation.separability import (
    ALIAS,
    Separability,
    best_fit,
    centre_priors,
    equivalent_places,
    find_place,
    free_curve,
    place_separability,
    residual_chi2,
    separability,
)
from enginediag_cli.validation.trial_flights import VISIBLE

Entry = Mapping[str, Any]


def formula_entries(x: Explanation) -> list[Entry]:
    """The laws among an explanation's options, as entries of an engine file, with the coefficients that were fitted."""
    known = {c.name: c.value for c in x.coefficients}
    return [law_entry(e.replace_values(known)) for e in _formulas(x.options)]


def formula_json(a: Answer) -> dict[str, Any]:
    """What an answer says of a law: places and drivers with their probabilities, laws, the share of the excess that the
    first explains; and the share that stays unexplained by all that is named, where the answer has it."""
    found: dict[str, Any] = {"unexplained": getattr(a, "unexplained", None)}
    if a.law is None:
        return found
    known = {c.name: c.value for x in reversed(a.explanations) for c in x.coefficients}
    laws = [(law, e) for law in a.law.laws for e in _formulas((law.option,))]
    return found | {
        "law": {
            "places": [
                {"location": place.name, "component": place.component, "probability": float(p)}
                for place, p in a.law.places
            ],
            "drivers": [
                {"variables": [[v.name for v in group] for group in groups], "probability": float(p)}
                for groups, p in a.law.drivers
            ],
            "laws": [
                {
                    "entry": law_entry(e.replace_values(known)),
                    "probability": float(law.probability),
                    "label": law.option.label,
                }
                for law, e in laws
            ],
            "along": [[[v.name for v in group] for group in groups] for groups in a.law.along],
            "explained": a.law.explained,
            "together": float(a.law.together),
            "alike": [a.law.places[0][0].name, *(p.name for p in a.law.alike)],
        }
    }


def _formulas(options: Sequence[Option]) -> list[Effect]:
    return [e for o in options for e in o.hypothesis.effects if isinstance(e.term, Law)]


@dataclass(frozen=True)
class AnsweredFormula:
    """A law as it was said: names of places (as `locations_of` has them) and groups of variables, likeliest first, with
    their probabilities, `along`: those of them that hold the truth together; `entries` of the laws that are said to
    act, several where one was not enough; `explained`: share of the excess; `together`: probability of the first place
    and of those that are said to be `alike`, which the first is one of."""

    places: tuple[tuple[str, float], ...]
    drivers: tuple[tuple[tuple[tuple[str, ...], ...], float], ...]
    driver_groups: tuple[tuple[tuple[str, ...], ...], ...]
    equivalent_places: tuple[str, ...]
    entries: tuple[Entry, ...]
    explained: float
    place_probability: float

    @staticmethod
    def from_json(raw: Mapping[str, Any]) -> AnsweredFormula | None:
        """Of an answer; None where it has none."""
        law = raw.get("law")
        if not law or not law["laws"]:
            return None
        first: Mapping[str, Any] = next(iter(raw.get("explanations", ())), {})
        return AnsweredFormula(
            tuple((p["location"], float(p["probability"])) for p in law["places"]),
            tuple((tuple(tuple(g) for g in d["variables"]), float(d["probability"])) for d in law["drivers"]),
            tuple(tuple(tuple(g) for g in groups) for groups in law["along"]),
            tuple(law["alike"]),
            tuple(first.get("laws", ()) or [law["laws"][0]["entry"]]),
            float(law["explained"]),
            float(law["together"]),
        )


def build_formulas(engine: Engine, entries: Sequence[Entry]) -> tuple[Effect, ...] | None:
    """The laws of entries; None where one of them cannot be carried."""
    found = [build_formula(engine, entry) for entry in entries]
    known = tuple(e for e in found if e is not None)
    return known if len(known) == len(found) else None


def build_formula(engine: Engine, entry: Entry) -> Effect | None:
    """The law of an entry at this engine; None for one that the engine's file could not carry."""
    text = dump(entry, width=100).splitlines()
    lines = [("  - " if k == 0 else "    ") + line for k, line in enumerate(text)]
    try:
        describe_formula = EngineDescription.from_engine_file(engine.path, engine.declared)
        with_law = replace(describe_formula, text=appended(describe_formula.text, engine.path, "physics", [lines]))
        return load_engine(with_law).effects[-1]
    except EngineDiagError:
        return None


NONE, FOUND, TRUE, SPLINE = "none", "found", "true", "spline"
"""Models of unseen flights."""


@dataclass(frozen=True)
class ForecastExcess:
    """Excess of models on unseen flights of several kinds; `rows`: of each kind, its place among these flights."""

    held_out: HeldOutFlights
    rows: Mapping[str, slice]

    @staticmethod
    def from_flights(fitted: Dataset, flights: Mapping[str, Sequence[Flight]]) -> ForecastExcess:
        """`flights`: with their true readings, by kind."""
        ends = np.cumsum([0, *(sum(map(len, own)) for own in flights.values())])
        rows = {name: slice(a, b) for name, a, b in zip(flights, ends[:-1], ends[1:], strict=True)}
        return ForecastExcess(HeldOutFlights.from_flights(fitted, [f for own in flights.values() for f in own]), rows)

    def squares(self, sought: Hypothesis = NULL_HYPOTHESIS, engine: Engine | None = None) -> np.ndarray | None:
        """((ŷ − y)/σ)² of each unseen record (n,), summed over sensors, NaN without a prediction; None where the fit
        does not converge. `engine`: one that carries more than that of the recordings."""
        held_out = self.held_out
        both = held_out.extended if engine is None else replace(held_out.extended, engine=engine)
        plain = sought is NULL_HYPOTHESIS and engine is None
        fit = held_out.base if plain else best_fit(both, sought, held_out.nuisance, held_out.base, 0.0)
        return (
            np.asarray(np.sum(replace(held_out, extended=both).squared_errors(fit), axis=1)) if fit.converged else None
        )

    def excess(self, models: Mapping[str, np.ndarray | None]) -> dict[str, dict[str, float]]:
        """E of each model by kind of unseen flights. A model without a fit, or without a prediction of a record, has
        what no law has there; what cannot be predicted without a formula or with the true one is excluded."""
        none, true = models[NONE], models[TRUE]
        if none is None or true is None:
            return {}
        judged = np.isfinite(none) & np.isfinite(true)
        found: dict[str, dict[str, float]] = {}
        for name, rows in self.rows.items():
            keep = np.zeros(len(none), bool)
            keep[rows] = judged[rows]
            if keep.any():
                found[name] = {
                    model: float(np.sum(np.where(np.isfinite(e), e, none)[keep]) if e is not None else none[keep].sum())
                    for model, e in models.items()
                }
        return found


def gain(excess: Mapping[str, float], model: str) -> float | None:
    """Relative to the true law; None where that has too little to gain."""
    most = excess[NONE] - excess[TRUE]
    return (excess[NONE] - excess[model]) / most if most >= VISIBLE else None


def is_worse(excess: Mapping[str, float], model: str) -> bool:
    """Whether the model predicts worse than no law at all; where no law has nothing to gain, worse by as much as would
    be seen."""
    allowed = 0.0 if gain(excess, model) is not None else VISIBLE
    return excess[model] > excess[NONE] + allowed


JUDGED = 60.0
"""λ from which a formula is required."""


def null_marks(answer: ExplainAnswer) -> Marks:
    """Where nothing is concealed."""
    if answer.status == NOT_CONVERGED:
        return {"no_verdict": True}
    return {
        "no_verdict": False,
        "law_false": answer.status == FORMULA,
        "law_false_name": answer.status in (IDENTIFIED, HIDDEN_STATE),
        "law_false_finding": answer.status != NO_DISCREPANCY,
    }


def is_judged(separation: Separability) -> bool:
    """Whether the readings show the law, and that the library has nothing that says it."""
    return separation.ok and separation.total >= JUDGED and separation.nearest >= VISIBLE


def answer_marks(separation: Separability, answer: ExplainAnswer) -> Marks:
    """Whether a law was said at all, or what else."""
    if answer.status == NOT_CONVERGED:
        return {"no_verdict": True}
    found: Marks = {"no_verdict": False, "law_judged": is_judged(separation)}
    if not is_judged(separation):
        return found
    found |= {"law_given": answer.status == FORMULA, "law_found": answer.status != NO_DISCREPANCY}
    found["law_wrong_name"] = answer.status == IDENTIFIED and not any(a in separation.aliases for a in answer.aliases)
    return found


def same_driver(true: Sequence[str], named: Sequence[Sequence[str]], values: Mapping[str, np.ndarray]) -> bool:
    """Whether each true variable is in a reported group of its own. `values`: of all variables over the records
    (N,)."""
    if len(true) != len(named):
        return False
    return any(
        all(any(_same_variable(values, v, n) for n in group) for v, group in zip(true, order, strict=True))
        for order in permutations(named)
    )


def _same_variable(values: Mapping[str, np.ndarray], a: str, b: str) -> bool:
    if a == b:
        return True
    if a not in values or b not in values:
        return False
    x, y = values[a], values[b]
    good = np.isfinite(x) & np.isfinite(y)
    if good.sum() < 2 or not np.std(x[good]) or not np.std(y[good]):
        return False
    return abs(float(np.corrcoef(x[good], y[good])[0, 1])) > SAME


def curve_error(found: np.ndarray, true: np.ndarray) -> float:
    """Of a law's curve over the records, a constant taken away, over the true one's range."""
    off = found - true
    good = np.isfinite(off)
    return float(np.std(off[good]) / max(float(np.ptp(true[good])), 1e-300)) if good.any() else float("nan")


def gain_marks(excess: Mapping[str, Mapping[str, float]]) -> dict[str, Any]:
    """Gains of the law and of the spline on each kind of unseen flights, and whether they are worse than no law."""
    marks: dict[str, Any] = {}
    for model, words in ((FOUND, "law"), (SPLINE, "spline")):
        own = {name: e for name, e in excess.items() if model in e}
        for name, e in own.items():
            g = gain(e, model)
            if g is not None:
                marks[f"{words}_gain_{name}"] = [g]
        if own:
            marks[f"{words}_worse"] = [float(is_worse(e, model)) for e in own.values()]
    return marks


UNSEEN, HIGHER = "unseen", "higher"
"""Kinds of flights that nobody is shown: like the others, and four kilometres above them."""


def mark_formula_trial(
    engine: Engine, concealed: ConcealedTruth, recorded: TrialFlights, answer: ExplainAnswer
) -> dict[str, Any]:
    """The trial's record: truth, answer, separability, marks."""
    if concealed.formula is None:
        return trial_record(concealed, recorded, None, np.nan, answer, null_marks(answer), ())
    clean = centre_priors(trial_dataset(engine, concealed, recorded, clean=True), concealed.health)
    separation = separability(clean, concealed.causes, dict(concealed.health), ())
    found = answer_marks(separation, answer)
    reported = AnsweredFormula.from_json(answer.raw) if answer.status == FORMULA else None
    kept: dict[str, Any] = {"law": describe_formula(concealed.formula)}
    if concealed.formula.higher:
        found["higher_at_ceiling"] = [concealed.formula.ceiling_share]
    if is_judged(separation) and not found["no_verdict"]:
        marked: Marks = dict.fromkeys(("law_place", "law_driver", "law_curve"), False)
        if reported is not None:
            opened = FormulaScorer.from_trial(engine, concealed, clean)
            marked, further = opened.marks(reported, trial_dataset(engine, concealed, recorded, clean=False))
            kept["law"] |= further
        found |= {f"{name}_of_all": marked[name] for name in ("law_place", "law_driver", "law_curve")}
        found |= marked if reported is not None else {}
    return trial_record(concealed, recorded, separation, np.nan, answer, found, ()) | kept


def describe_formula(law: ConcealedFormula) -> dict[str, Any]:
    """What the record keeps of a concealed law."""
    return {
        "entry": law_entry(law.effect),
        "place": law.place.name,
        "variables": list(law.law.variables),
        "form": law.form,
        "outside": law.outside_grammar,
        "at_ceiling": short(law.ceiling_share),
    }


@dataclass(frozen=True)
class FormulaScorer:
    """A concealed law, and what is known of it without noise: `values` of all variables over the records (N,), `f` its
    curve, `base` the fit without it."""

    engine: Engine
    concealed: ConcealedTruth
    truth: ConcealedFormula
    base: IdentifiedHypothesis
    nuisance: Nuisance
    places: tuple[Location, ...]
    values: Mapping[str, np.ndarray]
    f: np.ndarray

    @staticmethod
    def from_trial(engine: Engine, concealed: ConcealedTruth, clean: Dataset) -> FormulaScorer:
        """`clean`: the flights without noise, priors at the true state."""
        assert concealed.formula is not None
        beside = nuisance(clean)
        base = identify_with(clean, NULL_HYPOTHESIS, beside)
        truth = engine.replace_effects((*engine.effects, *concealed.effects))
        theta = {**concealed.health, **concealed.values}
        values = evaluate_variables(
            truth, input_values(clean), theta, tuple(formula_variables(engine.network).values())
        )
        places = tuple(list_locations(engine, list(clean.noise.sigma)))
        return FormulaScorer(
            engine,
            concealed,
            concealed.formula,
            base,
            beside,
            places,
            values,
            evaluate_formula(concealed.formula.effect, values),
        )

    def marks(self, reported: AnsweredFormula, searched: Dataset) -> tuple[Marks, dict[str, Any]]:
        """Marks of the reported formula, and what the record keeps of it. `searched`: the recordings as they were
        given."""
        laws = build_formulas(self.engine, reported.entries)
        apart, at_best = self.distance(laws), self.distance(laws, sought=True)
        separation = place_separability(self.base, self.nuisance, self.f, self.truth.place)
        first = reported.places[0][0]
        alike = equivalent_places(separation) | ({first} if apart < ALIAS else frozenset())
        exact = first == self.truth.place.name
        named = find_place(self.places, first)
        marks: Marks = {
            "law_place": exact or first in alike,
            "law_place_exact": exact,
            "law_component": named is not None and named.component == self.truth.place.component,
            "law_driver": same_driver(list(self.truth.law.variables), reported.drivers[0][0], self.values),
            "law_curve": apart < ALIAS,
            "law_form": at_best < ALIAS,
        }
        marks["law_alone"] = len({entry["at"] for entry in reported.entries}) == 1
        marks["stated"] = [reported.place_probability, marks["law_place"]]
        marks["law_driver_or_alike"] = marks["law_driver"] or apart < ALIAS
        marks["law_driver_told"] = any(
            same_driver(list(self.truth.law.variables), groups, self.values) for groups in reported.driver_groups
        )
        marks["law_drivers_told"] = [len(reported.driver_groups)]
        marks["stated_driver"] = [reported.drivers[0][1], marks["law_driver"]]
        here = [e for e in laws or () if formula_term(e).acts.leaf == self.truth.law.acts.leaf]
        if exact and here:
            told_curve = np.sum([evaluate_formula(e, self.values) for e in here], axis=0)
            marks["law_error"] = [curve_error(told_curve, self.f)]
        excess = self.excess(laws, named, reported, searched)
        kept = {
            "found": [dict(entry) for entry in reported.entries],
            "told_places": [[p, short(x)] for p, x in reported.places[:3]],
            "told_drivers": [[[g[0] for g in groups], short(x)] for groups, x in reported.drivers[:3]],
            "explained": short(reported.explained),
            "distance": short(apart),
            "distance_at_best": short(at_best),
            "alike": sorted(alike),
            "excess": {name: {m: short(x) for m, x in e.items()} for name, e in excess.items()},
        }
        return marks | gain_marks(excess), kept

    def distance(self, laws: Sequence[Effect] | None, sought: bool = False) -> float:
        """D of `marks`; infinite where the laws cannot be carried or fitted. `sought`: with their coefficients fitted
        anew, too."""
        if laws is None:
            return np.inf
        evidence, free = self.base.evidence, Hypothesis(tuple(laws))
        if not sought:
            engine = evidence.engine
            evidence, free = replace(evidence, engine=engine.replace_effects((*engine.effects, *laws))), NULL_HYPOTHESIS
        return residual_chi2(best_fit(evidence, free, self.nuisance, self.base, ALIAS))

    def excess(
        self, laws: Sequence[Effect] | None, place: Location | None, reported: AnsweredFormula, searched: Dataset
    ) -> dict[str, dict[str, float]]:
        """Excess on unseen flights without a formula, of the reported one, of the true one, and of a spline at the
        reported location and driver."""
        unseen = {
            name: self._true_flights(name, flights)
            for name, flights in (
                (UNSEEN, self.concealed.flights[self.concealed.training :]),
                (HIGHER, self.truth.higher),
            )
        }
        ahead = ForecastExcess.from_flights(searched, {name: f for name, f in unseen.items() if f})
        models = {NONE: ahead.squares(), TRUE: ahead.squares(Hypothesis((self.truth.effect,)))}
        models[FOUND] = models[NONE]
        if laws is not None:
            carrying = searched.engine.replace_effects((*searched.engine.effects, *laws))
            models[FOUND] = ahead.squares(engine=carrying)
        if place is not None:
            free = self._spline_hypothesis(ahead, place, reported.drivers[0][0], searched.records)
            if free is not None:
                models[SPLINE] = ahead.squares(free)
        return ahead.excess(models)

    def _spline_hypothesis(
        self, ahead: ForecastExcess, place: Location, groups: Sequence[Sequence[str]], fitted: int
    ) -> Hypothesis | None:
        """A spline of each reported variable, and the product of two, at a location; None where one is unknown."""
        known = formula_variables(self.engine.network)
        of = [known[g[0]] for g in groups if g and g[0] in known]
        if len(of) < len(groups) or not of:
            return None
        x = evaluate_variables(self.engine, input_values(ahead.held_out.extended), ahead.held_out.base.theta, of)
        curves = {f"{n} {k}": c for n, v in x.items() for k, c in enumerate(spline_basis(v, v[:fitted]).T)}
        if len(x) == 2:
            a, b = ((v - np.nanmean(v[:fitted])) / max(float(np.nanstd(v[:fitted])), 1e-12) for v in x.values())
            curves["product"] = a * b
        return free_curve(place, {n: np.where(np.isfinite(c), c, 0.0) for n, c in curves.items()}, ahead.held_out.base)

    def _true_flights(self, name: str, flights: Sequence[Mapping[str, np.ndarray]]) -> list[Flight]:
        """Flights with what the truth engine's sensors read without noise; records that it cannot compute are
        excluded."""
        if not flights:
            return []
        y = true_flight_readings(self.engine, replace(self.concealed, flights=tuple(flights)), exact_model=False)
        found, start = [], 0
        for k, flight in enumerate(flights):
            n = len(flight["time_s"])
            own = y[start : start + n]
            good = np.isfinite(own).all(axis=1)
            columns = {**flight, **dict(zip(self.engine.sensors, own.T, strict=True))}
            if good.any():
                found.append(Flight(f"{name}_{k + 1}", "", {c: np.asarray(v)[good] for c, v in columns.items()}))
            start += n
        return found
