"""What `check` shows of an engine file: its design table, and a heating value that does not fit the fuel, as rows."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING, Any

import numpy as np

from enginediag_cli.engine.overview import design_table, heating_value_doubts
from enginediag_cli.presentation.numbers import with_unit
from enginediag_cli.units import split_column

if TYPE_CHECKING:
    from enginediag_cli.engine.engine import Engine

SHOWN = {"N": (1e-3, "kN"), "W": (1e-3, "kW"), "Pa": (1e-3, "kPa")}
"""SI units that are large for an engine, with the factor and the unit that engineers read."""
PER_KWH = 3.6e6
"""J in a kilowatt hour."""
SFC = 1e6
"""mg per kg: specific fuel consumption in mg/(N s), which is g/(kN s)."""


def overview_rows(engine: Engine) -> Iterator[dict[str, Any]]:
    """One row per operating point of the design table, and one per heating value that does not fit."""
    table = design_table(engine)
    for point, values, reason in zip(table.points, table.values, table.reasons, strict=True):
        known = dict(zip(table.columns, values.tolist(), strict=True))
        shown = [_shown(c, v) for c, v in known.items() if np.isfinite(v)]
        if "Fn_N" not in known and known.get("power_W", 0.0) > 0.0 and "Wf_kg_s" in known:
            shown.insert(2, f"SFC {with_unit(known['Wf_kg_s'] / known['power_W'] * PER_KWH, 'kg/(kW h)')}")
        found = ", ".join(shown) if not reason else f"no operating point: {reason}"
        yield {"level": "note", "about": "design", "name": point, "found": found}
    for doubt in heating_value_doubts(engine):
        hint = f"the lower one is meant: {doubt.lower:.3g} J/kg, or another fuel_hydrogen_carbon_ratio"
        yield {
            "level": "warning",
            "about": "fuel",
            "name": f"{doubt.burner}.lower_heating_value_J_kg",
            "problem": str(doubt),
            "hint": hint,
        }


def _shown(column: str, value: float) -> str:
    if column == "SFC_kg_Ns":
        return f"SFC {with_unit(value * SFC, 'mg/(N s)')}"
    quantity, unit = split_column(column)
    factor, words = SHOWN.get(unit, (1.0, unit.replace("_", "/")))
    return f"{quantity} {with_unit(value * factor, words)}"
