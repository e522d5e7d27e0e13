"""Simulated records as recordings, and recordings as operating conditions."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from enginediag_cli.recordings.table import Recording
from enginediag_cli.simulation.conditions import Conditions


def conditions_of(recording: Recording) -> Conditions:
    """Operating conditions with the columns of a recording in their order; text stays text."""
    numbers, text = recording.columns, recording.text
    return Conditions(
        {name: numbers[name] if name in numbers else np.asarray(text[name], dtype=str) for name in recording.order}
    )


def recording_of(columns: Mapping[str, NDArray]) -> Recording:
    """A recording of columns (N,): numbers as float64, everything else as text."""
    numbers = {
        name: np.asarray(values, dtype=float)
        for name, values in columns.items()
        if np.issubdtype(values.dtype, np.number)
    }
    text = {name: [str(cell) for cell in values.tolist()] for name, values in columns.items() if name not in numbers}
    return Recording(numbers, text, tuple(columns))
