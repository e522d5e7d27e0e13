"""Sets with another option, or another time, in the place of one member.

What settles first is where the search began, and what lies beside it one member at a time. A set that holds something
else and leaves a misfit may lack a single exchange to explain all, and be likelier than what was settled.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence

from enginediag_cli.mismatch.explain.fitted_sets import FittedSets, Proposer
from enginediag_cli.mismatch.explain.members import MOST_MEMBERS, Held, Members, add, held
from enginediag_cli.mismatch.fit.options import FORMULA_OPTION, Option, begun_with
from enginediag_cli.mismatch.fit.trial import HypothesisFit

EXCHANGED = 2
"""Options that are tried in the place of each member of a set."""
FIRST_OF_TWO = 3
"""Options that are fitted in the place of a law for others to be tried beside them."""
RIVALS = 2
"""Sets that hold something else, likeliest first, in which members are exchanged once one is settled."""


def exchanges(
    sets: FittedSets,
    trial: HypothesisFit,
    proposers: Sequence[Proposer],
    enough: float,
    of: Iterable[Option] | None = None,
) -> list[Members]:
    """Sets with something else in the place of one member, of all or of these, that promise more than `enough`. A
    change in time has the onset that suits what is left, and that of the change in whose place it is: everything else
    bends to the fit without one, which may see another's onset somewhere else."""
    new: list[Members] = []
    for member in trial.options if of is None else of:
        others = tuple(o for o in trial.options if o is not member)
        without = sets.fitted(others)
        if without is None:
            continue
        for offer in sets.offered(without, proposers, EXCHANGED + 1):
            if offer.option.label == member.label:
                continue
            if sets.hope(without, offer) <= enough:
                continue
            for option in (offer.option, begun_with(offer.option, member)):
                if not sets.known((*others, option)):
                    add(new, (*others, option))
    return new


def two_for_a_law(sets: FittedSets, trial: HypothesisFit, enough: float) -> list[Members]:
    """Sets with two listed options in the place of a law, that promise more than `enough`. A law is free in form and
    may be as likely as two effects at once, either of which alone promises far too little to be tried in its place."""
    new: list[Members] = []
    for half in (h for o in trial.options if o.kind == FORMULA_OPTION for h in _with_one_more(sets, trial, o)):
        for second in sets.offered(half, (), EXCHANGED):
            both = (*half.options, second.option)
            if sets.hope(half, second) > enough and not sets.known(both):
                add(new, both)
    return new


def _with_one_more(sets: FittedSets, trial: HypothesisFit, law: Option) -> list[HypothesisFit]:
    """The set without its law, with each of the best listed options in its place."""
    without = sets.fitted(tuple(o for o in trial.options if o is not law))
    if without is None:
        return []
    fits = [sets.fitted((*without.options, o.option)) for o in sets.offered(without, (), FIRST_OF_TWO)]
    return [f for f in fits if f is not None]


def in_rivals(
    sets: FittedSets, settled: HypothesisFit, unlisted: Proposer, least: float, enough: float
) -> list[Members]:
    """Exchanges of listed options in the likeliest sets that hold something else than the settled one, neither more
    nor less of the same, and are likelier than `least`; and such a set with the free curve that says most beside it:
    what was settled may imitate what nobody has listed."""
    own = held(settled.options)
    first: dict[Held, HypothesisFit] = {}
    for t in sets.likeliest(listed=True):
        other = held(t.options)
        if sets.evidence(t) > least and not (other <= own or own <= other):
            first.setdefault(other, t)
    new: list[Members] = []
    for t in list(first.values())[:RIVALS]:
        for members in exchanges(sets, t, (), enough):
            add(new, members)
        for curve in sets.offered_by(unlisted, t)[:1] if len(t.options) < MOST_MEMBERS else ():
            wider = (*t.options, curve.option)
            if sets.hope(t, curve) > enough and not sets.known(wider):
                add(new, wider)
    return new
