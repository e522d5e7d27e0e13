"""Rate of change of a signal that was measured, per second."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from enginediag_cli.engine.dual import Array
from enginediag_cli.engine.moving.filters.base import Clock, Filter, Filtered


class RateOfChange(Filter):
    """Slope at each record of the parabola through it and its two neighbours: exact for a signal of constant
    acceleration, however unevenly it is sampled; of the straight line at the ends of a stretch.

    That is a smoothing over two steps h: noise σ of a reading becomes σ/(√2 h), and the corner of a ramp is rounded
    over one step on either side. It looks one record ahead."""

    COEFFICIENTS = 0

    def __call__(self, clock: Clock, signal: Array, along: Array, coefficients: Sequence[float]) -> Filtered:
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
        return Filtered(found[0], found[1:], np.empty((0, len(signal))))
