"""One hypothesis fitted and looked at: what it explains, and what it leaves to be explained."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from enginediag_cli.drivers import TIME
from enginediag_cli.engine.driver import DriverValues
from enginediag_cli.engine.moving.tape import MOMENT
from enginediag_cli.engine.term import Effect
from enginediag_cli.identification.gauss_newton import Fit
from enginediag_cli.intervals import NORMAL_95
from enginediag_cli.mismatch.fit.believable import along_driver, with_belief
from enginediag_cli.mismatch.fit.columns import Columns
from enginediag_cli.mismatch.fit.families import Scored, correlations
from enginediag_cli.mismatch.fit.freeform import Cell, free_form, locations
from enginediag_cli.mismatch.fit.identified import ANY_REACH, Hypothesis, Identified, Nuisance, Reach, identify_with
from enginediag_cli.mismatch.fit.options import (
    EFFECT,
    FAULT,
    FREE,
    LAW,
    SENSOR_FAULT,
    Option,
    OptionScore,
    effect_option,
    effect_options,
    effects_of,
    option_scores,
    parameters_of,
    together,
)
from enginediag_cli.mismatch.fit.plateau import interval_at
from enginediag_cli.mismatch.fit.projection import Projection
from enginediag_cli.mismatch.fit.response import response_error, tolerated
from enginediag_cli.mismatch.fit.scores import critical_surprise, surprise
from enginediag_cli.mismatch.fit.spread import spread_of
from enginediag_cli.mismatch.fit.unmet import UNTOLD, largest
from enginediag_cli.parameters import Parameter
from enginediag_cli.progress import stage

SHARES = (0.5, 0.2, 0.3)
"""Of the probability of a false alarm: listed effects, changes in time, free form. What can be named is what is looked
for, and there are fewer of them."""

MEMORY_PRICE = 6.0
"""χ² that a further coefficient of an effect with memory must gain to put it before one that needs none: by chance it
gains so much one time in seventy. Judgement: effects with memory are nested in each other, others are not."""
LEFT_BEHIND = 0.2
"""Of two limits one that is found this much below the other may be where it is because nothing showed it. Judgement."""
FAULTS = (FAULT, SENSOR_FAULT)


@dataclass(frozen=True)
class Trial:
    """A fit with some options. `objective` is its χ² of readings and priors."""

    options: tuple[Option, ...]
    found: Identified
    projection: Projection

    @property
    def label(self) -> str:
        return " + ".join(o.label for o in self.options) or "nothing"

    @property
    def converged(self) -> bool:
        return self.found.converged

    @property
    def objective(self) -> float:
        return self.projection.objective

    @property
    def weighed(self) -> float:
        """The objective by which explanations are put in order: with a price for what makes one kind of memory another
        (the second of two lags), which always gains a little."""
        more = (len(e.amplitudes) - 1 for e in self.hypothesis.effects if e.tried)
        return self.objective + MEMORY_PRICE * sum(more)

    @cached_property
    def at_bound(self) -> tuple[str, ...]:
        """Coefficients of the options that ended at a physical bound."""
        held = dict(zip(self.found.problem.names, self.found.fit.at_bound, strict=True))
        # of two rates one may have no limit: that is no bound that holds the fit
        absent = {n for e in self.hypothesis.effects if e.tried and not all(held[s] for s in e.sizes) for n in e.sizes}
        closed = {e.parameter_name(c.name) for e in self.hypothesis.effects for c in e.term.COEFFICIENTS if c.closed}
        return tuple(n for n in self.hypothesis.names if held[n] and n not in absent | closed)

    @property
    def hypothesis(self) -> Hypothesis:
        return self.found.hypothesis

    @property
    def values(self) -> dict[str, float]:
        """Each of the options' coefficients, in its unit."""
        return {n: value for n, (value, _) in self.coefficients.items()}

    @cached_property
    def coefficients(self) -> dict[str, tuple[float, float]]:
        """Value and standard error of each of the options' coefficients, in its unit. One whitened Newton step is
        added where noise is correlated in time, since the fit itself only tempers it; not to laws, whose coefficients
        are known together, along a curve that no straight step keeps to. Errors of the maps are wrong responses, which
        those of effects that remember take up."""
        problem, projection = self.found.problem, self.projection
        index = {n: j for j, n in enumerate(problem.names)}
        free = np.cumsum(projection.free) - 1
        error = np.sqrt(np.diag(projection.covariance()))
        result = {}
        of_laws = {n for o in self.options if o.kind == LAW for n in o.hypothesis.names}
        for n in self.hypothesis.names:
            j = index[n]
            scale = problem.prior_sigma[j]
            value = self.found.theta[n]
            if projection.free[j] and n not in of_laws:
                value += float(projection.step[free[j]]) * scale
                value = float(np.clip(value, problem.lower[j], problem.upper[j]))
            result[n] = float(value), float(error[free[j]] * scale) if projection.free[j] else 0.0
        result |= self._spread(result)
        share, remembered = response_error(self.found), {n for e in self.hypothesis.effects for n in _remembered(e)}
        return {n: (v, float(np.hypot(s, share * v)) if n in remembered else s) for n, (v, s) in result.items()}

    @cached_property
    def intervals(self) -> dict[str, tuple[float, float]]:
        """95 % interval of each of the options' coefficients. That of one of an effect that remembers keeps to its
        bounds; where the records tell nothing of its derivative, as of a limit that nothing met, it ends at the size
        from which on they would; where they tell one end only, the other lies where χ² has risen (`plateau`)."""
        found = {n: (v - NORMAL_95 * s, v + NORMAL_95 * s) for n, (v, s) in self.coefficients.items()}
        parameters = self.found.model.parameters
        for n in (n for e in self.hypothesis.effects if e.tried for n in e.amplitudes):
            p, (low, high) = parameters[n], found[n]
            found[n] = max(low, p.lower), min(high, p.upper)
            if self.coefficients[n][1] > UNTOLD * p.prior_sigma and self._absent.get(n) == p.lower:
                found[n] = p.lower, largest(self.projection, n)
        for n in (e.parameter_name(c) for e in self.hypothesis.effects for c in e.term.one_sided):
            if self.converged and n in found and self.coefficients[n][1] > 0.0:
                found[n] = interval_at(self.found, n, self.coefficients[n][1])
        return found

    @property
    def _absent(self) -> dict[str, float]:
        """Sizes of effects that remember, with the value at which each is absent."""
        return {
            e.parameter_name(c.name): c.absent
            for e in self.hypothesis.effects
            if e.tried
            for c in e.term.amplitudes()
            if not c.free
        }

    def _spread(self, found: Mapping[str, tuple[float, float]]) -> dict[str, tuple[float, float]]:
        """Coefficients of effects with memory whose estimates spread more over stretches of the records than
        independent readings would: what a model leaves of a transient is no noise."""
        if not self.converged:
            return {}
        problem = self.found.problem
        wider: dict[str, tuple[float, float]] = {}
        free = dict(zip(problem.names, self.projection.free[: len(problem.names)], strict=True))
        for e in self.hypothesis.effects:
            names = [n for n in e.amplitudes if free[n]] if e.tried else []
            if not names:
                continue
            scale = problem.prior_sigma[[problem.names.index(n) for n in names]]
            error = np.sqrt(np.diag(spread_of(self.projection, names)[1].covariance)) * scale
            wider |= {n: (found[n][0], max(found[n][1], float(s))) for n, s in zip(names, error, strict=True)}
        return wider


@dataclass(frozen=True)
class Gates:
    """Thresholds on −ln p of the most surprising effect, change in time and free-form block, at one level together."""

    effects: float = np.inf
    faults: float = np.inf
    cells: float = np.inf

    def of(self, option: Option) -> float:
        """That of a listed option."""
        return self.effects if option.kind == EFFECT else self.faults


@dataclass(frozen=True)
class Remainder:
    """What a trial leaves: scores of the other options and the free-form map, most surprising first."""

    scores: tuple[OptionScore, ...]
    cells: tuple[Cell, ...]

    @property
    def surprise(self) -> float:
        """−ln p of the most surprising thing that is left; infinite when nothing can be ranked (the model gave no
        derivatives at the fit), which must not pass for nothing left."""
        if self.unranked:
            return np.inf
        best = max((s.surprise for s in self.scores), default=0.0)
        return max(best, max((c.surprise for c in self.cells), default=0.0))

    @property
    def unranked(self) -> bool:
        """Whether nothing of what was looked for can be ranked."""
        return bool(self.scores or self.cells) and not self.blocks()

    @property
    def unseen(self) -> tuple[str, ...]:
        """Labels of the effects of which nothing can be ranked."""
        seen = {s.option.label for s in self.scores if not s.score.absorbed}
        of_effects = (s.option.label for s in self.scores if s.option.driver != TIME)
        return tuple(dict.fromkeys(label for label in of_effects if label not in seen))

    def over(self, gates: Gates) -> bool:
        """Whether anything that is left is significant."""
        return (
            self.best(EFFECT) > gates.effects
            or self.best(*FAULTS) > gates.faults
            or (max((c.surprise for c in self.cells), default=0.0) > gates.cells)
        )

    def best(self, *kinds: str) -> float:
        """Largest −ln p of the options of these kinds."""
        return max((s.surprise for s in self.scores if s.option.kind in kinds), default=0.0)

    def gates(self, levels: Sequence[float], rng: np.random.Generator) -> tuple[Gates, ...]:
        """Gates at each level, which the three families share by SHARES."""
        scores = [s for s in self.scores if not s.score.absorbed]
        families: tuple[list[Scored], ...] = (
            list[Scored](s for s in scores if s.option.kind == EFFECT),
            list[Scored](s for s in scores if s.option.kind != EFFECT),
            list[Scored](c for c in self.cells if not c.score.absorbed),
        )
        found = [
            critical_surprise(*correlations(blocks), [share * level for level in levels], rng)
            for blocks, share in zip(families, SHARES, strict=True)
        ]
        return tuple(Gates(*g) for g in zip(*found, strict=True))

    def tolerant(self, share: float) -> Remainder:
        """What is left beyond a non-centrality of `share`."""
        return Remainder(
            tuple(replace(s, score=tolerated(s, share)) for s in self.scores),
            tuple(replace(c, score=tolerated(c, share)) for c in self.cells),
        )

    def judged_by(self, gates: Gates) -> list[tuple[Scored, float]]:
        """Everything that was looked for, with its gate."""
        of = [(s, gates.of(s.option)) for s in self.scores if s.feasible]
        return [*of, *((c, gates.cells) for c in self.cells)]

    def blocks(self) -> list[Scored]:
        """Everything that can be ranked."""
        return [b for b in (*self.scores, *self.cells) if not b.score.absorbed]

    def beside_noise(self) -> list[Scored]:
        """The same but for effects that go by readings as they were measured: some of these together are a reading's
        noise, which then would be explained."""
        return [b for b in self.blocks() if not (isinstance(b, OptionScore) and _goes_by_readings(b.option))]


def _goes_by_readings(option: Option) -> bool:
    return any(e.term.MEASURED for e in option.hypothesis.effects)


def attempt(
    options: Sequence[Option],
    start: Identified,
    along: Nuisance,
    of_few: Fit | None = None,
    reach: Reach = ANY_REACH,
    onward: bool = False,
) -> Trial:
    """Fit nuisance and options together to the evidence of another fit. It begins at the prior means, the nominal
    state: the other fit, without the options, is bent by what they explain; or where a fit `of_few` records ended.
    `reach`: how far it is worth its time. `onward`: it begins at the other fit and ends roughly, which is enough to
    compare sets by.

    Of effects that remember and act at one place, one works on what the other makes: a limit behind a lag is not a lag
    behind a limit. Both orders are fitted, and the better one is the trial."""
    trial = _attempt(options, start, along, of_few, reach, onward)
    if not _one_behind_the_other(options):
        return trial
    turned = _attempt(options[::-1], start, along, None, reach)
    better = turned.converged and (not trial.converged or turned.objective < trial.objective)
    return turned if better else trial


def _remembered(effect: Effect) -> tuple[str, ...]:
    """Coefficients of an effect that remembers; none of any other."""
    return effect.amplitudes if MOMENT in effect.term.INPUTS else ()


def _one_behind_the_other(options: Sequence[Option]) -> bool:
    """Whether two of the options remember and act on the same thing; a law follows what both leave."""
    effects = [e for o in options if o.kind != LAW for e in o.hypothesis.effects if _remembered(e)]
    acts_on = [n for e in effects for n in e.site.acts_on]
    return len(acts_on) > len(set(acts_on))


def _attempt(
    options: Sequence[Option],
    start: Identified,
    along: Nuisance,
    of_few: Fit | None,
    reach: Reach,
    onward: bool = False,
) -> Trial:
    """The options in this order."""
    begun = start if onward else None
    found = identify_with(start.evidence, together(*options), along, begun, of_few, reach, onward)
    trial = Trial(tuple(options), found, Projection(found))
    evened = [_evened(o, found.theta) for o in options]
    if all(o is None for o in evened):
        return trial
    # where nothing met one of two limits, no derivative shows it: it is tried at the size of the other
    other = [e or o for e, o in zip(evened, options, strict=True)]
    again = identify_with(start.evidence, together(*other), along, reach=reach)
    second = Trial(tuple(other), again, Projection(again))
    return second if second.converged and second.objective < trial.objective else trial


def _evened(option: Option, theta: Mapping[str, float]) -> Option | None:
    """The option begun with all sizes alike, where one of them ended far below another; None elsewhere."""
    for e in option.hypothesis.effects:
        found = [theta[n] for n in e.sizes]
        if e.tried and len(found) > 1 and min(found) < LEFT_BEHIND * max(found):
            alike = {c.name: max(found) for c in e.term.amplitudes() if not c.free}
            return replace(option, hypothesis=Hypothesis((replace(e, values={**e.values, **alike}),)))
    return None


def begun(effects: Sequence[Effect], found: Identified) -> list[Option]:
    """Options of these effects, those that are tried at some size at the one that says most about what a fit without
    them leaves."""
    projection = Projection(found)
    best = []
    for effect in effects:
        scores = option_scores(found, projection, effect_options([effect])) if effect.tried else []
        told = max(scores, key=lambda s: s.score.statistic if s.feasible else -1.0, default=None)
        best.append(told.option if told is not None else effect_option(effect))
    return best


def not_needed(trial: Trial, least: float) -> str:
    """A listed option of the trial that is not needed, −ln p > `least`; empty without one."""
    return next((o.label for o in trial.options if o.kind != FREE and not is_needed(trial, o, least)), "")


def is_needed(trial: Trial, option: Option, least: float) -> bool:
    """Whether a coefficient of the option is further than −ln p = `least` from nothing."""
    own = [trial.coefficients[n] for n in option.hypothesis.sizes]
    z2 = max(((v / s) ** 2 for v, s in own if s > 0), default=0.0)
    if option.kind == LAW:
        z2 = max(z2, _beside_its_shape(trial, option))
    return not surprise(z2, 1) < least


def _beside_its_shape(trial: Trial, option: Option) -> float:
    """(v/s)² of the clearest size, shapes and further forms at its place held: what a law changes can be clear where
    neither size nor width is, since a wider one that is larger changes the same."""
    problem, free = trial.found.problem, trial.projection.free
    own = set(_acts_on(option))
    here = {n for o in trial.options if o.kind == LAW and own & set(_acts_on(o)) for n in o.hypothesis.names}
    at = [j for j, n in enumerate(problem.names) if n in here and free[j]]
    rows = (np.cumsum(free) - 1)[at]
    information = np.linalg.inv(trial.projection.covariance()[np.ix_(rows, rows)])
    sizes = [(k, problem.names[j]) for k, j in enumerate(at) if problem.names[j] in option.hypothesis.sizes]
    scale = dict(zip(problem.names, problem.prior_sigma, strict=True))
    return max((float((trial.coefficients[n][0] / scale[n]) ** 2 * information[k, k]) for k, n in sizes), default=0.0)


def _acts_on(option: Option) -> list[str]:
    return [n for e in option.hypothesis.effects for n in e.site.acts_on]


@stage("scoring effects")
def remainder(
    trial: Trial, library: Sequence[Option], drivers: Sequence[DriverValues], enough: Gates | None = None
) -> Remainder:
    """Scores of what the trial does not carry; drivers are over the records of the evidence. The map is left out where
    an option is already over the gates `enough`."""
    found, where = trial.found, locations(trial.found)
    names = [*parameters_of(library), *(p.parameter for p in where)]
    columns = Columns(found, names, [*effects_of(library), *(p.through for p in where if p.through is not None)])
    scores = sorted(option_scores(found, trial.projection, library, columns), key=lambda s: -s.surprise)
    left = Remainder(tuple(scores), ())
    if enough is not None and left.over(enough):
        return left
    parameters = found.evidence.engine.parameters
    cells = [_believed(c, parameters) for c in free_form(found, trial.projection, drivers, columns)]
    return Remainder(tuple(scores), tuple(sorted(cells, key=lambda c: -c.surprise)))


def _believed(cell: Cell, parameters: Mapping[str, Parameter]) -> Cell:
    """The cell judged with a prior on how far its place may vary: what is beyond belief does not stand out."""
    scale = along_driver(cell.location, parameters)
    return replace(
        cell, score=with_belief(cell.score, cell.sums.gram(cell.candidates), cell.sums.pulls(cell.candidates), scale)
    )
