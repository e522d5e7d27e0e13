"""Which of the sets that were fitted may be named: adequate, needed member by member, and likelier than unlisted
physics (one free-form block or two), which several listed ones together can imitate."""

from __future__ import annotations

from collections.abc import Sequence

from enginediag_cli.mismatch.explain.answer import Explanation
from enginediag_cli.mismatch.explain.exchanges import exchanges
from enginediag_cli.mismatch.explain.fitted_sets import FittedSets, Proposer
from enginediag_cli.mismatch.explain.judging import ALIAS
from enginediag_cli.mismatch.explain.members import MOST_MEMBERS, add, at_once, different, identity
from enginediag_cli.mismatch.explain.rejected import Reason, Rejected
from enginediag_cli.mismatch.fit.freeform import Cell
from enginediag_cli.mismatch.fit.options import FORMULA_OPTION, FREE
from enginediag_cli.mismatch.fit.trial import HypothesisFit

UNLISTED, CURVES = 2, 2
"""Free curves that a set must be likelier than, and how many are tried for each of them."""


class Deciding:
    """`best`: the free-form block at the base that a set must beat; `proposers`: of what may replace a member."""

    def __init__(self, sets: FittedSets, best: Cell | None, proposers: Sequence[Proposer] = ()):
        self.sets, self.best, self.proposers = sets, best, tuple(proposers)
        self._only_unlisted: HypothesisFit | None = None

    def only_unlisted(self) -> HypothesisFit:
        """The likeliest set of free curves alone, of none (the base) to UNLISTED of them."""
        sets = self.sets
        if self._only_unlisted is None:
            trial = sets.fits.base
            for _ in range(UNLISTED):
                wider = [(*trial.options, o.option) for o in sets.offered_by(sets.unlisted, trial)[:CURVES]]
                sets.fit([w for w in wider if not sets.known(w)])
                found = [t for t in map(sets.of, wider) if t is not None and t.converged]
                best = max(found, key=sets.evidence, default=trial)
                if sets.evidence(best) <= sets.evidence(trial):
                    break
                trial = best
            self._only_unlisted = trial
        return self._only_unlisted

    def settled(self, beam: Sequence[HypothesisFit], proposers: Sequence[Proposer] = ()) -> list[Explanation]:
        """The alias set of the likeliest sets, where one of them is adequate. What is proposed is tried in the place of
        each member that is no law: it may imitate unlisted physics."""
        sets, good, best = self.sets, self._good(beam), float("-inf")
        if good is None:
            return []
        while good is not None and sets.evidence(good) > best:
            best = sets.evidence(good)
            listed = [o for o in good.options if o.kind != FORMULA_OPTION]
            new = exchanges(sets, good, (*self.proposers, sets.unlisted), sets.near(good))
            for other in exchanges(sets, good, proposers, sets.near(good), listed):
                add(new, other)
            sets.fit(new)
            good = self._good(sets.beam(listed=True))
        near = [t for t in sets.likeliest(listed=True) if sets.evidence(t) >= best - 0.5 * ALIAS and at_once(t) > 1]
        near = different([t for t in near if self._counts(t) and not self.imitates(t)])
        return sets.fits.named(near, sets.weighed)

    def _good(self, beam: Sequence[HypothesisFit]) -> HypothesisFit | None:
        """The likeliest set that is adequate and counts, what is not needed dropped."""
        sets = self.sets
        for _ in range(MOST_MEMBERS):
            fewer = [f for f in map(sets.without_idle, beam) if f and not sets.known(f)]
            if not fewer:
                break
            sets.fit(fewer)
            beam = sets.beam(listed=True)
        return next((t for t in beam if at_once(t) > 1 and sets.is_adequate(t) and self._counts(t)), None)

    def unless_outdone(self, named: list[Explanation]) -> list[Explanation]:
        """Nothing where a likelier set leaves something: that one is right in what it shares with the truth."""
        sets = self.sets
        told = sets.evidence(sets.fits.fitted[named[0].label]) if named else float("inf")
        best = next(t for t in sets.likeliest(listed=True) if not (named and sets.without_idle(t)))
        return named if sets.evidence(best) <= told + 0.5 * ALIAS else []

    def leaves_to_a_curve(self, label: str) -> bool:
        """Whether a set with a free curve leaves less than this one, at two of χ² for each coefficient: what a curve
        costs besides, since it may be any, a law of few does not."""
        told = self.sets.fits.fitted.get(label)
        return told is not None and any(_paid(t) < _paid(told) for t in self._with_curves())

    def imitates(self, trial: HypothesisFit) -> bool:
        """Whether a set with a free curve is likelier: members of this one imitate unlisted physics then. What such a
        set does not need is dropped first."""
        sets = self.sets
        for _ in trial.options:
            tried = self._with_curves()[: sets.grown_from]
            fewer = [f for f in map(sets.without_idle, tried) if f and not sets.known(f)]
            if not fewer:
                break
            sets.fit(fewer)
        mixed = self._with_curves()
        own = {identity(o) for o in trial.options if o.kind != FORMULA_OPTION}
        if len(own) < len(trial.options):
            # a curve in the place of a law says no more of what is listed beside it
            mixed = [t for t in mixed if not own <= set(map(identity, t.options))]
        if not mixed or sets.evidence(mixed[0]) <= sets.evidence(trial):
            return False
        sets.fits.rejected[trial.label] = Rejected(Reason.ONE_UNLISTED)
        return True

    def _with_curves(self) -> list[HypothesisFit]:
        """Sets that hold a free curve, likeliest first."""
        return [t for t in self.sets.likeliest() if any(o.kind == FREE for o in t.options)]

    def _counts(self, trial: HypothesisFit) -> bool:
        """Whether a set of listed options, each of them needed, is likelier than unlisted physics."""
        sets = self.sets
        if not sets.fits.counts(trial, self.best):
            return False
        if len(trial.options) <= 2 or sets.evidence(trial) > sets.evidence(self.only_unlisted()):
            return True
        sets.fits.rejected[trial.label] = Rejected(Reason.ONE_UNLISTED)
        return False


def _paid(trial: HypothesisFit) -> float:
    """χ² that a trial leaves, and two for each coefficient (H. Akaike, 1974)."""
    return trial.objective + 2.0 * len(trial.hypothesis.names)
