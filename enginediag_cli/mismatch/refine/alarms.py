"""What `detect` does on unseen flights: the share of windows that alarm, and how well the model fits in them.

Each engine is identified from its own training flights as `identify` does, then its unseen flights are judged
window by window as `detect` does. The flights are believed healthy, so every alarm is a false one.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy import stats

from enginediag_cli.detection.verdict import FAULT, NO_VERDICT, NOTHING_REQUIRED, judge
from enginediag_cli.engine.engine import Engine
from enginediag_cli.identification.identify import identify
from enginediag_cli.identification.problem import TrainingRecording, settings_from_mapping
from enginediag_cli.mismatch.fit.evidence import Dataset, Flight
from enginediag_cli.recordings.table import Recording
from enginediag_cli.residuals.monitor import monitor_from_nominal
from enginediag_cli.residuals.pipeline import window_statistics
from enginediag_cli.residuals.reduced import add_sensor_lags, compact_monitor
from enginediag_cli.residuals.windows import WindowPlan

NOMINAL_RATE = 0.01
"""False-alarm rate at which windows are counted as alarms: the default of `detect`."""
NO_FIT = 0.01  # level of the lack-of-fit test


@dataclass(frozen=True)
class Alarms:
    """Windows judged and not judged, how many alarm at NOMINAL_RATE, how many the model does not fit at NO_FIT, and
    their median χ² per degree of freedom; `reason`: why an engine could not be identified, or empty."""

    judged: int
    without_verdict: int
    alarms: int
    misfits: int
    fit: float
    reason: str = ""

    @property
    def rate(self) -> float:
        return self.alarms / self.judged if self.judged else float("nan")

    @property
    def interval(self) -> tuple[float, float]:
        """95 % (Clopper and Pearson, Biometrika 26 (1934) 404–413)."""
        if not self.judged:
            return float("nan"), float("nan")
        found = stats.binomtest(self.alarms, self.judged).proportion_ci(0.95)
        return float(found.low), float(found.high)


def alarms(engine: Engine, evidence: Dataset, unseen: Sequence[int], window: int) -> Alarms:
    """Of the unseen flights of the evidence, by this engine, in windows of so many records."""
    judged = without = found = misfits = 0
    ratios: list[float] = []
    reasons = []
    for name in evidence.engines:
        mine = [k for k, f in enumerate(evidence.flights) if f.engine == name]
        training = [evidence.flights[k] for k in mine if k not in unseen]
        test = [evidence.flights[k] for k in mine if k in unseen]
        if not test:
            continue
        settings = settings_from_mapping(engine.declared.get("identification"))
        result = identify(
            engine,
            [TrainingRecording(f.label, f.columns) for f in training],
            settings=settings,
            cross_validation=settings.monitoring_noise == "cross_validation",
        )
        if not result.converged:
            reasons.append(f"{name or 'the engine'} could not be identified: {result.reason}")
            continue
        monitor = add_sensor_lags(compact_monitor(monitor_from_nominal(engine, result.nominal("", "", {}))))
        plan = WindowPlan(window, window)
        for w in window_statistics(monitor, [_recording(f) for f in test], plan):
            verdict = judge(w, NOMINAL_RATE, NOTHING_REQUIRED)
            if verdict.verdict == NO_VERDICT:
                without += 1
                continue
            judged += 1
            found += verdict.verdict == FAULT
            if verdict.fit is not None and np.isfinite(verdict.fit.ratio):
                ratios.append(verdict.fit.ratio)
                misfits += verdict.fit.p_value < NO_FIT
    fit = float(np.median(ratios)) if ratios else float("nan")
    return Alarms(judged, without, found, misfits, fit, "; ".join(reasons))


def _recording(f: Flight) -> Recording:
    return Recording(dict(f.columns), source=f.label)
