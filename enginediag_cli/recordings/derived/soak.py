"""How far a column is ahead of its own recent past: the driver of heat soak after a change of power."""

from __future__ import annotations

import numpy as np

from enginediag_cli.config.fields import Field, Section
from enginediag_cli.recordings.derived.rule import Columns, Rule, Settings


def lowpass(values: np.ndarray, time_s: np.ndarray, time_constant_s: float) -> np.ndarray:
    """Low-pass (N,) of values at any time stamps: τ dy/dt = x − y, with y = x at the first record.

    Exact between records for x held over each step: y_k = b y_{k−1} + (1 − b) x_k, b = exp(−Δt/τ), solved as
    one bidiagonal system. Where x is missing y is held; where time runs backwards (files joined) it starts
    afresh.
    """
    from scipy.linalg import solve_banded

    known = np.isfinite(values)
    if not known.any():
        return np.full(len(values), np.nan)
    step = np.diff(time_s, prepend=time_s[0])
    decay = np.where(step >= 0.0, np.exp(-np.maximum(step, 0.0) / time_constant_s), 0.0)
    decay = np.where(known, decay, 1.0)
    start = int(np.argmax(known))
    decay[: start + 1] = 0.0
    x = np.where(known, values, 0.0)
    x[:start] = values[start]
    bands = np.zeros((2, len(x)))
    bands[0] = 1.0
    bands[1, :-1] = -decay[1:]
    result: np.ndarray = solve_banded((1, 0), bands, (1.0 - decay) * x)
    return result


def _compute(columns: Columns, settings: Settings) -> np.ndarray:
    values = columns[settings["column"]]
    return values - lowpass(values, columns[settings["time"]], settings["time_constant_s"])


SOAK = Rule(
    Section(
        "soak",
        "a column minus its own low-pass, computed at the rate of the file, before averaging",
        (
            Field("column", "text", "column that drives the soak, e.g. N1_rpm"),
            Field("time_constant_s", "number", "time constant of the low-pass", unit="s", minimum=1e-3),
            Field("time", "text", "column of the time", "time_s"),
        ),
    ),
    lambda settings: [settings["column"], settings["time"]],
    _compute,
)
