"""Engines by severity, worst first, with intervals."""

from __future__ import annotations

import math
from collections.abc import Sequence

from enginediag_cli.presentation.charts.fleet_found import EngineFound
from enginediag_cli.presentation.charts.model import Axis, Chart, Column, Intervals, Layer, Table

MOST = 40
"""Engines that are drawn; the table has all."""


def fleet_ranking(key: str, engines: Sequence[EngineFound]) -> Chart:
    """Engines in the order of their rank."""
    known = [e for e in engines if math.isfinite(e.severity.value)]
    shown = known[:MOST]
    unit = next((e.severity_unit for e in known if e.severity_unit), "")
    layers: list[Layer] = []
    for colour, (verdict, words) in enumerate((("healthy", "no change shown"), ("changed", "changed"))):
        mine = [k for k, e in enumerate(shown) if (e.verdict == "changed") == (verdict == "changed")]
        if mine:
            values = [shown[k].severity for k in mine]
            low, high = [v.low for v in values], [v.high for v in values]
            origins = [shown[k].origin for k in mine]
            points = [v.value for v in values]
            layers.append(Intervals(words, points, [float(k) for k in mine], low, high, colour, True, origins))
    columns = (
        Column("rank"),
        Column("engine"),
        Column("build"),
        Column("verdict"),
        Column("severity", unit),
        Column("95 % from", unit),
        Column("to", unit),
        Column("on the fleet's list"),
        Column("log10 of evidence"),
        Column("flights"),
    )
    rows = [
        (
            rank,
            e.serial,
            e.build,
            e.verdict + (f": {e.reason}" if e.reason else ""),
            e.severity.value,
            e.severity.low,
            e.severity.high,
            "yes" if e.discovery else "",
            e.log10_e,
            e.flights,
        )
        for rank, e in enumerate(engines, start=1)
    ]
    left = len(engines) - len(shown)
    words = "K of margin used" if unit == "K" else "severity, prior standard deviations"
    return Chart(
        key,
        "Engines by severity",
        Axis(words),
        Axis("", categories=[e.serial for e in shown]),
        layers,
        Table(columns, rows, [e.origin for e in engines]),
        "How far each engine has gone towards its limit, with 95 % intervals."
        + (f" {left} more engines, less severe or not judged, stand in the table." if left else ""),
    )
