"""Rate limit: the output follows the signal, but never faster than so much per second up, and so much down."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from enginediag_cli.engine.dual import Array, Value, maximum, minimum, value
from enginediag_cli.engine.moving.filters.base import Clock, Filtered, Following

WINDOW = 256
"""Records that are looked through at once for the end of a ramp; each further look is over twice as many."""
NEVER = 1e-300
"""Seconds per unit that are as good as none: no limit."""


class RateLimit(Following):
    """dm/dt = min(max(u', −1/s₂), 1/s₁) while m follows u; on a ramp ±1/s until it meets u. Coefficients are the
    *slownesses* s₁ (up) and s₂ (down), seconds per unit of the signal; 0 is no limit.

    A ramp begins where u becomes too fast, at a record or where another ramp has met u, and ends where it meets u,
    between two records: m = v + r (t − t₀) with v = u(t₀). Both are followed exactly, and so are the derivatives:

        dm = dv − r dt₀ + dr (t − t₀),   dt_met = (du − dm)/(r − u')
    """

    COEFFICIENTS = 2

    def __call__(self, clock: Clock, signal: Array, along: Array, coefficients: Sequence[float]) -> Filtered:
        slowness = [max(float(c), 0.0) for c in coefficients]
        rates = np.array([1.0 / s if s > 0.0 else np.inf for s in slowness]) * [1.0, -1.0]
        # dr/ds = −r²·sign, written into rows of their own behind the directions of the signal
        K, N = along.shape
        value, d = np.zeros(N), np.zeros((K + 2, N))
        rise, d_rise = clock.rise(signal), clock.rise(along) if K else along
        fast = (rise > rates[0]) | (rise < rates[1])
        start = clock.begin(signal, along)[0]
        for span in clock.spans:
            ramps = _Ramps(clock.time[span], signal[span], along[:, span], rise[span], d_rise[:, span], rates)
            ramps.follow(np.flatnonzero(fast[span]), float(start[span.start]), value[span], d[:, span])
        return Filtered(value, d[:K], d[K:])

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
