"""What kind of change it is, and since when: explanations of a flight compared by their marginal likelihood.

    sudden fault              step of one or two health parameters, or of all together
    gradual deterioration     the same, growing linearly from its onset to now
    sensor jump, sensor drift step or ramp of one sensor's reading

Every kind has the same probability beforehand, and within a kind every onset. A change that was there when the flight
began has no onset in it and no law of growth: `present from the start`.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import combinations

import numpy as np

from enginediag_cli.detection.segments import LAWS, Coordinates, Segment, tails
from enginediag_cli.detection.sequential import Effect, effect, log_full, log_mean_exp, log_single

KINDS = {
    ("health", "step"): "sudden fault",
    ("health", "ramp"): "gradual deterioration",
    ("sensor", "step"): "sensor jump",
    ("sensor", "ramp"): "sensor drift",
}
FAMILY = {kind: family for (family, _), kind in KINDS.items()}
FROM_START = "present from the start"
CANNOT_TELL = "cannot tell"
SURE = 0.9
"""Probability from which a kind of change is named."""
MIXED = 0.95
"""Probability of the interval of the onset."""


@dataclass(frozen=True)
class Change:
    """kind: one of KINDS, `present from the start` or `cannot tell`; probability of the most probable kind, which
    `leading` names. parameter: the most probable single parameter or sensor. onset, low, high: block number, most
    probable and 95 % interval; onset_s, low_s, high_s: the same as times."""

    kind: str
    leading: str
    probability: float
    parameter: str
    onset: int
    low: int
    high: int
    onset_s: float
    low_s: float
    high_s: float


def log_health(found: Effect, count: int) -> np.ndarray:
    """log likelihood ratios (J,) of a fault: one health parameter, two, or all, a third each."""
    single = log_mean_exp(log_single(found)[:, :count], axis=1)
    parts = [single, log_full(found, count)]
    if count > 1:
        i, k = np.array(list(combinations(range(count), 2))).T
        a, d, b = 1 + found.S[:, i, i], 1 + found.S[:, k, k], found.S[:, i, k]
        determinant = np.maximum(a * d - b**2, 1.0)
        x, y = found.r[:, i], found.r[:, k]
        quadratic = (d * x**2 - 2 * b * x * y + a * y**2) / determinant
        parts.append(log_mean_exp(-0.5 * np.log(determinant) + 0.5 * quadratic, axis=1))
    return log_mean_exp(np.stack(parts), axis=0)


def explain_change(past: list[Segment], coordinates: Coordinates) -> Change:
    """The most probable kind, parameter and onset of the change that an alarm has found."""
    a = len(coordinates.health)
    evidence: dict[str, np.ndarray] = {}
    singles: dict[str, np.ndarray] = {}
    for law in LAWS:
        found = effect(tails(past, law), coordinates.nuisance)
        for family, chosen in (("health", slice(0, a)), ("sensor", slice(a, None))):
            alone = log_single(found)[:, chosen]
            if not alone.shape[1]:
                continue
            kind = KINDS[family, law]
            evidence[kind] = log_health(found, a) if family == "health" else log_mean_exp(alone, axis=1)
            singles[kind] = alone
    kinds = list(evidence)
    table = np.stack([evidence[kind] for kind in kinds])  # (kinds, onsets)
    weights = np.exp(table - table.max())
    # a ramp over a single piece, or from the start, is no ramp
    weights[[kind in (KINDS["health", "ramp"], KINDS["sensor", "ramp"]) for kind in kinds], 0] = 0.0
    weights = weights / weights.sum()
    onset = int(np.argmax(weights.sum(axis=0)))
    low, high = _interval(weights.sum(axis=0))
    probabilities = {kind: float(weights[i, 1:].sum()) for i, kind in enumerate(kinds)}
    probabilities[FROM_START] = float(weights[:, 0].sum())
    leading = max(probabilities, key=lambda kind: probabilities[kind])
    likely = leading if leading in singles else kinds[int(np.argmax(weights[:, 0]))]
    names = coordinates.sensors if FAMILY[likely] == "sensor" else coordinates.health
    parameter = names[int(np.argmax(singles[likely][onset]))]
    kind = leading if probabilities[leading] >= SURE else CANNOT_TELL
    begin = [piece.begin for piece in past]
    first = [piece.first for piece in past]
    # pieces begin where they begin: a change may have come anywhere in the piece before or after the best beginning
    low, high = max(low - 1, 0), min(high + 1, len(past) - 1)
    return Change(
        kind,
        leading,
        probabilities[leading],
        parameter,
        first[onset],
        first[low],
        first[high],
        begin[onset],
        begin[low],
        begin[high],
    )


def posterior_change(past: list[Segment], coordinates: Coordinates) -> np.ndarray:
    """Posterior mean (a,) of the health parameters, in prior standard deviations, after a step at the best onset.

    Zero when the most probable explanation is a sensor's.
    """
    a = len(coordinates.health)
    found = effect(tails(past), coordinates.nuisance)
    health = log_health(found, a)
    alone = log_single(found)[:, a:]
    if alone.size and alone.max() > health.max():
        return np.zeros(a)
    j = int(np.argmax(health))
    return np.asarray(np.linalg.solve(np.eye(a) + found.S[j, :a, :a], found.r[j, :a]))


def _interval(weights: np.ndarray) -> tuple[int, int]:
    """First and last onset of the smallest set that holds MIXED of the probability (J,)."""
    order = np.argsort(-weights, kind="stable")
    held = np.cumsum(weights[order])
    chosen = order[: int(np.searchsorted(held, MIXED)) + 1]
    return int(chosen.min()), int(chosen.max())
