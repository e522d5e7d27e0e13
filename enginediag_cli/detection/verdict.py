"""The verdict on one window: healthy, fault, or no verdict with the reason."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

from enginediag_cli.detection.glr import (
    USUALLY_REQUIRED,
    GlrTest,
    LackOfFit,
    RequiredPower,
    Unseen,
    glr_test,
    lack_of_fit,
    minimum_change,
    must_show,
    size_with_unit,
    unseen_components,
)
from enginediag_cli.recordings.table import Recording
from enginediag_cli.residuals.distributions import chdtrc
from enginediag_cli.residuals.gross_gate import input_effects
from enginediag_cli.residuals.monitor import Monitor
from enginediag_cli.residuals.pipeline import window_statistics
from enginediag_cli.residuals.score import Score, fisher_score
from enginediag_cli.residuals.windows import WindowPlan, WindowStatistics

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

    @property
    def with_instruments(self) -> str:
        """The verdict where instruments count, too: one that is stuck or scatters is a fault whatever the test says of
        the rest."""
        return FAULT if self.window.instruments and self.verdict == HEALTHY else self.verdict


def unknown_noise(score: Score) -> bool:
    """Whether the noise rests on so few independent readings that no threshold keeps its false-alarm rate."""
    return score.rank > 0 and score.doubt[1] > HARDLY_KNOWN * score.rank


def judge(
    window: WindowStatistics,
    false_alarm: float = 0.01,
    required: RequiredPower = USUALLY_REQUIRED,
    monitor: Monitor | None = None,
) -> Verdict:
    """Test one window at the given false-alarm probability.

    required: what silence must rest on. monitor: judges anew, without each channel in turn, what could not be checked
    for gross errors; an alarm that rests on one channel is no verdict then.

    Errors of sensors that gave no reading are left out of the statistics of the verdict's window: they are no suspects.
    """
    statistics = window.statistics
    if statistics is None:
        return Verdict(window, NO_VERDICT, window.reason)
    if window.silent:
        window = window.without(())
        statistics = window.statistics
        assert statistics is not None
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
        channel = "" if monitor is None or window.checked else _decisive_channel(window, monitor, false_alarm)
        return replace(found, verdict=NO_VERDICT, reason=one_channel_decides(channel)) if channel else found
    if window.disagreement is not None and window.doubtful:
        reason = f"the recording is likelier wrong than the engine: {window.disagreement.what}"
        return replace(found, verdict=NO_VERDICT, reason=reason)
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
    return f"one channel decides: without {channel} there is no alarm, and so few records may be gross errors of it"


def _decisive_channel(window: WindowStatistics, monitor: Monitor, false_alarm: float) -> str:
    """The sensor without whose readings, or the input with whose likeliest error taken out, there is no alarm; of
    several the one without which the window looks healthiest."""
    channels, variants = zip(*_without_each(window, monitor), strict=True)
    n = len(next(iter(variants[0].values())))
    columns = {c: np.concatenate([v[c] for v in variants]) for c in variants[0]}
    flights = [str(k) for k in range(len(channels)) for _ in range(n)]
    line = np.arange(1, len(flights) + 1)
    whole = Recording(columns, {"flight": flights}, line=line, source=window.source)
    least, likeliest = 0.0, ""
    for channel, found in zip(channels, window_statistics(monitor, [whole], WindowPlan()), strict=True):
        verdict = judge(found, false_alarm)
        p = verdict.test.p_value if verdict.test is not None else 1.0
        if verdict.verdict != FAULT and p > least:
            least, likeliest = p, str(channel)
    return likeliest


def _without_each(window: WindowStatistics, monitor: Monitor) -> Iterator[tuple[str, dict[str, np.ndarray]]]:
    """Each channel, and the records of a window, column → (n,), without it: t = Sᵀz/SᵀS of an input whose error moves
    the readings by S standard deviations."""
    inputs, y, sigma = dict(window.flown), window.read, monitor.noise.sigma
    assert y is not None
    every = {**inputs, **{c: y[:, j] for j, c in enumerate(monitor.sensors)}}
    for c in monitor.sensors:
        if np.isfinite(every[c]).any():
            yield c, {**every, c: np.full(len(y), np.nan)}
    predicted, _, _, _ = monitor.predict(inputs, monitor.theta0, nuisance=False)
    S = input_effects(monitor, inputs, np.arange(len(y)), tuple(inputs))
    z = (y - predicted) / sigma
    S = np.where(np.isfinite(z)[:, :, None], np.nan_to_num(S), 0.0)
    power = np.sum(S**2, axis=1)
    t = np.einsum("kmq,km->kq", S, np.nan_to_num(z)) / np.where(power > 0, power, np.inf)
    for i, c in enumerate(inputs):
        yield c, {**every, c: inputs[c] + t[:, i]}


def too_still(fit: LackOfFit) -> str:
    """Why nothing is told by readings without life."""
    return f"the readings scatter impossibly little (fit {fit.ratio:.1g}): they repeat, or were not measured"


def lifeless(fit: LackOfFit) -> bool:
    """Whether the readings scatter less than any that were measured can: a recorder that repeats itself."""
    tiny = fit.dof > 0 and fit.consistent and fit.ratio < LEAST_FIT
    return tiny and 1.0 - chdtrc(fit.dof, fit.statistic) < LEAST_FIT_CHANCE
