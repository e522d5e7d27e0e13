"""One answer for one window: which parameters changed, by all that is asked for.

The posterior over sets, with the full nonlinear model where changes are too large for the quadratic one, and with
what is known of signs; whether the answer fits; faults of a catalogue by name; whether a sensor and a component are
rivals.

A sensor and a component as rivals: is the instrument wrong, or the engine?
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace

import numpy as np

from enginediag_cli.faults.component_faults import FaultSet
from enginediag_cli.intake.agreement import Disagreement
from enginediag_cli.isolation.adequacy import (
    Adequacy,
    beyond_bounds,
    fit_after,
    log_of_free_vector,
    noise_level,
    probability_of_unlisted,
    tempered,
)
from enginediag_cli.isolation.belief import Belief
from enginediag_cli.isolation.large_faults import CHECKED, NATS, WindowModel, nonlinear_posterior, quadratic_error
from enginediag_cli.isolation.methods import IsolationOptions, isolate, posterior_result
from enginediag_cli.isolation.named_faults import NamedIsolation, isolate_named
from enginediag_cli.isolation.posterior import set_posterior
from enginediag_cli.isolation.prior import are_sensors
from enginediag_cli.isolation.result import Explanation, IsolationResult
from enginediag_cli.isolation.signs import known_signs, one_sided_posterior
from enginediag_cli.residuals.instruments import NoiseLevel
from enginediag_cli.residuals.score import Score
from enginediag_cli.residuals.statistics import LocalStatistics

LEAST = 0.05
"""A rival this much less probable than the other, or less, is no rival."""


@dataclass(frozen=True)
class SensorRivalry:
    """Two explanations that differ by a sensor's error in one and a component's change in the other.

    `sensors` and `components`: what is only in the one, and only in the other; `shared`: what is in both.
    """

    sensors: tuple[str, ...]
    components: tuple[str, ...]
    shared: tuple[str, ...]
    of_sensors: float
    of_components: float


def sensor_rivalry(result: IsolationResult, score: Score) -> SensorRivalry | None:
    """The most probable pair of explanations, one of them the answer, in which a sensor stands against a
    component; None when there is no such pair or one of the two is improbable. `score`: of which the result was made,
    which knows what is a sensor's error."""
    answer, sensors = set(result.isolated), {p.name for p in score.described if p.of_instrument}
    for rival in result.rivals:
        if rival.probability < LEAST * result.probability:
            continue
        only_answer, only_rival = answer - set(rival.parameters), set(rival.parameters) - answer
        if not only_answer or not only_rival:
            continue
        if only_answer <= sensors and not only_rival & sensors:
            return _rivalry(only_answer, only_rival, answer, result.probability, rival)
        if only_rival <= sensors and not only_answer & sensors:
            return _rivalry(only_rival, only_answer, answer, rival.probability, rival, result.probability)
    return None


def _rivalry(
    sensors: set[str],
    components: set[str],
    answer: set[str],
    of_sensors: float,
    rival: Explanation,
    of_components: float | None = None,
) -> SensorRivalry:
    return SensorRivalry(
        tuple(sorted(sensors)),
        tuple(sorted(components)),
        tuple(sorted(answer & set(rival.parameters))),
        of_sensors,
        rival.probability if of_components is None else of_components,
    )


NONLINEAR = ("auto", "always", "never")
MANY = 12
"""Up to twelve parameters all sets can be visited in a second."""
LARGEST_OF_MANY = 5
"""Of more than MANY parameters of health, no more than so many change together unless asked otherwise: a second's work
becomes hundredths."""


@dataclass(frozen=True)
class DiagnosisOptions:
    """`isolation`: choices common to the methods; one_sided: efficiencies fall, other signs from the catalogue;
    nonlinear: one of NONLINEAR; catalogue: faults to be named."""

    method: str = "posterior"
    isolation: IsolationOptions = field(default_factory=IsolationOptions)
    one_sided: bool = False
    nonlinear: str = "auto"
    catalogue: FaultSet | None = None


@dataclass(frozen=True)
class Diagnosis:
    """The result, the score that it rests on, and what else was asked for; adequacy: whether the answer fits; belief:
    the posterior over sets, None of other methods."""

    result: IsolationResult
    score: Score
    named: NamedIsolation | None
    rivalry: SensorRivalry | None
    nonlinear: bool
    adequacy: Adequacy = field(default_factory=Adequacy)
    belief: Belief | None = None


def diagnose(
    score: Score,
    options: DiagnosisOptions,
    records: Callable[[], WindowModel | None] | None = None,
    statistics: LocalStatistics | None = None,
    disagreement: Disagreement | None = None,
) -> Diagnosis:
    """Diagnosis of one window; `records` gives its records with the full model, when there are any.

    statistics: those of which `score` was made. With them the posterior's answer is asked whether it fits, and where it
    fits badly the evidence is worth less; without them the model is taken to be right. disagreement: of the recording
    with the engine; where the file is likelier wrong than the engine no full model is asked for what it cannot explain.

    Methods other than the posterior are as `isolate` gives them. DataError when no fault of the catalogue can
    be told by the score's parameters.
    """
    isolation = options.isolation
    health = int(np.sum(~are_sensors(score.described)))
    many = health > MANY and isolation.largest is None and isolation.faults is None
    if many:
        isolation = replace(isolation, largest=LARGEST_OF_MANY)
    large, adequacy, belief = False, Adequacy(), None
    if options.method == "posterior":
        if disagreement is not None and disagreement.doubtful:
            records = None
        belief, result, large, adequacy = _by_posterior(score, isolation, options, records, statistics, disagreement)
        score = belief.score
    else:
        result = isolate(score, options.method, isolation)
    named = None
    if options.catalogue is not None:
        named = isolate_named(
            score,
            options.catalogue,
            prior=isolation.prior,
            coverage=isolation.coverage,
            confidence=isolation.confidence,
            largest=isolation.largest,
        )
    return Diagnosis(result, score, named, sensor_rivalry(result, score), large, adequacy, belief)


def _by_posterior(
    score: Score,
    isolation: IsolationOptions,
    options: DiagnosisOptions,
    records: Callable[[], WindowModel | None] | None,
    statistics: LocalStatistics | None,
    disagreement: Disagreement | None,
) -> tuple[Belief, IsolationResult, bool, Adequacy]:
    prior, notes = isolation.prior, []
    if options.one_sided:  # knows the signs by itself
        prior = replace(prior, rises=0.5)
    level = NoiseLevel() if statistics is None else noise_level(score, statistics)
    about, score = score, tempered(score, level.factor)
    posterior = set_posterior(score, prior, largest=isolation.largest, faults=isolation.faults)
    large, own, offset = False, dict[bytes, Score](), 0.0
    if options.nonlinear != "never" and records is not None and posterior.masks[0].any():
        model = records()
        if model is None:
            notes.append("the records are no longer at hand for the full model")
        else:
            model = model.with_noise(level.factor)
            if options.nonlinear == "always" or quadratic_error(model, score, posterior.masks[:CHECKED]) > NATS:
                found = nonlinear_posterior(model, score, prior, largest=isolation.largest, faults=isolation.faults)
                score, posterior, prior = replace(found.score, doubt=score.doubt), found.posterior, found.prior
                large, own, offset = True, dict(found.about), found.offset
                about = tempered(score, 1 / level.factor)
                if not found.converged:
                    notes.append("a fit of the full model did not converge")
    if options.one_sided:
        faults = options.catalogue.components if options.catalogue is not None else ()
        signs = known_signs(score.described, faults)
        posterior = one_sided_posterior(score, posterior, signs, prior)
    adequacy = Adequacy().of_file(disagreement)
    if statistics is not None:
        free = log_of_free_vector(score, prior) + offset
        unlisted = probability_of_unlisted(level, posterior.log_total, free)
        adequacy = Adequacy(noise=level.factor, unlisted=unlisted).of_file(disagreement)
        if not adequacy.stands:
            adequacy = replace(adequacy, beyond=beyond_bounds(about, prior))
    result = posterior_result(score, posterior, isolation, prior, own, 1.0 - adequacy.unlisted)
    if statistics is not None:
        fit = fit_after(about, statistics, result.isolated)
        adequacy = replace(adequacy, fit=fit.fit, before=fit.before, explained=fit.explained)
    if notes:
        note = "; ".join(filter(None, [result.note, *notes]))
        result = replace(result, note=note, complete=result.complete and len(notes) == 0)
    return Belief(score, posterior, prior, own), result, large, adequacy
