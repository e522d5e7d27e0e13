"""The verdict on one window: healthy, fault, or no verdict with the reason."""

from __future__ import annotations

from dataclasses import dataclass

from enginediag_cli.detection.glr import GlrTest, glr_test
from enginediag_cli.detection.lack_of_fit import LackOfFit, lack_of_fit
from enginediag_cli.residuals.pipeline import WindowStatistics
from enginediag_cli.residuals.score import Score, fisher_score

HEALTHY, FAULT, NO_VERDICT = "healthy", "fault", "no verdict"
NOISE_UNKNOWN = "the noise was identified from too few independent records"
"""Why a window has no verdict where no threshold keeps its false-alarm rate."""


HARDLY_KNOWN = 0.5
"""A₂/rank beyond which no threshold can be had for noise that was estimated: about four degrees of freedom."""


@dataclass(frozen=True)
class Verdict:
    """`test`, `fit` and `score` are None where there is no verdict, and `reason` says why."""

    window: WindowStatistics
    verdict: str
    reason: str = ""
    test: GlrTest | None = None
    fit: LackOfFit | None = None
    score: Score | None = None


def unknown_noise(score: Score) -> bool:
    """Whether the noise rests on so few independent readings that no threshold keeps its false-alarm rate."""
    return score.rank > 0 and score.doubt[1] > HARDLY_KNOWN * score.rank


def judge(window: WindowStatistics, false_alarm: float = 0.01) -> Verdict:
    """Test one window at the given false-alarm probability."""
    if window.statistics is None:
        return Verdict(window, NO_VERDICT, window.reason)
    score = fisher_score(window.statistics)
    test = glr_test(score, false_alarm)
    if test.alarm is None:
        return Verdict(window, NO_VERDICT, "these operating points excite none of the monitored parameters")
    if unknown_noise(score):
        return Verdict(window, NO_VERDICT, NOISE_UNKNOWN)
    return Verdict(window, FAULT if test.alarm else HEALTHY, "", test, lack_of_fit(window.statistics), score)
