"""Second-order lag: two first-order ones in a row."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from enginediag_cli.engine.dual import Array, Value
from enginediag_cli.engine.moving.filters.base import Clock, Filtered, Integrated
from enginediag_cli.engine.moving.filters.lag import Lag


class SecondOrder(Integrated):
    """τ₁τ₂ m'' + (τ₁ + τ₂) m' + m = u, as two lags, by τ = τ₁ + τ₂ and the share τ₂/τ. The output of the first is
    taken straight between the records, which costs of the order of (h/τ)² of what changes within a step h."""

    COEFFICIENTS = 2
    STATES = 2

    def __call__(self, clock: Clock, signal: Array, along: Array, coefficients: Sequence[float]) -> Filtered:
        lag = Lag()
        total, share = (float(c) for c in coefficients)
        one = lag(clock, signal, along, (total * (1.0 - share),))
        clock = replace(clock, start=None)  # the output of the second is that of the first where that is known
        behind = np.concatenate([along + one.along, one.own])
        two = lag(clock, signal + one.value, behind, (total * share,))
        k = len(along)
        first, second = one.own + two.along[k:], two.own
        own = np.concatenate([(1.0 - share) * first + share * second, total * (second - first)])
        return Filtered(one.value + two.value, one.along + two.along[:k], own)

    def stage(
        self, signal: Value, base: Sequence[Value], step: Value, coefficients: Sequence[Value]
    ) -> tuple[Value, ...]:
        total, share = coefficients
        first = Lag().stage(signal, base[:1], step, (total * (1.0 - share),))
        return first + Lag().stage(first[0], base[1:], step, (total * share,))

    def slopes(self, signal: Value, states: Sequence[Value], coefficients: Sequence[Value]) -> tuple[Value, ...]:
        (first, second), (total, share) = states, coefficients
        return (signal - first) / (total * (1.0 - share)), (first - second) / (total * share)
