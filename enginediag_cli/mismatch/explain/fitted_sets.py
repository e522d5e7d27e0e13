"""Sets of options of one evidence, as far as they were fitted: how likely each is, and what it leaves proposes.

A set is a rival of every other whatever its size and kind: all are compared in one currency (`currency`). What one more
member promises is linear in a change that may be large; `hope` allows for what it errs by.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

from enginediag_cli.mismatch.explain.currency import Offer, Prices
from enginediag_cli.mismatch.explain.free_members import Unlisted
from enginediag_cli.mismatch.explain.judging import ALIAS, Fits
from enginediag_cli.mismatch.explain.members import Members, different, key_of, law_places
from enginediag_cli.mismatch.explain.promised import promising
from enginediag_cli.mismatch.fit.needed import not_needed
from enginediag_cli.mismatch.fit.options import FORMULA_OPTION, FREE
from enginediag_cli.mismatch.fit.trial import HypothesisFit

Proposer = Callable[[HypothesisFit], Sequence[Offer]]
"""Offers further options for what a trial leaves: what no library holds."""

BEAM = 3
"""Sets, likeliest first, whose remainder proposes the next members."""
BESIDE = 2
"""Of these where free curves are among the members: of all sets, and of those with something listed."""
LAWS_APART = 2
"""Of sets without laws, and with a law at one place, the likeliest is grown from in any case."""
OFFERED = 3
"""Members that the remainder of one set proposes."""
SLACK, ERRS = 5.0, 0.2
"""ln evidence, and share of itself, that what a member promises may err by: it is linear in a large change."""


class FittedSets:
    """`many`: of few of many records, each of which costs time: sets grow from one of them only."""

    def __init__(self, fits: Fits, many: bool = False):
        self.fits, self.many, self.made = fits, many, 0
        self.grown_from = 1 if many else BEAM
        self.prices = Prices(fits.library)
        self.unlisted = Unlisted(self.prices, fits.along_drivers)
        self._evidence: dict[str, tuple[HypothesisFit, float]] = {}
        self._offers: dict[tuple[str, Proposer | None], list[Offer]] = {}
        self._adequate: dict[str, bool] = {}

    # what was fitted

    def likeliest(self, listed: bool = False) -> list[HypothesisFit]:
        """All that was fitted, the base too, likeliest first; or what has no free curve."""
        trials = [self.fits.base, *(t for t in self.fits.fitted.values() if t.converged and self._priced(t))]
        trials = [t for t in trials if not (listed and any(o.kind == FREE for o in t.options))]
        return sorted(trials, key=lambda t: (-self.evidence(t), t.label))

    def beam(self, listed: bool) -> list[HypothesisFit]:
        """Sets to grow from, likeliest first; where free curves may be members, as many that hold something listed."""
        ranked = different(self.likeliest(listed))
        if listed:
            # several laws that imitate what is listed would crowd out the sets that hold it
            of_laws = [next((t for t in ranked if law_places(t) == n), None) for n in range(LAWS_APART)]
            apart = [t for t in of_laws if t is not None and not self.many]
            return list({t.label: t for t in (*ranked[: self.grown_from], *apart)}.values())
        named, beside = [t for t in ranked if any(o.kind != FREE for o in t.options)], 1 if self.many else BESIDE
        return list({t.label: t for t in (*ranked[:beside], *named[:beside])}.values())

    def evidence(self, trial: HypothesisFit) -> float:
        """ln p(y, S) of the trial's set."""
        known = self._evidence.get(trial.label)
        # an average or a curve of the same variables at the same place has the same name when it is another
        if known is None or known[0] is not trial:
            known = self._evidence[trial.label] = trial, self.prices.evidence(trial)
        return known[1]

    def weighed(self, trial: HypothesisFit) -> float:
        """−2 ln p(y, S), which compares as χ² does."""
        return -2.0 * self.evidence(trial)

    def fitted(self, members: Members) -> HypothesisFit | None:
        """The fit of these members, made where there is none; None where it did not settle."""
        if not self.known(members):
            self.fit([members])
        trial = self.of(members)
        return trial if trial is not None and trial.converged else None

    def fit(self, sets: Sequence[Members]) -> None:
        """Fit them; only the rows of what is likeliest are held."""
        self.made += len(sets)
        self.fits.refit(sets)
        for trial in self.likeliest()[BEAM:]:
            if trial is not self.fits.base:
                trial.projection.rest()

    def of(self, members: Members) -> HypothesisFit | None:
        """The fit of these members, in whatever order; None where there is none."""
        every = (self.fits.base, *self.fits.fitted.values())
        return next((t for t in every if key_of(t.options) == key_of(members)), None)

    def known(self, members: Members) -> bool:
        """Whether they were fitted, in whatever order."""
        return self.of(members) is not None

    def without_idle(self, trial: HypothesisFit) -> Members:
        """Its members but for one that is not needed; none where all are."""
        idle = not_needed(trial, self.fits.adequate.effects)
        return tuple(o for o in trial.options if o.label != idle) if idle and len(trial.options) > 1 else ()

    def is_adequate(self, trial: HypothesisFit) -> bool:
        """Whether nothing listed is over a gate in what it leaves."""
        self._listed(trial)
        return self._adequate[trial.label]

    def _priced(self, trial: HypothesisFit) -> bool:
        """Whether its members were offered here: laws that were tried elsewhere have prices of their own."""
        return all(o.kind != FORMULA_OPTION or o.label in self.prices.own for o in trial.options)

    # what may join

    def near(self, trial: HypothesisFit) -> float:
        """The evidence that what is tried beside a settled trial must promise: to be told with it, as far as known."""
        return self.evidence(trial) - 0.5 * ALIAS - SLACK

    def hope(self, trial: HypothesisFit, offer: Offer) -> float:
        """The evidence with the offer that its promise does not exclude."""
        return self.evidence(trial) + (1.0 + ERRS) * offer.gain

    def offered(self, trial: HypothesisFit, proposers: Sequence[Proposer], most: int) -> list[Offer]:
        """What the remainder of a trial proposes that promises a gain: the `most` best of what is listed, and of each
        proposer's, which would outbid all that is listed, since a free curve is next to what it imitates."""
        return [*self._listed(trial)[:most], *(o for p in proposers for o in self.offered_by(p, trial)[:most])]

    def offered_by(self, proposer: Proposer, trial: HypothesisFit) -> list[Offer]:
        """What a proposer offers beside what a trial has that promises a gain, most first."""
        key = trial.label, proposer
        if key not in self._offers:
            found = [o for o in proposer(trial) if not set(o.option.hypothesis.names) & set(trial.hypothesis.names)]
            self.prices.own |= {o.option.label: o.price for o in found}
            self._offers[key] = sorted((o for o in found if o.gain > 0.0), key=lambda o: (-o.gain, o.option.label))
        return self._offers[key]

    def _listed(self, trial: HypothesisFit) -> list[Offer]:
        key = trial.label, None
        if key not in self._offers:
            left = self.fits.left(trial)
            self._adequate[trial.label] = not (left.unranked or left.over(self.fits.adequate))
            self._offers[key] = promising(self.prices, trial, left.scores, OFFERED + 1)
        return self._offers[key]
