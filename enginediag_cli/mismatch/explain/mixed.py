"""Laws beside what is listed, in one search: sets grow with laws, too, among what may be a member.

What was fitted before counts: a law that explains most by itself is where a change in time may join, and a set of
listed ones is where a law may. A set is judged as any explanation is.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

from enginediag_cli.mismatch.explain.among_all import among_all
from enginediag_cli.mismatch.explain.answer import Explanation
from enginediag_cli.mismatch.explain.currency import Offer
from enginediag_cli.mismatch.explain.law_members import LawMembers
from enginediag_cli.mismatch.explain.law_of_set import LawOfSet
from enginediag_cli.mismatch.explain.stepwise import Stepwise
from enginediag_cli.mismatch.fit.options import FORMULA_OPTION
from enginediag_cli.mismatch.fit.trial import HypothesisFit
from enginediag_cli.mismatch.laws.finding import LawFinding
from enginediag_cli.mismatch.laws.shortlist import Proposal


@dataclass(frozen=True)
class Mixed:
    """`explanations`: sets of listed options and laws, likeliest first, empty where none explains the mismatch;
    `evidence`: ln, of the first, against the model as it is; `finding`: what is known of its law, None where that was
    not weighed by itself."""

    explanations: tuple[Explanation, ...] = ()
    evidence: float = 0.0
    finding: LawFinding | None = None


def with_laws(search: Stepwise, tried: Iterable[Proposal] = ()) -> Mixed:
    """The alias set of listed options with laws beside them; none where laws alone are likelier. `tried`: laws that
    were fitted; sets do not grow from curves of steps, which take up what other members would say."""
    sets = search.sets
    members = LawMembers(sets.fits.base.found, sets.prices)
    members.learn(p for p in tried if p.candidate.formula.form.listed)

    def propose(trial: HypothesisFit) -> Sequence[Offer]:
        return members.offers(trial, sets.offered_by(sets.unlisted, trial))

    named = search.grown((propose,))
    if not named or all(o.kind == FORMULA_OPTION for o in named[0].options):
        return Mixed()
    told = LawOfSet(sets, members).of(named)
    first = sets.fits.fitted[told.explanations[0].label]
    among = tuple(among_all(sets, told.explanations))
    finding = told.finding if among[0].label == told.explanations[0].label else None
    return Mixed(among, sets.evidence(first) - sets.evidence(sets.fits.base), finding)
