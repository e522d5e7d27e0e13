"""What may explain a mismatch: a listed effect, or a change in time of one engine or of one sensor.

A fault begins and stays; an effect repeats with its driver. Both are columns at the same fit, so they are rivals.
Onsets are tried at the flights' beginnings and at the quarters of each flight, at most 24 of each engine.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from enginediag_cli.drivers import TIME
from enginediag_cli.engine.term import Driver, Effect
from enginediag_cli.mismatch.fit.columns import Columns
from enginediag_cli.mismatch.fit.evidence import Dataset
from enginediag_cli.mismatch.fit.extended import Discrepancy
from enginediag_cli.mismatch.fit.families import Candidates, Scored, Sums, grid
from enginediag_cli.mismatch.fit.identified import Hypothesis, IdentifiedHypothesis
from enginediag_cli.mismatch.fit.nuisance import READ_WRONG, scales_not_identified
from enginediag_cli.mismatch.fit.projection import Projection, Score
from enginediag_cli.parameters import Parameter

EFFECT, FORMULA_OPTION, FAULT, SENSOR_FAULT = "effect", "law", "fault", "sensor fault"
FREE = "free form"
"""Kind of an unlisted effect: free curves of one place along one driver."""
PARTS_OF_FLIGHT = 4
"""Onsets that are tried in a flight: the best is refined between its neighbours."""
ONSETS_AT_ONCE = 400
"""Onsets, evenly spaced, of one look about an option's own; where they lie apart, the best is looked about again."""
UNSEEN = 1e-3
"""Standard deviations, root sum of squares over all readings, that an effect of the largest size would move them by:
less is rounding, of which a score would make anything."""
LEAST_RECORDS = 8  # on either side of an onset
MOST_ONSETS = 24
"""Onsets that are tried in all; with many flights every second or third flight's are."""


@dataclass(frozen=True)
class Option:
    """One thing that may be added to the model. `component`: where an engineer would look; `driver`: what the effect
    varies with, or TIME; `target`: the parameter
    that a fault changes; `tried`: the direction of the trial that an effect is scored by, and whose size a fit of it
    begins at, where its derivative at absence tells nothing."""

    kind: str
    label: str
    component: str
    driver: Driver
    hypothesis: Hypothesis
    target: Parameter | None = None
    tried: str = ""

    @property
    def directions(self) -> list[str]:
        """What an option of effects is scored along: its trial, or the amplitudes of its effects."""
        return [self.tried] if self.tried else [a for e in self.hypothesis.effects for a in e.amplitudes]


@dataclass(frozen=True)
class OptionScore(Scored):
    """Score of an option; `feasible`: its first one-step coefficient has a sign that physics allows."""

    option: Option
    feasible: bool

    @property
    def z(self) -> float:
        """Of the first column alone."""
        return float(self.sums.pulls(self.candidates)[0]) / max(self.score.length, 1e-300)

    @property
    def surprise(self) -> float:
        """−ln p, 0 for what cannot be ranked: absorbed by the nuisance, or of an impossible sign."""
        return 0.0 if self.score.absorbed or not self.feasible else self.score.surprise


def effect_option(effect: Effect) -> Option:
    return Option(EFFECT, effect.label, effect.site.component, effect.term.DRIVER, Hypothesis((effect,)))


def effect_options(effects: Iterable[Effect]) -> list[Option]:
    """One option of each effect, or one of each of its trials."""
    found: list[Option] = []
    for effect in effects:
        option = effect_option(effect)
        for tried, values in zip(effect.trial_names, effect.term.TRIALS, strict=True):
            begun = replace(effect, values={**effect.values, **values})
            found.append(replace(option, hypothesis=Hypothesis((begun,)), tried=tried))
        if not effect.trial_names:
            found.append(option)
    return found


def combine_options(*options: Option) -> Hypothesis:
    """All of them at once."""
    hypotheses = [o.hypothesis for o in options]
    return Hypothesis(
        tuple(e for h in hypotheses for e in h.effects),
        tuple(d for h in hypotheses for d in h.discrepancies),
        {k: v for h in hypotheses for k, v in h.curves.items()},
    )


def fault_options(found: IdentifiedHypothesis) -> list[Option]:
    """A step in time of every health parameter that is identified, and of every recorded sensor's scale, on each
    engine: an instrument may go wrong whether or not its constant error is identified."""
    evidence = found.evidence
    parameters = evidence.engine.parameters
    watched = [n for n in found.problem.names if n in parameters and parameters[n].family in ("health", "sensor")]
    watched += [p.name for p in scales_not_identified(evidence.engine, found.problem.sensors, watched)]
    reads = [n for n in watched if parameters[n].belongs_to_sensor and parameters[n].quantity in READ_WRONG]
    watched = [n for n in watched if n in evidence.engine.monitored or n in reads]
    # a sensor's scale and bias step alike within what a flight spans
    scaled = {parameters[n].component for n in watched if parameters[n].quantity == "scale"}
    watched = [n for n in watched if not (parameters[n].quantity == "bias" and parameters[n].component in scaled)]
    result = []
    for name, curve in _steps(found).items():
        for n in watched:
            sensor, component = parameters[n].belongs_to_sensor, parameters[n].component
            d = Discrepancy(n, name, parameters[n].prior_sigma)
            result.append(
                Option(
                    SENSOR_FAULT if sensor else FAULT,
                    f"{n} {name}",
                    component,
                    TIME,
                    Hypothesis((), (d,), {name: curve}),
                    parameters[n],
                )
            )
    return result


def _steps(found: IdentifiedHypothesis) -> dict[str, np.ndarray]:
    """Curves (records of the evidence,) that step from 0 to 1, per engine, by a name that says when."""
    steps: dict[str, np.ndarray] = {}
    evidence = found.evidence
    sizes = [len(next(iter(f.columns.values()))) for f in evidence.flights]
    starts = np.concatenate([[0], np.cumsum(sizes)])
    for name in evidence.engines:
        own = [
            start + part * n // PARTS_OF_FLIGHT
            for f, start, n in zip(evidence.flights, starts, sizes, strict=False)
            if f.engine == name
            for part in range(PARTS_OF_FLIGHT)
        ]
        for onset in own[:: -(-len(own) // MOST_ONSETS)]:
            steps |= _step(evidence, int(onset))
    return steps


def _step(evidence: Dataset, onset: int) -> dict[str, np.ndarray]:
    """The curve that steps at a record, counted over the evidence, on that record's engine; none too near an end."""
    flight = np.repeat(
        np.arange(len(evidence.flights)), [len(next(iter(f.columns.values()))) for f in evidence.flights]
    )
    engine = np.array([evidence.engines.index(f.engine) for f in evidence.flights])[flight]
    mine = engine == engine[onset]
    curve = (mine & (np.arange(len(mine)) >= onset)).astype(float)
    if min(curve.sum(), mine.sum() - curve.sum()) < LEAST_RECORDS:
        return {}
    first = int(np.flatnonzero(flight == flight[onset])[0])
    own = evidence.flights[flight[onset]]
    return {f"since {own.moment(onset - first)} of {own.label}": curve}


def with_best_onset(found: IdentifiedHypothesis, projection: Projection, option: Option) -> Option:
    """A change in time with the onset, to the record, that scores best about its own; any other option as it is."""
    if option.driver != TIME:
        return option
    (d,) = option.hypothesis.discrepancies
    evidence, at = found.evidence, onset(option)
    total = len(option.hypothesis.curves[d.curve])
    reach = max(2, -(-total // min(MOST_ONSETS, PARTS_OF_FLIGHT * len(evidence.flights))))
    columns = Columns(found, [d.target], [])
    name, curve = d.curve, option.hypothesis.curves[d.curve]
    while True:
        apart = -(-2 * reach // ONSETS_AT_ONCE)
        tried = range(max(at - reach, 0), min(at + reach, total - 1) + 1, apart)
        steps = {key: (k, c) for k in tried for key, c in _step(evidence, k).items()}
        if not steps:
            break
        curves = np.stack([c[found.number] for _, c in steps.values()], axis=1)
        sums = Sums(projection, columns, grid([d.target], curves, [[k] for k in range(len(steps))]))
        scores = [sums.score(np.array([[0, k]])).statistic for k in range(len(steps))]
        name = list(steps)[int(np.argmax(scores))]
        at, curve = steps[name]
        if apart == 1:
            break
        reach = apart
    return _begun(option, name, curve)


def onset(option: Option) -> int:
    """The record, counted over the evidence, with which a change in time begins."""
    (d,) = option.hypothesis.discrepancies
    return int(np.flatnonzero(option.hypothesis.curves[d.curve])[0])


def stepping(option: Option, evidence: Dataset, at: int) -> Option:
    """A change in time as one that begins with a record of this evidence, which is not too near an end."""
    ((name, curve),) = _step(evidence, at).items()
    return _begun(option, name, curve)


def begun_with(option: Option, other: Option) -> Option:
    """A change in time that begins with the record with which another does; any other option as it is."""
    if not option.driver == other.driver == TIME:
        return option
    (of,) = other.hypothesis.discrepancies
    return _begun(option, of.curve, other.hypothesis.curves[of.curve])


def _begun(option: Option, name: str, curve: np.ndarray) -> Option:
    (d,) = option.hypothesis.discrepancies
    return Option(
        option.kind,
        f"{d.target} {name}",
        option.component,
        TIME,
        Hypothesis((), (Discrepancy(d.target, name, d.sigma),), {name: curve}),
        option.target,
    )


def effects_of(options: Sequence[Option]) -> list[Effect]:
    """Absent, where they are scored by a trial."""
    return [replace(e, values={}) if o.tried else e for o in options for e in o.hypothesis.effects]


def parameters_of(options: Sequence[Option]) -> list[str]:
    """Amplitudes of the options' effects and targets of their discrepancies."""
    targets = (d.target for o in options for d in o.hypothesis.discrepancies)
    return [*(a for o in options for a in o.directions), *dict.fromkeys(targets)]


def option_scores(
    found: IdentifiedHypothesis, projection: Projection, options: Sequence[Option], columns: Columns | None = None
) -> list[OptionScore]:
    """Scores of options that the fit does not carry; `columns` of at least `parameters_of` them, if known. An option is
    of effects or of discrepancies, not of both."""
    carried = set(found.hypothesis.names)
    options = [o for o in options if not carried & set(o.hypothesis.names)]
    if not options:
        return []
    J = columns or Columns(found, parameters_of(options), effects_of(options))
    effects = [o for o in options if o.hypothesis.effects]
    changes = [o for o in options if not o.hypothesis.effects]
    scored = {**_effects_scored(projection, J, effects), **_changes_scored(projection, J, changes)}
    return [scored[id(o)] for o in options]


def _effects_scored(projection: Projection, J: Columns, options: Sequence[Option]) -> dict[int, OptionScore]:
    """By the option's identity."""
    names = [a for o in options for a in o.directions]
    if not names:
        return {}
    sums = Sums(projection, J, grid(names, np.ones((len(projection.found.number), 1)), [[0]]).whole)
    at = {n: k for k, n in enumerate(names)}
    blocks = (np.array([[at[a], 0] for a in o.directions]) for o in options)
    return {id(o): _scored(o, sums, own) for o, own in zip(options, blocks, strict=True)}


def _changes_scored(projection: Projection, J: Columns, options: Sequence[Option]) -> dict[int, OptionScore]:
    """By the option's identity."""
    if not options:
        return {}
    targets = list(dict.fromkeys(d.target for o in options for d in o.hypothesis.discrepancies))
    curves = {k: v for o in options for k, v in o.hypothesis.curves.items()}
    along = {k: j for j, k in enumerate(curves)}
    phi = np.stack([c[projection.found.number] for c in curves.values()], axis=1)
    candidates = [
        np.array([[targets.index(d.target), along[d.curve]] for d in o.hypothesis.discrepancies]) for o in options
    ]
    family = grid(targets, phi, {tuple(c[:, 1]) for c in candidates})
    sums = Sums(projection, J, family if all(len(set(c[:, 0])) == 1 for c in candidates) else family.whole)
    return {id(o): _scored(o, sums, c) for o, c in zip(options, candidates, strict=True)}


def _scored(option: Option, sums: Sums, candidates: Candidates) -> OptionScore:
    score = sums.score(candidates)
    if option.hypothesis.effects and score.length * _largest(option) < UNSEEN:
        score = replace(score, dof=0, statistic=0.0, surprise=0.0, share=0.0)
    return OptionScore(sums, candidates, score, option, _feasible(option, score))


def _largest(option: Option) -> float:
    """How far the coefficient that an option is scored by first can move."""
    first = option.hypothesis.effects[0].term.amplitudes()[0]
    return 1.0 if option.tried else first.upper - first.lower


def _feasible(option: Option, score: Score) -> bool:
    """Whether the first coefficient of an effect moves to where physics lets it."""
    if not score.dof:
        return False
    if option.tried:
        return bool(score.coefficients[0] > 0.0)
    for effect in option.hypothesis.effects:
        first = effect.term.amplitudes()[0]
        at, to = first.absent, first.absent + score.coefficients[0]
        return bool(not (first.lower >= at and to < at) and not (first.upper <= at and to > at))
    return True
