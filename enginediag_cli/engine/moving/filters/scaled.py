"""So much of what another filter makes."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from enginediag_cli.engine.dual import Array, Value
from enginediag_cli.engine.moving.filters.base import Clock, Filter, Filtered, Integrated


class Scaled(Filter):
    """The first coefficient times what `inner` makes with the others: a power is an inertia times a rate. A simulation
    takes it for a filter without states."""

    def __init__(self, inner: Filter):
        self.inner = inner
        self.COEFFICIENTS = 1 + inner.COEFFICIENTS

    def __call__(self, clock: Clock, signal: Array, along: Array, coefficients: Sequence[float]) -> Filtered:
        size = float(coefficients[0])
        clock = replace(clock, start=None)  # a power or a heat flow is not what is read
        one = self.inner(clock, signal, along, coefficients[1:])
        own = np.concatenate([one.value[None], size * one.own])
        return Filtered(size * one.value, size * one.along, own)

    def bends(self, time: Array, coefficients: Sequence[float]) -> Array:
        return self.inner.bends(time, coefficients[1:])


class ScaledIntegrated(Scaled, Integrated):
    """The same of a filter whose states are integrated: a heat flow is a conductance times a difference of
    temperatures."""

    inner: Integrated

    def __init__(self, inner: Integrated):
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
