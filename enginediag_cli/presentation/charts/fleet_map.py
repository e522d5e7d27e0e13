"""Heat map engines × parameters: what is one engine's own, and what all have."""

from __future__ import annotations

import math
from collections.abc import Sequence

from enginediag_cli.intervals import NORMAL_95
from enginediag_cli.presentation.charts.fleet_found import EngineFound, HealthFound
from enginediag_cli.presentation.charts.fleet_ranking import MOST
from enginediag_cli.presentation.charts.model import Axis, Cells, Chart, Column, Origin, Table

FULL = 8.0
"""Standard errors at which a cell is darkest."""


def fleet_map(key: str, engines: Sequence[EngineFound]) -> Chart | None:
    """Change of each parameter in its standard errors; empty where it is not known, None where no engine tells."""
    shown = [e for e in engines if any(math.isfinite(_score(h)) for h in e.health)][:MOST]
    names = list(dict.fromkeys(h.words for e in shown for h in e.health if math.isfinite(_score(h))))
    if not shown:
        return None
    x, y, value, words, rows = [], [], [], [], []
    origins: list[Origin] = []
    for line, engine in enumerate(shown):
        for health in engine.health:
            score = _score(health)
            if not math.isfinite(score):
                continue
            x.append(names.index(health.words))
            y.append(line)
            value.append(score)
            words.append(f"{score:.0f}".replace("-", "−") if abs(score) >= 2 else "")
            c, factor = health.change, health.scale
            cells = (factor * c.value, factor * c.low, factor * c.high, health.shown_unit)
            rows.append((engine.serial, health.words, score, *cells, health.probability))
            origins.append(health.origin)
    columns = (
        Column("engine"),
        Column("parameter"),
        Column("change in standard errors"),
        Column("change"),
        Column("95 % from"),
        Column("to"),
        Column("unit"),
        Column("probability that it changed"),
    )
    left = len(engines) - len(shown)
    return Chart(
        key,
        "Engines × parameters",
        Axis("", categories=names),
        Axis("", categories=[e.serial for e in shown]),
        [Cells("change", x, y, value, FULL, words, both=True, rooted=True, origins=origins)],
        Table(columns, rows, origins),
        "Change of each parameter in its standard errors; orange above, blue below the engine's baseline. A column of "
        "one colour is what most engines have in common: physics that the model lacks, or the recorder."
        + (f" {left} engines are not drawn." if left else ""),
    )


def _score(health: HealthFound) -> float:
    half = (health.change.high - health.change.low) / 2
    return health.change.value * NORMAL_95 / half if half > 0 else math.nan
