"""Search on few of many records, judge on all of them.

A search fits hundreds of sets of options, and a fit costs as much as there are records; which sets are likely, few
records, evenly chosen, say nearly as well: more of the same conditions change the order of few. So laws and sets are
sought on few, and what these show is fitted to all, from where the fits of few ended. All records judge it, and what
one member more would add to it.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from enginediag_cli.drivers import TIME
from enginediag_cli.mismatch.explain.answer import Explanation
from enginediag_cli.mismatch.explain.free_members import Unlisted
from enginediag_cli.mismatch.explain.judging import Fits
from enginediag_cli.mismatch.explain.rejected import Reason, Rejected
from enginediag_cli.mismatch.explain.repeated import repeated
from enginediag_cli.mismatch.explain.shortlist import shortlisted
from enginediag_cli.mismatch.fit.evidence import Dataset
from enginediag_cli.mismatch.fit.identified import identify_with
from enginediag_cli.mismatch.fit.options import FREE, Option, combine_options, onset, stepping
from enginediag_cli.mismatch.fit.projection import Projection
from enginediag_cli.mismatch.fit.remainder import Remainder, remainder
from enginediag_cli.mismatch.fit.trial import HypothesisFit

ENOUGH = 1000
"""Records that say which sets of options are likely."""
ON_ALL = 2
"""Sets, likeliest first on few of many records, that are fitted to all."""


@dataclass(frozen=True)
class Few:
    """`fits` of about ENOUGH records where what may be told is sought, and the `whole`, which judge; one and the same
    where there are no more records, or where these few could not be fitted."""

    whole: Fits
    fits: Fits

    @classmethod
    def of(cls, whole: Fits) -> Few:
        few = whole.on_few(ENOUGH)
        return cls(whole, few if few.base.converged else whole)

    @property
    def are_all(self) -> bool:
        return self.fits is self.whole

    def left(self) -> Remainder:
        """What the base of the few leaves, weighed as that of all is."""
        rest = remainder(self.fits.base, self.fits.library, self.fits.along_drivers)
        return repeated(rest, self.fits.base.projection, self.fits.detect) if self.fits.from_recordings else rest

    def singles(self, rest: Remainder) -> list[HypothesisFit]:
        """Single options fitted to the few, best first."""
        return self.fits.refit([(self.fits.timed(s.option),) for s in shortlisted(rest.scores)]) or []

    def on_all(self, trial: HypothesisFit, unlisted: Unlisted | None = None) -> HypothesisFit:
        """A trial of the few fitted to all records, from where it ended; `unlisted`: what has offered its free
        curves."""
        if self.are_all or trial is self.fits.base:
            return self.whole.base if trial is self.fits.base else trial
        options = [self._carried(o, unlisted) for o in trial.options]
        found = identify_with(
            self.whole.evidence, combine_options(*options), self.whole.along, trial.found, roughly=True
        )
        fitted = HypothesisFit(tuple(options), found, Projection(found))
        self.whole.fitted[fitted.label] = fitted
        if not fitted.converged:
            self.whole.rejected[fitted.label] = Rejected(Reason.NOT_CONVERGED, what=found.reason)
        return fitted

    def judged(
        self,
        named: Sequence[Explanation],
        weighed: Callable[[HypothesisFit], float],
        worth: Callable[[HypothesisFit], bool],
    ) -> list[Explanation]:
        """What is named of the few, judged on all records: of the sets that are `worth` it, in the order of
        `weighed`."""
        if self.are_all or not named:
            return list(named)
        trials = [self.on_all(self.fits.fitted[x.label]) for x in named[:ON_ALL]]
        return self.whole.named(sorted((t for t in trials if t.converged and worth(t)), key=weighed), weighed)

    def _carried(self, option: Option, unlisted: Unlisted | None) -> Option:
        """An option of the few records as one of all: a change in time begins where it did, as nearly as few tell."""
        if option.kind == FREE and unlisted is not None:
            return unlisted.over(option, self.whole.along_drivers)
        if option.driver != TIME:
            return option
        return stepping(option, self.whole.evidence, _record(onset(option), self.fits.evidence, self.whole.evidence))


def _record(k: int, few: Dataset, whole: Dataset) -> int:
    """A record of few as one of all, both counted over their evidence."""
    ends = np.cumsum([len(f) for f in few.flights])
    flight = int(np.searchsorted(ends, k, "right"))
    own = k - int(ends[flight]) + len(few.flights[flight])
    place, all_of_it = few.flights[flight].place(own), whole.flights[flight]
    at = np.arange(len(all_of_it)) if all_of_it.at is None else all_of_it.at
    return sum(len(f) for f in whole.flights[:flight]) + int(np.searchsorted(at, place))
