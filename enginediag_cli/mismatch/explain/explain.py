"""Names what a model lacks, or says that it cannot.

1. Fit everything that identification would absorb. Nothing left over the gate: *nothing*.
2. Score every listed effect and every change in time; refit the best (score to shortlist, refit to decide).
   An explanation must be *adequate*: fitted with it, no other option and no free-form block is significant.
3. No single one is: an unrecorded driver; pairs and, step by step, larger sets of one driver, of which every member
   must be needed, and which must beat the best single free-form block.
4. Else *none of these*, with the places and the driver of the free-form map.

With a model-error floor an explanation must also predict most flights better from the other flights.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from enginediag_cli.drivers import TIME
from enginediag_cli.engine.term import Effect
from enginediag_cli.mismatch.explain.answer import (
    FAILED,
    HIDDEN,
    LAW,
    NAMED,
    NONE,
    NOTHING,
    Answer,
    Coefficient,
    Explanation,
)
from enginediag_cli.mismatch.explain.lawful import law_for
from enginediag_cli.mismatch.explain.pairs import best_pairs
from enginediag_cli.mismatch.explain.rejected import Reason, Rejected
from enginediag_cli.mismatch.explain.repeated import repeated
from enginediag_cli.mismatch.explain.shortlist import shortlisted
from enginediag_cli.mismatch.explain.worth_fitting import reach_of, worth_fitting
from enginediag_cli.mismatch.fit.evidence import Evidence
from enginediag_cli.mismatch.fit.freeform import Cell, places
from enginediag_cli.mismatch.fit.held_out import flights_gained
from enginediag_cli.mismatch.fit.identified import NO_HYPOTHESIS, drivers_of, identify_with, nuisance, objective_of
from enginediag_cli.mismatch.fit.noise import doubtful, estimated_noise, with_noise
from enginediag_cli.mismatch.fit.options import (
    EFFECT,
    Option,
    effect_options,
    fault_options,
    with_best_onset,
)
from enginediag_cli.mismatch.fit.projection import Projection
from enginediag_cli.mismatch.fit.response import response_error
from enginediag_cli.mismatch.fit.trial_fit import Gates, Remainder, Trial, attempt, not_needed, remainder
from enginediag_cli.mismatch.laws.finding import LawFinding
from enginediag_cli.mismatch.laws.posterior import evidence_of
from enginediag_cli.mismatch.unrecorded.companions import with_shared_errors
from enginediag_cli.mismatch.unrecorded.recorded_driver import Hidden, HiddenScan, commanded, follows_a_driver
from enginediag_cli.physics.registry import candidates
from enginediag_cli.progress import each

ALIAS = 6.0
"""Explanations whose χ² is within this of the best are told together."""

ADEQUATE = 0.01
"""Level of the gate that an explanation must pass; 5 % would reject one right explanation in twenty."""

PAIRS = 4
"""Pairs that are refitted, best by score first, as of single options (`SHORTLIST`)."""
LARGEST_SET, EXTENDED = 4, 2
"""Options that may act together at most, and how many of the best singles or sets are extended by one more. Judgement:
more together is better told as unlisted physics."""
MOST_FLIGHTS = 0.75
"""Share of the flights, held out in turn, that must gain by an explanation: chance alone gives half of them.
Judgement."""
NOISE_PASSES, SAME_NOISE = 2, 0.03
"""Estimates of the noise at a fit, each with a fit after it, at most: a third changes nothing that matters, nor does
one more where none has changed by more than this share."""

NEARLY_ALL, PLAINLY = 0.8, 1.5
"""An unrecorded driver that explains this share of the excess χ², and so many times what the best recorded one does,
needs no comparison with sets of effects."""

MAIN, UNRECORDED = 0.8, 0.2
"""Shares of the probability of a false alarm, of the gate on recorded drivers and of that on unrecorded ones."""


TWICE = 2.0
"""A refit as two states seldom more than doubles the LR of a place: as long as twice the largest would not outweigh
what is recorded, single effects come first."""

HiddenSearch = Callable[[Trial], HiddenScan]


class Search:
    """One search for what the evidence shows; `run` gives the answer."""

    def __init__(self, evidence: Evidence, effects: Sequence[Effect] | None = None, hidden: HiddenSearch | None = None):
        self.evidence = evidence
        self.effects = list(candidates(evidence.engine)) if effects is None else list(effects)
        self.hidden, self.hidden_gate = hidden, np.inf
        self._scan: HiddenScan | None = None
        self._unrecorded: Sequence[Hidden] | None = () if hidden is None else None
        self.along = nuisance(evidence)
        self.rng = np.random.default_rng(evidence.settings.seed)
        self.rejected: dict[str, Rejected] = {}
        self.fitted: dict[str, Trial] = {}  # by label, without what scores need

    def run(self) -> Answer:
        found = identify_with(self.evidence, NO_HYPOTHESIS, self.along)
        projection = Projection(found)
        shared = with_shared_errors(projection) if found.converged else None
        if shared is not None:
            self.evidence = shared
            found = identify_with(shared, NO_HYPOTHESIS, self.along, found)
            projection = Projection(found)
        self.base = Trial((), found, projection)
        self.detect = self.adequate = Gates()
        if not found.converged:
            return self.answer(FAILED, f"the model as it is could not be fitted: {found.reason}", Remainder((), ()))
        self.look_from(self.base)
        rest = remainder(self.base, self.library, self.along_drivers)
        if self.evidence.settings.noise == "estimate":
            rest = self._with_estimated_noise(rest)
            if not self.base.converged:
                return self.answer(FAILED, f"the model could not be fitted: {self.base.found.reason}", rest)
        rest = self.weighed(rest)
        if self.hidden:
            self._scan = self.hidden(self.base)
            self.hidden_gate = self._scan.gate
        if rest.over(self.detect):
            return self.decide(rest)
        if self.unrecorded():
            return self.answer(HIDDEN, "", rest, hidden=self.unrecorded())
        return self.answer(NOTHING, "nothing stands out of noise and identified parameters", rest)

    def look_from(self, base: Trial) -> None:
        """Look for what this fit lacks: options and drivers are those of its records."""
        self.base = base
        self.library = [*effect_options(self.effects), *fault_options(base.found)]
        self.along_drivers = drivers_of(self.evidence, base.found.theta)

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

    @property
    def from_recordings(self) -> bool:
        """Whether the noise is known from recordings alone, not stated."""
        return self.evidence.noise.estimated or self.evidence.settings.noise == "estimate"

    def decide(self, rest: Remainder) -> Answer:
        best = rest.cells[0] if rest.cells else None
        scores = [*(s.score for s in rest.scores), *(c.score for c in rest.cells)]
        recorded = max((s.statistic - 2.0 * s.dof for s in scores), default=0.0)
        excess = self.base.objective - self.base.projection.dof
        # before single effects: each of them would be bent by a state that they all ignore
        if self._scan is not None and TWICE * self._scan.largest > PLAINLY * 0.5 * recorded:
            evidence = _evidence(self.unrecorded())
            if evidence > NEARLY_ALL * 0.5 * excess and evidence > PLAINLY * 0.5 * recorded:
                return self.answer(HIDDEN, "", rest, hidden=self.unrecorded())
        singles = self.refit([(self._timed(s.option),) for s in shortlisted(rest.scores, self.plain)])
        if singles is None:
            return self.answer(FAILED, "no explanation could be fitted", rest)
        named = self.named(singles)
        if named:
            return self.answer(NAMED, "", rest, named)
        pairs: list[tuple[Option, ...]] = []
        for found in best_pairs(rest.scores, PAIRS):
            _add(pairs, tuple(map(self._timed, found)))
        for wider in self.forward(singles[:EXTENDED]):
            _add(pairs, wider)
        named = self._named_set(pairs, best)
        hidden, evidence = self.unrecorded(), _evidence(self.unrecorded())
        law = law_for(self)
        if law.explanations and law.evidence > max(evidence, *(self._evidence_of(x) for x in named[:1]), 0.0):
            return self.answer(LAW, "", rest, law.explanations, hidden, law.finding)
        # an amplitude of its own in every record follows any driver: it must be the better account of the two
        if named and evidence < 0.5 * (named[0].gain - 2.0 * len(named[0].coefficients)):
            return self.answer(NAMED, "", rest, named, hidden)
        # that no column records the driver is only a finding where the best recorded one explains less
        if hidden and (named or evidence > 0.5 * recorded):
            return self.answer(HIDDEN, "", rest, named, hidden)
        return self.answer(
            NONE,
            f"no listed effect or change in time, nor up to {LARGEST_SET} together, explains the mismatch",
            rest,
            hidden=hidden,
            law=law.finding,
        )

    def _named_set(self, pairs: Sequence[tuple[Option, ...]], best: Cell | None) -> list[Explanation]:
        """The alias set of pairs, or of the larger sets that grow from them; empty when none is adequate."""
        sets = self.refit(pairs) or []
        for size in range(2, LARGEST_SET + 1):
            named = self.named([s for s in sets if self.counts(s, best)])
            if named or size == LARGEST_SET:
                return named
            sets = self.refit(self._extended(sets[:EXTENDED])) or []
        return []

    def _with_estimated_noise(self, rest: Remainder) -> Remainder:
        """What is left when the noise is what nothing explains; weights and noise in turn."""
        for _ in range(NOISE_PASSES):
            noise, before = estimated_noise(self.base.projection, rest.blocks()), self.evidence.noise
            self.evidence = with_noise(self.evidence, noise)
            found = identify_with(self.evidence, NO_HYPOTHESIS, self.along, self.base.found)
            self.base = Trial((), found, Projection(found))
            rest = remainder(self.base, self.library, self.along_drivers)
            if all(abs(v / before.sigma[s] - 1.0) < SAME_NOISE for s, v in noise.sigma.items()):
                break
        return rest

    # fitting

    def _timed(self, option: Option) -> Option:
        return with_best_onset(self.base.found, self.base.projection, option)

    def unrecorded(self) -> Sequence[Hidden]:
        """Findings of a driver that no column shows: none where a recorded driver gives the same amplitude, nor of what
        nobody commands where nobody vouches for the noise: errors of the model come and go along such an amplitude."""
        if self._unrecorded is None:
            found = [f for f in self._scan.refitted() if f.significant] if self._scan else []
            follows = not found or follows_a_driver(found[0], self.along_drivers)
            told = not follows and (not self.from_recordings or commanded(found[0], self.evidence.engine.parameters))
            self._unrecorded, self._scan = found if told else (), None
        return self._unrecorded

    def forward(self, singles: Sequence[Trial]) -> list[tuple[Option, ...]]:
        """Each single option with the effect, and with the change in time, that says most about what it leaves."""
        wider: list[tuple[Option, ...]] = []
        for trial in singles:
            left = remainder(trial, self.library, ())
            for timed in (False, True):
                best = next((s for s in left.scores if (s.option.driver == TIME) == timed and s.surprise > 0.0), None)
                if best is not None:
                    _add(wider, (*trial.options, with_best_onset(trial.found, trial.projection, best.option)))
        return wider

    def _extended(self, sets: Sequence[Trial]) -> list[tuple[Option, ...]]:
        """Each set with the effect of the same driver that has most to say about what the set leaves: more than two
        things are one cause that acts at several places, or a fit to chance."""
        wider: list[tuple[Option, ...]] = []
        for trial in sets:
            driver = {o.driver for o in trial.options}
            if len(driver) == 1 and TIME not in driver:
                left = remainder(trial, [o for o in self.library if o.driver in driver], ())
                if left.scores and left.scores[0].surprise > self.adequate.effects:
                    _add(wider, (*trial.options, left.scores[0].option))
        return wider

    def refit(self, sets: Sequence[tuple[Option, ...]]) -> list[Trial] | None:
        """Trials that converged, best first; None when there were some and none did."""
        trials: list[Trial] = []
        near, behind = worth_fitting(sets, self.base.found, self.along)
        for options, worse in behind:
            told = Rejected(Reason.WORSE, worse, "on a few of the records")
            self.rejected[" + ".join(o.label for o in options)] = told
        alone, best = objective_of(self.base.found.fit), np.inf
        for options, of_few in each(near, "fitting candidates", len(near)):
            reach = reach_of(best, alone)
            trial = attempt(options, self.base.found, self.along, of_few, reach)
            reached = objective_of(trial.found.fit)
            self.fitted[trial.label] = trial
            if trial.converged:
                trials.append(trial)
                best = min(best, reached)
            elif reached > reach:
                self.rejected[trial.label] = Rejected(Reason.WORSE, reached - best)
            else:
                self.rejected[trial.label] = Rejected(Reason.NOT_CONVERGED, what=trial.found.reason)
        if sets and not trials:
            return None
        return sorted(trials, key=lambda t: t.weighed)

    # deciding

    def named(self, trials: Sequence[Trial]) -> list[Explanation]:
        """The alias set of the best adequate trial, best first; empty when none is adequate."""
        adequate: list[tuple[Trial, float, float]] = []
        elsewhere = 0.0  # odds of what is too far behind to be told
        for trial in trials:
            behind = trial.weighed - adequate[0][0].weighed if adequate else 0.0
            if behind > ALIAS:
                trial.projection.rest()
                self.rejected.setdefault(trial.label, Rejected(Reason.WORSE, behind))
                elsewhere += float(np.exp(-0.5 * behind))
                continue
            left, flights, why = self.judge(trial)
            trial.projection.rest()
            if why:
                self.rejected[trial.label] = why
            else:
                adequate.append((trial, left, flights))
        if not adequate:
            return []
        odds = np.exp([-0.5 * (t.weighed - adequate[0][0].weighed) for t, _, _ in adequate])
        return [
            self.explanation(t, p, left, flights)
            for (t, left, flights), p in zip(adequate, odds / (odds.sum() + elsewhere), strict=True)
        ]

    def judge(self, trial: Trial) -> tuple[float, float, Rejected | None]:
        """What is left, share of flights gained, and why the trial is no explanation (None when it is one)."""
        if trial.at_bound:
            return np.nan, np.nan, Rejected(Reason.AT_BOUND, what=", ".join(trial.at_bound))
        # what leaves no more than is allowed to be left may still have explained nothing
        idle = not_needed(trial, -np.log(ADEQUATE))
        if idle:
            return np.nan, np.nan, Rejected(Reason.NOT_NEEDED, what=idle)
        left = self._left(trial)
        if left.unranked or left.over(self.adequate):
            return left.surprise, np.nan, Rejected(Reason.LEAVES_MISFIT, left.surprise)
        if self.evidence.settings.map_accuracy > 0.0 and all(o.driver != TIME for o in trial.options):
            flights = flights_gained(self.base, trial)
            if flights < MOST_FLIGHTS:
                return left.surprise, flights, Rejected(Reason.FEW_FLIGHTS, flights)
            return left.surprise, flights, None
        return left.surprise, np.nan, None

    def _left(self, trial: Trial) -> Remainder:
        """What a trial leaves, no further than to the first that is over the gates."""
        left = remainder(trial, self.library, self.along_drivers, self.adequate)
        share = response_error(trial.found) ** 2 * max(self.base.objective - trial.objective, 0.0)
        if share > 0.0 and left.over(self.adequate):
            if not left.cells:
                left = remainder(trial, self.library, self.along_drivers)
            left = left.tolerant(share)
        if not self.from_recordings or not left.over(self.adequate):
            return left
        if not left.cells and not repeated(left, trial.projection, self.adequate).over(self.adequate):
            left = remainder(trial, self.library, self.along_drivers)
        return repeated(left, trial.projection, self.adequate)

    def counts(self, trial: Trial, best: Cell | None) -> bool:
        """Whether a set is worth judging: every member is needed beside the others, and
        drop − 2·p > T − 2·dof of the best single free-form block, else one unlisted effect is the simpler story."""
        idle = not_needed(trial, self.adequate.effects)
        if idle:
            self.rejected[trial.label] = Rejected(Reason.NOT_NEEDED, what=idle)
            return False
        drop = self.base.objective - trial.objective
        if best is None or drop - 2.0 * len(trial.hypothesis.names) > best.score.statistic - 2.0 * best.score.dof:
            return True
        self.rejected[trial.label] = Rejected(Reason.ONE_UNLISTED)
        return False

    def explanation(self, t: Trial, probability: float, left: float, flights: float) -> Explanation:
        parameters = t.found.model.parameters
        found = tuple(Coefficient(n, parameters[n].unit, v, s, *t.intervals[n]) for n, (v, s) in t.coefficients.items())
        gain = self.base.objective - t.objective
        return Explanation(t.options, found, t.objective, gain, float(probability), left, flights, t.at_bound)

    def _evidence_of(self, x: Explanation) -> float:
        """ln evidence of a set of listed effects, each of which might have been any."""
        return evidence_of(self.base, self.fitted[x.label], -len(x.options) * float(np.log(len(self.library))))

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
        )


def _add(sets: list[tuple[Option, ...]], new: tuple[Option, ...]) -> None:
    """Adds a set that is not there yet, in whatever order."""
    if not any({o.label for o in new} == {o.label for o in other} for other in sets):
        sets.append(new)


def _evidence(hidden: Sequence[Hidden]) -> float:
    """ln likelihood ratio of the best finding of an unrecorded driver; −∞ without one."""
    return max(hidden[0].lr, hidden[0].gain) if hidden else -np.inf


def explain(evidence: Evidence, effects: Sequence[Effect] | None = None, hidden: HiddenSearch | None = None) -> Answer:
    """What the evidence shows that the engine's model lacks. `effects`: the library, default all that the model does
    not carry; `hidden`: finds effects of an unrecorded driver at a trial."""
    return Search(evidence, effects, hidden).run()
