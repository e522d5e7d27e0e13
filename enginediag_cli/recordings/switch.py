"""Switch columns: a valve, a bleed, an anti-ice command holds 0 or 1, or nothing."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from enginediag_cli.recordings.table import Recording

SHOWN = 5
"""Offending records that are named; the others are counted."""


@dataclass(frozen=True)
class SwitchFault:
    """A column declared as a switch that holds other values: how many, and the first of them with their lines."""

    column: str
    count: int
    lines: tuple[int, ...]
    values: tuple[str, ...]


def switch_faults(recording: Recording, switches: Iterable[str]) -> tuple[SwitchFault, ...]:
    """One fault for each of the columns that are there and hold anything but 0, 1 or nothing."""
    faults = []
    for column in switches:
        if column in recording.columns:
            values = recording[column]
            bad = np.flatnonzero(np.isfinite(values) & (values != 0.0) & (values != 1.0) | np.isinf(values))
            shown = [f"{values[k]:g}" for k in bad[:SHOWN]]
        elif column in recording.text:
            cells = [cell.strip() for cell in recording.text[column]]
            bad = np.array([k for k, cell in enumerate(cells) if not _is_switch(cell)], dtype=np.int64)
            shown = [cells[k] for k in bad[:SHOWN]]
        else:
            continue
        if bad.size:
            lines = tuple(int(n) for n in recording.line[bad[:SHOWN]])
            faults.append(SwitchFault(column, int(bad.size), lines, tuple(shown)))
    return tuple(faults)


def _is_switch(cell: str) -> bool:
    from enginediag_cli.recordings.formats.cells import is_missing

    if is_missing(cell):
        return True
    try:
        return float(cell) in (0.0, 1.0)
    except ValueError:
        return False
