"""The smallest change of each parameter that the data at hand would have shown, and whether that is small enough for
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
from enginediag_cli.detection.glr import critical_value, threshold
from enginediag_cli.errors import DataError
from enginediag_cli.parameters import Parameter
from enginediag_cli.residuals.distributions import noncentrality_of
from enginediag_cli.residuals.score import Score, separable_information

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
