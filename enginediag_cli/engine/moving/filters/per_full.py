"""A filter that follows, its signal counted in full scales: its coefficients do not depend on the size of a machine."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from enginediag_cli.engine.dual import Array, Value
from enginediag_cli.engine.moving.filters.base import Clock, Filtered, Following


class PerFull(Following):
    """`inner` of the signal over `full`, times `full`: slownesses of a rate limit are then seconds for a full scale."""

    def __init__(self, inner: Following, full: float):
        self.inner, self.full = inner, full
        self.COEFFICIENTS = inner.COEFFICIENTS

    def __call__(self, clock: Clock, signal: Array, along: Array, coefficients: Sequence[float]) -> Filtered:
        if clock.start is not None:
            clock = replace(clock, start=clock.start / self.full)
        one = self.inner(clock, signal / self.full, along / self.full, coefficients)
        return Filtered(one.value * self.full, one.along * self.full, one.own * self.full)

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
