"""Functions of a formula that remember: each follows its first argument along time, as a filter makes it of its past.

    lagged(x, t)         τ dm/dt = x − m, τ = t seconds
    limited(x, up, down) follows x no faster than 1/up, and 1/down on the way down; seconds per unit of x, 0 no limit
    backlash(x, h)       stands still while x turns round within ± h: what switches at c of it switches at c + h on the
                         way up, and at c − h on the way down

In equilibrium, where the past of a record is not known and where a recording begins all of them are x.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from enginediag_cli.engine.moving.filters.backlash import Backlash
from enginediag_cli.engine.moving.filters.base import Filter
from enginediag_cli.engine.moving.filters.lag import Lag
from enginediag_cli.engine.moving.filters.rate_limit import RateLimit


@dataclass(frozen=True)
class Follower:
    """`filter`: what it lies from its signal; `units` of its coefficients, "1" where that is a number without one."""

    filter: Filter
    units: tuple[str, ...]


FOLLOWERS: Mapping[str, Follower] = {
    "lagged": Follower(Lag(), ("s",)),
    "limited": Follower(RateLimit(), ("s", "s")),
    "backlash": Follower(Backlash(), ("1",)),
}


@dataclass(frozen=True)
class Followed:
    """A follower in a formula: `name`, the names `of` what it follows, the coefficients that it goes `by`, and the
    letter `at` which it stands."""

    name: str
    of: frozenset[str]
    by: tuple[str, ...]
    at: int

    @property
    def filter(self) -> Filter:
        return FOLLOWERS[self.name].filter
