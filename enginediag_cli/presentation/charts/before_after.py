"""What a refinement gains on flights that were not fitted: each reading before and after, and flight by flight."""

from __future__ import annotations

import math
from collections.abc import Sequence

from enginediag_cli.presentation.charts.model import Axis, Bars, Chart, Column, Mark, Origin, Points, Table
from enginediag_cli.presentation.charts.rows import Row
from enginediag_cli.units import split_column

CHI2, RMS = "chi2 per reading", "rms"
"""What rows of `refine` say of a reading."""
ALL = "all"
"""The row of all readings together."""


def before_after(key: str, rows: Sequence[Row]) -> Chart:
    """Rows of `refine`; the readings' own unit stands in the table."""
    chi2 = [row for row in rows if row.text("what") == CHI2 and row.text("of") != ALL]
    rms = {row.text("of"): row for row in rows if row.text("what") == RMS}
    names = [split_column(row.text("of"))[0] for row in chi2]
    before, after = ([math.sqrt(row.number(c)) for row in chi2] for c in ("before", "after"))
    places = list(range(len(chi2)))
    origins = [row.origin for row in chi2]
    cells = []
    for row, name, one, other in zip(chi2, names, before, after, strict=True):
        told = rms.get(row.text("of"))
        sizes = (told.number("before"), told.number("after"), told.text("unit")) if told else (None, None, "")
        cells.append((name, one, other, *sizes, row.count("n")))
    columns = (
        Column("reading"),
        Column("RMS before, standard deviations"),
        Column("after"),
        Column("RMS before"),
        Column("after"),
        Column("unit"),
        Column("readings"),
    )
    return Chart(
        key,
        "Unseen flights, before and after",
        Axis("RMS of the residual in standard deviations of the noise"),
        Axis("", categories=names),
        [
            Points("before", before, places, 1, origins=origins),
            Points("after", after, places, 0, origins=origins),
        ],
        Table(columns, cells, origins),
        "At 1 a reading is predicted as well as its noise allows.",
        [Mark(1.0, "noise alone")],
    )


def flight_gains(key: str, flights: Sequence[tuple[str, float, Origin]]) -> Chart:
    """(flight, gain of log likelihood, its place)."""
    origins = [origin for _, _, origin in flights]
    gains = [gain for _, gain, _ in flights]
    lost = sum(gain <= 0 for gain in gains)
    return Chart(
        key,
        "Gain, flight by flight",
        Axis("gain of log likelihood"),
        Axis("", categories=[name for name, _, _ in flights]),
        [Bars("", list(range(len(flights))), gains, 0, origins=origins)],
        Table((Column("flight"), Column("gain of log likelihood")), [(n, g) for n, g, _ in flights], origins),
        f"{sum(gains):.1f} in all; {lost or 'none'} of {len(flights)} without gain.",
    )
