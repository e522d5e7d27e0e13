"""The search for a law: every formula at every place by score, the best of them by fits inside the simulator.

Who searches says what a fit is and what it is good for (`Fitting`); which formulas there are, which of them are worth a
fit, and how likely each is beside the others is decided here.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from enginediag_cli.mismatch.fit.freeform import Location, locations
from enginediag_cli.mismatch.fit.options import Option
from enginediag_cli.mismatch.fit.trial import HypothesisFit
from enginediag_cli.mismatch.laws.at_place import said_at, said_at_places
from enginediag_cli.mismatch.laws.average import Sought, average_of
from enginediag_cli.mismatch.laws.band import curve_of
from enginediag_cli.mismatch.laws.elsewhere_too import MOST_PLACES, RIVAL, elsewhere_too
from enginediag_cli.mismatch.laws.fitted import LIKELIER, Fitted, Where, ordered
from enginediag_cli.mismatch.laws.grammar import FORMS
from enginediag_cli.mismatch.laws.said import Says
from enginediag_cli.mismatch.laws.scan import (
    Candidate,
    Scan,
    formulas_of,
    number_of_groups,
    prior_of_a_place,
    scanned,
    scored,
)
from enginediag_cli.mismatch.laws.shortlist import (
    Proposal,
    along_the_same,
    elsewhere,
    proposal,
    within_reach,
)
from enginediag_cli.mismatch.laws.smooth import Smooth, prior_of_variables
from enginediag_cli.mismatch.laws.steps import Bends, as_curve, as_surface, prior_of, prior_of_all

BEHIND, SECOND = 2, 3
"""Laws to which a second one is sought where none is enough by itself; how many of these are fitted to each."""

AS_GOOD = 6.0
"""χ² by which an average may be behind its likeliest form, which bends to the noise: explanations so near are told
together."""

PASSES, SETTLED = 3, 0.5
"""Averages of the same laws, each at a fit that carries the one before, at most; non-centrality by which one differs
from the one before it where it is the last."""

CURVES = 2
"""Smooth curves of one variable, likeliest first, that are fitted though no form of it was."""

SHAPED = 6
"""Forms that are fitted with the shape that suits them, likeliest first."""
BARELY, NEARLY = 1.0, 4.0
"""ln evidence by which a form must be likelier than when it was fitted, and by which it may be behind the best."""
STARTS, APART = 4, 10.0
"""Places and variables, best first, of which sums of forms are fitted at most, and by how much of ln evidence one may
be behind: of two variables that act together the right two may come first only with more than one form."""
MOST_FORMS = 5
"""Forms of one law: what needs more is no law."""
PLACES, WITHIN = 3, 15.0
"""Places at which variables are weighed whatever the form, at most, and by how much of ln evidence the best law at one
may be behind."""

Fitting = Callable[[Sequence[tuple[Option, ...]]], Sequence[HypothesisFit] | None]
"""Fits sets of options; trials that converged."""


@dataclass
class LawSearch:
    """One search from a base that lacks something, beside what this has. `also`: laws that are fitted in any case;
    `single` and `double`: those that were fitted, likeliest first; `says`: what places say of any curve, by name;
    `averages`: of places and variables whose form is not settled."""

    base: HypothesisFit
    scan: Scan
    fit: Fitting
    also: Sequence[tuple[Proposal, ...]] = ()
    single: list[Fitted] = field(default_factory=list)
    double: list[Fitted] = field(default_factory=list)
    smooth: list[Smooth] = field(default_factory=list)
    refined: list[Candidate] = field(default_factory=list)
    bends: dict[Where, Bends] = field(default_factory=dict)
    says: dict[str, Says] = field(default_factory=dict)
    averages: dict[Where, Fitted] = field(default_factory=dict)

    def __post_init__(self) -> None:
        self.engine = self.base.found.evidence.engine
        candidates = self.scan.candidates
        self.single = self._fitted([*((p,) for p in elsewhere(candidates, self.engine)), *self.also])
        self._weigh()
        self.single = self._with(self._fitted([(p,) for p in self._shaped()]))
        for first in self._apart():
            self.single = [*self.single, *self._of_more_forms(first)]
        self.single = self._with(self._fitted(self._at_other_places()))
        self.single = [*self.single, *self._smooth_laws()]
        total, best = self.totals(), self._best()
        self.single = ordered(replace(f, beside=total[f.where] - best[f.where].evidence) for f in self.single)
        self.averages = self._averages()

    @property
    def told(self) -> list[Fitted]:
        """Single laws as they may be told, likeliest first: of place and variables whose form is not settled the
        average, and then the likeliest form alone."""
        best = self._best()
        own = (f for f in self.single if f.where not in self.averages or f is best[f.where])
        return ordered([*self.averages.values(), *own])

    @property
    def proposals(self) -> list[Proposal]:
        """All laws that were fitted, once."""
        every = (*self.averages.values(), *self.single, *self.double)
        return list({p.option.label: p for f in every for p in f.laws}.values())

    def _averages(self) -> dict[Where, Fitted]:
        """Of the likeliest places and variables; the likeliest of a place holds laws of its others, too."""
        found: dict[Where, Fitted] = {}
        places = set[str]()
        for first in self._apart():
            if first.standing < self.single[0].standing - NEARLY:
                continue
            average = self._average(first, first.where[0] in places)
            if average is not None and average.trial.objective < first.trial.objective + AS_GOOD:
                found[first.where] = average
            places.add(first.where[0])
        return found

    def _average(self, first: Fitted, alone: bool) -> Fitted | None:
        """Of laws of the first one's variables at its place, and unless these are `alone` of others there, weighed
        again at a fit that carries their average until that stays: far from the law that was carried first, what a
        place says of curves is not linear."""
        says, prior, found = self.says.get(first.where[0]), prior_of_a_place(self.base.found), None
        if says is None or first.remembers or not first.at_one_place:
            return None  # what a variable was before is no function of what it is now
        sought = Sought(self.single, self.refined, self.bends)
        along = sought.along(first.where, says.known, self.totals(), self.engine)[: 1 if alone else None]
        for _ in range(PASSES):
            before = found
            if before is not None:
                said = said_at(self.base, before, self.scan)
                if said is None:
                    break
                says = said.kept
            average = average_of(first, along, says, prior)
            fitted = self._fitted([(average.law,)]) if average is not None else []
            if average is None or not fitted:
                return None
            found = average.fitted(fitted[0], max(first.standing - average.evidence, 0.0) + LIKELIER)
            if before is not None and says.any.apart(before.curve(says.known), found.curve(says.known)) < SETTLED:
                break
        return found

    def _smooth_laws(self) -> list[Fitted]:
        """Smooth curves as laws, or sums of one of each of two, of the likeliest places and variables where they are
        nearly as likely as any form, or no form was; and a surface of the likeliest two where it is likelier than all
        of theirs."""
        found: list[tuple[Proposal, ...]] = []
        here = prior_of_a_place(self.base.found)
        place = {p.name: p for p in locations(self.base.found)}
        total, best = self.totals(), self._best()
        likeliest = sorted(self.bends, key=lambda w: -total[w])
        for where in dict.fromkeys([*(f.where for f in self._apart()), *likeliest[:CURVES]]):
            bends = self.bends.get(where)
            if bends is None:
                continue
            least = (best[where].evidence if where in best else self.most) - NEARLY
            prior = prior_of(bends, self._groups)
            if bends.evidence + prior + here > least:
                found.append(as_curve(place[where[0]], bends, prior, here, self.engine))
        s = max(self.smooth, key=lambda s: s.evidence, default=None)
        own = best.get(s.where) if s is not None else None
        if s is not None and own is not None and len(s.of) == 2 and s.evidence > own.evidence:
            size = float(np.std(curve_of(own.effects, own.trial, self.says[s.place.name].known)[0]))
            prior = prior_of_variables(s.of, self._groups)
            found.append(as_surface(s.place, (s.of[0], s.of[1]), size, prior, here, self.engine))
        return self._fitted([laws for laws in found if laws])

    @property
    def _groups(self) -> int:
        return number_of_groups(self.scan.known)

    @property
    def most(self) -> float:
        """ln evidence of the likeliest single law; −∞ without one."""
        return max((f.evidence for f in self.single), default=-np.inf)

    def _best(self) -> dict[Where, Fitted]:
        """The best law of each place and variables."""
        best: dict[Where, Fitted] = {}
        for f in sorted(self.single, key=lambda f: -f.evidence):
            best.setdefault(f.where, f)
        return best

    def totals(self) -> dict[Where, float]:
        """ln evidence of each place and variables: of the forms, each once, and of all smooth curves, sums of them or
        surfaces. Of variables that the records hardly tell apart the best counts."""
        of: dict[Where, dict[object, float]] = {}
        for where, form, evidence in (
            *((f.where, _forms_of(f), f.evidence) for f in self.single),
            *((s.where, None, s.evidence) for s in self.smooth),
            *self._curves(),
            *self._unfitted(),
        ):
            own = of.setdefault(where, {})
            own[form] = max(own.get(form, -np.inf), evidence)
        return {where: float(np.logaddexp.reduce(list(own.values()))) for where, own in of.items()}

    def _curves(self) -> list[tuple[Where, None, float]]:
        """ln evidence of all curves of one variable, and of all sums of one of each of two, by steps."""
        here = prior_of_a_place(self.base.found)
        return [(where, None, b.evidence + prior_of_all(b, self._groups) + here) for where, b in self.bends.items()]

    def _at_places(self, gained: float) -> list[Fitted]:
        """The best law at each of the best places that were not weighed yet, as likely as the best of one form, or less
        by what the best has `gained` that no form says: a sum that is known at one of them is no measure of what others
        may come to, nor is a smooth curve."""
        best: dict[str, Fitted] = {}
        alone = next((f.evidence for f in self.single if len(f.laws) == 1), np.inf)
        for f in self.single:
            if f.at_one_place and f.evidence > alone - WITHIN - gained and f.where[0] not in self.says:
                best.setdefault(f.where[0], f)
        return list(best.values())[: PLACES - len(self.says)]

    def _weigh(self) -> None:
        """All variables at the places of the best laws, whatever the form; and every form of the likeliest of them."""
        self._weigh_at(self._at_places(0.0))
        if self.says:
            self._weigh_at(self._at_places(max(self.totals().values()) - self.most))
        self.refined.sort(key=lambda c: -c.weight)

    def _weigh_at(self, laws: Sequence[Fitted]) -> None:
        for here in said_at_places(self.base, self.scan, laws):
            self.smooth += here.smooth
            self.refined += here.refined
            self.bends |= here.bends
            self.says[here.place] = here.says

    def _shaped(self) -> list[Proposal]:
        """The likeliest forms with their best shapes, of which no fit was as good."""
        known = {_form_of(f.laws[0].candidate): f.evidence for f in reversed(self.single)}
        best: dict[object, Candidate] = {}
        for c in self.refined:
            if c.weight > known.get(_form_of(c), -np.inf) + BARELY:
                best.setdefault(_form_of(c), c)
        least = max([self.most, *(c.weight for c in best.values())]) - NEARLY
        return [proposal(c, self.engine) for c in best.values() if c.weight > least][:SHAPED]

    def _with(self, more: Sequence[Fitted]) -> list[Fitted]:
        """All single laws with these; of one that was fitted twice the better."""
        best: dict[str, Fitted] = {}
        for f in ordered([*self.single, *more]):
            best.setdefault(f.trial.label, f)
        return list(best.values())

    def _apart(self) -> list[Fitted]:
        """The best law of each of the best places and variables, whatever the form."""
        best, total = self._best(), self.totals()
        likeliest = sorted(best, key=lambda w: -total[w])[:STARTS]
        return [best[where] for where in likeliest if total[where] > total[likeliest[0]] - APART]

    def _at_other_places(self) -> list[tuple[Proposal, ...]]:
        """The likeliest law of listed forms at each of the other places that were weighed: places are compared by the
        same, and far from the law that was carried at one what it says of forms is not linear."""
        first = next((f for f in ordered(self.single) if f.at_one_place and _forms_of(f)), None)
        if first is None:
            return []

        def at(place: Location, law: Proposal) -> Proposal:
            (c,) = scored(self.base.found, self.base.projection, [place], [law.candidate.formula], 0.0)
            return proposal(replace(c, prior=law.candidate.prior), self.engine)

        others = [p for p in locations(self.base.found) if p.name in self.says and p.name != first.where[0]]
        sets = [tuple(at(place, law) for law in first.laws) for place in others]
        fitted = {tuple(p.option.label for p in f.laws) for f in self.single}
        return [laws for laws in sets if tuple(p.option.label for p in laws) not in fitted]

    def _of_more_forms(self, first: Fitted) -> list[Fitted]:
        """A law with further forms of the same variables at its place: a curve that no form has is a sum of some. One
        joins where all together are likelier; or where flights of the same kind are predicted better for it, which
        leaves the law as likely as it was."""
        found = [first]
        while len(found[-1].laws) < MOST_FORMS:
            last = found[-1]
            more = self._fitted([(*last.laws, p) for p in along_the_same(self.scan, last.laws, last.trial)])
            better = [f for f in more if f.evidence > last.evidence]
            if not better:
                better = sorted((f for f in more if _predicts(f, last) > 0.0), key=lambda f: -_predicts(f, last))
            if not better:
                break
            best = better[0]
            found.append(replace(best, evidence=max(best.evidence, last.evidence + LIKELIER), beside=last.beside))
        return found[1:]

    def elsewhere_too(self, first: Fitted) -> list[Fitted]:
        """Laws with the same formula at further places, as long as that is likelier; the last may be a rival."""
        where, found = locations(self.base.found), [first]
        while len(found[-1].laws) < MOST_PLACES:
            last = found[-1]
            further = elsewhere_too(last.laws, last.trial, where)
            more = [] if further is None else self._fitted([(*last.laws, further)])
            if not more or more[0].evidence < last.evidence - RIVAL:
                break
            found.append(replace(more[0], beside=first.beside))
            if more[0].evidence <= last.evidence:
                break
        wider = [*found[1:], *self._plainly(found[-1])] if len(found) > 1 else []
        self.double = ordered([*self.double, *wider])
        return wider

    def _plainly(self, found: Fitted) -> list[Fitted]:
        """The forms without a shape at the places of one formula: a law at one place bends to what further ones do, and
        is more than a plain one there; at all of them it need not be."""
        formula, scan = found.laws[0].candidate.formula, self.scan
        if any(p.candidate.formula.form is not formula.form for p in found.laws):
            return []
        plain = [f for f in formulas_of(formula.of, scan.known) if not f.form.shapes]
        at_each: list[dict[tuple[str, ...], Candidate]] = []
        for p in found.laws:
            # the first has paid for form and variables, the others for their place alone
            own = plain if p is found.laws[0] else [replace(f, prior=0.0) for f in plain]
            prior = p.candidate.prior - p.candidate.formula.prior
            scores = scored(self.base.found, self.base.projection, [p.candidate.location], own, prior)
            at_each.append({c.formula.what: c for c in scores})
        sets = [tuple(proposal(here[f.what], self.engine) for here in at_each) for f in plain]
        tried = {tuple(p.option.label for p in f.laws) for f in self.double}
        fitted = self._fitted([s for s in sets if tuple(p.option.label for p in s) not in tried])
        return [replace(f, beside=found.beside) for f in fitted]

    def with_second(self) -> list[Fitted]:
        """The best laws with the one that says most about what each leaves, and with further forms of the variables of
        both; those that are likelier than any without. What remembers is no second law: a fit of it takes minutes where
        flights do not hold it."""
        sets: list[tuple[Proposal, ...]] = []
        for first in self.single[:BEHIND]:
            left = scanned(first.trial.found, first.trial.projection)
            known = {o.label for o in first.options}
            at_once = [c for c in left.candidates if not c.formula.form.remembers]
            more = [p for p in elsewhere(at_once, self.engine, SECOND) if p.option.label not in known]
            sets += [(*first.laws, p) for p in more]
        found = self._fitted(sets)
        further = [f for second in found[:1] for f in self._of_more_forms(second)]
        likelier = [f for f in (*found, *further) if f.evidence > self.most]
        self.double = ordered([*self.double, *likelier])
        return self.double

    def _unfitted(self) -> list[tuple[Where, tuple[str, ...], float]]:
        """Candidates that were not fitted: at places where forms were shaped by these, else by their scores, moved as a
        fit has moved the best one's."""
        fitted = {_form_of(f.laws[0].candidate) for f in self.single if len(f.laws) == 1}
        moved = max((f.evidence - f.laws[0].candidate.weight for f in self.single if len(f.laws) == 1), default=0.0)
        shaped = {_form_of(c) for c in self.refined}
        found = [(c, c.weight) for c in self.refined]
        found += [
            (c, c.weight + min(moved, 0.0)) for c in within_reach(self.scan.candidates) if _form_of(c) not in shaped
        ]
        return [
            ((c.location.name, c.formula.groups), (c.formula.form.name,), weight)
            for c, weight in found
            if _form_of(c) not in fitted
        ]

    def _fitted(self, sets: Sequence[tuple[Proposal, ...]]) -> list[Fitted]:
        beside = self.base.options
        of = {frozenset(o.label for o in (*beside, *(p.option for p in s))): s for s in sets}
        trials = self.fit([(*beside, *(p.option for p in s)) for s in of.values()]) or []
        return ordered(Fitted.to(self.base, of[frozenset(o.label for o in t.options)], t) for t in trials)


def _predicts(more: Fitted, fewer: Fitted) -> float:
    """By how much a law with a further form, chosen as it was from many, predicts better; below 0 where it does not:

        Δχ² − 2 (k + ln m)      k: its coefficients,  m: forms of one variable or two

    Sources: H. Akaike, IEEE Trans. Autom. Control 19 (1974) 716–723; D. P. Foster, E. I. George, Ann. Statist. 22
    (1994) 1947–1975 (the price of the choice)."""
    k = len(more.trial.hypothesis.names) - len(fewer.trial.hypothesis.names)
    return fewer.trial.objective - more.trial.objective - 2.0 * (k + float(np.log(len(FORMS))))


def _forms_of(f: Fitted) -> object:
    """Names of a law's forms; none of a smooth curve or surface."""
    forms = [p.candidate.formula.form for p in f.laws]
    return tuple(form.name for form in forms) if all(form.listed for form in forms) else None


def _form_of(c: Candidate) -> tuple[str, str, frozenset[int]]:
    """Place, form and groups of variables: a fit moves one shape into another."""
    return c.location.name, c.formula.form.name, c.formula.groups
