"""Refinement: fit the effects that a model lacks on some flights, and see whether it predicts others better.

It is refused when a fit does not converge, when a coefficient ends at its physical bound, or when one of its `criteria`
is not met; where unseen flights cannot tell, it is not judged. Nothing is written in either case.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from enginediag_cli.engine.term import Effect
from enginediag_cli.mismatch.fit.attempt import attempt, begun
from enginediag_cli.mismatch.fit.evidence import Dataset, Flight
from enginediag_cli.mismatch.fit.identified import NULL_HYPOTHESIS, Nuisance, driver_values, identify_with, nuisance
from enginediag_cli.mismatch.fit.noise import estimated_noise, with_noise
from enginediag_cli.mismatch.fit.options import effect_options
from enginediag_cli.mismatch.fit.projection import Projection
from enginediag_cli.mismatch.fit.remainder import remainder
from enginediag_cli.mismatch.fit.trial import HypothesisFit
from enginediag_cli.mismatch.refine.alarms import Alarms, alarms
from enginediag_cli.mismatch.refine.criteria import Criterion, Prediction, Verdict, verdict
from enginediag_cli.mismatch.refine.significance import significance
from enginediag_cli.mismatch.refine.switch import compare_switched, switch_column, with_states
from enginediag_cli.mismatch.refine.unseen import Unseen, compare, concealed
from enginediag_cli.mismatch.unrecorded.hidden import HiddenFinding
from enginediag_cli.physics.registry import candidate_effects, separate_effects
from enginediag_cli.progress import stage

WINDOW = 30
"""Records of a window that is counted as alarm or not, as usual in `detect`."""
NOISE_PASSES = 2
"""Estimates of the noise at a fit, each with a fit after it; a third changes nothing that matters."""
STANDS_OUT = 10.0
"""−ln p that nothing reaches by chance, however many things are tried (about 1 in 200 searches)."""


@dataclass(frozen=True)
class Refinement:
    """`failed`: why nothing could be judged, or empty. `effects`: with fitted values; `criteria`: all that were asked;
    what was not reached is empty or None."""

    failed: str
    effects: tuple[Effect, ...]
    standard_errors: dict[str, float]  # by parameter name
    before: HypothesisFit
    after: HypothesisFit | None = None
    unseen: Unseen | None = None
    criteria: tuple[Criterion, ...] = ()
    alarms_before: Alarms | None = None
    alarms_after: Alarms | None = None
    flights: tuple[Flight, ...] = ()  # with the inferred states of a hidden switch in their column
    still_missing: str = ""  # what the fitted flights still show with the effects

    @property
    def verdict(self) -> Verdict:
        return Verdict.REFUSED if self.failed else verdict(self.criteria)


def refine(
    evidence: Dataset,
    unseen: Sequence[int],
    effects: Sequence[Effect],
    *,
    hidden: HiddenFinding | None = None,
    window: int = WINDOW,
) -> Refinement:
    """Fit the effects on all flights but the `unseen` (by position), and judge by those. `hidden`: the finding of
    unrecorded states, on the flights that are fitted, by which the one effect switches.

    Raises ValueError when no flight is left to train on, or an engine has unseen flights only.
    """
    _check(evidence, unseen)
    if hidden is not None:
        training = [k for k in range(len(evidence.flights)) if k not in unseen]
        column = switch_column(effects[0])
        evidence = with_states(evidence, training, hidden, column)
        effects = [replace(effects[0], switch=column)]
    along = nuisance(concealed(evidence, unseen))
    if evidence.settings.noise == "estimate":
        evidence = _with_estimated_noise(evidence, unseen, effects, along)
    before, after = fit_both(concealed(evidence, unseen), effects, along)
    if not before.converged:
        return Refinement(f"the model as it is could not be fitted: {before.found.reason}", (), {}, before)
    if not after.converged:
        return Refinement(f"the fit with {after.label} did not converge: {after.found.reason}", (), {}, before)
    fitted, errors = _fitted(effects, after)
    if after.at_bound:
        reason = f"{', '.join(after.at_bound)} ends at a physical bound"
        return Refinement(reason, fitted, errors, before, after)
    if hidden is None:
        seen, prediction = compare(evidence, unseen, before, after, along)
        predictions: tuple[Prediction, ...] = (prediction,)
    else:
        seen, predictions, evidence = compare_switched(evidence, unseen, before, after, along, effects[0])
    criteria: tuple[Criterion, ...] = (*significance(effects, after), *predictions)
    found = Refinement("", fitted, errors, before, after, seen, criteria, flights=evidence.flights)
    if found.verdict is not Verdict.ACCEPTED:
        return found
    engine = evidence.engine
    refined = engine.replace_effects((*engine.effects, *fitted))
    return replace(
        found,
        alarms_before=alarms(engine, evidence, unseen, window),
        alarms_after=alarms(refined, evidence, unseen, window),
        still_missing=still_missing(after),
    )


@stage("fitting with and without the effect")
def fit_both(hidden: Dataset, effects: Sequence[Effect], along: Nuisance) -> tuple[HypothesisFit, HypothesisFit]:
    """The model as it is and with the effects, fitted to the same flights."""
    found = identify_with(hidden, NULL_HYPOTHESIS, along)
    after = attempt(begun(effects, found), found, along)
    return HypothesisFit((), found, Projection(found)), after


def _with_estimated_noise(
    evidence: Dataset, unseen: Sequence[int], effects: Sequence[Effect], along: Nuisance
) -> Dataset:
    """The evidence with the noise that the fitted flights show where nothing explains the readings."""
    for _ in range(NOISE_PASSES):
        after = fit_both(concealed(evidence, unseen), effects, along)[1]
        library = effect_options(candidate_effects(evidence.engine))
        rest = remainder(after, library, driver_values(after.found.evidence, after.found.theta))
        evidence = with_noise(evidence, estimated_noise(after.projection, rest.beside_noise()))
    return evidence


def still_missing(after: HypothesisFit) -> str:
    """The most surprising thing that the fitted flights show beyond the effects; empty when nothing stands out."""
    engine = after.found.evidence.engine
    carried = {own.label for e in after.hypothesis.effects for own in separate_effects(e)}
    library = effect_options(e for e in candidate_effects(engine) if e.label not in carried)
    rest = remainder(after, library, driver_values(after.found.evidence, after.found.theta))
    if rest.surprise <= STANDS_OUT:
        return ""
    if rest.scores and rest.scores[0].surprise >= rest.surprise:
        return f"{rest.scores[0].option.label} (−ln p = {rest.scores[0].surprise:.1f})"
    cell = rest.cells[0]
    return f"something at {cell.location.name} that varies with {cell.driver.name} (−ln p = {cell.surprise:.1f})"


def _fitted(effects: Sequence[Effect], trial: HypothesisFit) -> tuple[tuple[Effect, ...], dict[str, float]]:
    """The effects with the fit's coefficients, and the standard errors of these; what acts at several places by one
    size as an effect at each of them."""
    found: list[Effect] = []
    errors: dict[str, float] = {}
    for e in effects:
        values, own = dict(e.values), dict[str, float]()
        for c in e.term.amplitudes():
            value, own[c.name] = trial.coefficients[e.parameter_name(c.name)]
            values[c.name] = float(np.clip(value, c.lower, c.upper))
        for stated in separate_effects(replace(e, values=values)):
            found.append(stated)
            errors |= {stated.parameter_name(n): error for n, error in own.items()}
    return tuple(found), errors


def _check(evidence: Dataset, unseen: Sequence[int]) -> None:
    training = {f.engine for k, f in enumerate(evidence.flights) if k not in unseen}
    if not training:
        raise ValueError("no flight is left to fit the effects to")
    if not unseen:
        raise ValueError("no flight is left to judge by")
    for k in unseen:
        name = evidence.flights[k].engine
        if name not in training:
            raise ValueError(
                f"{evidence.flights[k].label}: engine {name!r} has no flight among those that are fitted, "
                "so its health is not known"
            )


def last_flights(flights: Sequence[Flight], count: int) -> list[int]:
    """Positions of the last `count` flights of every engine."""
    result = []
    for name in dict.fromkeys(f.engine for f in flights):
        result += [k for k, f in enumerate(flights) if f.engine == name][-count:]
    return sorted(result)
