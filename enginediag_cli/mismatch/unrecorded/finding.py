"""What the search for effects without a recorded driver tells of one location."""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum

import numpy as np

from enginediag_cli.mismatch.fit.believable import BELIEVED
from enginediag_cli.mismatch.fit.freeform import Location


@dataclass(frozen=True)
class Switch:
    """A change of state: first record of the new state, counted in its flight from 0, and its probability; `before_s`
    and `time_s`: times of the last record of the old state and of that record, between which it changed, NaN where no
    column tells the time; `earliest_s` and `latest_s`: between which it changed with 95 % probability, by the unsteady
    records between these two, NaN where they tell no more."""

    flight: str
    record: int
    on: bool
    probability: float
    before_s: float = np.nan
    time_s: float = np.nan
    earliest_s: float = np.nan
    latest_s: float = np.nan

    @property
    def narrowed(self) -> bool:
        """Whether unsteady records tell when it changed."""
        return bool(np.isfinite(self.latest_s - self.earliest_s))

    @property
    def between(self) -> tuple[float, float]:
        """The times between which it changed, as far as anything tells them."""
        return (self.earliest_s, self.latest_s) if self.narrowed else (self.before_s, self.time_s)


@dataclass(frozen=True)
class Doubtful:
    """Records of a flight, one after the other, whose state cannot be told: how many, and the times of the first and
    the last, s, NaN where no column tells it."""

    flight: str
    records: int
    first_s: float
    last_s: float


class Limit(Enum):
    """How far a finding may be trusted. `what` of `Remark` is where the fit ended, for those that did not converge."""

    BASE_FIT = "the fit without the effect did not converge"
    REFIT = "the refit as two states did not converge"
    AT_BOUND = "the size is at its physical bound"
    UNSETTLED = "the states still changed from round to round"
    UNBELIEVED = "nothing there changes by so much within seconds and back"


@dataclass(frozen=True)
class Remark:
    """`limit`, with what belongs to it; told in words by presentation."""

    limit: Limit
    what: str = ""


@dataclass(frozen=True)
class HiddenFinding:
    """An amplitude that no column records, at one location; N records of the fit, `number` (N,) their place in the
    evidence.

    `lr`: ln likelihood ratio against no such effect, `threshold` the gate of the search, `kernel` the correlation in
    time that suits best; `amplitude`, `standard_error` (N,) in `unit`, about the mean that identification took;
    `signal_to_noise` (N,): |a_k| over the standard error of record k alone. `rivals`: locations that the readings do
    not tell from this one. Where it was refitted as two states: `states` (N,), the probability of "on",
    `coefficient` of on against off with `interval` (95 %), `switch_lr` and `continuous_lr`, ln evidence of either
    account at the refit against the fit without the effect, `is_switch`, the better one being two states. `sign`: +1
    or −1 where physics knows which state is on, 0 where the name is a convention. `believed`: standard deviation of
    what the place may plausibly do without a column showing it, infinite where nothing is known of it. `remark`: what
    limits it, None for nothing.
    """

    location: Location
    unit: str
    kernel: str
    lr: float
    threshold: float
    number: np.ndarray
    amplitude: np.ndarray
    standard_error: np.ndarray
    signal_to_noise: np.ndarray
    sign: int
    rivals: tuple[Location, ...] = ()
    states: np.ndarray | None = None
    is_switch: bool = False
    switch_lr: float = np.nan
    continuous_lr: float = np.nan
    switches: tuple[Switch, ...] = ()
    doubtful: tuple[Doubtful, ...] = ()
    coefficient: float = np.nan
    interval: tuple[float, float] = (np.nan, np.nan)
    converged: bool = True
    remark: Remark | None = None
    believed: float = np.inf

    @property
    def size(self) -> float:
        """Of on against off, or the rms amplitude."""
        return self.coefficient if self.is_switch else float(np.sqrt(np.mean(self.amplitude**2)))

    @property
    def believable(self) -> bool:
        """Whether the place may change by so much."""
        return bool(abs(self.size) <= BELIEVED * self.believed)

    @property
    def significant(self) -> bool:
        return self.converged and self.believable and self.lr > self.threshold

    @property
    def gain(self) -> float:
        """ln evidence of the better account after the refit, −∞ where there was none."""
        return -np.inf if self.states is None else max(self.switch_lr, self.continuous_lr)

    @property
    def worth(self) -> float:
        """`gain` less what it costs that the parameter must vary by so much, ½ (size/scale)²: places that the readings
        hardly tell apart differ in it."""
        return self.gain - 0.5 * (self.size / self.location.scale) ** 2
