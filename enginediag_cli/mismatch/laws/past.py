"""What followers in a formula are over the records of a fit, whose past these records themselves show.

    m(x)_n = x_n + v_n,     v: what the follower's filter makes of x along the records' times

In the simulator a follower has the whole recording for its past, what is judged by nobody included; here it has the
fit's records, between which variables are taken to run straight: near enough to find a law, which then is fitted.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from enginediag_cli.engine.dual import Dual, Value, value
from enginediag_cli.engine.filters import Filter, FilterClock
from enginediag_cli.engine.recall import MOMENT
from enginediag_cli.mismatch.fit.identified import IdentifiedHypothesis
from enginediag_cli.physics.law import MemoryCall, Past

COURSE = 8
"""Records that a stretch has on average, from which a recording tells a course."""


def clock_of(found: IdentifiedHypothesis) -> FilterClock | None:
    """The clock of a fit's records; None where these are not the course of anything: their past is not known, or most
    of them stand alone."""
    moment = found.problem.inputs.get(MOMENT)
    if moment is None:
        return None
    tapes = found.evidence.engine.tapes
    number, place = tapes.locate(moment)
    if not len(number) or (number < 0).any():
        return None
    time, stretch = np.empty(len(number)), np.empty(len(number))
    for k in np.unique(number).tolist():
        rows, tape = number == k, tapes.tapes[k]
        time[rows], stretch[rows] = tape.time[place[rows]], np.cumsum(tape.first)[place[rows]]
    first = np.append(True, (np.diff(number) != 0) | (np.diff(stretch) != 0) | (np.diff(time) <= 0.0))
    return FilterClock(time, first) if len(time) >= COURSE * np.count_nonzero(first) else None


def past_along(clock: FilterClock | None) -> Past | None:
    """Of formulas whose names have values (N,) over the records of a clock, or, coefficients, numbers, (N,) of one
    number with derivatives, or one number in each row (tries, 1)."""
    if clock is None:
        return None

    def past(of: MemoryCall, signal: Value, values: Mapping[str, Value]) -> Value:
        by = [values[n] for n in of.coefficients]
        if not np.ndim(value(signal)):
            return 0.0
        tries = [np.ndim(value(c)) == 2 for c in by]
        if not any(tries):
            return deviation(of.filter, clock, signal, by)
        rows = np.hstack([value(c) for c in by])  # (tries, coefficients)
        return np.stack([np.asarray(value(deviation(of.filter, clock, signal, [*map(float, own)]))) for own in rows])

    return past


def deviation(filter: Filter, clock: FilterClock, signal: Value, coefficients: Sequence[Value]) -> Value:
    """What a filter makes of a signal (N,) by coefficients that are one number each, with derivatives of both."""
    N = len(value(signal))
    along = signal.d if isinstance(signal, Dual) else np.zeros((0, N))
    one = filter(clock, value(signal), along, [float(np.ravel(value(c))[0]) for c in coefficients])
    rows = [along, *(c.d for c in coefficients if isinstance(c, Dual))]
    m = max(map(len, rows))
    if not m:
        return one.value
    d = np.zeros((m, N))
    d[: len(one.input_slopes)] = one.input_slopes
    for c, own in zip(coefficients, one.coefficient_slopes, strict=True):
        if isinstance(c, Dual):
            d[: len(c.d)] += own * c.d
    return Dual(one.value, d)
