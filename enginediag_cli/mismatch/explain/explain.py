"""Names what a model lacks, or says that it cannot.

1. Fit everything that identification would absorb. Nothing left over the gate: *nothing*.
2. Score every listed effect and every change in time; refit the best (score to shortlist, refit to decide).
   An explanation must be *adequate*: fitted with it, no other option and no free-form block is significant.
3. No single one is: an unrecorded driver; pairs and, step by step, larger sets (`stepwise`), of which every member
   must be needed, and which must beat what is unlisted.
4. Else members that stand beside unlisted physics are named *in part* (`in_part`).
5. Else *none of these*, with the places and the driver of the free-form map.

With a model-error floor an explanation must also predict most flights better from the other flights.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import cached_property

import numpy as np

from enginediag_cli.engine.term import Effect
from enginediag_cli.mismatch.explain.among_all import among_all
from enginediag_cli.mismatch.explain.answer import (
    FORMULA,
    HIDDEN_STATE,
    IDENTIFIED,
    NO_DISCREPANCY,
    NOT_CONVERGED,
    UNEXPLAINED,
    Answer,
    Explanation,
)
from enginediag_cli.mismatch.explain.few import Few
from enginediag_cli.mismatch.explain.fitted_sets import FittedSets, Proposer
from enginediag_cli.mismatch.explain.in_part import in_part, left_by
from enginediag_cli.mismatch.explain.judging import ADEQUATE, ALIAS, Fits
from enginediag_cli.mismatch.explain.latched_laws import outweighing
from enginediag_cli.mismatch.explain.lawful import LISTED_FIRST, Ground, LawsAlone, ground_of
from enginediag_cli.mismatch.explain.members import MOST_MEMBERS
from enginediag_cli.mismatch.explain.mixed import Mixed, with_laws
from enginediag_cli.mismatch.explain.rejected import Reason
from enginediag_cli.mismatch.explain.repeated import repeated
from enginediag_cli.mismatch.explain.shortlist import shortlisted
from enginediag_cli.mismatch.explain.stepwise import Stepwise
from enginediag_cli.mismatch.fit.evidence import Dataset
from enginediag_cli.mismatch.fit.freeform import places
from enginediag_cli.mismatch.fit.identified import NULL_HYPOTHESIS, identify_with
from enginediag_cli.mismatch.fit.noise import doubtful, estimated_noise, with_noise
from enginediag_cli.mismatch.fit.options import EFFECT
from enginediag_cli.mismatch.fit.projection import Projection
from enginediag_cli.mismatch.fit.remainder import Gates, Remainder, remainder
from enginediag_cli.mismatch.fit.trial import HypothesisFit
from enginediag_cli.mismatch.laws.finding import LawFinding
from enginediag_cli.mismatch.laws.posterior import evidence_of
from enginediag_cli.mismatch.laws.shortlist import Proposal
from enginediag_cli.mismatch.unrecorded.companions import with_shared_errors
from enginediag_cli.mismatch.unrecorded.recorded_driver import Hidden, HiddenScan, commanded, follows_a_driver

NOISE_PASSES, SAME_NOISE = 2, 0.03
"""Estimates of the noise at a fit, each with a fit after it, at most: a third changes nothing that matters, nor does
one more where none has changed by more than this share."""

NEARLY_ALL, PLAINLY = 0.8, 1.5
"""An unrecorded driver that explains this share of the excess χ², and so many times what the best recorded one does,
needs no comparison with sets of effects."""

MAIN, UNRECORDED = 0.8, 0.2
"""Shares of the probability of a false alarm, of the gate on recorded drivers and of that on unrecorded ones."""

FAR_BEHIND = 4.0 * ALIAS
"""χ² by which a single option may be behind another and be right in part. Judgement."""
WITHOUT_LAWS = 3
"""Listed options that are told together without a look at laws beside fewer. Judgement: several listed ones imitate a
law between them, and each that it takes is one more to be wrong about."""

TWICE = 2.0
"""A refit as two states seldom more than doubles the LR of a place: as long as twice the largest would not outweigh
what is recorded, single effects come first."""

HiddenSearch = Callable[[HypothesisFit], HiddenScan]


class Search(Fits):
    """One search for what the evidence shows; `run` gives the answer."""

    def __init__(self, evidence: Dataset, effects: Sequence[Effect] | None = None, hidden: HiddenSearch | None = None):
        super().__init__(evidence, effects)
        self.hidden, self.hidden_gate = hidden, np.inf
        self.proposers: Sequence[Proposer] = ()
        self._scan: HiddenScan | None = None
        self._unrecorded: Sequence[Hidden] | None = () if hidden is None else None
        self.rng = np.random.default_rng(evidence.settings.seed)

    def run(self) -> Answer:
        found = identify_with(self.evidence, NULL_HYPOTHESIS, self.along)
        projection = Projection(found)
        shared = with_shared_errors(projection) if found.converged else None
        if shared is not None:
            self.evidence = shared
            found = identify_with(shared, NULL_HYPOTHESIS, self.along, found)
            projection = Projection(found)
        self.base = HypothesisFit((), found, projection)
        if not found.converged:
            return self.answer(
                NOT_CONVERGED, f"the model as it is could not be fitted: {found.reason}", Remainder((), ())
            )
        self.look_from(self.base)
        rest = remainder(self.base, self.library, self.along_drivers)
        if self.evidence.settings.noise == "estimate":
            rest = self._with_estimated_noise(rest)
            if not self.base.converged:
                return self.answer(NOT_CONVERGED, f"the model could not be fitted: {self.base.found.reason}", rest)
        rest = self.weighed(rest)
        if self.hidden:
            self._scan = self.hidden(self.base)
            self.hidden_gate = self._scan.gate
        if rest.over(self.detect):
            return self.decide(rest)
        if self.unrecorded():
            return self._hidden(rest)
        return self.answer(NO_DISCREPANCY, "no significant difference beyond noise and identified parameters", rest)

    def weighed(self, rest: Remainder) -> Remainder:
        """What the base leaves, with the gates that it is judged by: set here."""
        self.plain = rest.scores
        levels = (MAIN * self.evidence.settings.false_alarm, ADEQUATE)
        self.detect, self.adequate = rest.gates(levels, self.rng)
        if not self.from_recordings:
            return rest
        self.detect, self.adequate = (
            Gates(*(doubtful(g, self.base.projection) for g in (gates.effects, gates.faults, gates.cells)))
            for gates in (self.detect, self.adequate)
        )
        return repeated(rest, self.base.projection, self.detect)

    def decide(self, rest: Remainder) -> Answer:
        scores = [*(s.score for s in rest.scores), *(c.score for c in rest.cells)]
        recorded = max((s.statistic - 2.0 * s.dof for s in scores), default=0.0)
        excess = self.base.objective - self.base.projection.dof
        # before single effects: each of them would be bent by a state that they all ignore
        if self._hidden_at_most > PLAINLY * 0.5 * recorded:
            many = self.evidence.records / self.few.fits.evidence.records
            recorded = max(recorded, 2.0 * many * self.laws.most)
        if self._hidden_at_most > PLAINLY * 0.5 * recorded:
            evidence = _evidence(self.unrecorded())
            if evidence > NEARLY_ALL * 0.5 * excess and evidence > PLAINLY * 0.5 * recorded:
                return self._hidden(rest)
        singles = self.refit([(self.timed(s.option),) for s in shortlisted(rest.scores, self.plain)])
        unfitted, singles = singles is None, singles or []
        named = self._or_sets(rest, singles, self.named(singles))
        if named and recorded <= named[0].gain + ALIAS:
            return self.answer(IDENTIFIED, "", rest, named)
        laws = LawsAlone(self.laws)
        law = laws.single()
        if named and not (law.explanations and law.evidence > self._evidence_of(named[0])):
            return self.answer(IDENTIFIED, "", rest, named)
        if named:
            return self.answer(FORMULA, "", rest, law.explanations, law=law.finding)
        # listed ones that explain no more than a law that explains all need not be found
        search, named = self._of_sets(rest, singles, laws.most - LISTED_FIRST if law.explanations else -np.inf)
        of_set = max((self._evidence_of(x) for x in named[:1]), default=0.0)
        named, mixed = self._or_with_laws(search, named, law.tried)
        if not law.explanations and not mixed.explanations:
            law = laws.double()
        of_set = max(of_set, mixed.evidence)
        if law.explanations and law.evidence > max(self._hidden_at_most, of_set):
            return self.answer(FORMULA, "", rest, law.explanations, law=law.finding)
        hidden, evidence = self.unrecorded(), _evidence(self.unrecorded())
        if law.explanations and law.evidence > max(evidence, of_set):
            return self.answer(FORMULA, "", rest, law.explanations, hidden, law.finding)
        if mixed.explanations and mixed.evidence > evidence:
            return self.answer(IDENTIFIED, "", rest, mixed.explanations, hidden, mixed.finding)
        # an amplitude of its own in every record follows any driver: it must be the better account of the two
        if named and evidence < 0.5 * (named[0].gain - 2.0 * len(named[0].coefficients)):
            return self.answer(IDENTIFIED, "", rest, named, hidden)
        # that no column records the driver is only a finding where the best recorded one explains less
        if hidden and (named or evidence > 0.5 * recorded):
            return self._hidden(rest, named or mixed.explanations)
        if mixed.explanations:
            return self.answer(IDENTIFIED, "", rest, mixed.explanations, hidden, mixed.finding)
        part = in_part(search, self.few)
        if part is not None:
            told = self.answer(IDENTIFIED, "", rest, (part.explanation,), hidden)
            return replace(told, unexplained=part.unexplained, rest=part.cells)
        if unfitted:
            return self.answer(NOT_CONVERGED, "no explanation could be fitted", rest, hidden=hidden)
        return self.answer(
            UNEXPLAINED,
            f"no listed effect or change in time, nor up to {MOST_MEMBERS} together, explains the mismatch",
            rest,
            hidden=hidden,
            law=law.finding,
        )

    def _hidden(self, rest: Remainder, named: Sequence[Explanation] = ()) -> Answer:
        """A driver that no column records; or a law, where the states are those of thresholds of something recorded."""
        hidden = self.unrecorded()
        also = outweighing(hidden[0], _evidence(hidden), self) if self.few.are_all else []
        law = LawsAlone(self.laws, also).single() if also else None
        if law is not None and law.explanations and law.explanations[0].label in {p.option.label for (p,) in also}:
            return self.answer(FORMULA, "", rest, law.explanations, hidden, law.finding)
        return self.answer(HIDDEN_STATE, "", rest, named, hidden)

    def _of_sets(
        self, rest: Remainder, singles: Sequence[HypothesisFit], least: float
    ) -> tuple[Stepwise, list[Explanation]]:
        """The search of sets, and what it names: sought on few of many records. `rest` and `singles` are of all;
        `least`: ln evidence that a set must promise."""
        few, best = self.few, rest.cells[0] if rest.cells else None
        if few.are_all:
            search = Stepwise(self, best, self.proposers, least=least)
            return search, among_all(search.sets, search.named(singles, rest.scores))
        left = few.left()
        search = Stepwise(few.fits, left.cells[0] if left.cells else None, self.proposers, many=True, least=least)
        named = search.named(few.singles(left), left.scores)
        return search, few.judged(named, search.sets.weighed, lambda t: self.counts(t, best))

    def _or_sets(
        self, rest: Remainder, singles: Sequence[HypothesisFit], named: list[Explanation]
    ) -> list[Explanation]:
        """What is named of single options, or of sets where these are likelier: sought where another single one, for
        all that it leaves, may be right and lack something beside it. Where neither is plainly likelier both are
        told."""
        if not named or not any(self._lacks_another(t, self.fitted[named[0].label]) for t in singles):
            return named
        search, several = self._of_sets(rest, singles, -np.inf)
        ahead = self._gained(search.sets, several[0]) - self._gained(search.sets, named[0]) if several else -np.inf
        return [*_likelier_first(several, self._among(search, named), ahead)]

    def _among(self, search: Stepwise, named: list[Explanation]) -> list[Explanation]:
        """What is named, with its probabilities among all sets of this search; of few of many records as it is."""
        return among_all(search.sets, named) if self.few.are_all else named

    def _lacks_another(self, trial: HypothesisFit, than: HypothesisFit) -> bool:
        """Whether a trial that leaves a misfit may explain more than another with something that makes up for it: more
        is over the gates than it is behind, in ln likelihood."""
        why, gates, behind = self.rejected.get(trial.label), self.adequate, trial.weighed - than.weighed
        if why is None or why.reason not in (Reason.LEAVES_MISFIT, Reason.WORSE) or behind > FAR_BEHIND:
            return False
        left = self.left(trial).surprise
        trial.projection.rest()
        return left - max(gates.effects, gates.faults, gates.cells) > 0.5 * behind

    def _or_with_laws(
        self, search: Stepwise, named: list[Explanation], tried: Sequence[Proposal]
    ) -> tuple[list[Explanation], Mixed]:
        """What is named of listed options alone, or what is with laws beside them: sought where nothing is, where it
        takes so many that fewer with a law may be likelier, and where a curve in the place of one leaves less. Where
        neither is plainly likelier both are told."""
        if named and len(named[0].options) <= WITHOUT_LAWS and not search.deciding.leaves_to_a_curve(named[0].label):
            return named, Mixed()
        mixed = self._mixed(search, tried)
        # those with laws are rivals now
        alone = self._among(search, named)
        own = self._gained(search.sets, named[0]) if named else -np.inf
        if not mixed.explanations:
            return alone, mixed
        told = _likelier_first(mixed.explanations, alone, mixed.evidence - own)
        return ([], replace(mixed, explanations=told)) if own < mixed.evidence else ([*told], Mixed())

    def _mixed(self, search: Stepwise, tried: Sequence[Proposal]) -> Mixed:
        """Listed options with laws beside them: sought on few of many records."""
        mixed = with_laws(search, tried)
        if self.few.are_all or not mixed.explanations:
            return mixed
        named = self.few.judged(mixed.explanations, search.sets.weighed, lambda t: True)
        if not named:
            return Mixed()
        finding = mixed.finding if named[0].label == mixed.explanations[0].label else None
        return Mixed(tuple(named), self._gained(search.sets, named[0]), finding)

    def _gained(self, sets: FittedSets, x: Explanation) -> float:
        """ln evidence of what is named against the model as it is, as sets compare."""
        return sets.evidence(self.fitted[x.label]) - sets.evidence(self.base)

    def _with_estimated_noise(self, rest: Remainder) -> Remainder:
        """What is left when the noise is what nothing explains; weights and noise in turn."""
        for _ in range(NOISE_PASSES):
            noise, before = estimated_noise(self.base.projection, rest.beside_noise()), self.evidence.noise
            self.evidence = with_noise(self.evidence, noise)
            found = identify_with(self.evidence, NULL_HYPOTHESIS, self.along, self.base.found)
            self.base = HypothesisFit((), found, Projection(found))
            rest = remainder(self.base, self.library, self.along_drivers)
            if all(abs(v / before.sigma[s] - 1.0) < SAME_NOISE for s, v in noise.sigma.items()):
                break
        return rest

    @cached_property
    def laws(self) -> Ground:
        """Every formula at every place, scored."""
        return ground_of(self.few)

    @cached_property
    def few(self) -> Few:
        """The records that sets and laws are searched on."""
        return Few.of(self)

    @property
    def _hidden_at_most(self) -> float:
        """ln likelihood ratio that an unrecorded driver may reach; what it does where it has been refitted."""
        if self._unrecorded is not None:
            return max(_evidence(self._unrecorded), 0.0)
        return TWICE * self._scan.largest if self._scan is not None else 0.0

    def unrecorded(self) -> Sequence[Hidden]:
        """Findings of a driver that no column shows: none where a recorded driver gives the same amplitude, nor of what
        nobody commands where nobody vouches for the noise: errors of the model come and go along such an amplitude."""
        if self._unrecorded is None:
            sought = self._scan if not self.from_recordings or (self._scan and self._scan.may_be_commanded()) else None
            found = [f for f in sought.refitted() if f.significant] if sought else []
            follows = not found or follows_a_driver(found[0], self.along_drivers)
            told = not follows and (not self.from_recordings or commanded(found[0], self.evidence.engine.parameters))
            self._unrecorded, self._scan = found if told else (), None
        return self._unrecorded

    def _evidence_of(self, x: Explanation) -> float:
        """ln evidence of a set of listed effects, each of which might have been any, against that of a law."""
        prior = LISTED_FIRST - len(x.options) * float(np.log(len(self.library)))
        return evidence_of(self.base, self.fitted[x.label], prior)

    # around it

    def answer(
        self,
        status: str,
        reason: str,
        rest: Remainder,
        named: Sequence[Explanation] = (),
        hidden: Sequence[Hidden] = (),
        law: LawFinding | None = None,
    ) -> Answer:
        base, self._scan = self.base, None  # a look holds rows of every record
        told = status in (IDENTIFIED, FORMULA)
        return Answer(
            status,
            reason,
            tuple(named),
            rest.cells,
            tuple(places(rest.cells)),
            rest.unseen,
            tuple(hidden),
            (self.detect.effects, self.adequate.effects),
            rest.best(EFFECT),
            base.objective,
            base.projection.dof,
            self.rejected,
            base.found.theta,
            base.found.number,
            law,
            unexplained=1.0 if status == UNEXPLAINED else left_by(named[0].objective, base) if told else None,
        )


def _evidence(hidden: Sequence[Hidden]) -> float:
    """ln likelihood ratio of the best finding of an unrecorded driver; −∞ without one."""
    return max(hidden[0].lr, hidden[0].gain) if hidden else -np.inf


def _likelier_first(
    ones: Sequence[Explanation], others: Sequence[Explanation], ahead: float
) -> tuple[Explanation, ...]:
    """Of two alias sets the likelier, `ahead` being the ln evidence of `ones` against the others; and the other after
    it where neither is plainly likelier."""
    first, second = (ones, others) if ahead > 0.0 else (others, ones)
    return _together(first, second if abs(ahead) < 0.5 * ALIAS else ())


def _together(first: Sequence[Explanation], others: Sequence[Explanation]) -> tuple[Explanation, ...]:
    """Explanations that cannot be told apart, each once. Laws are weighed anew after what is listed alone, which may
    leave more than 1 for all of them: their odds stand."""
    known = {x.label for x in first}
    every = (*first, *(x for x in others if x.label not in known))
    most = max(sum(x.probability for x in every), 1.0)
    return tuple(replace(x, probability=x.probability / most) for x in every)


def explain(evidence: Dataset, effects: Sequence[Effect] | None = None, hidden: HiddenSearch | None = None) -> Answer:
    """What the evidence shows that the engine's model lacks. `effects`: the library, default all that the model does
    not carry; `hidden`: finds effects of an unrecorded driver at a trial."""
    return Search(evidence, effects, hidden).run()
