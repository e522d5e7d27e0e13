"""The verdict on one window: healthy, fault, or no verdict with the reason.

Test. Generalised likelihood ratio test of "no parameter has changed", eqs. (10) and (11).

    t = sᵀ V⁻¹ F (F V⁻¹ F)⁺ F V⁻¹ s ~ χ²(rank F; λ),    λ = Δθᵀ F V⁻¹ F Δθ

The degrees of freedom are the rank, not the number of parameters: operating points that excite fewer
combinations give a test of fewer.

Where the noise itself was estimated, t/r is not χ²(r)/r but λ⁻¹ F(r, ν), with λ and ν such that mean and variance are
right: M. G. Kenward and J. H. Roger, Biometrics 53 (1997) 983–997.

Where noise is not Gaussian, t is a sum of squares of variance 2r + Q, Q = Σ_i κ_i h_i² (G. A. F. Seber and A. J. Lee,
Linear Regression Analysis, 2nd ed. (2003), theorem 1.6), and r'/r · t has about the χ²(r') distribution with
r' = 2r²/(2r + Q): the same mean and variance. Both together: λ t/r ~ F(r', ν).

Lack of fit. Whether the model fits at all is a test of its own, apart from "has a parameter changed".

    χ²_rest = Σ eᵀR⁻¹e − sᵀF⁺s ~ χ²(measurements − rank) when some value of the parameters explains the data.

Noise that is correlated in time counts as fewer measurements, which makes the test cautious.

Power. `minimum_change` is the smallest change of each parameter that these data would have shown. A test that would not
have shown a change of the size that a shop acts on is no evidence of health. What must show is
a site's choice; by default, of every component at least one of its parameters by

    efficiency, effectiveness   2 %     flow capacity, area   3 %     any other      as far as it plausibly lies off

Judgement: compressors and turbines are washed or opened for losses of 2 to 4 % of efficiency and 3 to 6 % of flow
(I. S. Diakunchak, J. Eng. Gas Turbines Power 114 (1992) 161–168), and what damages a component moves efficiency and
flow at once.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from fnmatch import fnmatch

import numpy as np

from enginediag_cli.config.fields import near
from enginediag_cli.errors import DataError
from enginediag_cli.parameters import Parameter
from enginediag_cli.probability import chdtrc, chdtri, fdtrc, fdtri, noncentrality_for_power
from enginediag_cli.recordings.table import Recording
from enginediag_cli.residuals.gross_gate import input_effects
from enginediag_cli.residuals.monitor import Monitor
from enginediag_cli.residuals.pipeline import window_statistics
from enginediag_cli.residuals.score import Score, fisher_score
from enginediag_cli.residuals.statistics import LocalStatistics, range_space
from enginediag_cli.residuals.windows import WindowPlan, WindowStatistics


@dataclass(frozen=True)
class GlrTest:
    """Outcome of the test: `alarm` is None where nothing is excited and nothing can be judged."""

    statistic: float
    dof: int
    threshold: float
    p_value: float
    alarm: bool | None


def threshold(dof: int, false_alarm: float) -> float:
    """Value that χ²(dof) exceeds with probability `false_alarm`."""
    if not 0 < false_alarm < 1:
        raise ValueError("`false_alarm` must lie between 0 and 1")
    return float(chdtri(dof, false_alarm)) if dof else float("nan")


def noise_correction(rank: int, doubt: tuple[float, float, float]) -> tuple[float, float]:
    """(λ, ν): λ t/r has the F(r, ν) distribution; (1, inf) when the noise is known.

    doubt: A₁ and A₂ of Kenward and Roger, see `Score`. Where the noise is hardly known at all the formulas end; they
    are then kept at their ends, and the test is cautious but not exact.
    """
    A1, A2, _ = doubt
    r = float(rank)
    if rank == 0 or A2 <= 0:
        return 1.0, float("inf")
    A2 = min(A2, 0.5 * r)
    B = (A1 + 6 * A2) / (2 * r)
    g = ((r + 1) * A1 - (r + 4) * A2) / ((r + 2) * A2)
    below = 3 * r + 2 * (1 - g)
    c1, c2, c3 = g / below, (r - g) / below, (r + 2 - g) / below
    mean = 1 / (1 - A2 / r)
    variance = 2 / r * (1 + c1 * B) / (max(1 - c2 * B, 0.05) ** 2 * max(1 - c3 * B, 0.05))
    ratio = variance / (2 * mean**2)
    nu = 4 + (r + 2) / max(r * ratio - 1, 1e-9)
    return nu / (mean * (nu - 2)), nu


def effective_rank(rank: int, doubt: tuple[float, float, float]) -> float:
    """r' = 2r²/(2r + Q): degrees of freedom with which the law of the noise makes the statistic scatter.

    It is kept within a factor of 4 of r: what is so far from Gaussian two moments do not describe.
    """
    return 2.0 * rank**2 / min(max(2.0 * rank + doubt[2], 0.5 * rank), 8.0 * rank) if rank else 0.0


def p_value(statistic: float, score: Score) -> float:
    """Probability of a larger statistic when nothing has changed."""
    scale, nu = noise_correction(score.rank, score.doubt)
    r = effective_rank(score.rank, score.doubt)
    if not np.isfinite(nu):
        return float(chdtrc(r, statistic * r / score.rank))
    return float(fdtrc(r, nu, scale * statistic / score.rank))


def critical_value(score: Score, false_alarm: float) -> float:
    """The statistic that is exceeded with probability `false_alarm` when nothing has changed."""
    limit = threshold(score.rank, false_alarm)
    if score.rank == 0:
        return limit
    scale, nu = noise_correction(score.rank, score.doubt)
    r = effective_rank(score.rank, score.doubt)
    if not np.isfinite(nu):
        return float(score.rank / r * chdtri(r, false_alarm))
    return float(score.rank / scale * fdtri(r, nu, 1 - false_alarm))


def glr_test(score: Score, false_alarm: float = 0.01) -> GlrTest:
    """Test "no parameter has changed" against any change of the parameters of `score`.

    Parameters
    ----------
    score : Score
        Score b (p,) and information (p, p) of p parameters.
    false_alarm : float
        Probability of an alarm without a change.

    Returns
    -------
    GlrTest
        Statistic, degrees of freedom (the rank of the information), threshold, p-value and alarm.

    References
    ----------
    Equations (10) and (11) of the local approach.
    """
    limit = critical_value(score, false_alarm)
    if score.rank == 0:
        return GlrTest(0.0, 0, limit, float("nan"), None)
    return GlrTest(score.glr, score.rank, limit, p_value(score.glr, score), bool(score.glr > limit))


ROUNDING = 1e-9
"""Share of χ² that sums of a million readings in double precision may miss."""


@dataclass(frozen=True)
class LackOfFit:
    """`ratio` = χ²_rest per degree of freedom: 1 when the noise is as stated and the model is right.

    `consistent`: whether s and F explain no more than there is; statistics of a window that was reduced with additional
    uncertainty (a reference, an error of the model) may, and then their rest, taken as 0, says nothing.
    """

    statistic: float
    dof: float
    p_value: float
    ratio: float
    consistent: bool = True


def lack_of_fit(statistics: LocalStatistics) -> LackOfFit:
    """Test what no change of the parameters explains.

    Parameters
    ----------
    statistics : LocalStatistics
        Score s (p,), information F (p, p) and χ² of a window.

    Returns
    -------
    LackOfFit
        With NaN for p-value and ratio where there are no degrees of freedom.
    """
    space = range_space(statistics.F, statistics.prior_sigma)
    v = (statistics.prior_sigma * statistics.s) @ space.basis
    unexplained = statistics.chi2 - float(np.sum(v**2 / space.eigenvalues))
    consistent = unexplained >= -ROUNDING * statistics.chi2
    rest = max(unexplained, 0.0)
    dof = statistics.dof - space.rank
    if dof <= 0:
        return LackOfFit(rest, dof, float("nan"), float("nan"), consistent)
    return LackOfFit(rest, dof, float(chdtrc(dof, rest)), rest / dof, consistent)


POWER = 0.9
"""Probability with which a change counts as shown when nobody chooses: nine in ten, as studies are usually planned."""
MUST_SHOW = {"efficiency": 0.02, "effectiveness": 0.02, "flow_capacity": 0.03, "area": 0.03}
"""Change of each quantity of a component that a healthy window would have shown; see above."""


@dataclass(frozen=True)
class RequiredPower:
    """Power that a window must have for "healthy" to be a verdict.

    Attributes
    ----------
    changes : tuple of (str, float)
        Shell patterns of parameters with the change that must show, in the parameter's unit (inf: none must show); they
        come before those of MUST_SHOW.
    power : float
        Probability with which it must show, larger than that of a false alarm.
    """

    changes: tuple[tuple[str, float], ...] = ()
    power: float = POWER

    def check(self, names: Sequence[str]) -> None:
        """Raises DataError for a pattern that fits none of these parameters."""
        for pattern, _ in self.changes:
            if not any(fnmatch(name, pattern) for name in names):
                raise DataError(f"--must-show: no monitored parameter matches {pattern!r} ({near(pattern, names)})")


USUALLY_REQUIRED = RequiredPower()
"""What must show when nobody chooses."""
NOTHING_REQUIRED = RequiredPower((("*", np.inf),))
"""Any window that was judged and raises no alarm is healthy."""


@dataclass(frozen=True)
class UndetectableComponent:
    """A component of which the window shows nothing small enough: `parameter`, the one that comes nearest, would have
    to change by `size` where `limit` must show, both in its unit."""

    parameter: Parameter
    size: float
    limit: float


def minimum_change(
    score: Score, *, false_alarm: float = 0.01, power: float = POWER, limit: float | None = None
) -> np.ndarray:
    """Smallest change (p,) of each parameter alone, in its unit, that the test detects with probability `power`.

    inf where the operating points do not excite the parameter. limit: the critical value of the test, where it is
    known.
    """
    if not false_alarm < power < 1:
        raise ValueError("`power` must lie between `false_alarm` and 1")
    if score.rank == 0:
        return np.full(len(score.parameters), np.inf)
    needed = noncentrality_for_power(score.rank, limit or critical_value(score, false_alarm), power)
    known = np.diag(score.information)
    scaled = known * score.prior_sigma**2
    seen = scaled > 1e-9 * max(float(np.max(np.diag(score.scaled()[1]), initial=0.0)), 1e-300)
    with np.errstate(divide="ignore"):
        return np.where(seen, np.sqrt(needed / np.where(seen, known, 1.0)), np.inf)


def required_changes(
    described: Sequence[Parameter], prior_sigma: np.ndarray, chosen: Sequence[tuple[str, float]] = ()
) -> np.ndarray:
    """Change (p,) of each parameter that must show, in its unit; inf where none must, as of instruments.

    chosen: shell patterns of names with a size, of which the last that fits counts; they go before MUST_SHOW.
    """
    found = np.full(len(described), np.inf)
    for i, p in enumerate(described):
        if not p.belongs_to_instrument:
            found[i] = MUST_SHOW.get(p.quantity, prior_sigma[i])
        for pattern, size in chosen:
            if fnmatch(p.name, pattern):
                found[i] = size
    return found


def undetectable_components(score: Score, sizes: np.ndarray, limits: np.ndarray) -> list[UndetectableComponent]:
    """Components of which no parameter shows a change of its limit (p,), the worst first; sizes (p,): the smallest
    changes that show. A component without a limit is not asked for."""
    nearest: dict[str, UndetectableComponent] = {}
    for p, size, limit in zip(score.described, sizes, limits, strict=True):
        if not np.isfinite(limit):
            continue
        known = nearest.get(p.component)
        if known is None or size / limit < known.size / known.limit:
            nearest[p.component] = UndetectableComponent(p, float(size), float(limit))
    return sorted((u for u in nearest.values() if u.size > u.limit), key=lambda u: -u.size / u.limit)


def format_size(parameter: Parameter, size: float) -> str:
    """A change as people read it: in per cent of a scale factor, else in the parameter's unit."""
    return f"{100.0 * size:.2g} %" if not parameter.shown_unit else f"{size:.3g} {parameter.shown_unit}"


HEALTHY, FAULT, NO_VERDICT = "healthy", "fault", "no verdict"
NOISE_UNKNOWN = "the noise was identified from too few independent records"
"""Why a window has no verdict where no threshold keeps its false-alarm rate."""

HARDLY_KNOWN = 0.5
"""A₂/rank beyond which no threshold can be had for noise that was estimated: about four degrees of freedom."""
LEAST_SENSORS = 2
"""Fewest sensors of a verdict: with one alone, whatever happens is as well an error of that one, and nothing
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
    """The verdict on one window.

    Attributes
    ----------
    window : WindowStatistics
        The window, without parameters that it holds no reading of.
    verdict : str
        HEALTHY, FAULT or NO_VERDICT.
    reason : str
        Why there is no verdict; "" where there is one.
    test, fit, score : GlrTest, LackOfFit, Score or None
        None where there is nothing to test.
    detectable : ndarray of shape (p,) or None
        Smallest change of each parameter of the score that would have shown, in its unit.
    """

    window: WindowStatistics
    verdict: str
    reason: str = ""
    test: GlrTest | None = None
    fit: LackOfFit | None = None
    score: Score | None = None
    detectable: np.ndarray | None = None

    @property
    def including_instruments(self) -> str:
        """The verdict where instruments count, too: one that is stuck or scatters is a fault whatever the test says of
        the rest."""
        return FAULT if self.window.instruments and self.verdict == HEALTHY else self.verdict


def is_noise_unknown(score: Score) -> bool:
    """Whether the noise rests on so few independent readings that no threshold keeps its false-alarm rate."""
    return score.rank > 0 and score.doubt[1] > HARDLY_KNOWN * score.rank


def judge(
    window: WindowStatistics,
    false_alarm: float = 0.01,
    required: RequiredPower = USUALLY_REQUIRED,
    monitor: Monitor | None = None,
) -> Verdict:
    """Test one window at the given false-alarm probability.

    Errors of sensors that gave no reading are excluded from the statistics of the verdict's window: they are no
    suspects.

    Parameters
    ----------
    window : WindowStatistics
        Statistics of the window; without them its reason is the verdict's.
    false_alarm : float
        Probability of an alarm without a change.
    required : RequiredPower
        Changes that must have been detectable for "healthy".
    monitor : Monitor, optional
        Repeats the test without each channel in turn where the window was not checked for gross errors: an alarm that
        rests on one channel is no verdict then.

    Returns
    -------
    Verdict

    References
    ----------
    Equations (10) and (11) of the local approach.
    """
    statistics = window.statistics
    if statistics is None:
        return Verdict(window, NO_VERDICT, window.reason)
    if window.silent:
        window = window.drop_parameters(())
        statistics = window.statistics
        assert statistics is not None
    if window.sensors_of and window.sensors < LEAST_SENSORS:
        return Verdict(window, NO_VERDICT, too_few_sensors_reason(window.sensors, window.sensors_of))
    score = fisher_score(statistics)
    test = glr_test(score, false_alarm)
    if test.alarm is None or statistics.dof <= 0:
        return Verdict(window, NO_VERDICT, "these operating points excite none of the monitored parameters")
    if is_noise_unknown(score):
        return Verdict(window, NO_VERDICT, NOISE_UNKNOWN)
    fit = lack_of_fit(statistics)
    if is_lifeless(fit):
        return Verdict(window, NO_VERDICT, low_scatter_reason(fit))
    power = max(required.power, 0.5 * (1.0 + false_alarm))  # no test has less power than its false alarms
    sizes = minimum_change(score, false_alarm=false_alarm, power=power, limit=test.threshold)
    found = Verdict(window, FAULT, "", test, fit, score, sizes)
    if test.alarm:
        channel = "" if monitor is None or window.checked else _decisive_channel(window, monitor, false_alarm)
        return replace(found, verdict=NO_VERDICT, reason=one_channel_reason(channel)) if channel else found
    if window.disagreement is not None and window.is_doubtful:
        reason = f"the recording is likelier wrong than the engine: {window.disagreement.description}"
        return replace(found, verdict=NO_VERDICT, reason=reason)
    if window.extrapolated > MOSTLY * statistics.n:
        return replace(found, verdict=NO_VERDICT, reason=extrapolation_reason(window.extrapolated, statistics.n))
    limits = required_changes(score.described, score.prior_sigma, required.changes)
    unseen = undetectable_components(score, sizes, limits)
    if unseen:
        return replace(found, verdict=NO_VERDICT, reason=too_few_records_reason(unseen[0]))
    return replace(found, verdict=HEALTHY)


def too_few_records_reason(unseen: UndetectableComponent) -> str:
    """Why there is no verdict on a window that would have shown no change of a component that matters."""
    p = unseen.parameter
    if not np.isfinite(unseen.size):
        return f"too few records: no change of {p.words or p.name} would show"
    size, limit = (format_size(p, x) for x in (unseen.size, unseen.limit))
    return f"too few records: a change of {p.words or p.name} would show from {size} on, and {limit} must"


def extrapolation_reason(extrapolated: int, judged: int) -> str:
    """Why there is no verdict without an alarm outside the identified envelope."""
    return (
        f"{extrapolated} of {judged} records outside the operating points identified, and nothing is seen within "
        "limits as wide as they are there"
    )


def too_few_sensors_reason(sensors: int, sensors_of: int) -> str:
    """Why there is no verdict from so few sensors."""
    return f"{sensors} of {sensors_of} sensors gave readings, and {LEAST_SENSORS} are the least"


def one_channel_reason(channel: str) -> str:
    """Why there is no verdict where a change rests on one channel, and has lasted no longer than a gross error."""
    return f"one channel decides: without {channel} there is no alarm, and so few records may be gross errors of it"


def _decisive_channel(window: WindowStatistics, monitor: Monitor, false_alarm: float) -> str:
    """The sensor without whose readings, or the input with whose likeliest error taken out, there is no alarm; of
    several the one without which the window looks healthiest, all of them where a record does not distinguish them."""
    channels, variants = zip(*_leave_one_channel_out(window, monitor), strict=True)
    n = len(next(iter(variants[0].values())))
    columns = {c: np.concatenate([v[c] for v in variants]) for c in variants[0]}
    flights = [str(k) for k in range(len(channels)) for _ in range(n)]
    line = np.arange(1, len(flights) + 1)
    whole = Recording(columns, {"flight": flights}, line=line, source=window.source)
    calm: dict[str, float] = {}
    for channel, found in zip(channels, window_statistics(monitor, [whole], WindowPlan()), strict=True):
        verdict = judge(found, false_alarm)
        p = verdict.test.p_value if verdict.test is not None else 1.0
        if verdict.verdict != FAULT:
            calm[str(channel)] = p
    return " or ".join(c for c, p in calm.items() if p >= (1.0 - ROUNDING) * max(calm.values()))


def _leave_one_channel_out(window: WindowStatistics, monitor: Monitor) -> Iterator[tuple[str, dict[str, np.ndarray]]]:
    """Each channel, and the records of a window, column → (n,), without it: t = Sᵀz/SᵀS of an input whose error moves
    the readings by S standard deviations."""
    inputs, y, sigma = dict(window.sample_inputs), window.sample_readings, monitor.noise.sigma
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


def low_scatter_reason(fit: LackOfFit) -> str:
    """Why there is no verdict from readings without noise."""
    return f"the readings scatter impossibly little (fit {fit.ratio:.1g}): they repeat, or were not measured"


def is_lifeless(fit: LackOfFit) -> bool:
    """Whether the readings scatter less than any that were measured can: a recorder that repeats itself."""
    tiny = fit.dof > 0 and fit.consistent and fit.ratio < LEAST_FIT
    return tiny and 1.0 - chdtrc(fit.dof, fit.statistic) < LEAST_FIT_CHANCE
