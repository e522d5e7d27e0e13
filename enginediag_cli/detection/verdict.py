"""The verdict on one window: healthy, fault, or no verdict with the reason."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from enginediag_cli.detection.glr import GlrTest, glr_test
from enginediag_cli.detection.lack_of_fit import LackOfFit, lack_of_fit
from enginediag_cli.detection.minimum_change import (
    USUALLY_REQUIRED,
    RequiredPower,
    Unseen,
    minimum_change,
    must_show,
    size_with_unit,
    unseen_components,
)
from enginediag_cli.residuals.distributions import chdtrc
from enginediag_cli.residuals.score import Score, fisher_score
from enginediag_cli.residuals.window import WindowStatistics

HEALTHY, FAULT, NO_VERDICT = "healthy", "fault", "no verdict"
NOISE_UNKNOWN = "the noise was identified from too few independent records"
"""Why a window has no verdict where no threshold keeps its false-alarm rate."""

HARDLY_KNOWN = 0.5
"""A₂/rank beyond which no threshold can be had for noise that was estimated: about four degrees of freedom."""
LEAST_SENSORS = 2
"""Sensors without which nothing is told: with one alone, whatever happens is as well an error of that one, and nothing
shows that it works at all."""
LEAST_FIT = 1e-4
"""χ² per degree of freedom below which readings do not scatter as readings do: the noise would be a hundredth of what
was identified. Noise that was taken too large, for errors of the model were counted in it, is so by a factor of ten."""
LEAST_FIT_CHANCE = 1e-9
"""And it must be no accident: of few readings one is as small by chance now and then."""
MOSTLY = 0.5
"""Share of judged records that training did not cover beyond which silence is no verdict: limits as wide as these hide
what would be seen within it. An alarm in spite of them stands."""


@dataclass(frozen=True)
class Verdict:
    """`reason` says why there is no verdict; `test`, `fit` and `score` are None where there is nothing to test.
    detectable: smallest change (p,) of each parameter of the score that would have shown, in its unit."""

    window: WindowStatistics
    verdict: str
    reason: str = ""
    test: GlrTest | None = None
    fit: LackOfFit | None = None
    score: Score | None = None
    detectable: np.ndarray | None = None


def unknown_noise(score: Score) -> bool:
    """Whether the noise rests on so few independent readings that no threshold keeps its false-alarm rate."""
    return score.rank > 0 and score.doubt[1] > HARDLY_KNOWN * score.rank


def judge(
    window: WindowStatistics,
    false_alarm: float = 0.01,
    required: RequiredPower = USUALLY_REQUIRED,
) -> Verdict:
    """Test one window at the given false-alarm probability.

    required: what silence must rest on.

    Errors of sensors that gave no reading are left out of the statistics of the verdict's window: they are no suspects.
    """
    statistics = window.statistics
    if statistics is None:
        return Verdict(window, NO_VERDICT, window.reason)
    if window.silent:
        statistics = statistics.without(window.silent)
        window = replace(window, statistics=statistics)
    if window.sensors_of and window.sensors < LEAST_SENSORS:
        return Verdict(window, NO_VERDICT, too_few(window.sensors, window.sensors_of))
    score = fisher_score(statistics)
    test = glr_test(score, false_alarm)
    if test.alarm is None or statistics.dof <= 0:
        return Verdict(window, NO_VERDICT, "these operating points excite none of the monitored parameters")
    if unknown_noise(score):
        return Verdict(window, NO_VERDICT, NOISE_UNKNOWN)
    fit = lack_of_fit(statistics)
    if lifeless(fit):
        return Verdict(window, NO_VERDICT, too_still(fit))
    power = max(required.power, 0.5 * (1.0 + false_alarm))  # no test has less power than its false alarms
    sizes = minimum_change(score, false_alarm=false_alarm, power=power, limit=test.threshold)
    found = Verdict(window, FAULT, "", test, fit, score, sizes)
    if test.alarm:
        return found
    if window.extrapolated > MOSTLY * statistics.n:
        return replace(found, verdict=NO_VERDICT, reason=nothing_seen(window.extrapolated, statistics.n))
    limits = must_show(score.described, score.prior_sigma, required.changes)
    unseen = unseen_components(score, sizes, limits)
    if unseen:
        return replace(found, verdict=NO_VERDICT, reason=too_few_records(unseen[0]))
    return replace(found, verdict=HEALTHY)


def too_few_records(unseen: Unseen) -> str:
    """Why nothing is told by a window that would have shown no change of a component that matters."""
    p = unseen.parameter
    if not np.isfinite(unseen.size):
        return f"too few records: no change of {p.words or p.name} would show"
    size, limit = (size_with_unit(p, x) for x in (unseen.size, unseen.limit))
    return f"too few records: a change of {p.words or p.name} would show from {size} on, and {limit} must"


def nothing_seen(extrapolated: int, judged: int) -> str:
    """Why nothing is told where no alarm is raised beyond what training covered."""
    return (
        f"{extrapolated} of {judged} records outside the operating points identified, and nothing is seen within "
        "limits as wide as they are there"
    )


def too_few(sensors: int, sensors_of: int) -> str:
    """Why nothing is told by so few sensors."""
    return f"{sensors} of {sensors_of} sensors gave readings, and {LEAST_SENSORS} are the least"


def one_channel_decides(channel: str) -> str:
    """Why nothing is told where a change rests on one channel, and has lasted no longer than a gross error."""
    return f"{channel} alone decides, and its readings may be gross errors: too few records to tell"


def too_still(fit: LackOfFit) -> str:
    """Why nothing is told by readings without life."""
    return f"the readings scatter impossibly little (fit {fit.ratio:.1g}): they repeat, or were not measured"


def lifeless(fit: LackOfFit) -> bool:
    """Whether the readings scatter less than any that were measured can: a recorder that repeats itself."""
    tiny = fit.dof > 0 and fit.consistent and fit.ratio < LEAST_FIT
    return tiny and 1.0 - chdtrc(fit.dof, fit.statistic) < LEAST_FIT_CHANCE
