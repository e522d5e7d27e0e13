"""A law, or a free curve, along what it varies with, with its band: what is settled whatever the form."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from enginediag_cli.intervals import NORMAL_95
from enginediag_cli.presentation.charts.model import Axis, Band, Chart, Column, Line, Origin, Table


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
