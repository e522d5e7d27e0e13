"""Snapshots: the mean residual of each flight at take-off and in cruise, as engine trend monitoring has it."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from enginediag_cli.presentation.charts.model import Axis, Chart, Column, Intervals, Layer, Table
from enginediag_cli.presentation.charts.order import order_of
from enginediag_cli.presentation.charts.records import Records
from enginediag_cli.presentation.charts.rows import Row
from enginediag_cli.units import split_column

LOW_M, CRUISE, FULL = 600.0, 0.9, 0.9
"""A take-off is recorded up to so many metres above the lowest point of a flight; a cruise above that share of its
height; full power above that share of the flight's most. Judgement."""
Chosen = Callable[[np.ndarray], np.ndarray]

FEWEST, SENSORS = 3, 4
"""Records of a snapshot; readings of a chart."""


def snapshots(key: str, records: Records) -> list[Chart]:
    """Take-off and cruise of engines that fly, full load of those that stand; none where neither is known."""
    if not records.power:
        return []
    power = records.inputs[records.power]
    stretches = records.stretches()
    if records.altitude:
        height = records.inputs[records.altitude]
        kinds: dict[str, Chosen] = {"take-off": _take_off(height, power), "cruise": _cruise(height)}
    else:
        kinds = {"full load": lambda mine: mine[power[mine] >= FULL * np.nanmax(power[mine])]}
    charts = []
    for name, chosen in kinds.items():
        found = [(stretch, chosen(mine)) for stretch, mine in stretches]
        kept = [(stretch, mine) for stretch, mine in found if len(mine) >= FEWEST]
        if len(kept) > 1:
            charts.append(_chart(f"{key}-{name.replace(' ', '-')}", name, records, kept))
    return charts


def _take_off(height: np.ndarray, power: np.ndarray) -> Chosen:
    def chosen(mine: np.ndarray) -> np.ndarray:
        low = mine[height[mine] <= np.nanmin(height[mine]) + LOW_M]
        return low[power[low] >= FULL * np.nanmax(power[mine])] if len(low) else low

    return chosen


def _cruise(height: np.ndarray) -> Chosen:
    def chosen(mine: np.ndarray) -> np.ndarray:
        low, high = np.nanmin(height[mine]), np.nanmax(height[mine])
        return mine[height[mine] >= low + CRUISE * (high - low)] if high > low else mine[:0]

    return chosen


def _chart(key: str, name: str, records: Records, kept: list[tuple[str, np.ndarray]]) -> Chart:
    rows = [Row({"flight": records.flights[mine[0]]}, records.origin(int(mine[0]))) for _, mine in kept]
    order = order_of(rows)
    layers: list[Layer] = []
    cells, origins = [], []
    for colour, sensor in enumerate(records.farthest(SENSORS)):
        quantity, unit = split_column(sensor)
        mean, low, high = [], [], []
        for (stretch, mine), row in zip(kept, rows, strict=True):
            values = records.sigmas[sensor][mine]
            raw = records.residual[sensor][mine]
            known = np.isfinite(values)
            quarter, middle, three = (
                np.quantile(values[known], [0.25, 0.5, 0.75]).tolist() if known.any() else [np.nan] * 3
            )
            mean.append(middle)
            low.append(quarter)
            high.append(three)
            told = float(np.median(raw[known])) if known.any() else None
            cells.append((stretch, quantity, int(known.sum()), middle, told, unit))
            origins.append(row.origin)
        layers.append(Intervals(quantity, [x + 0.05 * (colour - 1.5) for x in order.x], mean, low, high, colour))
    columns = (
        Column("flight"),
        Column("reading"),
        Column("records"),
        Column("median residual, standard deviations"),
        Column("median residual"),
        Column("unit"),
    )
    rules = {
        "take-off": f"within {LOW_M:g} m of the lowest record, at {FULL:.0%} of the most power or above",
        "cruise": f"above {CRUISE:.0%} of the flight's height",
        "full load": f"at {FULL:.0%} of the most power or above",
    }
    return Chart(
        key,
        f"Snapshots: {name}",
        order.axis,
        Axis("residual, standard deviations"),
        layers,
        Table(columns, cells, origins),
        f"Median residual of each flight's records {rules[name].replace('%', ' %')}; the bars hold the middle half. "
        "The line named is that of the first record.",
    )
