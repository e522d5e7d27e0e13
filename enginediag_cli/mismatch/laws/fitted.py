"""A law that was fitted, and by what it is put in order."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from enginediag_cli.engine.term import Effect
from enginediag_cli.mismatch.fit.options import Option
from enginediag_cli.mismatch.fit.trial import HypothesisFit
from enginediag_cli.mismatch.laws.band import curve_of, summed
from enginediag_cli.mismatch.laws.finding import Share
from enginediag_cli.mismatch.laws.posterior import evidence_of
from enginediag_cli.mismatch.laws.scan import KnownVariable, seen_at
from enginediag_cli.mismatch.laws.shortlist import Proposal
from enginediag_cli.mismatch.laws.within import Room

LIKELIER = 1e-3
"""ln evidence by which a law with a further form goes before the same without it where prediction alone asks for it."""

Where = tuple[str, frozenset[int]]
"""Name of a place, and groups of variables."""


@dataclass
class Fitted:
    """Laws, one or several together, fitted: the trial, and ln evidence against the model as it is; `beside`: what all
    other laws of its variables at its place, listed or just smooth, add to that of the best one there; `forms`: what
    it is an average of, nothing for a law of one form."""

    laws: tuple[Proposal, ...]
    trial: HypothesisFit
    evidence: float
    beside: float = 0.0
    forms: tuple[Share, ...] = ()
    told_for: Where | None = None

    @classmethod
    def to(cls, base: HypothesisFit, laws: tuple[Proposal, ...], trial: HypothesisFit) -> Fitted:
        """A trial of laws, weighed against the base of the same records."""
        prior = sum(p.candidate.prior for p in laws)
        return cls(laws, trial, evidence_of(base, trial, prior) + ln_within(laws, trial))

    def again(self, base: HypothesisFit, trial: HypothesisFit) -> Fitted:
        """The same laws fitted to other records."""
        return replace(Fitted.to(base, self.laws, trial), beside=self.beside, forms=self.forms, told_for=self.told_for)

    @property
    def standing(self) -> float:
        """ln evidence by which it is put in order: that of its place and variables, told by their best law."""
        return self.evidence + self.beside

    @property
    def options(self) -> tuple[Option, ...]:
        return tuple(p.option for p in self.laws)

    @property
    def effects(self) -> tuple[Effect, ...]:
        return tuple(e for o in self.options for e in o.hypothesis.effects)

    @property
    def where(self) -> Where:
        """Place of the first, and the groups of variables of all that act there."""
        if self.told_for is not None:
            return self.told_for
        place = self.laws[0].candidate.location.name
        own = (p.candidate.formula.groups for p in self.laws if p.candidate.location.name == place)
        return place, frozenset().union(*own)

    @property
    def names(self) -> frozenset[str]:
        """Of the variables of all its laws."""
        return frozenset(k.variable.name for p in self.laws for k in p.candidate.formula.of)

    def curve(self, known: Sequence[KnownVariable]) -> np.ndarray:
        """All its laws together over the records (N,)."""
        return summed(self.effects, known, self.trial.values)

    @property
    def at_the_first(self) -> tuple[Effect, ...]:
        """Those that act at the first one's place."""
        place = self.where[0]
        return tuple(e for p in self.laws if p.candidate.location.name == place for e in p.option.hypothesis.effects)

    @property
    def remembers(self) -> bool:
        """Whether one of its laws follows a variable along time."""
        return any(p.remembers for p in self.laws)

    @property
    def at_one_place(self) -> bool:
        return len({p.candidate.location.name for p in self.laws}) == 1


def ln_within(laws: Sequence[Proposal], trial: HypothesisFit) -> float:
    """What physics says (`within`) of laws that a trial has fitted, at each of their places; nothing where they were
    found on other records."""
    total, fitted = 0.0, {o.label: o for o in trial.options}
    for place in {p.candidate.location.name: p.candidate.location for p in laws}.values():
        own = [p for p in laws if p.candidate.location.name == place.name]
        # a curve of one variable at a place has one name, however many steps it has
        effects = [e for p in own for e in fitted[p.option.label].hypothesis.effects]
        known = {k.variable.name: k for p in own for k in p.candidate.formula.of}
        if any(len(k.values) != len(trial.found.number) for k in known.values()):
            continue
        f = summed(effects, list(known.values()), trial.values)
        room = Room.at(trial.found, place, float(np.mean(f)))
        if not room.allows(f):
            total += room.of_curve(*curve_of(effects, trial, seen_at(trial.found, list(known.values()))))
    return total


def ordered(fitted: Iterable[Fitted]) -> list[Fitted]:
    """Likeliest first."""
    return sorted(fitted, key=lambda f: -f.standing)
