"""What a discrepancy may vary with while an engine moves: how fast its power is changed, and what has yet to follow.

Whatever is missing that remembers (metal, a probe, an actuator) varies with none of the conditions at a record, but
with those before it: with the rate of ln u, u being what sets the power, or with ln u less itself filtered by a lag. Of
recordings that are too coarse, gated or without time nothing is added.
"""

from __future__ import annotations

import numpy as np

from enginediag_cli.drivers import LAGGING, RATE
from enginediag_cli.engine.filters import Lag, RateOfChange
from enginediag_cli.engine.recall import MOMENT, NO_MOMENT, Tape
from enginediag_cli.engine.term import DriverValues
from enginediag_cli.identification.instruments import number_stretches
from enginediag_cli.mismatch.fit.evidence import Dataset
from enginediag_cli.mismatch.fit.identified import stack_column

LAGS_S = (6.0, 20.0, 60.0)
"""Time constants, s: of actuators and probes, of thin metal, of casings; what lies between is like one of them."""


def moving_drivers(evidence: Dataset) -> list[DriverValues]:
    """Over all records of the evidence, 0 where an engine's past is not known; none where no recording shows how an
    engine moves."""
    engine = evidence.engine
    moment = stack_column(evidence, MOMENT, NO_MOMENT)
    shown = number_stretches(engine.tapes, moment) >= 0
    if not shown.any():
        return []
    number, place = engine.tapes.locate(moment)
    columns = np.zeros((1 + len(LAGS_S), len(moment)))
    for k in np.unique(number[shown]).tolist():
        tape, rows = engine.tapes.tapes[k], number == k
        if tape.has_column(engine.power_setting):
            columns[:, rows] = _followed(tape, tape.columns[engine.power_setting])[:, place[rows]]
    rate = "rate of the power setting"
    found = [DriverValues(RATE, "power_rate", columns[0], rate)]
    for lag, values in zip(LAGS_S, columns[1:], strict=True):
        short = f"what follows the power setting by {lag:g} s"
        found.append(DriverValues(LAGGING, f"power_lagging_{lag:g}s", values, short))
    return [d for d in found if d.moves]


def _followed(tape: Tape, u: np.ndarray) -> np.ndarray:
    """Rate of ln u, and ln u less each of its lags, at all records (n,) of a tape."""
    clock, none = tape.clock(), np.zeros((0, len(tape)))
    x = np.log(np.maximum(np.abs(u), np.abs(u).max() * 1e-6 + 1e-300))
    lags = [-Lag()(clock, x, none, (lag,)).value for lag in LAGS_S]
    return np.stack([RateOfChange()(clock, x, none, ()).value, *lags])
