"""What every method hands back, and what the methods that read scores have in common."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from enginediag_cli.config.fields import Field
from enginediag_cli.detection.glr import glr_test
from enginediag_cli.methods.evidence import Evidence
from enginediag_cli.residuals.pipeline import LINEARISE
from enginediag_cli.residuals.score import Score

LINEARISE_FIELD = Field(
    "linearise",
    "choice",
    "where the model is linearised: at the estimate of each window, or at nominal",
    "estimate",
    choices=LINEARISE,
)
LEVEL_FIELD = Field(
    "level", "number", "level of its tests; false_alarm of the study where absent", None, minimum=1e-6, maximum=0.5
)


@dataclass(frozen=True)
class Answers:
    """On W windows: judged (W,): there is a verdict; detected (W,); isolated (W, p) bool, None for a method that
    names no parameters; probability (W,) that the answer is right, NaN for a method that states none."""

    judged: np.ndarray
    detected: np.ndarray
    isolated: np.ndarray | None
    probability: np.ndarray


def by_score(
    evidence: Evidence, linearise: str, isolate: Callable[[int, Score], tuple[tuple[str, ...], float]]
) -> Answers:
    """Answers of a method that isolates each window from its score: isolate(window, score) -> names, probability.

    Detection is the GLR test of the same score.
    """
    scores, converged = evidence.scores(linearise)
    names = evidence.monitor.names
    isolated, probability = np.zeros((len(scores), len(names)), bool), np.full(len(scores), np.nan)
    tests = [glr_test(score, evidence.false_alarm) for score in scores]
    judged = converged & np.array([test.alarm is not None for test in tests])
    for w in np.flatnonzero(judged):
        found, probability[w] = isolate(int(w), scores[w])
        isolated[w] = [name in found for name in names]
    return Answers(judged, judged & np.array([bool(test.alarm) for test in tests]), isolated, probability)
