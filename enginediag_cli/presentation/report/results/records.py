"""Residuals of records as columns, from the rows that `residual --what records` writes."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from enginediag_cli.presentation.charts.records import Records
from enginediag_cli.presentation.charts.rows import Row
from enginediag_cli.presentation.report.results.kinds import RESIDUAL, SIGMAS


def records_of(rows: Sequence[Row]) -> Records:
    """Raises DataError for a cell that is no number. At least one row."""
    sensors = [name.removesuffix(SIGMAS) for name in rows[0].cells if name.endswith(SIGMAS)]

    def column(name: str) -> np.ndarray:
        return np.array([row.number(name) for row in rows])

    return Records(
        [row.origin.file for row in rows],
        [int(row.origin.row) if row.origin.row.isdigit() else k for k, row in enumerate(rows)],
        [row.text("flight") for row in rows],
        column("time_s"),
        {sensor: column(sensor + SIGMAS) for sensor in sensors},
        {sensor: column(sensor + RESIDUAL) for sensor in sensors},
    )
