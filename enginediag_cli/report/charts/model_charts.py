"""Charts of a model: how well it fits, where it differs, the correction that was found, before and after.

What a refinement gains on flights that were not fitted: each reading before and after, and flight by flight.

A law, or a free curve, along what it varies with, with its band: what is settled whatever the form.

Where model and recordings differ: location × driver, by how surprising a correction there is.

How well an identified engine reproduces each reading, in standard deviations of the noise that was found.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

from enginediag_cli.identification.quality import EVERYTHING, SensorQuality
from enginediag_cli.intervals import NORMAL_95
from enginediag_cli.report.charts.model import (
    Axis,
    Band,
    Bars,
    Cells,
    Chart,
    Column,
    Layer,
    Line,
    Mark,
    Origin,
    Points,
    Table,
    Value,
)
from enginediag_cli.report.charts.rows import Row
from enginediag_cli.units import split_column

if TYPE_CHECKING:
    from enginediag_cli.identification.identify import Identification


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


def law_curve(key: str, band: Mapping[str, Any], place: str, origin: Origin) -> Chart:
    """band: `variable`, `values`, `change`, `standard_error` and `unit`, as `explain` writes them."""
    unit = str(band.get("unit") or "")
    factor, shown = (100.0, "%") if unit in ("", "1") else (1.0, unit)
    x = [float(v) for v in band["values"]]
    change = [factor * float(v) for v in band["change"]]
    error = [factor * float(v) for v in band["standard_error"]]
    low = [c - NORMAL_95 * e for c, e in zip(change, error, strict=True)]
    high = [c + NORMAL_95 * e for c, e in zip(change, error, strict=True)]
    variable = str(band["variable"]).replace("_", " ")
    columns = (Column(variable), Column("change", shown), Column("95 % from", shown), Column("to", shown))
    rows = list(zip(x, change, low, high, strict=True))
    return Chart(
        key,
        f"What the model lacks at {place}",
        Axis(variable),
        Axis(f"change of {place}", shown),
        [Band("95 % band", x, low, high, 0), Line("law", x, change, 0)],
        Table(columns, rows, [Origin(origin.file, f"{origin.row}[{k}]") for k in range(len(rows))]),
        f"The change of {place} along {variable} over the conditions flown, about its mean, with the band of all forms "
        "that agree with the recordings.",
    )


MOST_ROWS, MOST_COLUMNS = 24, 12
"""Places and drivers of a map that can be read."""
SMALLEST = 1e-300
"""A p-value that a float no longer tells from nothing."""


def mismatch_places(key: str, rows: Sequence[Row], gate: float = math.nan) -> Chart:
    """Rows of `locate`, or `places` of `explain`; gate: what chance alone reaches, NaN where not known."""
    surprise = [_surprise(row) for row in rows]
    order = sorted(range(len(rows)), key=lambda k: -surprise[k])
    locations = list(dict.fromkeys(rows[k].text("location") for k in order))[:MOST_ROWS]
    drivers = list(dict.fromkeys(rows[k].text("driver") for k in order))[:MOST_COLUMNS]
    kept = [k for k in order if rows[k].text("location") in locations and rows[k].text("driver") in drivers]
    values = [surprise[k] for k in kept]
    cells = Cells(
        "−ln p",
        [drivers.index(rows[k].text("driver")) for k in kept],
        [locations.index(rows[k].text("location")) for k in kept],
        values,
        max(values, default=1.0),
        [f"{v:.0f}" if v >= 10 else f"{v:.1f}" for v in values],
        rooted=True,
        origins=[rows[k].origin for k in kept],
    )
    columns = (Column("place"), Column("varies with"), Column("−ln p"), Column("fall of χ²"), Column("stability"))
    chance = f" Chance alone reaches {gate:.1f}." if math.isfinite(gate) else ""
    left = len(rows) - len(kept)
    return Chart(
        key,
        "Where model and recordings differ",
        Axis("varies with", categories=[_short(driver) for driver in drivers]),
        Axis("", categories=locations),
        [cells],
        Table(
            columns,
            [
                (
                    rows[k].text("location"),
                    rows[k].text("driver"),
                    surprise[k],
                    rows[k].number("statistic"),
                    rows[k].number("stability"),
                )
                for k in order
            ],
            [rows[k].origin for k in order],
        ),
        f"−ln p of a correction at a place that varies with a driver: the darker, the less it is chance.{chance} "
        "Empty cells were not written or cannot be seen." + (f" Less surprising, not drawn: {left}." if left else ""),
    )


def _short(driver: str) -> str:
    """Of a group of drivers that the flights cannot tell apart, the first two."""
    parts = driver.split(" = ")
    return driver if len(parts) < 3 else f"{' = '.join(parts[:2])} + {len(parts) - 2}"


def _surprise(row: Row) -> float:
    if "surprise" in row:
        return row.number("surprise")
    p = row.number("p_value")
    return max(0.0, -math.log(max(p, SMALLEST))) if math.isfinite(p) else 0.0


def identified_fit(key: str, result: Identification) -> Chart:
    """Records that were fitted, left out in turn, and held out, as far as there are."""
    sets = {
        "fitted": result.in_sample,
        "left out in turn": result.cross_validated,
        "held out": result.held_out,
    }
    names = [q.sensor for q in _of_all(result.in_sample)]
    layers: list[Layer] = []
    rows: list[Sequence[Value]] = []
    for colour, (words, qualities) in enumerate(sets.items()):
        mine = [q for q in _of_all(qualities) if q.sensor in names]
        if mine:
            places = [float(names.index(q.sensor)) for q in mine]
            layers.append(Points(words, [q.chi2**0.5 for q in mine], places, colour))
            rows += [(split_column(q.sensor)[0], words, q.chi2**0.5, q.rms, q.unit, q.n) for q in mine]
    columns = (
        Column("reading"),
        Column("records"),
        Column("RMS, standard deviations"),
        Column("RMS"),
        Column("unit"),
        Column("readings"),
    )
    return Chart(
        key,
        "What identification leaves of each reading",
        Axis("RMS of the residual in standard deviations of the noise"),
        Axis("", categories=[split_column(name)[0] for name in names]),
        layers,
        Table(columns, rows),
        "At 1 a reading is reproduced as well as its noise allows.",
        [Mark(1.0, "noise alone")],
    )


def _of_all(qualities: Sequence[SensorQuality]) -> list[SensorQuality]:
    return [q for q in qualities if q.regime == EVERYTHING and q.n]
