"""Filters along time: lags, delays, rate limits, hysteresis, backlash and rates of change.

A *signal* is known at the records of a tape and runs in straight lines between them. A filter gives the deviation of
its output from the signal at the same records, and its derivatives by the signal and by the filter's own coefficients.
At the start, and after every gap (`FilterClock.first`), a filter is in equilibrium, unless its output is known there
(`FilterClock.start`).

- `Lag` is first-order, exact for straight lines; `SecondOrder` is two such lags in a row.
- `Delay` shifts in time; a clock that is ahead shows later values.
- `RateLimit` follows the signal no faster than so much per second up, and so much down.
- `Backlash` is dragged along by the signal and stands still while the signal reverses.
- `Hysteresis` depends, between two thresholds, on the side from which the signal came.
- `RateOfChange` is the slope of a measured signal, per second.
- `FullScaleFilter` counts the signal in full scales, so that coefficients do not depend on the size of a machine;
  `ScaledFilter` gives a share of the output of another filter.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import pairwise

import numpy as np

from enginediag_cli.engine.dual import Array, Value, maximum, minimum, value


@dataclass(frozen=True)
class FilterClock:
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

    def initial_deviation(self, signal: Array, along: Array) -> tuple[Array, Array]:
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
class FilterOutput:
    """Output (N,), its derivatives along those of the signal (K, N), and by the filter's own coefficients (c, N)."""

    value: Array
    input_slopes: Array
    coefficient_slopes: Array


class Filter(ABC):
    """On a recording it is called along the whole time; in a simulation, too, along the run that has been integrated,
    unless it has states."""

    COEFFICIENTS: int
    STATES = 0

    @abstractmethod
    def __call__(self, clock: FilterClock, signal: Array, along: Array, coefficients: Sequence[float]) -> FilterOutput:
        """The deviation of the output from the signal, or a rate: 0 in equilibrium. `signal` (N,) finite; `along`
        (K, N) its derivatives."""

    def kink_times(self, time: Array, coefficients: Sequence[float]) -> Array:
        """Times at which the output of a filter without states bends, for a signal that bends at `time` (N,)."""
        return time


class DynamicFilter(Filter):
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


class IntegratedFilter(DynamicFilter):
    """Its states are integrated."""

    @abstractmethod
    def slopes(self, signal: Value, states: Sequence[Value], coefficients: Sequence[Value]) -> tuple[Value, ...]:
        """dx/dt of the states."""


class TrackingFilter(DynamicFilter):
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


class Backlash(TrackingFilter):
    """m_k = min(max(m_{k−1}, u_k − h), u_k + h), and m = u where a stretch begins. The coefficient is h, half of the
    play. What switches at m = c switches at u = c + h on the way up and at u = c − h on the way down: hysteresis.

    A record clips what comes from before to [u − h, u + h], and clips one after the other are one clip again, so that
    all records are known after log₂ N passes: each clip over the records 2ᵖ back, by where its ends have come from.

    Source: M. A. Krasnosel'skii, A. V. Pokrovskii, Systems with Hysteresis (1989), chapter 1 (the play operator).
    """

    COEFFICIENTS = 1

    def __call__(self, clock: FilterClock, signal: Array, along: Array, coefficients: Sequence[float]) -> FilterOutput:
        h, N = max(float(coefficients[0]), 0.0), len(signal)
        record = np.arange(N)
        # what an end may be: u − h, u + h or, at a beginning, u of some record
        sign = np.repeat([-1.0, 1.0, 0.0], N)
        values = np.tile(signal, 3) + sign * h
        lower, upper = np.where(clock.first, record + 2 * N, record), np.where(clock.first, record + 2 * N, record + N)
        back = 1
        while back < N:
            low, high = lower[back:], upper[back:]
            ends = []
            for end in (lower[:-back], upper[:-back]):
                end = np.where(values[end] < values[low], low, end)
                ends.append(np.where(values[end] > values[high], high, end))
            lower, upper = np.append(lower[:back], ends[0]), np.append(upper[:back], ends[1])
            back *= 2
        # both ends are one: each stretch begins at a known value
        of, side = lower % max(N, 1), sign[lower]
        return FilterOutput(values[lower] - signal, along[:, of] - along, side[None])

    def stage(
        self, signal: Value, base: Sequence[Value], step: Value, coefficients: Sequence[Value]
    ) -> tuple[Value, ...]:
        h = coefficients[0]
        return (minimum(maximum(base[0], signal - h), signal + h),)

    def overrun(self, time: Array, x: Array, coefficients: Sequence[float]) -> Array:
        return np.zeros(x.shape[-1])


class Delay(Filter):
    """m(t) = u(t − d), straight between the records; before the beginning of a stretch as at its beginning, behind its
    end as at its end. ∂m/∂d is minus the slope there: exact, with a kink wherever t − d meets a record."""

    COEFFICIENTS = 1

    def __call__(self, clock: FilterClock, signal: Array, along: Array, coefficients: Sequence[float]) -> FilterOutput:
        d = float(coefficients[0])
        rows = np.concatenate([signal[None], along])
        rise = clock.rise(rows)
        moved, slope = np.empty_like(rows), np.zeros(len(signal))
        for span in clock.spans:
            t = clock.time[span]
            # of the step that ends at `after`, the last of two records at the same time
            after = np.clip(np.searchsorted(t, t - d, side="left" if d >= 0.0 else "right"), 1, max(len(t) - 1, 1))
            if len(t) < 2:
                moved[:, span] = rows[:, span]
                continue
            at = np.clip(t - d, t[0], t[-1])
            before = after - 1
            moved[:, span] = rows[:, span][:, before] + rise[:, span][:, after] * (at - t[before])
            if clock.start is not None and np.isfinite(clock.start[span.start]) and d > 0.0:
                # what was before the beginning comes out until it has passed
                early = np.arange(span.start, span.stop)[t - d < t[0]]
                moved[0, early], moved[1:, early] = clock.start[span.start], 0.0
            inside = (t - d >= t[0]) & (t - d <= t[-1])
            slope[span] = np.where(inside, rise[0, span][after], 0.0)
        return FilterOutput(moved[0] - signal, moved[1:] - along, -slope[None])

    def kink_times(self, time: Array, coefficients: Sequence[float]) -> Array:
        return np.asarray(time + float(coefficients[0]))


def last_switch_side(clock: FilterClock, above: Array, below: Array) -> tuple[Array, Array]:
    """Whether a signal was last above a band, not below it, and whether its stretch shows this (…, N); `above` and
    `below`: where it is now (…, N)."""
    record = np.arange(len(clock.first))
    outside = np.maximum.accumulate(np.where(below | above, record, -1), axis=-1)
    begin = np.maximum.accumulate(np.where(clock.first, record, 0))
    return np.take_along_axis(above, np.maximum(outside, 0), axis=-1), outside >= begin


class Hysteresis(Filter):
    """1 while u lies within [u₀, u₀ + band) and was last outside below u₀, else 0; 0 where a stretch begins within the
    band, since nobody knows. Records show where u has been: what passes between two of them is not seen.

    It jumps, and has no derivative."""

    COEFFICIENTS = 2

    def __call__(self, clock: FilterClock, signal: Array, along: Array, coefficients: Sequence[float]) -> FilterOutput:
        low, band = (float(c) for c in coefficients)
        below, above = signal < low, signal >= low + max(band, 0.0)
        from_above, known = last_switch_side(clock, above, below)
        value = (known & ~from_above & ~below & ~above).astype(float)
        return FilterOutput(value, np.zeros_like(along), np.zeros((2, len(signal))))


LONGEST = 700.0
"""Time constants after which nothing is left that a double could hold."""


class Lag(IntegratedFilter):
    """τ dm/dt = u − m. The deviation v = m − u follows, exactly for straight u with slope r over a step h,

    v_k = a v_{k−1} − τ (1 − a) r_k,   a = exp(−h/τ);   v = −τ r on a ramp that lasts, 0 in equilibrium and for τ = 0.
    """

    COEFFICIENTS = 1
    STATES = 1

    def __call__(self, clock: FilterClock, signal: Array, along: Array, coefficients: Sequence[float]) -> FilterOutput:
        tau = max(float(coefficients[0]), 0.0)
        with np.errstate(divide="ignore", invalid="ignore"):
            periods = np.where(clock.step > 0.0, np.minimum(clock.step / tau if tau else np.inf, LONGEST), LONGEST)
        a = np.where(clock.first, 0.0, np.exp(-periods))
        gain = -tau * (1.0 - a)
        rows = clock.rise(np.concatenate([signal[None], along]))
        start = np.concatenate([x.reshape(-1, len(signal)) for x in clock.initial_deviation(signal, along)])
        v = recursion(a, gain * rows + (start if tau else 0.0))
        # dv/dτ: a' = a h/τ², gain' = −(1 − a − a h/τ)
        before = np.append(0.0, v[0][:-1])
        bend = np.where(a > 0.0, a * periods / tau if tau else 0.0, 0.0)
        own = recursion(a, (bend * before - (1.0 - a - a * periods) * rows[0])[None])
        return FilterOutput(v[0], v[1:], own)

    def stage(
        self, signal: Value, base: Sequence[Value], step: Value, coefficients: Sequence[Value]
    ) -> tuple[Value, ...]:
        tau = coefficients[0]
        return ((base[0] * tau + signal * step) / (step + tau),)

    def slopes(self, signal: Value, states: Sequence[Value], coefficients: Sequence[Value]) -> tuple[Value, ...]:
        return ((signal - states[0]) / coefficients[0],)


class FullScaleFilter(TrackingFilter):
    """`inner` of the signal over `full`, times `full`: slownesses of a rate limit are then seconds for a full scale."""

    def __init__(self, inner: TrackingFilter, full: float):
        self.inner, self.full = inner, full
        self.COEFFICIENTS = inner.COEFFICIENTS

    def __call__(self, clock: FilterClock, signal: Array, along: Array, coefficients: Sequence[float]) -> FilterOutput:
        if clock.start is not None:
            clock = replace(clock, start=clock.start / self.full)
        one = self.inner(clock, signal / self.full, along / self.full, coefficients)
        return FilterOutput(one.value * self.full, one.input_slopes * self.full, one.coefficient_slopes * self.full)

    def stage(
        self, signal: Value, base: Sequence[Value], step: Value, coefficients: Sequence[Value]
    ) -> tuple[Value, ...]:
        share = 1.0 / self.full
        states = self.inner.stage(signal * share, [b * share for b in base], step, coefficients)
        return tuple(x * self.full for x in states)

    def deviation(self, signal: Value, states: Sequence[Value], coefficients: Sequence[Value]) -> Value:
        share = 1.0 / self.full
        return self.inner.deviation(signal * share, [x * share for x in states], coefficients) * self.full

    def overrun(self, time: Array, x: Array, coefficients: Sequence[float]) -> Array:
        return self.inner.overrun(time, x / self.full, coefficients) * self.full


WINDOW = 256
"""Records that are looked through at once for the end of a ramp; each further look is over twice as many."""
NEVER = 1e-300
"""Seconds per unit that are as good as none: no limit."""


class RateLimit(TrackingFilter):
    """dm/dt = min(max(u', −1/s₂), 1/s₁) while m follows u; on a ramp ±1/s until it meets u. Coefficients are the
    *slownesses* s₁ (up) and s₂ (down), seconds per unit of the signal; 0 is no limit.

    A ramp begins where u becomes too fast, at a record or where another ramp has met u, and ends where it meets u,
    between two records: m = v + r (t − t₀) with v = u(t₀). Both are followed exactly, and so are the derivatives:

        dm = dv − r dt₀ + dr (t − t₀),   dt_met = (du − dm)/(r − u')
    """

    COEFFICIENTS = 2

    def __call__(self, clock: FilterClock, signal: Array, along: Array, coefficients: Sequence[float]) -> FilterOutput:
        slowness = [max(float(c), 0.0) for c in coefficients]
        rates = np.array([1.0 / s if s > 0.0 else np.inf for s in slowness]) * [1.0, -1.0]
        # dr/ds = −r²·sign, written into rows of their own behind the directions of the signal
        K, N = along.shape
        value, d = np.zeros(N), np.zeros((K + 2, N))
        rise, d_rise = clock.rise(signal), clock.rise(along) if K else along
        fast = (rise > rates[0]) | (rise < rates[1])
        start = clock.initial_deviation(signal, along)[0]
        for span in clock.spans:
            ramps = _Ramps(clock.time[span], signal[span], along[:, span], rise[span], d_rise[:, span], rates)
            ramps.follow(np.flatnonzero(fast[span]), float(start[span.start]), value[span], d[:, span])
        return FilterOutput(value, d[:K], d[K:])

    def stage(
        self, signal: Value, base: Sequence[Value], step: Value, coefficients: Sequence[Value]
    ) -> tuple[Value, ...]:
        up, down = (step / np.maximum(value(c), NEVER) for c in coefficients)
        return (maximum(minimum(signal, base[0] + up), base[0] - down),)

    def overrun(self, time: Array, x: Array, coefficients: Sequence[float]) -> Array:
        moved, h = np.diff(x, axis=0), np.diff(time, axis=0)
        up, down = (h / np.maximum(c, NEVER) for c in coefficients)
        return np.asarray(np.maximum(np.maximum(moved - up, -down - moved).max(axis=0), 0.0))


class _Ramps:
    """The ramps of one stretch, one after the other."""

    def __init__(self, t: Array, u: Array, du: Array, rise: Array, d_rise: Array, rates: Array):
        self.t, self.u, self.du, self.rise, self.d_rise, self.rates = t, u, du, rise, d_rise, rates
        self.K = len(du)

    def follow(self, fast: Array, start: float, value: Array, d: Array) -> None:
        """Deviations m − u into `value` (N,) and their derivatives into `d` (K + 2, N); `fast`: records to which the
        signal runs too fast; `start`: the deviation at the beginning."""
        at = 0  # of `fast`: those before have been dealt with
        if start != 0.0 and np.isfinite(self.rates[0 if start < 0.0 else 1]) and len(self.t) > 1:
            value[0], d[: self.K, 0] = start, -self.du[:, 0]
            none = np.zeros(self.K + 2)
            known: tuple[int, float, float, Array, Array] | None = (0, float(self.t[0]), self.u[0] + start, none, none)
            last = 0
            up: bool | None = start < 0.0
            while known is not None:
                known, last = self._ramp(known, value, d, up=up)
                up = None
            at = int(np.searchsorted(fast, last, side="right"))
        while at < len(fast):
            k = int(fast[at]) - 1
            begin: tuple[int, float, float, Array, Array] | None = (
                k,
                float(self.t[k]),
                float(self.u[k]),
                np.append(self.du[:, k], [0.0, 0.0]),
                np.zeros(self.K + 2),
            )
            last = k
            while begin is not None:
                begin, last = self._ramp(begin, value, d)
            at = int(np.searchsorted(fast, last, side="right"))

    def _ramp(
        self, begin: tuple[int, float, float, Array, Array], value: Array, d: Array, up: bool | None = None
    ) -> tuple[tuple[int, float, float, Array, Array] | None, int]:
        """One ramp from (step that begins at record k, t₀, v, dv, dt₀): writes it down, and where the next one begins
        at once, or None, with the record up to which all has been dealt with; `up`: its side, that of the signal where
        it begins on it."""
        k, t0, v, dv, dt0 = begin
        up = self.rise[k + 1] > 0.0 if up is None else up
        r = float(self.rates[0 if up else 1])
        dr = np.zeros(self.K + 2)
        dr[self.K + (0 if up else 1)] = -r * abs(r)
        side = 1.0 if up else -1.0
        first, width, end = k + 1, WINDOW, len(self.t)
        while first < len(self.t):
            rows = slice(first, min(first + width, len(self.t)))
            over = side * (v + r * (self.t[rows] - t0) - self.u[rows])
            met = np.flatnonzero(over >= 0.0)
            if met.size:
                end = first + int(met[0])
                break
            first, width = rows.stop, 2 * width
        own = slice(k + 1, end)
        after = self.t[own] - t0
        value[own] = v + r * after - self.u[own]
        d[:, own] = (dv - r * dt0)[:, None] + dr[:, None] * after
        d[: self.K, own] -= self.du[:, own]
        if end == len(self.t) or end == k + 1:  # to its end, or met within rounding
            return None, end
        # met within the step to record `end`
        slope = float(self.rise[end])
        before = end - 1
        ahead_before = v + r * (float(self.t[before]) - t0) - float(self.u[before])
        t_met = float(self.t[before]) - ahead_before / (r - slope) if r != slope else float(self.t[end])
        into = t_met - float(self.t[before])
        du = np.append(self.du[:, before] + self.d_rise[:, end] * into, [0.0, 0.0])
        dm = dv - r * dt0 + dr * (t_met - t0)
        dt_met = (du - dm) / (r - slope) if r != slope else np.zeros_like(dm)
        too_fast = slope > self.rates[0] or slope < self.rates[1]
        if too_fast and t_met < self.t[end]:
            u_met = float(self.u[before]) + slope * into
            return (before, t_met, u_met, du + slope * dt_met, dt_met), end
        return None, end


class RateOfChange(Filter):
    """Slope at each record of the parabola through it and its two neighbours: exact for a signal of constant
    acceleration, however unevenly it is sampled; of the straight line at the ends of a stretch.

    That is a smoothing over two steps h: noise σ of a reading becomes σ/(√2 h), and the corner of a ramp is rounded
    over one step on either side. It looks one record ahead."""

    COEFFICIENTS = 0

    def __call__(self, clock: FilterClock, signal: Array, along: Array, coefficients: Sequence[float]) -> FilterOutput:
        rows = np.concatenate([signal[None], along])
        rise, h = clock.rise(rows), clock.step
        found = np.zeros_like(rows)
        for span in clock.spans:
            r, step = rise[:, span], h[span]
            if r.shape[1] < 2:
                continue
            before, after = step[1:-1], step[2:]
            both = before + after
            share = np.where(both > 0.0, before / np.where(both > 0.0, both, 1.0), 0.5)
            own = found[:, span]
            own[:, 1:-1] = (1.0 - share) * r[:, 1:-1] + share * r[:, 2:]
            own[:, 0], own[:, -1] = r[:, 1], r[:, -1]
        return FilterOutput(found[0], found[1:], np.empty((0, len(signal))))


class ScaledFilter(Filter):
    """The first coefficient times what `inner` makes with the others: a power is an inertia times a rate. A simulation
    takes it for a filter without states."""

    def __init__(self, inner: Filter):
        self.inner = inner
        self.COEFFICIENTS = 1 + inner.COEFFICIENTS

    def __call__(self, clock: FilterClock, signal: Array, along: Array, coefficients: Sequence[float]) -> FilterOutput:
        size = float(coefficients[0])
        clock = replace(clock, start=None)  # a power or a heat flow is not what is read
        one = self.inner(clock, signal, along, coefficients[1:])
        own = np.concatenate([one.value[None], size * one.coefficient_slopes])
        return FilterOutput(size * one.value, size * one.input_slopes, own)

    def kink_times(self, time: Array, coefficients: Sequence[float]) -> Array:
        return self.inner.kink_times(time, coefficients[1:])


class ScaledIntegratedFilter(ScaledFilter, IntegratedFilter):
    """The same of a filter whose states are integrated: a heat flow is a conductance times a difference of
    temperatures."""

    inner: IntegratedFilter

    def __init__(self, inner: IntegratedFilter):
        super().__init__(inner)
        self.STATES = inner.STATES

    def stage(
        self, signal: Value, base: Sequence[Value], step: Value, coefficients: Sequence[Value]
    ) -> tuple[Value, ...]:
        return self.inner.stage(signal, base, step, coefficients[1:])

    def slopes(self, signal: Value, states: Sequence[Value], coefficients: Sequence[Value]) -> tuple[Value, ...]:
        return self.inner.slopes(signal, states, coefficients[1:])

    def deviation(self, signal: Value, states: Sequence[Value], coefficients: Sequence[Value]) -> Value:
        return self.inner.deviation(signal, states, coefficients[1:]) * coefficients[0]


class SecondOrder(IntegratedFilter):
    """τ₁τ₂ m'' + (τ₁ + τ₂) m' + m = u, as two lags, by τ = τ₁ + τ₂ and the share τ₂/τ. The output of the first is
    taken straight between the records, which costs of the order of (h/τ)² of what changes within a step h."""

    COEFFICIENTS = 2
    STATES = 2

    def __call__(self, clock: FilterClock, signal: Array, along: Array, coefficients: Sequence[float]) -> FilterOutput:
        lag = Lag()
        total, share = (float(c) for c in coefficients)
        one = lag(clock, signal, along, (total * (1.0 - share),))
        clock = replace(clock, start=None)  # the output of the second is that of the first where that is known
        behind = np.concatenate([along + one.input_slopes, one.coefficient_slopes])
        two = lag(clock, signal + one.value, behind, (total * share,))
        k = len(along)
        first, second = one.coefficient_slopes + two.input_slopes[k:], two.coefficient_slopes
        own = np.concatenate([(1.0 - share) * first + share * second, total * (second - first)])
        return FilterOutput(one.value + two.value, one.input_slopes + two.input_slopes[:k], own)

    def stage(
        self, signal: Value, base: Sequence[Value], step: Value, coefficients: Sequence[Value]
    ) -> tuple[Value, ...]:
        total, share = coefficients
        first = Lag().stage(signal, base[:1], step, (total * (1.0 - share),))
        return first + Lag().stage(first[0], base[1:], step, (total * share,))

    def slopes(self, signal: Value, states: Sequence[Value], coefficients: Sequence[Value]) -> tuple[Value, ...]:
        (first, second), (total, share) = states, coefficients
        return (signal - first) / (total * (1.0 - share)), (first - second) / (total * share)
