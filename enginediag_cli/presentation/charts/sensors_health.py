"""The health of the instruments: whether each scatters as it did, how far it is off, how often it was silent."""

from __future__ import annotations

import math
from collections.abc import Mapping

import numpy as np

from enginediag_cli.presentation.charts.model import Axis, Bars, Chart, Column, Mark, Table
from enginediag_cli.presentation.charts.records import Records, mean_of
from enginediag_cli.units import split_column


def sensors_health(
    key: str, records: Records, wrong: Mapping[str, float], masked: Mapping[str, int] | None = None
) -> Chart:
    """wrong: by sensor column, the probability that it reads wrong, where it was asked for; masked: readings masked."""
    names = list(records.sigmas)
    stretches = [mine for _, mine in records.stretches()]
    scatter = [_scatter(records.sigmas[name], stretches) for name in names]
    last = stretches[-1]
    rows = []
    for name, ratio in zip(names, scatter, strict=True):
        quantity, unit = split_column(name)
        present = int(np.isfinite(records.sigmas[name]).sum())
        rows.append(
            (
                quantity,
                ratio,
                mean_of(records.sigmas[name][last]),
                mean_of(records.residual[name][last]),
                unit,
                wrong.get(name, math.nan),
                len(records) - present,
                (masked or {}).get(name, 0),
            )
        )
    columns = (
        Column("reading"),
        Column("scatter over identified noise"),
        Column("mean residual of the last stretch, standard deviations"),
        Column("mean residual"),
        Column("unit"),
        Column("probability that it reads wrong"),
        Column("records without residual"),
        Column("readings masked"),
    )
    return Chart(
        key,
        "Health of the instruments",
        Axis("scatter about the mean of its flight, over the noise identified"),
        Axis("", categories=[row[0] for row in rows]),
        [Bars("", list(range(len(names))), scatter, 0, thick=0.55)],
        Table(columns, rows),
        "An instrument that scatters as it did when it was identified is at 1. A failing one scatters more, a stuck "
        "one less; so does one that sees what the model lacks.",
        [Mark(1.0, "as identified")],
    )


def _scatter(values: np.ndarray, stretches: list[np.ndarray]) -> float:
    """Root of the mean square about the mean of each stretch."""
    parts = [values[mine][np.isfinite(values[mine])] for mine in stretches]
    parts = [part - part.mean() for part in parts if part.size > 1]
    joined = np.concatenate(parts) if parts else np.zeros(0)
    freedoms = sum(part.size - 1 for part in parts)
    return float(math.sqrt(float(joined @ joined) / freedoms)) if freedoms else math.nan
