"""The surge line of a compressor, and how far from it the compressor works.

The margin is that of pressure ratio at constant corrected flow, SM = PR_surge(W_c)/PR − 1. Others are in use and are
other numbers for the same point: at constant corrected speed (PR_surge/PR)(W_c/W_c,surge) − 1, for which one must know
where the speed line ends, and (PR_surge − PR)/(PR_surge − 1), which counts from a ratio of one. Below zero the point
lies beyond the line.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from enginediag_cli.config.fields import Field, Section
from enginediag_cli.engine.dual import Value, chain, value

SURGE_LINE = Section(
    "surge_line",
    "points at which the compressor surges; beyond the first and last one the straight line goes on",
    (
        Field(
            "corrected_flow",
            "numbers",
            "corrected flow of each point, rising: in the units of the table, or in kg/s where there is none",
        ),
        Field("pressure_ratio", "numbers", "pressure ratio of each point: that of the table, or as it is"),
    ),
)


class SurgeLine:
    """Straight lines between the points. Raises ValueError where they are no line."""

    def __init__(self, values: Mapping[str, Any]):
        self.flow = np.asarray(values["corrected_flow"], dtype=float)
        self.ratio = np.asarray(values["pressure_ratio"], dtype=float)
        if self.flow.size != self.ratio.size or self.flow.size < 2 or (np.diff(self.flow) <= 0.0).any():
            raise ValueError("corrected_flow of its surge_line must rise, with one pressure_ratio each, at least two")

    def at(self, flow: Value) -> Value:
        """Pressure ratio of surge (N,) at a corrected flow (N,)."""
        slope = np.diff(self.ratio) / np.diff(self.flow)
        w = np.asarray(value(flow))
        k = np.clip(np.searchsorted(self.flow, w, side="right") - 1, 0, slope.size - 1)
        return chain(self.ratio[k] + slope[k] * (w - self.flow[k]), (slope[k], flow))
