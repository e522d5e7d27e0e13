"""What every filter along time is.

A *signal* is known at the records of a tape and runs in straight lines between them; a filter answers with its output
at the same records, and how that changes with the signal and with the filter's own coefficients. At its start, and
after every gap (`Clock.first`), it is in equilibrium, unless its output is known there (`Clock.start`): nothing else
is known of what was before.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise

import numpy as np

from enginediag_cli.engine.dual import Array, Value


@dataclass(frozen=True)
class Clock:
    """Times (N,) s of the records of a tape, rising within each stretch; `first` (N,): where a stretch begins; `start`
    (N,): what the output is known to be there, NaN where it is not; None: nowhere."""

    time: Array
    first: Array
    start: Array | None = None

    @cached_property
    def step(self) -> Array:
        """Seconds since the record before, (N,); 0 at the beginning of a stretch."""
        return np.where(self.first, 0.0, np.diff(self.time, prepend=self.time[:1]))

    @cached_property
    def spans(self) -> tuple[slice, ...]:
        """The stretches."""
        edges = [*np.flatnonzero(self.first).tolist(), len(self.time)]
        return tuple(slice(a, b) for a, b in pairwise(edges))

    def begin(self, signal: Array, along: Array) -> tuple[Array, Array]:
        """Deviation of a known output from the signal at the beginnings of stretches (N,), with its derivatives along
        those of the signal (K, N); 0 where the output is not known."""
        if self.start is None:
            return np.zeros_like(signal), np.zeros_like(along)
        known = self.first & np.isfinite(self.start)
        return np.where(known, np.nan_to_num(self.start) - signal, 0.0), np.where(known, -along, 0.0)

    def rise(self, signal: Array) -> Array:
        """Slope of a signal (..., N) over the step to each record, per second; 0 at the beginning of a stretch."""
        change = np.diff(signal, prepend=signal[..., :1], axis=-1)
        return np.where(self.step > 0.0, change / np.where(self.step > 0.0, self.step, 1.0), 0.0)


@dataclass(frozen=True)
class Filtered:
    """Output (N,), its derivatives along those of the signal (K, N), and by the filter's own coefficients (c, N)."""

    value: Array
    along: Array
    own: Array


class Filter(ABC):
    """On a recording it is called along the whole time; in a simulation, too, along the run that has been integrated,
    unless it has states."""

    COEFFICIENTS: int
    STATES = 0

    @abstractmethod
    def __call__(self, clock: Clock, signal: Array, along: Array, coefficients: Sequence[float]) -> Filtered:
        """The deviation of the output from the signal, or a rate: 0 in equilibrium. `signal` (N,) finite; `along`
        (K, N) its derivatives."""

    def bends(self, time: Array, coefficients: Sequence[float]) -> Array:
        """Times at which the output of a filter without states bends, for a signal that bends at `time` (N,)."""
        return time


class WithStates(Filter):
    """In a simulation its `STATES` move with those of the engine."""

    @abstractmethod
    def stage(
        self, signal: Value, base: Sequence[Value], step: Value, coefficients: Sequence[Value]
    ) -> tuple[Value, ...]:
        """States x = base + step · dx/dt of an implicit stage, while the signal is this; in equilibrium all are the
        signal."""

    def deviation(self, signal: Value, states: Sequence[Value], coefficients: Sequence[Value]) -> Value:
        """The same as a call gives, from the states: of filters in a row the last is what is read."""
        return states[-1] - signal


class Integrated(WithStates):
    """Its states are integrated."""

    @abstractmethod
    def slopes(self, signal: Value, states: Sequence[Value], coefficients: Sequence[Value]) -> tuple[Value, ...]:
        """dx/dt of the states."""


class Following(WithStates):
    """Its state goes with the signal at once, as far as it can from where a step of the integration began: `step` of a
    stage is the time since then."""

    STATES = 1

    @abstractmethod
    def overrun(self, time: Array, x: Array, coefficients: Sequence[float]) -> Array:
        """By how much the state, x (k, N) at rising `time` (k, N), moved further than it can (N,)."""


def recursion(a: Array, g: Array) -> Array:
    """v_k = a_k v_{k−1} + g_k for rows g (K, N), a (N,) with a_0 = 0: a lower bidiagonal system, solved by LAPACK."""
    from scipy.linalg import solve_banded

    if not g.size:
        return np.zeros_like(g)
    bands = np.stack([np.ones_like(a), np.append(-a[1:], 0.0)])
    return np.asarray(solve_banded((1, 0), bands, g.T, check_finite=False).T)
