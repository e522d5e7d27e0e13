"""Pure delay: what a column shows is what was, or, with a clock that is ahead, what is yet to come."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from enginediag_cli.engine.dual import Array
from enginediag_cli.engine.moving.filters.base import Clock, Filter, Filtered


class Delay(Filter):
    """m(t) = u(t − d), straight between the records; before the beginning of a stretch as at its beginning, behind its
    end as at its end. ∂m/∂d is minus the slope there: exact, with a kink wherever t − d meets a record."""

    COEFFICIENTS = 1

    def __call__(self, clock: Clock, signal: Array, along: Array, coefficients: Sequence[float]) -> Filtered:
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
        return Filtered(moved[0] - signal, moved[1:] - along, -slope[None])

    def bends(self, time: Array, coefficients: Sequence[float]) -> Array:
        return np.asarray(time + float(coefficients[0]))
