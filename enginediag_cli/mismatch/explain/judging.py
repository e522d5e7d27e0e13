"""Fits of options to the evidence, and which of them explain it."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from enginediag_cli.drivers import TIME
from enginediag_cli.engine.term import DriverValues, Effect
from enginediag_cli.identification.gauss_newton import Fit
from enginediag_cli.mismatch.explain.answer import Coefficient, Explanation
from enginediag_cli.mismatch.explain.rejected import Reason, Rejected
from enginediag_cli.mismatch.explain.repeated import repeated
from enginediag_cli.mismatch.explain.worth_fitting import reach_of, worth_fitting
from enginediag_cli.mismatch.fit.attempt import attempt
from enginediag_cli.mismatch.fit.evidence import Dataset
from enginediag_cli.mismatch.fit.freeform import Cell
from enginediag_cli.mismatch.fit.handed import trials_handed
from enginediag_cli.mismatch.fit.held_out import flights_gained
from enginediag_cli.mismatch.fit.identified import (
    NULL_HYPOTHESIS,
    FitBudget,
    IdentifiedHypothesis,
    driver_values,
    identify_with,
    nuisance,
    objective_of,
)
from enginediag_cli.mismatch.fit.needed import not_needed
from enginediag_cli.mismatch.fit.options import Option, effect_options, fault_options, with_best_onset
from enginediag_cli.mismatch.fit.projection import Projection
from enginediag_cli.mismatch.fit.remainder import Gates, Remainder, remainder
from enginediag_cli.mismatch.fit.response import response_error
from enginediag_cli.mismatch.fit.share import every_so_often
from enginediag_cli.mismatch.fit.trial import HypothesisFit
from enginediag_cli.parallel import parallel_map
from enginediag_cli.physics.registry import candidate_effects
from enginediag_cli.progress import each

ALIAS = 6.0
"""Explanations whose χ² is within this of the best are told together."""

ADEQUATE = 0.01
"""Level of the gate that an explanation must pass; 5 % would reject one right explanation in twenty."""

MOST_FLIGHTS = 0.75
"""Share of the flights, held out in turn, that must gain by an explanation: chance alone gives half of them.
Judgement."""

AT_ONCE = 4
"""Sets that are fitted together, however many processes there are: the best of them says how far the next are worth
their time. Judgement."""

REMEMBERED = 8
"""Remainders that are kept, the last: what is judged soon proposes what may join it."""


class Fits:
    """Trials of one evidence. `effects`: the library, default all that the model does not carry; `base`: the fit
    without options; `library` and `along_drivers`: what is looked for in
    what a trial leaves; `detect`, `adequate`: the gates of its judgement; `fitted`: trials by label; `rejected`: why
    they are no explanation, by label."""

    base: HypothesisFit
    library: Sequence[Option]
    along_drivers: Sequence[DriverValues]

    def __init__(self, evidence: Dataset, effects: Sequence[Effect] | None = None):
        self.evidence = evidence
        self.effects = list(candidate_effects(evidence.engine)) if effects is None else list(effects)
        self.along = nuisance(evidence)
        self.onward = False
        self.detect = self.adequate = Gates()
        self.rejected: dict[str, Rejected] = {}
        self.fitted: dict[str, HypothesisFit] = {}  # without what scores need
        self._left: dict[str, Remainder] = {}

    @property
    def from_recordings(self) -> bool:
        """Whether the noise is known from recordings alone, not stated."""
        return self.evidence.noise.estimated or self.evidence.settings.noise == "estimate"

    def look_from(self, base: HypothesisFit) -> None:
        """Look for what this fit lacks: options and drivers are those of its records."""
        self.base = base
        self.library = [*effect_options(self.effects), *fault_options(base.found)]
        self.along_drivers = driver_values(self.evidence, base.found.theta)

    def on_few(self, most: int) -> Fits:
        """The same of about `most` of the records, judged by the same gates, its base fitted to these; itself where
        there are no more."""
        few = every_so_often(self.evidence, most)
        if few is self.evidence:
            return self
        fits = Fits(few, self.effects)
        fits.onward, fits.detect, fits.adequate = True, self.detect, self.adequate
        found = identify_with(few, NULL_HYPOTHESIS, fits.along)
        fits.look_from(HypothesisFit((), found, Projection(found)))
        return fits

    def timed(self, option: Option) -> Option:
        """A change in time with the onset that suits what the base leaves best; anything else as it is."""
        return with_best_onset(self.base.found, self.base.projection, option)

    def refit(self, sets: Sequence[tuple[Option, ...]]) -> list[HypothesisFit] | None:
        """Trials that converged, best first; None when there were some and none did."""
        trials: list[HypothesisFit] = []
        near, behind = worth_fitting(sets, self.base.found, self.along)
        for options, worse in behind:
            told = Rejected(Reason.WORSE, worse, "on a few of the records")
            self.rejected[" + ".join(o.label for o in options)] = told
        alone, best = objective_of(self.base.found.fit), np.inf
        most = 1 if self.onward else AT_ONCE
        some_by_some = (near[k : k + most] for k in range(0, len(near), most))
        for some in each(some_by_some, "fitting candidates", len(near), len):
            reach = reach_of(best, alone)
            for trial in self._attempted(some, reach):
                reached = objective_of(trial.found.fit)
                trial.found.model.forget_predictions()
                self.fitted[trial.label] = trial
                if trial.converged:
                    trials.append(trial)
                    best = min(best, reached)
                elif reached > reach.hopeless:
                    self.rejected[trial.label] = Rejected(Reason.WORSE, reached - best)
                else:
                    self.rejected[trial.label] = Rejected(Reason.NOT_CONVERGED, what=trial.found.reason)
        if sets and not trials:
            return None
        return sorted(trials, key=lambda t: t.weighed)

    def _attempted(
        self, sets: Sequence[tuple[tuple[Option, ...], Fit | None]], reach: FitBudget
    ) -> list[HypothesisFit]:
        """Fits of these sets, no further than is worth it, side by side."""

        def fitted(k: int) -> HypothesisFit:
            options, of_few = sets[k]
            return attempt(options, self._nearest(options), self.along, of_few, reach, onward=self.onward)

        every = list({o.label: o for options, _ in sets for o in options}.values())
        return parallel_map(fitted, len(sets), trials_handed(self.evidence, self.along, every))

    def _nearest(self, options: Sequence[Option]) -> IdentifiedHypothesis:
        """The fit that a fit of these goes on from: that with most of them, where these are few records; the base."""
        if not self.onward:
            return self.base.found
        own = {o.label for o in options}
        inner = (t for t in self.fitted.values() if t.converged and {o.label for o in t.options} < own)
        return max(inner, key=lambda t: len(t.options), default=self.base).found

    def named(
        self, trials: Sequence[HypothesisFit], weighed: Callable[[HypothesisFit], float] = lambda t: t.weighed
    ) -> list[Explanation]:
        """The alias set of the best adequate trial, best first; empty when none is adequate. `trials` are in the order
        of `weighed`, in units of χ². What is as far behind one that leaves a misfit is no explanation either: it only
        leaves more of it where nothing looks so closely."""
        adequate: list[tuple[HypothesisFit, float, float]] = []
        first: HypothesisFit | None = None  # that explains most, whether or not it explains all
        elsewhere = 0.0  # odds of what is too far behind to be told
        for trial in trials:
            behind = 0.0 if first is None else weighed(trial) - weighed(first)
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
            if first is None and (why is None or why.reason is Reason.LEAVES_MISFIT):
                first = trial
        if not adequate:
            return []
        odds = np.exp([-0.5 * (weighed(t) - weighed(adequate[0][0])) for t, _, _ in adequate])
        return [
            self.explanation(t, p, left, flights)
            for (t, left, flights), p in zip(adequate, odds / (odds.sum() + elsewhere), strict=True)
        ]

    def judge(self, trial: HypothesisFit, needed: bool = False) -> tuple[float, float, Rejected | None]:
        """What is left, share of flights gained, and why the trial is no explanation (None when it is one). `needed`:
        its members are known to be."""
        if trial.at_bound:
            return np.nan, np.nan, Rejected(Reason.AT_BOUND, what=", ".join(trial.at_bound))
        # what leaves no more than is allowed to be left may still have explained nothing
        idle = "" if needed else not_needed(trial, -np.log(ADEQUATE))
        if idle:
            return np.nan, np.nan, Rejected(Reason.NOT_NEEDED, what=idle)
        left = self.left(trial)
        if left.unranked or left.over(self.adequate):
            return left.surprise, np.nan, Rejected(Reason.LEAVES_MISFIT, left.surprise)
        flights = self.flights(trial)
        few = flights < MOST_FLIGHTS
        return left.surprise, flights, Rejected(Reason.FEW_FLIGHTS, flights) if few else None

    def flights(self, trial: HypothesisFit) -> float:
        """Share of the flights, held out in turn, that gain by a trial; NaN where that is not asked: of exact maps, and
        of changes in time."""
        if self.evidence.settings.map_accuracy > 0.0 and all(o.driver != TIME for o in trial.options):
            return flights_gained(self.base, trial)
        return float("nan")

    def left(self, trial: HypothesisFit) -> Remainder:
        """What a trial leaves, no further than to the first that is over the gates. Of the last few it is kept."""
        if trial.label not in self._left:
            self._left[trial.label] = left = self._looked(trial)
            for scored in (*left.scores[:1], *left.cells[:1]):
                scored.sums.columns.rest()
            for first in list(self._left)[:-REMEMBERED]:
                del self._left[first]
        return self._left[trial.label]

    def _looked(self, trial: HypothesisFit) -> Remainder:
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

    def counts(self, trial: HypothesisFit, best: Cell | None) -> bool:
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

    def explanation(self, t: HypothesisFit, probability: float, left: float, flights: float) -> Explanation:
        """A trial as it is told: its probability, −ln p of what it leaves, share of flights gained."""
        parameters = t.found.model.parameters
        found = tuple(Coefficient(n, parameters[n].unit, v, s, *t.intervals[n]) for n, (v, s) in t.coefficients.items())
        gain = self.base.objective - t.objective
        return Explanation(t.options, found, t.objective, gain, float(probability), left, flights, t.at_bound)
