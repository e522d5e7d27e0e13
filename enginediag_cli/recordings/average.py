"""Averages over windows that follow each other: one record out of some seconds of steady ones."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from enginediag_cli.recordings.steady import GateReport, first_reasons
from enginediag_cli.recordings.table import Recording

COMPLETE = 0.8
"""Share of the records of a window that must be there for it to count as a window."""


@dataclass(frozen=True)
class Averages:
    """recording: M records, means of the windows, with the line and text of each window's first record.

    standard_error: column → (M,) standard deviation over √n, right for noise without memory within a window;
    count: (M,) records in each window.
    """

    recording: Recording
    standard_error: Mapping[str, np.ndarray]
    count: np.ndarray


def average(
    recording: Recording, window_s: float, failed: Mapping[str, np.ndarray], new: np.ndarray | None = None
) -> tuple[Averages, GateReport]:
    """Means over windows of window_s seconds whose last record passes every condition in `failed`.

    new: (N,) bool, only the windows that end with one of these records; None for all.

    Windows begin at whole multiples of window_s, so that the engines of one flight have the same
    ones. A condition on the last window_s before a record is a condition on the window. Missing
    values are left out of the mean; a column without any is missing.
    """
    time = recording["time_s"]
    number = np.floor(np.where(np.isfinite(time), time, -1e300) / window_s)
    first = np.flatnonzero(np.concatenate([[True], np.diff(number) != 0.0])[: len(time)])
    last = np.concatenate([first[1:], [len(time)]])[: len(first)] - 1
    size = last - first + 1
    step = np.diff(time)
    forward = step[step > 0.0]
    expected = window_s / float(np.median(forward)) if len(forward) else 1.0
    complete = (size >= COMPLETE * expected) & np.isfinite(time[first])
    conditions = {"incomplete window": ~complete} | {why: mask[last] for why, mask in failed.items()}
    asked = np.ones(len(first), dtype=bool) if new is None else np.asarray(new)[last]
    keep, reasons = first_reasons(conditions, asked)
    report = GateReport(int(keep.sum()), int(asked.sum()), reasons, unit=f"windows of {window_s:g} s")
    return _means(recording, first[keep], size[keep]), report


def _means(recording: Recording, first: np.ndarray, size: np.ndarray) -> Averages:
    window = np.repeat(np.arange(len(first)), size)
    rows = first[window] + np.arange(len(window)) - np.repeat(np.cumsum(size) - size, size)
    means: dict[str, np.ndarray] = {}
    errors: dict[str, np.ndarray] = {}
    for name, values in recording.columns.items():
        x = values[rows]
        known = np.isfinite(x)
        n = np.bincount(window[known], minlength=len(first)).astype(float)
        with np.errstate(invalid="ignore", divide="ignore"):
            mean = np.bincount(window[known], x[known], minlength=len(first)) / n
            squares = np.bincount(window[known], (x[known] - mean[window[known]]) ** 2, minlength=len(first))
            means[name] = mean
            errors[name] = np.where(n > 1, np.sqrt(squares / (n - 1.0) / n), np.nan)
    return Averages(recording.select(first).with_columns(means), errors, size)
