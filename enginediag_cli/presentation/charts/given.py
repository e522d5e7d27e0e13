"""Sizes of an answer, flight by flight, as if nothing but the answer had changed."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

from enginediag_cli.intervals import NORMAL_95
from enginediag_cli.isolation.fingerprint import given
from enginediag_cli.presentation.charts.model import Origin
from enginediag_cli.presentation.charts.rows import Row
from enginediag_cli.residuals.window import WindowStatistics

ALONE = (
    "Dots: each flight by itself, with 95 % intervals, if nothing but the parameters shown has changed. Dashed, with a "
    "band: what the whole series says."
)
"""What a chart of such sizes says of itself."""


def given_rows(windows: Iterable[tuple[WindowStatistics, Origin]], changed: Sequence[str]) -> list[Row]:
    """Rows as those of `trend --what flights`, of every window with statistics of these parameters."""
    rows: list[Row] = []
    for number, (window, origin) in enumerate(windows, start=1):
        statistics = window.statistics
        if statistics is None or not changed or not set(changed) <= set(statistics.parameters):
            continue
        for name, change, error in zip(changed, *given(statistics, changed), strict=True):
            half = NORMAL_95 * error
            cells = {"flight": window.flight, "number": number, "parameter": name, "change": change}
            rows.append(Row({**cells, "low": change - half, "high": change + half}, origin))
    return rows
