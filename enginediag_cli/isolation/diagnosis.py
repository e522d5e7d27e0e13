"""The answer for one window, by parameter or by component.

By parameter: the posterior over sets, with the full nonlinear model where changes are too large for the quadratic one,
and with known signs of changes; whether the answer fits; faults of a catalogue by name; whether a sensor fault and a
component fault explain the data equally well.

By component: which of them changed, whatever each one's parameters did.

A set of components S changed with the probability of `SetPrior`, and in a component that changed every parameter
has the slab prior N(0, slab²·prior_sigma²): what wears a compressor costs efficiency and flow capacity together.
With β_S, I_SS the score and information of all parameters of S, scaled by D = slab·diag(prior_sigma),

    P(S | data) ∝ P(S) · mean over slabs of exp(½ β_Sᵀ A_S⁻¹ β_S − ½ log det A_S),    A_S = 1 + I_SS,

and of the leading sets the slab prior is cut to the way on which wear goes, as for parameters.
Where the maps of the model are generic this is surer than parameters: efficiency and flow capacity of one component
trade against each other with the shape of its map, and one parameter of a neighbour can imitate both together.
A sensor counts as a component of its own, with the prior that sensors have.

Named is what is itself more probable than not, see `median_model`: of few components, some of which changed,
a further one on which the data are silent is by the prior about as probable as not, and would come and go with noise.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace

import numpy as np

from enginediag_cli.faults.catalogue import FaultSet
from enginediag_cli.intake.agreement import RecordingMismatch
from enginediag_cli.isolation.catalogue import NamedIsolation, isolate_named, known_signs, one_sided_posterior
from enginediag_cli.isolation.methods import IsolationOptions, isolate, posterior_result
from enginediag_cli.isolation.nonlinear import CHECKED, NATS, WindowModel, nonlinear_posterior, quadratic_error
from enginediag_cli.isolation.posterior import SetInference, SetPosterior, set_posterior
from enginediag_cli.isolation.prior import InstrumentForms, SetPrior, are_sensors
from enginediag_cli.isolation.results import (
    ODDS,
    Adequacy,
    AmbiguityGroup,
    Explanation,
    SetIsolation,
    ambiguity_group,
    find_impossible_change,
    log_of_free_vector,
    noise_level,
    probability_of_unlisted,
    residual_fit,
    temper,
)
from enginediag_cli.isolation.subsets import enumeration_plan, log_leading_factors, size_limit
from enginediag_cli.probability import log_mean
from enginediag_cli.residuals.instruments import NoiseLevel
from enginediag_cli.residuals.score import Score
from enginediag_cli.residuals.statistics import LocalStatistics

MAX_SETS = 15_000
"""Enough for all sets of five components beside two of 13 instruments in two forms each."""
HALF = 0.5
"""Probability from which a component is named: as wrong a name as a missing one, both are least often so then."""


@dataclass(frozen=True)
class ComponentIsolation:
    """Components that changed.

    Attributes
    ----------
    components : tuple of str
        The answer; empty when nothing changed.
    probability, p_all : float
        Posterior probability of exactly this set, and that all of them changed, whatever else did.
    possible : tuple of str
        Further components that the most probable set holds, or that are more probable than not.
    alternatives : tuple of Explanation
        Other sets of components, the most probable first; with the answer they hold `coverage`.
    inclusion : dict of str to float
        Probability of each component to have changed.
    complete : bool
        False when the answer is as large as the largest set considered.
    adequacy : Adequacy
        Whether the answer fits, with every parameter of its components free.
    ambiguity : AmbiguityGroup or None
        The components that these data cannot separate, where the answer is one of them.
    """

    components: tuple[str, ...]
    probability: float
    alternatives: tuple[Explanation, ...]
    coverage: float
    inclusion: dict[str, float]
    complete: bool
    adequacy: Adequacy = field(default_factory=Adequacy)
    ambiguity: AmbiguityGroup | None = None
    possible: tuple[str, ...] = ()
    p_all: float = float("nan")


def component_posterior(
    score: Score, prior: SetPrior | None = None, *, largest: int | None = None
) -> tuple[tuple[str, ...], np.ndarray, np.ndarray, float]:
    """Components, sets of them (M, c) bool by falling probability, the probabilities (M,), summing to 1, and ln Z of
    all sets against no change.

    All sets of up to `largest` components are visited (default: as many as MAX_SETS allows).
    """
    prior = prior or SetPrior()
    owner = [p.component for p in score.described]
    components = tuple(dict.fromkeys(owner))
    # an instrument is wrong in one of its forms: each is a unit, and two of one instrument have the prior 0
    wrong, units = np.array([p.fails_alone for p in score.described], bool), list[list[int]]()
    for c in components:
        mine = [i for i, o in enumerate(owner) if o == c]
        units += [[i] for i in mine] if wrong[mine].all() else [mine]
    instruments = InstrumentForms.from_parameters([score.described[m[0]] for m in units])
    b, information = prior.scaled(score)
    p, width = len(owner), max(map(len, units), default=0)
    # every unit is filled up to the same width with a parameter of which the data tell nothing
    beta, I = np.zeros(p + 1), np.zeros((p + 1, p + 1))
    beta[:p], I[:p, :p] = b, information
    padded = np.array([m + [p] * (width - len(m)) for m in units], dtype=int).reshape(len(units), width)
    variance = np.square(prior.slabs)[:, None]
    u, forms, few = len(units), instruments.is_form, prior.max_sensor_faults
    every, _ = enumeration_plan(u, size_limit(u, largest, MAX_SETS, int(forms.sum()), few), tuple(forms.tolist()), few)
    log_prior = prior.log_probability(every, instruments)
    every, log_prior = every[np.isfinite(log_prior)], log_prior[np.isfinite(log_prior)]
    sizes = every.sum(axis=1)
    masks, logs = [every[:1]], [log_prior[:1]]
    for size in range(1, int(sizes.max()) + 1):
        mask = every[sizes == size]
        chosen = np.nonzero(mask)[1].reshape(len(mask), size)
        rows = padded[chosen].reshape(len(chosen), -1)
        A = np.eye(rows.shape[1]) + variance[:, :, None, None] * I[rows[:, :, None], rows[:, None, :]]
        right = np.broadcast_to(beta[rows][:, :, None], (*A.shape[:3], 1))
        gain = variance[:, :, None] * np.linalg.solve(A, right)[..., 0]
        each = 0.5 * np.sum(beta[rows] * gain, axis=2) - 0.5 * np.linalg.slogdet(A)[1]
        logs.append(log_mean(each) + log_prior[sizes == size])
        masks.append(mask)
    sets, weights = np.concatenate(masks), np.concatenate(logs)
    held = np.array([[i in m for i in range(p)] for m in units], bool).reshape(u, p)
    weights = weights + log_leading_factors(score, sets @ held, weights, prior)
    of_units = np.array([[owner[m[0]] == c for c in components] for m in units], bool).reshape(u, len(components))
    top = float(weights.max())
    total = top + float(np.log(np.exp(weights - top).sum()))
    return components, *_merge_equal_sets(sets @ of_units, np.exp(weights - top)), total


def _merge_equal_sets(sets: np.ndarray, weights: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Each of the sets (M, c) once, by falling probability, and the probabilities, of weights (M,)."""
    found, where = np.unique(sets, axis=0, return_inverse=True)
    total = np.bincount(where.reshape(-1), weights=weights, minlength=len(found))
    order = np.argsort(-total, kind="stable")
    return found[order], total[order] / total.sum()


def median_model(sets: np.ndarray, probabilities: np.ndarray) -> int:
    """Position of the set that is named among sets (M, c) bool by falling probability (M,): of the members of the most
    probable one those that are more probable than not, whatever else changed.

    They are the median probability model, which predicts better than the most probable one (Barbieri, M. M. and
    Berger, J. O. (2004) Annals of Statistics 32, 870–897), less what only other sets hold: a name that is missing does
    less harm than a wrong one. Where nothing is left, or a set that the data separate from the most probable one (see
    ODDS), that one is named: its members are then exchanges for others and form an ambiguity group.
    """
    members = sets[0] & (probabilities @ sets >= HALF)
    if not members.any():
        return 0
    found = np.flatnonzero((sets == members).all(axis=1))
    return int(found[0]) if found.size and probabilities[found[0]] >= probabilities[0] / ODDS else 0


def isolate_components(
    score: Score,
    options: IsolationOptions | None = None,
    statistics: LocalStatistics | None = None,
    disagreement: RecordingMismatch | None = None,
) -> ComponentIsolation:
    """The components that changed; of the options, those of the posterior method count.

    statistics: those of which `score` was made, for the question whether the answer fits, and disagreement of the
    recording with the engine, as in `diagnose`.
    """
    options = options or IsolationOptions()
    level = NoiseLevel() if statistics is None else noise_level(score, statistics)
    about, score = score, temper(score, level.factor)
    components, sets, probabilities, total = component_posterior(score, options.prior, largest=options.largest)
    answer, adequacy = median_model(sets, probabilities), Adequacy().include_disagreement(disagreement)
    if statistics is not None:
        names = _parameters(score, components, sets[answer])
        unlisted = probability_of_unlisted(level, total, log_of_free_vector(score, options.prior))
        adequacy = replace(residual_fit(about, statistics, names), noise=level.factor, unlisted=unlisted)
        adequacy = adequacy.include_disagreement(disagreement)
        if not adequacy.is_listed:
            adequacy = replace(adequacy, impossible_change=find_impossible_change(about, options.prior))
    listed = 1.0 - adequacy.unlisted
    probabilities = listed * probabilities
    own, inclusion = float(probabilities[answer]), probabilities @ sets
    count = min(int(np.searchsorted(np.cumsum(probabilities), listed * options.coverage - 1e-12)) + 1, len(sets))

    def named(row: np.ndarray) -> tuple[str, ...]:
        return tuple(c for c, member in zip(components, row, strict=True) if member)

    limit = int(sets.sum(axis=1).max())
    return ComponentIsolation(
        named(sets[answer]),
        own,
        tuple(Explanation(named(sets[i]), float(probabilities[i])) for i in range(count) if i != answer),
        options.coverage,
        dict(zip(components, map(float, inclusion), strict=True)),
        int(sets[0].sum()) < limit or limit == len(components),
        adequacy,
        ambiguity_group(components, sets, probabilities, answer),
        named((sets[0] | (inclusion >= HALF)) & ~sets[answer] & sets[answer].any()),
        min(float(probabilities[sets[:, sets[answer]].all(axis=1)].sum()), *inclusion[sets[answer]].tolist(), 1.0),
    )


def _parameters(score: Score, components: tuple[str, ...], members: np.ndarray) -> list[str]:
    """All parameters of the components chosen by `members` (c,) bool."""
    chosen = {c for c, member in zip(components, members, strict=True) if member}
    return [p.name for p in score.described if p.component in chosen]


LEAST = 0.05
"""An explanation this much less probable than the other, or less, is no alternative."""


@dataclass(frozen=True)
class SensorAmbiguity:
    """Two explanations that differ by a sensor's error in one and a component's change in the other.

    `sensors` and `components`: what is only in the one, and only in the other; `shared`: what is in both.
    """

    sensors: tuple[str, ...]
    components: tuple[str, ...]
    shared: tuple[str, ...]
    p_sensors: float
    p_components: float


def find_sensor_ambiguity(result: SetIsolation, score: Score) -> SensorAmbiguity | None:
    """The most probable pair of explanations, one of them the answer, in which a sensor stands against a
    component; None when there is no such pair or one of the two is improbable. `score`: of which the result was made,
    which knows what is a sensor's error."""
    answer, sensors = set(result.isolated), {p.name for p in score.described if p.belongs_to_instrument}
    for rival in result.alternatives:
        if rival.probability < LEAST * result.probability:
            continue
        only_answer, only_rival = answer - set(rival.parameters), set(rival.parameters) - answer
        if not only_answer or not only_rival:
            continue
        if only_answer <= sensors and not only_rival & sensors:
            return _sensor_ambiguity(only_answer, only_rival, answer, result.probability, rival)
        if only_rival <= sensors and not only_answer & sensors:
            return _sensor_ambiguity(only_rival, only_answer, answer, rival.probability, rival, result.probability)
    return None


def _sensor_ambiguity(
    sensors: set[str],
    components: set[str],
    answer: set[str],
    of_sensors: float,
    rival: Explanation,
    of_components: float | None = None,
) -> SensorAmbiguity:
    return SensorAmbiguity(
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
    """Options of the diagnosis of a window.

    Attributes
    ----------
    method : str
        Isolation method, by its name.
    isolation : IsolationOptions
        Options common to the methods.
    one_sided : bool
        Whether signs of changes are known: efficiencies fall, others follow the catalogue.
    nonlinear : str
        One of NONLINEAR: when leading sets are fitted with the full model.
    catalogue : FaultSet or None
        Faults that are named.
    """

    method: str = "posterior"
    isolation: IsolationOptions = field(default_factory=IsolationOptions)
    one_sided: bool = False
    nonlinear: str = "auto"
    catalogue: FaultSet | None = None


@dataclass(frozen=True)
class Diagnosis:
    """The answer for one window.

    Attributes
    ----------
    result : SetIsolation
        Changed parameters, alternatives and sizes.
    score : Score
        The score on which the result rests.
    catalogue : NamedIsolation or None
        The answer in terms of a fault catalogue, where one was given.
    sensor_ambiguity : SensorAmbiguity or None
        A sensor fault and a component fault that explain the data equally well.
    nonlinear : bool
        Whether the full engine model was fitted.
    adequacy : Adequacy
        Whether the answer fits.
    inference : SetInference or None
        The posterior over sets; None for other methods.
    """

    result: SetIsolation
    score: Score
    catalogue: NamedIsolation | None
    sensor_ambiguity: SensorAmbiguity | None
    nonlinear: bool
    adequacy: Adequacy = field(default_factory=Adequacy)
    inference: SetInference | None = None


def diagnose(
    score: Score,
    options: DiagnosisOptions,
    records: Callable[[], WindowModel | None] | None = None,
    statistics: LocalStatistics | None = None,
    disagreement: RecordingMismatch | None = None,
) -> Diagnosis:
    """Diagnosis of one window; `records` gives its records with the full model, when there are any.

    statistics: those of which `score` was made. With them the fit of the answer is tested, and where it
    fits badly the evidence is worth less; without them the model is taken to be right. disagreement: of the recording
    with the engine; where the file is likelier wrong than the engine the full model is not fitted.

    Methods other than the posterior are as `isolate` gives them. DataError when the score's parameters
    show no fault of the catalogue.
    """
    isolation = options.isolation
    health = int(np.sum(~are_sensors(score.described)))
    many = health > MANY and isolation.largest is None and isolation.faults is None
    if many:
        isolation = replace(isolation, largest=LARGEST_OF_MANY)
    large, adequacy, belief = False, Adequacy(), None
    if options.method == "posterior":
        if disagreement is not None and disagreement.is_likely_wrong:
            records = None
        belief, result, large, adequacy = _diagnose_by_posterior(
            score, isolation, options, records, statistics, disagreement
        )
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
    return Diagnosis(result, score, named, find_sensor_ambiguity(result, score), large, adequacy, belief)


def _diagnose_by_posterior(
    score: Score,
    isolation: IsolationOptions,
    options: DiagnosisOptions,
    records: Callable[[], WindowModel | None] | None,
    statistics: LocalStatistics | None,
    disagreement: RecordingMismatch | None,
) -> tuple[SetInference, SetIsolation, bool, Adequacy]:
    prior, notes = isolation.prior, []
    if options.one_sided:  # knows the signs by itself
        prior = replace(prior, p_recovery=0.5)
    level = NoiseLevel() if statistics is None else noise_level(score, statistics)
    about, score = score, temper(score, level.factor)
    posterior = set_posterior(score, prior, largest=isolation.largest, faults=isolation.faults)
    large, own, offset = False, dict[bytes, Score](), 0.0
    if options.nonlinear != "never" and records is not None and posterior.masks[0].any():
        model = records()
        if model is None:
            notes.append("the records are no longer at hand for the full model")
        else:
            model = model.scale_noise(level.factor)
            if options.nonlinear == "always" or quadratic_error(model, score, posterior.masks[:CHECKED]) > NATS:
                found = nonlinear_posterior(model, score, prior, largest=isolation.largest, faults=isolation.faults)
                score, posterior, prior = replace(found.score, doubt=score.doubt), found.posterior, found.prior
                large, own, offset = True, dict(found.own_scores), found.offset
                about = temper(score, 1 / level.factor)
                if not found.converged:
                    notes.append("a fit of the full model did not converge")
    if options.one_sided:
        faults = options.catalogue.components if options.catalogue is not None else ()
        signs = known_signs(score.described, faults)
        posterior = one_sided_posterior(score, posterior, signs, prior)
    adequacy = Adequacy().include_disagreement(disagreement)
    if statistics is not None:
        free = log_of_free_vector(score, prior) + offset
        unlisted = probability_of_unlisted(level, posterior.log_total, free)
        adequacy = Adequacy(noise=level.factor, unlisted=unlisted).include_disagreement(disagreement)
        if not adequacy.is_listed:
            adequacy = replace(adequacy, impossible_change=find_impossible_change(about, prior))
    result = posterior_result(score, posterior, isolation, prior, own, 1.0 - adequacy.unlisted)
    if statistics is not None:
        fit = residual_fit(about, statistics, result.isolated)
        adequacy = replace(adequacy, fit=fit.fit, fit_before=fit.fit_before, explained=fit.explained)
    if notes:
        note = "; ".join(filter(None, [result.note, *notes]))
        result = replace(result, note=note, complete=result.complete and len(notes) == 0)
    return SetInference(score, posterior, prior, own), result, large, adequacy


def infer_components(score: Score, prior: SetPrior, largest: int | None = None) -> SetInference:
    """The posterior over sets of components, each with all its parameters, as one over sets of parameters."""
    components, sets, probabilities, _ = component_posterior(score, prior, largest=largest)
    held = np.array([[p.component == c for p in score.described] for c in components], bool)
    masks = (sets[:, :, None] & held).any(axis=1)
    posterior = SetPosterior(
        score.parameters, masks, probabilities, probabilities @ masks, 0.0, int(masks.sum(axis=1).max())
    )
    return SetInference(score, posterior, prior)
