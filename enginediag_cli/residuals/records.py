"""Residuals record by record: measured minus predicted, in the sensor's unit and in standard deviations.

Residuals with the memory of the noise taken out: independent from record to record, for tests on a stream.

For AR(1) noise the innovation of a sensor is what its past reading does not predict,

    z_k = (e_k − c_k e_l) / (σ √(1 − c_k²))        G_k = (J_k − c_k J_l) / (σ √(1 − c_k²))        c_k = ρ^(k−l)

with l the sensor's last reading before k (G. E. P. Box and G. M. Jenkins, Time Series Analysis, 1976, ch. 7). Their
likelihood is that of the readings, so that likelihood ratios are exact and not only right in the long run.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from enginediag_cli.recordings.table import Recording
from enginediag_cli.residuals.instruments import NoiseModel
from enginediag_cli.residuals.monitor import Monitor
from enginediag_cli.residuals.statistics import whiten
from enginediag_cli.residuals.windows import KEYS, check_inputs, judged_inputs

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


@dataclass
class Innovations:
    """Innovations of a stream that comes in chunks; remembers the last reading of every sensor."""

    noise: NoiseModel
    _last: dict[int, tuple[float, float, np.ndarray]] = field(default_factory=dict)  # time, e/σ, J/σ of a sensor
    _elapsed: float = 0.0

    def fork(self) -> Innovations:
        """One that goes on from here by itself."""
        return replace(self, _last=dict(self._last))

    def of(self, e: np.ndarray, J: np.ndarray, lags: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """z (N, m) and G (N, m, p) of the next records, zero where a sensor is missing.

        e (N, m) in sensor units, NaN where missing; J (N, m, p); lags (N,) in records since the record before,
        inf for the first of a recording.
        """
        if self.noise.white:
            return whiten(e, J, self.noise)
        present = np.isfinite(e) & np.all(np.isfinite(J), axis=2)
        steps = np.where(np.isfinite(lags), lags, 1e9)
        time = self._elapsed + np.cumsum(steps)
        if len(time):
            self._elapsed = float(time[-1])
        z, G = np.zeros_like(e), np.zeros_like(J)
        for j, (sigma, rho) in enumerate(zip(self.noise.sigma, self.noise.rho, strict=True)):
            rows = np.flatnonzero(present[:, j])
            if not rows.size:
                continue
            t, x, g = time[rows], e[rows, j] / sigma, J[rows, j] / sigma
            before = self._last.get(j, (-np.inf, 0.0, np.zeros(J.shape[2])))
            c = rho ** np.diff(t, prepend=before[0])
            scale = 1 / np.sqrt(1 - c**2)
            z[rows, j] = scale * (x - c * np.concatenate([[before[1]], x[:-1]]))
            G[rows, j] = scale[:, None] * (g - c[:, None] * np.concatenate([before[2][None], g[:-1]]))
            self._last[j] = float(t[-1]), float(x[-1]), g[-1]
        return z, G
