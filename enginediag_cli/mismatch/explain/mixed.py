"""Laws beside what is listed: where the likeliest set holds a free curve, a law is sought in its place.

A free curve says where something unlisted acts, not what it does; no engine file can carry it. At the fit of the other
members every formula at the curve's places is scored, the best are fitted together with these members, and the set is
judged as any explanation is. A law costs what its place, variables and form were chosen from.
"""

from __future__ import annotations

from collections.abc import Sequence

from enginediag_cli.mismatch.explain.answer import Explanation
from enginediag_cli.mismatch.explain.stepwise import Sets
from enginediag_cli.mismatch.fit.freeform import Location, locations
from enginediag_cli.mismatch.fit.options import FREE, Option
from enginediag_cli.mismatch.fit.trial_fit import Trial
from enginediag_cli.mismatch.laws.scan import formulas, known_variables, prior_of_a_place, scored
from enginediag_cli.mismatch.laws.shortlist import Proposal, elsewhere

LAWS = 2
"""Free curves that laws are sought for, one after the other."""
TRIED = 4
"""Laws that are fitted in the place of one curve."""
OF_MANY = 1
"""Of both, where there are so many records that a fit takes seconds."""


def with_laws(sets: Sets) -> list[Explanation]:
    """The alias set of listed options with laws in the place of free curves; empty where none is adequate, or where
    the likeliest set has no such curve or nothing listed."""
    trial = next((t for t in sets.with_unlisted() if any(o.kind == FREE for o in t.options)), None)
    listed = tuple(o for o in trial.options if o.kind != FREE) if trial is not None else ()
    if trial is None or not listed:
        return []
    where = _places([o for o in trial.options if o.kind == FREE], trial)
    best = sets.fitted(listed)
    many = sets.many
    for _ in range(OF_MANY if many else LAWS):
        if best is None:
            return []
        wider = [(*best.options, p.option) for p in _laws_at(where, best, sets)[: OF_MANY if many else TRIED]]
        sets.fits.refit(wider)
        found = [t for w in wider if (t := sets.fitted(w)) is not None]
        if not found:
            return []
        ranked = sorted(found, key=lambda t: -sets.evidence(t))
        if sets.evidence(ranked[0]) <= sets.evidence(best):
            return []
        named = sets.fits.named(ranked, lambda t: -2.0 * sets.evidence(t))
        if named:
            return named
        best = ranked[0]
    return []


def _places(free: Sequence[Option], trial: Trial) -> list[Location]:
    """Where free curves act."""
    targets = {d.target for o in free for d in o.hypothesis.discrepancies}
    return [p for p in locations(trial.found) if p.parameter in targets]


def _laws_at(where: Sequence[Location], trial: Trial, sets: Sets) -> list[Proposal]:
    """The best laws at these places beside what a trial has, priced as one of all that might be anywhere."""
    laws = list(formulas(known_variables(trial.found)))
    prior = prior_of_a_place(trial.found)
    found = elsewhere(scored(trial.found, trial.projection, where, laws, prior), trial.found.evidence.engine, TRIED)
    carried = {o.label for o in trial.options}
    sets.prices.own |= {p.option.label: -p.candidate.prior for p in found}
    return [p for p in found if p.option.label not in carried]
