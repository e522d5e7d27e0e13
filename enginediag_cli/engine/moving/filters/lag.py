"""First-order lag, exact for a signal that runs straight from record to record."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from enginediag_cli.engine.dual import Array, Value
from enginediag_cli.engine.moving.filters.base import Clock, Filtered, Integrated, recursion

LONGEST = 700.0
"""Time constants after which nothing is left that a double could hold."""


class Lag(Integrated):
    """τ dm/dt = u − m. The deviation v = m − u follows, exactly for straight u with slope r over a step h,

    v_k = a v_{k−1} − τ (1 − a) r_k,   a = exp(−h/τ);   v = −τ r on a ramp that lasts, 0 in equilibrium and for τ = 0.
    """

    COEFFICIENTS = 1
    STATES = 1

    def __call__(self, clock: Clock, signal: Array, along: Array, coefficients: Sequence[float]) -> Filtered:
        tau = max(float(coefficients[0]), 0.0)
        with np.errstate(divide="ignore", invalid="ignore"):
            periods = np.where(clock.step > 0.0, np.minimum(clock.step / tau if tau else np.inf, LONGEST), LONGEST)
        a = np.where(clock.first, 0.0, np.exp(-periods))
        gain = -tau * (1.0 - a)
        rows = clock.rise(np.concatenate([signal[None], along]))
        start = np.concatenate([x.reshape(-1, len(signal)) for x in clock.begin(signal, along)])
        v = recursion(a, gain * rows + (start if tau else 0.0))
        # dv/dτ: a' = a h/τ², gain' = −(1 − a − a h/τ)
        before = np.append(0.0, v[0][:-1])
        bend = np.where(a > 0.0, a * periods / tau if tau else 0.0, 0.0)
        own = recursion(a, (bend * before - (1.0 - a - a * periods) * rows[0])[None])
        return Filtered(v[0], v[1:], own)

    def stage(
        self, signal: Value, base: Sequence[Value], step: Value, coefficients: Sequence[Value]
    ) -> tuple[Value, ...]:
        tau = coefficients[0]
        return ((base[0] * tau + signal * step) / (step + tau),)

    def slopes(self, signal: Value, states: Sequence[Value], coefficients: Sequence[Value]) -> tuple[Value, ...]:
        return ((signal - states[0]) / coefficients[0],)
