"""Residuals record by record: measured minus predicted, in the sensor's unit and in standard deviations."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np

from enginediag_cli.recordings.table import Recording
from enginediag_cli.residuals.admission import check_inputs, judged_inputs
from enginediag_cli.residuals.groups import KEYS
from enginediag_cli.residuals.monitor import Monitor

STATES = ("ok", "outside the maps", "did not converge", "invalid input")


def record_residuals(monitor: Monitor, recording: Recording) -> Iterator[dict[str, Any]]:
    """One row per record: its place, `<sensor>:residual` in the column's unit, `<sensor>:sigmas`, state.

    The state says why a record has no residual, or that it lies outside the operating points identified.
    """
    check_inputs(monitor, recording)
    taken = judged_inputs(monitor, recording)
    inputs, y, incomplete = taken.inputs, taken.y, taken.incomplete
    rows = np.flatnonzero(~incomplete)
    e = np.full(y.shape, np.nan)
    state = np.where(incomplete, "incomplete", "").astype(object)
    if rows.size:
        predicted, _, ok, prediction = monitor.predict({c: v[rows] for c, v in inputs.items()}, monitor.theta0)
        e[rows] = np.where(ok[:, None], y[rows] - predicted, np.nan)
        state[rows] = [STATES[code] for code in np.asarray(prediction.status)]
        for i in np.flatnonzero(~ok):
            state[rows[i]] = prediction.reason(int(i)) or state[rows[i]]
    state[taken.beyond & (state == "ok")] = "outside the operating points identified"
    sigmas = e / monitor.noise.sigma
    text = {c: recording.text[c] for c in KEYS if c in recording.text}
    time = recording.columns.get("time_s")
    for k in range(len(recording)):
        row: dict[str, Any] = {"source": recording.source, "line": int(recording.line[k])}
        row.update({c: values[k] for c, values in text.items()})
        if time is not None:
            row["time_s"] = time[k]
        for j, sensor in enumerate(monitor.sensors):
            row[f"{sensor}:residual"], row[f"{sensor}:sigmas"] = e[k, j], sigmas[k, j]
        row["state"] = state[k]
        yield row
