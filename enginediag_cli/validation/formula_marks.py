"""Laws in an explainer's answer: written as JSON, and read back as effects that an engine can carry.

What a law is worth on flights that nobody has shown it, beside the true one and beside a spline.

Everything identified is fitted to the recordings that were searched; what is left of the unseen flights' true readings
y, without noise, is a model's excess, and its gain the share of what the true law takes away that it takes away too:

    E = Σ ((ŷ − y)/σ)²        gain = (E_none − E)/(E_none − E_true)

The true law has its size fitted to the same recordings; a law that was found stands as it was told. Where a model has
no prediction, it has gained nothing.

Marks of what was said of a concealed law.

With t the truth, of place p, variables V and curve f over the records of the recordings, and the first of what was
said, of place p̂, groups of variables Ĝ and curve f̂; visible: λ ≥ 60 and λ_sep ≥ 25 from all that the library has:

    law_judged   visible
    law_given    a law was said                                             visible
    law_place    p̂ = p, λ_sep(p̂) < 11, or D < 11                            visible, a law was said
    law_driver   as many groups as variables, each v ∈ V correlated with
                 one of its own by more than 0.95 in these recordings       visible, a law was said
    law_driver_told  law_driver of one of those that are said to hold the
                 truth together, of which there are law_drivers_told        visible, a law was said
    law_driver_or_alike  law_driver, or D < 11                              visible, a law was said
    law_curve    D < 11                                                     visible, a law was said
    law_form     D < 11 with the law's coefficients fitted anew, too        visible, a law was said
    law_error    rms(f̂ − f − mean(f̂ − f))/(max f − min f)                    visible, p̂ = p
    law_alone    what was said acts at one place                            visible, a law was said
    stated       probability that was said of p̂ and of the places said to
                 be alike, together, beside whether law_place               visible, a law was said
    stated_driver  probability that was said of the first groups, beside
                 whether law_driver                                         visible, a law was said
    law_gain_…   see `ahead`; law_worse: whether it is worse than none      visible, a law was said
    law_false    a law was said                                             nothing concealed
    higher_at_ceiling  share of the records four kilometres higher that the
                 envelope keeps lower than that

    D = χ² of the recordings without noise with the law as it was said in place of the true one, all that is
        identified fitted anew: the non-centrality at which a test could tell the two apart

`…_of_all`: the same of all visible trials, wrong where no law was said.

A trial of a law opened: what was said of it, held against it.
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
    stack_column,
)
from enginediag_cli.mismatch.fit.options import Option
from enginediag_cli.physics.engine_file import law_entry, load_engine
from enginediag_cli.physics.law import Law, formula_variables
from enginediag_cli.validation.causes import VISIBLE
from enginediag_cli.validation.concealed_effects import Recorded, Sealed, readings
from enginediag_cli.validation.concealed_formulas import LawTruth, along, curve, law_of, spline
from enginediag_cli.validation.marks import Marks, Said, evidence_of, short, trial_record
from enginediag_cli.validation.separability import (
    ALIAS,
    Separability,
    curved,
    inseparable,
    left_by,
    lowest,
    place_named,
    place_separability,
    separability,
)

Entry = Mapping[str, Any]


def entries(x: Explanation) -> list[Entry]:
    """The laws among an explanation's options, as entries of an engine file, with the coefficients that were fitted."""
    known = {c.name: c.value for c in x.coefficients}
    return [law_entry(e.replace_values(known)) for e in _laws(x.options)]


def law_told(a: Answer) -> dict[str, Any]:
    """What an answer says of a law: places and drivers with their probabilities, laws, the share of the excess that the
    first explains; and the share that stays unexplained by all that is named, where the answer has it."""
    found: dict[str, Any] = {"unexplained": getattr(a, "unexplained", None)}
    if a.law is None:
        return found
    known = {c.name: c.value for x in reversed(a.explanations) for c in x.coefficients}
    laws = [(law, e) for law in a.law.laws for e in _laws((law.option,))]
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


def _laws(options: Sequence[Option]) -> list[Effect]:
    return [e for o in options for e in o.hypothesis.effects if isinstance(e.term, Law)]


@dataclass(frozen=True)
class ToldLaw:
    """A law as it was said: names of places (as `locations_of` has them) and groups of variables, likeliest first, with
    their probabilities, `along`: those of them that hold the truth together; `entries` of the laws that are said to
    act, several where one was not enough; `explained`: share of the excess; `together`: probability of the first place
    and of those that are said to be `alike`, which the first is one of."""

    places: tuple[tuple[str, float], ...]
    drivers: tuple[tuple[tuple[tuple[str, ...], ...], float], ...]
    along: tuple[tuple[tuple[str, ...], ...], ...]
    alike: tuple[str, ...]
    entries: tuple[Entry, ...]
    explained: float
    together: float

    @staticmethod
    def of(raw: Mapping[str, Any]) -> ToldLaw | None:
        """Of an answer; None where it has none."""
        law = raw.get("law")
        if not law or not law["laws"]:
            return None
        first: Mapping[str, Any] = next(iter(raw.get("explanations", ())), {})
        return ToldLaw(
            tuple((p["location"], float(p["probability"])) for p in law["places"]),
            tuple((tuple(tuple(g) for g in d["variables"]), float(d["probability"])) for d in law["drivers"]),
            tuple(tuple(tuple(g) for g in groups) for groups in law["along"]),
            tuple(law["alike"]),
            tuple(first.get("laws", ()) or [law["laws"][0]["entry"]]),
            float(law["explained"]),
            float(law["together"]),
        )


def all_built(engine: Engine, entries: Sequence[Entry]) -> tuple[Effect, ...] | None:
    """The laws of entries; None where one of them cannot be carried."""
    found = [built(engine, entry) for entry in entries]
    known = tuple(e for e in found if e is not None)
    return known if len(known) == len(found) else None


def built(engine: Engine, entry: Entry) -> Effect | None:
    """The law of an entry at this engine; None for one that the engine's file could not carry."""
    text = dump(entry, width=100).splitlines()
    lines = [("  - " if k == 0 else "    ") + line for k, line in enumerate(text)]
    try:
        described = EngineDescription.from_engine_file(engine.path, engine.declared)
        with_law = replace(described, text=appended(described.text, engine.path, "physics", [lines]))
        return load_engine(with_law).effects[-1]
    except EngineDiagError:
        return None


NONE, FOUND, TRUE, SPLINE = "none", "found", "true", "spline"
"""Models of unseen flights."""


@dataclass(frozen=True)
class Ahead:
    """The recordings that were searched with unseen flights behind them, of which nobody has the readings; `base`: the
    fit without a law; `sets`: of each kind of unseen flights its place among the records."""

    both: Dataset
    along: Nuisance
    base: IdentifiedHypothesis
    sets: Mapping[str, slice]
    true: np.ndarray

    @staticmethod
    def of(searched: Dataset, unseen: Mapping[str, Sequence[Flight]]) -> Ahead:
        """`unseen`: flights with their true readings, by kind."""
        sensors = list(searched.noise.sigma)
        flights = [f for own in unseen.values() for f in own]
        blind = [
            replace(f, columns={c: np.full_like(v, np.nan) if c in sensors else v for c, v in f.columns.items()})
            for f in flights
        ]
        both = replace(searched, flights=(*searched.flights, *blind))
        sets, first = {}, searched.records
        for name, own in unseen.items():
            n = sum(map(len, own))
            sets[name] = slice(first, first + n)
            first += n
        along = nuisance(both)
        base = identify_with(both, NULL_HYPOTHESIS, along)
        true = np.concatenate([np.column_stack([f.columns[c] for c in base.problem.sensors]) for f in flights])
        return Ahead(both, along, base, sets, true)

    def squares(self, hypothesis: Hypothesis = NULL_HYPOTHESIS, engine: Engine | None = None) -> np.ndarray | None:
        """((ŷ − y)/σ)² of each unseen record (n,), summed over sensors, NaN without a prediction; None where the fit
        does not converge. `engine`: one that carries more than that of the evidence."""
        both = self.both if engine is None else replace(self.both, engine=engine)
        plain = hypothesis is NULL_HYPOTHESIS and engine is None
        fit = self.base if plain else lowest(both, hypothesis, self.along, self.base, 0.0)
        if not fit.converged:
            return None
        last = len(self.true)
        curves = {**self.along.curves, **fit.hypothesis.curves}
        inputs = {c: stack_column(both, c) for c in fit.model.inputs}
        inputs |= {c: stack_column(both, c, d) for c, d in fit.model.optional_inputs.items() if c not in curves}
        now = {c: v[-last:] for c, v in {**inputs, **curves}.items()}
        p = fit.model.predict(now, fit.theta, sensors=fit.problem.sensors)
        squares = np.sum(((p.y - self.true) / fit.problem.sigma) ** 2, axis=1)
        return np.asarray(np.where(p.ok, squares, np.nan))

    def excess(self, models: Mapping[str, np.ndarray | None]) -> dict[str, dict[str, float]]:
        """E of each model by kind of unseen flights. A model without a fit, or without a prediction of a record, has
        what no law has there; what no law or the true one cannot predict is left out."""
        none, true = models[NONE], models[TRUE]
        if none is None or true is None:
            return {}
        judged = np.isfinite(none) & np.isfinite(true)
        first = self.both.records - len(self.true)
        found: dict[str, dict[str, float]] = {}
        for name, rows in self.sets.items():
            own = np.zeros(len(none), bool)
            own[rows.start - first : rows.stop - first] = True
            keep = own & judged
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


def worse(excess: Mapping[str, float], model: str) -> bool:
    """Whether the model predicts worse than no law at all; where no law has nothing to gain, worse by as much as would
    be seen."""
    allowed = 0.0 if gain(excess, model) is not None else VISIBLE
    return excess[model] > excess[NONE] + allowed


JUDGED = 60.0
"""λ from which a law is asked for."""


def null_marks(said: Said) -> Marks:
    """Where nothing is concealed."""
    if said.status == NOT_CONVERGED:
        return {"no_verdict": True}
    return {
        "no_verdict": False,
        "law_false": said.status == FORMULA,
        "law_false_name": said.status in (IDENTIFIED, HIDDEN_STATE),
        "law_false_finding": said.status != NO_DISCREPANCY,
    }


def judged(far: Separability) -> bool:
    """Whether the readings show the law, and that the library has nothing that says it."""
    return far.ok and far.total >= JUDGED and far.nearest >= VISIBLE


def given_marks(far: Separability, said: Said) -> Marks:
    """Whether a law was said at all, or what else."""
    if said.status == NOT_CONVERGED:
        return {"no_verdict": True}
    found: Marks = {"no_verdict": False, "law_judged": judged(far)}
    if not judged(far):
        return found
    found |= {"law_given": said.status == FORMULA, "law_found": said.status != NO_DISCREPANCY}
    found["law_wrong_name"] = said.status == IDENTIFIED and not any(a in far.aliases for a in said.aliases)
    return found


def same_driver(true: Sequence[str], named: Sequence[Sequence[str]], values: Mapping[str, np.ndarray]) -> bool:
    """Whether each true variable is told by a group of its own. `values`: of all variables over the records (N,)."""
    if len(true) != len(named):
        return False
    return any(
        all(any(_alike(values, v, n) for n in group) for v, group in zip(true, order, strict=True))
        for order in permutations(named)
    )


def _alike(values: Mapping[str, np.ndarray], a: str, b: str) -> bool:
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


def ahead_marks(excess: Mapping[str, Mapping[str, float]]) -> dict[str, Any]:
    """Gains of the law and of the spline on each kind of unseen flights, and whether they are worse than no law."""
    marks: dict[str, Any] = {}
    for model, words in ((FOUND, "law"), (SPLINE, "spline")):
        own = {name: e for name, e in excess.items() if model in e}
        for name, e in own.items():
            g = gain(e, model)
            if g is not None:
                marks[f"{words}_gain_{name}"] = [g]
        if own:
            marks[f"{words}_worse"] = [float(worse(e, model)) for e in own.values()]
    return marks


UNSEEN, HIGHER = "unseen", "higher"
"""Kinds of flights that nobody is shown: like the others, and four kilometres above them."""


def opened_law(engine: Engine, sealed: Sealed, recorded: Recorded, said: Said) -> dict[str, Any]:
    """The trial's record: truth, answer, separability, marks."""
    if sealed.law is None:
        return trial_record(sealed, recorded, None, np.nan, said, null_marks(said), ())
    clean = centred(evidence_of(engine, sealed, recorded, clean=True), sealed.health)
    far = separability(clean, sealed.causes, dict(sealed.health), ())
    found = given_marks(far, said)
    told = ToldLaw.of(said.raw) if said.status == FORMULA else None
    kept: dict[str, Any] = {"law": described(sealed.law)}
    if sealed.law.higher:
        found["higher_at_ceiling"] = [sealed.law.at_ceiling]
    if judged(far) and not found["no_verdict"]:
        marked: Marks = dict.fromkeys(("law_place", "law_driver", "law_curve"), False)
        if told is not None:
            opened = Opened.of(engine, sealed, clean)
            marked, further = opened.marks(told, evidence_of(engine, sealed, recorded, clean=False))
            kept["law"] |= further
        found |= {f"{name}_of_all": marked[name] for name in ("law_place", "law_driver", "law_curve")}
        found |= marked if told is not None else {}
    return trial_record(sealed, recorded, far, np.nan, said, found, ()) | kept


def centred(evidence: Dataset, health: Mapping[str, float]) -> Dataset:
    """With priors at the true state, so that what a true model leaves is nothing."""
    known = {n: health[n] for n in evidence.settings.nuisance if n in health}
    return replace(evidence, settings=replace(evidence.settings, prior_mean=known))


def described(law: LawTruth) -> dict[str, Any]:
    """What the record keeps of a concealed law."""
    return {
        "entry": law_entry(law.effect),
        "place": law.place.name,
        "variables": list(law.law.variables),
        "form": law.form,
        "outside": law.outside,
        "at_ceiling": short(law.at_ceiling),
    }


@dataclass(frozen=True)
class Opened:
    """A concealed law, and what is known of it without noise: `values` of all variables over the records (N,), `f` its
    curve, `base` the fit without it."""

    engine: Engine
    sealed: Sealed
    truth: LawTruth
    base: IdentifiedHypothesis
    nuisance: Nuisance
    places: tuple[Location, ...]
    values: Mapping[str, np.ndarray]
    f: np.ndarray

    @staticmethod
    def of(engine: Engine, sealed: Sealed, clean: Dataset) -> Opened:
        """`clean`: the flights without noise, priors at the true state."""
        assert sealed.law is not None
        beside = nuisance(clean)
        base = identify_with(clean, NULL_HYPOTHESIS, beside)
        truth = engine.replace_effects((*engine.effects, *sealed.effects))
        theta = {**sealed.health, **sealed.values}
        values = along(truth, input_values(clean), theta, tuple(formula_variables(engine.network).values()))
        places = tuple(list_locations(engine, list(clean.noise.sigma)))
        return Opened(engine, sealed, sealed.law, base, beside, places, values, curve(sealed.law.effect, values))

    def marks(self, told: ToldLaw, searched: Dataset) -> tuple[Marks, dict[str, Any]]:
        """Marks of what was told, and what the record keeps of it. `searched`: the recordings as they were given."""
        laws = all_built(self.engine, told.entries)
        apart, at_best = self.distance(laws), self.distance(laws, sought=True)
        far = place_separability(self.base, self.nuisance, self.f, self.truth.place)
        first = told.places[0][0]
        alike = inseparable(far) | ({first} if apart < ALIAS else frozenset())
        exact = first == self.truth.place.name
        named = place_named(self.places, first)
        marks: Marks = {
            "law_place": exact or first in alike,
            "law_place_exact": exact,
            "law_component": named is not None and named.component == self.truth.place.component,
            "law_driver": same_driver(list(self.truth.law.variables), told.drivers[0][0], self.values),
            "law_curve": apart < ALIAS,
            "law_form": at_best < ALIAS,
        }
        marks["law_alone"] = len({entry["at"] for entry in told.entries}) == 1
        marks["stated"] = [told.together, marks["law_place"]]
        marks["law_driver_or_alike"] = marks["law_driver"] or apart < ALIAS
        marks["law_driver_told"] = any(
            same_driver(list(self.truth.law.variables), groups, self.values) for groups in told.along
        )
        marks["law_drivers_told"] = [len(told.along)]
        marks["stated_driver"] = [told.drivers[0][1], marks["law_driver"]]
        here = [e for e in laws or () if law_of(e).acts.leaf == self.truth.law.acts.leaf]
        if exact and here:
            told_curve = np.sum([curve(e, self.values) for e in here], axis=0)
            marks["law_error"] = [curve_error(told_curve, self.f)]
        excess = self.ahead(laws, named, told, searched)
        kept = {
            "found": [dict(entry) for entry in told.entries],
            "told_places": [[p, short(x)] for p, x in told.places[:3]],
            "told_drivers": [[[g[0] for g in groups], short(x)] for groups, x in told.drivers[:3]],
            "explained": short(told.explained),
            "distance": short(apart),
            "distance_at_best": short(at_best),
            "alike": sorted(alike),
            "excess": {name: {m: short(x) for m, x in e.items()} for name, e in excess.items()},
        }
        return marks | ahead_marks(excess), kept

    def distance(self, laws: Sequence[Effect] | None, sought: bool = False) -> float:
        """D of `marks`; infinite where the laws cannot be carried or fitted. `sought`: with their coefficients fitted
        anew, too."""
        if laws is None:
            return np.inf
        evidence, free = self.base.evidence, Hypothesis(tuple(laws))
        if not sought:
            engine = evidence.engine
            evidence, free = replace(evidence, engine=engine.replace_effects((*engine.effects, *laws))), NULL_HYPOTHESIS
        return left_by(lowest(evidence, free, self.nuisance, self.base, ALIAS))

    def ahead(
        self, laws: Sequence[Effect] | None, place: Location | None, told: ToldLaw, searched: Dataset
    ) -> dict[str, dict[str, float]]:
        """Excess on unseen flights of no law, of the one that was told, of the true one, and of a spline in the place
        and driver that were told."""
        unseen = {
            name: self._flights(name, flights)
            for name, flights in (
                (UNSEEN, self.sealed.flights[self.sealed.training :]),
                (HIGHER, self.truth.higher),
            )
        }
        ahead = Ahead.of(searched, {name: f for name, f in unseen.items() if f})
        models = {NONE: ahead.squares(), TRUE: ahead.squares(Hypothesis((self.truth.effect,)))}
        models[FOUND] = models[NONE]
        if laws is not None:
            carrying = searched.engine.replace_effects((*searched.engine.effects, *laws))
            models[FOUND] = ahead.squares(engine=carrying)
        if place is not None:
            free = self._free(ahead, place, told.drivers[0][0], searched.records)
            if free is not None:
                models[SPLINE] = ahead.squares(free)
        return ahead.excess(models)

    def _free(self, ahead: Ahead, place: Location, groups: Sequence[Sequence[str]], fitted: int) -> Hypothesis | None:
        """A spline of each variable told, and the product of two, at a place; None where nothing is known of one."""
        known = formula_variables(self.engine.network)
        of = [known[g[0]] for g in groups if g and g[0] in known]
        if len(of) < len(groups) or not of:
            return None
        x = along(self.engine, input_values(ahead.both), ahead.base.theta, of)
        curves = {f"{n} {k}": c for n, v in x.items() for k, c in enumerate(spline(v, v[:fitted]).T)}
        if len(x) == 2:
            a, b = ((v - np.nanmean(v[:fitted])) / max(float(np.nanstd(v[:fitted])), 1e-12) for v in x.values())
            curves["product"] = a * b
        return curved(place, {n: np.where(np.isfinite(c), c, 0.0) for n, c in curves.items()}, ahead.base)

    def _flights(self, name: str, flights: Sequence[Mapping[str, np.ndarray]]) -> list[Flight]:
        """Flights with what the truth engine's sensors read without noise; records that it cannot compute left out."""
        if not flights:
            return []
        y = readings(self.engine, replace(self.sealed, flights=tuple(flights)), exact_model=False)
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
