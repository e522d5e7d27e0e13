"""Backlash: the output is dragged along by the signal, and stands still while the signal turns round."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from enginediag_cli.engine.dual import Array, Value, maximum, minimum
from enginediag_cli.engine.moving.filters.base import Clock, Filtered, Following


class Backlash(Following):
    """m_k = min(max(m_{k−1}, u_k − h), u_k + h), and m = u where a stretch begins. The coefficient is h, half of the
    play. What switches at m = c switches at u = c + h on the way up and at u = c − h on the way down: hysteresis.

    A record clips what comes from before to [u − h, u + h], and clips one after the other are one clip again, so that
    all records are known after log₂ N passes: each clip over the records 2ᵖ back, by where its ends have come from.

    Source: M. A. Krasnosel'skii, A. V. Pokrovskii, Systems with Hysteresis (1989), chapter 1 (the play operator).
    """

    COEFFICIENTS = 1

    def __call__(self, clock: Clock, signal: Array, along: Array, coefficients: Sequence[float]) -> Filtered:
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
        return Filtered(values[lower] - signal, along[:, of] - along, side[None])

    def stage(
        self, signal: Value, base: Sequence[Value], step: Value, coefficients: Sequence[Value]
    ) -> tuple[Value, ...]:
        h = coefficients[0]
        return (minimum(maximum(base[0], signal - h), signal + h),)

    def overrun(self, time: Array, x: Array, coefficients: Sequence[float]) -> Array:
        return np.zeros(x.shape[-1])
