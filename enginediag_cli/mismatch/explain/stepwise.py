"""Sets of options that act together, where no single one explains the evidence.

Pairs first, by their joint score and from what the best singles leave. Where none is adequate sets grow step by step,
whatever their members are, compared in one currency (`currency`):

1. forward: what the best few sets leave proposes the next members (effects, changes in time, and what `proposers` have
   to offer); the most promising are fitted, with everything else anew;
2. backward: a member that is not needed beside the others is dropped;
3. exchange: at the fit without each member, in turn, what explains as much in its place, or began at another time
   (`exchanges`); once a set is adequate also in those that hold something else, though they leave something;

until a set is adequate, or nothing that is tried makes any likelier. What is named must be needed, member by member,
and be likelier than unlisted physics (one free-form block or two), which several listed ones together can imitate.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from enginediag_cli.mismatch.explain.answer import Explanation
from enginediag_cli.mismatch.explain.currency import Offer, Prices
from enginediag_cli.mismatch.explain.exchanges import Proposer, exchanges, in_rivals, two_for_a_law
from enginediag_cli.mismatch.explain.free_members import Unlisted
from enginediag_cli.mismatch.explain.judging import ALIAS, Fits
from enginediag_cli.mismatch.explain.members import (
    MOST_MEMBERS,
    Members,
    add,
    at_once,
    different,
    identity,
    key_of,
    law_places,
    tied,
    too_far,
)
from enginediag_cli.mismatch.explain.pairs import EXTENDED, best_pairs, forward
from enginediag_cli.mismatch.explain.promised import promising
from enginediag_cli.mismatch.explain.rejected import Reason, Rejected
from enginediag_cli.mismatch.fit.freeform import Cell
from enginediag_cli.mismatch.fit.options import FREE, LAW, OptionScore
from enginediag_cli.mismatch.fit.trial_fit import Trial, not_needed
from enginediag_cli.physics.together import kinds_of_places

PAIRS = 4
"""Pairs that are refitted, best by score first, as of single options (`SHORTLIST`)."""
BEAM = 3
"""Sets, likeliest first, whose remainder proposes the next members."""
TRIED_OF_MANY = 2
"""Where there are more records than are searched sets grow from one set, so many at a time."""
ROUNDS, ROUNDS_OF_MANY = 12, 2
"""Rounds of growth at most; the first is seldom reached."""
BESIDE = 2
"""Of these where free curves are among the members: of all sets, and of those with something listed."""
OFFERED, TRIED = 3, 5
"""Members that the remainder of one set proposes, and sets that are fitted in one round, at most."""
UNLISTED, CURVES = 2, 2
"""Free curves that a set must be likelier than, and how many are tried for each of them."""
LIKELIER = 1.0
"""By how much of ln evidence a round must bring the search on: less is not worth another one."""
MOST_FITS = 150
"""Sets that are fitted, about at most: a search that finds what acts has needed half of that."""
WITHIN_REACH = 15.0
"""ln evidence that a set may be behind free curves for others to be tried in the place of its members. Judgement."""
SLACK, ERRS = 5.0, 0.2
"""ln evidence, and share of itself, that what a member promises may err by: it is linear in a large change."""
RIVAL_ROUNDS = 3
"""Rounds in which other sets may grow where one is settled, at most: they lack as many members as causes differ."""
LAWS_APART = 2
"""Of sets without laws, and with a law at one place, the likeliest is grown from in any case."""


class Sets:
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
        self.fits, self.best, self.proposers = fits, best, tuple(proposers)
        self.prices = Prices(fits.library)
        self.unlisted = Unlisted(self.prices, fits.along_drivers)
        effects = [e for o in fits.library for e in o.hypothesis.effects]
        self.places = kinds_of_places(effects, fits.evidence.engine.network)
        self.many, self.least = many, least
        self.beam, self.beside, self.tried = (1, 1, TRIED_OF_MANY) if many else (BEAM, BESIDE, TRIED)
        self._evidence: dict[str, tuple[Trial, float]] = {}
        self._offers: dict[tuple[str, Proposer | None], list[Offer]] = {}
        self._adequate: dict[str, bool] = {}
        self._only_unlisted: Trial | None = None
        self._fits = 0

    def named(self, singles: Sequence[Trial], scores: Sequence[OptionScore]) -> list[Explanation]:
        """The alias set of pairs, or of the larger sets that grow from them; empty when none is adequate. `singles`:
        fitted single options, best first; `scores` of all options at the base."""
        pairs: list[Members] = []
        for found in best_pairs(scores, PAIRS):
            add(pairs, tuple(map(self.fits.timed, found)))
        for wider in forward(self.fits.library, singles[:EXTENDED]):
            add(pairs, wider)
        fitted = self.fits.refit(pairs) or []
        named = self.fits.named([s for s in fitted if self.fits.counts(s, self.best)])
        if named and not self.many:
            named = self._with_rivals(named[0], fitted)
        return self._unless_outdone(named) or self._grown(self.proposers)

    def _with_rivals(self, first: Explanation, pairs: Sequence[Trial]) -> list[Explanation]:
        """The alias set of a pair, with what explains as much in the place of either member, or began at another
        time: its own fit without the other did not propose it. Empty where a free curve does in the place of one."""
        trial = self.fits.fitted[first.label]
        one = tied(trial, self.places)
        other = exchanges(self, trial, (self.unlisted,), self._near(trial))
        more = self.fits.refit([*other, *([one] if one else [])]) or []
        every = [t for t in (*pairs, *more) if all(o.kind != FREE for o in t.options)]
        # sets of different size compare by their evidence
        weighed = (lambda t: -2.0 * self.evidence(t)) if one else (lambda t: t.weighed)
        ranked = different(sorted(every, key=weighed))
        counting = [t for t in ranked if self.fits.counts(t, self.best) and not self._imitates(t)]
        return self.fits.named(counting, weighed)

    # growing

    def grown(self, proposers: Sequence[Proposer]) -> list[Explanation]:
        """The alias set of the sets that grow with what these propose beside what is listed; empty when none is
        adequate."""
        return self._grown((*self.proposers, *proposers))

    def with_unlisted(self) -> list[Trial]:
        """All sets, likeliest first, when free curves have been among what may be a member."""
        self._grown((*self.proposers, self.unlisted), settle=False)
        return self.likeliest()

    def only_unlisted(self) -> Trial:
        """The likeliest set of free curves alone, of none (the base) to UNLISTED of them."""
        if self._only_unlisted is None:
            trial = self.fits.base
            for _ in range(UNLISTED):
                wider = [(*trial.options, o.option) for o in self.offered_by(self.unlisted, trial)[:CURVES]]
                self._fit([w for w in wider if not self.known(w)])
                found = [t for t in map(self._of, wider) if t is not None and t.converged]
                best = max(found, key=self.evidence, default=trial)
                if self.evidence(best) <= self.evidence(trial):
                    break
                trial = best
            self._only_unlisted = trial
        return self._only_unlisted

    def _grown(self, proposers: Sequence[Proposer], settle: bool = True) -> list[Explanation]:
        """Steps until a set of listed options is settled, or none makes the likeliest one likelier; of all sets where
        they are not to `settle`. What promises less than free curves that leave nothing is not tried."""
        alone = self.only_unlisted()
        least = self.evidence(self.fits.base) + self.least
        enough = max(self.evidence(alone) if self._is_adequate(alone) else -np.inf, least) - 0.5 * ALIAS
        exchanged, stalled = "", False
        for _ in range(ROUNDS_OF_MANY if self.many else ROUNDS):
            beam = self._beam(settle)
            if settle and (named := self._settled(beam)):
                return self._or_a_rival(named, proposers)
            done = not settle and self._is_adequate(beam[0])
            new = [] if done or stalled else self._proposed(beam, proposers, enough)
            within = beam[0].label != exchanged and self.evidence(beam[0]) > enough - WITHIN_REACH
            if not new and within and not (self.many and settle):
                exchanged = beam[0].label
                new = exchanges(self, beam[0], proposers, enough)
            if not new:
                return []
            self._fit(new)
            gained = self.evidence(best := self.likeliest(settle)[0]) - self.evidence(beam[0])
            stalled = gained < LIKELIER or too_far(best, gained) or self._fits > MOST_FITS
        named = self._settled(self._beam(settle)) if settle else []
        return self._or_a_rival(named, proposers) if named else []

    def _or_a_rival(self, named: list[Explanation], proposers: Sequence[Proposer]) -> list[Explanation]:
        """What was settled, or what sets that hold something else grow to, where what they leave promises more at once,
        or may in the end: ½ (χ² − χ² of the settled one), less what a member costs, is about all that can be gained.
        Where they promise nothing more members of theirs are exchanged."""
        for _ in range(0 if self.many else RIVAL_ROUNDS):
            best = self.fits.fitted[named[0].label]
            own, enough = set(map(identity, best.options)), self.evidence(best) + 0.5 * ALIAS
            others = [t for t in self._beam(listed=True) if not set(map(identity, t.options)) <= own]
            floor = self.prices.least + 0.5 * best.objective
            far = [t for t in others if self.evidence(t) + 0.5 * t.objective - floor > enough]
            new = [*self._proposed(others, proposers, enough), *self._proposed(far, proposers, -np.inf)]
            new = new or two_for_a_law(self, best, self._near(best))
            new = new or in_rivals(self, best, self.unlisted, self.evidence(best) - WITHIN_REACH, self._near(best))
            if not new or self._fits > MOST_FITS:
                break
            self._fit(list({key_of(n): n for n in new}.values()))
            named = self._settled(self._beam(listed=True)) or named
        named = self._settled(self._beam(listed=True), proposers) or named
        return self._unless_outdone(named)

    def _unless_outdone(self, named: list[Explanation]) -> list[Explanation]:
        """Nothing where a likelier set leaves something: that one is right in what it shares with the truth."""
        told = self.evidence(self.fits.fitted[named[0].label]) if named else np.inf
        best = next(t for t in self.likeliest(listed=True) if not (named and self._without_idle(t)))
        return named if self.evidence(best) <= told + 0.5 * ALIAS else []

    def _beam(self, listed: bool) -> list[Trial]:
        """Sets to grow from, likeliest first; where free curves may be members, as many that hold something listed."""
        ranked = different(self.likeliest(listed))
        if listed:
            # several laws that imitate what is listed would crowd out the sets that hold it
            of_laws = [next((t for t in ranked if law_places(t) == n), None) for n in range(LAWS_APART)]
            apart = [t for t in of_laws if t is not None and not self.many]
            return list({t.label: t for t in (*ranked[: self.beam], *apart)}.values())
        named = [t for t in ranked if any(o.kind != FREE for o in t.options)]
        return list({t.label: t for t in (*ranked[: self.beside], *named[: self.beside])}.values())

    def likeliest(self, listed: bool = False) -> list[Trial]:
        """All that was fitted, the base too, likeliest first; or what has no free curve."""
        trials = [self.fits.base, *(t for t in self.fits.fitted.values() if t.converged and self._priced(t))]
        trials = [t for t in trials if not (listed and any(o.kind == FREE for o in t.options))]
        return sorted(trials, key=lambda t: (-self.evidence(t), t.label))

    def _priced(self, trial: Trial) -> bool:
        """Whether its members were offered here: laws that were tried elsewhere have prices of their own."""
        return all(o.kind != LAW or o.label in self.prices.own for o in trial.options)

    def evidence(self, trial: Trial) -> float:
        """ln p(y, S) of the trial's set."""
        known = self._evidence.get(trial.label)
        # an average or a curve of the same variables at the same place has the same name when it is another
        if known is None or known[0] is not trial:
            known = self._evidence[trial.label] = trial, self.prices.evidence(trial)
        return known[1]

    def fitted(self, members: Members) -> Trial | None:
        """The fit of these members, made where there is none; None where it did not settle."""
        if not self.known(members):
            self._fit([members])
        trial = self._of(members)
        return trial if trial is not None and trial.converged else None

    def _fit(self, sets: Sequence[Members]) -> None:
        """Fit them; only the rows of what is likeliest are held."""
        self._fits += len(sets)
        self.fits.refit(sets)
        for trial in self.likeliest()[BEAM:]:
            if trial is not self.fits.base:
                trial.projection.rest()

    def _of(self, members: Members) -> Trial | None:
        every = (self.fits.base, *self.fits.fitted.values())
        return next((t for t in every if key_of(t.options) == key_of(members)), None)

    def known(self, members: Members) -> bool:
        """Whether they were fitted, in whatever order."""
        return self._of(members) is not None

    def _proposed(self, beam: Sequence[Trial], proposers: Sequence[Proposer], enough: float) -> list[Members]:
        """Sets that were not fitted and promise to be likelier than the one that they grow from, the most promising
        first; and those that something is dropped from. None that promises less than `enough`."""
        promised: list[tuple[float, Members]] = []
        for trial in beam:
            fewer = self._without_idle(trial)
            promised += [(self.evidence(trial), other) for other in (fewer, tied(trial, self.places)) if other]
            if len(trial.options) < MOST_MEMBERS:
                for offer in self.offered(trial, proposers, OFFERED):
                    promised.append((self.hope(trial, offer), (*trial.options, offer.option)))
        new: list[Members] = []
        for promise, members in sorted(promised, key=lambda p: -p[0]):
            if promise > enough and not self.known(members):
                add(new, members)
        of_library = [n for n in new if n[-1].kind not in (FREE, LAW)]
        return [*of_library[: self.tried], *[n for n in new if n[-1].kind in (FREE, LAW)][: self.tried]]

    def _near(self, trial: Trial) -> float:
        """The evidence that what is tried beside a settled trial must promise: to be told with it, as far as known."""
        return self.evidence(trial) - 0.5 * ALIAS - SLACK

    def hope(self, trial: Trial, offer: Offer) -> float:
        """The evidence with the offer that its promise does not exclude."""
        return self.evidence(trial) + (1.0 + ERRS) * offer.gain

    def offered(self, trial: Trial, proposers: Sequence[Proposer], most: int) -> list[Offer]:
        """What the remainder of a trial proposes that promises a gain: the `most` best of what is listed, and of each
        proposer's, which would outbid all that is listed, since a free curve is next to what it imitates."""
        return [*self._listed(trial)[:most], *(o for p in proposers for o in self.offered_by(p, trial)[:most])]

    def offered_by(self, proposer: Proposer, trial: Trial) -> list[Offer]:
        """What a proposer offers beside what a trial has that promises a gain, most first."""
        key = trial.label, proposer
        if key not in self._offers:
            found = [o for o in proposer(trial) if not set(o.option.hypothesis.names) & set(trial.hypothesis.names)]
            self.prices.own |= {o.option.label: o.price for o in found}
            self._offers[key] = sorted((o for o in found if o.gain > 0.0), key=lambda o: (-o.gain, o.option.label))
        return self._offers[key]

    def _listed(self, trial: Trial) -> list[Offer]:
        key = trial.label, None
        if key not in self._offers:
            left = self.fits.left(trial)
            self._adequate[trial.label] = not (left.unranked or left.over(self.fits.adequate))
            self._offers[key] = promising(self.prices, trial, left.scores, OFFERED + 1)
        return self._offers[key]

    # deciding

    def _settled(self, beam: Sequence[Trial], proposers: Sequence[Proposer] = ()) -> list[Explanation]:
        """The alias set of the likeliest sets, where one of them is adequate. What is proposed is tried in the place of
        each member that is no law: it may imitate unlisted physics."""
        good = self._good(beam)
        if good is None:
            return []
        best = -np.inf
        while good is not None and self.evidence(good) > best:
            best = self.evidence(good)
            listed = [o for o in good.options if o.kind != LAW]
            new = exchanges(self, good, (*self.proposers, self.unlisted), self._near(good))
            for other in exchanges(self, good, proposers, self._near(good), listed):
                add(new, other)
            self._fit(new)
            good = self._good(self._beam(listed=True))
        near = [t for t in self.likeliest(listed=True) if self.evidence(t) >= best - 0.5 * ALIAS and at_once(t) > 1]
        near = different([t for t in near if self._counts(t) and not self._imitates(t)])
        return self.fits.named(near, lambda t: -2.0 * self.evidence(t))

    def _good(self, beam: Sequence[Trial]) -> Trial | None:
        """The likeliest set that is adequate and counts, what is not needed dropped."""
        for _ in range(MOST_MEMBERS):
            fewer = [f for f in map(self._without_idle, beam) if f and not self.known(f)]
            if not fewer:
                break
            self._fit(fewer)
            beam = self._beam(listed=True)
        return next((t for t in beam if at_once(t) > 1 and self._is_adequate(t) and self._counts(t)), None)

    def leaves_to_a_curve(self, label: str) -> bool:
        """Whether a set with a free curve leaves less than this one, at two of χ² for each coefficient: what a curve
        costs besides, since it may be any, a law of few does not."""
        told = self.fits.fitted.get(label)
        return told is not None and any(_paid(t) < _paid(told) for t in self._with_curves())

    def _with_curves(self) -> list[Trial]:
        """Sets that hold a free curve, likeliest first."""
        return [t for t in self.likeliest() if any(o.kind == FREE for o in t.options)]

    def _imitates(self, trial: Trial) -> bool:
        """Whether a set with a free curve is likelier: members of this one imitate unlisted physics then. What such a
        set does not need is dropped first."""
        for _ in trial.options:
            fewer = [f for f in map(self._without_idle, self._with_curves()[: self.beam]) if f and not self.known(f)]
            if not fewer:
                break
            self._fit(fewer)
        mixed = self._with_curves()
        own = {identity(o) for o in trial.options if o.kind != LAW}
        if len(own) < len(trial.options):
            # a curve in the place of a law says no more of what is listed beside it
            mixed = [t for t in mixed if not own <= set(map(identity, t.options))]
        if not mixed or self.evidence(mixed[0]) <= self.evidence(trial):
            return False
        self.fits.rejected[trial.label] = Rejected(Reason.ONE_UNLISTED)
        return True

    def _without_idle(self, trial: Trial) -> Members:
        """Its members but for one that is not needed; none where all are."""
        idle = not_needed(trial, self.fits.adequate.effects)
        return tuple(o for o in trial.options if o.label != idle) if idle and len(trial.options) > 1 else ()

    def _is_adequate(self, trial: Trial) -> bool:
        self._listed(trial)
        return self._adequate[trial.label]

    def _counts(self, trial: Trial) -> bool:
        """Whether a set of listed options, each of them needed, is likelier than unlisted physics."""
        if not self.fits.counts(trial, self.best):
            return False
        if len(trial.options) <= 2 or self.evidence(trial) > self.evidence(self.only_unlisted()):
            return True
        self.fits.rejected[trial.label] = Rejected(Reason.ONE_UNLISTED)
        return False


def _paid(trial: Trial) -> float:
    """χ² that a trial leaves, and two for each coefficient (H. Akaike, 1974)."""
    return trial.objective + 2.0 * len(trial.hypothesis.names)
