"""How evidence against an engine gathers over its life."""

from __future__ import annotations

import math
from collections.abc import Sequence

from enginediag_cli.presentation.charts.fleet_found import EngineFound
from enginediag_cli.presentation.charts.model import Axis, Chart, Column, Line, Mark, Table


def evidence_course(key: str, engine: EngineFound, marks: Sequence[Mark] = ()) -> Chart | None:
    """None where no flight has evidence."""
    told = [f for f in engine.by_flight if math.isfinite(f.log10_e)]
    if not told:
        return None
    x, y = [float(f.number) for f in told], [f.log10_e for f in told]
    columns = (Column("flight"), Column("log10 of evidence"), Column("p value"), Column("verdict"))
    rows = [(f.flight or str(f.number), f.log10_e, f.p_value, f.verdict) for f in told]
    return Chart(
        key,
        "Evidence that it has changed",
        Axis("flight, counted"),
        Axis("evidence, powers of ten"),
        [Line("", x, y, 0)],
        Table(columns, rows, [f.origin for f in told]),
        "At 2 the flights so far are a hundred times likelier if something has changed; it may be read at any flight.",
        marks,
    )
