"""The law of a set, searched as one that acts alone is, beside what the set holds besides.

While sets grow a law is the best of few forms at the place of a free curve. Which variables it is of, and whether it is
one form or a sum, is weighed here from the fit with all other members of the set: by all smooth curves of all
variables, by every form with the shape that suits it, at every place.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

from enginediag_cli.mismatch.explain.answer import Explanation
from enginediag_cli.mismatch.explain.fitted_sets import FittedSets
from enginediag_cli.mismatch.explain.law_members import LawMembers
from enginediag_cli.mismatch.explain.lawful import AS_GOOD, JUDGED, LISTED_FIRST, Judged, adequate
from enginediag_cli.mismatch.explain.members import Held, Members, held
from enginediag_cli.mismatch.fit.needed import is_needed
from enginediag_cli.mismatch.fit.options import FORMULA_OPTION, Option
from enginediag_cli.mismatch.fit.trial import HypothesisFit
from enginediag_cli.mismatch.laws.finding import LawFinding
from enginediag_cli.mismatch.laws.fitted import Fitted
from enginediag_cli.mismatch.laws.posterior import shares
from enginediag_cli.mismatch.laws.scan import scanned
from enginediag_cli.mismatch.laws.search import LawSearch
from enginediag_cli.mismatch.laws.shortlist import Proposal
from enginediag_cli.mismatch.laws.summary import summary
from enginediag_cli.progress import stage

ANOTHER_PLACE = LISTED_FIRST
"""ln of the odds by which one law that nobody has written down is likelier beforehand than two at two places, their
places and forms apart: as for the first beside what is listed."""

SEARCHED, NEAR = 2, 10.0
"""Sets that hold different things beside their laws, likeliest first, of which the law is searched, and ln evidence by
which one that was not named may be behind: all forms have brought up to 35 of it. Judgement."""


@dataclass(frozen=True)
class OfSet:
    """`explanations`: what is named, likeliest first; `finding`: what is known of its law, None where it stayed as it
    was."""

    explanations: tuple[Explanation, ...]
    finding: LawFinding | None = None


@dataclass(frozen=True)
class LawOfSet:
    """Sets that were named, and the laws that `members` knows."""

    sets: FittedSets
    members: LawMembers

    @stage("weighing the law of a set")
    def of(self, named: Sequence[Explanation]) -> OfSet:
        """What was named, likeliest first by what its laws are after this search: of each set of what is listed, alone
        or with its rivals. As it was named where none that was found explains as well."""
        same: dict[Held, list[Explanation]] = {}
        for x in named:
            same.setdefault(_held(x.options), []).append(x)
        found: dict[Held, _Told] = {}
        for options in self._searched_for(named):
            told = self._searched_again(options)
            if told is not None:
                found.setdefault(_held(told.explanations[0].options), told)
                same.pop(_held(options), None)
        for beside, own in same.items():
            found.setdefault(beside, _Told(tuple(own), self._evidence(own[0].label)))
        likeliest = sorted(found.values(), key=lambda t: -t.evidence)
        likeliest = [t for t in likeliest if t.evidence > likeliest[0].evidence - AS_GOOD]
        share = sum(x.probability for x in named) * shares([t.evidence for t in likeliest])
        every = [x for t, p in zip(likeliest, share, strict=True) for x in t.with_probability(float(p))]
        return OfSet(tuple(every), likeliest[0].finding)

    def _searched_for(self, named: Sequence[Explanation]) -> list[Members]:
        """Sets of which the law is searched, that hold different things beside it: what was named, and what is so near
        with the few forms that were tried while sets grew."""
        least = self._evidence(named[0].label) - NEAR
        near = (t for t in self.sets.likeliest(listed=True) if self.sets.evidence(t) > least)
        first: dict[Held, Members] = {}
        for options in (*(x.options for x in named), *(t.options for t in near)):
            if any(o.kind == FORMULA_OPTION for o in options) and _held(options):
                first.setdefault(_held(options), tuple(options))
        return list(first.values())[:SEARCHED]

    def _evidence(self, label: str) -> float:
        return self.sets.evidence(self.sets.fits.fitted[label])

    def _searched_again(self, options: Members) -> _Told | None:
        """Explanations that hold the same but for their laws, with their law searched beside the rest; what it leaves
        nothing to do is dropped, and the law searched again. None where none that is found explains."""
        beside = [o for o in options if o.kind != FORMULA_OPTION]
        also, found = tuple(self.members.known[o.label] for o in options if o.kind == FORMULA_OPTION), None
        while beside:
            further = self._searched(tuple(beside), also)
            if further is None:
                break
            found = further
            idle = [o for o in beside if not is_needed(found.first, o, self.sets.fits.adequate.of(o))]
            if not idle:
                break
            beside = [o for o in beside if o is not idle[0]]
        if found is None:
            return None
        fitted, base, fits = found.judged.fitted, found.search.base, self.sets.fits
        finding = summary(found.search, fitted, base, not fits.from_recordings)
        return _Told(found.judged.told(fits), self.sets.evidence(base) + fitted[0].standing, finding)

    def _searched(self, others: tuple[Option, ...], also: tuple[Proposal, ...]) -> _Searched | None:
        """Laws beside these members; None where none explains."""
        base = self.sets.fitted(others)
        if base is None:
            return None
        search = LawSearch(base, scanned(base.found, base.projection), self.sets.fits.refit, (also,))
        self.members.learn(search.proposals)
        judged = adequate(self.sets.fits, _simplest(search.told)[:JUDGED])
        for f in judged.fitted:  # priced while the laws of this search are those that are known
            self.sets.evidence(f.trial)
        return _Searched(search, judged) if judged.found else None


@dataclass(frozen=True)
class _Told:
    """Explanations that hold the same but for their laws; ln evidence of all of them, what is known of the law."""

    explanations: tuple[Explanation, ...]
    evidence: float
    finding: LawFinding | None = None

    def with_probability(self, p: float) -> list[Explanation]:
        """Shares of it, as they have them of each other."""
        total = sum(x.probability for x in self.explanations)
        return [replace(x, probability=p * x.probability / total) for x in self.explanations]


@dataclass(frozen=True)
class _Searched:
    """A search of laws beside some members, and which of them explain: at least one."""

    search: LawSearch
    judged: Judged

    @property
    def first(self) -> HypothesisFit:
        return self.judged.fitted[0].trial


def _simplest(found: Sequence[Fitted]) -> list[Fitted]:
    """Single laws, at one place or the same at several, where one of them is nearly as likely as the likeliest: where
    flights hardly tell two places apart, two halves of a law may be divided between them."""
    alone = [f for f in found if f.at_one_place or _the_same(f)]
    return alone if alone and alone[0].standing > found[0].standing - ANOTHER_PLACE else [*found]


def _the_same(f: Fitted) -> bool:
    """Whether its laws are of one form and the same variables."""
    formulas = [p.candidate.formula for p in f.laws]
    return len({(x.form.name, x.groups) for x in formulas}) == 1


def _held(options: Sequence[Option]) -> Held:
    """What a set holds but for its laws."""
    return held([o for o in options if o.kind != FORMULA_OPTION])
