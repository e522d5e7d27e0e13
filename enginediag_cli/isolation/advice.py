"""Advice: at which operating condition, with which further sensor or on which flight alternative
hypotheses separate soonest.

If the set A changed by Δ, the best account by the set B instead falls short, over records of information I, by

    λ = Δᵀ (I_AA − I_AB I_BB⁺ I_BA) Δ,

the non-centrality of the likelihood ratio between the two sets; n further records of information G each raise the
expected log odds of A over B by ½ [λ(I + nG) − λ(I)]. The advice is for the least favourable Δ of those that the
data allow, and for the less favourable of "A is true" and "B is true". A set that contains the other cannot lose
to it by this measure; then only the larger one being true counts. The gain is λ(n) of `planning.separation`, for what B
predicts when it is fitted to what A has shown so far, and may adapt within what is known of it and of nominal.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from itertools import permutations
from typing import Any

import numpy as np

from enginediag_cli.planning.flights import BEYOND, Outlook, Separation, Suggestion, best_first, fewest, flights
from enginediag_cli.residuals.instruments import NoiseModel
from enginediag_cli.residuals.monitor import Monitor
from enginediag_cli.residuals.score import Score
from enginediag_cli.residuals.statistics import covariance_root, whiten

ODDS = 20.0
"""Odds to one from which explanations count as separated: those of a 95 % test."""
ALLOWED = 0.8
"""Probability of the changes among which the least favourable is sought."""
MOST_RECORDS = 100_000
"""More records than any recording has: reported as “never”."""
FREE = 1e-10
"""Share of the largest information of a set below which a direction of it counts as unknown."""
LEADING = 4
"""Sets that flights are to separate, the most probable first. Judgement."""
POINTS = 24
"""Records by which a flight is judged: its course has a few corners."""
COMPUTED = 0.8
"""Share of a flight that the engine must have a prediction for."""


@dataclass(frozen=True)
class RecordingOption:
    """What could be recorded next: `label` and values in words' place, information per record (p_all, p_all) of
    the monitor's parameters, `inside_envelope`: identification has seen this operating condition."""

    label: str
    values: Mapping[str, float]
    information: np.ndarray
    inside_envelope: bool = True


@dataclass(frozen=True)
class Advice:
    """One option judged: non-centrality between the two sets per record, for a hundred records, and records needed
    for expected odds of `odds` to one (inf: more than MOST_RECORDS)."""

    label: str
    values: Mapping[str, float]
    noncentrality: float
    records: float
    odds: float
    inside_envelope: bool


def advise(
    score: Score,
    rivals: tuple[Sequence[str], Sequence[str]],
    options: Sequence[RecordingOption],
    uncertainty: np.ndarray,
    *,
    odds: float = ODDS,
    allowed: float = ALLOWED,
) -> list[Advice]:
    """Options by falling usefulness for separating the two `rivals`, sets of monitored parameters.

    uncertainty (p_all, p_all): covariance of what is uncertain about nominal and sensors, drawn anew for the
    further records. ValueError when both are the same set.
    """
    cases, root, wanted = _hardest_cases(score, rivals, allowed), _root(uncertainty), 2 * float(np.log(odds))
    judged = []
    for option in options:
        found = _separations(score, option.information, root, cases)
        needed = fewest(partial(_separates, found, wanted), MOST_RECORDS)
        judged.append(
            Advice(
                option.label, option.values, _least_separation(found, 100.0) / 100, needed, odds, option.inside_envelope
            )
        )
    return sorted(judged, key=lambda advice: (advice.records, -advice.noncentrality))


def noncentrality_gains(
    score: Score,
    rivals: tuple[Sequence[str], Sequence[str]],
    informations: Sequence[np.ndarray],
    *,
    allowed: float = ALLOWED,
) -> np.ndarray:
    """Gain (k,) of the non-centrality between the two sets from each of k further pieces of information (p, p) of the
    score's parameters, all else certain."""
    cases, certain = _hardest_cases(score, rivals, allowed), np.zeros((len(score.information), 0))
    return np.array(
        [_least_separation(_separations(score, information, certain, cases), 1.0) for information in informations]
    )


def _hardest_cases(
    score: Score, rivals: tuple[Sequence[str], Sequence[str]], allowed: float
) -> list[tuple[np.ndarray, np.ndarray, np.ndarray]]:
    """One set, the other, and the change of the first that is hardest to detect, for each set that may be true."""
    a, b = (score.indices(list(names)) for names in rivals)
    if set(a.tolist()) == set(b.tolist()):
        raise ValueError("the alternatives are the same set")
    changes = [_allowed_change(score, own, other, allowed) for own, other in ((a, b), (b, a))]
    return [(own, other, c) for (own, other), c in zip(((a, b), (b, a)), changes, strict=True) if c is not None]


def separable_information(information: np.ndarray, own: np.ndarray, other: np.ndarray) -> np.ndarray:
    """I_AA − I_AB I_BB⁺ I_BA (k, k): what the set `own` shows beyond what `other` can imitate."""
    if not len(other):
        return np.asarray(information[np.ix_(own, own)])
    eigenvalues, vectors = np.linalg.eigh(information[np.ix_(other, other)])
    kept = eigenvalues > 1e-10 * max(float(eigenvalues[-1]), 1e-300)
    half = information[np.ix_(own, other)] @ (vectors[:, kept] / np.sqrt(eigenvalues[kept]))
    return np.asarray(information[np.ix_(own, own)] - half @ half.T)


def _allowed_change(score: Score, own: np.ndarray, other: np.ndarray, allowed: float) -> np.ndarray | None:
    """Of the changes (k,), in prior_sigma, of the set `own` that the data allow, the one `other` imitates best.

    Minimum of a quadratic form over an ellipsoid about the estimate, by its Lagrange multiplier. None when
    `other` contains `own`.
    """
    if not len(own) or set(own.tolist()) <= set(other.tolist()):
        return None
    from scipy.optimize import brentq
    from scipy.special import chdtri

    b, information = score.scaled()
    I = information[np.ix_(own, own)] + 1e-9 * np.max(np.diag(information)) * np.eye(len(own))
    Q = separable_information(information, own, other)
    estimate = np.linalg.solve(I, b[own])
    radius = float(chdtri(len(own), 1 - allowed))

    def change(multiplier: float) -> np.ndarray:
        return np.asarray(np.linalg.solve(Q + multiplier * I, multiplier * I @ estimate))

    def excess(log_multiplier: float) -> float:
        away = change(float(np.exp(log_multiplier))) - estimate
        return float(away @ I @ away) - radius

    low, high = -30.0, 15.0
    return change(float(np.exp(low if excess(low) <= 0 else brentq(excess, low, high))))


def _separations(
    score: Score,
    information: np.ndarray,
    root: np.ndarray,
    cases: Sequence[tuple[np.ndarray, np.ndarray, np.ndarray]],
) -> list[Separation]:
    """λ(n) of each case from n further records of `information` (p_all, p_all); root (p_all, r): of the covariance of
    what is uncertain about nominal and sensors."""
    I, p = score.scaled()[1], len(score.parameters)
    found = []
    for own, other, change in cases:
        values, vectors = np.linalg.eigh(I[np.ix_(other, other)]) if len(other) else (np.zeros(0), np.zeros((0, 0)))
        # what nothing was told of is free to follow, or nearly so
        known = np.maximum(values, FREE * max(float(values.max(initial=0.0)), FREE))
        adapted = vectors @ ((vectors.T @ I[np.ix_(other, own)] @ change) / known)
        V = np.zeros((len(information), 1 + len(other) + root.shape[1]))
        V[own, 0] = change
        V[other, 0] -= adapted
        V[other, 1 : 1 + len(other)] = vectors / np.sqrt(known)
        V[:p] *= score.prior_sigma[:, None]
        V[:, 1 + len(other) :] = root
        found.append(Separation.from_gram(V.T @ information @ V))
    return found


def _root(uncertainty: np.ndarray) -> np.ndarray:
    spread = np.sqrt(np.diag(uncertainty))
    return covariance_root(uncertainty, np.where(spread > 0, spread, 1.0))


def _least_separation(separations: Sequence[Separation], n: float) -> float:
    return min(s(n) for s in separations)


def _separates(separations: Sequence[Separation], wanted: float, n: float) -> bool:
    return _least_separation(separations, n) >= wanted


def _informations(monitor: Monitor, conditions: Mapping[str, np.ndarray]) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Of each operating condition, inputs column -> (C,): information of a record (C, p_all, p_all), whether the engine
    can compute it, and whether identification has seen such a condition."""
    predicted, J, ok, _ = monitor.predict(dict(conditions), monitor.theta0)
    G = whiten(np.zeros_like(predicted), J, monitor.noise)[1]
    seen = np.ones(len(ok), bool)
    if monitor.envelope is not None:
        seen = ~np.asarray(monitor.envelope.outside(conditions))
    return np.swapaxes(G, 1, 2) @ G, np.asarray(ok), seen


def condition_options(monitor: Monitor, conditions: Mapping[str, np.ndarray]) -> list[RecordingOption]:
    """One option per operating condition, inputs column -> (C,), that the engine can compute."""
    G, ok, seen = _informations(monitor, conditions)
    return [
        RecordingOption(
            "condition", {column: float(values[k]) for column, values in conditions.items()}, G[k], bool(seen[k])
        )
        for k in np.flatnonzero(ok)
    ]


def advise_flights(
    score: Score, sets: Sequence[tuple[Sequence[str], float]], monitor: Monitor, flown: Mapping[str, np.ndarray]
) -> list[Suggestion]:
    """Flights that the engine's envelope allows, best first, for telling the leading `sets` of changes, with their
    probabilities, apart; `flown`: operating conditions so far, column -> (N,)."""
    leading = [(list(names), p) for names, p in sets[:LEADING]]
    chosen = flights(monitor.engine, flown)  # type: ignore[arg-type]
    if len(leading) < 2 or not chosen:
        return []
    pairs = {}
    for h, g in permutations(range(len(leading)), 2):
        own, other = (score.indices(leading[k][0]) for k in (h, g))
        change = _allowed_change(score, own, other, ALLOWED)
        if change is not None:
            pairs[h, g] = own, other, change
    parts = [f.inputs(monitor.engine, POINTS) for f in chosen]  # type: ignore[arg-type]
    G, ok, seen = _informations(monitor, {c: np.concatenate([p[c] for p in parts]) for c in parts[0]})
    root, found = _root(monitor.uncertainty), []
    for k, flight in enumerate(chosen):
        rows = slice(k * POINTS, (k + 1) * POINTS)
        if ok[rows].mean() < COMPUTED:
            continue
        mean = G[rows][ok[rows]].mean(axis=0)
        told = dict(zip(pairs, _separations(score, mean, root, list(pairs.values())), strict=True))
        table = [[told.get((h, g)) for g in range(len(leading))] for h in range(len(leading))]
        outlook = Outlook(np.array([p for _, p in leading]), table)
        known = bool(seen[rows].mean() >= 1.0 - BEYOND)
        found.append(Suggestion.from_outlook(outlook, flight.kind, flight.words, flight, known))
    return best_first(found)


def sensor_options(
    monitor: Monitor, inputs: Mapping[str, np.ndarray], noises: Mapping[str, float]
) -> list[RecordingOption]:
    """One option per further sensor (model column -> noise sigma, in the column's unit), recorded together with
    the present sensors at operating conditions like those of `inputs`, column -> (N,); before them the present
    sensors alone, for comparison. Empty when the engine can compute none of these conditions."""
    _, J, ok, _ = monitor.predict(dict(inputs), monitor.theta0)
    if not ok.any():
        return []
    q = len(monitor.names) - len(monitor.offsets)
    values: dict[str, Any] = dict(monitor.base)
    values.update(zip(monitor.names[:q], monitor.theta0[:q].tolist(), strict=True))
    columns = tuple(noises)
    if columns:
        extra = monitor.engine.predict(inputs, values, sensors=columns, wrt=monitor.names[:q])
        ok = ok & np.asarray(extra.ok)
    present = whiten(np.zeros_like(J[ok, :, 0]), J[ok], monitor.noise)[1].reshape(-1, len(monitor.names))
    base = present.T @ present / ok.sum()
    options = [RecordingOption("present sensors", {}, base)]
    if not columns:
        return options
    noise = NoiseModel(np.array([noises[c] for c in columns], float), np.zeros(len(columns)))
    full = np.zeros((int(ok.sum()), len(columns), len(monitor.names)))
    full[:, :, :q] = np.asarray(extra.jacobian)[ok]
    added = whiten(np.zeros(full.shape[:2]), full, noise)[1]
    for j, column in enumerate(columns):
        options.append(RecordingOption(column, {column: noises[column]}, base + added[:, j].T @ added[:, j] / ok.sum()))
    return options
