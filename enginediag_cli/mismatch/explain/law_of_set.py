"""The law of a set, searched as one that acts alone is, beside what the set holds besides.

While sets grow a law is the best of few forms at the place of a free curve. Which variables it is of, and whether it is
one form or a sum, is weighed here from the fit with all other members of the set: by all smooth curves of all
variables, by every form with the shape that suits it, at every place.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from enginediag_cli.mismatch.explain.answer import Explanation
from enginediag_cli.mismatch.explain.law_members import LawMembers
from enginediag_cli.mismatch.explain.lawful import JUDGED, LISTED_FIRST, Judged, adequate
from enginediag_cli.mismatch.explain.members import identity
from enginediag_cli.mismatch.explain.stepwise import Sets
from enginediag_cli.mismatch.fit.options import LAW, Option
from enginediag_cli.mismatch.fit.trial_fit import Trial, is_needed
from enginediag_cli.mismatch.laws.finding import LawFinding
from enginediag_cli.mismatch.laws.fitted import Fitted
from enginediag_cli.mismatch.laws.scan import scanned
from enginediag_cli.mismatch.laws.search import LawSearch
from enginediag_cli.mismatch.laws.shortlist import Proposal
from enginediag_cli.mismatch.laws.summary import summary
from enginediag_cli.progress import stage

ANOTHER_PLACE = LISTED_FIRST
"""ln of the odds by which one law that nobody has written down is likelier beforehand than two at two places, their
places and forms apart: as for the first beside what is listed."""


@dataclass(frozen=True)
class OfSet:
    """`explanations`: what is named, likeliest first; `finding`: what is known of its law, None where it stayed as it
    was."""

    explanations: tuple[Explanation, ...]
    finding: LawFinding | None = None


@dataclass(frozen=True)
class LawOfSet:
    """Sets that were named, and the laws that `members` knows."""

    sets: Sets
    members: LawMembers

    @stage("weighing the law of a set")
    def of(self, named: Sequence[Explanation]) -> OfSet:
        """What was named, with the law of the first as it is after this search, alone or with its rivals; as it was
        where none that was found explains as well. What the law leaves nothing to do is dropped, and the law searched
        again."""
        trial = self.sets.fits.fitted[named[0].label]
        laws = [o for o in trial.options if o.kind == LAW]
        beside = [o for o in trial.options if o.kind != LAW]
        own, found = set(map(identity, beside)), None
        also = tuple(self.members.known[o.label] for o in laws)
        while laws and beside:
            further = self._searched(tuple(beside), also)
            if further is None:
                break
            found = further
            idle = [o for o in beside if not is_needed(found.first, o, self.sets.fits.adequate.of(o))]
            if not idle:
                break
            beside = [o for o in beside if o is not idle[0]]
        if found is None:
            return OfSet(tuple(named))
        same, others = list[Explanation](), list[Explanation]()
        for x in named:
            (same if {identity(o) for o in x.options if o.kind != LAW} == own else others).append(x)
        told = found.judged.told(self.sets.fits, sum(x.probability for x in same))
        finding = summary(found.search, found.judged.fitted, found.search.base, not self.sets.fits.from_recordings)
        return OfSet((*told, *others), finding)

    def _searched(self, others: tuple[Option, ...], also: tuple[Proposal, ...]) -> _Searched | None:
        """Laws beside these members; None where none explains."""
        base = self.sets.fitted(others)
        if base is None:
            return None
        search = LawSearch(base, scanned(base.found, base.projection), self.sets.fits.refit, (also,))
        self.members.learn(search.proposals)
        judged = adequate(self.sets.fits, _simplest(search.told)[:JUDGED])
        return _Searched(search, judged) if judged.found else None


@dataclass(frozen=True)
class _Searched:
    """A search of laws beside some members, and which of them explain: at least one."""

    search: LawSearch
    judged: Judged

    @property
    def first(self) -> Trial:
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
