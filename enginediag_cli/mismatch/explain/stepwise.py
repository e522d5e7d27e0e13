"""Sets of options that act together, where no single one explains the evidence.

Pairs first, by their joint score and from what the best singles leave. Where none is adequate sets grow step by step,
whatever their members are, compared in one currency (`currency`):

1. forward: what the best few sets leave proposes the next members (effects, changes in time, and what `proposers` have
   to offer); the most promising are fitted, with everything else anew;
2. backward: a member that is not needed beside the others is dropped;
3. exchange: at the fit without each member, in turn, what explains as much in its place, or began at another time
   (`exchanges`); once a set is adequate also in those that hold something else, though they leave something;

until a set is adequate, or nothing that is tried makes any likelier. What may be named is decided in `deciding`.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from enginediag_cli.mismatch.explain.answer import Explanation
from enginediag_cli.mismatch.explain.deciding import Deciding
from enginediag_cli.mismatch.explain.exchanges import exchanges, in_rivals, two_for_a_law
from enginediag_cli.mismatch.explain.fitted_sets import OFFERED, FittedSets, Proposer
from enginediag_cli.mismatch.explain.judging import ALIAS, Fits
from enginediag_cli.mismatch.explain.members import (
    MOST_MEMBERS,
    Members,
    add,
    different,
    identity,
    key_of,
    tied,
    too_far,
)
from enginediag_cli.mismatch.explain.pairs import EXTENDED, best_pairs, forward
from enginediag_cli.mismatch.fit.freeform import Cell
from enginediag_cli.mismatch.fit.options import FORMULA_OPTION, FREE, OptionScore
from enginediag_cli.mismatch.fit.trial import HypothesisFit
from enginediag_cli.physics.registry import shared_effects

PAIRS = 4
"""Pairs that are refitted, best by score first, as of single options (`SHORTLIST`)."""
TRIED, TRIED_OF_MANY = 5, 2
"""Sets that are fitted in one round, at most; where there are more records than are searched."""
ROUNDS, ROUNDS_OF_MANY = 12, 2
"""Rounds of growth at most; the first is seldom reached."""
LIKELIER = 1.0
"""By how much of ln evidence a round must bring the search on: less is not worth another one."""
MOST_FITS = 150
"""Sets that are fitted, about at most: a search that finds what acts has needed half of that."""
WITHIN_REACH = 15.0
"""ln evidence that a set may be behind free curves for others to be tried in the place of its members. Judgement."""
RIVAL_ROUNDS = 3
"""Rounds in which other sets may grow where one is settled, at most: they lack as many members as causes differ."""


class Stepwise:
    """The search of sets of one evidence. `best`: the free-form block at the base that a set must beat; `many`: it is
    of few of many records, each of which costs time; `least`: ln evidence against the base that a set must promise."""

    def __init__(
        self,
        fits: Fits,
        best: Cell | None,
        proposers: Sequence[Proposer] = (),
        many: bool = False,
        least: float = -np.inf,
    ):
        self.sets = FittedSets(fits, many)
        self.deciding = Deciding(self.sets, best, proposers)
        self.proposers, self.least = tuple(proposers), least
        effects = [e for o in fits.library for e in o.hypothesis.effects]
        self.places = shared_effects(effects, fits.evidence.engine.network)

    def named(self, singles: Sequence[HypothesisFit], scores: Sequence[OptionScore]) -> list[Explanation]:
        """The alias set of pairs, or of the larger sets that grow from them; empty when none is adequate. `singles`:
        fitted single options, best first; `scores` of all options at the base."""
        sets = self.sets
        pairs: list[Members] = []
        for found in best_pairs(scores, PAIRS):
            add(pairs, tuple(map(sets.fits.timed, found)))
        for wider in forward(sets.fits.library, singles[:EXTENDED]):
            add(pairs, wider)
        fitted = sets.fits.refit(pairs) or []
        named = sets.fits.named([s for s in fitted if sets.fits.counts(s, self.deciding.best)])
        if named and not sets.many:
            named = self._with_rivals(named[0], fitted)
        return self.deciding.unless_outdone(named) or self._grown(self.proposers)

    def _with_rivals(self, first: Explanation, pairs: Sequence[HypothesisFit]) -> list[Explanation]:
        """The alias set of a pair, with what explains as much in the place of either member, or began at another
        time: its own fit without the other did not propose it. Empty where a free curve does in the place of one."""
        sets = self.sets
        trial = sets.fits.fitted[first.label]
        one = tied(trial, self.places)
        other = exchanges(sets, trial, (sets.unlisted,), sets.near(trial))
        more = sets.fits.refit([*other, *([one] if one else [])]) or []
        every = [t for t in (*pairs, *more) if all(o.kind != FREE for o in t.options)]
        # sets of different size compare by their evidence
        weighed = sets.weighed if one else (lambda t: t.weighed)
        ranked = different(sorted(every, key=weighed))
        counting = [t for t in ranked if sets.fits.counts(t, self.deciding.best) and not self.deciding.imitates(t)]
        return sets.fits.named(counting, weighed)

    # growing

    def grown(self, proposers: Sequence[Proposer]) -> list[Explanation]:
        """The alias set of the sets that grow with what these propose beside what is listed; empty when none is
        adequate."""
        return self._grown((*self.proposers, *proposers))

    def with_unlisted(self) -> list[HypothesisFit]:
        """All sets, likeliest first, when free curves have been among what may be a member."""
        self._grown((*self.proposers, self.sets.unlisted), settle=False)
        return self.sets.likeliest()

    def _grown(self, proposers: Sequence[Proposer], settle: bool = True) -> list[Explanation]:
        """Steps until a set of listed options is settled, or none makes the likeliest one likelier; of all sets where
        they are not to `settle`. What promises less than free curves that leave nothing is not tried."""
        sets = self.sets
        alone = self.deciding.only_unlisted()
        least = sets.evidence(sets.fits.base) + self.least
        enough = max(sets.evidence(alone) if sets.is_adequate(alone) else -np.inf, least) - 0.5 * ALIAS
        exchanged, stalled = "", False
        for _ in range(ROUNDS_OF_MANY if sets.many else ROUNDS):
            beam = sets.beam(settle)
            if settle and (named := self.deciding.settled(beam)):
                return self._or_a_rival(named, proposers)
            done = not settle and sets.is_adequate(beam[0])
            new = [] if done or stalled else self._proposed(beam, proposers, enough)
            within = beam[0].label != exchanged and sets.evidence(beam[0]) > enough - WITHIN_REACH
            if not new and within and not (sets.many and settle):
                exchanged = beam[0].label
                new = exchanges(sets, beam[0], proposers, enough)
            if not new:
                return []
            sets.fit(new)
            gained = sets.evidence(best := sets.likeliest(settle)[0]) - sets.evidence(beam[0])
            stalled = gained < LIKELIER or too_far(best, gained) or sets.made > MOST_FITS
        named = self.deciding.settled(sets.beam(settle)) if settle else []
        return self._or_a_rival(named, proposers) if named else []

    def _or_a_rival(self, named: list[Explanation], proposers: Sequence[Proposer]) -> list[Explanation]:
        """What was settled, or what sets that hold something else grow to, where what they leave promises more at once,
        or may in the end: ½ (χ² − χ² of the settled one), less what a member costs, is about all that can be gained.
        Where they promise nothing more members of theirs are exchanged."""
        sets = self.sets
        for _ in range(0 if sets.many else RIVAL_ROUNDS):
            best = sets.fits.fitted[named[0].label]
            own, enough = set(map(identity, best.options)), sets.evidence(best) + 0.5 * ALIAS
            others = [t for t in sets.beam(listed=True) if not set(map(identity, t.options)) <= own]
            floor = sets.prices.least + 0.5 * best.objective
            far = [t for t in others if sets.evidence(t) + 0.5 * t.objective - floor > enough]
            new = [*self._proposed(others, proposers, enough), *self._proposed(far, proposers, -np.inf)]
            new = new or two_for_a_law(sets, best, sets.near(best))
            least = sets.evidence(best) - WITHIN_REACH
            new = new or in_rivals(sets, best, sets.unlisted, least, sets.near(best))
            if not new or sets.made > MOST_FITS:
                break
            sets.fit(list({key_of(n): n for n in new}.values()))
            named = self.deciding.settled(sets.beam(listed=True)) or named
        named = self.deciding.settled(sets.beam(listed=True), proposers) or named
        return self.deciding.unless_outdone(named)

    def _proposed(self, beam: Sequence[HypothesisFit], proposers: Sequence[Proposer], enough: float) -> list[Members]:
        """Sets that were not fitted and promise to be likelier than the one that they grow from, the most promising
        first; and those that something is dropped from. None that promises less than `enough`."""
        sets = self.sets
        promised: list[tuple[float, Members]] = []
        for trial in beam:
            fewer = sets.without_idle(trial)
            promised += [(sets.evidence(trial), other) for other in (fewer, tied(trial, self.places)) if other]
            if len(trial.options) < MOST_MEMBERS:
                for offer in sets.offered(trial, proposers, OFFERED):
                    promised.append((sets.hope(trial, offer), (*trial.options, offer.option)))
        new: list[Members] = []
        for promise, members in sorted(promised, key=lambda p: -p[0]):
            if promise > enough and not sets.known(members):
                add(new, members)
        most = TRIED_OF_MANY if sets.many else TRIED
        of_library = [n for n in new if n[-1].kind not in (FREE, FORMULA_OPTION)]
        return [*of_library[:most], *[n for n in new if n[-1].kind in (FREE, FORMULA_OPTION)][:most]]
