"""A linear twin of the search for laws: many trials in minutes, to compare what blind trials are too few for.

    python tests/benchmarks/law_twin.py --laws 300 --seed 41 --map-accuracy 0.003

Laws are drawn as blind trials draw them, on the engines and flights of blind trials, and what the place of each says of
any curve is computed once from a fit without noise: H (N, N), the curvature of χ² over the records, everything that is
identified projected out. The noise of a recording is drawn as what it adds to that,

    pull = H f + n,  n ~ N(0, H)

so that a trial costs a second. The tool's own search of variables, forms and shapes works on it as on a recording; the
place is given, sums of forms are not tried, and a model that is not linear is not seen. Counted is D = (f̂ − f)ᵀH(f̂ − f)
< 11 as in blind trials, of the likeliest law, and of what is told (the average where no form is settled).
"""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from enginediag_cli.cli.validation import SEVERAL_ENGINES
from enginediag_cli.mismatch.laws.at_place import all_said
from enginediag_cli.mismatch.laws.average import Sought, with_smooth
from enginediag_cli.mismatch.laws.carried import Carried
from enginediag_cli.mismatch.laws.fitted import Where
from enginediag_cli.mismatch.laws.mean import mean_of
from enginediag_cli.mismatch.laws.said import Said
from enginediag_cli.mismatch.laws.scan import Formula, formulas, number_of_groups
from enginediag_cli.mismatch.laws.steps import prior_of, prior_of_all
from enginediag_cli.physics.engine_file import load_engine
from enginediag_cli.shipped import shipped
from enginediag_cli.validation.concealed_formulas import (
    ConcealedFormula,
    FormulaDesign,
    FormulaRequest,
    draft_formula,
    evaluate_formula,
)
from enginediag_cli.validation.formula_marks import same_driver
from enginediag_cli.validation.separability import ALIAS
from enginediag_cli.validation.trial_flights import draw_flights
from enginediag_cli.validation.trials import wilson

PER_ENGINE, TRIES = 3, 60
"""Sets of flights of each engine; laws that are drawn of one sort."""

Groups = frozenset[int]


@dataclass(frozen=True)
class Flown:
    """Flights of an engine, and every formula of their variables."""

    ground: FormulaDesign
    every: Sequence[Formula]


@dataclass
class Case:
    """A law, its curve f (N,), and what its place says of it with noise."""

    flown: Flown
    truth: ConcealedFormula
    f: np.ndarray
    said: Said

    def within(self, found: np.ndarray) -> bool:
        return self.said.any.apart(found, self.f) < ALIAS

    def right(self, groups: Groups) -> bool:
        known = self.flown.ground.variables
        named = [[k.variable.name for k in known if k.group == g] for g in groups]
        return same_driver(list(self.truth.law.variables), named, {k.variable.name: k.values for k in known})


def flown(seed: int, accuracy: float) -> list[Flown]:
    found = []
    for j, name in enumerate(SEVERAL_ENGINES):
        engine = load_engine(str(shipped(name)))
        for k in range(PER_ENGINE):
            flights, training = draw_flights(engine, np.random.default_rng([seed, j, k]))
            ground = FormulaDesign.from_flights(engine, flights[:training], accuracy)
            found.append(Flown(ground, list(formulas(ground.variables))))
    return found


def cases(seed: int, count: int, accuracy: float) -> Iterator[Case]:
    grounds, rng = flown(seed, accuracy), np.random.default_rng([seed, len(SEVERAL_ENGINES)])
    roots: dict[tuple[int, str], tuple[Said, np.ndarray]] = {}
    while count:
        at = int(rng.integers(len(grounds)))
        ground, sort = grounds[at].ground, FormulaRequest.draw(rng)
        drawn = (draft_formula(ground, sort, rng) for _ in range(TRIES))
        truth = next((t for t in drawn if t is not None), None)
        if truth is None:
            continue
        f = evaluate_formula(truth.effect, {k.variable.name: k.values for k in ground.variables})
        if (at, truth.place.name) not in roots:
            clean = Said(Carried(ground.fit, ground.projection, truth.place, f, 0.0, tuple(ground.variables)))
            values, vectors = np.linalg.eigh(clean.any.grams(np.eye(len(f))[:, None, :])[0])
            roots[at, truth.place.name] = clean, vectors * np.sqrt(np.maximum(values, 0.0))
        clean, root = roots[at, truth.place.name]
        said = clean.with_carried(f, root @ rng.standard_normal(root.shape[1]))
        yield Case(grounds[at], truth, f, said)
        count -= 1


@dataclass(frozen=True)
class Told:
    """Of the likeliest variables and form: whether the variables are right, the likeliest law's curve and what is
    told are within noise, and whether an average is told."""

    variables: bool
    likeliest: bool
    told: bool
    averaged: bool


def answered(case: Case) -> Told:
    ground = case.flown.ground
    groups, place = number_of_groups(ground.variables), case.truth.place.name
    here = all_said(case.said, case.flown.every, 0.0)
    # of variables that are alike the best counts, as in the search
    totals: dict[Where, dict[str, float]] = {s.where: {"": s.evidence} for s in reversed(here.smooth)}
    for where, b in here.bends.items():
        totals[where][""] = max(totals[where][""], b.evidence + prior_of_all(b, groups))
    for c in sorted(here.refined, key=lambda c: c.weight):
        totals.setdefault((place, c.formula.groups), {})[c.formula.form.name] = c.weight
    total = {where: float(np.logaddexp.reduce(list(own.values()))) for where, own in totals.items()}
    known = {*here.bends, *((place, c.formula.groups) for c in here.refined)}
    first = max(known, key=lambda where: total[where])
    sets = Sought([], here.refined, here.bends).along(first, here.says.known, total, ground.engine)
    along = [with_smooth(a, here.says, 0.0) for a in sets]
    smooth = max((b.evidence + prior_of(b, groups) for w, b in here.bends.items() if w == first), default=-np.inf)
    forms = max((m.evidence for m in sets[0].members), default=-np.inf)
    best = max(along[0].members, key=lambda m: m.evidence)
    mean = mean_of(along, None if smooth > forms else best.curve, here.says.any)
    told = best.curve if mean is None else mean.curve
    return Told(case.right(first[1]), case.within(best.curve), case.within(told), mean is not None)


def _row(words: str, told: Sequence[Told]) -> None:
    counts = [sum(getattr(t, n) for t in told) for n in ("variables", "likeliest", "told", "averaged")]
    rates = []
    for k in counts:
        low, high = wilson(k, len(told))
        rates.append(f"{100 * k / len(told):5.1f} ({100 * low:.0f}–{100 * high:.0f})")
    print(f"{words:24} {len(told):5}  " + "  ".join(f"{r:>14}" for r in rates))


def main() -> None:
    parser = argparse.ArgumentParser()
    parser.add_argument("--laws", type=int, default=300)
    parser.add_argument("--seed", type=int, default=41)
    parser.add_argument("--map-accuracy", type=float, default=0.0, help="of the maps, which may err so much")
    parser.add_argument("--json", action="store_true", help="one line for each law")
    asked = parser.parse_args()
    found: list[tuple[Case, Told]] = []
    for case in cases(asked.seed, asked.laws, asked.map_accuracy):
        found.append((case, answered(case)))
        if asked.json:
            print(json.dumps({"form": case.truth.form, "outside": case.truth.outside_grammar, **vars(found[-1][1])}))
        print(f"{len(found)} of {asked.laws}", end="\r", file=sys.stderr)
    if asked.json:
        return
    print(f"{'%':24} {'laws':>5}  " + "  ".join(f"{w:>14}" for w in ("variables", "likeliest", "as told", "averaged")))
    _row("all", [t for _, t in found])
    for two in (False, True):
        for outside in (False, True):
            own = [t for c, t in found if (len(c.truth.law.variables) == 2, c.truth.outside_grammar) == (two, outside)]
            if own:
                _row(f"{'two' if two else 'one'}, {'outside' if outside else 'in'} the grammar", own)


if __name__ == "__main__":
    main()
