"""Sets of options that act together, where no single one explains the evidence.

Pairs first, by their joint score and from what the best singles leave. Where none is adequate sets grow step by step,
whatever their members are, compared in one currency (`currency`):

1. forward: what the best few sets leave proposes the next members (effects, changes in time, and what `proposers` have
   to offer); the most promising are fitted, with everything else anew;
2. backward: a member that is not needed beside the others is dropped;
3. exchange: at the fit without each member, in turn, what explains as much in its place, or began at another time;

until a set is adequate, or nothing that is tried makes any likelier. What is named must be needed, member by member,
and be likelier than unlisted physics (one free-form block or two), which several listed ones together can imitate.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import replace

import numpy as np

from enginediag_cli.drivers import TIME
from enginediag_cli.mismatch.explain.answer import Explanation
from enginediag_cli.mismatch.explain.currency import Offer, Prices, scales_of
from enginediag_cli.mismatch.explain.free_members import Unlisted
from enginediag_cli.mismatch.explain.judging import ALIAS, Fits
from enginediag_cli.mismatch.explain.pairs import best_pairs
from enginediag_cli.mismatch.explain.rejected import Reason, Rejected
from enginediag_cli.mismatch.fit.freeform import Cell
from enginediag_cli.mismatch.fit.options import FREE, LAW, Option, OptionScore, with_best_onset
from enginediag_cli.mismatch.fit.trial_fit import Trial, not_needed, remainder

PAIRS = 4
"""Pairs that are refitted, best by score first, as of single options (`SHORTLIST`)."""
EXTENDED = 2
"""Of the best singles, how many are extended to pairs by what they leave."""
MOST_MEMBERS = 6
"""Options that may act together at most. Judgement: more together is better told as unlisted physics."""
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
WITHIN_REACH = 15.0
"""ln evidence that a set may be behind free curves for others to be tried in the place of its members. Judgement."""
SLACK, ERRS = 5.0, 0.2
"""ln evidence, and share of itself, that what a member promises may err by: it is linear in a large change."""
EXCHANGED = 2
"""Options that are tried in the place of each member of a set."""

Members = tuple[Option, ...]
Settled = Callable[[Sequence[Trial]], list[Explanation]]
Proposer = Callable[[Trial], Sequence[Offer]]
"""Offers further options for what a trial leaves: what no library holds."""


def forward(fits: Fits, singles: Sequence[Trial]) -> list[Members]:
    """Each single option with the effect, and with the change in time, that says most about what it leaves."""
    wider: list[Members] = []
    for trial in singles:
        left = remainder(trial, fits.library, ())
        for timed in (False, True):
            best = next((s for s in left.scores if (s.option.driver == TIME) == timed and s.surprise > 0.0), None)
            if best is not None:
                _add(wider, (*trial.options, with_best_onset(trial.found, trial.projection, best.option)))
    return wider


class Sets:
    """The search of sets of one evidence. `best`: the free-form block at the base that a set must beat; `many`: it is
    of few of many records, each of which costs time."""

    def __init__(self, fits: Fits, best: Cell | None, proposers: Sequence[Proposer] = (), many: bool = False):
        self.fits, self.best, self.proposers = fits, best, tuple(proposers)
        self.prices = Prices(fits.library)
        self.unlisted = Unlisted(self.prices, fits.along_drivers)
        self.many = many
        self.beam, self.beside, self.tried = (1, 1, TRIED_OF_MANY) if many else (BEAM, BESIDE, TRIED)
        self._evidence: dict[str, float] = {}
        self._offers: dict[tuple[str, Proposer | None], list[Offer]] = {}
        self._adequate: dict[str, bool] = {}
        self._only_unlisted: Trial | None = None

    def named(self, singles: Sequence[Trial], scores: Sequence[OptionScore]) -> list[Explanation]:
        """The alias set of pairs, or of the larger sets that grow from them; empty when none is adequate. `singles`:
        fitted single options, best first; `scores` of all options at the base."""
        pairs: list[Members] = []
        for found in best_pairs(scores, PAIRS):
            _add(pairs, tuple(map(self.fits.timed, found)))
        for wider in forward(self.fits, singles[:EXTENDED]):
            _add(pairs, wider)
        fitted = self.fits.refit(pairs) or []
        named = self.fits.named([s for s in fitted if self.fits.counts(s, self.best)])
        if named and not self.many:
            named = self._with_rivals(named[0], fitted)
        return named or self._grown(self.proposers, self._settled)

    def _with_rivals(self, first: Explanation, pairs: Sequence[Trial]) -> list[Explanation]:
        """The alias set of a pair, with what explains as much in the place of either member, or began at another
        time: its own fit without the other did not propose it. Empty where a free curve does in the place of one."""
        trial = self.fits.fitted[first.label]
        reach = self.evidence(trial) - 0.5 * ALIAS - SLACK
        more = self.fits.refit(self._exchanges(trial, (self.unlisted,), reach)) or []
        every = [t for t in (*pairs, *more) if all(o.kind != FREE for o in t.options)]
        ranked = _different(sorted(every, key=lambda t: t.weighed))
        return self.fits.named([t for t in ranked if self.fits.counts(t, self.best) and not self._imitates(t)])

    # growing

    def with_unlisted(self) -> list[Trial]:
        """All sets, likeliest first, when free curves have been among what may be a member."""
        self._grown((*self.proposers, self.unlisted), None)
        return self.likeliest()

    def only_unlisted(self) -> Trial:
        """The likeliest set of free curves alone, of none (the base) to UNLISTED of them."""
        if self._only_unlisted is None:
            trial = self.fits.base
            for _ in range(UNLISTED):
                wider = [(*trial.options, o.option) for o in self._offered_by(self.unlisted, trial)[:CURVES]]
                self._fit([w for w in wider if not self._known(w)])
                found = [t for t in map(self._of, wider) if t is not None and t.converged]
                best = max(found, key=self.evidence, default=trial)
                if self.evidence(best) <= self.evidence(trial):
                    break
                trial = best
            self._only_unlisted = trial
        return self._only_unlisted

    def _grown(self, proposers: Sequence[Proposer], settled: Settled | None) -> list[Explanation]:
        """Steps until a set of listed options is `settled`, or none makes the likeliest one likelier; of all sets where
        nothing settles them. What promises less than free curves that leave nothing is not tried."""
        alone = self.only_unlisted()
        enough = self.evidence(alone) - 0.5 * ALIAS if self._is_adequate(alone) else -np.inf
        exchanged, stalled, listed = "", False, settled is not None
        for _ in range(ROUNDS_OF_MANY if self.many else ROUNDS):
            beam = self._beam(listed)
            named = settled(beam) if settled is not None else []
            if named:
                return named
            done = settled is None and self._is_adequate(beam[0])
            new = [] if done or stalled else self._proposed(beam, proposers, enough)
            within = beam[0].label != exchanged and self.evidence(beam[0]) > enough - WITHIN_REACH
            if not new and within and not (self.many and listed):
                exchanged = beam[0].label
                new = self._exchanges(beam[0], proposers, enough)
            if not new:
                return []
            self._fit(new)
            stalled = self.evidence(self.likeliest(listed)[0]) < self.evidence(beam[0]) + LIKELIER
        return settled(self._beam(listed)) if settled is not None else []

    def _beam(self, listed: bool) -> list[Trial]:
        """Sets to grow from, likeliest first; where free curves may be members, as many that hold something listed."""
        ranked = _different(self.likeliest(listed))
        if listed:
            return ranked[: self.beam]
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
        if trial.label not in self._evidence:
            self._evidence[trial.label] = self.prices.evidence(trial)
        return self._evidence[trial.label]

    def fitted(self, members: Members) -> Trial | None:
        """The fit of these members, made where there is none; None where it did not settle."""
        if not self._known(members):
            self._fit([members])
        trial = self._of(members)
        return trial if trial is not None and trial.converged else None

    def _fit(self, sets: Sequence[Members]) -> None:
        """Fit them; only the rows of what is likeliest are held."""
        self.fits.refit(sets)
        for trial in self.likeliest()[BEAM:]:
            if trial is not self.fits.base:
                trial.projection.rest()

    def _of(self, members: Members) -> Trial | None:
        key = _key(members)
        every = (self.fits.base, *self.fits.fitted.values())
        return next((t for t in every if _key(t.options) == key), None)

    def _known(self, members: Members) -> bool:
        return self._of(members) is not None

    def _proposed(self, beam: Sequence[Trial], proposers: Sequence[Proposer], enough: float) -> list[Members]:
        """Sets that were not fitted and promise to be likelier than the one that they grow from, the most promising
        first; and those that something is dropped from. None that promises less than `enough`."""
        promised: list[tuple[float, Members]] = []
        for trial in beam:
            fewer = self._without_idle(trial)
            if fewer:
                promised.append((self.evidence(trial), fewer))
            if len(trial.options) < MOST_MEMBERS:
                for offer in self._offered(trial, proposers, OFFERED):
                    promised.append((self._hope(trial, offer), (*trial.options, offer.option)))
        new: list[Members] = []
        for promise, members in sorted(promised, key=lambda p: -p[0]):
            if promise > enough and not self._known(members):
                _add(new, members)
        of_library = [n for n in new if n[-1].kind not in (FREE, LAW)]
        return [*of_library[: self.tried], *[n for n in new if n[-1].kind in (FREE, LAW)][: self.tried]]

    def _hope(self, trial: Trial, offer: Offer) -> float:
        """The evidence with the offer that its promise does not exclude."""
        return self.evidence(trial) + (1.0 + ERRS) * offer.gain

    def _offered(self, trial: Trial, proposers: Sequence[Proposer], most: int) -> list[Offer]:
        """What the remainder of a trial proposes that promises a gain: the `most` best of what is listed, and of each
        proposer's, which would outbid all that is listed, since a free curve is next to what it imitates."""
        return [*self._listed(trial)[:most], *(o for p in proposers for o in self._offered_by(p, trial)[:most])]

    def _offered_by(self, proposer: Proposer, trial: Trial) -> list[Offer]:
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
            self._offers[key] = self._promising(trial, left.scores)
        return self._offers[key]

    def _promising(self, trial: Trial, scores: Iterable[OptionScore]) -> list[Offer]:
        best: dict[tuple[str, ...], Offer] = {}
        for s in scores:
            if s.score.absorbed or not s.feasible or _clashes(s.option, trial.options):
                continue
            price, own = self.prices.of(s.option), identity(s.option)
            gain = self.prices.promise(s, scales_of(s.option), price)
            if gain > 0.0 and (own not in best or gain > best[own].gain):
                best[own] = Offer(s.option, price, gain)
        found = sorted(best.values(), key=lambda o: (-o.gain, o.option.label))[: OFFERED + 1]
        return [replace(o, option=with_best_onset(trial.found, trial.projection, o.option)) for o in found]

    def _exchanges(self, trial: Trial, proposers: Sequence[Proposer], enough: float) -> list[Members]:
        """Sets with another option, or another time, in the place of one member, that promise more than `enough`."""
        new: list[Members] = []
        for member in trial.options:
            others = tuple(o for o in trial.options if o is not member)
            without = self.fitted(others)
            if without is None:
                continue
            for offer in self._offered(without, proposers, EXCHANGED + 1):
                if offer.option.label == member.label:
                    continue
                if self._hope(without, offer) > enough and not self._known((*others, offer.option)):
                    _add(new, (*others, offer.option))
        return new

    # deciding

    def _settled(self, beam: Sequence[Trial]) -> list[Explanation]:
        """The alias set of the likeliest sets, where one of them is adequate."""
        good = next((t for t in beam if len(t.options) > 1 and self._is_adequate(t) and self._counts(t)), None)
        if good is None:
            return []
        reach = self.evidence(good) - 0.5 * ALIAS
        self._fit(self._exchanges(good, (*self.proposers, self.unlisted), reach - SLACK))
        near = [t for t in self.likeliest(listed=True) if self.evidence(t) >= reach and len(t.options) > 1]
        near = _different([t for t in near if self._counts(t) and not self._imitates(t)])
        return self.fits.named(near, lambda t: -2.0 * self.evidence(t))

    def _imitates(self, trial: Trial) -> bool:
        """Whether a set with a free curve is likelier: members of this one imitate unlisted physics then. What such a
        set does not need is dropped first."""
        for _ in trial.options:
            mixed = [t for t in self.likeliest() if any(o.kind == FREE for o in t.options)][: self.beam]
            fewer = [f for f in map(self._without_idle, mixed) if f and not self._known(f)]
            if not fewer:
                break
            self._fit(fewer)
        mixed = [t for t in self.likeliest() if any(o.kind == FREE for o in t.options)]
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
        if len(trial.options) == 2 or self.evidence(trial) > self.evidence(self.only_unlisted()):
            return True
        self.fits.rejected[trial.label] = Rejected(Reason.ONE_UNLISTED)
        return False


def identity(option: Option) -> tuple[str, ...]:
    """What it is, whenever it began and at whatever size it is tried."""
    if option.driver == TIME:
        return tuple(d.target for d in option.hypothesis.discrepancies)
    return (option.label,)


def _different(trials: Sequence[Trial]) -> list[Trial]:
    """The first of those that hold the same: begun at another time they are no rivals."""
    first: dict[frozenset[tuple[str, ...]], Trial] = {}
    for t in trials:
        first.setdefault(frozenset(map(identity, t.options)), t)
    return list(first.values())


def _clashes(option: Option, members: Sequence[Option]) -> bool:
    """Whether it is no further thing beside the members: another change in time of the same component."""
    return option.driver == TIME and any(o.driver == TIME and o.component == option.component for o in members)


def _key(members: Sequence[Option]) -> frozenset[str]:
    return frozenset(o.label for o in members)


def _add(sets: list[Members], new: Members) -> None:
    """Adds a set that is not there yet, in whatever order."""
    if not any(_key(new) == _key(other) for other in sets):
        sets.append(new)
