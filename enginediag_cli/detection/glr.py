"""Generalised likelihood ratio test of "no parameter has changed", eqs. (10) and (11).

    t = sᵀ V⁻¹ F (F V⁻¹ F)⁺ F V⁻¹ s ~ χ²(rank F; λ),    λ = Δθᵀ F V⁻¹ F Δθ

The degrees of freedom are the rank, not the number of parameters: operating points that excite fewer
combinations give a test of fewer.

Where the noise itself was estimated, t/r is not χ²(r)/r but λ⁻¹ F(r, ν), with λ and ν such that mean and variance are
right: M. G. Kenward and J. H. Roger, Biometrics 53 (1997) 983–997.

Where noise is not Gaussian, t is a sum of squares of variance 2r + Q, Q = Σ_i κ_i h_i² (G. A. F. Seber and A. J. Lee,
Linear Regression Analysis, 2nd ed. (2003), theorem 1.6), and r'/r · t has about the χ²(r') distribution with
r' = 2r²/(2r + Q): the same mean and variance. Both together: λ t/r ~ F(r', ν).

Does the model fit at all? A verdict of its own, apart from "has a parameter changed".

    χ²_rest = Σ eᵀR⁻¹e − sᵀF⁺s ~ χ²(measurements − rank) when some value of the parameters explains the data.

Noise that is correlated in time counts as fewer measurements, which makes the test cautious.

The smallest change of each parameter that the data at hand would have shown, and whether that is small enough for
"healthy" to mean anything.

A test that would not have seen a change of the size that a shop acts on says nothing by its silence. What must show is
a site's choice; by default, of every component at least one of its parameters by

    efficiency, effectiveness   2 %     flow capacity, area   3 %     any other      as far as it plausibly lies off

Judgement: compressors and turbines are washed or opened for losses of 2 to 4 % of efficiency and 3 to 6 % of flow
(I. S. Diakunchak, J. Eng. Gas Turbines Power 114 (1992) 161–168), and what damages a component moves efficiency and
flow at once.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from fnmatch import fnmatch

import numpy as np

from enginediag_cli.config.hints import near
from enginediag_cli.errors import DataError
from enginediag_cli.parameters import Parameter
from enginediag_cli.residuals.distributions import noncentrality_of
from enginediag_cli.residuals.excitation import range_space
from enginediag_cli.residuals.score import Score, separable_information
from enginediag_cli.residuals.statistics import LocalStatistics


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
    from enginediag_cli.residuals.distributions import chdtri

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


def numerator(rank: int, doubt: tuple[float, float, float]) -> float:
    """r' = 2r²/(2r + Q): degrees of freedom with which the law of the noise makes the statistic scatter.

    It is kept within a factor of 4 of r: what is so far from Gaussian two moments do not describe.
    """
    return 2.0 * rank**2 / min(max(2.0 * rank + doubt[2], 0.5 * rank), 8.0 * rank) if rank else 0.0


def p_value(statistic: float, score: Score) -> float:
    """Probability of a larger statistic when nothing has changed."""
    from enginediag_cli.residuals.distributions import chdtrc, fdtrc

    scale, nu = noise_correction(score.rank, score.doubt)
    r = numerator(score.rank, score.doubt)
    if not np.isfinite(nu):
        return float(chdtrc(r, statistic * r / score.rank))
    return float(fdtrc(r, nu, scale * statistic / score.rank))


def critical_value(score: Score, false_alarm: float) -> float:
    """The statistic that is exceeded with probability `false_alarm` when nothing has changed."""
    from enginediag_cli.residuals.distributions import chdtri, fdtri

    limit = threshold(score.rank, false_alarm)
    if score.rank == 0:
        return limit
    scale, nu = noise_correction(score.rank, score.doubt)
    r = numerator(score.rank, score.doubt)
    if not np.isfinite(nu):
        return float(score.rank / r * chdtri(r, false_alarm))
    return float(score.rank / scale * fdtri(r, nu, 1 - false_alarm))


def glr_test(score: Score, false_alarm: float = 0.01) -> GlrTest:
    """Test of no change against any change of the parameters of `score`."""
    limit = critical_value(score, false_alarm)
    if score.rank == 0:
        return GlrTest(0.0, 0, limit, float("nan"), None)
    return GlrTest(score.glr, score.rank, limit, p_value(score.glr, score), bool(score.glr > limit))


def power(score: Score, change: np.ndarray, false_alarm: float = 0.01) -> float:
    """Probability that the test sees the change Δθ (p,), in parameter units."""
    from scipy.stats import ncx2

    if score.rank == 0:
        return 0.0
    noncentrality = float(change @ score.information @ change)
    return float(ncx2.sf(threshold(score.rank, false_alarm), score.rank, noncentrality))


ROUNDING = 1e-9
"""Share of χ² that sums of a million readings in double precision may miss."""


@dataclass(frozen=True)
class LackOfFit:
    """`ratio` = χ²_rest per degree of freedom: 1 when the noise is as stated and the model is right.

    `consistent`: whether s and F explain no more than there is; statistics of a window that was condensed with doubt
    (a reference, an error of the model) may, and then their rest, taken as 0, says nothing.
    """

    statistic: float
    dof: float
    p_value: float
    ratio: float
    consistent: bool = True


def lack_of_fit(statistics: LocalStatistics) -> LackOfFit:
    """Test of what no change of the parameters explains; NaN where nothing is left over to test."""
    from enginediag_cli.residuals.distributions import chdtrc

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
TESTS = ("global", "directed", "minmax")
"""global: the test of all parameters; directed: the test of this one alone, the others unchanged; minmax:
the test of this one whatever the others did."""


@dataclass(frozen=True)
class RequiredPower:
    """What a window must be able to show before silence is "healthy": `changes`, shell patterns of parameters with a
    size in their unit (inf: none must show), before those of MUST_SHOW, each with probability `power`,
    which is larger than that of a false alarm."""

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
class Unseen:
    """A component of which the window shows nothing small enough: `parameter`, the one that comes nearest, would have
    to change by `size` where `limit` must show, both in its unit."""

    parameter: Parameter
    size: float
    limit: float


def required_noncentrality(dof: int, false_alarm: float, power: float) -> float:
    """λ at which χ²(dof; λ) exceeds the threshold with probability `power`."""
    if not false_alarm < power < 1:
        raise ValueError("`power` must lie between `false_alarm` and 1")
    return noncentrality_of(dof, threshold(dof, false_alarm), power)


def minimum_change(
    score: Score,
    *,
    false_alarm: float = 0.01,
    power: float = POWER,
    test: str = "global",
    sides: int = 2,
    limit: float | None = None,
) -> np.ndarray:
    """Smallest change (p,) of each parameter alone, in its unit, seen with probability `power`.

    inf where the operating points do not excite the parameter. `sides` = 1 when the direction of the change
    is known beforehand (only for the directed and min-max tests, whose statistic has a sign). limit: the critical value
    of the global test, where it is known.
    """
    if test not in TESTS:
        raise ValueError(f"`test` must be one of {', '.join(TESTS)}, not {test!r}")
    if sides not in (1, 2) or (sides == 1 and test == "global"):
        raise ValueError("`sides` must be 1 or 2, and 2 for the global test")
    if test == "global":
        if score.rank == 0:
            return np.full(len(score.parameters), np.inf)
        if not false_alarm < power < 1:
            raise ValueError("`power` must lie between `false_alarm` and 1")
        needed = noncentrality_of(score.rank, limit or critical_value(score, false_alarm), power)
    elif sides == 2:
        needed = required_noncentrality(1, false_alarm, power)
    else:
        from scipy.stats import norm

        needed = float((norm.isf(false_alarm) + norm.ppf(power)) ** 2)
    known = separable_information(score) if test == "minmax" else np.diag(score.information)
    scaled = known * score.prior_sigma**2
    seen = scaled > 1e-9 * max(float(np.max(np.diag(score.scaled()[1]), initial=0.0)), 1e-300)
    with np.errstate(divide="ignore"):
        return np.where(seen, np.sqrt(needed / np.where(seen, known, 1.0)), np.inf)


def must_show(
    described: Sequence[Parameter], prior_sigma: np.ndarray, chosen: Sequence[tuple[str, float]] = ()
) -> np.ndarray:
    """Change (p,) of each parameter that must show, in its unit; inf where none must, as of instruments.

    chosen: shell patterns of names with a size, of which the last that fits counts; they go before MUST_SHOW.
    """
    found = np.full(len(described), np.inf)
    for i, p in enumerate(described):
        if not p.of_instrument:
            found[i] = MUST_SHOW.get(p.quantity, prior_sigma[i])
        for pattern, size in chosen:
            if fnmatch(p.name, pattern):
                found[i] = size
    return found


def unseen_components(score: Score, sizes: np.ndarray, limits: np.ndarray) -> list[Unseen]:
    """Components of which no parameter shows a change of its limit (p,), the worst first; sizes (p,): the smallest
    changes that show. A component without a limit is not asked for."""
    nearest: dict[str, Unseen] = {}
    for p, size, limit in zip(score.described, sizes, limits, strict=True):
        if not np.isfinite(limit):
            continue
        known = nearest.get(p.component)
        if known is None or size / limit < known.size / known.limit:
            nearest[p.component] = Unseen(p, float(size), float(limit))
    return sorted((u for u in nearest.values() if u.size > u.limit), key=lambda u: -u.size / u.limit)


def size_with_unit(parameter: Parameter, size: float) -> str:
    """A change as people read it: in per cent of a scale factor, else in the parameter's unit."""
    return f"{100.0 * size:.2g} %" if not parameter.shown_unit else f"{size:.3g} {parameter.shown_unit}"
