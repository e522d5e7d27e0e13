"""A law for what no listed effect explains: judged as any explanation is, told with what is known of it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from enginediag_cli.mismatch.explain.answer import Explanation
from enginediag_cli.mismatch.explain.few import ON_ALL, Few
from enginediag_cli.mismatch.explain.judging import Fits
from enginediag_cli.mismatch.explain.rejected import Rejected
from enginediag_cli.mismatch.laws.finding import LawFinding
from enginediag_cli.mismatch.laws.fitted import Fitted, ordered
from enginediag_cli.mismatch.laws.posterior import shares
from enginediag_cli.mismatch.laws.scan import Scan, scanned
from enginediag_cli.mismatch.laws.search import LawSearch
from enginediag_cli.mismatch.laws.shortlist import Proposal
from enginediag_cli.mismatch.laws.summary import summary
from enginediag_cli.mismatch.laws.unlisted import any_curve_at_all

LEAST = 3.0
"""ln evidence from which a law is told: twenty to one, everything that was tried counted in its prior."""
LISTED_FIRST = 7.0
"""ln of the odds by which what the library holds is likelier beforehand than a law that nobody has written down, its
place and form apart: a thousand to one, judgement. Where both explain as well what is known is told."""
JUDGED = 4
"""Laws, likeliest first, that are judged."""
FURTHER = 3
"""Laws whose formulas are sought at further places."""
AS_GOOD = 3.0
"""ln evidence within which laws are told together, as of explanations (`ALIAS`)."""


@dataclass(frozen=True)
class Lawful:
    """`explanations`: laws that explain the mismatch, likeliest first, empty where none does; `finding`: what is known
    of it, None where no law is likely; `evidence`: ln, of the first; `tried`: laws that were fitted."""

    explanations: tuple[Explanation, ...]
    finding: LawFinding | None
    evidence: float
    tried: tuple[Proposal, ...] = ()


@dataclass(frozen=True)
class Ground:
    """Where laws are searched: few records, and every formula at every place scored at the base of these."""

    few: Few
    scan: Scan

    @property
    def most(self) -> float:
        """ln evidence of the likeliest on these records by score, a form or any smooth curve; 0 where there is none."""
        base = self.few.fits.base
        listed = self.scan.candidates[0].weight if self.scan.candidates else 0.0
        return max(listed, any_curve_at_all(base.found, base.projection, self.scan.known))


def ground_of(few: Few) -> Ground:
    return Ground(few, scanned(few.fits.base.found, few.fits.base.projection))


class LawsAlone:
    """Laws that explain what the base lacks, of the formulas scored, nothing else beside them. Of many records some
    say which laws are likely, and all of them judge the best of these. `also`: laws that are tried in any case."""

    def __init__(self, ground: Ground, also: Sequence[tuple[Proposal, ...]] = ()):
        self.few = ground.few
        self._search = LawSearch(ground.few.fits.base, ground.scan, ground.few.fits.refit, also)

    @property
    def most(self) -> float:
        """ln evidence of the likeliest that was fitted, on the few records."""
        return self._search.most

    @property
    def _likely(self) -> bool:
        return self.most >= LEAST

    def single(self) -> Lawful:
        """By one law, perhaps with the same formula at further places."""
        return self._of(self._search.told) if self._likely else Lawful((), None, 0.0)

    def double(self) -> Lawful:
        """By two together."""
        return self._of(self._search.with_second()) if self._likely else Lawful((), None, 0.0)

    def _of(self, tried: Sequence[Fitted]) -> Lawful:
        laws, fits = self._search, self.few.whole
        known = not fits.from_recordings
        formed = [f for f in tried if not f.forms]
        more = [f for first in formed[:FURTHER] for f in laws.elsewhere_too(first)]
        likeliest = ordered([*tried, *more])
        if not self.few.are_all:
            apart = (f for f in likeliest if f.forms or f.where not in laws.averages)
            likeliest = _on_all(self.few, list(apart)[:ON_ALL])
        judged = adequate(fits, likeliest[:JUDGED])
        fits.rejected.update(judged.rejected)
        proposals = tuple(laws.proposals)
        if judged.found:
            finding = summary(laws, judged.fitted, fits.base, known)
            return Lawful(judged.told(fits), finding, judged.fitted[0].evidence, proposals)
        finding = summary(laws, laws.single[:1], self.few.fits.base, known)
        return Lawful((), finding, laws.most, proposals)


def _on_all(few: Few, fitted: Sequence[Fitted]) -> list[Fitted]:
    """The laws fitted to all records, likeliest first."""
    found = [(f, few.on_all(f.trial)) for f in fitted]
    return ordered(f.again(few.whole.base, trial) for f, trial in found if trial.converged)


@dataclass(frozen=True)
class Judged:
    """`found`: laws that are explanations, likeliest first, with what each leaves and the share of flights that it
    gains; `rejected`: why the others are none, by label."""

    found: tuple[tuple[Fitted, float, float], ...]
    rejected: dict[str, Rejected]

    @property
    def fitted(self) -> list[Fitted]:
        return [f for f, _, _ in self.found]

    def told(self, fits: Fits, probability: float = 1.0) -> tuple[Explanation, ...]:
        """The explanations, with shares of this probability."""
        odds = probability * shares([f.standing for f in self.fitted])
        return tuple(
            fits.explanation(f.trial, float(p), left, flights)
            for (f, left, flights), p in zip(self.found, odds, strict=True)
        )


def adequate(fits: Fits, fitted: Sequence[Fitted]) -> Judged:
    """Those that are explanations, as likely as the first. Members of a law are needed: none has joined without more
    evidence for all together, though along the same variables their sizes may well be known only together."""
    found: list[tuple[Fitted, float, float]] = []
    rejected: dict[str, Rejected] = {}
    for f in fitted:
        if found and f.standing < found[0][0].standing - AS_GOOD:
            break
        if any(g.forms and g.where == f.where for g, _, _ in found):
            continue  # one of those that are averaged
        left, flights, why = fits.judge(f.trial, needed=True)
        if why is None:
            found.append((f, left, flights))
        else:
            rejected[f.trial.label] = why
    return Judged(tuple(found), rejected)
